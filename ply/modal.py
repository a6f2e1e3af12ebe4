r"""Fibers of three bending modes: the paper's model, generalized.

The paper bends its cubic by one mode, Eq. 14. Here a fiber is the cubic plus :math:`m`
modes that are orthogonal in bending and in length,

.. math:: r(u) = c(u) + \sum_k b_k \varphi_k(u), \qquad b_k \in R^3.

The cubic is the curve of least bending energy between its ends; the energy of the whole
is least, under Eq. 19, where each mode's share of the curve is

.. math:: y_k = g_k + b_k = \frac{\lambda_k}{\lambda_k + \mu} g_k, \qquad
          \sum_k |y_k|^2 = R,

with :math:`g_k` the share of the cubic, :math:`\mu` the axial force and :math:`R` the
length that is left for bending: one equation in one number, docs/derivations.md, D13.
With one mode it is Eq. 22. A fiber whose cups are parallel buckles: :math:`\mu =
-\lambda_1`, and the caller says to which side.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ply.fiber import (
    PARALLEL,
    STRAIGHT,
    WEAK,
    Array,
    FiberStatus,
    Statuses,
    dot,
    length_error,
)
from ply.modes import Modes, bending_modes
from ply.secular import Secular, least_energy, other_side

OPEN = WEAK / 8  # [-] lean of the first mode that is noise: 0.05 deg between the cups


class ModalFibers(NamedTuple):
    """Curves of three modes and what became of each.

    Attributes:
        coefficients: Coefficients of u^0 ... u^(m + 3), shape (..., m + 4, 3), in [m].
        status: FiberStatus, shape (...).
        side: Side to which the first mode bends, shape (...): 1 along the normal, -1
            against it, 0 for a fiber that does not bend.
        force: Axial force mu, compression negative, in units of bending stiffness over
            squared length, shape (...); infinite for a fiber that is taut.
    """

    coefficients: Array
    status: Statuses
    side: Statuses
    force: Array


def modal_fibers(
    r0: Array,
    r1: Array,
    dr0: Array,
    dr1: Array,
    length: ArrayLike,
    normal: Array,
    *,
    modes: int = 3,
    side: ArrayLike = 0,
    load: ArrayLike | None = None,
    softness: float = 0.0,
    ribbon: bool = True,
) -> ModalFibers:
    """Curves of given length and least bending energy between two cups (D13).

    Args:
        r0: First ends, shape (..., 3), in [m].
        r1: Second ends, shape (..., 3), in [m].
        dr0: Unit tangents at the first ends, shape (..., 3).
        dr1: Unit tangents at the second ends, shape (..., 3).
        length: Fiber lengths, shape (...) or one for all, in [m].
        normal: Mean normals of the two cups, shape (..., 3); any length.
        modes: Number of modes.
        side: Side to bulge to where slack leaves a choice, shape (...): 1 along the
            normal, -1 against it, 0 for the side to which the cups lean.
        load: Weight of the ply per area over its bending stiffness, a vector, shape
            (..., 3) or (3,), in [1/m^3].
        softness: Relative change of the mean squared speed per unit of mu.
        ribbon: True where the last batch axis holds the fibers of one strip: they bulge
            to one side, and nowhere in their own plane, since a strip's width does not
            bend there. False for lone fibers: with one mode, the paper's.

    Returns:
        The curves, with what became of each.
    """
    chord = r1 - r0
    L = np.broadcast_to(np.asarray(length, dtype=float), chord.shape[:-1])
    basis = bending_modes(modes)
    gamma = length_error(chord, dr0, dr1, L)
    cubic = _Cubic.of(chord / L[..., None], dr0, dr1, normal, ribbon)
    push = np.zeros((1,) * L.ndim)
    if load is not None:
        push = dot(np.asarray(load, dtype=float), cubic.up) * L**3
    along, lean, equation = _equation(basis, cubic, gamma, push, softness, ribbon)
    way = np.where(dot(along, cubic.up) < 0, -1, 1)  # 1: along points up
    x, share, bulge = _choose(equation, lean, way * np.asarray(side), ribbon)
    straight = (abs(gamma) <= STRAIGHT) & (push == 0)
    scale = np.where(straight, 0.0, L)[..., None]
    parts = np.empty((*L.shape, 3, modes + 4))
    parts[..., 0], parts[..., 1] = r0, chord
    parts[..., 2], parts[..., 3] = L[..., None] * dr0, L[..., None] * dr1
    first = (bulge * np.sqrt(share))[..., None] * along - basis.areas[0] * cubic.turn
    parts[..., 4] = scale * first
    for k in range(1, modes):
        falls = basis.loads[k] / (x + (basis.loads[k] - basis.loads[0]))
        parts[..., 4 + k] = scale * cubic.change(basis, k, falls, push)
    a = np.matmul(parts.reshape(-1, modes + 4), basis.powers).reshape(parts.shape)
    force = np.where(straight, 0.0, x - basis.loads[0])
    status: Statuses = np.full(L.shape, int(FiberStatus.MET))  # the last one holds
    weak = (abs(lean) <= OPEN) & (share > (2 * OPEN) ** 2) & ~straight
    status[weak] = FiberStatus.WEAK_DIRECTION
    status[np.isinf(force) & (equation.room < -STRAIGHT)] = FiberStatus.TAUT
    status[dot(chord, chord) > L**2 * (1 + STRAIGHT)] = FiberStatus.OVERSTRETCHED
    taken: Statuses = np.where(straight, 0, way * bulge)
    return ModalFibers(np.swapaxes(a, -1, -2), status, taken, force)


class _Cubic(NamedTuple):
    """What the shares g_k of the modes in the cubic are made of, in fiber lengths.

    g_k = areas_k turn - 3 tilts_k skew. "kept" is what a strip's width lets bend.
    """

    up: Array  # direction of the bulge, a unit vector
    turn: Array  # r'_0 - r'_1: bends the fiber one way
    skew: Array  # A3 / L of D1: bends it like an S
    turn_kept: Array
    skew_kept: Array

    @classmethod
    def of(
        cls, chord: Array, dr0: Array, dr1: Array, normal: Array, ribbon: bool
    ) -> "_Cubic":
        total, turn = dr0 + dr1, dr0 - dr1
        skew = total - 2 * chord
        sideways = _unit(_cross(normal, total))
        up = _unit(_cross(total, sideways))
        if not ribbon:
            return cls(up, turn, skew, turn, skew)
        turn_kept = turn - dot(turn, sideways)[..., None] * sideways
        skew_kept = skew - dot(skew, sideways)[..., None] * sideways
        return cls(up, turn, skew, turn_kept, skew_kept)

    def change(self, basis: Modes, k: int, falls: Array, push: Array) -> Array:
        """Amplitude b_k of a mode whose share falls by a factor, shape (..., 3)."""
        if basis.tilts[k]:
            return -3 * basis.tilts[k] * (falls[..., None] * self.skew_kept - self.skew)
        change = basis.areas[k] * (falls[..., None] * self.turn_kept - self.turn)
        lift = falls * push * (basis.areas[k] / basis.loads[k])
        return change + lift[..., None] * self.up


def _equation(
    basis: Modes,
    cubic: _Cubic,
    gamma: Array,
    push: Array,
    softness: float,
    ribbon: bool,
) -> tuple[Array, Array, Secular]:
    """Direction of the first mode, its share there, and the equation of its force."""
    lift = push[..., None] * cubic.up
    turn = basis.areas[0] * cubic.turn_kept + basis.areas[0] / basis.loads[0] * lift
    along = cubic.up if ribbon else _direction(turn, cubic.up)
    lean = dot(turn, along) + np.zeros(gamma.shape)
    turned, skewed = dot(cubic.turn, cubic.turn), dot(cubic.skew, cubic.skew)
    room = (basis.areas**2).sum() * turned + 9 * (basis.tilts**2).sum() * skewed - gamma
    rest = np.empty((len(basis.loads) - 1, *gamma.shape))
    skewed = dot(cubic.skew_kept, cubic.skew_kept)
    for k in range(1, len(basis.loads)):
        if basis.tilts[k]:
            rest[k - 1] = (3 * basis.loads[k] * basis.tilts[k]) ** 2 * skewed
        else:
            turn = basis.loads[k] * cubic.turn_kept + lift
            rest[k - 1] = basis.areas[k] ** 2 * dot(turn, turn)
    gaps = basis.loads[1:] - basis.loads[0]
    first, room = (basis.loads[0] * lean) ** 2, room - softness * basis.loads[0]
    flat = gaps.reshape(-1, *[1] * gamma.ndim)
    return along, lean, Secular(first, rest, flat, room, softness)


def _cross(a: Array, b: Array) -> Array:
    """Cross products; numpy's own takes thrice as long for a few fibers."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0] = y * b[..., 2] - z * b[..., 1]
    out[..., 1] = z * b[..., 0] - x * b[..., 2]
    out[..., 2] = x * b[..., 1] - y * b[..., 0]
    return out


