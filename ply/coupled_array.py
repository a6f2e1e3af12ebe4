"""The coupled ply of a whole cup array, patch by patch (D12)."""

import numpy as np
from numpy.typing import ArrayLike

from ply.coupled import CoupledModel, CoupledPatches
from ply.errors import PlyError
from ply.fiber import Array
from ply.grid import CupGrid, Region

CORNERS = ((0, 0), (0, 1), (1, 0), (1, 1))


def coupled_points(
    grid: CupGrid,
    positions: ArrayLike,
    rotations: ArrayLike,
    s: ArrayLike,
    t: ArrayLike,
    *,
    model: CoupledModel | None = None,
    sides: ArrayLike | None = None,
    start: CoupledPatches | None = None,
) -> tuple[Array, CoupledPatches]:
    """Points of the ply between all cups, each patch solved on its own.

    Two patches share each inner strip and shape it a little differently. There their
    points are blended by a cubic across the strip, so that the ply stays smooth.

    Args:
        grid: The cup array; a single row or column gives strips.
        positions: Centers of the suction faces, shape (..., n_cups, 3), in [m].
        rotations: Cup frames, shape (..., n_cups, 3, 3).
        s: Material coordinates along s, in [m].
        t: Material coordinates along t; s and t broadcast to a shape (*shape).
        model: The energy; by default that of `CoupledModel` for the grid.
        sides: Start of each patch's strips, as for `CoupledModel.solve`, shape
            (..., rows - 1, columns - 1, 4), or (..., spans) for strips.
        start: Patches of the poses before, to start from.

    Returns:
        Points, shape (..., *shape, 3), in [m], and the patches, batch shape
        (..., rows - 1, columns - 1), or (..., spans) for strips.

    Raises:
        PlyError: The array has a single cup, or a shape does not fit the grid.
    """
    model = model or CoupledModel(grid)
    p, frames = np.asarray(positions, float), np.asarray(rotations, float)
    for name, array, tail in (("positions", p, 1), ("rotations", frames, 2)):
        if array.shape[-1 - tail : -tail] != (grid.n_cups,):
            problem = f"shape {array.shape}"
            raise PlyError(name, problem, f"the grid has {grid.n_cups} cups")
    if grid.n_cups == 1:
        raise PlyError("grid", "a single cup has no neighbor", "use its plane")
    cups = patch_cups(grid)
    if min(grid.rows, grid.columns) > 1:
        patches = model.solve(p[..., cups, :], frames[..., cups, :, :], sides, start)
        found = patches
    else:
        along = Region.S_STRIP if grid.rows == 1 else Region.T_STRIP
        found = model.solve_strips(
            p[..., cups, :], frames[..., cups, :, :], sides, start, along
        )
        shape = (max(grid.rows - 1, 1), max(grid.columns - 1, 1))
        one = found.energy.ndim - 1
        patches = found[(..., np.arange(found.energy.shape[one]).reshape(shape))]
    return blended_points(grid, model, patches, s, t), found


def patch_cups(grid: CupGrid) -> Array:
    """Cups of each patch, shape (rows - 1, columns - 1, 4), or strip, (spans, 2)."""
    index = np.arange(grid.n_cups).reshape(grid.rows, grid.columns)
    if min(index.shape) == 1:
        return np.stack([index.ravel()[:-1], index.ravel()[1:]], axis=-1)
    around = [
        index[i : i + grid.rows - 1, j : j + grid.columns - 1] for i, j in CORNERS
    ]
    return np.stack(around, axis=-1)


def blended_points(
    grid: CupGrid,
    model: CoupledModel,
    patches: CoupledPatches,
    s: ArrayLike,
    t: ArrayLike,
) -> Array:
    """Points of patches, batch shape (..., rows of them, columns), blended."""
    s, t = np.broadcast_arrays(s, t)
    shape, s, t = s.shape, s.ravel(), t.ravel()
    *batch, rows, columns = patches.energy.shape
    on_s = _shares(s, columns, grid)
    on_t = _shares(t, rows, grid)
    out = np.zeros((*batch, len(s), 3))
    for i in range(rows):  # one product of matrices each
        for j in range(columns):
            share = on_t[i] * on_s[j]
            k = np.flatnonzero(share)
            own = model.points(
                patches[..., i, j], s[k] - j * grid.pitch, t[k] - i * grid.pitch
            )
            out[..., k, :] += share[k, None] * own
    return out.reshape(*batch, *shape, 3)


def _shares(x: Array, count: int, grid: CupGrid) -> Array:
    """Shares of the patches along one axis in points, shape (count, n); sum 1."""
    cut = grid.pitch * np.arange(1, count)[:, None]
    u = np.clip((x - cut) / (2 * grid.half_width) + 0.5, 0, 1)
    behind = u**2 * (3 - 2 * u)
    ends = np.ones((1, len(x)))
    return np.concatenate([ends, behind]) - np.concatenate([behind, 0 * ends])
