import subprocess
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from drapeplan.errors import InputError
from drapeplan.legs import FACE, leg_coordinates
from drapeplan.robot import ARM_HOME, ReachError, Robot, arm_description, face_jacobian
from urdf import read_tool
from urdf.generate import tool_sidecar, tool_urdf
from urdf.spec import RIGID, ToolSpec

EXACT = 1e-12  # [m, rad] a few thousand roundings at 1 m
STEP = 1e-6  # [rad, m] of central differences: error about 1e-10, from both sides
DIFFERENCE = 2e-9  # [m/rad, -] of central differences at that step
MEMORY = 400e6  # [byte] of a process that builds and moves the cell; 110 MB measured

SMALL = ToolSpec("small", rows=4, columns=3, ball_height=0.012)
HOME = np.array(ARM_HOME)
seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def robot():
    return Robot(arm_description("ur10"), *read_tool("drape_tool_6x8"))


@pytest.fixture(scope="module")
def small():
    """A tool small enough for Pinocchio's data, which grow as nv^3."""
    return Robot(arm_description("ur10"), tool_urdf(SMALL), tool_sidecar(SMALL))


def random_q(robot, seed):
    return np.random.default_rng(seed).uniform(robot.lower, robot.upper)


def downward(x, y, z):
    """Tool straight down at a point, s along +x."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = FACE, (x, y, z)
    return T


@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_kinematics_agree_with_pinocchio(small, seed):
    """Closed forms of the legs against the joints of the URDF."""
    q = random_q(small, seed)
    state, data = small.kinematics(q), pin.Data(small.model)
    pin.computeJointJacobians(small.model, data, q)
    pin.updateFramePlacements(small.model, data)
    tool0 = data.oMf[small.model.getFrameId("tool0")]
    assert_allclose(state.T_world_tool, tool0.homogeneous, atol=EXACT)
    J = data.J.T.copy()
    assert_allclose(state.arm_twists, J[small.arm_columns], atol=EXACT)
    assert_allclose(state.leg_twists, J[small.leg_columns], atol=EXACT)
    for cup, (row, column) in enumerate(np.ndindex(4, 3)):
        face = data.oMf[small.model.getFrameId(f"cup_{row}_{column}_face")]
        s, t, n = state.rotations[cup].T
        assert_allclose(state.positions[cup], face.translation, atol=EXACT)
        assert_allclose(np.stack([s, -t, -n], axis=1), face.rotation, atol=EXACT)


@settings(max_examples=5, deadline=None)
@given(seed=seeds)
def test_face_jacobian_agrees_with_finite_differences(small, seed):
    q = random_q(small, seed)
    state = small.kinematics(q)
    J = np.zeros((small.n_cups, 6, small.nq))
    columns = small.face_columns()
    np.put_along_axis(J, columns[:, None].repeat(6, axis=1), face_jacobian(state), 2)
    for k, step in enumerate(np.eye(small.nq) * STEP):
        ahead, behind = (small.kinematics(q + d) for d in (step, -step))
        velocity = (ahead.positions - behind.positions) / (2 * STEP)
        spin = (ahead.rotations - behind.rotations) / (2 * STEP)
        assert_allclose(J[:, :3, k], velocity, atol=DIFFERENCE)
        turned = np.cross(J[:, 3:, k][:, :, None], state.rotations, axis=1)
        assert_allclose(turned, spin, atol=DIFFERENCE)


def test_default_cell(robot):
    assert (robot.nq, robot.model.nv, robot.n_cups) == (294, 294, 48)
    assert (robot.rows, robot.columns) == (8, 6)
    assert (robot.pitch, robot.half_width) == (0.110, 0.020)
    assert robot.arm_names[0] == "shoulder_pan_joint"
    assert robot.leg_names[13] == (
        "leg_2_1_ux",
        "leg_2_1_uy",
        "leg_2_1_stroke",
        "cup_2_1_sx",
        "cup_2_1_sy",
        "cup_2_1_sz",
    )
    assert_array_equal(
        np.sort(np.r_[robot.arm_columns, robot.leg_columns.ravel()]), np.arange(294)
    )
    for leg, columns in zip(robot.leg_names, robot.leg_columns, strict=True):
        assert [robot.model.names[1 + int(k)] for k in columns] == list(leg)


def test_limits_come_from_the_urdf(robot):
    legs = robot.leg_columns
    degrees = np.degrees(robot.upper[legs[:, [0, 1, 3, 4, 5]]])
    assert_allclose(degrees, np.tile([15, 15, 40, 40, 15], (48, 1)))
    assert_allclose(robot.upper[legs[:, 2]], np.full(48, 0.300))
    assert_array_equal(robot.lower[legs[:, 2]], np.zeros(48))
    assert_array_equal(robot.velocity[legs[:, 2]], np.full(48, 0.2))


def test_rows_and_columns_beyond_ten_keep_their_order():
    """Pinocchio sorts joints by name, 10 before 2."""
    spec = ToolSpec("long", rows=12, columns=2)
    robot = Robot(arm_description("ur10"), tool_urdf(spec), tool_sidecar(spec))
    assert robot.model.names[1 + int(robot.leg_columns[22, 2])] == "leg_11_0_stroke"
    y = robot.kinematics(robot.home()).positions[::2, 1]
    assert_allclose(np.diff(y), np.full(11, spec.pitch), atol=EXACT)


def test_home_points_straight_down_with_s_along_x(robot):
    state = robot.kinematics(robot.home())
    assert_allclose(state.T_world_tool[:3, :3], FACE, atol=1e-9)
    s, t = (
        state.positions[1] - state.positions[0],
        state.positions[6] - state.positions[0],
    )
    assert_allclose([s, t], [[0.11, 0, 0], [0, 0.11, 0]], atol=1e-9)
    strokes = robot.home()[robot.leg_columns[:, 2]]
    assert_allclose(strokes, np.full(48, 0.150), atol=EXACT)


def test_leg_coordinates_undo_kinematics(robot):
    q = random_q(robot, 4)
    state = robot.kinematics(q)
    legs = leg_coordinates(
        robot.geometry, state.T_world_tool, state.positions, state.rotations
    )
    assert_allclose(robot.configuration(q[robot.arm_columns], legs), q, atol=EXACT)


def test_configurations_come_in_batches(robot):
    legs = np.random.default_rng(5).normal(size=(2, 3, 48, 6))
    q = robot.configuration(HOME, legs)
    assert q.shape == (2, 3, 294)
    assert_array_equal(q[1, 2, robot.leg_columns], legs[1, 2])
    assert_array_equal(q[1, 2, robot.arm_columns], HOME)


def test_states_neither_change_nor_can_be_changed(robot):
    state = robot.kinematics(robot.home())
    before = {key: value.copy() for key, value in vars(state).items()}
    robot.kinematics(random_q(robot, 6))
    for key, value in before.items():
        assert_array_equal(getattr(state, key), value)
        with pytest.raises(ValueError, match="read-only"):
            getattr(state, key)[...] = 0


def test_configurations_of_another_robot_are_refused(robot):
    with pytest.raises(ValueError, match=r"\(294,\)"):
        robot.kinematics(np.zeros(293))


@settings(max_examples=30, deadline=None)
@given(
    x=st.floats(0.6, 0.9),
    y=st.floats(-0.3, 0.3),
    z=st.floats(0.45, 0.75),
    tilt=st.floats(-0.3, 0.3),
    yaw=st.floats(-0.5, 0.5),
)
def test_arm_inverse_meets_the_placement_within_limits(robot, x, y, z, tilt, yaw):
    T = downward(x, y, z)
    spin = pin.rpy.rpyToMatrix(tilt, 0, yaw)
    T[:3, :3] = spin @ T[:3, :3]
    q = robot.arm_inverse(T, HOME)
    assert_allclose(robot.arm_forward(q), T, atol=EXACT)
    arm = robot.arm_columns
    assert ((robot.lower[arm] <= q) & (q <= robot.upper[arm])).all()
    assert np.sign(q[2]) == np.sign(HOME[2])


@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_arm_inverse_finds_what_is_reachable_from_far_away(robot, seed):
    rng = np.random.default_rng(seed)
    goal = rng.uniform(-np.pi, np.pi, 6)
    T = robot.arm_forward(goal)
    q = robot.arm_inverse(T, HOME)
    assert_allclose(robot.arm_forward(q), T, atol=EXACT)


def test_arm_inverse_returns_the_nearby_solution(robot):
    rng = np.random.default_rng(7)
    for _ in range(20):
        q = HOME + rng.uniform(-0.3, 0.3, 6)
        seed = q + rng.uniform(-0.1, 0.1, 6)
        assert_allclose(robot.arm_inverse(robot.arm_forward(q), seed), q, atol=1e-9)


def test_arm_inverse_keeps_the_turns_of_its_seed(robot):
    T, turned = robot.arm_forward(HOME), HOME.copy()
    turned[5] += 2 * np.pi
    assert_allclose(robot.arm_inverse(T, turned), turned, atol=1e-9)


def test_arm_inverse_is_deterministic(robot):
    T = downward(-0.7, 0.2, 0.6)
    assert_array_equal(robot.arm_inverse(T, HOME), robot.arm_inverse(T, HOME))


def test_out_of_reach_says_how_far(robot):
    """A UR10 stretched out reaches 1.3 to 1.5 m."""
    with pytest.raises(ReachError, match="mm") as caught:
        robot.arm_inverse(downward(3.0, 0, 0.5), HOME)
    assert caught.value.exit_code == 1
    assert 1.4 < caught.value.error < 2.0
    assert_array_equal(caught.value.target, [3.0, 0, 0.5])


ARM = arm_description("ur10")
TOOL, SIDECAR = tool_urdf(SMALL), tool_sidecar(SMALL)


@pytest.mark.parametrize(
    ("arm", "problem"),
    [
        ("", "no valid XML"),
        ("<robot name='a'/>", "no valid URDF"),
        (ARM.replace('"tool0"', '"flange"'), "tool0: there is no such link"),
        (ARM.replace('"base_link"', '"foot"'), "base_link: there is no such link"),
        (
            ARM.replace(
                'name="elbow_joint" type="revolute"', 'name="elbow_joint" type="fixed"'
            ),
            "5 joints",
        ),
        (ARM.replace('velocity="3.15"', 'velocity="0"'), "elbow_joint: needs"),
        (ARM.replace('"shoulder_link"', '"drape_base"'), "does not fit the arm"),
    ],
)
def test_arms_that_do_not_fit(arm, problem):
    assert arm != ARM
    with pytest.raises(InputError, match=problem):
        Robot(arm, TOOL, SIDECAR)


def test_a_base_off_the_origin_is_refused():
    raised = '<origin rpy="0.0 0.0 0.0" xyz="0.0 0.0 0.3"/>'
    start = ARM.index('<joint name="world_joint"')
    where = ARM.index("<origin", start)
    moved = ARM[:where] + raised + ARM[ARM.index("/>", where) + 2 :]
    with pytest.raises(InputError, match="not the origin of the world"):
        Robot(moved, TOOL, SIDECAR)


def test_endless_joints_are_given_limits():
    endless = ARM.replace('type="revolute"', 'type="continuous"')
    robot = Robot(endless, TOOL, SIDECAR)
    assert robot.nq == 6 + 72
    assert_allclose(robot.upper[robot.arm_columns], np.full(6, 2 * np.pi))


def test_tool_and_sidecar_of_different_tools_are_refused():
    with pytest.raises(InputError, match=r"^tool URDF"):
        Robot(ARM, TOOL, tool_sidecar(RIGID))
    with pytest.raises(InputError, match=r"^tool URDF"):
        Robot(ARM, tool_urdf(RIGID), SIDECAR)


def test_the_cell_fits_in_memory():
    """Pinocchio's data of the whole cell alone would take 820 MB."""
    status = Path("/proc/self/status")  # rusage would count the parent's peak
    if not status.exists():
        pytest.skip("peak memory is read from /proc")
    code = (
        "from pathlib import Path; from urdf import read_tool;"
        "from drapeplan.robot import Robot, arm_description;"
        "robot = Robot(arm_description('ur10'), *read_tool('drape_tool_6x8'));"
        "robot.kinematics(robot.home());"
        f"print(Path('{status}').read_text().split('VmHWM:')[1].split()[0])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert 1024 * int(run.stdout) < MEMORY
