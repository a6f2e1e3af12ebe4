"""Motion: joint positions that follow a path, or the reason why none do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drapeplan.cell import Cell
from drapeplan.errors import InfeasibleError
from drapeplan.legs import leg_coordinates
from drapeplan.path import CupState, Path
from drapeplan.robot import ReachError, Robot
from drapeplan.strokes import StrokeSolution, StrokeSolver

Array = NDArray[np.float64]

CLOSED = 1e-6  # [m] largest error of an interlink's length: 1e-3 mm
CHORD = 1e-6  # [m] largest excess of a chord over its fiber
LIMIT = 1e-6  # [rad], [m] largest excess over a joint limit
LANDED = 1e-4  # [m] largest distance of a landed cup from its target: 0.1 mm
WAITED = 1e-3  # [m] largest distance of a waiting cup from its request: 1 mm
ALIGNED = np.radians(0.1)  # [rad] largest angle of a landed cup from its target
STILL = 1e-12  # [rad], [m] legs that change by less than this do not move
SHORTEST = 0.05  # [s] shortest time between waypoints outside the wave
OUTWARD = "place the cups from the start outward, neighbor by neighbor"
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
    """

    def __init__(
        self, reason: tuple[str, str, str], waypoint: int, phase: str, step: int
    ) -> None:
        """Prefix the reason with its moment."""
        what, excess, remedy = reason
        moment = phase
        if phase == "wave":
            moment = f"wave step {step + 1}" if step >= 0 else "start cup"
        if phase != "wave" and remedy == OUTWARD:
            remedy = "a flatter mold, less lift or a lower hover would help"
        super().__init__(f"{moment}: {what}", excess, remedy)
        self.waypoint, self.phase, self.step = waypoint, phase, step


def follow(
    cell: Cell, path: Path, progress: Callable[[int], None] | None = None
) -> Motion:
    """Joint positions for every waypoint of a path.

    The arm's come from its inverse kinematics. The closed-form inverse of the legs
    proposes theirs, and the stroke QP makes them respect interlinks, fibers, limits
    and rates; what it returns is judged by residuals recomputed from the joints.

    Args:
        cell: Robot, mold and ply.
        path: The requested path.
        progress: Called with the number of waypoints done.

    Raises:
        ReachError: If the arm does not reach a placement of the tool.
        StrokesError: If the tool cannot take a pose that it must take.
    """
    follower = _Follower(cell, path)
    for phase in ("wave", "pick"):  # the places that matter before the way to them
        follower.reach(path.phase.index(phase))
    for k in range(len(path.tau)):
        follower.advance(k)
        if progress:
            progress(k + 1)
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


class _Follower:
    """Goes along a path, one waypoint after the other."""

    def __init__(self, cell: Cell, path: Path) -> None:
        self.cell, self.path, self.robot = cell, path, cell.robot
        take_up = cell.scene.ply.take_up_mm * 1e-3
        self.solver = StrokeSolver(self.robot, cell.sampling.grid.span + take_up)
        self.arm = np.array(cell.scene.robot.home_rad)
        self.rows: list[Array] = []
        self.programs: list[int] = []

    def advance(self, k: int) -> None:
        """Append the joint positions and the time of waypoint k."""
        path, robot = self.path, self.robot
        if k == 0 or not np.array_equal(path.tool[k], path.tool[k - 1]):
            self.arm = np.round(self.reach(k), DIGITS)
        previous = self.rows[-1] if self.rows else None
        guess, fixed = self._guess(k, previous)
        landing = path.states[k] >= CupState.LANDING
        request = path.positions[k], path.rotations[k]
        solution = self.solver.solve(
            guess, previous, request, fixed, landing, self._duration(k)
        )
        reason = explain(robot, solution, landing & ~fixed)
        if reason:  # the constraint that the request itself breaks says more
            asked = self.solver.judge(guess, request)
            reason = explain(robot, asked, landing & ~fixed) or reason
            reason = self._too_fast(k, guess, previous) or reason
            raise StrokesError(reason, k, path.phase[k], int(path.step[k]))
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

    def _too_fast(
        self, k: int, guess: Array, previous: Array | None
    ) -> tuple[str, str, str] | None:
        """The joint that would have to move too fast for the wave's time, if any."""
        if previous is None:
            return None
        share = np.abs(guess - previous) / (self.robot.velocity * self._duration(k))
        joint = int(share.argmax())
        if share[joint] <= 1:
            return None
        what = f"joint {self.robot.model.names[1 + joint]} passes its speed limit"
        return what, f"{100 * (share[joint] - 1):.0f} %", "raise motion.step_time_s"

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

    def _duration(self, k: int) -> float:
        """Time that the wave gives a waypoint, [s]; unlimited elsewhere."""
        path = self.path
        if path.phase[k] != "wave":
            return np.inf
        same = path.phase[k - 1] == "wave" and path.step[k] == path.step[k - 1]
        before = path.tau[k - 1] if same else 0.0
        return float(self.cell.scene.motion.step_time_s * (path.tau[k] - before))


