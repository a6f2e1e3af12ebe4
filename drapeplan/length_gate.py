"""Length gate: fibers whose cups ask for lengths that the weave does not take up.

It rests on cup poses alone, before any shape: what the cups ask for is the natural
length of each outer fiber of a strip, all along the path. Surplus beyond the take-up
bows the ply out. A fiber that is too short cannot bow: it holds its cups back, or slips
out from under them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drapeplan.cell import Cell
from drapeplan.closures import Chords
from drapeplan.track import Track
from ply.fiber import LengthStatus, bubble_height
from ply.shape import PlyFibers
from urdf.sidecar import neighbor_pairs

Array = NDArray[np.float64]

DIGITS = 9  # decimals of the numbers in a verdict
EDGES = [0, -1]  # fibers of a strip over which chords are measured
TOLD = 40  # [-] most fibers that are told one by one


def judge_lengths(cell: Cell, track: Track, fibers: PlyFibers) -> dict[str, Any]:
    """Fiber lengths that the held ply asks for, against the take-up band.

    Args:
        cell: Robot, mold and ply.
        track: The drape.
        fibers: The ply's fibers at its first waypoints, up to the end of the wave.

    Returns:
        Plain data; `infeasible` has the fibers that leave the band, at most TOLD of
        `infeasible_count`, the worst first: the cups that they join, when and for how
        long, and what comes of it.
    """
    L, take_up = cell.sampling.grid.span, cell.scene.ply.take_up_mm * 1e-3
    count = len(fibers.s_natural)
    chords = Chords(track.robot).values(*(pose[:count] for pose in track.poses))
    natural = _joined(fibers.s_natural[..., EDGES], fibers.t_natural[..., EDGES])
    band = _joined(fibers.s_band[..., EDGES], fibers.t_band[..., EDGES])
    change, outside = natural - L, band != LengthStatus.IN_BAND
    beyond = np.abs(change).max(axis=0, where=outside, initial=0.0)
    guilty = np.flatnonzero(outside.any(axis=0))
    guilty = guilty[np.argsort(-beyond[guilty], kind="stable")]
    lasts = np.diff(track.time[: count + 1], append=track.time[-1])[:count]
    return {
        "good": not guilty.size,
        "take_up_mm": cell.scene.ply.take_up_mm,
        "longest_need_mm": _number(1e3 * change.max()),
        "largest_surplus_mm": _number(-1e3 * change.min()),
        "longest_chord_mm": _number(1e3 * chords.max()),
        "infeasible_count": int(guilty.size),
        "infeasible": [
            {
                **_fiber(cell, int(i)),
                **_when(outside[:, i], np.abs(change[:, i]), lasts),
                "need_mm": _number(1e3 * change[:, i].max()),
                "surplus_mm": _number(-1e3 * change[:, i].min()),
                "short_mm": _number(1e3 * max(0.0, change[:, i].max() - take_up)),
                "bubble_mm": _number(
                    1e3 * float(bubble_height(-change[:, i].min() - take_up, L))
                ),
            }
            for i in guilty[:TOLD]
        ],
    }


def _when(outside: NDArray[np.bool_], off: Array, lasts: Array) -> dict[str, Any]:
    """First, last and worst waypoint of a fiber that leaves the band, and for how long.

    Args:
        outside: Whether it does, shape (K,).
        off: How far it is off its length, shape (K,), in [m].
        lasts: Time from each waypoint to the next, shape (K,), in [s].
    """
    at = np.flatnonzero(outside)
    return {
        "waypoint": int(at[0]),
        "last_waypoint": int(at[-1]),
        "worst_waypoint": int(at[off[at].argmax()]),
        "duration_s": _number(lasts[at].sum()),
    }


def _fiber(cell: Cell, index: int) -> dict[str, Any]:
    """A fiber by its index: a name, and the cups that it joins."""
    grid = cell.grid
    pair, side = divmod(index, 2)
    cups = neighbor_pairs(grid.rows, grid.columns)[pair]
    first, second = (divmod(int(cup), grid.columns) for cup in cups)
    family = "s" if first[0] == second[0] else "t"
    offset = (-1e3 if side == 0 else 1e3) * grid.half_width
    name = f"{family} fiber {first}-{second}, {offset:+g} mm"
    return {"fiber": name, "cups": [list(first), list(second)]}


def _joined(s: NDArray[Any], t: NDArray[Any]) -> NDArray[Any]:
    """Both families in the order of the interlinks, (K, ...) to (K, n_fibers)."""
    return np.concatenate([s.reshape(len(s), -1), t.reshape(len(t), -1)], axis=1)


def _number(value: float) -> float:
    """Plain rounded number, no negative zero."""
    return round(float(value), DIGITS) + 0.0
