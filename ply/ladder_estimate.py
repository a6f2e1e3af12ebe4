r"""How far the coupled patch may lie from independent fibers: what `auto` asks first.

Each estimate is a root mean square normal distance over a cell, which is a patch with
its strips, or a strip alone. Where they come from and how they were scaled: D17.
"""

from typing import NamedTuple

import numpy as np

from ply.fiber import Array, FiberStatus, bubble_height
from ply.grid import CupGrid
from ply.measures import Measures
from ply.weave import PlyFibers

FLAT = 0.3  # [-] of the relief of the ply beside a cup that is flat; D17
COUPLING = 0.1  # [-] of the change of bow of a patch's middle fibers
SHEAR = 1.0  # [-] of what shear adds to a curved patch
TWIST = 1.0  # [-] of the bow of lengths by which fibers of a strip differ
OPEN = 0.5  # [-] of the largest distance between a strip and its other side


class Causes(NamedTuple):
    """Estimates by cause, in [m], one for each cell, shape (..., cells t, cells s).

    Attributes:
        flat: Cups hold the ply flat, while the strips beside them bend.
        coupling: Fibers inside a patch have another length than its strips give them.
        shear: In-plane shear bears on a curved patch.
        twist: The fibers of a strip ask for different lengths.
        open: Slack lets a strip bulge to its other side as well.
        stretch: Cups are farther apart than a fiber reaches.
    """

    flat: Array
    coupling: Array
    shear: Array
    twist: Array
    open: Array
    stretch: Array


def causes(
    grid: CupGrid, fibers: PlyFibers, turned: PlyFibers, found: Measures
) -> Causes:
    """Estimate what the coupled patch would change.

    Args:
        grid: The cup array.
        fibers: Modal fibers of the poses, three a strip.
        turned: The same asked to bulge to the other side.
        found: Measures of the same poses.

    Returns:
        The estimates; their sum bounds the difference.
    """
    lengths = grid.s_length, grid.t_length
    families = (fibers.s, fibers.t), (turned.s, turned.t)
    ends = [_end_curvature(a, L) for a, L in zip(families[0], lengths, strict=True)]
    naturals = fibers.s_natural, fibers.t_natural
    twists = [_twist(n, L) for n, L in zip(naturals, lengths, strict=True)]
    apart = [_distance(a, b) for a, b in zip(*families, strict=True)]
    over = [
        np.where(status == FiberStatus.OVERSTRETCHED, excess, 0.0).max(axis=-1)
        for status, excess in (
            (fibers.s_status, fibers.s_excess),
            (fibers.t_status, fibers.t_excess),
        )
    ]
    twist = TWIST * largest_around(grid, *twists)
    lone = min(grid.rows, grid.columns) == 1
    relief = 0.0 if lone else FLAT * grid.half_width**2 / 2
    return Causes(
        relief * largest_around(grid, *ends),
        np.zeros_like(twist) if lone else COUPLING * found.coupling,
        np.zeros_like(twist) if lone else SHEAR * found.shear_effect,
        twist,
        OPEN * largest_around(grid, *apart),
        largest_around(grid, *over),
    )


def largest_around(grid: CupGrid, s: Array, t: Array) -> Array:
    """Largest value of the strips of each cell.

    Args:
        grid: The cup array.
        s: Values of the strips along s, shape (..., rows, columns - 1).
        t: Values of the strips along t, shape (..., rows - 1, columns).

    Returns:
        Values, shape (..., cells along t, cells along s).
    """
    if grid.rows == 1 or grid.columns == 1:
        return s if grid.rows == 1 else t
    s = np.maximum(s[..., :-1, :], s[..., 1:, :])
    return np.maximum(s, np.maximum(t[..., :, :-1], t[..., :, 1:]))


def _end_curvature(curves: Array, length: float) -> Array:
    """Largest second derivative at both ends of a strip's fibers, in [1/m]."""
    k = np.arange(curves.shape[-2])
    second = np.stack([2.0 * (k == 2), k * (k - 1.0)])  # at u = 0 and u = 1
    size = np.linalg.norm(second @ curves, axis=-1) / length**2
    return np.asarray(size.max(axis=(-1, -2)))


def _twist(natural: Array, length: float) -> Array:
    """Bow of the length by which the fibers of a strip differ, in [m]."""
    return bubble_height(natural.max(axis=-1) - natural.min(axis=-1), length)


def _distance(a: Array, b: Array) -> Array:
    """Largest distance in the middle of two strips' fibers, in [m]."""
    middle = 0.5 ** np.arange(a.shape[-2]) @ (a - b)
    return np.asarray(np.linalg.norm(middle, axis=-1).max(axis=-1))
