"""One spread and one mean: against textbook answers and by counting."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from drapeplan.likelihood import fit, numbers, without

GRID = 0.005  # [-] of a spread: two steps of its grid


def sample(random, n=40, mean=2.0, spread=0.3, noise=0.01):
    values = mean + random.normal(0, spread, n) + random.normal(0, noise, n)
    return numbers(values, np.eye(n), np.full(n, noise), np.ones(n)), values


def test_alike_numbers_have_the_interval_of_student():
    part, values = sample(np.random.default_rng(1))
    found = fit([part])
    low, high = stats.t.interval(0.95, 39, values.mean(), stats.sem(values))
    assert found.mean.value == pytest.approx(values.mean(), abs=1e-9)
    width = high - low
    assert found.mean.low == pytest.approx(low, abs=GRID * width)
    assert found.mean.high == pytest.approx(high, abs=GRID * width)
    assert found.spread.value == pytest.approx(values.std(), rel=GRID)


def test_intervals_cover():
    """Two hundred times a few numbers: between 90 and 99 in a hundred."""
    random = np.random.default_rng(2)
    found = [fit([sample(random, 12)[0]]) for _ in range(200)]
    mean = np.mean([f.mean.low <= 2.0 <= f.mean.high for f in found])
    spread = np.mean([f.spread.low <= 0.3 <= f.spread.high for f in found])
    assert 0.90 <= mean <= 0.99
    assert 0.90 <= spread <= 0.99


def test_correlated_numbers_are_weighed():
    """Sums of neighbors' errors cancel; a chain is known by its ends."""
    n = 30
    steps = np.eye(n, n + 1, 1) - np.eye(n, n + 1)
    errors = np.random.default_rng(3).normal(0, 1e-3, n + 1)
    values = 5e-4 + steps @ errors
    found = fit([numbers(values, steps, np.full(n, 1e-5), np.ones(n))])
    C = steps @ steps.T * found.spread.value**2 + 1e-10 * np.eye(n)
    w = np.linalg.solve(C, np.ones(n))
    assert found.mean.value == pytest.approx(w @ values / w.sum(), abs=1e-9)
    assert found.mean_sigma == pytest.approx(w.sum() ** -0.5, rel=1e-6)
    assert found.mean_sigma < 0.2 * values.std() / np.sqrt(n)


def test_common_causes_are_taken_out():
    random = np.random.default_rng(4)
    causes = random.normal(size=(20, 3))
    own = random.normal(size=20)
    rows, left = without(causes, own + causes @ [5.0, -7.0, 3.0])
    assert_allclose(left, rows @ own, atol=1e-12)
    assert_allclose(rows @ rows.T, np.eye(17), atol=1e-12)


def test_a_spread_below_the_noise_may_be_none():
    n, noise = 30, 0.1
    values = np.random.default_rng(6).normal(0, 0.8 * noise, n)
    found = fit([numbers(values, np.eye(n), np.full(n, noise))])
    assert found.spread.value == found.spread.low == 0.0
    assert 0 < found.spread.high < noise
    assert found.mean is None


def test_no_numbers_say_nothing():
    assert fit([]).spread is None
    assert fit([numbers(np.ones(2), np.zeros((2, 1)), np.ones(2))]).spread is None
