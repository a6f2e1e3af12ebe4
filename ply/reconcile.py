r"""Cup poses reconciled with the lengths of the fibers, within their own uncertainty.

Noise of a quarter of a millimeter in the poses reads as slack, and slack bows out:
0.25 mm in 70 mm makes 2.7 mm. So before any length is corrected, the poses move as
little as possible, weighted by their uncertainty, until the cups ask each fiber for its
length: less what slack the ply has as a whole, and what no noise explains. D15.
"""

from dataclasses import dataclass

import numpy as np

from ply.errors import PlyError
from ply.fiber import Array, dot, natural_length
from ply.grid import CupGrid

ITERATIONS = 4  # [-] of Gauss and Newton: the lengths settle to 1e-9 m
COMMON = 2.0  # [-] standard deviations of the common slack that count as noise
SINGLE = 3.0  # [-] and of single fibers, since a ply has many
LENGTH_SIGMA = 50e-6  # [m] by which lengths of fibers differ, or models of them


@dataclass(frozen=True, eq=False)
class Reconciled:
    """Poses that the fibers allow.

    Attributes:
        positions: Centers of the suction faces, shape (..., n_cups, 3), in [m].
        rotations: Cup frames, shape (..., n_cups, 3, 3).
        slack: Length that all fibers have beyond what the cups ask for, shape (...), in
            [m]; 0 where noise explains it, negative where they lack some.
        take_up: Length that the fibers of these poses may give and take, in [m], for
            `ply_fibers`: two standard deviations of what lengths differ by; 0 for poses
            that are exact.
        misfit: Root mean square of the pose changes over their standard deviations,
            shape (...), in [-]; well above 1 where the stated uncertainty is too small.
    """

    positions: Array
    rotations: Array
    slack: Array
    take_up: float
    misfit: Array


def reconcile(
    grid: CupGrid,
    positions: Array,
    rotations: Array,
    sigma: float,
    sigma_angle: float,
) -> Reconciled:
    """Poses of least weighted change whose fibers have the length that they ask for.

    Args:
        grid: The cup array.
        positions: Centers of the suction faces, shape (..., n_cups, 3), in [m].
        rotations: Cup frames, shape (..., n_cups, 3, 3).
        sigma: Standard deviation of each coordinate of the positions, in [m].
        sigma_angle: Standard deviation of the rotation about each axis, in [rad].

    Returns:
        The poses, with the common slack that noise does not explain.

    Raises:
        PlyError: A standard deviation is negative or not finite.
    """
    for name, value in (("sigma", sigma), ("sigma_angle", sigma_angle)):
        if not (np.isfinite(value) and value >= 0):
            raise PlyError(name, f"{value:g}", "use 0 or more")
    p, frames = np.array(positions, dtype=float), np.array(rotations, dtype=float)
    batch = p.shape[:-2]
    if len(grid.neighbors) == 0 or sigma == sigma_angle == 0:
        return Reconciled(p, frames, np.zeros(batch), 0.0, np.zeros(batch))
    scale = np.repeat([sigma, sigma_angle], 3)
    change = np.zeros((*batch, 6 * grid.n_cups))  # in standard deviations

    def moved() -> tuple[Array, Array]:
        return _moved(p, frames, scale * change.reshape(*batch, grid.n_cups, 6))

    excess, J, C = _linear(grid, *moved(), scale)
    target, slack = _target(excess, C)
    for _ in range(ITERATIONS):
        wanted = target - excess + (J @ change[..., None])[..., 0]
        force = np.linalg.solve(C, wanted[..., None])
        change = (np.swapaxes(J, -1, -2) @ force)[..., 0]
        excess, J, C = _linear(grid, *moved(), scale)
    misfit = np.sqrt((change**2).mean(axis=-1))
    return Reconciled(*moved(), slack, 2 * LENGTH_SIGMA, misfit)


