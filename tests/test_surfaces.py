import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from drapeplan.surfaces import (
    Cylinder,
    KinDrape,
    Paraboloid,
    Plane,
    Ridge,
    Sphere,
    Step,
    Trimmed,
)

STEP = 1e-6  # [m] of central differences: error about 1e-10 at these curvatures
SLOPE = 1e-8  # [-] central differences: rounding 1e-16 m over STEP, with a margin
EXACT = 1e-12  # [m] float64 noise at a meter

SURFACES = [
    Plane(),
    Paraboloid(1.2, 2.5),
    Paraboloid(-1.5, 1.8),
    Sphere(1.0),
    Sphere(-0.8),
    Cylinder(0.6),
    Cylinder(-0.5),
    Ridge(),
    Step(),
    KinDrape(0.3, 1.0),
    Trimmed(Paraboloid(1.2, 2.5), (0.05, 0.0), (0.3, 0.4), 0.5),
]


def places(n=200, half=0.45):
    """Random places on every mold, x and y of shape (n,), in [m]."""
    return np.random.default_rng(1).uniform(-half, half, (2, n))


@pytest.mark.parametrize("surface", SURFACES, ids=repr)
def test_slopes_are_the_derivatives_of_the_height(surface):
    x, y = places()
    _, zx, zy = surface.evaluate(x, y)
    fx = (surface.height(x + STEP, y) - surface.height(x - STEP, y)) / (2 * STEP)
    fy = (surface.height(x, y + STEP) - surface.height(x, y - STEP)) / (2 * STEP)
    assert_allclose(zx, fx, atol=SLOPE)
    assert_allclose(zy, fy, atol=SLOPE)


@pytest.mark.parametrize("surface", SURFACES, ids=repr)
def test_shapes_follow_the_arguments(surface):
    x, y = places(12)
    for shape in ((), (12,), (3, 4)):
        a, b = np.resize(x, shape), np.resize(y, shape)
        assert all(value.shape == shape for value in surface.evaluate(a, b))
        assert surface.inside(a, b).shape == shape
        assert surface.normal(a, b).shape == surface.point(a, b).shape == (*shape, 3)
    z, zx, _ = surface.evaluate(x[:, None], y[None, :])
    assert z.shape == zx.shape == (12, 12)


@pytest.mark.parametrize("surface", SURFACES, ids=repr)
def test_normals_are_unit_upward_and_across_the_tangents(surface):
    x, y = places()
    n = surface.normal(x, y)
    _, zx, zy = surface.evaluate(x, y)
    assert_allclose(np.linalg.norm(n, axis=-1), 1)
    assert (n[:, 2] > 0).all()
    assert_allclose(n[:, 0] + zx * n[:, 2], 0, atol=EXACT)
    assert_allclose(n[:, 1] + zy * n[:, 2], 0, atol=EXACT)


@given(radius=st.floats(0.3, 5), sign=st.sampled_from([-1, 1]))
def test_a_sphere_keeps_its_radius_and_its_side(radius, sign):
    x, y = places(half=0.2)
    center = np.array([0, 0, -sign * radius])
    p = Sphere(sign * radius).point(x, y)
    assert_allclose(np.linalg.norm(p - center, axis=-1), radius, rtol=1e-12)
    n = Sphere(sign * radius).normal(x, y)
    assert_allclose(n, sign * (p - center) / radius, atol=1e-12)


@given(radius=st.floats(0.3, 5), sign=st.sampled_from([-1, 1]))
def test_a_cylinder_keeps_its_radius(radius, sign):
    x, y = places(half=0.2)
    p = Cylinder(sign * radius).point(x, y)
    assert_allclose(np.hypot(p[:, 0], p[:, 2] + sign * radius), radius, rtol=1e-12)


