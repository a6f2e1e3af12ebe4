import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from drapeplan.lift import Fronts, RadialLift, RectangleLift, WeightedSum
from drapeplan.surfaces import Paraboloid
from tests.tolerances import EXACT, GRADIENT

coordinate = st.floats(-0.5, 0.5)
warps = st.floats(-3.0, 3.0)
CENTER = np.array([0.05, -0.03])  # [m] start cup
STEP = 1e-6  # [m] central differences


def lift(warp=0.0, curvature=0.6, bend=0.12):
    distances = np.array([0.13, 0.24, 0.02, 0.35])
    return RectangleLift(Fronts(CENTER, warp, distances), (curvature, curvature), bend)


def radial():
    return RadialLift(CENTER, 0.13, 0.6, 0.12)


@given(x=coordinate, y=coordinate, moving=st.one_of(warps.map(lift), st.just(radial())))
def test_slopes_are_the_derivatives(x, y, moving):
    surface = WeightedSum(((1.0, Paraboloid(1.0, -2.0)), (0.7, moving)))
    _, zx, zy = surface.evaluate(x, y)
    dx = surface.height(x + STEP, y) - surface.height(x - STEP, y)
    dy = surface.height(x, y + STEP) - surface.height(x, y - STEP)
    assert_allclose([zx, zy], [dx / (2 * STEP), dy / (2 * STEP)], atol=2 * GRADIENT)


@given(s=st.floats(-0.13, 0.24), t=st.floats(-0.02, 0.35), warp=warps)
def test_the_rectangle_itself_is_not_lifted(s, t, warp):
    cos, sin = np.cos(warp), np.sin(warp)
    z = lift(warp).height(0.05 + cos * s - sin * t, -0.03 + sin * s + cos * t)
    assert_allclose(z, 0, atol=EXACT)


@given(x=coordinate, y=coordinate, warp=warps)
def test_warp_turns_the_lift(x, y, warp):
    cos, sin = np.cos(warp), np.sin(warp)
    turned = lift(warp).height(0.05 + cos * x - sin * y, -0.03 + sin * x + cos * y)
    assert_allclose(turned, lift().height(0.05 + x, -0.03 + y), atol=EXACT)


def test_quadratic_in_the_bend_and_straight_after():
    surface = lift()
    d = np.array([0.01, 0.05, 0.12, 0.2, 0.3])
    z = surface.height(0.05 + 0.24 + d, np.full(5, -0.03))
    expected = np.where(d < 0.12, 0.6 * d**2, 0.6 * 0.12 * (2 * d - 0.12))
    assert_allclose(z, expected, atol=EXACT)


def test_each_side_has_its_own_lift():
    surface = RectangleLift(Fronts(CENTER, 0.0, np.full(4, 0.1)), (0.5, 2.0), 0.12)
    heights = surface.height(*(CENTER + 0.15 * np.eye(2)).T)
    assert_allclose(heights, [0.5 * 0.05**2, 2.0 * 0.05**2], atol=EXACT)


@given(angle=warps, d=st.floats(0.001, 0.3))
def test_radial_lift_depends_on_the_distance_alone(angle, d):
    way = np.array([np.cos(angle), np.sin(angle)])
    expected = 0.6 * d**2 if d < 0.12 else 0.6 * 0.12 * (2 * d - 0.12)
    assert_allclose(radial().height(*(CENTER + (0.13 + d) * way)), expected, atol=EXACT)
    assert radial().height(*(CENTER + 0.129 * way)) == 0
