"""Strokes: the QP that turns requested cup poses into what the legs can do."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from drapeplan.closures import Chords, Closures
from drapeplan.frames import rotation_vectors
from drapeplan.patterns import RowPattern, block_pattern
from drapeplan.qp import QpSolver, QuadraticProgram
from drapeplan.robot import Robot, State, face_jacobian

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CLOSED = 1e-6  # [m] largest error of an interlink's length: 1e-3 mm
CHORD = 1e-6  # [m] largest excess of a chord over its fiber
LIMIT = 1e-6  # [rad], [m] largest excess over a joint limit
LANDED = 1e-4  # [m] largest distance of a landed cup from its target: 0.1 mm
WAITED = 1e-3  # [m] largest distance of a waiting cup from its request: 1 mm
ALIGNED = np.radians(0.1)  # [rad] largest angle of a landed cup from its target
MILLI = 1e3  # rows of the QP are in mm, so that they are of order one
TILT_LEVER = 35.0  # [mm/rad] a tilt counts like the rise of half a free span
WAITING = 0.02  # [-] weight of cups that neither stand nor land
DAMPING = 1e-6  # [-] keeps the Hessian definite
TRUST = 0.15  # [rad], [m] longest step of one linearization
STEPS = 20  # most linearizations
SETTLED = 1e-9  # [rad], [m] step at which the iteration has settled
CREEP = 1e-5  # [rad], [m] step that is not worth another one where all rows hold
PATIENCE = 4  # linearizations without a better residual that make a stall
BETTER = 0.9  # [-] share of the best residual that counts as better


class StrokeStatus(StrEnum):
    """How the iteration over QPs ended."""

    FOLLOWED = "followed"
    INFEASIBLE = "infeasible"  # a linearization has no solution
    STALLED = "stalled"  # every QP solves, yet interlinks or fibers stay open


@dataclass(frozen=True)
class Step:
    """What the legs are asked for at one waypoint.

    Attributes:
        guess: Joint positions to start from, shape (nq,).
        request: Cup positions, shape (n, 3), in [m], and rotations, shape (n, 3, 3),
            in the world.
        fixed: Cups on the mold, whose legs stay as they are in the guess.
        landing: Cups whose pose matters most.
        lower: Least positions in reach, by limits and rates, shape (nq,).
        upper: Largest positions in reach, shape (nq,).
    """

    guess: Array
    request: tuple[Array, Array]
    fixed: Mask
    landing: Mask
    lower: Array
    upper: Array


@dataclass(frozen=True)
class StrokeSolution:
    """Legs that follow a request, and how well, all recomputed from the legs.

    Attributes:
        q: Joint positions of arm and tool.
        status: How the iteration ended.
        programs: Number of QPs solved.
        closure: Error of each interlink's length, [m].
        chord_excess: Chord of each fiber beyond its longest length, [m].
        limit_excess: Each joint beyond its limits, [rad] or [m].
        position_error: Distance of each cup from its request, [m].
        angle_error: Angle of each cup from its request, [rad].
    """

    q: Array
    status: StrokeStatus
    programs: int
    closure: Array
    chord_excess: Array
    limit_excess: Array
    position_error: Array
    angle_error: Array

    @property
    def found(self) -> bool:
        """Whether every QP was solved, and interlinks and fibers hold."""
        return self.status == StrokeStatus.FOLLOWED


class Pattern:
    """Where the numbers of a step go, as long as the same cups stand.

    Attributes:
        free: Cups whose legs move, shape (n,).
        columns: Places in q of the variables, six for each free cup.
        linked: Interlinks with a free cup.
        stretched: Fibers with a free cup.
        hessian: Blocks of the free legs.
        closures: Rows of the interlinks.
        chords: Rows of the fibers.
    """

    def __init__(self, robot: Robot, rows: tuple[Closures, Chords], fixed: Mask):
        """Fix the pattern."""
        self.free = ~fixed
        self.columns = robot.leg_columns[self.free].ravel()
        n = len(self.columns)
        place = np.full(robot.nq, -1)
        place[self.columns] = np.arange(n)
        self.linked, self.stretched = (self.free[r.pairs].any(axis=1) for r in rows)
        self.hessian = block_pattern(n // 6, 6)
        self.closures = RowPattern(place[rows[0].columns[self.linked]], n)
        self.chords = RowPattern(place[rows[1].columns[self.stretched]], n)


class StrokeSolver:
    """Sequential QP over the legs that are free to move.

    At each linearization, with x the change of the free legs,

        minimise    sum over cups of weight |e_position - J x|^2 (and of the tilt)
        subject to  closures + C x = 0,  chords + F x <= longest fiber,
                    joint limits, rate limits and a trust region.

    Legs of placed cups are not among the variables. This is the kinematic
    fidelity: passive joints are free, as if something steered them.
    """

    def __init__(
        self, robot: Robot, longest_fiber: float, qp: QpSolver | None = None
    ) -> None:
        """Prepare the rows.

        Args:
            robot: Arm and tool.
            longest_fiber: Free length of a fiber plus its take-up, [m].
            qp: Solver of the QPs; OSQP, kept alive, if None.
        """
        self.robot = robot
        self.closures, self.chords = Closures(robot), Chords(robot)
        self.longest_fiber = longest_fiber
        self.qp = qp or QpSolver()
        self._pattern: Pattern | None = None

    def step(
        self,
        guess: Array,
        previous: Array | None,
        request: tuple[Array, Array],
        fixed: Mask,
        landing: Mask,
        duration: float,
    ) -> Step:
        """Put together what a waypoint asks for.

        Args:
            guess: Joint positions to start from, shape (nq,); the closed-form leg
                inverse kinematics of the request is the best there is.
            previous: Joint positions of the waypoint before; None if there is none.
            request: Cup positions, shape (n, 3), in [m], and rotations, shape
                (n, 3, 3), in the world.
            fixed: Cups on the mold, whose legs stay as they are in `guess`.
            landing: Cups whose pose matters most.
            duration: Time since the waypoint before, [s].
        """
        lower, upper = self.robot.lower, self.robot.upper
        if previous is not None:
            reach = self.robot.velocity * duration
            lower = np.maximum(lower, previous - reach)
            upper = np.minimum(upper, previous + reach)
        return Step(guess, request, fixed, landing, lower, upper)

    def solve(self, step: Step) -> StrokeSolution:
        """Follow a request as well as the tool can.

        Args:
            step: What is asked for.
        """
        q, columns = step.guess.copy(), self.pattern(step.fixed).columns
        status, programs = StrokeStatus.FOLLOWED, 0
        best, since = np.inf, 0
        while columns.size and programs < STEPS:
            program = self.program(self.robot.kinematics(q), step)
            taut = (-program.h).max(initial=0.0)
            residual = max(np.abs(program.b).max(initial=0.0), taut) / MILLI
            since = 0 if residual < BETTER * best else since + 1
            best = min(best, residual)
            if residual > CLOSED and since >= PATIENCE:
                break
            solution = self.qp.solve(program)
            programs += 1
            if not solution.found:
                status = StrokeStatus.INFEASIBLE
                break
            q[columns] += solution.x
            moved = np.abs(solution.x).max()
            if moved < SETTLED or (moved < CREEP and residual < SETTLED):
                break
        judged = self.judge(q, step.request, status, programs)
        excess = judged.chord_excess.max(initial=0.0)
        residual = max(np.abs(judged.closure).max(initial=0.0), excess)
        if judged.found and columns.size and residual > CLOSED:
            return replace(judged, status=StrokeStatus.STALLED)
        return judged

    def hold(self, step: Step, q: Array) -> StrokeSolution:
        """Close interlinks and fibers where the legs are, and judge by the request.

        Args:
            step: What is asked for.
            q: Joint positions that meet it, but for roundings, shape (nq,).
        """
        state = self.robot.kinematics(q)
        here = replace(step, guess=q, request=(state.positions, state.rotations))
        held = self.solve(here)
        return self.judge(held.q, step.request, held.status, held.programs)

    def pattern(self, fixed: Mask) -> Pattern:
        """Pattern of the steps with given cups on the mold; the last one is kept."""
        if self._pattern is None or not np.array_equal(~fixed, self._pattern.free):
            self._pattern = Pattern(self.robot, (self.closures, self.chords), fixed)
        return self._pattern

    def program(self, state: State, step: Step) -> QuadraticProgram:
        """Linearization at a state: lengths in mm, variables in rad and m.

        Args:
            state: Kinematics of all cups.
            step: What is asked for.
        """
        pattern = self.pattern(step.fixed)
        free, columns = pattern.free, pattern.columns
        poses = state.positions, state.rotations
        e = np.concatenate(pose_errors(*poses, step.request), axis=1)[free]
        scale = np.repeat([MILLI, TILT_LEVER], 3)
        J = face_jacobian(state)[free][..., 6:] * scale[:, None]
        weighted = np.where(step.landing, 1.0, WAITING)[free, None, None] * J
        blocks = weighted.swapaxes(1, 2) @ J + DAMPING * np.eye(6)
        c = -((e * scale)[:, None] @ weighted).ravel()
        closure = self.closures.values(*poses)[pattern.linked]
        slack = self.longest_fiber - self.chords.values(*poses)[pattern.stretched]
        C = self.closures.gradients(state)[pattern.linked]
        F = self.chords.gradients(state)[pattern.stretched]
        box = step.lower[columns], step.upper[columns]
        lower, upper = (np.clip(x - state.q[columns], -TRUST, TRUST) for x in box)
        return QuadraticProgram(
            pattern.hessian.fill(blocks),
            c,
            pattern.chords.fill(MILLI * F),
            MILLI * slack,
            pattern.closures.fill(MILLI * C),
            -MILLI * closure,
            lower,
            upper,
        )

    def judge(
        self,
        q: Array,
        request: tuple[Array, Array],
        status: StrokeStatus = StrokeStatus.FOLLOWED,
        programs: int = 0,
    ) -> StrokeSolution:
        """Residuals of joint positions, whoever made them.

        Args:
            q: Joint positions, shape (nq,).
            request: Cup positions and rotations asked for.
            status: How the iteration ended.
            programs: Number of QPs solved.
        """
        robot = self.robot
        state = robot.kinematics(q)
        poses = state.positions, state.rotations
        position, angle = pose_errors(*poses, request)
        return StrokeSolution(
            q,
            status,
            programs,
            self.closures.values(*poses),
            self.chords.values(*poses) - self.longest_fiber,
            np.maximum(robot.lower - q, q - robot.upper),
            np.linalg.norm(position, axis=1),
            np.linalg.norm(angle, axis=1),
        )


def pose_errors(
    positions: Array, rotations: Array, request: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Position and rotation vectors from poses to a request, each (n, 3), world."""
    return request[0] - positions, rotation_vectors(rotations, request[1])
