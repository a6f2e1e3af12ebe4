"""Which side the strips of a ply bulge to, where slack leaves a choice.

The side is history: a trajectory carries it, `PlyFibers.sides`. Where none is known,
`alternatives` offers the shapes of least energy.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cache
from itertools import combinations, product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ply.fiber import Array, dot, powers
from ply.grid import CupGrid
from ply.sampling import PlySampling
from ply.weave import PlyFibers, Sides, ply_fibers

ALL = 8  # [-] open strips up to which every combination of sides is weighed
CELLS = 7  # [-] cells in the length of a span, of the grid that sums bending energy
PLACES = np.linspace(0.0, 1.0, 9)  # [-] along a fiber, where bending is summed


@dataclass(frozen=True, eq=False)
class Choice:
    """Shapes of one pose by the sides of their strips, least energy first.

    Attributes:
        grid: The cup array.
        own: Fibers on the sides that the cups lean to.
        other: The same asked to bulge to the other side.
        flips: Strips of each shape that are on the other side, those along s first,
            shape (n, strips).
        energy: Bending energies per stiffness, in [-], shape (n,); with gravity its
            potential as well, counted from that of `own`.
    """

    grid: CupGrid
    own: PlyFibers
    other: PlyFibers
    flips: NDArray[np.bool_]
    energy: Array

    @property
    def fibers(self) -> PlyFibers:
        """Fibers of the shapes, along a first batch axis."""
        return mixed(self.grid, self.own, self.other, self.flips)

    @property
    def turned(self) -> PlyFibers:
        """The same with every strip asked to bulge to its other side."""
        return mixed(self.grid, self.own, self.other, ~self.flips)


def alternatives(
    grid: CupGrid,
    positions: Array,
    rotations: Array,
    count: int = 4,
    **settings: Any,
) -> list[tuple[PlyFibers, float]]:
    """Shapes of one pose with the least energy, by the sides of their strips.

    A strip is open if a curve of the same length bulges to its other side. Up to ALL
    open strips, every combination is weighed; beyond, every strip alone, and the strips
    of a row, a column or a family turned together, by ones and twos.

    Args:
        grid: The cup array.
        positions: Centers of the suction faces, shape (n_cups, 3), in [m].
        rotations: Cup frames, shape (n_cups, 3, 3).
        count: Largest number of shapes.
        **settings: Arguments of `ply_fibers`, beyond the model.

    Returns:
        Fibers of each shape with their energy as in `Choice`, least first; the fibers
        of the pose alone where no strip is open.
    """
    settings = {"model": "modal"} | settings
    own = ply_fibers(grid, positions, rotations, **settings)
    other = ply_fibers(
        grid, positions, rotations, **settings | {"sides": other_sides(own)}
    )
    pull = None
    if settings.get("gravity") is not None:
        pull = np.asarray(settings["gravity"]) / settings["stiffness"]
    found = choices(grid, own, other, (positions, rotations), count, pull=pull)
    many = found.fibers
    return [(many.pose(n), float(energy)) for n, energy in enumerate(found.energy)]


def other_sides(fibers: PlyFibers) -> Sides:
    """Sides opposite to those of fibers; along the normals for strips without one."""
    s, t = (np.where(one == 0, 1, -one) for one in fibers.sides)
    return Sides(s, t)


def choices(
    grid: CupGrid,
    own: PlyFibers,
    other: PlyFibers,
    poses: tuple[Array, Array],
    count: int,
    *,
    rival: float = np.inf,
    apart: float = 0.0,
    pull: ArrayLike | None = None,
) -> Choice:
    """Weigh the sides of strips; a strip is shaped alone, so two shapes of each do.

    Args:
        grid: The cup array.
        own: Fibers of one pose.
        other: The same asked to bulge to the other side.
        poses: Positions and rotations of the cups.
        count: Largest number of shapes.
        rival: A strip's other side is offered if it takes less bending energy than
            this times its own.
        apart: Rms distance between both shapes of a strip below which they are one, in
            [m].
        pull: Weight per area over bending stiffness, a vector, in [1/m^3], or None.

    Returns:
        The shapes of least energy.
    """
    mine = _joined(own.sides)
    opens = (_joined(other.sides) == -mine) & (mine != 0)
    both = (own.s, other.s), (own.t, other.t)
    rivals = [strip_bending(b) < rival * strip_bending(a) for a, b in both]
    distinct = [strip_distance(a, b) >= apart for a, b in both]
    opens &= _joined(rivals) & _joined(distinct)
    open_strips = np.flatnonzero(opens)
    flips = np.unique(_candidates(grid, open_strips, mine), axis=0)
    energy = _energies(grid, own, other, poses, flips, open_strips, pull)
    order = np.argsort(energy, kind="stable")[:count]
    return Choice(grid, own, other, flips[order], energy[order])


def mixed(
    grid: CupGrid, first: PlyFibers, second: PlyFibers, flips: NDArray[np.bool_]
) -> PlyFibers:
    """Fibers of a second ply where strips are flipped, shape (..., strips)."""
    masks = {"s": _split(grid, flips).s, "t": _split(grid, flips).t}
    arrays = {}
    for one in fields(PlyFibers):
        a, b = getattr(first, one.name), getattr(second, one.name)
        mask = masks[one.name[0]]
        tail = a.ndim - (first.s_status.ndim - 1)
        arrays[one.name] = np.where(mask.reshape(*mask.shape, *[1] * tail), b, a)
    return PlyFibers(**arrays)


def strip_bending(curves: Array) -> Array:
    """Sum of squared second derivatives over a strip's fibers.

    Args:
        curves: Coefficients, shape (..., count, K, 3).

    Returns:
        Sums, shape (...), to compare strips of one length.
    """
    k = np.arange(curves.shape[-2])
    second = PLACES[:, None] ** np.maximum(k - 2, 0) * (k * (k - 1)) @ curves
    return np.asarray((second**2).sum(axis=(-1, -2, -3)))


def strip_distance(first: Array, second: Array) -> Array:
    """Rms distance between two shapes of strips, over all of their fibers.

    Args:
        first: Coefficients, shape (..., count, K, 3), in [m].
        second: The same of the other shape.

    Returns:
        Distances, shape (...), in [m].
    """
    away = powers(PLACES, first.shape[-2]) @ (first - second)
    return np.asarray(np.sqrt(dot(away, away).mean(axis=(-1, -2))))


def bending_energy(
    grid: CupGrid, fibers: PlyFibers, positions: Array, rotations: Array
) -> Array:
    """Bending energy of the free ply over its bending stiffness.

    Half the integral of squared curvature along s, along t and, twice, of the twist, by
    second differences of points on the surface.

    Args:
        grid: The cup array.
        fibers: Fibers of the same poses.
        positions: Centers of the suction faces, shape (..., n_cups, 3), in [m].
        rotations: Cup frames, shape (..., n_cups, 3, 3).

    Returns:
        Energies, shape (...), in [-]: times the stiffness in [N m], in [J].
    """
    points = _sampling(grid).points(fibers, positions, rotations)
    return np.asarray((_bends(grid, points) ** 2).sum(axis=-1) / 2)


def _energies(
    grid: CupGrid,
    own: PlyFibers,
    other: PlyFibers,
    poses: tuple[Array, Array],
    flips: NDArray[np.bool_],
    open_strips: NDArray,
    pull: ArrayLike | None,
) -> Array:
    """Energy of each row of flips: quadratic in them, since points are linear."""
    alone = np.zeros((1 + len(open_strips), flips.shape[-1]), dtype=bool)
    alone[np.arange(1, len(alone)), open_strips] = True
    many = [np.broadcast_to(pose, (len(alone), *np.shape(pose))) for pose in poses]
    fibers = mixed(grid, own, other, alone)
    points = _sampling(grid).points(fibers, many[0], many[1])
    points[1:] -= points[0]
    rows = _bends(grid, points)
    turned = np.concatenate([np.ones((len(flips), 1)), flips[:, open_strips]], axis=1)
    energy = ((turned @ (rows @ rows.T)) * turned).sum(axis=-1) / 2
    if pull is not None:
        lifts = (points[1:] @ np.asarray(pull, dtype=float)).sum(axis=(-1, -2))
        ds, dt = (lines[1] - lines[0] for lines in _lines(grid))
        energy = energy - turned[:, 1:] @ lifts * ds * dt
    return np.asarray(energy)


def _bends(grid: CupGrid, points: Array) -> Array:
    """Curvatures and twists, times the roots of the area that they stand for."""
    ds, dt = (lines[1] - lines[0] for lines in _lines(grid))
    root, ends = np.sqrt(ds * dt), np.sqrt(0.5)
    along_s = np.diff(points, 2, axis=-2) * (root / ds**2)
    along_t = np.diff(points, 2, axis=-3) * (root / dt**2)
    twist = np.diff(np.diff(points, axis=-2), axis=-3) * (np.sqrt(2.0) * root / ds / dt)
    along_s[..., [0, -1], :, :] *= ends
    along_t[..., [0, -1], :] *= ends
    parts = along_s, along_t, twist
    return np.concatenate([x.reshape(*x.shape[:-3], -1) for x in parts], axis=-1)


@cache
def _sampling(grid: CupGrid) -> PlySampling:
    return PlySampling(grid, *_lines(grid))


def _lines(grid: CupGrid) -> tuple[Array, Array]:
    lines = []
    for cups in (grid.columns, grid.rows):
        length = (cups - 1) * grid.pitch + 2 * grid.half_width
        count = round(length / grid.span * CELLS) + 1
        lines.append(np.linspace(-grid.half_width, length - grid.half_width, count))
    return lines[0], lines[1]


def _candidates(grid: CupGrid, open_strips: NDArray, sides: NDArray) -> NDArray:
    """Which strips to turn, one row a candidate, shape (candidates, strips)."""
    strips = len(sides)
    if len(open_strips) <= ALL:
        rows = list(product((False, True), repeat=len(open_strips)))
        turns = np.zeros((len(rows), strips), dtype=bool)
        turns[:, open_strips] = rows
        return turns
    alone = np.zeros((len(open_strips), strips), dtype=bool)
    alone[np.arange(len(open_strips)), open_strips] = True
    row, column = np.divmod(np.array(grid.neighbors[:, 0]), grid.columns)
    family = (np.arange(strips) >= grid.n_s_pairs).astype(int)
    lines = [
        (family == one) & (place == n)
        for one in (0, 1)
        for place in (row, column)
        for n in range(place.max() + 1)
    ]
    lines += [(family == one) & (sides == way) for one in (0, 1) for way in (-1, 1)]
    lines += [alone.any(axis=0)]
    lines = [line & alone.any(axis=0) for line in lines]
    pairs = [a ^ b for a, b in combinations(lines, 2)]
    return np.concatenate([np.zeros((1, strips), dtype=bool), alone, lines, pairs])


def _joined(families: Sequence[NDArray]) -> NDArray:
    """One value for each strip of one pose, those along s first, shape (strips,)."""
    return np.concatenate([one.ravel() for one in families])


def _split(grid: CupGrid, sides: NDArray) -> Sides:
    """Sides of the strips of both families, from shape (..., strips)."""
    s, t = sides[..., : grid.n_s_pairs], sides[..., grid.n_s_pairs :]
    return Sides(
        s.reshape(*sides.shape[:-1], grid.rows, grid.columns - 1),
        t.reshape(*sides.shape[:-1], grid.rows - 1, grid.columns),
    )
