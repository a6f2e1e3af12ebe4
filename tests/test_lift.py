import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from drapeplan.lift import Fronts, RectangleLift, WeightedSum
from drapeplan.surfaces import Paraboloid
from tests.tolerances import EXACT, GRADIENT

coordinate = st.floats(-0.5, 0.5)
warps = st.floats(-3.0, 3.0)
STEP = 1e-6  # [m] central differences


def lift(warp=0.0, curvature=0.6, bend=0.12):
    distances = np.array([0.13, 0.24, 0.02, 0.35])
    return RectangleLift(
        Fronts(np.array([0.05, -0.03]), warp, distances), (curvature, curvature), bend
    )


@given(x=coordinate, y=coordinate, warp=warps)
def test_slopes_are_the_derivatives(x, y, warp):
    surface = WeightedSum(((1.0, Paraboloid(1.0, -2.0)), (0.7, lift(warp))))
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
