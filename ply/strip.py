r"""Strips between the fibers of a span [Nielsen2018, 5.2].

Eq. 24 is linear in the edge fibers, and those are linear in their coefficients, so a
point of a strip is a row of constants times the coefficients of its fibers. The
sum of Eq. 29 is printed as a difference; Eq. 28 gives the sum used here.
"""

import numpy as np
from numpy.typing import ArrayLike

from ply.fiber import Array, powers


def across(y: ArrayLike, half_width: float, count: int = 2) -> Array:
    """Weights of the fibers of a strip at a distance from its middle line, Eq. 24-28.

    Two fibers on the edges rule the strip, as in the paper. A third one along the
    middle makes each cross-section a parabola, which a twisted strip asks for.

    Args:
        y: Distances across the strip, shape (...), in [m]; beyond the half width the
            strip is extended along its tangent.
        half_width: Half width of the strip, in [m].
        count: Number of fibers, evenly from -half_width to +half_width: 2 or 3.

    Returns:
        Weights of the fibers, -half_width first, shape (..., count).
    """
    y = np.asarray(y, dtype=float) / half_width
    if count == 2:
        return np.stack([(1 - y) / 2, (1 + y) / 2], axis=-1)
    inside = np.clip(y, -1, 1)[..., None]
    beyond = y[..., None] - inside
    parabolas = np.array([[0.0, -0.5, 0.5], [1.0, 0.0, -1.0], [0.0, 0.5, 0.5]])
    rates = parabolas[:, 1:] * [1, 2]
    return powers(inside[..., 0], 3) @ parabolas.T + beyond * (
        powers(inside[..., 0], 2) @ rates.T
    )


def slopes(half_width: float, count: int = 2) -> Array:
    """Weights whose sums are the strip's slopes across, on both its edges.

    Args:
        half_width: Half width of the strip, in [m].
        count: Number of fibers: 2 or 3.

    Returns:
        Weights of the fibers at -half_width and at +half_width, shape (2, count), in
        [1/m].
    """
    edges = {
        2: [[-0.5, 0.5], [-0.5, 0.5]],
        3: [[-1.5, 2.0, -0.5], [0.5, -2.0, 1.5]],
    }
    return np.array(edges[count]) / half_width


def weights(
    u: ArrayLike, y: ArrayLike, half_width: float, count: int = 2, terms: int = 5
) -> Array:
    """Rows that take the coefficients of a strip's fibers to its points.

    Args:
        u: Positions along the strip, shape (n,), from 0 to 1.
        y: Distances across the strip, shape (n,), in [m].
        half_width: Half width of the strip, in [m].
        count: Number of fibers.
        terms: Number of coefficients of a fiber.

    Returns:
        Rows over (fiber, power of u), shape (n, count * terms).
    """
    lateral = across(y, half_width, count)
    rows = lateral[..., :, None] * powers(u, terms)[..., None, :]
    return rows.reshape(*rows.shape[:-2], count * terms)
