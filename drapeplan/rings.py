"""Rings: how far each cup is from the front, and which way is outward there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def ring_of(rows: int, columns: int, placed: Mask, landing: Mask) -> NDArray[np.int_]:
    """Ring of each cup: 0 placed, 1 landing, then one more a cup further out.

    Args:
        rows: Cups along t.
        columns: Cups along s.
        placed: Cups on the mold, shape (n,).
        landing: Cups on their way down, shape (n,).

    Returns:
        Rings by king's moves, shape (n,); 1 everywhere if no cup stands or lands.
    """
    down = placed | landing
    if not down.any():
        return np.ones(len(placed), dtype=int)
    cell = np.stack(np.divmod(np.arange(rows * columns), columns), axis=1)
    distance = np.abs(cell[:, None] - cell[down]).max(axis=-1).min(axis=1)
    return np.where(placed, 0, distance + 1)


def outward(rows: int, columns: int, placed: Mask) -> Array:
    """Direction on the grid away from the nearest placed cups.

    Args:
        rows: Cups along t.
        columns: Cups along s.
        placed: Cups on the mold, shape (n,).

    Returns:
        Unit vectors along (s, t), shape (n, 2); zero for placed cups and where none is
        placed.
    """
    cell = np.stack(np.divmod(np.arange(rows * columns), columns)[::-1], axis=1)
    away = np.zeros((len(placed), 2))
    if placed.any():
        apart = (cell[:, None] - cell[placed]).astype(float)
        square = (apart**2).sum(axis=-1)
        nearest = square == square.min(axis=1, keepdims=True)
        away = (apart * nearest[..., None]).sum(axis=1)
    size = np.linalg.norm(away, axis=1, keepdims=True)
    unit: Array = np.where(size > 0, away / np.where(size > 0, size, 1.0), 0.0)
    unit[placed] = 0.0
    return unit


def toe_down(rotations: Array, requested: Array, directions: Array) -> Array:
    """How far each cup's outer edge hangs lower than its request.

    Args:
        rotations: Cup frames, shape (..., n, 3, 3).
        requested: Cup frames asked for, of the same shape.
        directions: Outward along (s, t), shape (n, 2), as from `outward`.

    Returns:
        Angles, positive toe-down, shape (..., n), in [rad]; zero without a direction.
    """
    along = (requested[..., :2] @ directions[..., None])[..., 0]
    lean = rotations[..., 2] - requested[..., 2]
    return np.arcsin(np.clip((lean * along).sum(axis=-1), -1.0, 1.0))
