r"""Ruled strips between the two edge fibers of a span [Nielsen2018, 5.2].

Eq. 24 is linear in the edge fibers, and those are linear in their coefficients, so a
point of a strip is a row of constants times the coefficients of its two fibers. The
sum of Eq. 29 is printed as a difference; Eq. 28 gives the sum used here.
"""

import numpy as np
from numpy.typing import ArrayLike

from ply.fiber import Array, powers


def across(y: ArrayLike, half_width: float) -> Array:
    """Weights of the two edge fibers at a distance from the middle line, Eq. 24-28.

    Args:
        y: Distances across the strip, shape (...), in [m]; beyond the half width the
            strip is extended linearly.
        half_width: Half width of the strip, in [m].

    Returns:
        Weights of the fibers at -half_width and +half_width, shape (..., 2).
    """
    share = np.asarray(y, dtype=float) / (2 * half_width)
    return np.stack([0.5 - share, 0.5 + share], axis=-1)


def weights(u: ArrayLike, y: ArrayLike, half_width: float) -> Array:
    """Rows that take the coefficients of a strip's two fibers to its points.

    Args:
        u: Positions along the strip, shape (n,), from 0 to 1.
        y: Distances across the strip, shape (n,), in [m].
        half_width: Half width of the strip, in [m].

    Returns:
        Rows over (fiber, power of u), shape (n, 2 * 5).
    """
    rows = across(y, half_width)[..., :, None] * powers(u)[..., None, :]
    return rows.reshape(*rows.shape[:-2], 10)
