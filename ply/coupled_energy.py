"""Energy, forces and stiffness of one region of the coupled ply (D10).

Bending is quadratic in the unknowns. Stretch and shear come from the Green strains of
the mid-surface at the Gauss points: (|r_s|^2 - 1) / 2, (|r_t|^2 - 1) / 2, r_s . r_t;
what the weave takes up of a stretch costs no energy (D8). The
weight is a constant load.

Batch axes first; a leading axis of the piece meets the last batch axes.
"""

import numpy as np
from numpy.typing import NDArray

from ply.coupled_basis import Piece
from ply.fiber import Array, dot

WIDE = 100  # [-] strains of that many bands pass a band as if there were none
ROUNDING = 1e-9  # [-] of the take-up: a strain at its edge counts as beyond


def tangents(piece: Piece, q: Array, cups: Array) -> tuple[Array, Array]:
    """Derivatives of the surface along s and t at the Gauss points.

    Args:
        piece: Matrices of the region.
        q: Unknowns, shape (..., n, 3).
        cups: Position, s and t direction of the four cups, shape (..., 12, 3).

    Returns:
        Two arrays of shape (..., G, 3).
    """
    return piece.ds @ q + piece.ds_cups @ cups, piece.dt @ q + piece.dt_cups @ cups


def strains(rs: Array, rt: Array) -> Array:
    """Green strains: stretch along s, along t, shear; shape (..., 3, G)."""
    out = np.empty((*rs.shape[:-2], 3, rs.shape[-2]))
    out[..., 0, :], out[..., 1, :] = (dot(rs, rs) - 1) / 2, (dot(rt, rt) - 1) / 2
    out[..., 2, :] = dot(rs, rt)
    return out


def strain_changes(piece: Piece, rs: Array, rt: Array, dq: Array) -> Array:
    """Changes of the strains with the unknowns, to first order; (..., 3, G)."""
    ds, dt = piece.ds @ dq, piece.dt @ dq
    out = np.empty((*rs.shape[:-2], 3, rs.shape[-2]))
    out[..., 0, :], out[..., 1, :] = dot(rs, ds), dot(rt, dt)
    out[..., 2, :] = dot(rs, dt) + dot(rt, ds)
    return out


def pulls(piece: Piece, strain: Array, foreseen: Array | None = None) -> Array:
    """What is left of strains beyond the take-up of the weave, shape (..., 3, G).

    Args:
        piece: Matrices of the region.
        strain: Strains, shape (..., 3, G).
        foreseen: Strains that say where the take-up is used up, and to which side;
            by default the strains themselves.
    """
    if not gives(piece):
        return strain
    if foreseen is None:
        return strain - np.clip(strain, piece.low, piece.high)
    beyond = strain - np.clip(foreseen, piece.low, piece.high)
    return np.where(taken_up(piece, foreseen), 0.0, beyond)


def gives(piece: Piece) -> bool:
    """Whether the weave of a region takes up any length."""
    return bool(piece.high.any())


def taken_up(piece: Piece, strain: Array) -> NDArray[np.bool_]:
    """Where the weave takes up all of a strain, shape (..., 3, G)."""
    return (strain > piece.low) & (strain < piece.high)


def next_foreseen(piece: Piece, before: Array, now: Array, share: float) -> Array:
    """Strains foreseen, of which none pulls at once that did not pull before (D8).

    Args:
        piece: Matrices of the region.
        before: Strains foreseen by the step before, shape (..., 3, G).
        now: Strains that the linear step leads to, shape (..., 3, G).
        share: Share of the new ones in what is foreseen, where there is a take-up.
    """
    if not gives(piece):
        return now
    low, high = piece.low, piece.high
    same = ((before >= high) & (now > high)) | ((before <= low) & (now < low))
    edge = np.clip(now, (1 + ROUNDING) * low, (1 + ROUNDING) * high)
    past = now - edge  # a stress of no meaning where the fiber came through the band
    less = edge + np.sign(past) * np.maximum(abs(past) - WIDE * (high - low), 0)
    mixed = before + share * (np.where(same, now, less) - before)
    return np.where(low == high, now, mixed)


