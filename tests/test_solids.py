import coal
import numpy as np
import pytest
from numpy.testing import assert_allclose

from drapeplan.mold import HeightGrid
from drapeplan.solids import (
    FLOOR,
    NoGeometryError,
    arm_solids,
    herd,
    hull,
    link_points,
    mold_prisms,
    table_prism,
    tool_solids,
)
from drapeplan.surfaces import Paraboloid
from tests.arms import six_axes
from urdf.arm import read_arm
from urdf.generate import tool_urdf
from urdf.spec import ToolSpec

TOUCH = 1e-5  # [m] of GJK, which stops at 1e-6
TALL = 1.5e-3  # [m] prisms above the mold at R = 0.5 m: (25 mm)^2 / (2 R), and as much
SMALL = ToolSpec(name="small", rows=2, columns=3)
LEGS = tuple(
    tuple(
        [f"leg_{i}_{j}_{n}" for n in ("ux", "uy", "stroke")]
        + [f"cup_{i}_{j}_{n}" for n in ("sx", "sy", "sz")]
    )
    for i in range(2)
    for j in range(3)
)


def heights_over(tree, points):
    """Signed distances of points from prisms."""
    found = []
    for point in points:
        body = coal.CollisionObject(coal.Sphere(1e-9))
        body.setTranslation(point)
        body.computeAABB()
        callback = coal.DistanceCallBackDefault()
        tree.distance(body, callback)
        found.append(callback.data.result.min_distance)
    return np.array(found)


def test_links_contain_their_meshes():
    chain, solids = arm_solids(read_arm("ur10"))
    assert [s.name for s in solids][:3] == [
        "base_link",
        "shoulder_link",
        "upper_arm_link",
    ]
    parts = dict(link_points(read_arm("ur10")))
    for body in solids:
        joint, T = chain.links[body.name]
        assert joint == body.joint
        points = parts[body.name] @ T[:3, :3].T + T[:3, 3]
        assert np.linalg.norm(points, axis=1).max() == pytest.approx(body.extent)
        line = body.axis[1] - body.axis[0]
        share = np.clip((points - body.axis[0]) @ line / (line @ line), 0, 1)
        near = body.axis[0] + share[:, None] * line
        assert np.linalg.norm(points - near, axis=1).max() <= body.radius + 1e-12


@pytest.mark.parametrize(("radius_x", "radius_y"), [(0.5, 1.0), (-0.5, 0.5)])
def test_prisms_contain_the_mold_and_rise_little_above_it(radius_x, radius_y):
    mold = HeightGrid.from_surface(Paraboloid(radius_x, radius_y), 0.2, 0.15)
    shift = np.eye(4)
    shift[:3, 3] = 0.5, 0.1, 0.3
    tree = herd(mold_prisms(mold, shift))
    rng = np.random.default_rng(5)
    x, y = rng.uniform(-0.2, 0.2, 60), rng.uniform(-0.15, 0.15, 60)
    points = np.stack([x, y, mold.height(x, y)], axis=1) + shift[:3, 3]
    assert (heights_over(tree, points) <= TOUCH).all()
    assert (heights_over(tree, points + np.array([0, 0, TALL])) > 0).all()
    points[:, 2] = FLOOR + 0.01
    assert (heights_over(tree, points) < TOUCH).all()


def test_prisms_leave_out_what_the_mold_does_not_cover():
    whole = HeightGrid.from_surface(Paraboloid(2, 2), 0.2, 0.2)
    x = whole.origin[0] + whole.step[0] * np.arange(whole.heights.shape[0])
    half = whole.covered & (x < 0.01)[:, None]
    mold = HeightGrid(whole.origin, whole.step, whole.heights, half)
    corners = mold_prisms(mold, np.eye(4))
    assert corners[..., 0].max() < 0.02


def test_table_is_solid_down_to_the_floor():
    place = np.eye(4)
    place[:3, 3] = 0, 0.7, 0.2
    tree = herd(table_prism(np.array([0.6, 0.4]), place))
    points = [[0, 0.7, 0.25], [0.35, 0.7, 0.1], [0, 0.7, 0.1], [0, 0.95, 0.1]]
    found = heights_over(tree, np.array(points))
    assert_allclose(found[[0, 1, 3]], 0.05, atol=TOUCH)
    assert found[2] < 0


def test_legs_are_tubes_and_rods():
    platform, legs = tool_solids(tool_urdf(SMALL), LEGS, SMALL.leg_max)
    assert_allclose(np.ptp(platform, axis=0), [*SMALL.platform_size, 0.02])
    assert_allclose(legs.tube, [[0, 0.15]] * 6)
    assert_allclose(legs.rod, [[-0.3, 0]] * 6)
    assert (legs.radius >= 0.012).all()
    assert (legs.radius < 0.0125).all()
    up, down = np.zeros((6, 3)), np.tile([0, 0, -0.2], (6, 1))
    ends = legs.ends(up, down)
    assert_allclose(ends[:, :, 2], [[0.1, -0.2]] * 6)  # the rod stands out above
    assert_allclose(legs.ends(up, down, bare=0.04)[:, 1, 2], -0.16)


def test_missing_geometry_is_told():
    with pytest.raises(NoGeometryError, match="joint a1"):
        arm_solids(six_axes(geometry=False))
    lost = read_arm("ur10").replace("meshes/ur10/collision/forearm", "nowhere/forearm")
    with pytest.raises(NoGeometryError, match="forearm"):
        arm_solids(lost)
    bare = tool_urdf(SMALL).replace("visual>", "hidden>")
    with pytest.raises(NoGeometryError, match="platform"):
        tool_solids(bare, LEGS, SMALL.leg_max)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_flat_links_have_a_hull(count):
    """A sheet, a line and a point would end the process in coal."""
    points = np.array([[0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1.0]])[:count]
    tree = coal.DynamicAABBTreeCollisionManager()
    tree.registerObject(coal.CollisionObject(hull(points)))
    tree.setup()
    away = heights_over(tree, np.array([[0, 0, 1.5]]))
    assert_allclose(away, 0.5, atol=1e-4)
