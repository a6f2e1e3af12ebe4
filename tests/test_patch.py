import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ply import patch

HALF, LS, LT = 0.02, 0.07, 0.08  # [m] different lengths, so that no mix-up hides
ROUNDING = 1e-13  # [-] float64 noise of weights below ten
UNIT = st.floats(0, 1)


def eight_fibers(seed):
    """Fibers of a patch, shape (8, 5, 3), in the order of patch.weights."""
    return np.random.default_rng(seed).normal(size=(8, 5, 3))


def at(fiber, x, length):
    """A fiber in the paper's form, sum of a_k x^k with x in [m]."""
    return sum(fiber[k] / length**k * x**k for k in range(5))


def along_t(a, s, t):
    """gamma_s of Eq. 31-39 as printed, from the fibers along s, with s and t in [m]."""
    low1, low2, high1, high2 = (at(fiber, s, LS) for fiber in a)
    g0, g1 = low2, high1
    dg0, dg1 = (low2 - low1) / (2 * HALF), (high2 - high1) / (2 * HALF)
    c2 = (3 * (g1 - g0) - LT * (2 * dg0 + dg1)) / LT**2
    c3 = (-2 * (g1 - g0) + LT * (dg0 + dg1)) / LT**3
    return g0 + dg0 * t + c2 * t**2 + c3 * t**3


def along_s(a, s, t):
    """gamma_t, the same along s."""
    low1, low2, high1, high2 = (at(fiber, t, LT) for fiber in a)
    g0, g1 = low2, high1
    dg0, dg1 = (low2 - low1) / (2 * HALF), (high2 - high1) / (2 * HALF)
    c2 = (3 * (g1 - g0) - LS * (2 * dg0 + dg1)) / LS**2
    c3 = (-2 * (g1 - g0) + LS * (dg0 + dg1)) / LS**3
    return g0 + dg0 * s + c2 * s**2 + c3 * s**3


def printed_weights(s, t, a=1e4, k=2, eps=1e-12):
    """w_s and w_t of Eq. 47-50 as printed."""

    def w(x):
        return 0.5 * (np.exp(-a * x**2) + np.exp(-a * (1 - x) ** 2))

    def f(x, length):
        return (x / length) ** k * (1 - x / length) ** k

    ft, fs = f(t, LT), f(s, LS)
    ws = (eps + ft * w(t / LT) + fs * (1 - w(s / LS))) / (eps + ft + fs)
    wt = (eps + ft * (1 - w(t / LT)) + fs * w(s / LS)) / (eps + ft + fs)
    return ws, wt


@settings(deadline=None)
@given(seed=st.integers(0, 10**6), u=UNIT, v=UNIT)
def test_points_follow_the_printed_equations(seed, u, v):
    a = eight_fibers(seed)
    s, t = u * LS, v * LT
    ws, wt = printed_weights(s, t)
    expected = ws * along_t(a[:4], s, t) + wt * along_s(a[4:], s, t)
    point = patch.weights([u], [v], LS, LT, HALF)[0] @ a.reshape(40, 3)
    assert_allclose(point, expected / (ws + wt), rtol=0, atol=100 * ROUNDING)


@settings(deadline=None)
@given(seed=st.integers(0, 10**6), u=UNIT)
def test_constants_of_equation_43_with_the_sign_mended(seed, u):
    """Eq. 41-45 in b0, b1, as printed but for -d b3 in the first bracket of Eq. 43."""
    a = eight_fibers(seed)[:4]
    d, values = HALF, [at(fiber, u * LS, LS) for fiber in a]
    b11, b10 = (values[1] - values[0]) / (2 * d), (values[1] + values[0]) / 2
    b31, b30 = (values[3] - values[2]) / (2 * d), (values[3] + values[2]) / 2
    c = [
        d * b11 + b10,
        b11,
        3 * (-d * b31 + b30 - d * b11 - b10) / LT**2 - (2 * b11 + b31) / LT,
        2 * (d * b31 - b30 + d * b11 + b10) / LT**3 + (b11 + b31) / LT**2,
    ]
    v = np.linspace(0, 1, 5)[:, None]
    expected = sum(c[j] * (v * LT) ** j for j in range(4))
    point = patch.across(v[:, 0], LT, HALF) @ np.array(values)
    assert_allclose(point, expected, rtol=0, atol=100 * ROUNDING)


def test_blend_leaves_each_strip_its_edge():
    x = np.linspace(0.05, 0.95, 19)  # 3.5 mm off the corners: the paper's w has decayed
    for edge in (0.0, 1.0):
        assert_allclose(patch.blend(x, edge), 1, rtol=0, atol=1e-8)
        assert_allclose(patch.blend(edge, x), 0, rtol=0, atol=1e-8)
    corners = patch.blend([0.0, 0.0, 1.0, 1.0], [0.0, 1.0, 0.0, 1.0])
    assert_allclose(corners, 0.5, rtol=0, atol=ROUNDING)


@settings(deadline=None)
@given(u=UNIT, v=UNIT)
def test_blend_treats_both_families_alike(u, v):
    assert patch.blend(u, v) + patch.blend(v, u) == pytest.approx(1, abs=ROUNDING)
    assert patch.blend(1 - u, v) == pytest.approx(patch.blend(u, v), abs=1e-9)


@settings(deadline=None)
@given(u=UNIT, v=UNIT)
def test_weights_are_a_partition_of_unity(u, v):
    rows = patch.weights([u], [v], LS, LT, HALF).reshape(8, 5)
    assert rows[:, 0].sum() == pytest.approx(1, abs=ROUNDING)
