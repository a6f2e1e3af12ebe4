"""How low can one walk: levels of the passes of a height field, and margins from them.

A flood finds, for each sample, the least highest pass on any way from a seed. It sweeps
the samples forward and backward and lowers each level to what its neighbors offer. A
level is always that of a real way, hence never too low; once a sweep changes nothing,
no step of any way can lower one, hence none is too high. Heights above the mold are
smooth: two to five double sweeps do, several times faster than a heap.
"""

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


def pass_level(h: Floats, seed: Bools, eight_connected: bool) -> Floats:
    """Least highest pass on any way from the seed to each sample.

    A way steps from a sample to a neighbor; its level is the largest height on it, both
    ends included.

    Args:
        h: Heights, shape (..., nt, ns), in [m].
        seed: Where ways start, shape (nt, ns) or the shape of `h`.
        eight_connected: Whether a way may step over corners, or over sides alone.

    Returns:
        Pass levels, the shape of `h`, in [m]; infinite where there is no seed at all.
    """
    rows, columns = h.shape[-2:]
    field = np.ascontiguousarray(h, dtype=np.float64).reshape(-1, rows, columns)
    level = np.full((len(field), rows + 2, columns + 2), np.inf)
    inside = level[:, 1:-1, 1:-1]
    inside[...] = np.where(seed, h, np.inf).reshape(field.shape)
    _settle(field, level, eight_connected)
    return inside.reshape(h.shape)


def escape_level(h: Floats, vents: Bools | None = None) -> Floats:
    """Height of the lowest place on the best way from each sample to where air leaves.

    The best way is the one whose lowest place is highest, over sides alone: how wide
    the ply gapes where trapped air would leave.

    Args:
        h: Heights, shape (..., nt, ns), in [m].
        vents: Where air leaves, shape (nt, ns); by default the ply's edge.

    Returns:
        Escape levels, the shape of `h`, in [m].
    """
    vents = edge_mask(h.shape[-2:]) if vents is None else vents
    return -pass_level(-np.asarray(h), vents, eight_connected=False)


def edge_mask(shape: tuple[int, ...]) -> Bools:
    """Samples on the ply's edge, for a grid of shape (nt, ns)."""
    edge = np.ones(shape, dtype=bool)
    edge[1:-1, 1:-1] = False
    return edge


def premature_margins(h: Floats, start: Bools, touch: float, barrier: float) -> Floats:
    """How far each sample is from touching the mold apart from the start.

    A sample is apart if every way to it from the start leads over a hump that rises by
    more than `barrier` above both the sample and the touching height. The least margin
    is at most zero exactly if `front.premature_regions` finds a region.

    Args:
        h: Heights above the laid state, shape (..., nt, ns), in [m].
        start: Samples on the start cup's pad, shape (nt, ns).
        touch: Height up to which a sample touches, in [m].
        barrier: Height by which a hump separates, in [m].

    Returns:
        Margins, the shape of `h`, in [m]; infinite where nothing separates.
    """
    apart = pass_level(h, start, eight_connected=True) > np.maximum(h, touch) + barrier
    return np.where(apart, h - touch, np.inf)


def air_margins(
    h: Floats, touch: float, barrier: float, vents: Bools | None = None
) -> Floats:
    """How far the ply is from closing around each sample.

    A sample lies in a hollow if it is higher, by more than `barrier`, than both the
    touching height and the lowest place on its best way out. The least margin is at
    most zero exactly if `front.air_pockets` finds a pocket.

    Args:
        h: Heights above the laid state, shape (..., nt, ns), in [m].
        touch: Height up to which a sample touches, in [m].
        barrier: Height by which a hollow counts, in [m].
        vents: Where air leaves, shape (nt, ns); by default the ply's edge.

    Returns:
        Margins, the shape of `h`, in [m]; infinite outside hollows.
    """
    escape = escape_level(h, vents)
    hollow = h > np.maximum(escape, touch) + barrier
    return np.where(hollow, escape - touch, np.inf)


