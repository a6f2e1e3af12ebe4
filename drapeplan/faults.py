"""Faults by labels: whether a window of the ply is out of order, pose by pose.

Samples that hang together are joined by union-find in one pass over the window. What
lies outside enters as a ring of samples around it, each with the number of its part
outside, or none; parts that the window joins become one.
"""

from enum import IntFlag
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from drapeplan.flood import Bools, Floats

ANCHORED = 1  # bit of a part: it holds the start, or air leaves it
TOLD = 2  # bit of a part: the window touches in it, or it is a deep hollow


class Fault(IntFlag):
    """What goes wrong in a pose; several can at once."""

    PREMATURE = 1
    AIR_POCKET = 2
    PENETRATION = 4
    PAD_PENETRATION = 8


class Ring(NamedTuple):
    """Parts outside a window, as seen from the samples around it, for K poses.

    Attributes:
        part: Part of each sample around the window, -1 for none, shape
            (K, nt + 2, ns + 2); only its rim is read.
        bits: ANCHORED and TOLD of each part, shape (K, parts).
    """

    part: NDArray[np.int32]
    bits: NDArray[np.uint8]


class Samples(NamedTuple):
    """What a window's samples are in each of K poses, shapes (K, nt, ns).

    Attributes:
        laid: All their cups are placed.
        pads: They are on the pads of landing cups.
    """

    laid: Bools
    pads: Bools


@numba.njit(cache=True, nogil=True)
def window_faults(
    h: Floats,
    samples: Samples,
    start: Bools,
    vents: Bools,
    contact: Ring,
    air: Ring,
    limits: tuple[float, float, float, float],
) -> NDArray[np.uint8]:  # pragma: no cover
    """Faults of many tries of K poses.

    Args:
        h: Heights above the laid state, shape (tries, K, nt, ns), in [m].
        samples: What the samples are in each pose.
        start: Samples on the start cup's pad, shape (nt, ns).
        vents: Where air leaves, shape (nt, ns).
        contact: Parts outside up to touch + barrier; anchored with the start pad.
        air: Parts outside above touch; anchored where air leaves, told where deep.
        limits: Touch, barrier, penetration and pad penetration, in [m].

    Returns:
        Fault flags, shape (tries, K).
    """
    tries, poses, nt, ns = h.shape
    touch, top = limits[0], limits[0] + limits[1]
    out = np.zeros((tries, poses), dtype=np.uint8)
    size = (nt + 2) * (ns + 2)
    node = np.empty(size, dtype=np.int32)
    parts = max(contact.bits.shape[1], air.bits.shape[1])
    parent = np.empty(size + parts, dtype=np.int32)
    bits = np.empty(size + parts, dtype=np.uint8)
    for n in range(tries):
        for k in range(poses):
            one = h[n, k]
            found = _depths(one, samples.laid[k], samples.pads[k], limits)
            _enter(node, parent, bits, contact.part[k], contact.bits[k])
            for i in range(nt):
                for j in range(ns):
                    if one[i, j] <= top:
                        bit = ANCHORED if start[i, j] else 0
                        bit |= TOLD if one[i, j] <= touch else 0
                        _add(node, parent, bits, i, j, ns + 2, bit)
            _join(node, parent, bits, nt + 2, ns + 2, True)
            if _loose(node, parent, bits, one, touch, False):
                found |= 1
            _enter(node, parent, bits, air.part[k], air.bits[k])
            for i in range(nt):
                for j in range(ns):
                    if one[i, j] > touch:
                        bit = ANCHORED if vents[i, j] else 0
                        bit |= TOLD if one[i, j] > top else 0
                        _add(node, parent, bits, i, j, ns + 2, bit)
            _join(node, parent, bits, nt + 2, ns + 2, False)
            if _loose(node, parent, bits, one, touch, True):
                found |= 2
            out[n, k] = found
    return out


@numba.njit(cache=True)
def _depths(h: Any, laid: Any, pads: Any, limits: Any) -> int:  # pragma: no cover
    """Faults of samples that sink too deep."""
    found = 0
    for i in range(h.shape[0]):
        for j in range(h.shape[1]):
            if not laid[i, j]:
                if pads[i, j]:
                    if -h[i, j] > limits[3]:
                        found |= 8
                elif -h[i, j] > limits[2]:
                    found |= 4
    return found


@numba.njit(cache=True)
def _enter(
    node: Any, parent: Any, bits: Any, part: Any, part_bits: Any
) -> None:  # pragma: no cover
    """Clear the window and enter the parts outside."""
    rows, columns = part.shape
    size = rows * columns
    node[:] = -1
    for n in range(len(part_bits)):
        parent[size + n] = size + n
        bits[size + n] = part_bits[n]
    for i in range(rows):
        step = 1 if i in (0, rows - 1) else columns - 1
        for j in range(0, columns, step):
            if part[i, j] >= 0:
                node[i * columns + j] = size + part[i, j]


@numba.njit(cache=True, inline="always")
def _add(
    node: Any, parent: Any, bits: Any, i: int, j: int, columns: int, bit: int
) -> None:  # pragma: no cover
    """Enter a sample of the window as a part of its own."""
    place = (i + 1) * columns + j + 1
    node[place] = parent[place] = place
    bits[place] = bit


@numba.njit(cache=True)
def _join(
    node: Any, parent: Any, bits: Any, rows: int, columns: int, corners: bool
) -> None:  # pragma: no cover
    """Join what hangs together, over sides or over corners, too."""
    for i in range(rows):
        for j in range(columns):
            place = i * columns + j
            if node[place] < 0:
                continue
            if j > 0 and node[place - 1] >= 0:
                _unite(node[place], node[place - 1], parent, bits)
            if i == 0:
                continue
            above = place - columns
            if node[above] >= 0:
                _unite(node[place], node[above], parent, bits)
            elif not corners:
                continue
            if corners and j > 0 and node[above - 1] >= 0:
                _unite(node[place], node[above - 1], parent, bits)
            if corners and j < columns - 1 and node[above + 1] >= 0:
                _unite(node[place], node[above + 1], parent, bits)


@numba.njit(cache=True)
def _root(n: int, parent: Any) -> int:  # pragma: no cover
    """Representative of a part; halves the way to it."""
    while parent[n] != n:
        parent[n] = parent[parent[n]]
        n = parent[n]
    return n


@numba.njit(cache=True)
def _unite(a: int, b: int, parent: Any, bits: Any) -> None:  # pragma: no cover
    """Make two parts one."""
    a, b = _root(a, parent), _root(b, parent)
    if a != b:
        low, high = min(a, b), max(a, b)
        parent[high] = low
        bits[low] |= bits[high]


@numba.njit(cache=True)
def _loose(
    node: Any, parent: Any, bits: Any, h: Any, touch: float, air: bool
) -> bool:  # pragma: no cover
    """Whether the window has a sample in a part that is told and not anchored.

    Of contacts, a touching one.
    """
    rows, columns = h.shape
    for i in range(rows):
        for j in range(columns):
            place = (i + 1) * (columns + 2) + j + 1
            if node[place] >= 0 and (air or h[i, j] <= touch):
                if bits[_root(place, parent)] & 3 == TOLD:
                    return True
    return False
