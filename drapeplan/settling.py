"""Settling: where the tool's passive joints come to rest along a path.

The kinematic solution of a path proposes strokes; each waypoint is settled at
equilibrium, the strokes are corrected to lead the tilt lag, and it is settled again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drapeplan.cell import Cell
from drapeplan.closures import Chords
from drapeplan.equilibrium import (
    Equilibrium,
    Sensitivities,
    Settled,
    SettledStatus,
)
from drapeplan.errors import InfeasibleError
from drapeplan.families import PathSection, known
from drapeplan.hanging import rides_level, tool_physics
from drapeplan.lead import DEPTH, StrokeLead, Task
from drapeplan.legs import STROKE, cup_poses
from drapeplan.motion import DIGITS, Motion, duration, schedule
from drapeplan.path import CupState, Path
from drapeplan.ply_rows import PlyRows
from drapeplan.rings import outward, ring_of

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

GIVEN = ("pick", "release", "retreat")  # phases with the cups on a table or let go
ROUNDS = 3  # most corrections of a waypoint; the first is enough where all is well
WORTH = 0.01e-3  # [m] ply deeper than believed, or fibers that gain: one more round
SLIGHT = 0.03e-3  # [m] fibers too long by no more may yet fit, at a higher price
FADE = 0.5e-3  # [m] of its fall over which a cup that leans back is laid flat
SHARES = (1.0, 0.5, 0.25)  # of a correction, tried until the tool comes to rest


class UnsettledError(InfeasibleError):
    """The tool has no stable rest at a waypoint.

    Attributes:
        waypoint: Index of the waypoint.
        phase: Its phase.
        step: Its wave step, -1 outside the wave.
    """

    def __init__(self, path: Path, k: int, settled: Settled) -> None:
        """Say where, and what was found instead."""
        self.waypoint, self.phase, self.step = k, path.phase[k], int(path.step[k])
        moment = self.phase
        if moment == "wave":
            moment = f"wave step {self.step + 1}" if self.step >= 0 else "start cup"
        if settled.status == SettledStatus.SADDLE:
            what = "the cups have no stable rest, the tool would flip"
            figure = f"stiffness {settled.least_eigenvalue:.3g} N m/rad"
            remedy = "lower or lighter cups, a stiffer ply or a flatter mold would help"
        else:
            what = "no rest of the tool was found"
            figure = f"{settled.residual:.3g} N m out of balance"
            remedy = "a flatter or less tilted mold, or another lift, would help"
        super().__init__(f"{moment}: {what} ({figure})", "", remedy)


@dataclass(frozen=True)
class Settling:
    """A path at rest, and what was learned on the way; K waypoints.

    Attributes:
        motion: Joint positions at equilibrium, with their times.
        believed: How far the QP's belief about free cups was off, shape (K,), in [m].
        iterations: Newton steps, shape (K,).
        least_eigenvalue: Stability of each waypoint, shape (K,); NaN-free: infinite
            where nothing had to settle.
    """

    motion: Motion
    believed: Array
    iterations: NDArray[np.int_]
    least_eigenvalue: Array


def settle_path(
    cell: Cell,
    path: Path,
    motion: Motion,
    *,
    lead: bool = True,
    progress: Callable[[int, Array], None] | None = None,
) -> Settling:
    """Settle a path at equilibrium, its strokes leading the lag of the cups.

    Args:
        cell: Robot, mold and ply.
        path: The requested path.
        motion: Its kinematic solution.
        lead: Whether strokes are corrected; else those of the motion are kept.
        progress: Called with the number of waypoints done and the last one's joint
            positions.

    Raises:
        UnsettledError: A waypoint has no stable rest.
    """
    walk = _Walk(cell, path, motion, lead)
    for k in range(len(path.tau)):
        walk.advance(k)
        if progress:
            progress(k + 1, walk.rows[-1])
    return walk.result()


def _toe_up(section: PathSection, step: NDArray[np.int_]) -> Array:
    """Lean of the cups that land at each waypoint, shape (K,), in [rad]."""
    angles = np.full(len(step), known(section.toe_up_deg))
    for number, angle in section.toe_up_steps:
        angles[step == number - 1] = angle
    return np.radians(angles)


class _Walk:
    """Goes along a path, each waypoint warm from the one before."""

    def __init__(self, cell: Cell, path: Path, motion: Motion, lead: bool) -> None:
        self.cell, self.path, self.motion, self.lead = cell, path, motion, lead
        self.robot, self.columns = cell.robot, cell.robot.leg_columns
        physics = tool_physics(cell)
        self.tool = Equilibrium(self.robot, physics)
        self.strokes = StrokeLead(Chords(self.robot), physics.longest_fiber)
        self.toe_up = _toe_up(cell.scene.path, path.step)
        n = len(self.columns)
        placed = np.asarray(path.states == CupState.PLACED)
        last = len(path.phase) - 1 - path.phase[::-1].index("wave")
        self.landed = path.positions[last], path.rotations[last]
        self.ply = PlyRows(cell, self.landed)
        self.start = placed[placed.any(axis=1).argmax()]
        legs = motion.q[:, self.columns]
        given = np.append(True, np.isin(path.phase[:-1], GIVEN))
        self.rides = ~given & rides_level(path.tool, legs, placed)
        self.carry = np.zeros((n, 6))  # settled legs less the kinematic ones
        self.settled: Settled | None = None
        self.rows: list[Array] = []
        self.facts: list[tuple[float, int, float]] = []

    def advance(self, k: int) -> None:
        """Append the joint positions of waypoint k."""
        if self.path.phase[k] in GIVEN:
            self._append(self.motion.q[k], (0.0, 0, np.inf))
        elif self.rides[k]:
            q = self.rows[-1].copy()
            q[self.robot.arm_columns] = self.motion.q[k, self.robot.arm_columns]
            self._append(q, (0.0, 0, self.facts[-1][2]))
        else:
            self._settle(k)

    def _append(self, q: Array, facts: tuple[float, int, float]) -> None:
        self.rows.append(np.round(q, DIGITS))
        self.facts.append(facts)

    def _settle(self, k: int) -> None:
        path, columns = self.path, self.columns
        fixed = np.asarray(path.states[k] == CupState.PLACED)
        kinematic = self.motion.q[k]
        q = kinematic.copy()
        q[columns[~fixed]] += self.carry[~fixed]
        room = self._room(k, fixed)
        stroke = columns[~fixed, STROKE]
        q[stroke] = np.clip(q[stroke], *room)
        settled = self._rest(k, [q, kinematic], fixed)
        believed, iterations = 0.0, settled.iterations
        if self.lead and not fixed.all():
            settled, believed, more = self._led(k, settled, fixed, room)
            iterations += more
        self.settled = settled
        self.carry = settled.q[columns] - kinematic[columns]
        self.carry[fixed] = 0.0
        least = settled.least_eigenvalue
        self._append(
            settled.q, (believed, iterations, np.inf if least is None else least)
        )

    def _led(
        self, k: int, settled: Settled, fixed: Mask, room: tuple[Array, Array]
    ) -> tuple[Settled, float, int]:
        """Strokes corrected, and again where that may help ply or fibers.

        Returns:
            The settled result, the last belief's error, [m], and Newton's steps.
        """
        poses, iterations = self._poses(settled.q), 0
        low, over = self.ply.low(poses, fixed), self.strokes.overlong(poses)
        for _ in range(ROUNDS):
            firm = 0 < over < SLIGHT
            settled, believed, depth = self._improve(k, settled, fixed, room, low, firm)
            iterations += settled.iterations
            poses, before = self._poses(settled.q), over
            low, over = self.ply.low(poses, fixed), self.strokes.overlong(poses)
            deep = low[1].min(initial=0.0) < min(-DEPTH, depth - WORTH)
            gains = before <= 0 or over < before - WORTH
            stretched = over > 0 and (gains or (over < SLIGHT and not firm))
            if not (deep or stretched):
                break
        return settled, believed, iterations

    def _improve(
        self,
        k: int,
        settled: Settled,
        fixed: Mask,
        room: tuple[Array, Array],
        low: tuple[NDArray[np.int64], Array],
        firm: bool,
    ) -> tuple[Settled, float, float]:
        """One correction of the strokes.

        Returns:
            The settled result, the error of what was believed of the cups, and how low
            the ply was believed to be, [m].
        """
        stroke = self.columns[~fixed, STROKE]
        response = self.tool.sensitivities(settled, fixed)
        poses = self._poses(settled.q)
        now = settled.q[stroke]
        rows = None
        if low[1].size:
            motion = response.position, response.rotation
            rows = self.ply.slopes(poses, low[0], motion), low[1]
        x = self.strokes.correction(
            poses,
            response,
            self._task(k, fixed),
            now - self.motion.q[k, stroke],
            (room[0] - now, room[1] - now),
            rows,
            firm,
        )
        found, x = self._moved(k, settled, fixed, response, x)
        believed = poses[0] + response.position @ x
        error = np.linalg.norm(self._poses(found.q)[0] - believed, axis=-1)
        depth = (rows[1] + rows[0] @ x).min() if rows else 0.0
        return found, float(error.max()), float(depth)

    def _moved(
        self, k: int, settled: Settled, fixed: Mask, response: Sensitivities, x: Array
    ) -> tuple[Settled, Array]:
        """Rest after a change of strokes, of which less is made where there is none."""
        stroke = self.columns[~fixed, STROKE]
        for share in SHARES:
            q = settled.q + response.q @ (share * x)
            q[stroke] = settled.q[stroke] + share * x
            found = self.tool.settle(q, fixed, settled)
            if found.status == SettledStatus.SETTLED:
                return found, share * x
        return settled, 0.0 * x

    def _rest(self, k: int, starts: list[Array], fixed: Mask) -> Settled:
        """Rest from the first start that has one."""
        for q in starts:
            settled = self.tool.settle(q, fixed, self.settled, leave=False)
            if settled.status == SettledStatus.SETTLED:
                return settled
        raise UnsettledError(self.path, k, settled)

    def _task(self, k: int, fixed: Mask) -> Task:
        path, robot = self.path, self.robot
        landing = np.asarray(path.states[k] == CupState.LANDING)
        if not (landing | fixed).any():  # the start cup is the next to land
            landing = self.start
        size = robot.rows, robot.columns
        return Task(
            (path.positions[k], path.rotations[k]),
            ring_of(*size, fixed, landing),
            outward(*size, fixed),
            self._lean(k),
            robot.half_width,
        )

    def _lean(self, k: int) -> Array:
        """How far cups lean back, less and less over the last of their fall, [rad]."""
        positions, rotations = self.landed
        way = self.path.positions[k] - positions
        fall = np.sum(way * rotations[..., 2], axis=-1)
        return self.toe_up[k] * np.clip(fall / FADE, 0.0, 1.0)

    def _room(self, k: int, fixed: Mask) -> tuple[Array, Array]:
        """Least and largest free strokes: limits, and rates within the wave."""
        robot = self.robot
        stroke = self.columns[~fixed, STROKE]
        lower, upper = robot.lower[stroke], robot.upper[stroke]
        time = duration(self.cell, self.path, k)
        if np.isfinite(time) and self.rows:
            before, reach = self.rows[-1][stroke], robot.velocity[stroke] * time
            lower = np.maximum(lower, before - reach)
            upper = np.minimum(upper, before + reach)
        return lower, upper

    def _poses(self, q: Array) -> tuple[Array, Array]:
        robot = self.robot
        tool = robot.arm_forward(q[robot.arm_columns])
        return cup_poses(robot.geometry, tool, q[self.columns])

    def result(self) -> Settling:
        """All waypoints, with their times."""
        q, path = np.stack(self.rows), self.path
        time = schedule(self.cell, path.phase, path.step, path.tau, q)
        believed, iterations, least = zip(*self.facts, strict=True)
        return Settling(
            replace(self.motion, q=q, time=time),
            np.array(believed),
            np.array(iterations),
            np.array(least),
        )
