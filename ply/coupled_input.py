"""Cup poses as they come, checked and brought to one batch axis."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ply.errors import PlyError
from ply.fiber import Array

ROTATION = 1e-6  # [-] departure from a rotation that is the rounding of a file
FARTHEST = 10.0  # [-] distance of two cups over the pitch that is an error


def flat_poses(
    positions: ArrayLike, rotations: ArrayLike, sides: ArrayLike | None, n_strips: int
) -> tuple[Array, Array, Array, tuple[int, ...]]:
    """Inputs with one batch axis, and the batch shape that they stand for."""
    chosen = np.zeros(n_strips) if sides is None else sides
    n_cups = 4 if n_strips == 4 else 2
    given = {
        "positions": (positions, (n_cups, 3)),
        "rotations": (rotations, (n_cups, 3, 3)),
        "sides": (chosen, (n_strips,)),
    }
    arrays, batches = [], []
    for name, (value, tail) in given.items():
        array = np.asarray(value, dtype=float)
        if array.shape[-len(tail) :] != tail:
            raise PlyError(name, f"shape {array.shape} does not end in {tail}")
        arrays.append(array)
        batches.append(array.shape[: -len(tail)])
    try:
        batch = np.broadcast_shapes(*batches)
    except ValueError:
        raise PlyError("batch axes", f"{batches} do not fit together") from None
    p, frames, chosen = (
        np.broadcast_to(a, (*batch, *tail)).reshape(-1, *tail)
        for a, (_, tail) in zip(arrays, given.values(), strict=True)
    )
    return p, frames, chosen, batch


def sound_poses(positions: Array, rotations: Array, pitch: float) -> NDArray[np.bool_]:
    """Which patches have positions within reach and true rotations, shape (b,)."""
    known = np.isfinite(positions).all((1, 2)) & np.isfinite(rotations).all((1, 2, 3))
    finite = np.asarray(known)
    p = np.where(finite[:, None, None], positions, 0)
    near = abs(p - p[:, :1]).max((1, 2)) < FARTHEST * pitch
    frames = np.where(finite[:, None, None, None], rotations, 0)
    square = abs(frames.mT @ frames - np.eye(3)).max((1, 2, 3)) < ROTATION
    upright = np.asarray(np.linalg.det(frames) > 0).all(-1)
    return np.asarray(finite & near & square & upright)
