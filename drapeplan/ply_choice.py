"""Ply choice: the cheapest ply model that a path's tolerance allows, and why (D19)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from drapeplan.cell import Cell
from drapeplan.held_ply import (
    CUBIC,
    PlyModel,
    held_fibers,
    outside_take_up,
    weight_on_mold,
)
from drapeplan.ply_coupling import CoupledCell, coupled_cells, coupling_estimate
from ply.free_edge import CORNER_TIP, tip_droop
from ply.ladder_rungs import probes
from ply.measures import EARTH, PATCH_SAG, Measures, measures
from ply.shape import PlyFibers

Array = NDArray[np.float64]
Cause = Literal["take_up", "gravity", "droop", "coupling"]

ROUND = 6  # [-] decimals of millimeters: a micrometer's thousandth decides nothing
PATCH_ALONE = 1 - 1 / PATCH_SAG  # [-] of a patch's sag, which its strips do not have
EDGE_ALONE = 1.9 / CORNER_TIP  # [-] of the droop: the strips beneath the edge sag, D17
VERIFIED = 3  # [-] patches whose coupled shape is solved, where an estimate asks for it


@dataclass(frozen=True)
class Effect:
    """What one cause changes in the ply's shape.

    Attributes:
        cause: "take_up" (fibers that bulge or are taut beyond the take-up), "gravity"
            (sag between the cups), "droop" (of the overhang), or "coupling" (strips and
            patches that hold each other).
        size: Largest change over the path, in [m]; of coupling the rms over a patch.
        modeled: Whether the shape has it.
        left_out: What the shape still lacks of it, in [m].
        waypoint: Pose with the largest change.
        patch: Row and column of the patch with the largest change, for "coupling".
    """

    cause: Cause
    size: float
    modeled: bool
    left_out: float
    waypoint: int
    patch: tuple[int, int] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, the unit in the key."""
        return {
            "cause": self.cause,
            "size_mm": _mm(self.size),
            "modeled": self.modeled,
            "left_out_mm": _mm(self.left_out),
            "waypoint": self.waypoint,
            "patch": list(self.patch) if self.patch else None,
        }


