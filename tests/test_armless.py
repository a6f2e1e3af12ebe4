"""A tool without an arm: its frame goes where the path has it, however far or large."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from numpy.testing import assert_allclose

from drapeplan.arm_words import arm_failures, arm_lines
from drapeplan.check import check_plan
from drapeplan.frames import pose, rpy
from drapeplan.planner import make_plan
from drapeplan.robot import ARM_HOME, Robot, arm_description
from drapeplan.scene import RobotSection
from drapeplan.visuals import arm_visuals
from tests.plans import scene
from tests.settled import tool_section
from urdf.generate import tool_sidecar, tool_urdf
from urdf.spec import ToolSpec

REACHED = 1e-11  # [m] the inverse meets a placement to 1e-12 in the tool's frame
HANGS = 1e-3  # [rad] homes are rounded to 0.01 rad
AWAY = (9.0, -4.0, 0.2)  # [m] of the mold: no arm in the package reaches there


@pytest.fixture(scope="module")
def robot():
    spec = ToolSpec("small", rows=2, columns=2)
    return Robot(arm_description("none"), tool_urdf(spec), tool_sidecar(spec))


def test_homes_hang_the_tool(robot):
    """That of a scene and that of a robot, which are those of a UR10."""
    for home in (RobotSection(name="none").home_rad, ARM_HOME):
        T = robot.arm_forward(np.array(home))
        assert_allclose(T[:3, 2], [0, 0, -1], atol=HANGS)


def test_any_placement_is_reached_and_slides_do_not_turn(robot):
    seed = np.array(RobotSection(name="none").home_rad)
    T = pose(rpy(np.array([np.pi + 0.2, 0.1, 2.0])), (9.0, -4.0, 7.5))
    q = robot.arm_inverse(T, seed)
    assert_allclose(q[:3], T[:3, 3], atol=REACHED)
    assert_allclose(robot.arm_forward(q), T, atol=REACHED)


@pytest.fixture(scope="module")
def plan():
    """Nine rows of seven cups, more than any tool that is shipped."""
    with TemporaryDirectory() as folder:
        read = scene(
            {"kind": "paraboloid", "radius_x_m": 2.0, "radius_y_m": 4.0},
            mold={"position_m": AWAY},
            robot={"name": "none"},
            tool=tool_section(folder, rows=9, columns=7),
            path={"family": "rectangle_blend", "poses_per_step": 3},
            fidelity="kinematic",
        )
        return make_plan(read, Path(folder), "test").plan


def test_large_arrays_plan_where_no_arm_reaches(plan):
    assert plan.verdict["good"]
    assert plan.track.states.shape[1] == 63
    assert check_plan(plan).passed
    landed = plan.track.poses[0][plan.track.placed.all(axis=1)]
    assert np.linalg.norm(landed[0].mean(axis=0) - AWAY) < 0.1


def test_the_verdict_says_that_nothing_was_looked_at(plan):
    arm = plan.verdict["arm"]
    assert not arm["checked"]
    assert "there is none" in arm_lines(arm)[0]
    assert arm_failures(arm, []) == []


def test_there_is_nothing_to_draw(plan):
    drawn = arm_visuals(plan.document["arm"]["urdf"])
    assert drawn.placements(plan.track.arm).shape == (len(plan.track.arm), 0, 4, 4)
