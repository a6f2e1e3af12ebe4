"""Equilibrium of the tool: where given strokes really put the cups.

Strokes leave most of the tool's freedoms open: each leg hangs on a universal joint,
each cup on a ball. They settle where weight, ply, springs and bent links balance, with
the links as long as they are and no fiber stretched beyond its take-up.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from drapeplan.kkt import Layout, Layouts, Mask
from drapeplan.legs import STROKE, Array
from drapeplan.robot import Robot
from drapeplan.settle import Pose, Rest, Settler, Sides, reduced
from drapeplan.stability import least_curvature
from drapeplan.tool_energy import PASSIVE, Indices, ToolEnergy, ToolPhysics

__all__ = [
    "Equilibrium",
    "Sensitivities",
    "Settled",
    "SettledStatus",
    "ToolPhysics",
]

SHARES = 64  # a move is split into no smaller parts
MOST = 400  # iterations after which a move in parts is given up
NUDGE = 0.02  # [rad] largest turn that pushes the tool off a saddle


class SettledStatus(IntEnum):
    """What became of the search for an equilibrium."""

    SETTLED = 0
    SADDLE = 1  # at rest, but the least push makes it fall elsewhere
    FAILED = 2  # not at rest, or links and fibers do not hold


@dataclass(frozen=True)
class Settled:
    """The tool at rest, or the best that was found; arrays are read-only.

    Attributes:
        q: Configuration, shape (nq,), in [rad] and [m].
        multipliers: Tension of each interlink, shape (links,), in [N]; negative where
            it is compressed.
        chord_forces: Tension of the fiber on each rim, in the order of Chords, shape
            (chords,), in [N], zero or more.
        status: What it is.
        iterations: Linear systems solved, all parts of a split move together.
        residual: Largest moment left on a free passive coordinate, [N m].
        closure: Largest error of an interlink, or excess of a fiber, [m].
        least_eigenvalue: Least curvature of the energy along motions that keep links
            and taut fibers, [N m/rad]; None where it was not asked for, or there is no
            such motion.
    """

    q: Array
    multipliers: Array
    chord_forces: Array
    status: SettledStatus
    iterations: int
    residual: float
    closure: float
    least_eigenvalue: float | None


@dataclass(frozen=True)
class Sensitivities:
    """How all cups move with the strokes of the free legs.

    Fibers that are taut stay taut: where one is about to go slack, these are the
    derivatives on one side.

    Attributes:
        position: Of the suction faces' centers, world, shape (n, 3, k), [-].
        rotation: Of the cups' rotation vectors, world, shape (n, 3, k), in [rad/m].
        q: Of the configuration, shape (nq, k), in [rad/m]; 1 at the own stroke.
        free: Cups whose legs are free, shape (k,).
    """

    position: Array
    rotation: Array
    q: Array
    free: Indices


class Equilibrium:
    """Quasi-static equilibrium of one tool with one ply."""

    def __init__(self, robot: Robot, physics: ToolPhysics) -> None:
        """Lay out all that is fixed.

        Args:
            robot: Arm and tool; masses come from its URDF.
            physics: The ply.
        """
        self.robot, self.physics = robot, physics
        self.energy = ToolEnergy(robot, physics)
        self._layouts = Layouts(robot.rows, robot.columns, self.energy)
        self._settler = Settler(self.energy, self._layouts)

    def settle(
        self,
        q: Array,
        fixed: Mask,
        warm: Settled | None = None,
        *,
        stability: bool = True,
        leave: bool = True,
    ) -> Settled:
        """Let the passive coordinates of the free legs settle.

        From a warm start, a move that does not converge, or ends on a saddle, is
        repeated in parts from the warm configuration.

        Args:
            q: Configuration, shape (nq,): arm, strokes and fixed legs are taken from
                it; its passive coordinates of free legs are the start.
            fixed: Legs whose coordinates stay, as those of placed cups, shape (n,).
            warm: Result of a pose nearby, whose forces and taut fibers are the start.
            stability: Whether to tell a stable equilibrium from a saddle.
            leave: Whether to leave a saddle downhill; else it is the answer.

        Returns:
            The equilibrium, with its status.
        """
        q, free = np.array(q, dtype=float), ~np.asarray(fixed, dtype=bool)
        T = self.robot.arm_forward(q[self.robot.arm_columns])
        start = self._pose(q, warm)
        rest = self._settler.settle(T, start, free)
        least = self._least(rest, free) if stability else None
        count = rest.iterations
        if rest.found and not leave:
            return self._result(q, rest, least, count)
        if not _good(rest, least) and warm is not None:
            whole, least_whole, more = self._in_parts(q, warm, free, stability)
            count += more
            if whole is not None:
                rest, least = whole, least_whole
        if not _good(rest, least) and (rest.found or (warm is None and not rest.torn)):
            careful, least_careful, more = self._leave(T, rest, start, free, stability)
            count += more
            if careful.found or not rest.found:
                rest, least = careful, least_careful
        return self._result(q, rest, least, count)

    def settle_once(self, q: Array, fixed: Mask, warm: Settled) -> Settled:
        """One run of Newton's method, with no help where it goes astray.

        Args:
            q: Configuration, shape (nq,).
            fixed: Legs whose coordinates stay, shape (n,).
            warm: Result of a pose nearby.

        Returns:
            Where it ended, with its status.
        """
        free = ~np.asarray(fixed, dtype=bool)
        T = self.robot.arm_forward(q[self.robot.arm_columns])
        rest = self._settler.settle(T, self._pose(q, warm), free)
        least = self._least(rest, free)
        return self._result(np.array(q, dtype=float), rest, least, rest.iterations)

    def layout(self, free: Mask, forces: Array) -> Layout:
        """Places of the unknowns of Newton's system.

        Args:
            free: Legs that are free, shape (n,).
            forces: Of all rows, shape (r,); rigid links count with any force.

        Returns:
            The layout.
        """
        live = free[self.energy.row_pairs].any(axis=1)
        return self._layouts(free, live & (self._settler.rigid | (forces != 0)))

    def sensitivities(self, settled: Settled, fixed: Mask) -> Sensitivities:
        """Derivatives of all cup poses by the strokes of the free legs.

        Args:
            settled: An equilibrium.
            fixed: Legs that stay, as it was settled, shape (n,).

        Returns:
            The derivatives.

        Raises:
            ArithmeticError: The equilibrium does not depend smoothly on the strokes.
        """
        robot, free = self.robot, ~np.asarray(fixed, dtype=bool)
        pose = self._pose(settled.q, settled)
        T = robot.arm_forward(settled.q[robot.arm_columns])
        terms = self.energy.evaluate(T, pose.legs, pose.forces)
        layout = self.layout(free, pose.forces)
        cups = layout.cups
        right = np.zeros((layout.size, len(robot.leg_columns)))
        right[layout.x[cups], cups[:, None]] = terms.own[cups][:, PASSIVE, STROKE]
        i, j = self.energy.pairs[layout.pairs].T
        mixed = terms.mixed[layout.pairs]
        right[layout.x[i], j[:, None]] = mixed[:, PASSIVE, STROKE]
        right[layout.x[j], i[:, None]] = mixed[:, STROKE, PASSIVE]
        for k in (0, 1):
            ends = layout.ends[k]
            legs = self.energy.row_pairs[ends, k]
            right[layout.f[ends], legs] = terms.rows[ends, k, STROKE]
        slopes = layout.factor(terms).solve(-right[:, cups])
        by_leg = np.zeros((len(free), 6, len(cups)))
        by_leg[np.ix_(cups, PASSIVE)] = slopes[layout.x[cups]]
        by_leg[cups, STROKE, np.arange(len(cups))] = 1.0
        return self._on_faces(terms.positions, terms.twists, by_leg, cups)

    def _on_faces(
        self, positions: Array, twists: Array, by_leg: Array, cups: Indices
    ) -> Sensitivities:
        """Motion of the faces from that of the legs' coordinates, shape (n, 6, k)."""
        slopes = np.zeros((self.robot.nq, len(cups)))
        slopes[self.robot.leg_columns] = by_leg
        motion = twists.swapaxes(1, 2) @ by_leg  # velocity at the world's origin, turn
        turn = motion[:, 3:]
        position = motion[:, :3] + np.cross(turn, positions[:, :, None], axis=1)
        return Sensitivities(position, turn, slopes, cups)

    def _pose(self, q: Array, warm: Settled | None) -> Pose:
        """Legs of a configuration with the forces of a result."""
        legs = q[self.robot.leg_columns]
        if warm is None:
            forces = np.zeros(len(self.energy.row_pairs))
        else:
            forces = np.concatenate([warm.multipliers, warm.chord_forces])
        sides: Sides = np.sign(forces).astype(np.int8)
        return Pose(legs, forces, sides)

    def _least(self, rest: Rest, free: Mask) -> float | None:
        """Least curvature along the rows, [N m/rad]."""
        if not rest.found or not free.any():
            return None
        return least_curvature(self._layouts(free, rest.pose.sides != 0), rest.terms)

    def _in_parts(
        self, q: Array, warm: Settled, free: Mask, stability: bool
    ) -> tuple[Rest | None, float | None, int]:
        """Go from the warm configuration to q, in parts as large as converge.

        Returns:
            The rest at q, None if it is not reached; its curvature; iterations.
        """
        columns = self.robot.arm_columns
        start, pose = warm.q, self._pose(warm.q, warm)
        done, part, count = 0.0, 0.5, 0
        move = (q - start)[self.robot.leg_columns]
        move[np.ix_(free, PASSIVE)] = 0.0
        while True:
            share = min(part, 1.0 - done)
            T = self.robot.arm_forward((start + (done + share) * (q - start))[columns])
            moved = Pose(pose.legs + share * move, pose.forces, pose.sides)
            rest = self._settler.settle(T, moved, free)
            least = self._least(rest, free) if stability else None
            count += rest.iterations
            if _good(rest, least):
                done, pose, part = done + share, rest.pose, 2 * share
            elif count > MOST:
                return None, None, count
            elif share > 1 / SHARES:
                part = share / 2
                continue
            else:
                if rest.found or not rest.torn:
                    rest, least, more = self._leave(T, rest, moved, free, stability)
                    count += more
                if not _good(rest, least):
                    return None, None, count
                done, pose, part = done + share, rest.pose, share
            if done >= 1.0:
                return rest, least, count

    def _leave(
        self, T: Array, rest: Rest, start: Pose, free: Mask, stability: bool
    ) -> tuple[Rest, float | None, int]:
        """Go downhill: off a saddle along its falling direction, or from the start."""
        pose, count = start, 0
        if rest.found:
            H, J = self._layouts(free, rest.pose.sides != 0).dense(rest.terms)
            fall = reduced(H, J)[1][:, 0]
            legs = rest.pose.legs.copy()
            push = NUDGE * fall / np.abs(fall).max()
            legs[np.ix_(free, PASSIVE)] += push.reshape(-1, 5)
            pose = Pose(legs, rest.pose.forces, rest.pose.sides)
        rest = self._settler.settle(T, pose, free, careful=True)
        count += rest.iterations
        return rest, self._least(rest, free) if stability else None, count

    def _result(
        self, q: Array, rest: Rest, least: float | None, iterations: int
    ) -> Settled:
        """Put a result together, read-only."""
        q[self.robot.leg_columns] = rest.pose.legs
        forces, n = rest.pose.forces, self.energy.n_links
        if not rest.found:
            status = SettledStatus.FAILED
        elif least is not None and least <= 0:
            status = SettledStatus.SADDLE
        else:
            status = SettledStatus.SETTLED
        arrays = q, forces[:n].copy(), forces[n:].copy()
        for array in arrays:
            array.setflags(write=False)
        return Settled(*arrays, status, iterations, rest.residual, rest.closure, least)


def _good(rest: Rest, least: float | None) -> bool:
    """At rest, and not known to be a saddle."""
    return rest.found and (least is None or least > 0)
