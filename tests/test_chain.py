import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from drapeplan.chain import read_chain
from drapeplan.robot import Robot
from tests.arms import six_axes
from urdf.arm import read_arm
from urdf.generate import tool_sidecar, tool_urdf
from urdf.spec import ToolSpec

SAME = 1e-12  # [m] products of a dozen rotations, in float64
STEP = 1e-6  # [rad] of central differences
SLOPE = 1e-9  # [m/rad] their error: STEP^2 and roundings over STEP
SMALL = ToolSpec(name="small", rows=2, columns=2)
ARMS = {"ur10": read_arm("ur10"), "ur3": read_arm("ur3"), "six": six_axes()}
ANGLES = st.lists(st.floats(-3, 3), min_size=6, max_size=6).map(np.array)


@pytest.fixture(params=ARMS, scope="module")
def urdf(request):
    return ARMS[request.param]


def test_frames_are_those_of_pinocchio(urdf):
    chain = read_chain(urdf)
    robot = Robot(urdf, tool_urdf(SMALL), tool_sidecar(SMALL))
    assert chain.names == robot.arm_names
    q = np.random.default_rng(3).uniform(-2, 2, (5, 6))
    tools = chain.frames(q)[:, -1] @ chain.tip
    assert_allclose(tools, [robot.arm_forward(x) for x in q], atol=SAME)


def test_jacobians_against_central_differences(urdf):
    chain = read_chain(urdf)
    q = np.random.default_rng(4).uniform(-2, 2, 6)
    step = STEP * np.eye(6)
    tools = chain.frames(np.stack([q + step, q - step]))[..., -1, :, :] @ chain.tip
    rate = (tools[0] - tools[1]) / (2 * STEP)
    turn = (chain.frames(q)[-1] @ chain.tip)[:3, :3]
    skew = rate[:, :3, :3] @ turn.T
    spin = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    J = chain.jacobians(chain.frames(q))
    assert_allclose(J, np.concatenate([rate[:, :3, 3], spin], axis=1).T, atol=SLOPE)


@settings(max_examples=50, deadline=None)
@given(q=ANGLES, point=st.tuples(*[st.floats(-0.3, 0.3)] * 3), joint=st.integers(1, 6))
def test_no_point_is_farther_from_an_axis_than_its_reach(q, point, joint):
    chain = read_chain(ARMS["ur10"])
    frames = chain.frames(q)
    world = frames[joint, :3, :3] @ point + frames[joint, :3, 3]
    axes = (frames[1:, :3, :3] @ chain.axes[..., None])[..., 0]
    away = np.linalg.norm(np.cross(axes, world - frames[1:, :3, 3]), axis=1)
    reach = chain.reach(joint, float(np.linalg.norm(point)))
    assert (away[:joint] <= reach[:joint] + SAME).all()
    assert_allclose(reach[joint:], 0)


def test_fixed_links_stand_where_the_urdf_says():
    links = read_chain(ARMS["ur10"]).links
    assert links["ee_link"][0] == 6
    assert_allclose(links["ee_link"][1][:3, 3], [0, 0.0922, 0], atol=SAME)
    assert links["base"][0] == 0  # turned by half a turn
    assert_allclose(links["base"][1][:3, :3], np.diag([-1, -1, 1]), atol=1e-6)
