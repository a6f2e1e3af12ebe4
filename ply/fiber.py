r"""Curves of single fibers that hang free between two cups [Nielsen2018, 5.1].

A fiber is a polynomial in :math:`u = x / L`, given by the coefficients of
:math:`u^0, \dots, u^4`. What goes beyond the paper is derived in docs/derivations.md.
"""

from enum import IntEnum

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Statuses = NDArray[np.int64]

BULGE = np.array([0.0, 0.0, 1.0, -2.0, 1.0])  # u^2 (1 - u)^2 in powers of u
STRAIGHT = 1e-9  # [-] length error left as it is: float64 noise at ply scale
PARALLEL = 1e-14  # [-] |d| / L that is rounding: the bulge has no direction
WEAK = 1e-4  # [-] |d| / L below which the bulge's direction rests on 0.05 deg of tilt
LONGEST = 196.0  # [-] c of Eq. 22 where its two roots meet, D1
NODES, WEIGHTS = legendre.leggauss(12)  # arc length to 1e-12 at 30 deg
TO_LEGENDRE = legendre.legvander(NODES, 11).T * WEIGHTS * (np.arange(12) + 0.5)[:, None]
INTEGRALS = legendre.legint(np.eye(12), lbnd=-1)  # of Legendre series, from -1
EVENING = 5  # [-] Newton iterations that make the speed even
SLOW = 0.1  # [-] speed over its mean, below which Newton's steps are held back


class FiberStatus(IntEnum):
    """What became of the length condition, Eq. 19, of one fiber."""

    MET = 0
    TOO_LONG = 1  # the curve cannot be shortened: no real root of Eq. 22
    NO_DIRECTION = 2  # slack between parallel cups: d vanishes, the bulge has no side
    OVERSTRETCHED = 3  # the chord is longer than the fiber: no curve exists
    WEAK_DIRECTION = 4  # met, but nearly parallel cups decide the side of the bulge
    NOT_ASKED = 5  # the cubic was asked for: its length is not corrected
    TAUT = 6  # no curve of these modes is as short, though its chord is
    COINCIDENT = 7  # the facing edges of the cups meet
    INVERTED = 8  # a cup faces away, or its neighbor lies behind it
    SKEWED = 9  # a cup's rotation is none: its columns are not orthonormal


class LengthStatus(IntEnum):
    """Whether the weave can take up the length that a fiber needs."""

    IN_BAND = 0
    TOO_SHORT = 1  # the fiber is shorter than its cups ask for
    SLACK = 2  # the fiber is longer than its cups ask for: it bows out


def dot(a: Array, b: Array) -> Array:
    """Dot products over the last axis, shape (..., 3) to (...)."""
    return np.vecdot(a, b)


def cubic_fibers(
    r0: Array, r1: Array, dr0: Array, dr1: Array, length: ArrayLike
) -> Array:
    """Cubic curves through the ends and tangents of fibers, Eq. 9-13.

    Args:
        r0: First ends, shape (..., 3), in [m].
        r1: Second ends, shape (..., 3), in [m].
        dr0: Unit tangents at the first ends, shape (..., 3).
        dr1: Unit tangents at the second ends, shape (..., 3).
        length: Fiber lengths, shape (...) or one for all, in [m].

    Returns:
        Coefficients of u^0 ... u^4, shape (..., 5, 3), in [m]; the last is zero.
    """
    L = np.asarray(length, dtype=float)[..., None]
    a = np.zeros((*r0.shape[:-1], 5, 3))
    chord, a1, end = r1 - r0, L * dr0, L * dr1
    a[..., 0, :] = r0  # Eq. 10
    a[..., 1, :] = a1  # Eq. 11
    a[..., 2, :] = 3 * chord - 2 * a1 - end  # Eq. 12
    a[..., 3, :] = a1 + end - 2 * chord  # Eq. 13
    return a


def length_error(chord: Array, dr0: Array, dr1: Array, length: ArrayLike) -> Array:
    """Mean squared speed of the cubic less one: gamma, Eq. 20's constant term (D1).

    Args:
        chord: Second ends less first ends, shape (..., 3), in [m].
        dr0: Unit tangents at the first ends, shape (..., 3).
        dr1: Unit tangents at the second ends, shape (..., 3).
        length: Fiber lengths, shape (...) or one for all, in [m].

    Returns:
        gamma, shape (...): positive where the cubic is longer than the fiber.
    """
    L = np.asarray(length, dtype=float)
    slopes = dot(chord, dr0 + dr1) / L
    return 1.2 * dot(chord, chord) / L**2 - slopes / 5 - (11 + dot(dr0, dr1)) / 15