def energy(piece: Piece, q: Array, cups: Array, strain: Array) -> Array:
    """Energy of the region, shape (...), in [J]; weight works from q = 0."""
    e = pulls(piece, strain)
    bending = piece.bending @ q / 2 + piece.bending_cups @ cups
    out = dot(q, bending).sum(-1) + dot(cups, piece.cups_bending @ cups).sum(-1) / 2
    work = dot(q, np.broadcast_to(piece.load, q.shape)).sum(-1)
    return out + ((piece.roots * e) ** 2).sum((-1, -2)) / 2 - work


def forces(
    piece: Piece, q: Array, cups: Array, rs: Array, rt: Array, foreseen: Array
) -> Array:
    """Gradient of the energy, shape (..., n, 3), in [N] for values."""
    e = (piece.roots**2 * pulls(piece, strains(rs, rt), foreseen))[..., None]
    along_s = e[..., 0, :, :] * rs + e[..., 2, :, :] * rt
    along_t = e[..., 1, :, :] * rt + e[..., 2, :, :] * rs
    out = piece.bending @ q + piece.bending_cups @ cups - piece.load
    return out + piece.ds.mT @ along_s + piece.dt.mT @ along_t


def stiffness(piece: Piece, rs: Array, rt: Array, strain: Array) -> Array:
    """Second derivative of the energy; unknowns ordered (coordinate, function).

    Args:
        piece: Matrices of the region.
        rs: Derivatives along s, shape (..., G, 3).
        rt: Derivatives along t, shape (..., G, 3).
        strain: Strains that enter, shape (..., 3, G): those of rs and rt for the plain
            tangent, better guesses to gain convergence.

    Returns:
        Symmetric matrices, shape (..., 3 n, 3 n).
    """
    *batch, points, _ = rs.shape
    n = piece.ds.shape[-1]
    root = piece.roots[..., None]
    if gives(piece):
        root = np.where(taken_up(piece, strain)[..., None], 0.0, root)
    rows = np.empty((*batch, 3, points, 3, n))
    for k in range(2):
        first, own = (piece.ds, rs) if k == 0 else (piece.dt, rt)
        rows[..., k, :, :, :] = _outer(own, root[..., k, :, :] * first)
    rows[..., 2, :, :, :] = _outer(rt, root[..., 2, :, :] * piece.ds)
    rows[..., 2, :, :, :] += _outer(rs, root[..., 2, :, :] * piece.dt)
    flat = rows.reshape(*batch, 3 * points, 3 * n)
    out = flat.mT @ flat
    add_to_blocks(out, piece.bending + _geometric(piece, strain))
    return out


def add_to_blocks(matrix: Array, block: Array) -> None:
    """Add a matrix (..., n, n) to the three diagonal blocks of (..., 3 n, 3 n)."""
    n = block.shape[-1]
    for k in range(3):
        part = slice(k * n, (k + 1) * n)
        matrix[..., part, part] += block


def _outer(vectors: Array, rows: Array) -> Array:
    """Vectors (..., G, 3) times rows (..., G, n), shape (..., G, 3, n)."""
    return vectors[..., :, None] * rows[..., None, :]


def _geometric(piece: Piece, strain: Array) -> Array:
    """Stiffness that stresses give one coordinate, shape (..., n, n)."""
    e = (piece.roots**2 * pulls(piece, strain))[..., None]
    along_s = e[..., 0, :, :] * piece.ds + e[..., 2, :, :] * piece.dt
    along_t = e[..., 1, :, :] * piece.dt + e[..., 2, :, :] * piece.ds
    return piece.ds.mT @ along_s + piece.dt.mT @ along_t
