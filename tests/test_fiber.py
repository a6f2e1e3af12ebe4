import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import brentq

from ply.fiber import (
    LONGEST,
    FiberStatus,
    LengthStatus,
    arc_length,
    band_length,
    bubble_height,
    cubic_fibers,
    length_error,
    natural_length,
    powers,
    quartic_fibers,
)

L = 0.07  # [m] free length between neighboring cups [Nielsen2018, Section 2]
X, Y, Z = np.eye(3)
ROUNDING = 1e-15  # [m] float64 noise on coordinates below 1 m
SPEED = 2e-9  # [-] mean squared speed: STRAIGHT leaves 1e-9, rounding adds less
ORDER = 0.1  # [-] slope of a log-log fit over two octaves
NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)  # exact for degree 7


def arc_ends(angle):
    """Ends and tangents of a circular arc of length L, shapes (..., 3)."""
    angle = np.asarray(angle)[..., None]
    rise, run = np.sin(angle) * Z, np.cos(angle) * X
    chord = L * np.sin(angle) / angle * X
    return 0 * chord, chord, run + rise, run - rise


def random_ends(seed, count=20, tilt=0.3, play=0.03):
    """Ends and tangents of fibers between disturbed cups, shapes (count, 3)."""
    rng = np.random.default_rng(seed)
    r0 = rng.normal(size=(count, 3))
    r1 = r0 + L * (X + play * rng.normal(size=(count, 3)))
    dr = X + tilt * rng.normal(size=(2, count, 3))
    dr /= np.linalg.norm(dr, axis=-1, keepdims=True)
    return r0, r1, dr[0], dr[1]


def rotation(seed):
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]


def velocity(a, u):
    """dr/du at positions u, shape (..., n, 3)."""
    return (powers(u)[..., :4] * np.arange(1, 5)) @ a[..., 1:, :]


def mean_squared_speed(a, length):
    """Mean of |dr/dx|^2, Eq. 19, by quadrature exact for its degree 6."""
    speed = (velocity(a, (NODES + 1) / 2) ** 2).sum(-1) / np.asarray(length)[
        ..., None
    ] ** 2
    return speed @ WEIGHTS / 2


@settings(deadline=None)
@given(seed=st.integers(0, 10**6))
def test_curves_meet_ends_and_tangents(seed):
    r0, r1, dr0, dr1 = random_ends(seed)
    for a in (
        quartic_fibers(r0, r1, dr0, dr1, L)[0],
        cubic_fibers(r0, r1, dr0, dr1, L),
    ):
        ends = powers([0.0, 1.0]) @ a
        assert_allclose(ends, np.stack([r0, r1], axis=1), rtol=0, atol=8 * ROUNDING)
        slopes = velocity(a, [0.0, 1.0]) / L
        assert_allclose(slopes, np.stack([dr0, dr1], axis=1), rtol=0, atol=1e-12)


@settings(deadline=None)
@given(seed=st.integers(0, 10**6))
def test_mean_squared_speed_is_one_where_the_status_says_so(seed):
    ends = random_ends(seed)
    a, status = quartic_fibers(*ends, L)
    met = status == FiberStatus.MET
    assert_allclose(mean_squared_speed(a[met], L), 1, rtol=0, atol=SPEED)
    assert_array_equal(a[~met], cubic_fibers(*ends, L)[~met])
    assert 0 < met.sum() < met.size  # the sample shows both


@settings(deadline=None)
@given(seed=st.integers(0, 10**6))
def test_length_error_is_the_constant_term_as_printed(seed):
    r0, r1, dr0, dr1 = random_ends(seed)
    a1 = dr0
    a2 = (3 * (r1 - r0) - L * (2 * dr0 + dr1)) / L**2
    a3 = (-2 * (r1 - r0) + L * (dr0 + dr1)) / L**3

    def dots(a, b):
        return (a * b).sum(-1)

    printed = dots(a1, a1) + 4 / 3 * dots(a2, a2) * L**2 + 3 * dots(a2, a3) * L**3
    printed += 9 / 5 * dots(a3, a3) * L**4 + 2 * dots(a1, a2) * L
    printed += 2 * dots(a1, a3) * L**2 - 1
    assert_allclose(length_error(r1 - r0, dr0, dr1, L), printed, rtol=0, atol=1e-13)
    cubic = cubic_fibers(r0, r1, dr0, dr1, L)
    assert_allclose(mean_squared_speed(cubic, L) - 1, printed, rtol=0, atol=1e-13)


