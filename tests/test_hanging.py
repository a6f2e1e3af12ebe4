"""Where cups hang before the first one stands, and the tool over them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from drapeplan.equilibrium import Equilibrium
from drapeplan.hanging import rides_level, shifted, tool_physics
from drapeplan.legs import cup_poses, leg_coordinates
from drapeplan.path import CupState
from tests.settled import small

OVER = 0.02e-3  # [m] start cup beside its target once the tool is shifted


def beside(made, path):
    """Start cup beside its request right before it stands, along the mold, [m]."""
    robot = made.cell.robot
    placed = path.states == CupState.PLACED
    k = int(placed.any(axis=1).argmax()) - 1
    start = int(placed[k + 1].argmax())
    arm = robot.arm_inverse(path.tool[k], np.array(made.cell.scene.robot.home_rad))
    legs = leg_coordinates(
        robot.geometry, path.tool[k], path.positions[k], path.rotations[k]
    )
    tool = Equilibrium(robot, tool_physics(made.cell))
    rest = tool.settle(robot.configuration(arm, legs), placed[k])
    hangs = cup_poses(robot.geometry, path.tool[k], rest.q[robot.leg_columns])[0]
    off, n = (hangs - path.positions[k])[start], path.rotations[k, start, :, 2]
    return np.linalg.norm(off - n * (n @ off))


@pytest.mark.parametrize("name", ["dome", "saddle"])
def test_the_start_cup_hangs_over_its_target(name):
    made = small(name)
    path, shift = made.request.path, made.request.shift
    assert beside(made, path) < OVER
    assert beside(made, shifted(path, -shift)) > 3 * OVER


def test_the_tool_is_shifted_from_the_approach_on():
    path = small("dome").request.path
    first = path.phase.index("approach")
    moved = shifted(path, np.array([1e-3, 2e-3, 3e-3]))
    assert_array_equal(moved.tool[:first], path.tool[:first])
    way = moved.tool[first:, :3, 3] - path.tool[first:, :3, 3]
    assert_allclose(way, np.tile([1e-3, 2e-3, 3e-3], (len(way), 1)), atol=1e-15)
    assert_array_equal(moved.positions, path.positions)


def test_what_rides_on_a_level_tool():
    """Legs, standing cups and the vertical each end the ride; turning does not."""
    tool = np.tile(np.eye(4), (6, 1, 1))
    legs, fixed = np.zeros((6, 4, 6)), np.zeros((6, 4), bool)
    tool[1, :2, :2] = [[0.0, -1.0], [1.0, 0.0]]  # turned about the vertical
    tool[1, :3, 3] = 0.5
    legs[2:, 1, 3] = 1e-6
    fixed[3:, 2] = True
    tool[4:, 1:3, 1:3] = [[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]]
    expected = [False, True, False, False, False, True]
    assert_array_equal(rides_level(tool, legs, fixed), expected)
