"""Intervals of a share, against scipy and by counting what they cover."""

import numpy as np
import pytest
from scipy.stats import binom, binomtest

from drapeplan.intervals import LEVEL, share_interval

SAME = 1e-12  # [-] of two ways to the same quantile


@pytest.mark.parametrize(
    ("failures", "samples"), [(0, 1), (1, 1), (0, 64), (3, 64), (64, 64), (11, 200)]
)
def test_it_is_the_exact_interval_of_scipy(failures, samples):
    found = binomtest(failures, samples).proportion_ci(LEVEL, method="exact")
    expected = found.low, found.high
    assert share_interval(failures, samples) == pytest.approx(expected, abs=SAME)


@pytest.mark.parametrize("share", [0.001, 0.03, 0.1, 0.5, 0.97])
def test_it_covers_the_share_often_enough(share):
    samples = 40
    ends = np.array([share_interval(k, samples) for k in range(samples + 1)])
    inside = (ends[:, 0] <= share) & (share <= ends[:, 1])
    chances = binom.pmf(np.arange(samples + 1), samples, share)
    assert chances[inside].sum() >= LEVEL


def test_a_wider_level_gives_a_wider_interval():
    narrow, wide = share_interval(4, 50, 0.8), share_interval(4, 50, 0.99)
    assert wide[0] < narrow[0] < 4 / 50 < narrow[1] < wide[1]
