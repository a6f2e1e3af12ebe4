"""Homogeneous transforms as arrays: build, invert, apply, interpolate."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation, Slerp

Array = NDArray[np.float64]

# From cup axes (s, t, n) seen from above to tool axes (x, y, z along the approach).
FLIP = np.diag([1.0, -1.0, -1.0])


def pose(rotation: ArrayLike, translation: ArrayLike) -> Array:
    """Transform from a rotation, shape (3, 3), and a translation, shape (3,)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, translation
    return T


def translation(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Array:
    """Pure translation, shape (4, 4), from lengths in [m]."""
    return pose(np.eye(3), (x, y, z))


def inverse(T: Array) -> Array:
    """Inverse of rigid transforms, shape (..., 4, 4)."""
    back = np.zeros_like(T)
    R = np.swapaxes(T[..., :3, :3], -1, -2)
    back[..., :3, :3] = R
    back[..., :3, 3] = -(R @ T[..., :3, 3:])[..., 0]
    back[..., 3, 3] = 1.0
    return back


def rpy(angles: ArrayLike) -> Array:
    """Rotation from roll, pitch and yaw about fixed axes, shape (3, 3), [rad]."""
    return np.asarray(Rotation.from_euler("xyz", angles).as_matrix())


def yaw(angle: float) -> Array:
    """Rotation about z, shape (3, 3), from an angle in [rad]."""
    return rpy((0.0, 0.0, angle))


def moved(T: Array, positions: Array, rotations: Array) -> tuple[Array, Array]:
    """Cup poses taken through a rigid transform, or through one for each pose.

    Args:
        T: Transforms, shape (..., 4, 4).
        positions: Shape (..., n, 3).
        rotations: Shape (..., n, 3, 3).
    """
    R = T[..., None, :3, :3]
    turned = (R @ positions[..., None])[..., 0]
    return turned + T[..., None, :3, 3], R @ rotations


def rotation_vectors(start: Array, end: Array) -> Array:
    """Turns that take rotations to others, seen from the fixed frame.

    Args:
        start: Rotations, shape (..., 3, 3).
        end: Rotations that broadcast with them.

    Returns:
        Axis times angle, shape (..., 3), in [rad], for angles below pi.
    """
    turn = end @ np.swapaxes(start, -1, -2)
    skew = np.stack(
        [
            turn[..., 2, 1] - turn[..., 1, 2],
            turn[..., 0, 2] - turn[..., 2, 0],
            turn[..., 1, 0] - turn[..., 0, 1],
        ],
        axis=-1,
    )
    sin = np.linalg.norm(skew, axis=-1) / 2
    cos = (np.trace(turn, axis1=-2, axis2=-1) - 1) / 2
    angle = np.arctan2(sin, cos)
    factor = np.where(sin > 0, angle / np.where(sin > 0, 2 * sin, 1.0), 0.5)
    return skew * factor[..., None]


def around_base(start: Array, end: Array, fractions: Array) -> Array:
    """Transforms that turn around the world's z axis from one pose to another.

    Radius, angle and height of the translation are interpolated linearly and the
    rotation along its shortest turn, so that a level tool stays level.

    Args:
        start: First pose, shape (4, 4).
        end: Last pose, shape (4, 4).
        fractions: From 0 to 1, shape (m,).

    Returns:
        Poses, shape (m, 4, 4).
    """
    f = np.asarray(fractions)
    (x0, y0, z0), (x1, y1, z1) = start[:3, 3], end[:3, 3]
    radius = (1 - f) * np.hypot(x0, y0) + f * np.hypot(x1, y1)
    turn = np.arctan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1)
    angle = np.arctan2(y0, x0) + f * turn
    ends = Rotation.from_matrix(np.stack([start[:3, :3], end[:3, :3]]))
    T = np.tile(np.eye(4), (len(f), 1, 1))
    T[:, :3, :3] = Slerp([0.0, 1.0], ends)(f).as_matrix()
    T[:, 0, 3], T[:, 1, 3] = radius * np.cos(angle), radius * np.sin(angle)
    T[:, 2, 3] = (1 - f) * z0 + f * z1
    return T
