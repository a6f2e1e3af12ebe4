"""Relaxation of a step that fails: which constraints stay open, and by how much."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import diags, vstack

from drapeplan.elastic import Rows, least_open
from drapeplan.legs import STROKE
from drapeplan.patterns import RowPattern
from drapeplan.robot import face_jacobian
from drapeplan.strokes import (
    ALIGNED,
    LANDED,
    MILLI,
    TILT_LEVER,
    WAITED,
    Step,
    StrokeSolver,
    pose_errors,
)

Array = NDArray[np.float64]

FIBER = 0.4  # [-] price of a fiber against that of an interlink: two run beside each
POSE = 2.0  # [-] price of a pose against that of a length or a limit
TURN = 0.01  # [-] price of the tilt of a cup that waits, which nothing is held to
OPEN = 1e-3  # [mm] excess below which a row holds
SHARE = 0.5  # [-] of what a pose may miss, by component: all three stay within it


class RowKind(StrEnum):
    """What a row of a step constrains."""

    INTERLINK = "interlink"
    FIBER = "fiber"
    LIMIT = "limit"
    RATE = "rate"
    POSITION = "position"
    ANGLE = "angle"


@dataclass(frozen=True)
class OpenRow:
    """A constraint that stays open.

    Attributes:
        kind: What it constrains.
        index: Interlink, fiber, place in q, or cup, by kind.
        excess: By how much, [m] or [rad]; the sign is that of an interlink's error.
        size: The same in [mm], an angle at its lever, to compare rows of all kinds.
    """

    kind: RowKind
    index: int
    excess: float
    size: float


@dataclass(frozen=True)
class Relaxation:
    """Where a step comes nearest to all its constraints.

    Attributes:
        q: Joint positions there, shape (nq,).
        rows: Constraints that stay open, the worst first; none if all can be met.
    """

    q: Array
    rows: tuple[OpenRow, ...]


def relax_step(solver: StrokeSolver, step: Step) -> Relaxation:
    """Relax every constraint of a step: interlinks, fibers, limits, rates and poses.

    Args:
        solver: Gives the constraints.
        step: A step that its QPs could not follow.
    """
    parts = _Parts(solver, step)
    start = step.guess[parts.columns]
    u, rows = least_open(parts.rows, start, lambda rows: not parts.open(rows.excess()))
    q = step.guess.copy()
    q[parts.columns] = u
    return Relaxation(q, parts.open(rows.excess()))


class _Parts:
    """Rows of a step, part by part: interlinks, fibers, joints, positions, angles."""

    def __init__(self, solver: StrokeSolver, step: Step) -> None:
        self.solver, self.step = solver, step
        self.pattern = solver.pattern(step.fixed)
        self.columns = self.pattern.columns
        n = len(self.columns)
        free = np.flatnonzero(self.pattern.free)
        legs = np.arange(n).reshape(-1, 6)
        self.cups, self.lands = free, step.landing[free]
        self.poses = RowPattern(np.repeat(legs, 3, axis=0), n)
        self.scale = np.full((len(free), 6), TILT_LEVER)
        self.scale[:, STROKE] = MILLI
        self.joints = diags(self.scale.ravel(), format="csc")
        lands = np.repeat(self.lands, 3)
        band = MILLI * SHARE * np.where(lands, LANDED, WAITED)
        tilt = TILT_LEVER * SHARE * np.where(lands, ALIGNED, 0.0)
        lengths = int(self.pattern.linked.sum()), int(self.pattern.stretched.sum())
        low, high = (
            x[self.columns] * self.scale.ravel() for x in (step.lower, step.upper)
        )
        longest = np.full(lengths[1], MILLI * solver.longest_fiber)
        none = np.zeros(lengths[0])
        self.lower = np.concatenate([none, 0 * longest - np.inf, low, -band, -tilt])
        self.upper = np.concatenate([none, longest, high, band, tilt])
        sizes = [*lengths, n, len(band), len(tilt)]
        self.price = np.repeat([1.0, FIBER, 1.0, POSE, POSE], sizes)
        self.price[-len(tilt) :] = np.where(lands, POSE, TURN)
        self.ends = np.cumsum(sizes)[:-1]

    def rows(self, u: Array) -> Rows:
        """Values and derivatives at coordinates of the free legs."""
        solver, pattern = self.solver, self.pattern
        q = self.step.guess.copy()
        q[self.columns] = u
        state = solver.robot.kinematics(q)
        poses = state.positions, state.rotations
        position, angle = pose_errors(*poses, self.step.request)
        J = face_jacobian(state)[..., 6:]
        value = [
            MILLI * solver.closures.values(*poses)[pattern.linked],
            MILLI * solver.chords.values(*poses)[pattern.stretched],
            u * self.scale.ravel(),
            -MILLI * position[self.cups].ravel(),
            -TILT_LEVER * angle[self.cups].ravel(),
        ]
        matrix = [
            pattern.closures.fill(
                MILLI * solver.closures.gradients(state)[pattern.linked]
            ),
            pattern.chords.fill(
                MILLI * solver.chords.gradients(state)[pattern.stretched]
            ),
            self.joints,
            self.poses.fill(MILLI * J[self.cups, :3].reshape(-1, 6)),
            self.poses.fill(TILT_LEVER * J[self.cups, 3:].reshape(-1, 6)),
        ]
        stacked = vstack(matrix, format="csc"), self.lower, self.upper, self.price
        return Rows(np.concatenate(value), *stacked)

    def open(self, excess: Array) -> tuple[OpenRow, ...]:
        """Name the rows that stay open, the worst first."""
        closures, chords, joints, positions, angles = np.split(excess, self.ends)
        scale = self.scale.ravel()
        q = self.columns
        robot, step = self.solver.robot, self.step
        by_rate = np.where(
            joints > 0, step.upper[q] < robot.upper[q], step.lower[q] > robot.lower[q]
        )
        kinds = np.where(by_rate, RowKind.RATE, RowKind.LIMIT)
        norms = [np.linalg.norm(x.reshape(-1, 3), axis=1) for x in (positions, angles)]
        linked, stretched = (
            np.flatnonzero(x) for x in (self.pattern.linked, self.pattern.stretched)
        )
        found = [
            *_name(RowKind.INTERLINK, linked, closures, MILLI),
            *_name(RowKind.FIBER, stretched, chords, MILLI),
            *_name(RowKind.POSITION, self.cups, norms[0], MILLI),
            *_name(RowKind.ANGLE, self.cups, norms[1] * self.lands, TILT_LEVER),
        ]
        for kind in (RowKind.LIMIT, RowKind.RATE):
            mine = kinds == kind
            found += _name(kind, q[mine], np.abs(joints[mine]), scale[mine])
        return tuple(sorted(found, key=lambda row: -row.size))


def _name(
    kind: RowKind, index: NDArray[np.int_], excess: Array, scale: Array | float
) -> list[OpenRow]:
    """Open rows among those of one kind, given in [mm]."""
    size = excess / scale
    return [
        OpenRow(kind, int(index[k]), float(size[k]), float(abs(excess[k])))
        for k in np.flatnonzero(np.abs(excess) > OPEN)
    ]
