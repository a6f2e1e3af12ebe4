"""Held ply: the shape of the ply between and beyond cups, on a chosen model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from drapeplan.cell import Cell
from ply.fiber import LengthStatus
from ply.free_edge import free_edge_droop
from ply.grid import CupGrid
from ply.measures import EARTH
from ply.sag import with_sag
from ply.sampling import PlySampling
from ply.shape import PlyFibers, ply_fibers
from ply.weave import Sides

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class PlyModel:
    """What of the ply is modeled.

    Attributes:
        name: "cubic", whose fibers have the length that their cups ask for; or "modal",
            whose fibers have the nearest length of the take-up band and bulge.
        gravity: Whether the ply sags between the cups; "modal" alone does.
        droop: Whether the overhang droops.
    """

    name: Literal["cubic", "modal"] = "cubic"
    gravity: bool = False
    droop: bool = False


CUBIC = PlyModel()


def weight_on_mold(cell: Cell) -> Array:
    """Weight of the ply per area in the mold frame, shape (3,), in [N/m^2]."""
    down = cell.world_mold[:3, :3].T @ EARTH
    return np.asarray(cell.scene.ply.areal_mass_kg_m2 * down)


def held_fibers(
    cell: Cell, positions: Array, rotations: Array, model: PlyModel = CUBIC
) -> PlyFibers:
    """Fibers of the ply along a path.

    Args:
        cell: Robot, mold and ply.
        positions: Cup positions in the mold frame, shape (K, n, 3), in [m].
        rotations: Cup rotations in the mold frame, shape (K, n, 3, 3).
        model: What is modeled.

    Returns:
        The fibers; where slack lets strips bulge to either side, each keeps the side
        that it had in the pose before.
    """
    grid, ply = cell.sampling.grid, cell.scene.ply
    take_up = ply.take_up_mm * 1e-3
    poses = positions, rotations
    fibers = ply_fibers(grid, *poses, model="cubic", take_up=take_up)
    if model.name == "cubic":
        return fibers
    if outside_take_up(fibers).any():
        fibers = _bulging(cell, poses, outside_take_up(fibers), model.gravity)
    if model.gravity:
        stiffness = ply.bending_stiffness_Nm
        fibers = with_sag(grid, fibers, rotations, weight_on_mold(cell), stiffness)
    return fibers


def held_points(
    cell: Cell,
    fibers: PlyFibers,
    positions: Array,
    rotations: Array,
    model: PlyModel = CUBIC,
) -> Array:
    """Points of the cell's sampling on the ply, shape (K, nt, ns, 3), in [m].

    Args:
        cell: Robot, mold and ply.
        fibers: Fibers of the same poses.
        positions: Cup positions in the mold frame, shape (K, n, 3), in [m].
        rotations: Cup rotations in the mold frame, shape (K, n, 3, 3).
        model: What is modeled.
    """
    sampling, ply = cell.sampling, cell.scene.ply
    points = sampling.points(fibers, positions, rotations)
    if model.droop:
        t, s = np.nonzero(overhang_samples(sampling))
        points[:, t, s] += free_edge_droop(
            sampling.grid,
            rotations,
            sampling.points_st[t, s],
            weight_on_mold(cell),
            ply.bending_stiffness_Nm,
            ply.overhang_mm * 1e-3,
        )
    return points


def outside_take_up(fibers: PlyFibers) -> Bools:
    """Poses in which some fiber has not the length that its cups ask for, (K,)."""
    bands = fibers.s_band, fibers.t_band
    free = [(band == LengthStatus.IN_BAND).all(axis=(1, 2, 3)) for band in bands]
    return ~np.logical_and(*free)


def overhang_samples(sampling: PlySampling) -> Bools:
    """Samples beyond the outer cups, shape (nt, ns)."""
    grid = sampling.grid
    beyond = []
    for lines, cups in ((sampling.t, grid.rows), (sampling.s, grid.columns)):
        last = (cups - 1) * grid.pitch + grid.half_width
        beyond.append((lines < -grid.half_width) | (lines > last))
    return beyond[0][:, None] | beyond[1]


def _bulging(
    cell: Cell, poses: tuple[Array, Array], outside: Bools, gravity: bool
) -> PlyFibers:
    """Modal fibers; with gravity those alone that are outside the take-up."""
    grid, ply = cell.sampling.grid, cell.scene.ply
    settings: dict[str, Any] = {"model": "modal", "take_up": ply.take_up_mm * 1e-3}
    loaded = dict(settings)
    if gravity:
        loaded["gravity"] = weight_on_mold(cell)
        loaded["stiffness"] = ply.bending_stiffness_Nm
    sides = _carried(grid, poses, outside, loaded)
    free = ply_fibers(grid, *poses, **settings, sides=sides)
    if not gravity:
        return free
    heavy = ply_fibers(grid, *poses, **loaded, sides=sides)
    return heavy_where_slack(free, heavy)


def heavy_where_slack(free: PlyFibers, heavy: PlyFibers) -> PlyFibers:
    """Fibers under weight where they leave the take-up, without it inside the band.

    Args:
        free: Fibers of some poses without weight.
        heavy: The same under weight.
    """
    s, t = (
        np.where((band == LengthStatus.IN_BAND)[..., None, None], own, under)
        for band, own, under in (
            (free.s_band, free.s, heavy.s),
            (free.t_band, free.t, heavy.t),
        )
    )
    return replace(heavy, s=s, t=t)


def _carried(
    grid: CupGrid, poses: tuple[Array, Array], outside: Bools, loaded: dict[str, Any]
) -> Sides:
    """Sides of all poses: each strip keeps its own for as long as it is slack."""
    count = len(outside)
    s = np.zeros((count, grid.rows, grid.columns - 1), np.int64)
    t = np.zeros((count, grid.rows - 1, grid.columns), np.int64)
    for k in np.flatnonzero(outside).tolist():  # a pose needs the one before
        one = poses[0][k], poses[1][k]
        before = Sides(s[k - 1], t[k - 1]) if k else None
        found = ply_fibers(grid, *one, **loaded, sides=before)
        s[k] = np.where(_slack(found.s_band), found.sides.s, 0)
        t[k] = np.where(_slack(found.t_band), found.sides.t, 0)
    return Sides(s, t)


def _slack(band: NDArray[np.int64]) -> Bools:
    """Strips of which some fiber is slack."""
    return np.asarray((band == LengthStatus.SLACK).any(axis=-1))
