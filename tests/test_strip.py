import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ply import strip
from ply.fiber import powers

HALF = 0.02  # [m] half width of a strip [Nielsen2018, Fig. 4]
ROUNDING = 1e-14  # [-] float64 noise of weights and points near one


def fibers(seed):
    return np.random.default_rng(seed).normal(size=(2, 5, 3))


@settings(deadline=None)
@given(seed=st.integers(0, 10**6), u=st.floats(0, 1), y=st.floats(-0.05, 0.05))
def test_points_follow_equations_24_to_28(seed, u, y):
    a = fibers(seed)
    r1, r2 = powers(u) @ a[0], powers(u) @ a[1]
    b1, b0 = (r2 - r1) / (2 * HALF), (r2 + r1) / 2
    point = strip.weights([u], [y], HALF)[0] @ a.reshape(10, 3)
    assert_allclose(point, b1 * y + b0, rtol=0, atol=20 * ROUNDING)


def test_edges_are_the_fibers():
    u = np.linspace(0, 1, 7)
    a = fibers(1)
    for side, y in enumerate((-HALF, HALF)):
        points = strip.weights(u, np.full(7, y), HALF) @ a.reshape(10, 3)
        assert_allclose(points, powers(u) @ a[side], rtol=0, atol=ROUNDING)


def test_weights_are_constants_of_the_place():
    u, y = np.linspace(0, 1, 5), np.linspace(-0.03, 0.03, 5)
    rows = strip.weights(u, y, HALF)
    assert rows.shape == (5, 10)
    assert_allclose(rows[:, [0, 5]].sum(1), 1, rtol=0, atol=ROUNDING)
    assert_allclose(strip.across(y, HALF) @ [-HALF, HALF], y, rtol=0, atol=ROUNDING)
