"""Identification: take-up, bending stiffness and pose noise, from what a shop measures.

Strips over an edge give the stiffness; the squares that cups hold give the errors of
recorded poses; strips that are longer or shorter than their cups ask for give the
weave's take-up. What a measurement does not show is said, never guessed (D24).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student

from drapeplan.cantilever import bending_stiffness
from drapeplan.cups_file import Cups
from drapeplan.identify_cups import SeenCups, see_cups
from drapeplan.identify_file import Cantilever, Links, Measurements
from drapeplan.identify_strips import Strips, see_strips
from drapeplan.likelihood import LEVEL, Estimate, Fit, Numbers, fit, numbers, without
from ply.reconcile import LENGTH_SIGMA

Array = NDArray[np.float64]

TINY = 1e-9  # [m] cups nearer to each other have no arm
MODEL_SIGMA = 20e-6  # [m] of the take-up: what patches do to their strips (D24)


@dataclass(frozen=True, eq=False)
class Look:
    """One scan, looked at: its cups and its strips."""

    cups: SeenCups
    strips: Strips


class _Lengths(NamedTuple):
    """Lengths as `numbers` takes them: errors of links, take-ups of strips."""

    values: Array
    gains: Array
    noise: Array
    x: Array


@dataclass(frozen=True, eq=False)
class Identified:
    """What measurements say, in SI units and radians; None: they do not show it.

    Attributes:
        take_up: Of the weave, in [m]; its interval must leave out zero to count.
        take_up_share: Standard deviation of its estimate, relative.
        stiffness: Bending stiffness, in [N m], by "warp", "weft" and "both".
        stiffness_log: Standard deviation of its logarithm: of the estimate, and between
            the directions.
        areal_mass: Of the ply, in [kg/m^2].
        position: Standard deviation of a cup's coordinates, in [m].
        angle: Standard deviation of a cup's tilts, in [rad].
        looks: The scans.
        likely: Likeliest errors of the strips' lengths by recorded poses, one array of
            shape (k,) for each scan, in [m].
        strips: Strips over an edge by direction: their stiffnesses, in [N m].
    """

    take_up: Estimate | None
    take_up_share: float
    stiffness: dict[str, Estimate]
    stiffness_log: float
    areal_mass: float | None
    position: Estimate | None
    angle: Estimate | None
    looks: tuple[Look, ...]
    likely: tuple[Array, ...]
    strips: dict[str, Array]


def identify(measured: Measurements) -> Identified:
    """Estimates of greatest likelihood with intervals of 95 %.

    Args:
        measured: The measurements.

    Raises:
        InputError: A scan does not show the ply that its cups hold.
    """
    looks = []
    for cups, scan in measured.scans:
        seen = see_cups(cups, scan)
        looks.append(Look(seen, see_strips(seen)))
    lengths = [numbers(*_lengths(one, measured.links)) for one in looks]
    poses = fit([*(_heights(one.cups) for one in looks), *lengths])
    angles = fit([_angles(one.cups) for one in looks])
    take_up = _take_up(poses)
    strips: dict[str, Array] = {}
    stiffness: dict[str, Estimate] = {}
    spread = 0.0
    if measured.cantilever:
        strips = _stiffnesses(measured.cantilever)
        stiffness, spread = _mean_stiffness(strips, measured.cantilever)
    return Identified(
        take_up,
        float(np.hypot(poses.mean_sigma, MODEL_SIGMA)) / take_up.value
        if take_up
        else 0.0,
        stiffness,
        spread,
        measured.cantilever.areal_mass if measured.cantilever else None,
        poses.spread,
        angles.spread,
        tuple(looks),
        tuple(_likely_errors(one, measured.links, poses) for one in looks),
        strips,
    )


def _take_up(poses: Fit) -> Estimate | None:
    """Take-up with the model's share in its interval, if that leaves out zero."""
    if poses.mean is None:
        return None
    value, low, high = poses.mean
    reach = norm.ppf((1 + LEVEL) / 2) * MODEL_SIGMA
    low = value - float(np.hypot(value - low, reach))
    high = value + float(np.hypot(high - value, reach))
    return Estimate(value, low, high) if low > 0 else None


def _heights(seen: SeenCups) -> Numbers:
    """Heights of cups, less what moves all of them: the scan's registration."""
    k = seen.seen
    n, p = seen.cups.rotations[k, :, 2], seen.cups.positions[k]
    arms = p - p.mean(axis=0)
    common = np.hstack([n, np.cross(arms / max(arms.std(), TINY), n)])
    rows, left = without(common, seen.heights[k])
    return numbers(left, rows, np.sqrt(rows**2 @ seen.height_sigma[k] ** 2))


def _angles(seen: SeenCups) -> Numbers:
    """Tilts of cups, less what turns all of them."""
    k = seen.seen
    axes = seen.cups.rotations[k, :, :2].swapaxes(1, 2).reshape(-1, 3)
    rows, left = without(axes, seen.tilts[k].ravel())
    return numbers(left, rows, np.sqrt(rows**2 @ seen.tilt_sigma[k].ravel() ** 2))


