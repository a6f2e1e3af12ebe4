r"""Exact planar fibers: clamped ends, unit speed, least bending energy.

The reference of the fiber models: an inextensible strip in its plane. The tangent's
angle is a Legendre polynomial in :math:`v = 2 x / L - 1`; Newton's method makes its
bending energy stationary under four conditions, both end angles and both coordinates
of the chord. Its error falls exponentially with the order.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

from ply.fiber import Array

ORDER = 16  # [-] of the angle: 1e-9 L on bows of 45 deg
ITERATIONS = 30  # [-] of Newton's method at most; five are common
CONVERGED = 1e-12  # [-] change of the angle, and residual
GIVE = 1e-13  # [-] of the conditions: a straight fiber of full chord has a spare one
BENT = 1e-9  # [-] eigenvalues below are zero
LONGEST_STEP = 0.5  # [rad] largest change of the angle's coefficients in one iteration

COUNT = ORDER + 1
NODES, WEIGHTS = legendre.leggauss(2 * ORDER)
VALUES = legendre.legvander(NODES, ORDER)
ENDS = legendre.legvander(np.array([-1.0, 1.0]), ORDER)
RATES = legendre.legval(NODES, legendre.legder(np.eye(COUNT))).T
BENDING = 2 * (RATES.T * WEIGHTS) @ RATES  # of half the mean squared slope over u


class ElasticaStatus(IntEnum):
    """What became of one elastica."""

    STABLE = 0
    UNSTABLE = 1  # stationary, but a neighbor of the same length has less energy
    NOT_CONVERGED = 2  # or no curve exists: the chord is longer than the fiber


class Elastica(NamedTuple):
    """Planar fibers of exact length.

    Attributes:
        angles: Legendre coefficients of the tangent's angle over v, shape (..., n).
        length: Lengths, shape (...), in [m].
        energy: Half the integral of squared curvature, shape (...), in [1/m].
        status: ElasticaStatus, shape (...).
    """

    angles: Array
    length: Array
    energy: Array
    status: NDArray[np.int64]

    def points(self, u: ArrayLike) -> Array:
        """Points at positions u from 0 to 1, shape (n,) to (..., n, 2), in [m]."""
        u = np.asarray(u, dtype=float)
        inner = u[:, None] * (NODES + 1) - 1  # v on [0, u] of each position
        angle = self.angles @ legendre.legvander(inner, ORDER).reshape(-1, COUNT).T
        angle = angle.reshape(*self.length.shape, *inner.shape)
        share = np.stack([np.cos(angle) @ WEIGHTS, np.sin(angle) @ WEIGHTS], axis=-1)
        return share * (u / 2)[:, None] * self.length[..., None, None]


def elastica(
    chord: Array,
    angle0: ArrayLike,
    angle1: ArrayLike,
    length: ArrayLike,
    bow: ArrayLike = 0.0,
) -> Elastica:
    """Fibers that leave the origin at one angle and arrive at the chord at another.

    Args:
        chord: Second ends, the first being the origin, shape (..., 2), in [m].
        angle0: Angles of the tangents at the first ends, shape (...), in [rad].
        angle1: Angles at the second ends, shape (...), in [rad].
        length: Fiber lengths, shape (...), in [m].
        bow: Height of the bow over the length, that the first guess adds to a parabola
            of angles, positive to the left of the chord, shape (...). Slack between
            parallel ends asks for one, to its side.

    Returns:
        The curves. A start decides which one is found where slack makes several.
    """
    chord, L = np.asarray(chord, dtype=float), np.asarray(length, dtype=float)
    target = np.stack(
        np.broadcast_arrays(chord[..., 0] / L, chord[..., 1] / L, angle0, angle1),
        axis=-1,
    )
    shape = target.shape[:-1]
    x = np.zeros((*shape, COUNT + 4))  # angles, then the forces of the conditions
    x[..., :COUNT] = _start(target, bow)
    done = np.zeros(shape, dtype=bool)
    for _ in range(ITERATIONS):
        matrix, residual = _newton(x, target)
        step = np.linalg.solve(matrix, residual[..., None])[..., 0]
        longest = abs(step[..., :COUNT]).max(axis=-1)
        met = abs(residual[..., COUNT:]).max(axis=-1) < CONVERGED
        done |= (longest < CONVERGED) & met
        step *= np.minimum(1, LONGEST_STEP / np.maximum(longest, CONVERGED))[..., None]
        x = np.where(done[..., None], x, x - step)
        if done.all():
            break
    matrix, _ = _newton(x, target)
    negative = (np.linalg.eigvalsh(matrix) < BENT).sum(axis=-1)
    angles = x[..., :COUNT]
    status = np.select(
        [~done, negative > 4],  # each condition makes one negative eigenvalue
        [ElasticaStatus.NOT_CONVERGED, ElasticaStatus.UNSTABLE],
        ElasticaStatus.STABLE,
    )
    energy = ((angles @ BENDING) * angles).sum(axis=-1) / (2 * L)
    return Elastica(angles, np.broadcast_to(L, shape), energy, status)


def _start(target: Array, bow: ArrayLike) -> Array:
    """A parabola of angles with the ends' and the chord's direction, and a bow."""
    x, z, first, last = np.moveaxis(target, -1, 0)
    mean = np.arctan2(z, x)
    angles = np.zeros((*target.shape[:-1], COUNT))
    angles[..., 0], angles[..., 1] = mean, (last - first) / 2
    angles[..., 2] = (first + last) / 2 - mean
    wave = np.asarray(bow, dtype=float)[..., None] * np.pi * -np.sin(np.pi * NODES)
    return angles + (wave * WEIGHTS) @ VALUES * (np.arange(COUNT) + 0.5)


def _newton(x: Array, target: Array) -> tuple[Array, Array]:
    """Newton matrix and residual of energy and conditions."""
    angles, forces = x[..., :COUNT], x[..., COUNT:]
    angle = angles @ VALUES.T
    cosine, sine = np.cos(angle) * WEIGHTS / 2, np.sin(angle) * WEIGHTS / 2
    rates = np.empty((*x.shape[:-1], 4, COUNT))
    rates[..., 0, :], rates[..., 1, :] = -sine @ VALUES, cosine @ VALUES
    rates[..., 2:, :] = ENDS
    pull = forces[..., :1] * cosine + forces[..., 1:2] * sine
    matrix = np.zeros((*x.shape, x.shape[-1]))
    matrix[..., :COUNT, :COUNT] = BENDING - (pull[..., None, :] * VALUES.T) @ VALUES
    matrix[..., COUNT:, :COUNT] = rates
    matrix[..., :COUNT, COUNT:] = np.swapaxes(rates, -1, -2)
    matrix[..., range(COUNT, COUNT + 4), range(COUNT, COUNT + 4)] = -GIVE
    found = np.stack([cosine.sum(axis=-1), sine.sum(axis=-1)], axis=-1)
    found = np.concatenate([found, angles @ ENDS.T], axis=-1)
    gradient = angles @ BENDING + (forces[..., None, :] @ rates)[..., 0, :]
    return matrix, np.concatenate([gradient, found - target], axis=-1)
