"""Explanations: which constraint a step breaks, where, by how much, what would help."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drapeplan.relaxation import OpenRow, RowKind
from drapeplan.robot import Robot
from drapeplan.strokes import (
    ALIGNED,
    CHORD,
    CLOSED,
    LANDED,
    LIMIT,
    WAITED,
    StrokeSolution,
)
from urdf.sidecar import neighbor_pairs

Reason = tuple[str, str, str]  # what, by how much, what would help

OUTWARD = "place the cups from the start outward, neighbor by neighbor"
HIGH = 1e-3  # [m] interlinks above this change length with the mold's curvature
UNREACHED = "rigid interlinks cannot reach it"


def explain(
    robot: Robot, solution: StrokeSolution, landing: NDArray[np.bool_]
) -> Reason | None:
    """What a solution breaks worst: what, by how much, what would help.

    Args:
        robot: Arm and tool.
        solution: Result of the stroke QP.
        landing: Cups that must meet their request, shape (n,).

    Returns:
        None if nothing is broken.
    """
    allowed = np.where(landing, LANDED, WAITED)
    turned = np.where(landing, solution.angle_error, 0.0)
    breaks = [
        (RowKind.INTERLINK, solution.closure, CLOSED),
        (RowKind.POSITION, solution.position_error, allowed),
        (RowKind.ANGLE, turned, ALIGNED),
        (RowKind.LIMIT, np.maximum(solution.limit_excess, 0.0), LIMIT),
        (RowKind.FIBER, np.maximum(solution.chord_excess, 0.0), CHORD),
    ]
    shares = [np.abs(excess / limit) for _, excess, limit in breaks]
    worst = max(range(len(breaks)), key=lambda k: float(shares[k].max(initial=0.0)))
    row = int(shares[worst].argmax())
    if shares[worst][row] <= 1:
        return None
    kind, excess, _ = breaks[worst]
    return words(robot, OpenRow(kind, row, float(excess[row]), 0.0))


def explain_rows(robot: Robot, rows: Sequence[OpenRow]) -> Reason:
    """What a relaxed step leaves open worst, and how many rows besides.

    Args:
        robot: Arm and tool.
        rows: Rows that stay open, the worst first.
    """
    what, excess, remedy = words(robot, rows[0])
    more = f", the worst of {len(rows)} that stay open" if len(rows) > 1 else ""
    return what, excess + more, remedy


def words(robot: Robot, row: OpenRow) -> Reason:
    """A row in words.

    Args:
        robot: Arm and tool.
        row: The constraint that is broken, and by how much.
    """
    match row.kind:
        case RowKind.INTERLINK:
            return _interlink(robot, row)
        case RowKind.FIBER:
            pair = neighbor_pairs(robot.rows, robot.columns)[row.index // 2]
            what = f"a fiber between {_pair(robot, pair)} is too short"
            remedy = "raise ply.take_up_mm if the weave allows it, or lift less (path)"
            return what, _millimeters(row), _low(robot) or remedy
        case RowKind.POSITION:
            what = f"{UNREACHED}: {_cup(robot, row.index)} misses its request"
            return what, _millimeters(row), OUTWARD
        case RowKind.ANGLE:
            what = f"{_cup(robot, row.index)} misses the angle of its target"
            degrees = f"{np.degrees(row.excess):.3g} deg"
            remedy = "raise ply.take_up_mm, widen the ball's limit or place the mold"
            return what, degrees, f"{remedy} flatter"
        case _:
            return _joint(robot, row)


def _interlink(robot: Robot, row: OpenRow) -> Reason:
    word = "longer" if row.excess > 0 else "shorter"
    pair = _pair(robot, robot.tool.interlinks.pairs[row.index])
    what = f"{UNREACHED}: the one between {pair}"
    remedy = _low(robot) or OUTWARD
    return f"{what} would have to be {word}", _millimeters(row), remedy


def _low(robot: Robot) -> str:
    """What helps where interlinks lie so high that they shrink or grow on a mold."""
    if abs(robot.tool.interlinks.height) <= HIGH:
        return ""
    return "interlinks nearer the suction face or a flatter mold would help"


def _joint(robot: Robot, row: OpenRow) -> Reason:
    name = robot.model.names[1 + row.index]
    excess = f"{np.degrees(row.excess):.3g} deg"
    remedy = "a longer stroke, a flatter mold or another start would help"
    if name.endswith("stroke"):
        excess = _millimeters(row)
    leg = np.flatnonzero((robot.leg_columns == row.index).any(axis=1))
    joint = f"{_cup(robot, int(leg[0]))}: joint {name}" if leg.size else f"joint {name}"
    if row.kind == RowKind.RATE:
        return f"{joint} passes its speed limit", excess, "raise motion.step_time_s"
    return f"{joint} passes its limit", excess, remedy


def _millimeters(row: OpenRow) -> str:
    return f"{1e3 * abs(row.excess):.3g} mm"


def _cup(robot: Robot, index: int) -> str:
    return f"cup ({index // robot.columns}, {index % robot.columns})"


def _pair(robot: Robot, pair: NDArray[np.int_]) -> str:
    return f"{_cup(robot, int(pair[0]))} and {_cup(robot, int(pair[1]))}"
