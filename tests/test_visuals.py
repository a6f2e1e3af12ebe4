"""Bodies of the arm: colors, places, and what happens without meshes."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from drapeplan.robot import Robot
from drapeplan.visuals import Body, arm_visuals, installed_folders, merge_vertices
from urdf.arm import read_arm

SAME = 1e-9  # [m] two ways through the same kinematics

PLANAR = """<robot name="two">
<link name="base"><visual>
<origin xyz="0 0 0.1" rpy="1.5707963267948966 0 1.5707963267948966"/>
<geometry><box size="0.1 0.2 0.3"/></geometry></visual></link>
<link name="one"><visual><geometry>{shape}</geometry></visual></link>
<link name="tip"><visual><geometry><sphere radius="0.02"/></geometry></visual></link>
<joint name="a" type="revolute"><parent link="base"/><child link="one"/>
<origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="b" type="fixed"><parent link="one"/><child link="tip"/>
<origin xyz="0.7 0 0"/></joint></robot>"""


@pytest.fixture(scope="module")
def ur10():
    return arm_visuals(read_arm("ur10"))


def test_ur10_has_its_seven_bodies_in_color(ur10):
    assert not ur10.simplified
    assert [body.name for body in ur10.bodies] == [
        "base_link",
        "shoulder_link",
        "upper_arm_link",
        "forearm_link",
        "wrist_1_link",
        "wrist_2_link",
        "wrist_3_link",
    ]
    blue = np.array([100, 138, 163]) / 255
    shoulder = ur10.bodies[1].colors
    assert np.any(np.all(np.abs(shoulder - blue) < 1e-6, axis=1))
    assert len(np.unique(shoulder, axis=0)) > 1


def test_bodies_follow_the_arm(ur10):
    """The last body ends at the flange, wherever the arm is [Pinocchio's robot]."""
    rng = np.random.default_rng(1)
    q = rng.uniform(-1.5, 1.5, (4, 6))
    placed = ur10.placements(q)
    assert placed.shape == (4, 7, 4, 4)
    end = ur10.bodies[-1].vertices
    from urdf import read_tool

    robot = Robot(read_arm("ur10"), *read_tool("drape_tool_6x8"))
    for k in range(4):
        T_base_tool = robot.arm_forward(q[k])
        world = end @ placed[k, -1, :3, :3].T + placed[k, -1, :3, 3]
        seen = (world - T_base_tool[:3, 3]) @ T_base_tool[:3, :3]
        assert np.abs(seen[:, 2].max()) < 2e-3  # flange plane, to the meshes' detail
        assert np.abs(seen[:, :2]).max() < 0.06


@pytest.mark.parametrize(
    "shape",
    ['<mesh filename="package://nowhere/x.dae"/>', '<mesh filename="/etc/hostname"/>'],
)
def test_missing_or_unreadable_meshes_become_rods(shape):
    visuals = arm_visuals(PLANAR.format(shape=shape))
    assert visuals.simplified
    arm = visuals.bodies[visuals.joints.index(1)].vertices
    assert arm[:, 0].max() == pytest.approx(0.7 + 0.045, abs=2e-3)


def test_rods_of_an_arm_reach_from_joint_to_joint():
    visuals = arm_visuals(read_arm("ur10"), package_dirs=[])
    assert visuals.simplified
    assert set(visuals.joints) >= {0, 1, 2, 3, 4, 5}


def test_primitives_are_placed_and_kept_exact():
    shape = '<cylinder radius="0.05" length="0.3"/>'
    visuals = arm_visuals(PLANAR.format(shape=shape), detail=0)
    assert not visuals.simplified
    base, one, tip = visuals.bodies
    assert visuals.joints == [0, 1, 1]
    assert_allclose(np.ptp(base.vertices, axis=0), [0.3, 0.1, 0.2], atol=SAME)
    assert_allclose(tip.vertices.mean(axis=0), [0.7, 0, 0], atol=1e-6)
    assert_allclose(base.vertices[:, 2].min(), 0, atol=SAME)
    assert_allclose(np.ptp(one.vertices[:, 2]), 0.3, atol=SAME)
    placed = visuals.placements(np.array([[np.pi / 2]]))
    assert_allclose(placed[0, 1, :3, 3], [0, 0, 0.5], atol=SAME)
    assert_allclose(placed[0, 1, :3, 0], [0, 1, 0], atol=SAME)


def test_merging_keeps_the_shape_and_the_colors():
    rng = np.random.default_rng(2)
    x, y = np.meshgrid(np.linspace(0, 1, 50), np.linspace(0, 1, 50))
    vertices = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    i = np.arange(2500).reshape(50, 50)
    faces = np.stack([i[:-1, :-1], i[:-1, 1:], i[1:, 1:]], axis=-1).reshape(-1, 3)
    colors = np.eye(3)[rng.integers(0, 2, 50)].repeat(50, axis=0)
    merged = merge_vertices(Body("plate", vertices, faces, colors), 0.1)
    assert len(merged.vertices) < 300
    assert_allclose(np.ptp(merged.vertices, axis=0), [1, 1, 0], atol=0.1)
    assert np.all(np.isin(merged.colors, [0, 1]))
    assert merged.faces.max() < len(merged.vertices)


def test_folder_of_the_meshes_is_found():
    (folder,) = installed_folders()
    assert (folder / "example-robot-data" / "robots" / "ur_description").is_dir()
