"""Cheap rungs of the ladder: which one a cell needs, and strips on mixed rungs.

A cell is a patch with its strips, or a strip of a lone row or column.
"""

from dataclasses import replace
from enum import IntEnum
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ply.fiber import Array, FiberStatus, dot
from ply.grid import CupGrid
from ply.ladder_estimate import largest_around
from ply.sampling import PlySampling
from ply.sides import strip_distance
from ply.weave import PlyFibers

IN_SPAN = np.linspace(0.1, 0.9, 5)  # [-] places along a span where rungs are compared
ON_CUP = np.array([-1.0, 0.0, 1.0])  # [-] the same on a cup, in half widths
FAULTY = (FiberStatus.COINCIDENT, FiberStatus.INVERTED, FiberStatus.SKEWED)


class Rung(IntEnum):
    """Models by rising cost."""

    CUBIC = 0
    QUARTIC = 1
    MODAL = 2
    COUPLED = 3


@cache
def probes(grid: CupGrid) -> PlySampling:
    """Lines on which rungs are compared."""
    lines = []
    for cups in (grid.columns, grid.rows):
        centers = grid.pitch * np.arange(cups)[:, None]
        spans = centers[:-1] + grid.half_width + grid.span * IN_SPAN
        own = centers + grid.half_width * ON_CUP
        lines.append(np.sort(np.concatenate([own.ravel(), spans.ravel()])))
    return PlySampling(grid, *lines)


def cell_rms(grid: CupGrid, first: Array, second: Array) -> Array:
    """Rms normal distance of two surfaces on the lines of `probes`, for each cell.

    Args:
        grid: The cup array.
        first: Points, shape (..., n_t, n_s, 3), in [m].
        second: Points of the same material, of the same shape.

    Returns:
        Distances, shape (..., cells along t, cells along s), in [m].
    """
    x, y = np.gradient(second, axis=-2), np.gradient(second, axis=-3)
    normal = np.cross(x, y)
    size = dot(normal, normal)
    square = dot(first - second, normal) ** 2 / np.where(size > 0, size, 1.0)
    for axis, cups in ((-1, grid.columns), (-2, grid.rows)):
        square = np.moveaxis(square, axis, -1)
        stride = len(ON_CUP) + len(IN_SPAN)
        width = len(ON_CUP) + (stride if cups > 1 else 0)
        starts = stride * np.arange(max(cups - 1, 1))
        square = square[..., starts[:, None] + np.arange(width)].mean(axis=-1)
        square = np.moveaxis(square, -1, axis)
    return np.sqrt(square)


def cells(grid: CupGrid) -> tuple[int, int]:
    """Number of cells along t and s."""
    if grid.n_cups == 1:
        return 0, 0
    return max(grid.rows - 1, 1), max(grid.columns - 1, 1)


def cheap_rungs(
    grid: CupGrid, surfaces: list[Array], room: Array
) -> tuple[NDArray[np.int64], Array]:
    """Lowest cheap rung of each cell that those above leave room for, and its loss.

    Args:
        grid: The cup array.
        surfaces: Points of cubic, quartic and modal ply on the lines of `probes`; shape
            (..., n_t, n_s, 3), in [m].
        room: Largest loss of each cell, shape (..., cells along t, cells along s).

    Returns:
        Rungs and losses, shape as `room`.
    """
    to_quartic, to_modal, last = (
        cell_rms(grid, surfaces[a], surfaces[b]) for a, b in ((0, 1), (0, 2), (1, 2))
    )
    first = np.maximum(to_quartic, to_modal)
    rung = np.select(
        [first < room, last < room],
        [int(Rung.CUBIC), int(Rung.QUARTIC)],
        int(Rung.MODAL),
    )
    size = np.select([rung == Rung.CUBIC, rung == Rung.QUARTIC], [first, last], 0.0)
    return rung, size


def faulty_cells(grid: CupGrid, fibers: PlyFibers) -> NDArray[np.bool_]:
    """Cells beside cups whose poses make no sense."""
    if grid.n_cups == 1:
        return np.zeros((*fibers.s.shape[:-5], *cells(grid)), dtype=bool)
    faults = [
        np.isin(status, FAULTY).any(axis=-1).astype(float)
        for status in (fibers.s_status, fibers.t_status)
    ]
    return np.asarray(largest_around(grid, *faults) > 0)


def joined(grid: CupGrid, cheap: list[PlyFibers], rung: NDArray[np.int64]) -> PlyFibers:
    """Fibers of each strip on the highest cheap rung of the cells around it."""
    if len(cheap) == 1:
        return cheap[0]
    top, curves = cheap[-1], {}
    for axis, name in enumerate("st"):
        level = largest_beside(grid, rung, axis)[..., None, None, None]
        own = [_as_modal(getattr(one, name)) for one in cheap]
        curves[name] = np.where(
            level == Rung.CUBIC, own[0], np.where(level == Rung.QUARTIC, own[1], own[2])
        )
    return replace(top, **curves)


def largest_beside(
    grid: CupGrid, rung: NDArray[np.int64], axis: int
) -> NDArray[np.int64]:
    """Highest rung, or other level, of the cells beside each strip.

    Args:
        grid: The cup array.
        rung: Level of each cell, shape (..., cells along t, cells along s).
        axis: 0 for strips along s, 1 for those along t.

    Returns:
        Levels, shape (..., rows, columns - 1) or (..., rows - 1, columns).
    """
    shape = (
        (grid.rows, grid.columns - 1) if axis == 0 else (grid.rows - 1, grid.columns)
    )
    out = np.zeros((*rung.shape[:-2], *shape), dtype=np.int64)
    if min(grid.rows, grid.columns) == 1:
        return rung.reshape(out.shape) if out.size else out
    if axis == 0:
        out[..., :-1, :] = rung
        out[..., 1:, :] = np.maximum(out[..., 1:, :], rung)
    else:
        out[..., :-1] = rung
        out[..., 1:] = np.maximum(out[..., 1:], rung)
    return out


def _as_modal(curves: Array) -> Array:
    """Curves with three fibers a strip and the terms of three modes."""
    *batch, count, terms, _ = curves.shape
    out = np.zeros((*batch, 3, 7, 3))
    out[..., :terms, :] = curves if count == 3 else curves[..., [0, 0, 1], :, :]
    if count == 2:  # the middle of a ruled strip
        out[..., 1, :terms, :] = curves.mean(axis=-3)
    return out


def strips_apart(first: PlyFibers, second: PlyFibers) -> float:
    """Largest rms distance between a strip of two shapes, in [m]."""
    pairs = (first.s, second.s), (first.t, second.t)
    return max(float(strip_distance(a, b).max(initial=0.0)) for a, b in pairs)
