"""Intervals: how well a share is known from a count of samples."""

from __future__ import annotations

from scipy.special import betaincinv

LEVEL = 0.95  # [-] of the two-sided intervals that are printed


def share_interval(
    failures: int, samples: int, level: float = LEVEL
) -> tuple[float, float]:
    r"""Clopper-Pearson interval of a share: never too narrow, whatever the share is.

    Its ends are the shares under which as many failures or more, or as few or fewer,
    have the probability :math:`(1 - level) / 2`: quantiles of beta distributions.

    Args:
        failures: Samples that failed.
        samples: All samples, at least one.
        level: Probability with which the interval covers the share.

    Returns:
        Least and largest share.
    """
    tail = (1 - level) / 2
    low = betaincinv(failures, samples - failures + 1, tail) if failures else 0.0
    left = samples - failures
    high = betaincinv(failures + 1, left, 1 - tail) if left else 1.0
    return float(low), float(high)