@settings(deadline=None)
@given(seed=st.integers(0, 10**6))
def test_bulge_is_the_larger_root_of_the_printed_quadratic(seed):
    """Eq. 20 built by quadrature from Eq. 14, solved by numpy, root by the paper."""
    ends = random_ends(seed, count=6)
    a, status = quartic_fibers(*ends, L)
    cubic = cubic_fibers(*ends, L)
    d = powers([0.5]) @ cubic - (powers([0.0]) + powers([1.0])) @ cubic / 2
    bulge = np.array([0, 0, 1, -2, 1])[:, None] * d
    base = mean_squared_speed(cubic, L) - 1
    both, less = (mean_squared_speed(cubic + k * bulge, L) - 1 for k in (1, -1))
    quadratics = np.stack([(both + less) / 2 - base, (both - less) / 2, base], axis=-1)
    for n, quadratic in enumerate(quadratics):
        roots = np.roots(quadratic)
        if status[n] != FiberStatus.MET:
            assert np.iscomplex(roots).all()
            continue
        expected = cubic[n] + roots.real.max() * bulge[n]
        assert_allclose(a[n], expected, rtol=0, atol=1e-9)


@settings(deadline=None)
@given(seed=st.integers(0, 10**6))
def test_reversed_fiber_is_the_same_curve(seed):
    r0, r1, dr0, dr1 = random_ends(seed)
    a, status = quartic_fibers(r0, r1, dr0, dr1, L)
    b, mirrored = quartic_fibers(r1, r0, -dr1, -dr0, L)
    u = np.linspace(0, 1, 9)
    assert_array_equal(status, mirrored)
    assert_allclose(powers(1 - u) @ b, powers(u) @ a, rtol=0, atol=1e-12)


@settings(deadline=None)
@given(seed=st.integers(0, 10**6))
def test_rigid_motion_moves_the_curve(seed):
    r0, r1, dr0, dr1 = random_ends(seed)
    turn, shift = rotation(seed), np.array([1.0, -2.0, 3.0])
    a, status = quartic_fibers(r0, r1, dr0, dr1, L)
    moved = (r0 @ turn.T + shift, r1 @ turn.T + shift, dr0 @ turn.T, dr1 @ turn.T)
    b, same = quartic_fibers(*moved, L)
    expected = a @ turn.T
    expected[:, 0] += shift
    assert_array_equal(status, same)
    assert_allclose(b, expected, rtol=0, atol=1e-11)


def test_sag_converges_to_the_arc_at_fifth_order():
    angle = np.array([0.4, 0.2, 0.1])
    sag = 0.5 ** np.arange(5) @ quartic_fibers(*arc_ends(angle), L)[0] @ Z
    error = abs(sag - L * (1 - np.cos(angle)) / (2 * angle))
    assert np.polyfit(np.log(angle), np.log(error), 1)[0] == pytest.approx(5, abs=ORDER)


def test_true_length_is_missed_at_fourth_order():
    """Eq. 18 leaves the variance of the speed, which is quadratic in its own error."""
    angle = np.array([0.4, 0.2, 0.1])
    error = abs(arc_length(quartic_fibers(*arc_ends(angle), L)[0]) / L - 1)
    assert np.polyfit(np.log(angle), np.log(error), 1)[0] > 4 - ORDER


@settings(deadline=None)
@given(seed=st.integers(0, 10**6))
def test_natural_length_is_the_root_found_by_brute_force(seed):
    ends = random_ends(seed, count=5)
    natural = natural_length(*ends)
    for n in range(5):
        one = [end[n] for end in ends]
        root = brentq(
            lambda x, one=one: mean_squared_speed(cubic_fibers(*one, x), x) - 1,
            0.3 * L,
            3 * L,
            xtol=1e-15,
        )
        assert natural[n] == pytest.approx(root, abs=1e-13)


@settings(deadline=None)
@given(seed=st.integers(0, 10**6))
def test_at_natural_length_the_quartic_is_the_cubic(seed):
    ends = random_ends(seed)
    natural = natural_length(*ends)
    a, status = quartic_fibers(*ends, natural)
    assert_array_equal(status, FiberStatus.MET)
    assert_array_equal(a, cubic_fibers(*ends, natural))


def too_long_margin(chord, angle):
    """How far c of Eq. 22 is beyond its limit, for symmetric tilts, and gamma."""
    d = L * np.sin(angle) / 4
    dr0 = np.cos(angle) * X + np.sin(angle) * Z
    dr1 = np.cos(angle) * X - np.sin(angle) * Z
    gamma = length_error(chord * X, dr0, dr1, L)
    return gamma - 56 / 15 * d**2 / L**2, gamma


def test_too_long_begins_exactly_where_the_roots_meet():
    angle = np.deg2rad(10)
    chord = brentq(lambda x: too_long_margin(x, angle)[0], 0.068, 0.072, xtol=1e-16)
    _, _, dr0, dr1 = arc_ends(angle)
    scale = np.array([1 - 1e-9, 1 + 1e-9])[:, None]
    a, status = quartic_fibers(np.zeros((2, 3)), scale * chord * X, dr0, dr1, L)
    assert_array_equal(status, [FiberStatus.MET, FiberStatus.TOO_LONG])
    kappa = a[0, 4] @ Z / (L * np.sin(angle) / 4)
    assert kappa == pytest.approx(-14, abs=1e-2)  # where the two roots meet
    assert a[1, 4] @ Z == 0
    gamma = too_long_margin(chord, angle)[1]
    assert gamma == pytest.approx(0.0070, abs=5e-5)
    assert L - chord == pytest.approx(0.11e-3, abs=5e-6)
    assert LONGEST == 14**2