def least_margins(
    h: Floats, start: Bools, vents: Bools, touch: float, barrier: float
) -> Floats:
    """Least of `premature_margins` and of `air_margins` of each pose, without fields.

    Args and result are those of `placed_margins`, whose first answer it is.
    """
    return placed_margins(h, start, vents, touch, barrier)[0]


def placed_margins(
    h: Floats, start: Bools, vents: Bools, touch: float, barrier: float
) -> tuple[Floats, NDArray[np.int64]]:
    """Least of `premature_margins` and of `air_margins` of each pose, and where.

    Args:
        h: Heights above the laid state, shape (K, nt, ns), in [m].
        start: Samples on the start cup's pad, shape (nt, ns).
        vents: Where air leaves, shape (nt, ns).
        touch: Height up to which a sample touches, in [m].
        barrier: Height by which a hump or a hollow counts, in [m].

    Returns:
        Premature and air margins, shape (2, K), in [m], infinite for none; and the
        first sample that has each, row * ns + column, shape (2, K), -1 for none.
    """
    least, where = _least(np.ascontiguousarray(h), start, vents, touch, barrier)
    return np.asarray(least), np.asarray(where)


@numba.njit(cache=True, nogil=True)
def _settle(h: Any, level: Any, eight_connected: bool) -> None:  # pragma: no cover
    """Lower the levels until none can be lowered; they carry an infinite rim."""
    for k in range(h.shape[0]):
        _settle_one(h[k], level[k], eight_connected)


@numba.njit(cache=True, nogil=True)
def _settle_one(h: Any, level: Any, eight_connected: bool) -> None:  # pragma: no cover
    """The same of one pose."""
    back_h, back_level = h[::-1, ::-1], level[::-1, ::-1]
    _sweep(h, level, eight_connected)
    while _sweep(back_h, back_level, eight_connected):
        if not _sweep(h, level, eight_connected):
            break


@numba.njit(cache=True, nogil=True)
def _least(
    h: Any, start: Any, vents: Any, touch: float, barrier: float
) -> Any:  # pragma: no cover
    """Least margins, one pose after the other on the same scratch arrays."""
    poses, rows, columns = h.shape
    least, where = np.full((2, poses), np.inf), np.full((2, poses), -1)
    field, level = np.empty((rows, columns)), np.empty((rows + 2, columns + 2))
    for k in range(poses):
        for kind in range(2):
            sign, seed = (1.0, start) if kind == 0 else (-1.0, vents)
            level[:] = np.inf
            for i in range(rows):
                for j in range(columns):
                    field[i, j] = sign * h[k, i, j]
                    if seed[i, j]:
                        level[i + 1, j + 1] = field[i, j]
            _settle_one(field, level, kind == 0)
            for i in range(rows):
                for j in range(columns):
                    one, found = h[k, i, j], sign * level[i + 1, j + 1]
                    high, low = (found, one) if kind == 0 else (one, found)
                    apart = high > max(low, touch) + barrier
                    if apart and low - touch < least[kind, k]:
                        least[kind, k], where[kind, k] = low - touch, i * columns + j
    return least, where


@numba.njit(cache=True, nogil=True)
def _sweep(h: Any, level: Any, eight_connected: bool) -> bool:  # pragma: no cover
    """Lower each level to what the neighbors already passed offer; whether any fell."""
    changed = False
    for i in range(h.shape[0]):
        for j in range(h.shape[1]):
            if level[i + 1, j + 1] > h[i, j]:
                best = min(level[i + 1, j], level[i, j + 1])
                if eight_connected:
                    best = min(best, level[i, j], level[i, j + 2])
                best = max(best, h[i, j])
                if best < level[i + 1, j + 1]:
                    level[i + 1, j + 1] = best
                    changed = True
    return changed