def quartic_fibers(
    r0: Array, r1: Array, dr0: Array, dr1: Array, length: ArrayLike
) -> tuple[Array, Statuses]:
    r"""Curves of given length through the ends and tangents of fibers, Eq. 14-23.

    Eq. 14 is :math:`r = \sum_k a_k u^k + \kappa d u^2 (1 - u)^2`. As
    :math:`d = L (r'_0 - r'_1) / 8`, Eq. 20 is :math:`\kappa^2 + 28 \kappa + c = 0`, and
    its larger root serves both cases of Eq. 22 (D1). A fiber whose length cannot be met
    keeps its cubic and says so in its status.

    Args:
        r0: First ends, shape (..., 3), in [m].
        r1: Second ends, shape (..., 3), in [m].
        dr0: Unit tangents at the first ends, shape (..., 3).
        dr1: Unit tangents at the second ends, shape (..., 3).
        length: Fiber lengths, shape (...) or one for all, in [m].

    Returns:
        Coefficients of u^0 ... u^4, shape (..., 5, 3), in [m], and the FiberStatus of
        each fiber, shape (...).
    """
    L = np.asarray(length, dtype=float)
    chord, turn = r1 - r0, (dr0 - dr1) / 8  # turn = d / L, Eq. 15
    gamma = length_error(chord, dr0, dr1, L)
    size = dot(turn, turn)
    c = 52.5 * gamma / np.maximum(size, PARALLEL**2)
    status = np.select(
        [
            abs(gamma) <= STRAIGHT,
            dot(chord, chord) > L**2,
            c > LONGEST,
            (c < 0) & (size < PARALLEL**2),
            (c < 0) & (size < WEAK**2),
        ],
        [
            FiberStatus.MET,
            FiberStatus.OVERSTRETCHED,
            FiberStatus.TOO_LONG,
            FiberStatus.NO_DIRECTION,
            FiberStatus.WEAK_DIRECTION,
        ],
        FiberStatus.MET,
    )
    solved = (status == FiberStatus.MET) | (status == FiberStatus.WEAK_DIRECTION)
    c = np.where(solved & (abs(gamma) > STRAIGHT), c, 0.0)
    kappa = -c / (14 + np.sqrt(LONGEST - c))  # Eq. 22, free of cancellation
    bulge = (L * kappa)[..., None] * turn
    a = cubic_fibers(r0, r1, dr0, dr1, L)
    a[..., 2:, :] += BULGE[2:, None] * bulge[..., None, :]
    return a, status


def natural_length(r0: Array, r1: Array, dr0: Array, dr1: Array) -> Array:
    """Length at which the cubic needs no bulge: gamma of Eq. 20 vanishes (D2).

    Args:
        r0: First ends, shape (..., 3), in [m].
        r1: Second ends, shape (..., 3), in [m].
        dr0: Unit tangents at the first ends, shape (..., 3).
        dr1: Unit tangents at the second ends, shape (..., 3).

    Returns:
        Natural lengths, shape (...), in [m]; 0 where the ends meet.
    """
    chord = r1 - r0
    b = 3 * dot(chord, dr0 + dr1)
    a = 22 + 2 * dot(dr0, dr1)
    root = np.sqrt(b**2 + 36 * a * dot(chord, chord))
    return np.maximum(root - b, 0.0) / a  # chords below 1e-150 m underflow


def band_length(
    natural: Array, length: ArrayLike, take_up: float
) -> tuple[Array, Statuses]:
    """Length that a fiber assumes when the weave takes up or gives some.

    Args:
        natural: Lengths that the cups ask for, shape (...), in [m].
        length: Fiber lengths at rest, shape (...) or one for all, in [m].
        take_up: Largest change of length either way, in [m].

    Returns:
        The natural length clipped to the band, shape (...), in [m], and the
        LengthStatus of each fiber, shape (...).
    """
    L = np.asarray(length, dtype=float)
    noise = STRAIGHT * L
    status = np.select(
        [natural > L + take_up + noise, natural < L - take_up - noise],
        [LengthStatus.TOO_SHORT, LengthStatus.SLACK],
        LengthStatus.IN_BAND,
    )
    return np.clip(natural, L - take_up, L + take_up), status


def bubble_height(surplus: ArrayLike, length: ArrayLike) -> Array:
    """Height to which a surplus of length bows a fiber out (D4).

    Args:
        surplus: Length that the cups do not ask for, shape (...), in [m]; negative
            counts as none.
        length: Fiber lengths, shape (...) or one for all, in [m].

    Returns:
        Heights (2 / pi) sqrt(length * surplus), shape (...), in [m].
    """
    return 2 / np.pi * np.sqrt(np.asarray(length) * np.maximum(surplus, 0.0))


def powers(u: ArrayLike, count: int = 5) -> Array:
    """Powers u^0 ... u^(count - 1) of positions u, shape (...) to (..., count)."""
    u = np.asarray(u, dtype=float)[..., None]
    return u ** np.arange(count)


def arc_length(coefficients: Array) -> Array:
    """True arc length of fibers, by Gauss quadrature of their speed, Eq. 16.

    Args:
        coefficients: Coefficients of u^0, u^1, ..., shape (..., count, 3), in [m].

    Returns:
        Lengths, shape (...), in [m].
    """
    last = coefficients.shape[-2] - 1
    rates = powers((NODES + 1) / 2, last) * np.arange(1, last + 1)
    velocity = rates @ coefficients[..., 1:, :]
    return np.sqrt(dot(velocity, velocity)) @ WEIGHTS / 2


def even_positions(coefficients: Array, u: ArrayLike) -> Array:
    """Positions at which fibers have run the shares u of their arc length.

    The speed is interpolated at Gauss nodes; its integral is solved for u by Newton's
    method.

    Args:
        coefficients: Coefficients of u^0, u^1, ..., shape (..., count, 3), in [m].
        u: Shares of the arc length, from 0 to 1, shape (...).

    Returns:
        Positions, from 0 to 1, shape (...).
    """
    last = coefficients.shape[-2] - 1
    velocity = (powers((NODES + 1) / 2, last) * np.arange(1, last + 1)) @ coefficients[
        ..., 1:, :
    ]
    speed = np.sqrt(dot(velocity, velocity)) @ TO_LEGENDRE.T
    run: Array = speed @ INTEGRALS.T  # Legendre series of the arc length over 2 u - 1
    whole = np.maximum(2 * speed[..., 0], np.finfo(float).tiny)
    place = np.array(np.broadcast_to(np.asarray(u, dtype=float), whole.shape))
    for _ in range(EVENING):
        values: Array = legendre.legvander(2 * place - 1, len(NODES))
        rate = 2 * np.vecdot(values[..., :-1], speed) / whole
        missing = np.vecdot(values, run) / whole - u
        place = np.clip(place - missing / np.maximum(rate, SLOW), 0, 1)
    return place
