"""How long the ply is between its cups: strips of a scan (D24).

The strip that the cups ask for is the cubic between them. A scan shows how far the ply
bows from it, as amplitudes of the fiber's bending modes by linear least squares; what
it shows is a curve, and a curve has a length. No side is guessed, no root is sought.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drapeplan.identify_cups import SeenCups, farthest
from ply.fiber import Array, arc_length, dot, powers
from ply.modes import bending_modes
from ply.shape import ply_fibers
from ply.strip import across

Bools = NDArray[np.bool_]

MODES = 3  # [-] as in the ply model
MIDDLE = 0.5  # [-] of the half width: beyond it the patches pull on the strip
FEWEST = 15  # points of a strip, five for each mode
ROUNDS = 4  # of Gauss and Newton: feet of the points, then amplitudes
CLEAR = 0.05e-3  # [m] of length that a fiber must be off to count as out of the band
ACROSS = 3  # [-] fibers of a strip
PULLED = 0.2  # [-] of what a cubic has beyond its chord: three modes keep 0.14 (D24)
DIFFERENCE = 1e-6  # [m] of amplitudes, for rates of lengths


@dataclass(frozen=True, eq=False)
class Strips:
    """Strips between neighboring cups that a scan covers, k of them, s family first.

    Attributes:
        pairs: The cups of each, shape (k, 2).
        rest: Length of its fibers at rest, shape (k,), in [m].
        asked: Length that its cups ask of its middle fiber, shape (k,), in [m].
        length: Length that the scan shows there, shape (k,), in [m].
        sigma: Standard deviation of that length by the scan, shape (k,), in [m].
        out: 1 where all its fibers are shorter than asked, -1 where all are longer, 0
            where the weave gave what was asked, or where cups pull them straight, shape
            (k,).
        pulled: Where cups pull fibers straight: they may stretch or slide, shape (k,).
        tangents: Unit tangents at the rims of both cups, shape (k, 2, 3).
        rise: How far the middle lies above the cubic along the cups' normals, shape
            (k,), in [m].
    """

    pairs: NDArray[np.int64]
    rest: Array
    asked: Array
    length: Array
    sigma: Array
    out: NDArray[np.int64]
    pulled: Bools
    tangents: Array
    rise: Array


def see_strips(scanned: SeenCups) -> Strips:
    """Lengths of the strips between cups that a scan shows.

    Args:
        scanned: The cups, and the points of the scan near the ply.
    """
    cups, grid = scanned.cups, scanned.cups.grid
    a, b = grid.neighbors.T
    curves, natural = _cubics(scanned)
    normals = cups.rotations[a, :, 2] + cups.rotations[b, :, 2]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    seen, amplitudes, covariance = _bows(curves, normals, *_on_strips(scanned))
    seen &= scanned.seen[a] & scanned.seen[b]
    length, rates = _lengths(curves, normals, amplitudes)
    excess = length - natural
    short, long = ((sign * excess > CLEAR).all(axis=1) for sign in (-1, 1))
    chord = np.linalg.norm(curves[..., 1:, :].sum(axis=-2), axis=-1)
    pulled = short & (length - chord < PULLED * (natural - chord)).any(axis=1)
    out = np.where(short & ~pulled, 1, np.where(long, -1, 0))
    along_s = np.arange(len(a)) < grid.n_s_pairs
    axis = np.where(along_s, 0, 1)
    tangents = np.stack([cups.rotations[n, :, axis] for n in (a, b)], axis=1)
    variance = np.einsum("kj,kjl,kl->k", rates, covariance, rates)
    return Strips(
        grid.neighbors[seen],
        np.where(along_s, grid.s_length, grid.t_length)[seen],
        natural[seen, ACROSS // 2],
        length[seen, ACROSS // 2],
        np.sqrt(variance)[seen],
        out[seen],
        pulled[seen],
        tangents[seen],
        (amplitudes @ (_shapes() @ powers(0.5, MODES + 4)))[seen],
    )


def _shapes() -> Array:
    """The modes as coefficients of u^0, u^1, ..., shape (MODES, MODES + 4)."""
    return bending_modes(MODES).powers[4:]


def _cubics(scanned: SeenCups) -> tuple[Array, Array]:
    """Curves that the cups ask for, shape (k, ACROSS, MODES + 4, 3), and lengths."""
    cups = scanned.cups
    poses = cups.positions, cups.rotations
    fibers = ply_fibers(cups.grid, *poses, model="cubic", across=ACROSS)
    parts = [family.reshape(-1, *family.shape[-3:]) for family in (fibers.s, fibers.t)]
    cubics = np.concatenate(parts)
    curves = np.zeros((*cubics.shape[:2], MODES + 4, 3))
    curves[:, :, : cubics.shape[2]] = cubics
    natural = [x.reshape(-1, ACROSS) for x in (fibers.s_natural, fibers.t_natural)]
    return curves, np.concatenate(natural)


def _on_strips(scanned: SeenCups) -> tuple[NDArray[np.int64], Array, Array, Array]:
    """Points near middle lines: strip, place along it, weights of fibers, position."""
    grid = scanned.cups.grid
    s, t = grid.place_s(scanned.st[:, 0]), grid.place_t(scanned.st[:, 1])
    middle = MIDDLE * grid.half_width
    on_s, on_t = (
        along.in_span & ~beside.in_span & (abs(beside.y) <= middle)
        for along, beside in ((s, t), (t, s))
    )
    index_s = t.cup * (grid.columns - 1) + s.cup
    index_t = grid.n_s_pairs + t.cup * grid.columns + s.cup
    on = on_s | on_t
    y = np.where(on_s, t.y, s.y)[on]
    return (
        np.where(on_s, index_s, index_t)[on],
        np.where(on_s, s.u, t.u)[on],
        across(y, grid.half_width, ACROSS),
        scanned.points[on],
    )


def _bows(
    curves: Array,
    normals: Array,
    strip: NDArray[np.int64],
    u: Array,
    lateral: Array,
    points: Array,
) -> tuple[Bools, Array, Array]:
    """Amplitudes of the modes that bring the curves of each strip to its points.

    Returns:
        Strips with enough points, amplitudes, shape (k, MODES), and covariances.
    """
    k, shapes, n = len(curves), _shapes(), normals[strip]
    amplitudes, kept = np.zeros((k, MODES)), np.ones(len(points), dtype=bool)
    line = np.einsum("nm,nmkc->nkc", lateral, curves[strip])
    for _ in range(ROUNDS):
        bowed = line + (amplitudes @ shapes)[strip][..., None] * n[:, None]
        x, tangent = _places(bowed, u)
        u = np.clip(u + dot(points - x, tangent) / dot(tangent, tangent), 0, 1)
        x, tangent = _places(bowed, u)
        up = n - (dot(n, tangent) / dot(tangent, tangent))[:, None] * tangent
        up /= np.linalg.norm(up, axis=1, keepdims=True)
        rows = dot(n, up)[:, None] * (powers(u, MODES + 4) @ shapes.T)
        left = dot(points - x, up)
        count = np.bincount(strip[kept], minlength=k)
        enough = count >= FEWEST
        N, right = np.zeros((k, MODES, MODES)), np.zeros((k, MODES))
        np.add.at(N, strip[kept], rows[kept, :, None] * rows[kept, None, :])
        np.add.at(right, strip[kept], rows[kept] * left[kept, None])
        N[~enough] = np.eye(MODES)
        inverse = np.linalg.inv(N)
        step = (inverse @ right[..., None])[..., 0] * enough[:, None]
        amplitudes += step
        left = left - np.vecdot(rows, step[strip])
        used = kept & enough[strip]
        freedom = max(used.sum() - MODES * enough.sum(), 1)
        variance = (left[used] ** 2).sum() / freedom
        kept = abs(left) <= farthest(left)
    return enough, amplitudes, variance * inverse


def _places(curves: Array, u: Array) -> tuple[Array, Array]:
    """Points of curves, and their rates with u, each of shape (n, 3)."""
    count = curves.shape[-2]
    rates = curves[:, 1:] * np.arange(1, count)[:, None]
    at, slope = powers(u, count)[:, None], powers(u, count - 1)[:, None]
    return (at @ curves)[:, 0], (slope @ rates)[:, 0]


def _lengths(curves: Array, normals: Array, amplitudes: Array) -> tuple[Array, Array]:
    """Lengths of all fibers, shape (k, ACROSS), and rates of the middle one's."""
    shapes = _shapes()

    def of(bows: Array) -> Array:
        bow = (bows @ shapes)[..., None] * normals[:, None]
        return arc_length(curves + bow[:, None])

    steps = DIFFERENCE * np.eye(MODES)
    rates = [of(amplitudes + step) - of(amplitudes - step) for step in steps]
    middle = np.stack(rates, axis=-1)[:, ACROSS // 2]
    return of(amplitudes), middle / (2 * DIFFERENCE)
