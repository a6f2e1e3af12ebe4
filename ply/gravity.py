r"""What gravity does to a held ply, in closed form: sag between cups, droop of edges.

Both are upper estimates of plates by beams: docs/derivations.md, D7.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ply.fiber import Array
from ply.grid import CupGrid

EARTH = (0.0, 0.0, -9.81)  # [m/s^2]
CLAMPED_SPAN = 384.0  # [-] q L^4 / (384 D): middle of a strip clamped at both ends
PATCH_SAG = 2.8  # [-] patch over strip: plate on square cups, d / L = 2 / 7, D7


class Sags(NamedTuple):
    """Gravity sag in the middle of spans of single strips, and of patches, in [m].

    Attributes:
        s: Of spans along s, shape (..., rows, columns - 1).
        t: Of spans along t, shape (..., rows - 1, columns).
        patch: Of patches, shape (..., rows - 1, columns - 1).
    """

    s: Array
    t: Array
    patch: Array


def gravity_sags(
    grid: CupGrid, rotations: Array, weight: ArrayLike, bending: float
) -> Sags:
    """Estimate how far the ply sags between its cups.

    Args:
        grid: The cup array.
        rotations: Cup frames, shape (..., n_cups, 3, 3).
        weight: Weight of the ply per area, a vector, shape (3,), in [N/m^2].
        bending: Bending stiffness, in [N m].

    Returns:
        The sags, without a sign.
    """
    batch = np.shape(rotations)[:-3]
    load = abs(np.asarray(rotations)[..., 2] @ np.asarray(weight, dtype=float))
    load = load.reshape(*batch, grid.rows, grid.columns)
    s = clamped_sag((load[..., :-1] + load[..., 1:]) / 2, grid.s_length, bending)
    t_load = (load[..., :-1, :] + load[..., 1:, :]) / 2
    t = clamped_sag(t_load, grid.t_length, bending)
    return Sags(s, t, PATCH_SAG * around(s, t))


def clamped_sag(load: ArrayLike, length: ArrayLike, bending: float) -> Array:
    """Sag in the middle of a strip clamped at both ends: q L^4 / (384 D).

    Args:
        load: Force an area along the normal, shape (...), in [N/m^2].
        length: Free length, shape (...), in [m].
        bending: Bending stiffness, in [N m].

    Returns:
        Sags, shape (...), in [m].
    """
    return np.asarray(load) * np.asarray(length) ** 4 / (CLAMPED_SPAN * bending)


def cantilever_droop(
    y: ArrayLike, overhang: ArrayLike, load: ArrayLike, bending: float
) -> Array:
    """Droop of ply beyond an outer cup, which it leaves along the cup's tangent.

    Args:
        y: Distances beyond the cup's edge, shape (...), in [m]; from 0 to the overhang.
        overhang: Ply beyond the edge, shape (...), in [m].
        load: Force an area along the normal, shape (...), in [N/m^2].
        bending: Bending stiffness, in [N m].

    Returns:
        q y^2 (y^2 - 4 l y + 6 l^2) / (24 D), shape (...), in [m], along the load; at
        the end q l^4 / (8 D).
    """
    y, end = np.asarray(y, dtype=float), np.asarray(overhang, dtype=float)
    shape = y**2 * (y**2 - 4 * end * y + 6 * end**2)
    return np.asarray(load) * shape / (24 * bending)


def around(s: Array, t: Array) -> Array:
    """Largest values of the four spans around each patch.

    Args:
        s: Values of spans along s, shape (..., rows, columns - 1).
        t: Values of spans along t, shape (..., rows - 1, columns).

    Returns:
        Values, shape (..., rows - 1, columns - 1).
    """
    along_s = np.maximum(s[..., :-1, :], s[..., 1:, :])
    return np.maximum(along_s, np.maximum(t[..., :, :-1], t[..., :, 1:]))
