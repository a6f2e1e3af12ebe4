"""Shape of the ply that cups hold: fibers from poses, points from fibers.

`ply_fibers` and `PlySampling` live in modules of their own; this is their common door,
with `evaluate` for material points that form no grid.
"""

import numpy as np
from numpy.typing import ArrayLike

from ply import patch, strip
from ply.fiber import Array, even_positions, powers
from ply.grid import CupGrid
from ply.sampling import PlySampling
from ply.weave import MODELS, PlyFibers, ply_fibers

__all__ = ["MODELS", "PlyFibers", "PlySampling", "evaluate", "ply_fibers"]


def evaluate(
    grid: CupGrid,
    fibers: PlyFibers,
    positions: Array,
    rotations: Array,
    points_st: ArrayLike,
    *,
    material: bool = False,
) -> Array:
    """Positions of scattered material points; `PlySampling` is for tensor grids.

    Fibers are not traveled at even speed, so that material drifts along a bulge, by up
    to 0.5 mm. Where a material point is tracked, material=True mends it.

    Args:
        grid: The cup array.
        fibers: Fibers of the same poses.
        positions: Centers of the suction faces, shape (..., n_cups, 3), in [m].
        rotations: Cup frames, shape (..., n_cups, 3, 3).
        points_st: Material coordinates (s, t), shape (n, 2), in [m].
        material: Place points along fibers by arc length rather than by parameter.

    Returns:
        Points, shape (..., n, 3), in [m].
    """
    points_st = np.asarray(points_st, dtype=float)
    s, t = grid.place_s(points_st[:, 0]), grid.place_t(points_st[:, 1])
    half, count = grid.half_width, fibers.s.shape[-3]
    out = np.empty((*np.shape(positions)[:-2], len(points_st), 3))

    n = np.flatnonzero(~s.in_span & ~t.in_span)
    cup = t.cup[n] * grid.columns + s.cup[n]
    local = np.stack([s.y[n], t.y[n]], axis=-1)
    frame = rotations[..., cup, :, :2]
    out[..., n, :] = positions[..., cup, :] + (frame @ local[..., None])[..., 0]

    n = np.flatnonzero(s.in_span & ~t.in_span)
    around = fibers.s[..., t.cup[n], s.cup[n], :, :, :]
    lateral = strip.across(t.y[n], half, count)
    out[..., n, :] = _weighted(lateral, around, s.u[n], material)

    n = np.flatnonzero(~s.in_span & t.in_span)
    around = fibers.t[..., t.cup[n], s.cup[n], :, :, :]
    lateral = strip.across(s.y[n], half, count)
    out[..., n, :] = _weighted(lateral, around, t.u[n], material)

    n = np.flatnonzero(s.in_span & t.in_span)
    u, v, i, j = s.u[n], t.u[n], t.cup[n], s.cup[n]
    share = patch.blend(u, v)[:, None]
    pairs = fibers.s[..., i, j, :, :, :], fibers.s[..., i + 1, j, :, :, :]
    lateral = share * patch.across(v, grid.t_length, half, count)
    along_s = _weighted(lateral, np.concatenate(pairs, axis=-3), u, material)
    pairs = fibers.t[..., i, j, :, :, :], fibers.t[..., i, j + 1, :, :, :]
    lateral = (1 - share) * patch.across(u, grid.s_length, half, count)
    along_t = _weighted(lateral, np.concatenate(pairs, axis=-3), v, material)
    out[..., n, :] = along_s + along_t
    return out


def _weighted(weights: Array, fibers: Array, u: Array, material: bool) -> Array:
    """Weighted points of fibers: (n, m), (..., n, m, K, 3), (n,) to (..., n, 3)."""
    places = np.broadcast_to(u[:, None], fibers.shape[:-2])
    if material:
        places = even_positions(fibers, places)
    rows = weights[..., None] * powers(places, fibers.shape[-2])
    return np.einsum("...nmk,...nmkc->...nc", rows, fibers)
