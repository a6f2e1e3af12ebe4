r"""How far the coupled patch may lie from independent fibers: what `auto` asks first.

Each estimate is a root mean square normal distance over a cell, which is a patch with
its strips, or a strip alone. Where they come from and how they were scaled: D18.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ply.fiber import Array, FiberStatus, Statuses, bubble_height
from ply.grid import CupGrid
from ply.measures import Measures
from ply.sides import strip_bending
from ply.weave import PlyFibers

FLAT = 0.2  # [-] of the relief of the ply beside a cup that is flat; D18
COUPLING = 0.1  # [-] of the change of bow of a patch's middle fibers
SHEAR = 1.0  # [-] of what shear adds to a curved patch
SLIDE = 1.0  # [-] of the bow of the length that a lone strip gains by shear
STIFF = 6e4  # [1/m^2] shear over bending stiffness above which it bows more, D18
BENT_IN_PLANE = 5.0  # [-] a cubic that leaves at an angle a is longer by L a^2 / 5
TWIST = 0.1  # [-] of the bow of lengths by which fibers of a strip differ
LONE_TWIST = 1.0  # [-] the same of a strip that no patch holds
GRAVITY = 0.5  # [-] of the sag of a patch; D18
OPEN = 0.3  # [-] of the largest distance between a strip and its other side
RIVAL = 2.0  # [-] bending energy of the other side over that of a strip's own


class Causes(NamedTuple):
    """Estimates by cause, in [m], one for each cell, shape (..., cells t, cells s).

    Attributes:
        flat: Cups hold the ply flat, while the strips beside them bend.
        coupling: Fibers inside a patch have another length than its strips give them.
        shear: In-plane shear bears on a curved patch, or straightens a lone strip.
        twist: The fibers of a strip ask for different lengths.
        open: Slack lets a strip bulge to its other side for little energy.
        stretch: Cups are farther apart than a fiber reaches.
        gravity: Patches sag more than the strips around them.
    """

    flat: Array
    coupling: Array
    shear: Array
    twist: Array
    open: Array
    stretch: Array
    gravity: Array


def causes(
    grid: CupGrid,
    fibers: PlyFibers,
    turned: PlyFibers,
    found: Measures,
    heavy: ArrayLike = 0.0,
    stiffness: float = STIFF,
) -> Causes:
    """Estimate what the coupled patch would change.

    Args:
        grid: The cup array.
        fibers: Modal fibers of the poses, three a strip.
        turned: The same asked to bulge to the other side.
        found: Measures of the same poses.
        heavy: Sag of each cell whose gravity is modeled, 0 of others, in [m].
        stiffness: Shear stiffness over bending stiffness, in [1/m^2].

    Returns:
        The estimates; their sum bounds the difference.
    """
    around, lone = partial(largest_around, grid), min(grid.rows, grid.columns) == 1
    lengths = grid.s_length, grid.t_length
    curves = (fibers.s, turned.s), (fibers.t, turned.t)
    missing = fibers.s_natural - fibers.s_used, fibers.t_natural - fibers.t_used
    twist = [_twist(e, L) for e, L in zip(missing, lengths, strict=True)]
    rivals = [_rival(own, other) for own, other in curves]
    over = _stretch(fibers.s_status, fibers.s_excess)
    stretch = around(over, _stretch(fibers.t_status, fibers.t_excess))
    if lone:
        angles = zip((found.s_shear, found.t_shear), lengths, strict=True)
        slides = [bubble_height(L * a**2 / BENT_IN_PLANE, L) for a, L in angles]
        flat = coupling = np.zeros_like(stretch)
        shear = SLIDE * max(1.0, stiffness / STIFF) ** 0.5 * around(*slides)
    else:
        bends = [_end_curvature(c[0], L) for c, L in zip(curves, lengths, strict=True)]
        flat = FLAT * grid.half_width**2 / 2 * around(*bends)
        coupling, shear = COUPLING * found.coupling, SHEAR * found.shear_effect
    twisted = (LONE_TWIST if lone else TWIST) * around(*twist)
    opened = OPEN * around(*rivals)
    return Causes(
        flat, coupling, shear, twisted, opened, stretch, GRAVITY * np.asarray(heavy)
    )


def tipping(grid: CupGrid, parts: Causes) -> Array:
    """How far a small load may tip cells whose shape their cups hardly decide.

    Args:
        grid: The cup array.
        parts: The estimates.

    Returns:
        Distances, in [m]: to other sides of strips, and bows of either sign.
    """
    share = LONE_TWIST if min(grid.rows, grid.columns) == 1 else TWIST
    bows = parts.open / OPEN + parts.twist / share
    return np.asarray(bows + parts.shear + parts.stretch)


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


def _twist(missing: Array, length: float) -> Array:
    """Bow of the length by which the fibers of a strip differ in need, in [m]."""
    return bubble_height(missing.max(axis=-1) - missing.min(axis=-1), length)


def _rival(own: Array, other: Array) -> Array:
    """Distance in the middle to the other side, 0 if that takes much energy, in [m]."""
    middle = 0.5 ** np.arange(own.shape[-2]) @ (own - other)
    distance = np.linalg.norm(middle, axis=-1).max(axis=-1)
    near = strip_bending(other) < RIVAL * strip_bending(own)
    return np.where(near, distance, 0.0)


def _stretch(status: Statuses, excess: Array) -> Array:
    """Largest overstretch of a strip's fibers, in [m]."""
    over = np.where(status == FiberStatus.OVERSTRETCHED, excess, 0.0)
    return np.asarray(over.max(axis=-1))