def test_radii_of_a_paraboloid_are_those_of_its_apex():
    near = 1e-3  # [m] the fourth-order difference to the circle is 1e-13 m there
    for radius in (1.2, -0.7):
        circle = np.sign(radius) * (np.sqrt(radius**2 - near**2) - abs(radius))
        assert_allclose(Paraboloid(radius, 2.0).height(near, 0), circle, atol=EXACT)
        assert_allclose(Paraboloid(2.0, radius).height(0, near), circle, atol=EXACT)


def test_features_stand_where_they_should():
    assert_allclose(Ridge(0.015, 0.1, 0.11).height(0.11, 0.3), 0.015)
    assert_allclose(Ridge(0.015, 0.1, 0.11).height(0.21, 0), 0.015 * np.exp(-0.5))
    assert_allclose(Step(0.03, 0.04, 0.11).height([-9.0, 0.11, 9], 0), [0, 0.015, 0.03])


def test_kindrape_is_the_published_polynomial():
    x, y = np.array([0.1, 0.4]), np.array([0.3, 0.05])
    z = 1.004 * x + 1.089 * y - 3.667 * x**2 - 4.4 * x * y - 3.75 * y**2
    z = z + 3.086 * x**3 + 8.889 * x**2 * y + 4.321 * y**3
    published = KinDrape()
    difference = published.height(x - 0.25, y - 0.25)
    assert_allclose(np.diff(difference), np.diff(z), atol=EXACT)
    assert_allclose(published.height(0, 0), 0, atol=EXACT)
    larger = KinDrape(0.3, 1.0)  # twice the size at 0.3 of the slopes
    doubled = 2 * (x - 0.25), 2 * (y - 0.25)
    assert_allclose(larger.height(*doubled), 0.6 * difference, atol=EXACT)
    assert larger.extent == (0.5, 0.5)


@pytest.mark.parametrize(
    "surface", [Sphere(0.5), Sphere(-0.5), Cylinder(0.5)], ids=repr
)
def test_round_surfaces_go_on_smoothly_beyond_their_rim(surface):
    rim = surface.extent[0]
    x = np.array([0.0, 0.9, 1 - 1e-9, 1 + 1e-9, 1.5, 100]) * rim
    z, zx, zy = surface.evaluate(x, 0 * x)
    assert np.isfinite([z, zx, zy]).all()
    assert surface.inside(x, 0 * x).tolist() == [True, True, True, False, False, False]
    assert_allclose(z[3], z[2], atol=1e-7)  # [m] slope 22 over 1e-9 m
    assert_allclose(zx[3], zx[2], rtol=1e-5)
    assert_allclose((z[5] - z[4]) / (x[5] - x[4]), zx[4], rtol=1e-12)


def test_the_corner_of_a_spheres_extent_is_off_it():
    sphere = Sphere(0.5)
    assert not sphere.inside(*sphere.extent)


def test_gap_is_zero_on_the_surface_and_positive_above():
    x, y = places()
    surface = Sphere(1.0)
    p, n = surface.point(x, y), surface.normal(x, y)
    assert_allclose(surface.gap(p), 0, atol=EXACT)
    for h in (2e-3, -2e-3):
        assert_allclose(surface.gap(p + h * n), h, atol=8e-6)  # [m] about h^2 / R


@given(angle=st.floats(-3, 3), x=st.floats(-0.6, 0.6), y=st.floats(-0.6, 0.6))
def test_trimming_cuts_a_turned_rectangle(angle, x, y):
    cut = Trimmed(Plane(), (0.1, -0.05), (0.3, 0.4), angle)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    along, across = turn @ [x - 0.1, y + 0.05]
    assert cut.inside(x, y) == (abs(along) <= 0.3 and abs(across) <= 0.4)
    half_x, half_y = cut.extent
    if cut.inside(x, y):
        assert abs(x) <= half_x
        assert abs(y) <= half_y


def test_trimming_keeps_what_is_off_the_surface_off():
    cut = Trimmed(Sphere(0.2), (0.0, 0.0), (0.3, 0.4))
    assert cut.inside(0.1, 0.1)
    assert not cut.inside(0.25, 0.0)
