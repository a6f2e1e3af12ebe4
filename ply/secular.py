r"""The secular equation of a fiber: the axial force that gives it its length (D14).

With :math:`x = \lambda_1 + \mu`, the distance of the axial force from buckling,

.. math:: \frac{w_1}{x^2} + \sum_{k > 1} \frac{w_k}{(\lambda_k - \lambda_1 + x)^2}
          = R(x) = R_0 + s x, \qquad w_k = \lambda_k^2 |g_k|^2.

For :math:`x > 0` the left side falls and the right one does not: one root, the curve of
least energy. For :math:`x < 0` there is at most one more stable curve, which bulges to
the other side. Newton's method runs on logarithms, where slopes stay between 1 and 3:
it needs no bracket, and a fixed number of iterations serves every fiber of a batch.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ply.fiber import Array

ITERATIONS = 6  # [-] of each Newton iteration; the tests count the digits
TINY = 1e-60  # [-] stands for a vanishing share: its root is 0 to rounding
FLOOR = 1e-200  # [-] keeps logarithms finite, far below all that TINY leads to
HALVINGS = 20  # [-] iterations for the other side, whose two roots may nearly meet
FAR = 10.0  # [-] longest step of a logarithm towards the other side
FOUND = 1e-9  # [-] error of the logarithm below which a root counts as found


class Secular(NamedTuple):
    """Equations of n fibers, in units of their squared lengths.

    Attributes:
        first: w_1, shape (n,).
        rest: w_k of the further modes, shape (m - 1, n).
        gaps: Loads of the further modes less the first, shape (m - 1, 1).
        room: R_0, shape (n,).
        slope: s, 0 or positive.
    """

    first: Array
    rest: Array
    gaps: Array
    room: Array
    slope: float


def least_energy(equation: Secular) -> tuple[Array, Array]:
    """Root x > 0, and the share of R that the first mode takes there.

    Args:
        equation: The equations.

    Returns:
        Roots x, shape (n,), infinite for a fiber that is taut beyond its modes, and
        w_1 / x^2 free of cancellation, shape (n,): the square of the first mode's
        share, also where w_1 and x vanish and the fiber buckles.
    """
    start, spare = _crossing(equation)
    gaps = equation.gaps + start
    w = np.maximum(equation.first, TINY)
    rate = equation.slope + 2 * (equation.rest / gaps**3).sum(axis=0)
    e = np.minimum(
        np.sqrt(w / np.maximum(spare, TINY)),
        np.minimum(
            np.cbrt(w / np.maximum(rate, TINY)),
            w / np.maximum(rate * start**2, TINY),
        ),
    )
    for _ in range(ITERATIONS):
        p, dp = _room_left(equation, gaps, spare, e)
        error = np.log((start + e) ** 2 * (p / w))
        e = e * np.exp(-error / (2 * e / (start + e) + e * dp / p))
    share, _ = _room_left(equation, gaps, spare, e)
    taut = (equation.room <= 0) & (equation.slope == 0)
    return np.where(taut, np.inf, start + e), np.where(taut, 0.0, share)


def other_side(equation: Secular) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Root x < 0 nearest to 0: the stable curve that bulges to the other side.

    Args:
        equation: The equations.

    Returns:
        Roots x, shape (n,), the share of R that the first mode takes there, shape (n,),
        and whether such a curve exists, shape (n,).
    """
    spare = equation.room - (equation.rest / equation.gaps**2).sum(axis=0)
    exists = spare > 0
    spare = np.where(exists, spare, 1.0)
    w = np.maximum(equation.first, TINY)
    limit = 0.999 * equation.gaps.min(initial=np.inf)
    e, error, steep = np.sqrt(w / spare), np.zeros_like(w), np.ones_like(w)
    for _ in range(HALVINGS):
        e = np.minimum(e, limit)
        p, dp = _room_left(equation, equation.gaps, spare, -e)
        exists &= p > 0
        p = np.where(exists, p, 1.0)
        error, steep = np.log(e**2 * (p / w)), 2 - e * dp / p
        exists &= steep > 0
        step = np.where(exists, -error / np.where(exists, steep, 1.0), 0.0)
        e = e * np.exp(np.clip(step, -FAR, FAR))
    exists &= abs(error) < FOUND
    return -e, np.where(exists, p, 0.0), exists


def _crossing(equation: Secular) -> tuple[Array, Array]:
    """Where R exceeds the further modes, x >= 0, and its excess there.

    The unknown is the logarithm of x + c: c is the least gap, or less where softness
    brings the zero of R nearer than the nearest pole.
    """
    _, rest, gaps, room, slope = equation
    drawn = (rest / gaps**2).sum(axis=0)
    short = (drawn > room) & ((room > 0) | (slope > 0))
    x = np.zeros_like(room)
    spare = np.where(short, 0.0, np.maximum(room - drawn, 0.0))
    if not short.any():
        return x, spare
    rest, room = rest[:, short], room[short]
    nearest = gaps.min(initial=np.inf)
    c = np.minimum(room / slope, nearest) if slope > 0 else np.full_like(room, nearest)
    v = np.where(c > 0, c, 1.0)
    if slope > 0:
        farthest = (rest / (gaps - np.minimum(c, 0)) ** 2).sum(axis=0) / slope
        v = np.where(c > 0, c, np.maximum(farthest, TINY))
    for _ in range(ITERATIONS):
        shares = rest / (gaps + v - c) ** 2
        left, right = shares.sum(axis=0), room - slope * c + slope * v
        steep = 2 * (shares / (gaps + v - c)).sum(axis=0) / left + slope / right
        v = v * np.exp(np.log(left / right) / (v * steep))
    x[short] = np.maximum(v - c, 0.0)
    return x, spare


def _room_left(
    equation: Secular, gaps: Array, spare: Array, e: Array
) -> tuple[Array, Array]:
    """What R leaves to the first mode at a distance e from x = gaps, and its slope."""
    near = gaps + e
    falls = equation.rest / (gaps * near) ** 2
    p = spare + e * (equation.slope + np.add.reduce(falls * (gaps + near)))
    rate = equation.slope + 2 * np.add.reduce(falls * (gaps * gaps / near))
    return np.maximum(p, FLOOR), rate
