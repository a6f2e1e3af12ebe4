"""Shape of the ply that cups hold: fibers from poses, points from fibers.

`ply_fibers` and `PlySampling` live in modules of their own; this is their common door,
with `evaluate` for material points that form no grid.
"""

import numpy as np
from numpy.typing import ArrayLike

from ply import patch, strip
from ply.fiber import Array
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
) -> Array:
    """Positions of scattered material points; `PlySampling` is for tensor grids.

    Args:
        grid: The cup array.
        fibers: Fibers of the same poses.
        positions: Centers of the suction faces, shape (..., n_cups, 3), in [m].
        rotations: Cup frames, shape (..., n_cups, 3, 3).
        points_st: Material coordinates (s, t), shape (n, 2), in [m].

    Returns:
        Points, shape (..., n, 3), in [m].
    """
    points_st = np.asarray(points_st, dtype=float)
    s, t = grid.place_s(points_st[:, 0]), grid.place_t(points_st[:, 1])
    half, layout = grid.half_width, fibers.s.shape[-3:-1]
    out = np.empty((*np.shape(positions)[:-2], len(points_st), 3))

    n = np.flatnonzero(~s.in_span & ~t.in_span)
    cup = t.cup[n] * grid.columns + s.cup[n]
    local = np.stack([s.y[n], t.y[n]], axis=-1)
    frame = rotations[..., cup, :, :2]
    out[..., n, :] = positions[..., cup, :] + (frame @ local[..., None])[..., 0]

    n = np.flatnonzero(s.in_span & ~t.in_span)
    rows = strip.weights(s.u[n], t.y[n], half, *layout)
    out[..., n, :] = _combine(rows, fibers.s[..., t.cup[n], s.cup[n], :, :, :])

    n = np.flatnonzero(~s.in_span & t.in_span)
    rows = strip.weights(t.u[n], s.y[n], half, *layout)
    out[..., n, :] = _combine(rows, fibers.t[..., t.cup[n], s.cup[n], :, :, :])

    n = np.flatnonzero(s.in_span & t.in_span)
    lengths = grid.s_length, grid.t_length
    rows = patch.weights(s.u[n], t.u[n], *lengths, half, *layout)
    i, j = t.cup[n], s.cup[n]
    around = [fibers.s[..., i, j, :, :, :], fibers.s[..., i + 1, j, :, :, :]]
    around += [fibers.t[..., i, j, :, :, :], fibers.t[..., i, j + 1, :, :, :]]
    out[..., n, :] = _combine(rows, np.concatenate(around, axis=-3))
    return out


def _combine(rows: Array, coefficients: Array) -> Array:
    """Rows (n, k) times coefficients (..., n, fibers, terms, 3), k = fibers terms."""
    flat = coefficients.reshape(*coefficients.shape[:-3], rows.shape[-1], 3)
    return np.einsum("nk,...nkc->...nc", rows, flat)
