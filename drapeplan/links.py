"""Links between neighboring cups: who is linked, their lengths, their angles."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from drapeplan.surfaces import AbstractSurface, Array

Indices = NDArray[np.int64]


@lru_cache
def neighbor_pairs(rows: int, columns: int) -> tuple[Indices, Indices]:
    """Indices of neighboring cups, in row-major order of the first.

    Args:
        rows: Number of cups along t.
        columns: Number of cups along s.

    Returns:
        Pairs along s, shape (rows * (columns - 1), 2), and pairs along t, shape
        ((rows - 1) * columns, 2). All links are the first followed by the second.
    """
    k = np.arange(rows * columns).reshape(rows, columns)
    s = np.stack([k[:, :-1].ravel(), k[:, 1:].ravel()], axis=1)
    t = np.stack([k[:-1].ravel(), k[1:].ravel()], axis=1)
    s.flags.writeable = t.flags.writeable = False
    return s, t


@lru_cache
def corner_links(rows: int, columns: int) -> Indices:
    """Links along s and t that share a cup, one pair for each corner of each cell.

    Args:
        rows: Number of cups along t.
        columns: Number of cups along s.

    Returns:
        Indices into all links, shape (4 * (rows - 1) * (columns - 1), 2).
    """
    s = np.arange(rows * (columns - 1)).reshape(rows, columns - 1)
    t = s.size + np.arange((rows - 1) * columns).reshape(rows - 1, columns)
    corners = [
        np.stack([along_s.ravel(), along_t.ravel()], axis=1)
        for along_s in (s[:-1], s[1:])
        for along_t in (t[:, :-1], t[:, 1:])
    ]
    return np.concatenate(corners)


@dataclass(frozen=True)
class Links:
    """All links of a net at one shape of it.

    Attributes:
        pairs: Indices of the cups at their ends, shape (m, 2).
        chords: From first to second cup, shape (m, 3), in [m].
        error: Length less the pitch, shape (m,), in [m].
        jacobian: Derivative of the error by xy, flattened, shape (m, 2 n).
        tangents: Derivative of the positions by their x and y, shape (n, 2, 3).
    """

    pairs: Indices
    chords: Array
    error: Array
    jacobian: Array
    tangents: Array


def measure_links(
    surface: AbstractSurface,
    xy: Array,
    rows: int,
    columns: int,
    pitch: float,
    offsets: Array | None = None,
) -> Links:
    """Lengths of all links and their derivatives.

    Args:
        surface: Surface the cups lie on.
        xy: Plan view of the cups, shape (n, 2), in [m].
        rows: Number of cups along t.
        columns: Number of cups along s.
        pitch: Length the links should have, in [m].
        offsets: Height of each cup above the surface, shape (n,), in [m].

    Returns:
        The links.
    """
    pairs = np.concatenate(neighbor_pairs(rows, columns))
    i, j = pairs.T
    z, zx, zy = surface.evaluate(xy[:, 0], xy[:, 1])
    points = np.column_stack([xy, z if offsets is None else z + offsets])
    tangents = np.zeros((len(xy), 2, 3))
    tangents[:, 0, 0] = tangents[:, 1, 1] = 1
    tangents[:, 0, 2], tangents[:, 1, 2] = zx, zy
    chords = points[j] - points[i]
    length = np.sqrt(np.sum(chords**2, axis=1))
    unit = (chords / length[:, None])[:, :, None]
    jacobian = np.zeros((len(pairs), len(xy), 2))
    link = np.arange(len(pairs))
    jacobian[link, i] = -(tangents[i] @ unit)[..., 0]
    jacobian[link, j] = (tangents[j] @ unit)[..., 0]
    flat = jacobian.reshape(len(pairs), -1)
    return Links(pairs, chords, length - pitch, flat, tangents)


def corner_cosines(
    links: Links, rows: int, columns: int, pitch: float
) -> tuple[Array, Array]:
    """Cosines of the angles between s and t links at all corners, to be zero.

    Args:
        links: Links at the shape in question.
        rows: Number of cups along t.
        columns: Number of cups along s.
        pitch: Length of the links, in [m].

    Returns:
        Chord products over the squared pitch, shape (c,), and their derivatives by xy,
        flattened, shape (c, 2 n), in [1/m].
    """
    corners = corner_links(rows, columns)
    a, b = links.chords[corners[:, 0]], links.chords[corners[:, 1]]
    value = np.sum(a * b, axis=1) / pitch**2
    jacobian = np.zeros((len(corners), len(links.tangents), 2))
    corner = np.arange(len(corners))
    for own, other in ((0, b), (1, a)):
        for end, sign in ((0, -1), (1, 1)):
            cup = links.pairs[corners[:, own], end]
            slope = (links.tangents[cup] @ other[:, :, None])[..., 0]
            jacobian[corner, cup] += sign * slope / pitch**2
    return value, jacobian.reshape(len(corners), -1)