def _lengths(look: Look, links: Links | None) -> _Lengths:
    """Errors of links, and take-ups of strips out of the band, in [m].

    Both change with errors of the positions in the cups' own planes; what the strips
    lie off along the normals is mended already.
    """
    cups, strips = look.cups.cups, look.strips
    out = strips.out != 0
    sign, pairs = strips.out[out], strips.pairs[out]
    take_up = sign * (strips.length - strips.rest)[out]
    gains = [_gains(cups, pairs, sign[:, None, None] * strips.tangents[out])]
    values, noise = [take_up], [np.hypot(LENGTH_SIGMA, strips.sigma[out])]
    if links:
        pairs = cups.grid.neighbors
        pairs = pairs[look.cups.seen[pairs].all(axis=1)]
        ends = cups.positions + links.height * cups.rotations[..., 2]
        d = ends[pairs[:, 1]] - ends[pairs[:, 0]]
        length = np.linalg.norm(d, axis=1)
        e = np.repeat((d / length[:, None])[:, None], 2, axis=1)
        values.append(length - links.length)
        gains.append(_gains(cups, pairs, e))
        noise.append(_link_noise(look.cups, pairs, e, links))
    x = np.zeros(sum(map(len, values)))
    x[: len(take_up)] = 1.0
    return _Lengths(np.concatenate(values), np.vstack(gains), np.concatenate(noise), x)


def _likely_errors(look: Look, links: Links | None, poses: Fit) -> Array:
    """Likeliest errors of the lengths of all strips, given all that was seen."""
    strips, seen = look.strips, _lengths(look, links)
    variance = poses.spread.value**2 if poses.spread else 0.0
    mean = poses.mean.value if poses.mean else 0.0
    C = variance * seen.gains @ seen.gains.T + np.diag(seen.noise**2)
    force = np.linalg.solve(C, seen.values - mean * seen.x)
    errors = variance * seen.gains.T @ force
    return np.asarray(_gains(look.cups.cups, strips.pairs, strips.tangents) @ errors)


def _gains(cups: Cups, pairs: NDArray[np.int64], directions: Array) -> Array:
    """Rates of lengths with positions in the cups' planes, shape (k, 3 n)."""
    n = cups.rotations[pairs, :, 2]
    within = directions - np.vecdot(n, directions)[..., None] * n
    J = np.zeros((len(pairs), cups.grid.n_cups, 3))
    row = np.arange(len(pairs))
    J[row, pairs[:, 0]], J[row, pairs[:, 1]] = -within[:, 0], within[:, 1]
    return J.reshape(len(pairs), 3 * cups.grid.n_cups)


def _link_noise(
    seen: SeenCups, pairs: NDArray[np.int64], directions: Array, links: Links
) -> Array:
    """Standard deviations of links' lengths but for those positions, shape (k,)."""
    n = seen.cups.rotations[pairs, :, 2]
    heights = np.vecdot(n, directions) * seen.height_sigma[pairs]
    turned = links.height * np.linalg.norm(seen.tilt_sigma, axis=1)[pairs]
    return np.sqrt(links.sigma**2 + (heights**2 + turned**2).sum(axis=1))


def _stiffnesses(cantilever: Cantilever) -> dict[str, Array]:
    """Stiffness of each strip by direction, in [N m]."""
    mass = cantilever.areal_mass
    return {
        name: bending_stiffness(strips.load, strips.length, mass)
        for name, strips in cantilever.strips.items()
    }


def _mean_stiffness(
    strips: dict[str, Array], cantilever: Cantilever
) -> tuple[dict[str, Estimate], float]:
    """Geometric means by direction and of both; what a scene does not know of it.

    Repeats scatter about the mean of their direction alike; the mass is common to all.
    """
    logs = {name: np.log(values) for name, values in strips.items()}
    freedom = sum(len(x) - 1 for x in logs.values())
    scatter = sum(((x - x.mean()) ** 2).sum() for x in logs.values()) / freedom
    mass = cantilever.areal_mass_sigma / cantilever.areal_mass
    factor = float(student.ppf((1 + LEVEL) / 2, freedom))

    def estimate(mean: float, share: float) -> tuple[Estimate, float]:
        sigma = float(np.sqrt(scatter * share + mass**2))
        ends = np.exp(mean + factor * sigma * np.array([0.0, -1.0, 1.0]))
        return Estimate(*(float(end) for end in ends)), sigma

    found = {n: estimate(x.mean(), 1 / len(x))[0] for n, x in logs.items()}
    means = [float(x.mean()) for x in logs.values()]
    share = sum(1 / len(x) for x in logs.values()) / len(logs) ** 2
    found["both"], sigma = estimate(float(np.mean(means)), share)
    return found, float(np.hypot(sigma, np.ptp(means) / 2))
