"""Makes the example molds: `python examples/molds/make_molds.py [folder]`.

All are open surfaces in millimeters, z up, with the mold's origin at the middle.
"""

import sys
from pathlib import Path

import numpy as np
import trimesh

from drapeplan.surfaces import Array, KinDrape

MM = 1e3  # [1/m]


def panel_height(x: Array, y: Array) -> Array:
    """Shallow panel: an arc of 1.2 m along x, moved along one of 2.5 m along y; [m]."""
    return np.sqrt(1.2**2 - x**2) - 1.2 + np.sqrt(2.5**2 - y**2) - 2.5


def height_field(x: Array, y: Array, z: Array) -> trimesh.Trimesh:
    """Two triangles for each cell of a grid, normals up.

    Args:
        x: Grid lines along x, shape (nx,), in [m]; where they run back, the mesh
            goes on under itself.
        y: Grid lines along y, shape (ny,), in [m].
        z: Heights, shape (nx, ny), in [m].

    Returns:
        The mesh, in mm.
    """
    k = np.arange(z.size).reshape(z.shape)
    a, b, c, d = (v.ravel() for v in (k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    grid_x, grid_y = np.meshgrid(x, y, indexing="ij")
    vertices = MM * np.stack([grid_x, grid_y, z], axis=-1).reshape(-1, 3)
    return trimesh.Trimesh(vertices, faces, process=False)


def make_panel() -> trimesh.Trimesh:
    """Panel of 0.8 x 1.0 m, facets at most 0.013 mm below the surface."""
    x, y = np.linspace(-0.4, 0.4, 101), np.linspace(-0.5, 0.5, 101)
    return height_field(x, y, panel_height(x[:, None], y[None, :]))


def make_kindrape() -> trimesh.Trimesh:
    """KinDrape's generic mold at relief 0.3, its square mapped to an edge of 1.0 m."""
    line = np.linspace(-0.5, 0.5, 126)
    surface = KinDrape(relief=0.3, size=1.0)
    return height_field(line, line, surface.height(line[:, None], line[None, :]))


def make_channel() -> trimesh.Trimesh:
    """Panel with a dovetail channel along y: 40 mm open, 56 mm wide 25 mm below."""
    y = np.linspace(-0.5, 0.5, 51)
    land, floor = np.linspace(0.02, 0.4, 49), np.linspace(-0.028, 0.028, 8)
    wall = np.linspace(0.02, 0.028, 6)[1:-1]
    depth = 0.025 * (wall - 0.02) / 0.008
    x = np.concatenate([-land[::-1], -wall, floor, wall[::-1], land])
    flat, deep = np.zeros(49), np.full(8, 0.025)
    below = np.concatenate([flat, depth, deep, depth[::-1], flat])
    z = panel_height(x[:, None], y[None, :]) - below[:, None]
    return height_field(x, y, z)


MOLDS = {
    "panel.stl": make_panel,
    "kindrape.stl": make_kindrape,
    "channel.stl": make_channel,
}

if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent)
    for name, make in MOLDS.items():
        make().export(folder / name)
        print(folder / name)
