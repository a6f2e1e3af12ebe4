"""Coupled cells within a ply of other rungs: solved where asked, edges shared."""

from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ply.coupled import ARRAYS, CoupledModel, CoupledPatches
from ply.coupled_array import patch_cups
from ply.fiber import Array, powers
from ply.grid import CupGrid, Region
from ply.weave import PlyFibers, Sides

EDGES = np.array([-1.0, 0.0, 1.0])  # [-] fibers across a strip, in half widths


def solve_cells(
    grid: CupGrid,
    model: CoupledModel,
    poses: tuple[Array, Array],
    sides: Sides,
    high: NDArray[np.bool_],
    heavy: NDArray[np.bool_],
) -> CoupledPatches:
    """Coupled cells where asked for, void ones elsewhere; equal ones solved once.

    Args:
        grid: The cup array.
        model: The energy.
        poses: Positions and rotations of the cups, shape (..., n_cups, 3) and so on.
        sides: Where the strips start.
        high: Cells to solve, shape (..., cells along t, cells along s), one or more.
        heavy: Cells in which the model's weight counts.

    Returns:
        The cells, batch shape as `high`.
    """
    if not any(model.weight):
        return _solve_cells(grid, model, poses, sides, high)
    parts = [
        (mask, _solve_cells(grid, own, poses, sides, mask))
        for mask, own in ((high & heavy, model), (high & ~heavy, weightless(model)))
        if mask.any()
    ]
    found = parts[0][1]
    for mask, other in parts[1:]:
        for name in ARRAYS:
            getattr(found, name)[mask] = getattr(other, name)[mask]
    return found


@cache
def weightless(model: CoupledModel) -> CoupledModel:
    """The same model without a weight."""
    return replace(model, weight=(0.0, 0.0, 0.0))


def _solve_cells(
    grid: CupGrid,
    model: CoupledModel,
    poses: tuple[Array, Array],
    sides: Sides,
    high: NDArray[np.bool_],
) -> CoupledPatches:
    """Cells with one model."""
    cups, spans = patch_cups(grid), high.reshape(*poses[0].shape[:-2], -1)
    if patch_region := min(grid.rows, grid.columns) > 1:
        spans = high
        around = [sides.s[..., :-1, :], sides.s[..., 1:, :]]
        around += [sides.t[..., :-1], sides.t[..., 1:]]
        start = np.stack(around, axis=-1)[high]
    else:
        start = (sides.s if grid.rows == 1 else sides.t)[high][:, None]
    p, frames = poses[0][..., cups, :][spans], poses[1][..., cups, :, :][spans]
    parts = [array.reshape(len(start), -1) for array in (p, frames, start)]
    every = np.concatenate(parts, axis=-1)
    _, one, back = np.unique(every, axis=0, return_index=True, return_inverse=True)
    p, frames, start = p[one], frames[one], start[one]
    if patch_region:
        found = model.solve(p, frames, start)
    else:
        along = Region.S_STRIP if grid.rows == 1 else Region.T_STRIP
        found = model.solve_strips(p, frames, start[:, 0], along=along)
    arrays = {}
    for name in ARRAYS:
        own = getattr(found, name)
        arrays[name] = np.zeros((*high.shape, *own.shape[1:]), dtype=own.dtype)
        arrays[name][high] = own[back.ravel()]
    return CoupledPatches(found.region, **arrays)


def with_coupled(
    grid: CupGrid,
    fibers: PlyFibers,
    model: CoupledModel,
    patches: CoupledPatches,
    high: NDArray[np.bool_],
) -> PlyFibers:
    """Fibers of coupled strips in place of their own: each edge from its own patch."""
    curves = {}
    for axis, name in enumerate("st"):
        old = getattr(fibers, name)
        terms = model.order + 4
        new = np.zeros((*old.shape[:-2], terms, 3))
        new[..., : old.shape[-2], :] = old
        if patches.region == Region.PATCH:
            pair = [_strip_curves(model, patches, axis, which) for which in (0, 1)]
            new = _edges_of_their_own(new, pair, high, axis)
        elif new.size:
            own = _strip_curves(model, patches, axis, 0)
            new = np.where(high[..., None, None, None], own, new)
        curves[name] = new
    return replace(fibers, **curves)


def _strip_curves(
    model: CoupledModel, patches: CoupledPatches, axis: int, which: int
) -> Array:
    """Curves along a strip of coupled cells: coefficients, shape (..., 3, terms, 3)."""
    free, cups = _strip_rows(model, patches.region, axis, which)
    curves = free @ patches.coefficients + cups @ patches.cups
    return curves.reshape(*patches.energy.shape, len(EDGES), -1, 3)


@cache
def _strip_rows(
    model: CoupledModel, region: Region, axis: int, which: int
) -> tuple[Array, Array]:
    """Constant matrices to those coefficients, from unknowns and from cups.

    The curves are polynomials, so that as many points as terms give them exactly.
    """
    grid, terms = model.grid, model.order + 4  # a Hermite cubic and `order` bubbles
    u = (1 - np.cos(np.pi * np.arange(terms) / (terms - 1))) / 2
    lateral = which * grid.pitch + grid.half_width * EDGES
    along = grid.half_width + grid.span * u
    s, t = np.broadcast_arrays(along, lateral[:, None])
    rows = model.rows(region, *((s, t) if axis == 0 else (t, s)))
    inverse = np.linalg.inv(powers(u, terms))
    free, cups = (
        (inverse @ one.reshape(len(EDGES), terms, -1)).reshape(one.shape)
        for one in rows
    )
    return free, cups


def _edges_of_their_own(
    old: Array, pair: list[Array], high: NDArray[np.bool_], axis: int
) -> Array:
    """Strips between patches: each patch gives its edge, both give the middle."""
    across = high.ndim - 2 + axis
    spread, has = [], []
    for which, curves in enumerate(pair):  # a cell's first strip, then its second
        width = [(0, 0)] * curves.ndim
        width[across] = (which, 1 - which)
        spread.append(np.pad(curves, width))
        has.append(np.pad(high, width[: high.ndim])[..., None, None, None])
    one = np.where(has[0], spread[0], np.where(has[1], spread[1], old))
    ends = [spread[1][..., 0, :, :], spread[0][..., 2, :, :]]
    middle = (spread[0][..., 1, :, :] + spread[1][..., 1, :, :]) / 2
    both = np.stack([ends[0], middle, ends[1]], axis=-3)
    return np.where(has[0] & has[1], both, one)
