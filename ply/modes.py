"""Bending modes of a clamped fiber: what the modal model adds to the cubic (D13)."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import Polynomial, legendre

from ply.fiber import Array

CUBIC = np.array(  # first end, chord and end slopes, each in powers of u; Eq. 10-13
    [[1.0, 0, 0, 0], [0, 0, 3, -2], [0, 1, -2, 1], [0, 0, -1, 1]]
)


@dataclass(frozen=True, eq=False)
class Modes:
    """Polynomials with double zeros at both ends, orthogonal in slope and bending.

    The mean squared slope of each is one.

    Attributes:
        loads: Buckling loads: mean squared second derivatives, ascending, shape (m,).
        areas: Integrals over u, shape (m,); 0 for odd polynomials.
        tilts: Integrals of the polynomials times 2 u - 1, shape (m,); 0 for even ones.
        powers: Rows that take first end, chord, both end slopes and the amplitudes of
            the modes to coefficients of u^0 ... u^(m + 3), shape (m + 4, m + 4).
    """

    loads: Array
    areas: Array
    tilts: Array
    powers: Array


@cache
def bending_modes(count: int) -> Modes:
    """The modes of a clamped fiber, from one small eigenproblem.

    Args:
        count: Number of modes, 1 or more.

    Returns:
        The modes, by ascending load.
    """
    orders = np.arange(2, count + 2)  # of the Legendre polynomials phi'' over 2 u - 1
    second = np.zeros((count + 2, count))
    second[orders, orders - 2] = 1
    slopes = legendre.legint(second, lbnd=-1)
    squares = 2 / (2 * np.arange(count + 3) + 1)
    root = np.linalg.inv(np.linalg.cholesky(2 * (slopes.T * squares) @ slopes))
    loads, vectors = np.linalg.eigh((root * (16 / (2 * orders + 1))) @ root.T)
    shares = vectors.T @ root
    odd = np.arange(count) % 2 == 1
    shares[odd[:, None] != odd] = 0  # rounding: even and odd modes alternate
    lead = shares[np.arange(count), odd.astype(int)]
    shares *= np.sign(lead)[:, None]  # areas of even modes, tilts of odd ones above 0
    curves = legendre.legint(slopes, lbnd=-1) @ shares.T
    powers = np.zeros((count + 4, count + 4))
    powers[:4, :4] = CUBIC
    for row, series in zip(powers[4:], curves.T, strict=True):
        in_u = Polynomial(legendre.leg2poly(series))(Polynomial([-1, 2]))
        row[2 : len(in_u.coef)] = in_u.coef[2:]
    areas, tilts = np.where(odd, 0, curves[0]), np.where(odd, curves[1] / 3, 0)
    return Modes(loads, areas, tilts, powers)
