import numpy as np
import pytest
from numpy.testing import assert_allclose

from drapeplan.legs import leg_coordinates
from drapeplan.path import plan_path
from drapeplan.strokes import StrokeSolver
from tests.plans import scene, stages
from tests.tolerances import CLOSED

LONGEST = 0.0708  # [m] span of 70 mm with 0.8 mm of take-up
FREE = np.zeros(48, bool)
SLOW = 10.0  # [s] long enough for any stroke


def follow(robot, longest, *asked):
    """What the solver makes of a step."""
    solver = StrokeSolver(robot, longest)
    return solver.solve(solver.step(*asked))


@pytest.fixture(scope="module")
def stand():
    """Robot, and a request in the middle of a wave with its exact joints."""
    cell, sequence, targets, wave = stages(scene())
    path = plan_path(cell, targets, wave, sequence.index(sequence.start_cup))
    k = path.phase.index("wave") + 15
    arm = cell.robot.arm_inverse(path.tool[k], np.array(cell.scene.robot.home_rad))
    poses = path.positions[k], path.rotations[k]
    legs = leg_coordinates(cell.robot.geometry, path.tool[k], *poses)
    return cell.robot, cell.robot.configuration(arm, legs), poses


def test_an_exact_request_is_left_as_it_is(stand):
    robot, q, poses = stand
    found = follow(robot, LONGEST, q, None, poses, FREE, ~FREE, SLOW)
    assert found.found
    assert found.programs == 1
    assert_allclose(found.q, q, atol=1e-8)


def test_a_disturbed_guess_comes_back(stand):
    robot, q, poses = stand
    rng = np.random.default_rng(0)
    guess = q.copy()
    guess[robot.leg_columns] += rng.normal(0, 0.01, (48, 6))
    found = follow(robot, LONGEST, guess, None, poses, FREE, ~FREE, SLOW)
    assert found.found
    assert found.programs > 1
    assert np.abs(found.closure).max() < CLOSED
    assert found.position_error.max() < 1e-6
    assert found.angle_error.max() < 1e-5


def test_interlinks_hold_even_if_the_request_breaks_them(stand):
    robot, q, (positions, rotations) = stand
    wanted = positions.copy()
    wanted[10, 2] += 0.01  # one cup 10 mm up: its four links would stretch
    guess = q.copy()
    found = follow(robot, LONGEST, guess, None, (wanted, rotations), FREE, ~FREE, SLOW)
    assert found.found
    assert np.abs(found.closure).max() < CLOSED
    assert found.position_error.max() > 1e-4


def test_strokes_stay_within_their_limits(stand):
    robot, q, (positions, rotations) = stand
    state = robot.kinematics(q)
    down = -state.T_world_tool[:3, 2]
    wanted = positions + 0.2 * down  # 200 mm towards the platform
    tool = state.T_world_tool
    legs = leg_coordinates(robot.geometry, tool, wanted, rotations)
    assert (legs[:, 2] < 0).any()
    guess = robot.configuration(q[robot.arm_columns], legs)
    found = follow(robot, LONGEST, guess, None, (wanted, rotations), FREE, ~FREE, SLOW)
    assert found.limit_excess.max() < 1e-6 or not found.found


def test_rates_are_kept(stand):
    robot, q, (positions, rotations) = stand
    tool = robot.kinematics(q).T_world_tool
    wanted = positions + 0.03 * tool[:3, 2]
    legs = leg_coordinates(robot.geometry, tool, wanted, rotations)
    guess = robot.configuration(q[robot.arm_columns], legs)
    duration = 0.1  # [s] 20 mm at the actuators' 0.2 m/s
    found = follow(robot, LONGEST, guess, q, (wanted, rotations), FREE, ~FREE, duration)
    change = np.abs(found.q - q)[robot.leg_columns]
    assert found.found
    assert change[:, 2].max() == pytest.approx(0.02, abs=1e-5)
    assert np.abs(found.closure).max() < CLOSED


def test_short_fibers_hold_the_cups_back(stand):
    robot, q, poses = stand
    loose = follow(robot, LONGEST, q, None, poses, FREE, ~FREE, SLOW)
    longest = LONGEST + float(loose.chord_excess.max()) - 1e-5  # 0.01 mm too short
    found = follow(robot, longest, q, None, poses, FREE, ~FREE, SLOW)
    assert found.found
    assert found.chord_excess.max() < 1e-9
    assert np.abs(found.closure).max() < CLOSED
    assert found.angle_error.max() > 1e-6  # the cups turn to meet them


def test_placed_cups_do_not_move(stand):
    robot, q, (positions, rotations) = stand
    fixed = np.zeros(48, bool)
    fixed[[14, 15, 20, 21]] = True
    wanted = np.add(positions, (0.0, 0.0, 0.002))
    found = follow(robot, LONGEST, q, None, (wanted, rotations), fixed, ~fixed, SLOW)
    columns = robot.leg_columns[fixed]
    assert np.array_equal(found.q[columns], q[columns])
    assert np.abs(found.closure).max() < CLOSED
