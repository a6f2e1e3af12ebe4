"""Bending modes of a clamped fiber: what the modal model adds to the cubic (D13)."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import Polynomial

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
    shape = Polynomial([0, 0, 1, -2, 1])  # u^2 (1 - u)^2
    basis = [shape * Polynomial([-1, 2]) ** j for j in range(count)]

    def products(order: int) -> Array:
        rates = [one.deriv(order) for one in basis]
        return np.array([[(a * b).integ()(1.0) for b in rates] for a in rates])

    root = np.linalg.inv(np.linalg.cholesky(products(1)))
    loads, vectors = np.linalg.eigh(root @ products(2) @ root.T)
    shares = vectors.T @ root
    shares[abs(shares) < 1e-9 * abs(shares).max()] = 0  # parity, exactly
    shares *= np.sign(shares.sum(axis=1))[:, None]  # > 0 just before the second end
    modes = [sum(a * one for a, one in zip(row, basis, strict=True)) for row in shares]
    odd = np.arange(count) % 2 == 1
    areas = np.array([one.integ()(1.0) for one in modes])
    tilts = np.array([(one * Polynomial([-1, 2])).integ()(1.0) for one in modes])
    powers = np.zeros((count + 4, count + 4))
    powers[:4, :4] = CUBIC
    for row, one in zip(powers[4:], modes, strict=True):
        row[2 : len(one.coef)] = one.coef[2:]
    return Modes(loads, np.where(odd, 0, areas), np.where(odd, tilts, 0), powers)
