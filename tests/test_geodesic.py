import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from drapeplan.errors import InfeasibleError
from drapeplan.geodesic import geodesic_net, strip_net
from drapeplan.mold import HeightGrid
from drapeplan.shear import cell_shear
from drapeplan.surfaces import Cylinder, KinDrape, Paraboloid, Plane, Sphere

LINK = 1e-12  # [m] float64 noise at a meter
ANGLE = 1e-9  # [rad] noise of a link over its length, with a margin

radii = st.floats(0.6, 5) | st.floats(-5, -0.6)


def link_lengths(net):
    """Lengths of all links, in [m]."""
    s, t = np.diff(net, axis=1).reshape(-1, 3), np.diff(net, axis=0).reshape(-1, 3)
    return np.linalg.norm(np.concatenate([s, t]), axis=1)


@pytest.mark.parametrize("grow", [geodesic_net, strip_net])
@given(radius_x=radii, radius_y=radii, heading=st.floats(-3, 3))
@settings(max_examples=20, deadline=None)
def test_links_are_exact_and_nodes_on_the_surface(grow, radius_x, radius_y, heading):
    surface = Paraboloid(radius_x, radius_y)
    net = grow(surface, 6, 5, 0.11, (2, 3), (0.05, -0.02), heading)
    assert_allclose(link_lengths(net), 0.11, atol=LINK)
    assert_allclose(net[..., 2], surface.height(net[..., 0], net[..., 1]), atol=LINK)
    assert_allclose(net[2, 3, :2], (0.05, -0.02))


@pytest.mark.parametrize("grow", [geodesic_net, strip_net])
@pytest.mark.parametrize("heading", [0.0, 0.4, -2.0])
def test_a_flat_net_is_a_turned_square_grid(grow, heading):
    net = grow(Plane(), 4, 5, 0.1, (1, 2), (0.3, 0.1), heading)
    i, j = np.indices((4, 5)) - np.array([1, 2])[:, None, None]
    x, y = 0.1 * j, 0.1 * i
    turned = x * np.cos(heading) - y * np.sin(heading) + 0.3
    assert_allclose(net[..., 0], turned, atol=LINK)
    turned = x * np.sin(heading) + y * np.cos(heading) + 0.1
    assert_allclose(net[..., 1], turned, atol=LINK)


@given(heading=st.floats(-3, 3))
@settings(max_examples=20, deadline=None)
def test_a_cylinder_unrolls_without_shear(heading):
    """Chords bend the net by (pitch / R)^2, so a fine one is needed."""
    net = geodesic_net(Cylinder(0.5), 30, 30, 0.01, (15, 15), (0.0, 0.0), heading)
    assert abs(cell_shear(net)).max() < 2e-4  # [rad] (0.01 / 0.5)^2 / 2


def test_arms_are_great_circles():
    net = geodesic_net(Sphere(1.0), 9, 9, 0.05, (4, 4), (0.2, -0.1), 0.3)
    center = np.array([0, 0, -1])
    for arm in (net[4], net[:, 4]):
        spread = np.linalg.svd(arm - center)[1]
        assert spread[2] < 1e-12  # [m] all in one plane through the center
    s, t = net[4, 5] - net[4, 3], net[5, 4] - net[3, 4]
    assert abs(s @ t) < 1e-12
    assert_allclose(np.arctan2(s[1], s[0]), 0.3, atol=ANGLE)


def test_the_origin_may_be_any_node():
    """The same four nodes grow from a corner of a net as from its middle."""
    surface = KinDrape(0.3, 1.0)
    whole = geodesic_net(surface, 5, 5, 0.08, (2, 2), (0.0, 0.0))
    assert_allclose(
        geodesic_net(surface, 3, 3, 0.08, (0, 0), (0.0, 0.0)), whole[2:, 2:], atol=LINK
    )
    assert_allclose(
        geodesic_net(surface, 3, 3, 0.08, (2, 2), (0.0, 0.0)), whole[:3, :3], atol=LINK
    )


def test_generator_strips_have_no_shear_in_the_mean():
    net = strip_net(KinDrape(), 8, 9, 0.03, (3, 4), (0.01, 0.02), 0.2)
    shear = cell_shear(net)
    assert_allclose(shear[3, :], 0, atol=ANGLE)
    assert_allclose(shear[:, 4], 0, atol=ANGLE)
    assert abs(shear).max() > 0.02
    first = net[4, 4] - net[3, 4]
    assert_allclose(np.arctan2(-first[0], first[1]), 0.2, atol=ANGLE)


def test_grids_and_surfaces_grow_the_same_net():
    surface = Paraboloid(1.2, 2.5)
    grid = HeightGrid.from_surface(surface, 0.4, 0.5)
    nets = [geodesic_net(s, 8, 6, 0.11, (4, 3), (0.05, 0.05)) for s in (surface, grid)]
    assert_allclose(*nets, atol=1e-7)  # [m] grid heights are 1e-9 m off


@pytest.mark.parametrize("grow", [geodesic_net, strip_net])
def test_what_does_not_exist_is_named(grow):
    with pytest.raises(InfeasibleError, match=r"net node \(\d, \d\)"):
        grow(Sphere(0.2), 8, 6, 0.11, (4, 3), (0.0, 0.0))
    with pytest.raises(InfeasibleError, match="off the mold"):
        grow(KinDrape(0.3, 0.3), 8, 6, 0.11, (4, 3), (0.0, 0.0))


def test_two_neighbors_too_far_apart_have_no_common_node():
    """On a needle the arms fold down its sides."""
    with pytest.raises(InfeasibleError) as failure:
        geodesic_net(Sphere(0.06), 5, 5, 0.11, (2, 2), (0.0, 0.0))
    assert failure.value.exit_code == 1
    assert failure.value.remedy
