"""Gravity on fibers that the weave lets have any length: a sag that adds up (D19).

Within the take-up a fiber carries no force along itself, so the weight bends it like a
beam that its two cups clamp, whatever else bends it.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ply.errors import PlyError
from ply.fiber import BULGE, Array, LengthStatus, Statuses, dot
from ply.grid import CupGrid
from ply.weave import PlyFibers

BEAM = 24.0  # [-] q x^2 (L - x)^2 / (24 D): a beam clamped at both ends


def with_sag(
    grid: CupGrid,
    fibers: PlyFibers,
    rotations: Array,
    weight: ArrayLike,
    stiffness: float,
) -> PlyFibers:
    """Fibers that sag under gravity wherever they are within the take-up.

    Args:
        grid: The cup array.
        fibers: Fibers of cups, made with a take-up and without gravity.
        rotations: Cup frames of the same poses, shape (..., n_cups, 3, 3).
        weight: Weight of the ply per area, a vector, shape (3,), in [N/m^2].
        stiffness: Bending stiffness, in [N m].

    Returns:
        The fibers; those outside the take-up are left as they are.

    Raises:
        PlyError: The weight is no vector, or the stiffness is not positive.
    """
    weight = np.asarray(weight, dtype=float)
    if not (weight.shape == (3,) and np.isfinite(weight).all()):
        raise PlyError("weight", "is not three finite numbers")
    if not (np.isfinite(stiffness) and stiffness > 0):
        raise PlyError("stiffness", f"{stiffness:g} N m", "use more than 0")
    batch = rotations.shape[:-3]
    n = rotations[..., 2].reshape(*batch, grid.rows, grid.columns, 3)
    load = weight / (BEAM * stiffness)
    s = n[..., :-1, :] + n[..., 1:, :]
    t = n[..., :-1, :, :] + n[..., 1:, :, :]
    return replace(
        fibers,
        s=_sagging(fibers.s, fibers.s_band, s, load * grid.s_length**4),
        t=_sagging(fibers.t, fibers.t_band, t, load * grid.t_length**4),
    )


def _sagging(curves: Array, band: Statuses, normals: Array, load: Array) -> Array:
    """Curves of one family with the sag; normals have any length but 0."""
    share = np.divide(
        *(normals @ load, dot(normals, normals)),
        out=np.zeros(normals.shape[:-1]),
        where=dot(normals, normals) > 0,
    )
    sag = (share[..., None] * normals)[..., None, None, :]
    free = (band == LengthStatus.IN_BAND)[..., None, None]
    out = np.array(curves)
    out[..., : len(BULGE), :] += np.where(free, BULGE[:, None] * sag, 0.0)
    return out
