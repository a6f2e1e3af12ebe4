r"""How points of the ply move with the cups: analytic derivatives by their poses.

A cup is moved by a twist: a translation of its face center and a rotation vector about
it, both along the world's axes. A point depends on the cups around it alone, at most
four. Points are linear in the parts of their fibers, so a derivative is a row of the
surface's constant weights times the rates of these parts; docs/derivations.md, D16.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ply import patch, strip
from ply.errors import PlyError
from ply.fiber import Array
from ply.grid import AxisPlace, CupGrid
from ply.rates import (
    EndRates,
    Ends,
    Loading,
    fiber_rates,
    natural_length_rates,
    part_polynomials,
)
from ply.weave import MODELS, PlyFibers

FROM_CHORD, FROM_FIRST, FROM_SECOND = slice(0, 3), slice(3, 6), slice(6, 9)
BLOCK = 2**20  # [-] numbers gathered at a time: 8 MB
CORNERS = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])  # row and column of cups around


class PointJacobian(NamedTuple):
    """Derivatives of n points by the twists of the cups around them.

    Attributes:
        values: Derivatives, shape (..., n, 4, 3, 6): point coordinates by translation,
            in [-], and rotation vector, in [m/rad]. A cup that `cups` names again has
            zeros there, so that sums over all four are right.
        cups: Cups around each point, shape (n, 4), as `PlySampling.cups_around`.
    """

    values: Array
    cups: NDArray[np.int64]

    def gap_rows(self, normals: Array) -> Array:
        """Derivatives of the gaps of the points to a surface.

        The nearest point of the surface slides along it, so its motion does not count.

        Args:
            normals: Unit normals of the surface nearest to the points, out of the mold,
                shape (..., n, 3).

        Returns:
            Derivatives, shape (..., n, 4, 6), for the same cups.
        """
        return (normals[..., None, None, :] @ self.values)[..., 0, :]


def point_jacobian(
    grid: CupGrid,
    fibers: PlyFibers,
    positions: Array,
    rotations: Array,
    points_st: ArrayLike,
    *,
    model: str = "quartic",
    take_up: float | None = None,
    gravity: ArrayLike | None = None,
    stiffness: float | None = None,
    softness: float = 0.0,
) -> PointJacobian:
    """Derivatives of material points by the poses of the cups.

    Strips keep their sides and fibers their status. A fiber whose length is not met
    changes as the cubic that it keeps. Where cups of the quartic are nearly parallel
    (WEAK_DIRECTION), derivatives are as large as that model's are.

    Args:
        grid: The cup array.
        fibers: Fibers of the same poses.
        positions: Centers of the suction faces, shape (..., n_cups, 3), in [m].
        rotations: Cup frames, shape (..., n_cups, 3, 3).
        points_st: Material coordinates (s, t), shape (n, 2), in [m]; of a sampling
            `sampling.points_st.reshape(-1, 2)`.
        model: The model of the fibers, as all that follows as given to `ply_fibers`.
        take_up: Largest change of fiber length either way, in [m], or None.
        gravity: Weight of the ply per area, shape (3,), in [N/m^2].
        stiffness: Bending stiffness, in [N m].
        softness: Strain of a fiber per axial force and width, in [m/N].

    Returns:
        The derivatives.

    Raises:
        PlyError: The model is unknown, a stiffness is missing, or the points are not
            pairs.
    """
    points_st = np.asarray(points_st, dtype=float)
    _check(points_st, model, gravity, stiffness, softness)
    if model == "quartic" and take_up is not None:
        model = "cubic"  # inside the band and out of it
    bending = stiffness or 0.0
    load = None if gravity is None else np.asarray(gravity, dtype=float) / bending
    s, t = grid.place_s(points_st[:, 0]), grid.place_t(points_st[:, 1])
    cells = t.cup * grid.columns + s.cup
    reach = CORNERS * np.stack([t.in_span, s.in_span], axis=-1)[:, None]
    cups = cells[:, None] + reach @ [grid.columns, 1]
    out = np.zeros((*np.shape(positions)[:-2], len(points_st), 4, 3, 6))
    held = np.flatnonzero(~s.in_span & ~t.in_span)
    local = np.stack([s.y[held], t.y[held], 0 * held], axis=-1)
    arms = (rotations[..., cups[held, 0], :, :] @ local[..., None])[..., 0]
    out[..., held, 0, :, :3] = np.eye(3)
    out[..., held, 0, :, 3:] = np.swapaxes(_turns(arms), -1, -2)
    for axis in (0, 1):
        rows = _rows(grid, s, t, axis, *fibers.s.shape[-3:-1])
        if len(rows.points):
            strips, place = np.unique(rows.strips, return_inverse=True)
            family = _family(grid, fibers, axis, strips)
            ends, rates = _ends(grid, axis, strips, positions, rotations, family)
            in_band = bool(take_up) & (family.used == family.natural)
            if take_up:
                dL = natural_length_rates(ends, rates)
                rates = rates._replace(length=np.where(in_band[..., None], dL, 0.0))
            soft = 2 * softness * bending / family.length**2
            loading = Loading(load, soft, in_band)
            parts = fiber_rates(model, family.coefficients, ends, rates, loading)
            _add(out, rows, place, parts, part_polynomials(model, parts.shape[-1]))
    return PointJacobian(out, cups)


class _Rows(NamedTuple):
    """Points that hang on strips of one family, once for each strip."""

    points: NDArray[np.int64]  # (n,)
    strips: NDArray[np.int64]  # (n,)
    slots: NDArray[np.int64]  # (n, 2): places of the strip's cups among those around
    weights: Array  # (n, count, terms) of the coefficients of its fibers


class _Family(NamedTuple):
    """Some strips of one family; strips on the axis before their fibers."""

    coefficients: Array
    used: Array
    natural: Array
    length: float


def _rows(
    grid: CupGrid, s: AxisPlace, t: AxisPlace, axis: int, count: int, terms: int
) -> _Rows:
    """Rows of the surface: those of `ply.shape.evaluate`, strip by strip."""
    along, across = (s, t) if axis == 0 else (t, s)
    per_row = grid.columns - 1 if axis == 0 else grid.columns
    step = per_row if axis == 0 else 1  # to the strip beyond the patch
    strips = t.cup * per_row + s.cup
    size, half = (-1, count, terms), grid.half_width
    lone = np.flatnonzero(along.in_span & ~across.in_span)
    single = strip.weights(along.u[lone], across.y[lone], half, count, terms)
    inside = np.flatnonzero(s.in_span & t.in_span)
    lengths = grid.s_length, grid.t_length
    four = patch.weights(s.u[inside], t.u[inside], *lengths, half, count, terms)
    low, high = np.split(four, 4, axis=-1)[2 * axis : 2 * axis + 2]
    slots = np.array([[0, 1], [2, 3]] if axis == 0 else [[0, 2], [1, 3]])
    repeats = [len(lone) + len(inside), len(inside)]
    return _Rows(
        np.concatenate([lone, inside, inside]),
        np.concatenate([strips[lone], strips[inside], strips[inside] + step]),
        np.repeat(slots, repeats, axis=0),
        np.concatenate([part.reshape(size) for part in (single, low, high)]),
    )


def _family(grid: CupGrid, fibers: PlyFibers, axis: int, strips: NDArray) -> _Family:
    arrays = [
        (fibers.s, fibers.s_used, fibers.s_natural),
        (fibers.t, fibers.t_used, fibers.t_natural),
    ][axis]
    batch = np.ndim(fibers.s_used) - 3
    flat = [
        array.reshape(*array.shape[:batch], -1, *array.shape[batch + 2 :])
        for array in arrays
    ]
    coefficients, used, natural = (np.take(a, strips, axis=batch) for a in flat)
    return _Family(coefficients, used, natural, (grid.s_length, grid.t_length)[axis])


def _ends(
    grid: CupGrid,
    axis: int,
    strips: NDArray,
    positions: Array,
    rotations: Array,
    family: _Family,
) -> tuple[Ends, EndRates]:
    """Ends of the fibers of strips, Eq. 1-4, and their rates.

    Nine directions: the chord, which stands for both translations, and the rotation
    vectors of the first and of the second cup.
    """
    first, second = grid.neighbors[axis * grid.n_s_pairs + strips].T
    frames = [rotations[..., cups, None, :, :] for cups in (first, second)]
    chord = (positions[..., second, :] - positions[..., first, :])[..., None, :]
    count = family.used.shape[-1]
    offsets = np.linspace(-grid.half_width, grid.half_width, count)[:, None]
    along = [frame[..., axis] for frame in frames]
    arms = [
        way * grid.half_width * x + offsets * frame[..., 1 - axis]
        for way, x, frame in zip((1, -1), along, frames, strict=True)
    ]
    chord = chord + arms[1] - arms[0]
    shape = (*chord.shape[:-1], 9, 3)
    r0, dchord, ddr0, ddr1, dn = (np.zeros(shape) for _ in range(5))
    r0[..., FROM_FIRST, :] = _turns(arms[0])
    dchord[..., FROM_CHORD, :] = np.eye(3)
    dchord[..., FROM_FIRST, :] = -r0[..., FROM_FIRST, :]
    dchord[..., FROM_SECOND, :] = _turns(arms[1])
    ddr0[..., FROM_FIRST, :] = _turns(along[0])
    ddr1[..., FROM_SECOND, :] = _turns(along[1])
    dn[..., FROM_FIRST, :] = _turns(frames[0][..., 2])
    dn[..., FROM_SECOND, :] = _turns(frames[1][..., 2])
    normal = frames[0][..., 2] + frames[1][..., 2]
    chord, dr0, dr1, normal = np.broadcast_arrays(chord, *along, normal)
    ends = Ends(chord, dr0, dr1, normal, family.used)
    return ends, EndRates(r0, dchord, ddr0, ddr1, dn, np.zeros(shape[:-1]))


def _add(
    out: Array, rows: _Rows, place: NDArray, parts: Array, polynomials: Array
) -> None:
    """Add what strips do to their points, a block of points at a time."""
    weights = rows.weights @ polynomials.T  # (n, count, parts)
    shifts = weights[..., 0].sum(axis=-1)[:, None, None] * np.eye(3)
    flat = np.swapaxes(np.moveaxis(parts, -1, -3), -1, -2)  # (..., parts, 3, D)
    flat = flat.reshape(*parts.shape[:-4], weights[0].size, -1)
    poses = max(1, flat[..., 0, 0, 0].size)
    block = max(1, BLOCK // (poses * flat[0, 0].size))
    for start in range(0, len(rows.points), block):
        n = slice(start, start + block)
        moved = weights[n].reshape(-1, 1, weights[0].size) @ flat[..., place[n], :, :]
        moved = moved.reshape(*moved.shape[:-2], 3, parts.shape[-3])
        points, (first, second) = rows.points[n], rows.slots[n].T
        chord = moved[..., FROM_CHORD]
        out[..., points, first, :, :3] += shifts[n] - chord
        out[..., points, first, :, 3:] += moved[..., FROM_FIRST]
        out[..., points, second, :, :3] += chord
        out[..., points, second, :, 3:] += moved[..., FROM_SECOND]


def _turns(vectors: Array) -> Array:
    """Cross products of the axes with vectors, shape (..., 3) to (..., 3, 3)."""
    out = np.zeros((*vectors.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i, j], out[..., j, i] = -vectors[..., k], vectors[..., k]
    return out


def _check(
    points_st: Array,
    model: str,
    gravity: ArrayLike | None,
    stiffness: float | None,
    softness: float,
) -> None:
    if model not in MODELS:
        problem = f"there is no model {model!r}"
        raise PlyError("model", problem, f"choose from {', '.join(MODELS)}")
    if points_st.ndim != 2 or points_st.shape[1] != 2:
        problem = f"shape {points_st.shape} is not (n, 2)"
        raise PlyError("points_st", problem, "give pairs (s, t)")
    if (gravity is not None or softness > 0) and not (stiffness and stiffness > 0):
        problem = "gravity and softness ask for a bending stiffness"
        raise PlyError("stiffness", problem, "give one above 0 N m")
