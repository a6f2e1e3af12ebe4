r"""One spread and one mean behind normal numbers: maximum likelihood, with intervals.

Numbers with the covariance :math:`\sigma^2 M + N` and the mean :math:`\mu x` are turned
into independent ones, :math:`z \sim N(\mu x, 1 + \sigma^2 g)`, once; the likelihood
then costs next to nothing, and its profile is an explicit function of both (D24).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

Array = NDArray[np.float64]

LEVEL = 0.95  # [-] of the intervals
STEPS = 4001  # of the spread, 0.4 % each
RANGE = 1e-7, 1.0  # of the spread, in the unit of the numbers; a lower end counts as 0
FAINT = 0.03  # [-] of the largest singular value: causes below change next to nothing
ALIKE = 1e-9  # [-] of the largest: what is smaller is rounding


class Numbers(NamedTuple):
    """Independent normal numbers z with the mean mean * x, the variance 1 + spread^2 g.

    Attributes:
        z: Numbers, shape (n,).
        x: How much of the mean each has, shape (n,).
        g: How much of the squared spread each has, shape (n,).
    """

    z: Array
    x: Array
    g: Array


class Estimate(NamedTuple):
    """An estimate with the ends of its interval."""

    value: float
    low: float
    high: float


class Fit(NamedTuple):
    """What numbers say.

    Attributes:
        spread: Standard deviation, or None where no number has any of it.
        mean: Their mean, or None where no number has any of it.
        mean_sigma: Its standard deviation.
    """

    spread: Estimate | None
    mean: Estimate | None
    mean_sigma: float


def numbers(
    values: Array, gains: Array, noise: Array, x: Array | None = None
) -> Numbers:
    """Numbers with correlated errors, as independent ones.

    Args:
        values: Numbers, shape (n,).
        gains: How they change with errors of the spread looked for, shape (n, m).
        noise: Standard deviations of their own errors, shape (n,), all positive.
        x: How much of the mean each has, shape (n,), or None for nothing.
    """
    x = np.zeros(len(values)) if x is None else x
    A = gains / noise[:, None]
    g, Q = np.linalg.eigh(A @ A.T)
    return Numbers(Q.T @ (values / noise), Q.T @ (x / noise), np.maximum(g, 0.0))


def without(nuisance: Array, values: Array) -> tuple[Array, Array]:
    """What is left of numbers when common causes are taken out.

    Args:
        nuisance: How numbers change with each cause, shape (n, k), in sizes that can be
            compared.
        values: Numbers, shape (n,).

    Returns:
        Orthonormal combinations of the numbers that no cause changes, as rows, shape
        (n - rank, n), and their values.
    """
    U, size, _ = np.linalg.svd(nuisance, full_matrices=True)
    rank = int((size > FAINT * size.max(initial=0.0)).sum())
    rows = U[:, rank:].T
    return rows, rows @ values


def fit(parts: Sequence[Numbers]) -> Fit:
    """Spread and mean of greatest likelihood, with the intervals of its profile.

    The profile is compared with that of normal numbers of unknown variance, which for
    many numbers is the usual one of chi squared.

    Args:
        parts: Numbers that share spread and mean.
    """
    if not parts:
        return Fit(None, None, 0.0)
    z, x, g = (np.concatenate(part) for part in zip(*parts, strict=True))
    informed = int((g > ALIKE * g.max(initial=0.0)).sum())
    if not informed:
        return Fit(None, None, 0.0)
    spread = np.geomspace(*RANGE, STEPS)
    variance = 1 + spread[:, None] ** 2 * g
    precision = (x**2 / variance).sum(axis=1)
    seen = precision.max() > 0
    mean = (x * z / variance).sum(axis=1) / (precision if seen else 1.0)
    misfit = (z - mean[:, None] * x) ** 2 / variance
    loss = (misfit + np.log(variance)).sum(axis=1)
    loss -= loss.min()
    best = int(loss.argmin())
    freedom = max(informed - seen, 1)
    limit = informed * np.log1p(student.ppf((1 + LEVEL) / 2, freedom) ** 2 / freedom)
    likely = loss <= limit
    ends = spread[likely]
    low = 0.0 if likely[0] else float(ends[0])
    value = 0.0 if best == 0 else float(spread[best])
    found = Estimate(value, low, float(ends[-1]))
    if not seen:
        return Fit(found, None, 0.0)
    reach = np.sqrt((limit - loss[likely]) / precision[likely])
    low, high = (mean[likely] - reach).min(), (mean[likely] + reach).max()
    middle = Estimate(float(mean[best]), float(low), float(high))
    return Fit(found, middle, float(precision[best] ** -0.5))
