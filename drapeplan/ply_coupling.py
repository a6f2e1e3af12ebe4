"""Ply coupling: how far strips and patches that hold each other lie off (D19)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from drapeplan.cell import Cell
from drapeplan.held_ply import weight_on_mold
from ply.coupled import CoupledModel, CoupledStatus
from ply.coupled_array import patch_cups
from ply.fiber import Array, bubble_height, dot
from ply.grid import CupGrid
from ply.ladder_estimate import largest_around
from ply.shape import PlyFibers, evaluate

RELIEF = 0.3  # [-] of the relief beside a flat cup, both curvatures added; D19
BOW = 0.6  # [-] of the bow of slack beyond the take-up
LINES = 31  # [-] across a patch with its strips and cups, 5 mm apart on the 6 x 8
WIDEST = 0.9  # [-] of a span that a take-up may be in the coupled patch
ALIKE = 9  # [-] decimals of meters: estimates that differ by less pick the first patch


class CoupledCell(NamedTuple):
    """One patch whose coupled shape was solved.

    Attributes:
        patch: Row and column.
        waypoint: The pose.
        estimate: What was estimated, in [m].
        rms: Rms normal distance of the coupled patch from the model, in [m]; None if
            no stable shape was found.
        largest: Its largest normal distance, in [m].
    """

    patch: tuple[int, int]
    waypoint: int
    estimate: float
    rms: float | None
    largest: float | None


def coupling_estimate(
    grid: CupGrid, fibers: PlyFibers, rotations: Array, shear: Array
) -> Array:
    """Estimated rms distance of coupled patches from independent fibers.

    Within the take-up a fiber has any length without a force: what is left is that cups
    are flat while the strips beside them bend, and shear.

    Args:
        grid: The cup array.
        fibers: Fibers of the poses, made with a take-up.
        rotations: Cup frames of the same poses, shape (..., n_cups, 3, 3).
        shear: What shear adds to each patch, of `measures`, in [m].

    Returns:
        Estimates, shape (..., rows - 1, columns - 1), in [m].
    """
    frames = rotations.reshape(*rotations.shape[:-3], grid.rows, grid.columns, 3, 3)
    n = frames[..., 2]
    s0, s1 = _curvatures(fibers.s, n[..., :-1, :], n[..., 1:, :], grid.s_length)
    t0, t1 = _curvatures(fibers.t, n[..., :-1, :, :], n[..., 1:, :, :], grid.t_length)
    corners = [
        s0[..., :-1, :, -1] + t0[..., :, :-1, -1],
        s1[..., :-1, :, -1] + t0[..., :, 1:, 0],
        s0[..., 1:, :, 0] + t1[..., :, :-1, -1],
        s1[..., 1:, :, 0] + t1[..., :, 1:, 0],
    ]
    relief = grid.half_width**2 / 2 * abs(np.stack(corners)).mean(axis=0)
    bow_s = _excess(fibers.s_natural, fibers.s_used)
    bow_t = _excess(fibers.t_natural, fibers.t_used)
    return RELIEF * relief + shear + largest_around(grid, bow_s, bow_t)


def coupled_cells(
    cell: Cell,
    positions: Array,
    rotations: Array,
    fibers: PlyFibers,
    estimate: Array,
    count: int,
) -> tuple[CoupledCell, ...]:
    """Solve the coupled shape of those patches whose estimates are largest.

    Args:
        cell: Robot, mold and ply.
        positions: Cup positions in the mold frame, shape (K, n, 3), in [m].
        rotations: Cup rotations in the mold frame, shape (K, n, 3, 3).
        fibers: Fibers of the same poses: what the coupled shape is compared with.
        estimate: Estimates of all patches, shape (K, rows - 1, columns - 1), in [m].
        count: Largest number of patches, each in its worst pose.

    Returns:
        The patches, the largest estimate first.
    """
    grid, model = cell.sampling.grid, coupled_model(cell)
    shape = estimate.shape[1:]
    flat = np.round(estimate, ALIKE).reshape(len(estimate), -1)
    chosen = np.argsort(-flat.max(axis=0), kind="stable")[:count]
    poses = flat[:, chosen].argmax(axis=0)
    i, j = np.unravel_index(chosen, shape)
    cups = patch_cups(grid).reshape(-1, 4)[chosen]
    p, frames = positions[poses[:, None], cups], rotations[poses[:, None], cups]
    sides = fibers.sides
    around = [sides.s[poses, i, j], sides.s[poses, i + 1, j]]
    around += [sides.t[poses, i, j], sides.t[poses, i, j + 1]]
    found = model.solve(p, frames, np.stack(around, axis=-1))
    lines = np.linspace(-grid.half_width, grid.pitch + grid.half_width, LINES)
    s, t = (x.ravel() for x in np.meshgrid(lines, lines))
    cells = []
    for n, k in enumerate(poses.tolist()):
        place = int(i[n]), int(j[n])
        size = float(estimate[(k, *place)])
        if found.status[n] != CoupledStatus.CONVERGED:
            cells.append(CoupledCell(place, k, size, None, None))
            continue
        points_st = np.stack([s + place[1] * grid.pitch, t + place[0] * grid.pitch])
        own = evaluate(grid, fibers.pose(k), positions[k], rotations[k], points_st.T)
        away = abs(_normal_distance(own, model.points(found[n], s, t)))
        rms = float(np.sqrt((away**2).mean()))
        cells.append(CoupledCell(place, k, size, rms, float(away.max())))
    return tuple(cells)


def coupled_model(cell: Cell) -> CoupledModel:
    """Energy of coupled patches of a scene's ply, with its weight and take-up."""
    grid, ply = cell.sampling.grid, cell.scene.ply
    shortest = min(grid.s_length, grid.t_length)
    x, y, z = (float(w) for w in weight_on_mold(cell))
    return CoupledModel(
        grid,
        bending=ply.bending_stiffness_Nm,
        weight=(x, y, z),
        take_up=min(ply.take_up_mm * 1e-3, WIDEST * shortest),
    )


def _curvatures(
    curves: Array, n0: Array, n1: Array, length: float
) -> tuple[Array, Array]:
    """Curvatures along the normals of a strip's fibers at both ends, in [1/m]."""
    k = np.arange(curves.shape[-2])
    ends = (2.0 * (k == 2), k * (k - 1.0))  # second derivatives at u = 0 and u = 1
    first, last = (
        dot(row @ curves, n[..., None, :]) / length**2
        for row, n in zip(ends, (n0, n1), strict=True)
    )
    return first, last


def _excess(natural: Array, used: Array) -> Array:
    """What a strip's length beyond the take-up does, shape of strips, in [m]."""
    slack = BOW * bubble_height(used - natural, used)
    return np.asarray(np.maximum(slack, natural - used).max(axis=-1))


def _normal_distance(own: Array, other: Array) -> Array:
    """Distances along the normals of a grid of points, shape (LINES^2,), in [m]."""
    grid = own.reshape(LINES, LINES, 3)
    normal = np.cross(np.gradient(grid, axis=1), np.gradient(grid, axis=0))
    size = np.sqrt(dot(normal, normal))
    away = dot(other.reshape(grid.shape) - grid, normal)
    return np.asarray(away / np.where(size > 0, size, 1.0)).ravel()
