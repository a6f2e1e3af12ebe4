"""Hanging: where cups hang with the strokes of the request, and the tool over them.

Strokes steer heights; where the net of cups hangs sideways follows from gravity and
the interlinks. Before the first cup stands, the whole net hangs beside its request, by
millimeters: the arm makes up for it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drapeplan.cell import Cell
from drapeplan.equilibrium import Equilibrium, Settled, SettledStatus, ToolPhysics
from drapeplan.frames import rotation_vectors, translation
from drapeplan.legs import cup_poses, leg_coordinates
from drapeplan.path import CupState, Path
from drapeplan.robot import ReachError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LEVEL = 1e-9  # [rad], [m], [-] change of a joint or of the vertical that is none
PASSES = 4  # each leaves about a tenth of what the one before left
DIGITS = 6  # decimals of the shift in [m]


def tool_physics(cell: Cell) -> ToolPhysics:
    """What the equilibrium needs to know of a scene's ply."""
    ply = cell.scene.ply
    return ToolPhysics(
        bending=ply.bending_stiffness_Nm,
        areal_mass=ply.areal_mass_kg_m2,
        longest_fiber=cell.sampling.grid.span + 1e-3 * ply.take_up_mm,
    )


def hang_shift(cell: Cell, path: Path) -> Array:
    """Shift of the tool that hangs the start cup over its target.

    Forces within the tool do not depend on where it stands, so that the arm has to
    reach the placement without the shift alone.

    Args:
        cell: Robot, mold and ply.
        path: The requested path.

    Returns:
        Shift along the mold where the start cup lands, world, shape (3,), in [m]; zero
        where the arm does not reach, or the tool finds no rest.
    """
    robot = cell.robot
    placed = np.asarray(path.states == CupState.PLACED)
    k = int(placed.any(axis=1).argmax()) - 1
    start = int(placed[k + 1].argmax())
    request, normal = (path.positions[k], path.rotations[k]), path.rotations[k, start]
    try:
        arm = robot.arm_inverse(path.tool[k], np.array(cell.scene.robot.home_rad))
    except ReachError:
        return np.zeros(3)
    tool, shift = Equilibrium(robot, tool_physics(cell)), np.zeros(3)
    warm: Settled | None = None
    for _ in range(PASSES):
        frame = translation(*shift) @ path.tool[k]
        legs = leg_coordinates(robot.geometry, frame, *request)
        q = robot.configuration(arm, legs)
        warm = tool.settle(q, placed[k], warm, leave=False)
        if warm.status != SettledStatus.SETTLED:
            return np.zeros(3)
        hangs = cup_poses(robot.geometry, frame, warm.q[robot.leg_columns])[0][start]
        off = hangs - request[0][start]
        shift -= off - normal[:, 2] * (normal[:, 2] @ off)
    return np.round(shift, DIGITS) + 0.0


def shifted(path: Path, shift: Array) -> Path:
    """Path with the tool shifted from the approach on; what cups are asked stays.

    Args:
        path: The path.
        shift: World, shape (3,), in [m].
    """
    tool = path.tool.copy()
    tool[path.phase.index("approach") :, :3, 3] += shift
    return replace(path, tool=tool)


def rides_level(tool: Array, legs: Array, fixed: Mask) -> Mask:
    """Waypoints at which the tool carries on as it was: nothing settles anew.

    Args:
        tool: Placements of tool0, shape (K, 4, 4).
        legs: Joint positions of the legs, shape (K, n, 6), in [rad] and [m].
        fixed: Cups that stand, shape (K, n).

    Returns:
        Whether legs, standing cups and the vertical in the tool frame are those of the
        waypoint before, shape (K,); the first one is not.
    """
    moved = np.abs(np.diff(legs, axis=0)).max(axis=(1, 2))
    tilted = np.abs(np.diff(tool[:, 2, :3], axis=0)).max(axis=1)
    same = (fixed[1:] == fixed[:-1]).all(axis=1)
    return np.append(False, same & (moved < LEVEL) & (tilted < LEVEL))


def kinematic_lag(cell: Cell, path: Path, arm: Array) -> tuple[float, float]:
    """How far cups are from what the kinematic fidelity believes, before contact.

    Args:
        cell: Robot, mold and ply.
        path: The requested path, which the kinematic fidelity believes in.
        arm: Joint positions of the arm, shape (K, 6), in [rad].

    Returns:
        Largest distance of a free cup from where it was believed to be, in [m], and
        largest angle, in [rad], over the last waypoint before each landing; strokes
        that leave the tool no stable rest do not count.
    """
    robot = cell.robot
    tool, columns = Equilibrium(robot, tool_physics(cell)), robot.leg_columns
    placed = np.asarray(path.states == CupState.PLACED)
    count = placed.sum(axis=1)
    before = np.flatnonzero((count[:-1] > 0) & (count[1:] > count[:-1]))
    worst, settled = np.zeros(2), None
    for k in before:
        believed = path.positions[k], path.rotations[k]
        legs = leg_coordinates(robot.geometry, path.tool[k], *believed)
        q = robot.configuration(arm[k], legs)
        settled = tool.settle(q, placed[k], settled, stability=False)
        if settled.status == SettledStatus.SETTLED:
            p, R = cup_poses(robot.geometry, path.tool[k], settled.q[columns])
            apart = np.linalg.norm(p - believed[0], axis=1).max()
            turn = np.linalg.norm(rotation_vectors(believed[1], R), axis=1).max()
            worst = np.maximum(worst, [apart, turn])
    return float(worst[0]), float(worst[1])
