"""Strokes: the QP that turns requested cup poses into what the legs can do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag, csc_matrix

from drapeplan.closures import Chords, Closures
from drapeplan.frames import rotation_vectors
from drapeplan.qp import QpSolver, QuadraticProgram
from drapeplan.robot import Robot, State, face_jacobian

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MILLI = 1e3  # rows of the QP are in mm, so that they are of order one
TILT_LEVER = 35.0  # [mm/rad] a tilt counts like the rise of half a free span
WAITING = 0.02  # [-] weight of cups that neither stand nor land
DAMPING = 1e-6  # [-] keeps the Hessian definite
TRUST = 0.15  # [rad], [m] longest step of one linearization
STEPS = 12  # most linearizations
SETTLED = 1e-9  # [rad], [m] step at which the iteration has settled


@dataclass(frozen=True)
class StrokeSolution:
    """Legs that follow a request, and how well, all recomputed from the legs.

    Attributes:
        q: Joint positions of arm and tool.
        found: Whether every QP was solved.
        programs: Number of QPs solved.
        closure: Error of each interlink's length, [m].
        chord_excess: Chord of each fiber beyond its longest length, [m].
        limit_excess: Each joint beyond its limits, [rad] or [m].
        position_error: Distance of each cup from its request, [m].
        angle_error: Angle of each cup from its request, [rad].
    """

    q: Array
    found: bool
    programs: int
    closure: Array
    chord_excess: Array
    limit_excess: Array
    position_error: Array
    angle_error: Array


class StrokeSolver:
    """Sequential QP over the legs that are free to move.

    At each linearization, with x the change of the free legs,

        minimise    sum over cups of weight |e_position - J x|^2 (and of the tilt)
        subject to  closures + C x = 0,  chords + F x <= longest fiber,
                    joint limits, rate limits and a trust region.

    Legs of placed cups are not among the variables. This is the kinematic
    fidelity: passive joints are free, as if something steered them.
    """

    def __init__(self, robot: Robot, longest_fiber: float) -> None:
        """Prepare the fixed patterns.

        Args:
            robot: Arm and tool.
            longest_fiber: Free length of a fiber plus its take-up, [m].
        """
        self.robot = robot
        self.closures, self.chords = Closures(robot), Chords(robot)
        self.longest_fiber = longest_fiber
        self.qp = QpSolver()

    def solve(
        self,
        guess: Array,
        previous: Array | None,
        request: tuple[Array, Array],
        fixed: Mask,
        landing: Mask,
        duration: float,
    ) -> StrokeSolution:
        """Follow a request as well as the tool can.

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
        robot, q = self.robot, guess.copy()
        columns = robot.leg_columns[~fixed].ravel()
        lower, upper = robot.lower[columns], robot.upper[columns]
        if previous is not None:
            reach = robot.velocity[columns] * duration
            lower = np.maximum(lower, previous[columns] - reach)
            upper = np.minimum(upper, previous[columns] + reach)
        weights = np.where(landing, 1.0, WAITING)[~fixed]
        found, programs = True, 0
        while columns.size and programs < STEPS:
            state = robot.kinematics(q)
            program = self._program(state, request, ~fixed, weights, columns)
            box = np.clip([lower - q[columns], upper - q[columns]], -TRUST, TRUST)
            solution = self.qp.solve(QuadraticProgram(*program, *box))
            programs += 1
            found = solution.found
            if not found:
                break
            q[columns] += solution.x
            if np.abs(solution.x).max() < SETTLED:
                break
        return self.judge(q, request, found, programs)

    def _program(
        self,
        state: State,
        request: tuple[Array, Array],
        free: Mask,
        weights: Array,
        columns: NDArray[np.int_],
    ) -> tuple[csc_matrix, Array, csc_matrix, Array, csc_matrix, Array]:
        position, angle = _errors(state.positions, state.rotations, request)
        J = face_jacobian(state)[free][..., 6:]
        scale = np.repeat([MILLI, TILT_LEVER], 3)
        e = np.concatenate([position, angle], axis=1)[free] * scale
        J = J * scale[:, None]
        blocks = np.einsum("k,kij,kil->kjl", weights, J, J) + DAMPING * np.eye(6)
        H = block_diag(list(blocks), format="csc")
        c = -np.einsum("k,kij,ki->kj", weights, J, e).ravel()
        moving = free[self.closures.pairs].any(axis=1)
        stretched = free[self.chords.pairs].any(axis=1)
        C = self.closures.jacobian(state)[moving][:, columns] * MILLI
        b = -self.closures.values(state.positions, state.rotations)[moving] * MILLI
        F = self.chords.jacobian(state)[stretched][:, columns] * MILLI
        chord = self.chords.values(state.positions, state.rotations)[stretched]
        h = (self.longest_fiber - chord) * MILLI
        return H, c, F.tocsc(), h, C.tocsc(), b

    def judge(
        self,
        q: Array,
        request: tuple[Array, Array],
        found: bool = True,
        programs: int = 0,
    ) -> StrokeSolution:
        """Residuals of joint positions, whoever made them.

        Args:
            q: Joint positions, shape (nq,).
            request: Cup positions and rotations asked for.
            found: Whether every QP was solved.
            programs: Number of QPs solved.
        """
        robot = self.robot
        state = robot.kinematics(q)
        poses = state.positions, state.rotations
        position, angle = _errors(*poses, request)
        return StrokeSolution(
            q,
            found,
            programs,
            self.closures.values(*poses),
            self.chords.values(*poses) - self.longest_fiber,
            np.maximum(robot.lower - q, q - robot.upper),
            np.linalg.norm(position, axis=1),
            np.linalg.norm(angle, axis=1),
        )


def _errors(
    positions: Array, rotations: Array, request: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Position and rotation vectors from poses to a request, each (n, 3), world."""
    return request[0] - positions, rotation_vectors(rotations, request[1])
