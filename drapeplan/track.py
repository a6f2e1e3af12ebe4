"""Track: a drape as joint positions over time, with what follows from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from drapeplan.legs import cup_poses
from drapeplan.path import CupState
from drapeplan.robot import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Track:
    """Waypoints of a drape, K of them.

    Attributes:
        robot: Arm and tool.
        phase: Name of the phase of each waypoint.
        step: Wave step, -1 outside the wave and while the start cup lands, shape (K,).
        tau: Progress within the step or phase, shape (K,).
        time: Time of each waypoint, shape (K,), in [s].
        arm: Joint positions of the arm, shape (K, 6), in [rad].
        legs: Joint positions of the legs, shape (K, n, 6), in [rad], strokes in [m].
        states: CupState of each cup, shape (K, n).
    """

    robot: Robot
    phase: tuple[str, ...]
    step: NDArray[np.int_]
    tau: Array
    time: Array
    arm: Array
    legs: Array
    states: NDArray[np.uint8]

    @cached_property
    def tool(self) -> Array:
        """Placements of tool0 in the world, shape (K, 4, 4)."""
        return np.stack([self.robot.arm_forward(q) for q in self.arm])

    @cached_property
    def poses(self) -> tuple[Array, Array]:
        """Cup positions (K, n, 3), in [m], and rotations (K, n, 3, 3), in the world."""
        return cup_poses(self.robot.geometry, self.tool, self.legs)

    @cached_property
    def q(self) -> Array:
        """Joint positions of arm and tool, shape (K, nq)."""
        return self.robot.configuration(self.arm, self.legs)

    @property
    def placed(self) -> NDArray[np.bool_]:
        """Cups that stand on the mold, shape (K, n)."""
        return np.asarray(self.states == CupState.PLACED)

    @property
    def landing(self) -> NDArray[np.bool_]:
        """Cups on their way down, shape (K, n)."""
        return np.asarray(self.states == CupState.LANDING)

    @property
    def held(self) -> slice:
        """Waypoints from the pick to the end of the wave."""
        return slice(0, len(self.phase) - self.phase[::-1].index("wave"))
