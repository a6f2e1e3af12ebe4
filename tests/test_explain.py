from functools import cache

import numpy as np
import pytest

from drapeplan.explain import explain, explain_rows
from drapeplan.relaxation import OpenRow, RowKind
from drapeplan.robot import Robot
from drapeplan.strokes import StrokeSolution, StrokeStatus
from urdf import read_tool
from urdf.arm import read_arm


@cache
def array():
    """The arm with the tool of 6 x 8 cups."""
    return Robot(read_arm("ur10"), *read_tool("drape_tool_6x8"))


def solution(**changes):
    """A solution that breaks nothing, but for what is given."""
    robot = array()
    parts = {
        "closure": np.zeros(82),
        "chord_excess": np.full(164, -1e-3),
        "limit_excess": np.full(robot.nq, -0.1),
        "position_error": np.zeros(48),
        "angle_error": np.zeros(48),
    }
    for name, (index, value) in changes.items():
        parts[name][index] = value
    return StrokeSolution(robot.home(), StrokeStatus.FOLLOWED, 1, **parts)


def reason(landing=(), **changes):
    mask = np.zeros(48, bool)
    mask[list(landing)] = True
    return explain(array(), solution(**changes), mask)


def test_nothing_broken_has_no_reason():
    assert reason() is None
    assert reason(landing=[9], position_error=(9, 0.9e-4)) is None
    assert reason(angle_error=(9, 1.0)) is None  # a waiting cup may turn


@pytest.mark.parametrize(
    ("changes", "words", "excess"),
    [
        (
            {"closure": (0, 2e-3)},
            "(0, 0) and cup (0, 1) would have to be longer",
            "2 mm",
        ),
        (
            {"closure": (81, -2e-3)},
            "(6, 5) and cup (7, 5) would have to be short",
            "2 mm",
        ),
        (
            {"chord_excess": (3, 1e-4)},
            "fiber between cup (0, 1) and cup (0, 2)",
            "0.1 mm",
        ),
        ({"position_error": (13, 2e-3)}, "cup (2, 1) misses its request", "2 mm"),
        (
            {"limit_excess": (0, 0.1)},
            "joint shoulder_pan_joint passes its limit",
            "deg",
        ),
    ],
)
def test_what_is_broken_is_named_with_its_size(changes, words, excess):
    what, size, remedy = reason(**changes)
    assert words in what
    assert excess in size
    assert remedy


def test_a_landing_cup_is_named_before_a_waiting_one_that_is_farther_off():
    """0.3 mm is too much for a cup that lands, 0.9 mm is not for one that waits."""
    errors = [9, 30], [0.3e-3, 0.9e-3]
    what, size, _ = reason(landing=[9], position_error=errors)
    assert "cup (1, 3)" in what
    assert size == "0.3 mm"


def test_a_landing_cup_must_meet_its_angle():
    what, size, _ = reason(landing=[9], angle_error=(9, np.radians(0.5)))
    assert "cup (1, 3) misses the angle" in what
    assert size == "0.5 deg"


def test_the_worst_of_several_rows_speaks_for_all():
    robot = array()
    column = int(robot.leg_columns[9, 2])
    rows = [
        OpenRow(RowKind.LIMIT, column, 2e-3, 2.0),
        OpenRow(RowKind.FIBER, 162, 1e-3, 1.0),
    ]
    what, excess, remedy = explain_rows(robot, rows)
    assert what == "cup (1, 3): joint leg_1_3_stroke passes its limit"
    assert excess == "2 mm, the worst of 2 that stay open"
    assert "longer stroke" in remedy
    what, excess, remedy = explain_rows(robot, rows[1:])
    assert what == "a fiber between cup (6, 5) and cup (7, 5) is too short"
    assert excess == "1 mm"
    assert "take_up_mm" in remedy


def test_a_rate_is_named_with_what_gives_time():
    robot = array()
    row = OpenRow(RowKind.RATE, int(robot.leg_columns[47, 0]), np.radians(2), 1.0)
    what, excess, remedy = explain_rows(robot, [row])
    assert what == "cup (7, 5): joint leg_7_5_ux passes its speed limit"
    assert (excess, remedy) == ("2 deg", "raise motion.step_time_s")
