r"""Legs of the drape tool in closed form: cup poses to joint coordinates and back.

A leg hangs from its universal joint U at a fixed point of the tool frame. With
:math:`F = \mathrm{diag}(1, -1, -1)`, which turns the directions (s, t, n) of a cup into
its face frame (z along the approach, -n), the chain in the tool frame is

.. math::
    b = U + R_x(u_x) R_y(u_y) (l + \mathrm{stroke}) e_z, \qquad
    R F = R_x(u_x) R_y(u_y) R_x(s_x) R_y(s_y) R_z(s_z), \qquad
    p = b + h R F e_z,

with ball center b, cup rotation R, suction face p, least length l and ball height h.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
FACE = np.diag([1.0, -1.0, -1.0])  # (s, t, n) to the face frame (s, -t, -n) and back
UX, UY, STROKE, SX, SY, SZ = range(6)  # coordinates of one leg


@dataclass(frozen=True)
class LegGeometry:
    """Lengths that the legs' closed forms need; the same for all legs but U.

    Attributes:
        universals: Universal joints in the tool frame, shape (n, 3), in [m].
        leg_min: Universal joint to ball at stroke 0, [m].
        leg_max: Universal joint to ball at full stroke, [m].
        ball_height: Ball center above the suction face, [m].
    """

    universals: Array
    leg_min: float
    leg_max: float
    ball_height: float


def grid_universals(rows: int, columns: int, pitch: float, depth: float) -> Array:
    """Universal joints of a grid in the tool frame: x along s, y against t, z down.

    Args:
        rows: Cups along t.
        columns: Cups along s.
        pitch: Distance between neighbors, [m].
        depth: Universal joints below tool0, [m].

    Returns:
        Points by cup index, shape (rows * columns, 3), in [m].
    """
    i, j = np.divmod(np.arange(rows * columns), columns)
    x, y = (j - (columns - 1) / 2) * pitch, -(i - (rows - 1) / 2) * pitch
    return np.stack([x, y, np.full(len(i), depth)], axis=-1)


def leg_coordinates(
    geometry: LegGeometry, T_world_tool: Array, positions: Array, rotations: Array
) -> Array:
    r"""Joint coordinates that bring the cups to given poses, closed form.

    The line from U to the ball has the direction
    :math:`(\sin u_y, -\sin u_x \cos u_y, \cos u_x \cos u_y)`; the rest of the rotation,
    :math:`R_x R_y R_z`, is read from its first row and last column. Of the two
    solutions, these are the ones with cosines of u_y and s_y that are not negative,
    the only ones within any limits below 90 degrees. No limit is looked at here.

    Args:
        geometry: The legs, n of them.
        T_world_tool: Tool placement, shape (..., 4, 4), lengths in [m].
        positions: Centers of the suction faces in the world, shape (..., n, 3), in [m].
        rotations: Columns are the directions of s, t and n, shape (..., n, 3, 3).

    Returns:
        ux, uy, stroke, sx, sy, sz, shape (..., n, 6), in [rad], the stroke in [m].
    """
    R_tool_world = np.swapaxes(T_world_tool[..., None, :3, :3], -1, -2)
    balls = positions + geometry.ball_height * rotations[..., 2]
    offset = balls - T_world_tool[..., None, :3, 3]
    x, y, z = np.moveaxis(_apply(R_tool_world, offset) - geometry.universals, -1, 0)
    ux, uy = np.arctan2(-y, z), np.arctan2(x, np.hypot(y, z))
    stroke = np.sqrt(x * x + y * y + z * z) - geometry.leg_min
    leg = rotation("x", ux) @ rotation("y", uy)
    ball = np.swapaxes(leg, -1, -2) @ R_tool_world @ rotations @ FACE
    sx = np.arctan2(-ball[..., 1, 2], ball[..., 2, 2])
    sy = np.arctan2(ball[..., 0, 2], np.hypot(ball[..., 1, 2], ball[..., 2, 2]))
    sz = np.arctan2(-ball[..., 0, 1], ball[..., 0, 0])
    return np.stack([ux, uy, stroke, sx, sy, sz], axis=-1)


def cup_poses(
    geometry: LegGeometry, T_world_tool: Array, legs: Array
) -> tuple[Array, Array]:
    """Cup poses of given joint coordinates: the chain of the module's head.

    Args:
        geometry: The legs, n of them.
        T_world_tool: Tool placement, shape (..., 4, 4), lengths in [m].
        legs: ux, uy, stroke, sx, sy, sz, shape (..., n, 6), in [rad] and [m].

    Returns:
        Centers of the suction faces, shape (..., n, 3), in [m], and rotations with
        the directions of s, t and n as columns, shape (..., n, 3, 3), in the world.
    """
    ux, uy, stroke, sx, sy, sz = np.moveaxis(legs, -1, 0)
    R_world_tool = T_world_tool[..., None, :3, :3]
    leg = rotation("x", ux) @ rotation("y", uy)
    ball = rotation("x", sx) @ rotation("y", sy) @ rotation("z", sz)
    face = leg @ ball
    reach = (geometry.leg_min + stroke)[..., None] * leg[..., 2]
    local = geometry.universals + reach + geometry.ball_height * face[..., 2]
    positions = T_world_tool[..., None, :3, 3] + _apply(R_world_tool, local)
    return positions, R_world_tool @ face @ FACE


def leg_twists(geometry: LegGeometry, T_world_tool: Array, legs: Array) -> Array:
    r"""Spatial twists of each leg's coordinates: how its cup moves with them.

    A revolute joint with axis a through x moves the world's origin at
    :math:`v = x \times a`; the stroke moves all points along the leg. The axes of
    ux and uy meet in U, those of sx, sy and sz in the ball's center.

    Args:
        geometry: The legs, n of them.
        T_world_tool: Tool placement, shape (..., 4, 4), lengths in [m].
        legs: ux, uy, stroke, sx, sy, sz, shape (..., n, 6), in [rad] and [m].

    Returns:
        By coordinate: velocity of the cup's point at the world's origin, then angular
        velocity, shape (..., n, 6, 6), in [m] and [rad] per [rad], or per [m].
    """
    ux, uy, stroke, sx, sy, _ = np.moveaxis(legs, -1, 0)
    R_world_tool = T_world_tool[..., None, :3, :3]
    first = R_world_tool @ rotation("x", ux)
    leg = first @ rotation("y", uy)
    third = leg @ rotation("x", sx)
    fourth = third @ rotation("y", sy)
    U = T_world_tool[..., None, :3, 3] + _apply(R_world_tool, geometry.universals)
    ball = U + (geometry.leg_min + stroke)[..., None] * leg[..., 2]
    tool = np.broadcast_to(R_world_tool, leg.shape)
    axes = [tool[..., 0], first[..., 1], leg[..., 0], third[..., 1], fourth[..., 2]]
    a = np.stack(axes, axis=-2)
    U = np.broadcast_to(U, ball.shape)
    points = np.stack([U, U, ball, ball, ball], axis=-2)
    twists = np.zeros((*legs.shape, 6))
    revolute = [UX, UY, SX, SY, SZ]
    twists[..., revolute, :3] = cross(points, a)
    twists[..., revolute, 3:] = a
    twists[..., STROKE, :3] = leg[..., 2]
    return twists


def cross(a: Array, b: Array) -> Array:
    """Cross product, several times faster than numpy's on small batches.

    Args:
        a: Shape (..., 3).
        b: Shape (..., 3).

    Returns:
        a x b, shape (..., 3).
    """
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def rotation(axis: str, angle: Array) -> Array:
    """Rotations about one coordinate axis.

    Args:
        axis: "x", "y" or "z".
        angle: Shape (...), in [rad].

    Returns:
        Rotation matrices, shape (..., 3, 3).
    """
    k = "xyz".index(axis)
    i, j = (k + 1) % 3, (k + 2) % 3
    matrix = np.zeros((*np.shape(angle), 3, 3))
    matrix[..., k, k] = 1.0
    matrix[..., i, i] = matrix[..., j, j] = np.cos(angle)
    matrix[..., j, i] = np.sin(angle)
    matrix[..., i, j] = -matrix[..., j, i]
    return matrix


def _apply(matrix: Array, vector: Array) -> Array:
    """Matrix times vector over all batch axes, shape (..., 3)."""
    product: Array = (matrix @ vector[..., None])[..., 0]
    return product
