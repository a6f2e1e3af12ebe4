"""Small matrices of twists and wrenches, in batches."""

import numpy as np

from drapeplan.legs import Array

LOW, HIGH = np.minimum.outer(range(6), range(6)), np.maximum.outer(range(6), range(6))


def skew(a: Array) -> Array:
    """Matrices of the cross product from the left.

    Args:
        a: Shape (..., 3).

    Returns:
        The matrix that takes b to a x b, shape (..., 3, 3).
    """
    matrix = np.zeros((*a.shape, 3))
    matrix[..., 0, 1], matrix[..., 0, 2] = -a[..., 2], a[..., 1]
    matrix[..., 1, 0], matrix[..., 1, 2] = a[..., 2], -a[..., 0]
    matrix[..., 2, 0], matrix[..., 2, 1] = -a[..., 1], a[..., 0]
    return matrix


def point_velocity(x: Array) -> Array:
    """Velocity of points by the spatial twist of their body.

    Args:
        x: Points, shape (..., 3), in [m].

    Returns:
        The matrix that takes (v, w) to v + w x x, shape (..., 3, 6).
    """
    eye = np.broadcast_to(np.eye(3), (*x.shape, 3))
    return np.concatenate([eye, -skew(x)], axis=-1)


def chain_curvature(twists: Array, mixed: Array) -> Array:
    r"""Second derivatives by the coordinates of one chain, first joint first.

    Args:
        twists: Spatial twists of the coordinates, shape (..., k, 6).
        mixed: C of docs/derivations.md, D20, shape (..., 6, 6).

    Returns:
        :math:`-(T C T^T)[a, b]` for a <= b, and the same at [b, a], shape (..., k, k).
    """
    k = twists.shape[-2]
    product = twists @ mixed @ twists.swapaxes(-1, -2)
    mirrored: Array = -product[..., LOW[:k, :k], HIGH[:k, :k]]
    return mirrored