def _linear(
    grid: CupGrid, p: Array, frames: Array, scale: Array
) -> tuple[Array, Array, Array]:
    """Excess of each fiber, its rates with the whitened poses, and its variances."""
    excess, rates = _excess(grid, p, frames)
    J = (rates * scale).reshape(*excess.shape, -1)
    noise = LENGTH_SIGMA**2 * np.eye(excess.shape[-1])
    return excess, J, J @ np.swapaxes(J, -1, -2) + noise


def _target(excess: Array, C: Array) -> tuple[Array, Array]:
    """Excess of length that each fiber may keep, shape (..., n), and the slack."""
    ones = np.ones((*excess.shape, 1))
    weights = np.linalg.solve(C, ones)[..., 0]
    precision = weights.sum(axis=-1)
    common = (weights * excess).sum(axis=-1) / precision
    common = np.where(abs(common) * np.sqrt(precision) > COMMON, common, 0.0)
    apart = excess - common[..., None]
    noise = SINGLE * np.sqrt(np.diagonal(C, axis1=-2, axis2=-1))
    kept = np.sign(apart) * np.maximum(abs(apart) - noise, 0.0)
    return common[..., None] + kept, -common


def _excess(grid: CupGrid, p: Array, frames: Array) -> tuple[Array, Array]:
    """Natural length of each edge fiber less its own, and its rates with the poses.

    Shapes (..., n) and (..., n, n_cups, 6); the rates are those with position and with
    rotation about the world's axes.
    """
    first_t, half = grid.n_s_pairs, grid.half_width
    excesses, rates = [], []
    for along, pairs, L in (
        (0, grid.neighbors[:first_t], grid.s_length),
        (1, grid.neighbors[first_t:], grid.t_length),
    ):
        tangents, laterals = frames[..., along], frames[..., 1 - along]
        for lateral in (-half, half):
            a, b = pairs.T
            dr0, dr1 = tangents[..., a, :], tangents[..., b, :]
            arm0 = half * dr0 + lateral * laterals[..., a, :]
            arm1 = -half * dr1 + lateral * laterals[..., b, :]
            chord = p[..., b, :] + arm1 - p[..., a, :] - arm0
            N = natural_length(0 * chord, chord, dr0, dr1)
            by_chord, by_sum, by_cosine = _natural_rates(chord, dr0, dr1, N)
            rate = np.zeros((*N.shape, grid.n_cups, 6))
            n = np.arange(len(pairs))
            rate[..., n, a, :3], rate[..., n, b, :3] = -by_chord, by_chord
            rate[..., n, a, 3:] = np.cross(arm0, -by_chord) + np.cross(
                dr0, by_sum + by_cosine * dr1
            )
            rate[..., n, b, 3:] = np.cross(arm1, by_chord) + np.cross(
                dr1, by_sum + by_cosine * dr0
            )
            excesses.append(N - L)
            rates.append(rate)
    return np.concatenate(excesses, axis=-1), np.concatenate(rates, axis=-3)


def _natural_rates(
    chord: Array, dr0: Array, dr1: Array, N: Array
) -> tuple[Array, Array, Array]:
    """Rates of the natural length with chord, sum and cosine of the tangents (D2)."""
    N = N[..., None]
    total = dr0 + dr1
    square, slope = dot(chord, chord)[..., None], dot(chord, total)[..., None]
    steep = 2.4 * square / N**3 - slope / (5 * N**2)  # of -gamma with N
    by_chord = (2.4 * chord / N**2 - total / (5 * N)) / steep
    return by_chord, -chord / (5 * N) / steep, -1 / 15 / steep


def _moved(p: Array, frames: Array, change: Array) -> tuple[Array, Array]:
    """Poses after a change: positions, and rotation vectors about the world's axes."""
    vector = change[..., 3:]
    angle = np.sqrt(dot(vector, vector))[..., None, None]
    axis = vector[..., None, :] / np.where(angle > 0, angle, 1.0)
    columns = np.swapaxes(frames, -1, -2)  # rows are the directions
    turned = (
        columns * np.cos(angle)
        + np.cross(axis, columns) * np.sin(angle)
        + axis * dot(axis, columns)[..., None] * (1 - np.cos(angle))
    )
    return p + change[..., :3], np.swapaxes(turned, -1, -2)