def explain(
    robot: Robot, solution: StrokeSolution, landing: NDArray[np.bool_]
) -> tuple[str, str, str] | None:
    """What a solution breaks worst: what, by how much, what would help.

    Args:
        robot: Arm and tool.
        solution: Result of the stroke QP.
        landing: Cups that must meet their request, shape (n,).

    Returns:
        None if nothing is broken.
    """
    allowed = np.where(landing, LANDED, WAITED)
    breaks = [
        (np.abs(solution.closure) / CLOSED, _closure),
        (solution.position_error / allowed, _position),
        (np.where(landing, solution.angle_error, 0.0) / ALIGNED, _angle),
        (solution.limit_excess / LIMIT, _limit),
        (solution.chord_excess / CHORD, _chord),
    ]
    shares, words = max(breaks, key=lambda pair: pair[0].max())
    worst = int(shares.argmax())
    return words(robot, solution, worst) if shares[worst] > 1 else None


def _cup(robot: Robot, index: int) -> str:
    return f"cup ({index // robot.columns}, {index % robot.columns})"


def _pair(robot: Robot, index: int) -> str:
    i, j = robot.tool.interlinks.pairs[index]
    return f"{_cup(robot, int(i))} and {_cup(robot, int(j))}"


def _closure(robot: Robot, solution: StrokeSolution, k: int) -> tuple[str, str, str]:
    word = "longer" if solution.closure[k] > 0 else "shorter"
    what = f"rigid interlinks cannot reach it: the one between {_pair(robot, k)}"
    excess = f"{1e3 * abs(solution.closure[k]):.3g} mm"
    return f"{what} would have to be {word}", excess, OUTWARD


def _position(robot: Robot, solution: StrokeSolution, k: int) -> tuple[str, str, str]:
    what = f"rigid interlinks cannot reach it: {_cup(robot, k)} misses its request"
    return what, f"{1e3 * solution.position_error[k]:.3g} mm", OUTWARD


def _angle(robot: Robot, solution: StrokeSolution, k: int) -> tuple[str, str, str]:
    what = f"{_cup(robot, k)} misses the angle of its target"
    remedy = "raise ply.take_up_mm, widen the ball's limit or place the mold flatter"
    return what, f"{np.degrees(solution.angle_error[k]):.3g} deg", remedy


def _limit(robot: Robot, solution: StrokeSolution, k: int) -> tuple[str, str, str]:
    name = robot.model.names[1 + k]
    unit = "mm" if name.endswith("stroke") else "deg"
    size = 1e3 if unit == "mm" else np.degrees(1.0)
    what = f"joint {name} passes its limit"
    remedy = "a longer stroke, a flatter mold or another start would help"
    return what, f"{size * solution.limit_excess[k]:.3g} {unit}", remedy


def _chord(robot: Robot, solution: StrokeSolution, k: int) -> tuple[str, str, str]:
    what = f"a fiber between {_pair(robot, k // 2)} is too short"
    remedy = "raise ply.take_up_mm if the weave allows it, or lift less (path)"
    return what, f"{1e3 * solution.chord_excess[k]:.3g} mm", remedy
