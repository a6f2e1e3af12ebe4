r"""Fibers of three bending modes: the paper's model, generalized.

The paper bends its cubic by one mode, Eq. 14. Here a fiber is the cubic plus :math:`m`
modes that are orthogonal in bending and in length,

.. math:: r(u) = c(u) + \sum_k b_k \varphi_k(u), \qquad b_k \in R^3.

The cubic is the curve of least bending energy between its ends; the energy of the whole
is least, under Eq. 19, where each mode's share of the curve is

.. math:: y_k = g_k + b_k = \frac{\lambda_k}{\lambda_k + \mu} g_k, \qquad
          \sum_k |y_k|^2 = R,

with :math:`g_k` the share of the cubic, :math:`\mu` the axial force and :math:`R` the
length that is left for bending: one equation in one number, docs/derivations.md, D7.
With one mode it is Eq. 22. A fiber whose cups are parallel buckles: :math:`\mu =
-\lambda_1`, and the caller says to which side.
"""

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from ply.fiber import (
    PARALLEL,
    STRAIGHT,
    WEAK,
    Array,
    FiberStatus,
    Statuses,
    cubic_fibers,
    dot,
    length_error,
)
from ply.secular import Secular, least_energy, other_side

OPEN = WEAK / 8  # [-] lean of the first mode that is noise: 0.05 deg between the cups


@dataclass(frozen=True, eq=False)
class Modes:
    """Polynomials with double zeros at both ends, orthogonal in slope and bending.

    The mean squared slope of each is one.

    Attributes:
        loads: Buckling loads: mean squared second derivatives, ascending, shape (m,).
        areas: Integrals over u, shape (m,); 0 for odd polynomials.
        tilts: Integrals of the polynomials times 2 u - 1, shape (m,); 0 for even ones.
        powers: Coefficients of u^0 ... u^(m + 3), shape (m, m + 4).
    """

    loads: Array
    areas: Array
    tilts: Array
    powers: Array


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
    side: Array
    force: Array


@cache
def bending_modes(count: int) -> Modes:
    """The modes of a clamped fiber, from one small eigenproblem."""
    shape = Polynomial([0, 0, 1, -2, 1])  # u^2 (1 - u)^2
    basis = [shape * Polynomial([-1, 2]) ** j for j in range(count)]

    def products(order: int) -> Array:
        rates = [one.deriv(order) for one in basis]
        return np.array([[(a * b).integ()(1.0) for b in rates] for a in rates])

    root = np.linalg.inv(np.linalg.cholesky(products(1)))
    loads, vectors = np.linalg.eigh(root @ products(2) @ root.T)
    shares = vectors.T @ root
    shares[abs(shares) < 1e-9 * abs(shares).max()] = 0  # parity, exactly
    shares *= np.sign(shares.sum(axis=1))[:, None]  # > 0 just before the second end
    modes = [sum(a * one for a, one in zip(row, basis, strict=True)) for row in shares]
    odd = np.arange(count) % 2 == 1
    areas = np.array([one.integ()(1.0) for one in modes])
    tilts = np.array([(one * Polynomial([-1, 2])).integ()(1.0) for one in modes])
    powers = np.zeros((count, count + 4))
    for row, one in zip(powers, modes, strict=True):
        row[2 : len(one.coef)] = one.coef[2:]
    return Modes(loads, np.where(odd, 0, areas), np.where(odd, tilts, 0), powers)


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
    """Curves of given length and least bending energy between two cups (D7).

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
    up, sideways = _frame(dr0, dr1, normal)
    g = _shares(basis, chord / L[..., None], dr0, dr1)
    gamma = length_error(chord, dr0, dr1, L)
    free = g - dot(g, sideways)[..., None] * sideways if ribbon else g
    push = np.zeros(L.shape)
    if load is not None:
        push = dot(np.asarray(load, dtype=float), up) * L**3
        free = free + (_each(basis.areas / basis.loads, g) * push)[..., None] * up
    along = up if ribbon else _direction(free[0], up)
    lean = dot(free[0], along)
    equation = Secular(
        first=(basis.loads[0] * lean) ** 2,
        rest=_each(basis.loads[1:], g) ** 2 * dot(free[1:], free[1:]),
        gaps=_each(basis.loads[1:] - basis.loads[0], g),
        room=dot(g, g).sum(axis=0) - gamma - softness * basis.loads[0],
        slope=softness,
    )
    way = np.where(dot(along, up) < 0, -1, 1)  # 1: along points up
    x, share, bulge = _choose(equation, lean, way * np.asarray(side), ribbon)
    bent = free[1:] * (_each(basis.loads[1:], g) / (equation.gaps + x))[..., None]
    y = np.concatenate([((bulge * np.sqrt(share))[..., None] * along)[None], bent])
    straight = (abs(gamma) <= STRAIGHT) & (push == 0)
    b = np.where(straight[..., None], 0.0, y - g) * L[..., None]
    a = np.zeros((*L.shape, modes + 4, 3))
    a[..., :4, :] = cubic_fibers(r0, r1, dr0, dr1, L)[..., :4, :]
    a[..., 2:, :] += np.einsum("kc,k...d->...cd", basis.powers[:, 2:], b)
    force = np.where(straight, 0.0, x - basis.loads[0])
    status = np.select(
        [
            dot(chord, chord) > L**2 * (1 + STRAIGHT),
            np.isinf(force) & (equation.room < -STRAIGHT),
            (abs(lean) <= OPEN) & (share > (2 * OPEN) ** 2) & ~straight,
        ],
        [FiberStatus.OVERSTRETCHED, FiberStatus.TAUT, FiberStatus.WEAK_DIRECTION],
        FiberStatus.MET,
    )
    return ModalFibers(a, status, np.where(straight, 0, way * bulge), force)


def _each(values: Array, like: Array) -> Array:
    """Values of each mode, shape (k,), against the batch axes of g."""
    return values.reshape(-1, *[1] * (like.ndim - 2))


def _frame(dr0: Array, dr1: Array, normal: Array) -> tuple[Array, Array]:
    """Direction of the bulge and direction across the strip, unit vectors or zero."""
    sideways = _unit(np.cross(normal, dr0 + dr1))
    return _unit(np.cross(dr0 + dr1, sideways)), sideways


def _unit(vectors: Array) -> Array:
    size = np.sqrt(dot(vectors, vectors))[..., None]
    return vectors / np.where(size > 0, size, 1.0)


def _direction(vectors: Array, otherwise: Array) -> Array:
    """Unit vectors, or others where a vector is rounding."""
    vanishes = dot(vectors, vectors) < PARALLEL**2
    return np.where(vanishes[..., None], otherwise, _unit(vectors))


def _shares(basis: Modes, chord: Array, dr0: Array, dr1: Array) -> Array:
    """Shares g_k of the modes in the cubic, shape (m, ..., 3), in lengths (D7)."""
    a3 = dr0 + dr1 - 2 * chord
    axes = [1] * chord.ndim
    areas, tilts = basis.areas.reshape(-1, *axes), basis.tilts.reshape(-1, *axes)
    return areas * (dr0 - dr1) - 3 * tilts * a3


def _choose(
    equation: Secular, lean: Array, wanted: Array, ribbon: bool
) -> tuple[Array, Array, Array]:
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
