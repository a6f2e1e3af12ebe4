r"""Patches inside four cups [Nielsen2018, 5.3].

Two cubic blends, one along t between the strips that run along s and one along s
between those that run along t, share the patch by a weight that leaves each strip its
own edge. All of it is linear in the coefficients of the fibers around. In Eq. 43 the
term d b3 needs a minus sign, as Eq. 32 and 38 show.
"""

import numpy as np
from numpy.typing import ArrayLike

from ply import strip
from ply.fiber import Array, powers

SHARPNESS = 1e4  # [-] a of Eq. 49, from Fig. 6 of the paper
ORDER = 2  # [-] k of Eq. 50, for which the paper has no value: measured in D6
TINY = 1e-12  # [-] epsilon of Eq. 47 and 48: defines the four corners


def across(v: ArrayLike, length: float, half_width: float, count: int = 2) -> Array:
    """Weights of the fibers in the cubic from one strip to the next, Eq. 31-39.

    The cubic takes value and slope from Eq. 24 at the facing edges of both strips.

    Args:
        v: Positions across the patch, shape (...), from 0 at the first strip to 1.
        length: Distance that v = 1 stands for, in [m].
        half_width: Half width of the strips, in [m].
        count: Number of fibers of a strip: 2 or 3.

    Returns:
        Weights of the fibers of the first strip, its inner edge last, then those of the
        second, its inner edge first, shape (..., 2 * count).
    """
    v = np.asarray(v, dtype=float)[..., None]
    low, high = strip.slopes(half_width, count) * length
    first = v * (1 - v) ** 2 * high
    second = v**2 * (v - 1) * low
    rise = v**2 * (3 - 2 * v)
    first[..., -1:] += 1 - rise
    second[..., :1] += rise
    return np.concatenate([first, second], axis=-1)


def blend(u: ArrayLike, v: ArrayLike) -> Array:
    """Share of the cubic along t, gamma_s, in Eq. 46.

    Args:
        u: Positions along s, shape (...), from 0 to 1.
        v: Positions along t, shape (...), from 0 to 1.

    Returns:
        Shares w_s / (w_s + w_t), shape (...): 1 on the edges of the strips along s, 0
        on those of the strips along t, 1/2 at the corners and on the diagonals.
    """
    u, v = np.asarray(u, dtype=float), np.asarray(v, dtype=float)
    fs, ft = (u * (1 - u)) ** ORDER, (v * (1 - v)) ** ORDER  # Eq. 50
    ws, wt = _near_edge(u), _near_edge(v)
    along_t = TINY + ft * wt + fs * (1 - ws)  # Eq. 47
    along_s = TINY + ft * (1 - wt) + fs * ws  # Eq. 48
    return along_t / (along_t + along_s)


def weights(
    u: ArrayLike,
    v: ArrayLike,
    s_length: float,
    t_length: float,
    half_width: float,
    count: int = 2,
    terms: int = 5,
) -> Array:
    """Rows that take the coefficients of the fibers around a patch to its points.

    Args:
        u: Positions along s, shape (n,), from 0 to 1.
        v: Positions along t, shape (n,), from 0 to 1.
        s_length: Free fiber length along s, in [m].
        t_length: Free fiber length along t, in [m].
        half_width: Half width of the strips, in [m].
        count: Number of fibers of a strip.
        terms: Number of coefficients of a fiber.

    Returns:
        Rows over (fiber, power), shape (n, 4 * count * terms): the fibers along s of
        the lower row and those of the upper, then those along t of the left column and
        of the right; in each strip the one at -half_width first.
    """
    share = blend(u, v)[..., None, None]
    v_weights = across(v, t_length, half_width, count)
    u_weights = across(u, s_length, half_width, count)
    along_s = v_weights[..., :, None] * powers(u, terms)[..., None, :]
    along_t = u_weights[..., :, None] * powers(v, terms)[..., None, :]
    rows = np.concatenate([share * along_s, (1 - share) * along_t], axis=-2)
    return rows.reshape(*rows.shape[:-2], 4 * count * terms)


def _near_edge(x: Array) -> Array:
    return (np.exp(-SHARPNESS * x**2) + np.exp(-SHARPNESS * (1 - x) ** 2)) / 2  # Eq. 49
