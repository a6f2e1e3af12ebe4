"""Poses of a drape: as planned, as another fidelity has them, or only as requested."""

from dataclasses import dataclass

import numpy as np

from drapeplan.cell import Cell
from drapeplan.frames import inverse, moved
from drapeplan.hanging import kinematic_lag
from drapeplan.legs import Array
from drapeplan.motion import Motion, follow
from drapeplan.path import CupState
from drapeplan.planner import Request, make_track
from drapeplan.settling import UnsettledError, settle_path

Poses = tuple[Array, Array]


@dataclass(frozen=True)
class Held:
    """Poses of a drape while cups hold the ply, mold frame: (K, n, 3), (K, n, 3, 3).

    Attributes:
        plan: As the plan has them.
        down: Cups placed and cups landing, shape (K, n) each.
        other: With the rest of the tool taken out of the plan, or put in; None where
            there is none.
        settled: Whether the plan has the tool at rest.
        lag: The plan's estimate of what that changes, [m]; None of refused scenes.
        fall: What it changes where cups hover in the wave, [m].
    """

    plan: Poses
    down: tuple[Array, Array]
    other: Poses | None = None
    settled: bool = False
    lag: float | None = None
    fall: float | None = None


def held_as_planned(cell: Cell, request: Request) -> Held:
    """The drape as planned and as the other fidelity has it.

    Raises:
        InfeasibleError: If the tool cannot follow its path, or has no rest.
    """
    path, motion = request.path, follow(cell, request.path)
    settled = cell.scene.fidelity == "equilibrium"
    planned = settle_path(cell, path, motion).motion if settled else motion
    held = make_track(cell, path, planned).held
    to_mold = inverse(cell.world_mold)

    def poses(one: Motion) -> Poses:
        track = make_track(cell, path, one)
        return moved(to_mold, *(pose[held] for pose in track.poses))

    asked = moved(to_mold, path.positions[held], path.rotations[held])
    states = path.states[held]
    free = states != CupState.PLACED
    free[np.array(path.phase)[held] != "wave"] = False
    arm = planned.q[:, cell.robot.arm_columns]
    try:
        hung = poses(settle_path(cell, path, motion, lead=False).motion)
    except UnsettledError:
        hung = None
    fall = hung and np.linalg.norm(hung[0] - asked[0], axis=-1)[free].max()
    return Held(
        poses(planned),
        (states == CupState.PLACED, states == CupState.LANDING),
        asked if settled else hung,
        settled,
        kinematic_lag(cell, path, arm)[0],
        fall and float(fall),
    )


def held_as_requested(cell: Cell, request: Request) -> Held:
    """The poses that a refused scene asks for, from above the mold on."""
    wave = request.wave
    above = [0.0, 0.0, cell.scene.motion.clearance_mm * 1e-3]
    none = np.zeros_like(wave.placed[:1])
    p = np.concatenate([wave.positions[:1] + above, wave.positions])
    R = np.concatenate([wave.rotations[:1], wave.rotations])
    down = (np.concatenate([none, each]) for each in (wave.placed, wave.landing))
    return Held((p, R), tuple(down))
