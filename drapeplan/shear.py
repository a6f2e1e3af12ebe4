"""Shear angles of a net: pi/2 minus the angle from s to t."""

import numpy as np

from drapeplan.surfaces import Array


def corner_shear(points: Array) -> Array:
    """Shear at the four corners of each cell.

    In a cell of four equal sides opposite corners have equal angles; two are sharp
    where two are blunt. The angle from s to t is the inner angle at the first and the
    third corner, and its supplement at the others: hence KinDrape's alternating signs.

    Args:
        points: Nodes of a net, shape (..., rows, columns, 3), in [m].

    Returns:
        Shear at corners (i, j), (i, j + 1), (i + 1, j + 1) and (i + 1, j) of cell
        (i, j), shape (..., rows - 1, columns - 1, 4), in [rad].
    """
    s, t = np.diff(points, axis=-2), np.diff(points, axis=-3)
    s /= np.linalg.norm(s, axis=-1, keepdims=True)
    t /= np.linalg.norm(t, axis=-1, keepdims=True)
    near, far = s[..., :-1, :, :], s[..., 1:, :, :]
    left, right = t[..., :-1, :], t[..., 1:, :]
    pairs = ((near, left), (near, right), (far, right), (far, left))
    cosine = np.stack([np.sum(a * b, axis=-1) for a, b in pairs], axis=-1)
    return np.arcsin(np.clip(cosine, -1, 1))


def cell_shear(points: Array) -> Array:
    """Mean shear of the corners of each cell, KinDrape's measure with its sign kept.

    Args:
        points: Nodes of a net, shape (..., rows, columns, 3), in [m].

    Returns:
        Shear, shape (..., rows - 1, columns - 1), in [rad].
    """
    return np.mean(corner_shear(points), axis=-1)


def node_shear(points: Array) -> Array:
    """Mean shear of the corners that meet at each node.

    Inside the net these are central differences, so the error falls with the spacing
    squared; on its edge it falls with the spacing.

    Args:
        points: Nodes of a net, shape (..., rows, columns, 3), in [m].

    Returns:
        Shear, shape (..., rows, columns), in [rad].
    """
    corner = corner_shear(points)
    rows, columns = points.shape[-3], points.shape[-2]
    total, count = np.zeros(points.shape[:-1]), np.zeros((rows, columns))
    for k, (di, dj) in enumerate(((0, 0), (0, 1), (1, 1), (1, 0))):
        window = slice(di, rows - 1 + di), slice(dj, columns - 1 + dj)
        total[(..., *window)] += corner[..., k]
        count[window] += 1
    return total / count