@dataclass(frozen=True)
class PlyChoice:
    """The model on which a verdict rests.

    Attributes:
        model: What is modeled.
        asked: What the scene asks for: "auto", "cubic" or "modal".
        tolerance: Change of shape that may be left out, in [m].
        effects: What each cause changes.
        coupled: Patches whose coupled shape was solved, with its distance.
    """

    model: PlyModel
    asked: str
    tolerance: float
    effects: tuple[Effect, ...]
    coupled: tuple[CoupledCell, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, the unit in the key."""
        return {
            "model": self.model.name,
            "asked": self.asked,
            "gravity": self.model.gravity,
            "droop": self.model.droop,
            "tolerance_mm": _mm(self.tolerance),
            "effects": [effect.to_dict() for effect in self.effects],
            "coupled": [
                {
                    "patch": list(one.patch),
                    "waypoint": one.waypoint,
                    "estimate_mm": _mm(one.estimate),
                    "measured_mm": None if one.rms is None else _mm(one.rms),
                    "largest_mm": None if one.largest is None else _mm(one.largest),
                }
                for one in self.coupled
            ],
        }


def choose_ply(
    cell: Cell, positions: Array, rotations: Array
) -> tuple[PlyChoice, PlyFibers]:
    """The cheapest model for a whole path, and its fibers.

    What a model leaves out between the cups adds up and must stay within the scene's
    tolerance, as must what it leaves out beyond them. Coupled patches take too long for
    a whole path: where their estimate exceeds the tolerance, the worst are solved, and
    the choice says how far they lie off.

    Args:
        cell: Robot, mold and ply.
        positions: Cup positions in the mold frame, shape (K, n, 3), in [m].
        rotations: Cup rotations in the mold frame, shape (K, n, 3, 3).

    Returns:
        The choice and the fibers of all poses on it.
    """
    poses = positions, rotations
    asked, limit = cell.scene.ply.model, cell.scene.tolerance.shape_mm * 1e-3
    fibers = held_fibers(cell, *poses, CUBIC)
    bulge, bulge_pose = _beyond_take_up(cell, poses, fibers)
    found = _measures(cell, poses)
    sag, sag_pose = _largest(found.sag.max(axis=(1, 2), initial=0.0))
    droop, droop_pose = _droop(cell, rotations)
    modal = bulge + sag > limit if asked == "auto" else asked == "modal"
    heavy = modal and (sag > limit or asked == "modal")
    model = PlyModel("modal" if modal else "cubic", heavy, droop > limit)
    if modal:
        fibers = held_fibers(cell, *poses, model)
    estimate = coupling_estimate(
        cell.sampling.grid, fibers, rotations, found.shear_effect
    )
    if heavy:
        estimate = estimate + PATCH_ALONE * found.sag
    coupling, pose, patch = _worst(estimate)
    edge = EDGE_ALONE if model.droop else 1.0
    effects = (
        Effect("take_up", bulge, modal, 0.0 if modal else bulge, bulge_pose),
        Effect("gravity", sag, heavy, 0.0 if heavy else sag, sag_pose),
        Effect("droop", droop, model.droop, edge * droop, droop_pose),
        Effect("coupling", coupling, False, coupling, pose, patch),
    )
    coupled: tuple[CoupledCell, ...] = ()
    if coupling > limit:
        coupled = coupled_cells(cell, *poses, fibers, estimate, VERIFIED)
    return PlyChoice(model, asked, limit, effects, coupled), fibers


def _beyond_take_up(
    cell: Cell, poses: tuple[Array, Array], fibers: PlyFibers
) -> tuple[float, int]:
    """Largest distance of modal from cubic fibers, and its pose.

    Within the take-up they are the same: only poses with other fibers are shaped.
    """
    some = np.flatnonzero(outside_take_up(fibers))
    if not some.size:
        return 0.0, 0
    p, frames = poses[0][some], poses[1][some]
    sampling = probes(cell.sampling.grid)
    shapes = [
        sampling.points(held_fibers(cell, p, frames, model), p, frames)
        for model in (CUBIC, PlyModel("modal"))
    ]
    away = np.linalg.norm(shapes[1] - shapes[0], axis=-1).max(axis=(-1, -2))
    size, pose = _largest(away)
    return size, int(some[pose])


def _measures(cell: Cell, poses: tuple[Array, Array]) -> Measures:
    """Estimates of what fibers leave out, under the scene's gravity."""
    ply = cell.scene.ply
    stiffness, mass = ply.bending_stiffness_Nm, ply.areal_mass_kg_m2
    down = cell.world_mold[:3, :3].T @ EARTH
    return measures(cell.sampling.grid, *poses, stiffness, mass, gravity=down)


def _droop(cell: Cell, rotations: Array) -> tuple[float, int]:
    """Largest droop of the overhang, at a corner's tip, and its pose (D17)."""
    grid, ply = cell.sampling.grid, cell.scene.ply
    outer = np.zeros((grid.rows, grid.columns), bool)
    outer[[0, -1]] = outer[:, [0, -1]] = True
    frames = rotations[:, outer.ravel()]
    settings = ply.bending_stiffness_Nm, ply.overhang_mm * 1e-3
    droop = abs(tip_droop(frames, weight_on_mold(cell), *settings)).max(axis=-1)
    return _largest(CORNER_TIP * droop)


def _largest(sizes: Array) -> tuple[float, int]:
    """Largest size and its place; ties that rounding decides go to the first."""
    place = int(np.round(sizes, ROUND + 3).argmax())
    return float(sizes[place]), place


def _worst(estimate: Array) -> tuple[float, int, tuple[int, int] | None]:
    """Largest estimate, its pose and its patch; no patch for a lone row of cups."""
    if not estimate.size:
        return 0.0, 0, None
    size, place = _largest(estimate.ravel())
    k, i, j = (int(x) for x in np.unravel_index(place, estimate.shape))
    return size, k, (i, j)


def _mm(length: float) -> float:
    return round(1e3 * length, ROUND) + 0.0
