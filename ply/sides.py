"""Which side the strips of a ply bulge to, where slack leaves a choice.

The side is history: a trajectory carries it, `PlyFibers.sides`. Where none is known,
`alternatives` offers the shapes of least energy.
"""

from itertools import combinations, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ply.fiber import Array
from ply.grid import CupGrid
from ply.sampling import PlySampling
from ply.weave import PlyFibers, Sides, ply_fibers

ALL = 8  # [-] open strips up to which every combination of sides is weighed
CELLS = 7  # [-] cells in the length of a span, of the grid that sums bending energy


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
        Fibers of each shape with their bending energy per stiffness, in [-], least
        first; the fibers of the pose alone where no strip is open.
    """
    settings = {"model": "modal"} | settings
    base = ply_fibers(grid, positions, rotations, **settings)
    mine = _joined(base.sides)
    turned = _split(grid, np.where(mine == 0, 1, -mine))
    other = ply_fibers(grid, positions, rotations, **settings | {"sides": turned})
    open_strips = np.flatnonzero((_joined(other.sides) == -mine) & (mine != 0))
    flips = _candidates(grid, open_strips, mine)
    sides = np.unique(np.where(flips, -mine, mine), axis=0)
    fibers, energy = _weighed(grid, positions, rotations, sides, settings)
    order = np.argsort(energy, kind="stable")[:count]
    return [(fibers.pose(n), float(energy[n])) for n in order]


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
    s, t = (_lines(grid, cups) for cups in (grid.columns, grid.rows))
    points = PlySampling(grid, s, t).points(fibers, positions, rotations)
    ds, dt = s[1] - s[0], t[1] - t[0]
    along_s = (np.diff(points, 2, axis=-2) ** 2).sum(axis=(-1, -2)) / ds**4
    along_t = (np.diff(points, 2, axis=-3) ** 2).sum(axis=(-1, -3)) / dt**4
    twist = np.diff(np.diff(points, axis=-2), axis=-3) / (ds * dt)
    total = 2 * (twist**2).sum(axis=(-1, -2, -3))
    for bends in (along_s, along_t):
        total += bends.sum(axis=-1) - (bends[..., 0] + bends[..., -1]) / 2
    return total * ds * dt / 2


def _weighed(
    grid: CupGrid,
    positions: Array,
    rotations: Array,
    sides: NDArray,
    settings: dict[str, Any],
) -> tuple[PlyFibers, Array]:
    """Fibers of one pose with each row of sides, and their energies."""
    many = len(sides)
    p = np.broadcast_to(positions, (many, *np.shape(positions)))
    frames = np.broadcast_to(rotations, (many, *np.shape(rotations)))
    settings = settings | {"sides": _split(grid, sides)}
    fibers = ply_fibers(grid, p, frames, **settings)
    return fibers, bending_energy(grid, fibers, p, frames)


def _lines(grid: CupGrid, cups: int) -> Array:
    length = (cups - 1) * grid.pitch + 2 * grid.half_width
    count = round(length / grid.span * CELLS) + 1
    return np.linspace(-grid.half_width, length - grid.half_width, count)


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


def _joined(sides: Sides) -> NDArray:
    """Sides of all strips of one pose, those along s first, shape (strips,)."""
    return np.concatenate([sides.s.ravel(), sides.t.ravel()])


def _split(grid: CupGrid, sides: NDArray) -> Sides:
    """Sides of the strips of both families, from shape (..., strips)."""
    s, t = sides[..., : grid.n_s_pairs], sides[..., grid.n_s_pairs :]
    return Sides(
        s.reshape(*sides.shape[:-1], grid.rows, grid.columns - 1),
        t.reshape(*sides.shape[:-1], grid.rows - 1, grid.columns),
    )
