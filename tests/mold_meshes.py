"""Meshes of molds that tests look at, in [m]."""

import numpy as np
import trimesh


def swept(x, z, y):
    """Profile (x, z), which may run back under itself, swept along y; looks up."""
    k = np.arange(len(x) * len(y)).reshape(len(x), len(y))
    a, b, c, d = (v.ravel() for v in (k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    grid_x, grid_y = np.meshgrid(x, y, indexing="ij")
    vertices = np.stack([grid_x, grid_y, 0 * grid_y + np.asarray(z)[:, None]], axis=-1)
    return vertices.reshape(-1, 3), faces


def channel(under=0.008, opening=0.04, depth=0.025, half=0.15):
    """Flat land with a channel along y, its walls leaning back by `under`."""
    edge, foot = opening / 2, opening / 2 + under
    x = [-half, -edge, -foot, foot, edge, half]
    return swept(x, [0, 0, -depth, -depth, 0, 0], np.linspace(-0.1, 0.1, 5))


def cap(radius=1.0, half=0.04, step=0.002):
    """Open cap of a sphere about (0, 0, -radius), facets within 1 um of it."""
    line = np.linspace(-half, half, round(2 * half / step) + 1)
    vertices, faces = swept(line, 0 * line, line)
    vertices[:, 2] = np.sqrt(radius**2 - np.sum(vertices[:, :2] ** 2, axis=1)) - radius
    return vertices, faces


def torus(major=0.1, minor=0.04):
    """Closed torus about z: overhangs all around."""
    mesh = trimesh.creation.torus(major, minor, major_sections=48, minor_sections=24)
    return np.array(mesh.vertices), np.array(mesh.faces, np.int64)


def box(size=(0.2, 0.16, 0.1)):
    """Closed box about the origin."""
    mesh = trimesh.creation.box(size)
    return np.array(mesh.vertices), np.array(mesh.faces, np.int64)