def test_status_of_parallel_cups():
    chord = L * np.array([1 - 1e-8, 1, 1 + 1e-8])[:, None] * X
    _, status = quartic_fibers(0 * chord, chord, X, X, L)
    expected = [FiberStatus.NO_DIRECTION, FiberStatus.MET, FiberStatus.OVERSTRETCHED]
    assert_array_equal(status, expected)
    offset = 0.992 * X + 0.125 * Z  # chord 0.9998 L, its S is longer than L
    assert quartic_fibers(0 * X, L * offset, X, X, L)[1] == FiberStatus.TOO_LONG


def test_slack_that_rests_on_a_hair_of_tilt_is_named():
    r0, r1, dr0, dr1 = arc_ends(1e-5)
    a, status = quartic_fibers(r0, 0.99 * r1, dr0, dr1, L)
    assert status == FiberStatus.WEAK_DIRECTION
    assert mean_squared_speed(a, L) == pytest.approx(1, abs=SPEED)


REACH = 1e6  # [m] coordinates beyond which squares mean nothing for a ply
NUMBERS = st.floats(-REACH, REACH, allow_subnormal=True)
VECTORS = st.tuples(NUMBERS, NUMBERS, NUMBERS).map(np.array)


@settings(max_examples=300, deadline=None)
@given(VECTORS, VECTORS, VECTORS, VECTORS, st.floats(1e-4, 1e3))
def test_no_finite_input_gives_nan(r0, r1, dr0, dr1, length):
    dr0, dr1 = (
        v / np.linalg.norm(v) if np.linalg.norm(v) > 1e-3 else X for v in (dr0, dr1)
    )
    with np.errstate(all="raise", under="ignore"):
        a, _ = quartic_fibers(r0, r1, dr0, dr1, length)
        natural = natural_length(r0, r1, dr0, dr1)
        used, _ = band_length(natural, length, 1e-3)
        surplus = bubble_height(length - natural, length)
        results = [a, natural, used, surplus, arc_length(a)]
    assert all(np.isfinite(result).all() for result in results)
    assert natural >= 0
    assert surplus >= 0


def test_length_band():
    natural = L + np.array([-0.6, -0.5, 0.0, 0.5, 0.6]) * 1e-3
    used, status = band_length(natural, L, 0.5e-3)
    slack, fits, short = (
        LengthStatus.SLACK,
        LengthStatus.IN_BAND,
        LengthStatus.TOO_SHORT,
    )
    assert_array_equal(status, [slack, fits, fits, fits, short])
    assert_allclose(used - L, [-0.5e-3, -0.5e-3, 0, 0.5e-3, 0.5e-3], rtol=0, atol=1e-16)
    rigid, status = band_length(natural, L, 0)
    assert_array_equal(rigid, L)
    assert_array_equal(status, [slack, slack, fits, short, short])


@pytest.mark.parametrize("surplus", [1e-6, 1e-5])
def test_bubble_height_is_that_of_a_clamped_bow(surplus):
    x = np.linspace(0, L, 20001)
    bow = bubble_height(surplus, L) / 2 * (1 - np.cos(2 * np.pi * x / L))
    length = np.hypot(np.diff(x), np.diff(bow)).sum()
    assert length - L == pytest.approx(surplus, rel=surplus / L * 3)
    assert bubble_height(-surplus, L) == 0


def test_arc_length_of_known_curves():
    line = quartic_fibers(0 * X, L * X, X, X, L)[0]
    assert arc_length(line) == pytest.approx(L, abs=ROUNDING)
    a = quartic_fibers(*arc_ends(np.array([0.2, 0.5])), L)[0]
    path = powers(np.linspace(0, 1, 20001)) @ a
    polyline = np.linalg.norm(np.diff(path, axis=1), axis=-1).sum(-1)
    assert_allclose(arc_length(a), polyline, rtol=1e-8)


def test_batch_axes_and_lengths_broadcast():
    ends = [end.reshape(4, 5, 3) for end in random_ends(1)]
    length = L * np.linspace(0.98, 1.02, 5)
    a, status = quartic_fibers(*ends, length)
    assert a.shape == (4, 5, 5, 3)
    assert status.shape == (4, 5)
    one = quartic_fibers(*(end[2, 3] for end in ends), length[3])
    assert_allclose(a[2, 3], one[0], rtol=0, atol=ROUNDING)
    assert status[2, 3] == one[1]
