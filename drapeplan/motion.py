"""Motion: joint positions that follow a path, or the reason why none do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drapeplan.cell import Cell
from drapeplan.errors import InfeasibleError
from drapeplan.explain import OUTWARD, Reason, explain, explain_rows
from drapeplan.legs import leg_coordinates
from drapeplan.path import CupState, Path
from drapeplan.qp import QpSolver
from drapeplan.relaxation import OpenRow, relax_step
from drapeplan.robot import ReachError
from drapeplan.strokes import (
    ALIGNED,
    CLOSED,
    LANDED,
    LIMIT,
    WAITED,
    Step,
    StrokeSolution,
    StrokeSolver,
    StrokeStatus,
)

__all__ = [
    "ALIGNED",  # what a motion is held to, for those who judge it
    "CLOSED",
    "LANDED",
    "LIMIT",
    "WAITED",
    "Motion",
    "StrokesError",
    "follow",
    "schedule",
]

Array = NDArray[np.float64]

STILL = 1e-12  # [rad], [m] legs that change by less than this do not move
SHORTEST = 0.05  # [s] shortest time between waypoints outside the wave
DIGITS = 12  # joint positions are rounded to this, so that a file holds them exactly


@dataclass(frozen=True)
class Motion:
    """Joint positions along a path.

    Attributes:
        q: Joint positions of arm and tool, shape (K, nq), in [rad] and [m].
        time: Time of each waypoint, shape (K,), in [s].
        programs: Number of QPs solved at each waypoint, shape (K,).
    """

    q: Array
    time: Array
    programs: NDArray[np.int_]


class StrokesError(InfeasibleError):
    """The tool cannot follow the path.

    Attributes:
        waypoint: Index of the first waypoint that it cannot reach.
        phase: Phase of that waypoint.
        step: Wave step, -1 outside the wave.
        status: How the iteration over its QPs ended.
        rows: Constraints that stay open when all of them are relaxed, the worst first.
    """

    def __init__(
        self,
        reason: Reason,
        place: tuple[int, str, int],
        status: StrokeStatus,
        rows: tuple[OpenRow, ...],
    ) -> None:
        """Prefix the reason with its moment: waypoint, phase and wave step."""
        waypoint, phase, step = place
        self.status, self.rows = status, rows
        what, excess, remedy = reason
        moment = phase
        if phase == "wave":
            moment = f"wave step {step + 1}" if step >= 0 else "start cup"
        if phase != "wave" and remedy == OUTWARD:
            remedy = "a flatter mold, less lift or a lower hover would help"
        super().__init__(f"{moment}: {what}", excess, remedy)
        self.waypoint, self.phase, self.step = waypoint, phase, step


def follow(
    cell: Cell,
    path: Path,
    progress: Callable[[int, Array], None] | None = None,
    qp: QpSolver | None = None,
) -> Motion:
    """Joint positions for every waypoint of a path.

    The arm's come from its inverse kinematics. The closed-form inverse of the legs
    proposes theirs, and the stroke QP makes them respect interlinks, fibers, limits
    and rates; what it returns is judged by residuals recomputed from the joints.

    Args:
        cell: Robot, mold and ply.
        path: The requested path.
        progress: Called with the number of waypoints done and the last one's joint
            positions.
        qp: Solver of the QPs; OSQP, kept alive, if None.

    Raises:
        ReachError: If the arm does not reach a placement of the tool.
        StrokesError: If the tool cannot take a pose that it must take.
    """
    follower = _Follower(cell, path, qp)
    for phase in ("wave", "pick"):  # the places that matter before the way to them
        follower.reach(path.phase.index(phase))
    for k in range(len(path.tau)):
        follower.advance(k)
        if progress:
            progress(k + 1, follower.rows[-1])
    q = np.stack(follower.rows)
    time = schedule(cell, path.phase, path.step, path.tau, q)
    return Motion(q, time, np.array(follower.programs))


def schedule(
    cell: Cell,
    phase: tuple[str, ...],
    step: NDArray[np.int_],
    tau: Array,
    q: Array,
) -> Array:
    """Times of waypoints.

    A wave step takes the scene's time and goes evenly in tau; elsewhere the slowest
    joint sets the time, at the scene's share of its speed.

    Args:
        cell: Gives the robot's speeds and the scene's times.
        phase: Phase of each waypoint.
        step: Wave step of each waypoint, shape (K,).
        tau: Progress within it, shape (K,).
        q: Joint positions, shape (K, nq).

    Returns:
        Times, shape (K,), in [s], rounded to microseconds.
    """
    motion = cell.scene.motion
    need = (np.abs(np.diff(q, axis=0)) / cell.robot.velocity).max(axis=1)
    duration = np.maximum(SHORTEST, need / motion.speed_fraction)
    wave = np.array(phase) == "wave"
    same = wave[1:] & wave[:-1] & (np.diff(step) == 0)
    share = tau[1:] - np.where(same, tau[:-1], 0.0)
    duration = np.where(wave[1:], motion.step_time_s * share, duration)
    return np.round(np.concatenate([[0.0], np.cumsum(duration)]), 6) + 0.0


def duration(cell: Cell, path: Path, k: int) -> float:
    """Time that the wave gives a waypoint, in [s]; unlimited elsewhere.

    Args:
        cell: Gives the time of a step.
        path: The path.
        k: Index of the waypoint.
    """
    if path.phase[k] != "wave":
        return np.inf
    same = path.phase[k - 1] == "wave" and path.step[k] == path.step[k - 1]
    before = path.tau[k - 1] if same else 0.0
    return float(cell.scene.motion.step_time_s * (path.tau[k] - before))


class _Follower:
    """Goes along a path, one waypoint after the other."""

    def __init__(self, cell: Cell, path: Path, qp: QpSolver | None) -> None:
        self.cell, self.path, self.robot = cell, path, cell.robot
        take_up = cell.scene.ply.take_up_mm * 1e-3
        self.solver = StrokeSolver(self.robot, cell.sampling.grid.span + take_up, qp)
        self.arm = np.array(cell.scene.robot.home_rad)
        self.rows: list[Array] = []
        self.programs: list[int] = []

    def advance(self, k: int) -> None:
        """Append the joint positions and the time of waypoint k."""
        path = self.path
        if k == 0 or not np.array_equal(path.tool[k], path.tool[k - 1]):
            self.arm = np.round(self.reach(k), DIGITS)
        previous = self.rows[-1] if self.rows else None
        guess, fixed = self._guess(k, previous)
        landing = path.states[k] >= CupState.LANDING
        request = path.positions[k], path.rotations[k]
        step = self.solver.step(
            guess, previous, request, fixed, landing, duration(self.cell, path, k)
        )
        solution, failure = self._solve(step)
        if failure:
            place = k, path.phase[k], int(path.step[k])
            raise StrokesError(failure[0], place, solution.status, failure[1])
        self.rows.append(np.round(solution.q, DIGITS))
        self.programs.append(solution.programs)

    def reach(self, k: int) -> Array:
        """Arm coordinates of waypoint k, shape (6,), in [rad].

        Raises:
            ReachError: If there are none.
        """
        try:
            return self.robot.arm_inverse(self.path.tool[k], self.arm)
        except ReachError as error:
            raise ReachError(error.target, error.error, self.path.phase[k]) from error

    def _solve(
        self, step: Step
    ) -> tuple[StrokeSolution, tuple[Reason, tuple[OpenRow, ...]] | None]:
        """Legs that follow a step, or why none do.

        What the QPs do not follow is relaxed: either some rows stay open, which are
        the reason, or none do, and the legs take the point where all hold.
        """
        robot, solver = self.robot, self.solver
        landing = step.landing & ~step.fixed
        solution = solver.solve(step)
        if solution.found and not explain(robot, solution, landing):
            return solution, None
        relaxed = relax_step(solver, step)
        if relaxed.rows:
            return solution, (explain_rows(robot, relaxed.rows), relaxed.rows)
        solution = solver.hold(step, relaxed.q)
        reason = explain(robot, solution, landing)
        return solution, (reason, ()) if reason else None

    def _guess(self, k: int, previous: Array | None) -> tuple[Array, NDArray[np.bool_]]:
        """Closed-form legs, and which of them stay as they were.

        Those of placed cups stay, and all of them where the ply rides on the tool.
        """
        path, robot, columns = self.path, self.robot, self.robot.leg_columns
        poses = path.positions[k], path.rotations[k]
        tool = robot.arm_forward(self.arm)
        guess = robot.configuration(
            self.arm, leg_coordinates(robot.geometry, tool, *poses)
        )
        if previous is None:
            return guess, np.zeros(len(columns), bool)
        standing = (path.states[k - 1] == CupState.PLACED) & (
            path.states[k] == CupState.PLACED
        )
        if np.abs(guess[columns] - previous[columns]).max() < STILL:
            standing = np.ones_like(standing)
        guess[columns[standing]] = previous[columns[standing]]
        return guess, standing