def _unit(vectors: Array) -> Array:
    size = np.sqrt(dot(vectors, vectors))[..., None]
    return vectors / np.where(size > 0, size, 1.0)


def _direction(vectors: Array, otherwise: Array) -> Array:
    """Unit vectors, or others where a vector is rounding."""
    vanishes = dot(vectors, vectors) < PARALLEL**2
    return np.where(vanishes[..., None], otherwise, _unit(vectors))


def _choose(
    equation: Secular, lean: Array, wanted: Array, ribbon: bool
) -> tuple[Array, Array, Statuses]:
    """Root, share of the first mode and its sign, on the wanted side if it exists."""
    shape = lean.shape
    flat = Secular(
        equation.first.ravel(),
        equation.rest.reshape(len(equation.rest), lean.size),
        equation.gaps.reshape(-1, 1),
        equation.room.ravel(),
        equation.slope,
    )
    x, share = least_energy(flat)
    bulge = np.where(lean < 0, -1, 1).ravel()
    if ribbon:
        common = lean.mean(axis=-1, keepdims=True)
        wanted = np.where(wanted == 0, np.where(common > OPEN, 1, -1), wanted)
    asked = np.broadcast_to(wanted, shape).ravel()
    turn = np.flatnonzero(asked == -bulge)
    if turn.size:
        part = flat._replace(
            first=flat.first[turn], rest=flat.rest[:, turn], room=flat.room[turn]
        )
        other, its_share, exists = other_side(part)
        turn = turn[exists]
        x[turn], share[turn] = other[exists], its_share[exists]
        bulge[turn] *= -1
    return x.reshape(shape), share.reshape(shape), bulge.reshape(shape)
