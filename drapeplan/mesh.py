"""Mold meshes: reading them with clear refusals, and looking at them from above.

The mesh's own coordinates are the mold frame: its origin is the mold's, z is up.
"""

from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from drapeplan.errors import InputError
from drapeplan.surfaces import Array, Mask

Faces = NDArray[np.int64]

UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "inch": 0.0254}  # [m]
NAMES = {"mm": "millimeters", "cm": "centimeters", "m": "meters", "inch": "inches"}
FORMATS = (".stl", ".obj", ".ply")
LARGEST = 20.0  # [m] no mold for an arm is larger
SMALLEST = 0.2  # [-] share of the ply below which a mold was read in a wrong unit
SLIVER = 1e-14  # [-] face area over squared mesh size: no area, in float32 files
WELD = 1e-6  # [m] vertices nearer than this belong together
STEEP = 1e-3  # [-] vertical part of a unit normal below which a face is a wall
JITTER = 1e-6  # [m] shift of a ray that slipped between two faces


def read_mesh(path: str | Path, unit: str) -> tuple[Array, Faces]:
    """Read one connected surface from an STL, OBJ or PLY file.

    Open surfaces are normal. Faces without area are dropped.

    Args:
        path: The file.
        unit: Unit of its coordinates, "mm", "cm", "m" or "inch".

    Returns:
        Vertices, shape (v, 3), in [m], and the vertex indices of the triangles, shape
        (f, 3).

    Raises:
        InputError: The file is missing, unreadable, empty, not finite, without area,
            or holds several bodies.
    """
    if unit not in UNITS:
        known = ", ".join(UNITS)
        raise InputError(str(path), "unit", f"unknown unit {unit!r}", f"use {known}")
    mesh = _load(Path(path))
    vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, int)
    if len(faces) == 0:
        raise InputError(str(path), "", "the mesh has no faces", "export a surface")
    if not np.isfinite(vertices).all():
        count = int(np.sum(~np.isfinite(vertices).all(axis=1)))
        problem = f"{count} vertices are not finite (NaN or infinite)"
        raise InputError(str(path), "", problem, "export the mesh again")
    vertices, faces = _weld(vertices * UNITS[unit], _with_area(vertices, faces, path))
    bodies = _count_bodies(vertices, faces)
    if bodies > 1:
        problem = f"the mesh has {bodies} separate bodies"
        remedy = "export the one surface that the ply is draped on"
        raise InputError(str(path), "", problem, remedy)
    return vertices, faces


def _load(path: Path) -> trimesh.Trimesh:
    """The file as trimesh reads it, its faces untouched."""
    if path.suffix.lower() not in FORMATS:
        problem = f"unknown mesh format {path.suffix or path.name!r}"
        raise InputError(str(path), "", problem, "use STL, OBJ or PLY")
    if not path.is_file():
        raise InputError(str(path), "", "no such mesh file", "check mold.mesh.path")
    try:
        mesh = trimesh.load_mesh(path, process=False)
    except Exception as error:  # trimesh's readers raise whatever they stumble on
        problem = f"the content cannot be read as {path.suffix[1:].upper()}"
        raise InputError(str(path), "", problem, "export it again") from error
    if not isinstance(mesh, trimesh.Trimesh):
        raise InputError(str(path), "", "the mesh has no faces", "export a surface")
    return mesh


def _with_area(vertices: Array, faces: Faces, path: str | Path) -> Faces:
    """Faces that have an area; raises if none has."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    good = area > SLIVER * np.max(np.ptp(vertices, axis=0)) ** 2
    if not good.any():
        problem = "the mesh is degenerate: no face has an area"
        raise InputError(str(path), "", problem, "export it again")
    return faces[good]


def _weld(vertices: Array, faces: Faces) -> tuple[Array, Faces]:
    """Mesh without unused vertices, equal vertices made one."""
    used, inverse = np.unique(
        vertices[faces].reshape(-1, 3), axis=0, return_inverse=True
    )
    return used, inverse.reshape(-1, 3)


def _count_bodies(vertices: Array, faces: Faces) -> int:
    """Number of parts that share no vertex and nearly none."""
    near = cKDTree(vertices).query_pairs(WELD, output_type="ndarray")
    edges = np.concatenate([faces[:, :2], faces[:, 1:], near])
    shape = (len(vertices), len(vertices))
    graph = coo_array((np.ones(len(edges), bool), (edges[:, 0], edges[:, 1])), shape)
    return int(connected_components(graph, directed=False)[0])


def check_size(
    extent: ArrayLike,
    needed_x: float,
    needed_y: float,
    source: str,
    unit: str = "mm",
) -> None:
    """Refuse a mold whose size says that it was read in a wrong unit.

    Args:
        extent: Sizes of the mold along x and y, in [m].
        needed_x: Size of the ply along x, in [m].
        needed_y: Size of the ply along y, in [m].
        source: Names the mesh in the message.
        unit: Unit it was read in.

    Raises:
        InputError: The mold is far too small for the ply, or larger than 20 m.
    """
    sizes, needed = np.asarray(extent, float)[:2], max(needed_x, needed_y)
    largest = float(np.max(sizes))
    if SMALLEST * needed <= largest <= LARGEST:
        return
    scaled = {name: largest * factor / UNITS[unit] for name, factor in UNITS.items()}
    fits = [name for name, size in scaled.items() if needed / 2 <= size <= LARGEST / 4]
    remedy = "check the mesh and mold.mesh.unit"
    if fits:
        remedy = f"is the mesh in {NAMES[fits[0]]}? set mold.mesh.unit: {fits[0]}"
    problem = f"the mold is {_sizes(*sizes)}, the ply {_sizes(needed_x, needed_y)}"
    raise InputError(source, "mold.mesh.unit", problem, remedy)


def _sizes(x: float, y: float) -> str:
    """Two lengths in a unit that suits them."""
    scale, unit = (1e3, "mm") if max(x, y) < 10 else (1, "m")
    digits = 0 if max(x, y) * scale >= 100 else 1
    return f"{x * scale:.{digits}f} x {y * scale:.{digits}f} {unit}"


def look_down(vertices: Array, faces: Faces, x: Array, y: Array) -> tuple[Array, Mask]:
    """Highest points of a mesh over given places, by vertical rays.

    Walls are looked past. The ray tracer works in single precision and only picks the
    face; the height is that of its plane, in double precision.

    Args:
        vertices: Vertices, shape (v, 3), in [m].
        faces: Vertex indices of the triangles, shape (f, 3).
        x: Where to look, shape (n,), in [m].
        y: The same along y, shape (n,), in [m].

    Returns:
        Heights, shape (n,), in [m], zero where the mesh is missed, and whether it was
        hit, shape (n,).
    """
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    open_up = abs(normals[:, 2]) > STEEP * np.linalg.norm(normals, axis=1)
    corners, normals = corners[open_up], normals[open_up]
    if len(corners) == 0:
        return np.zeros(len(x)), np.zeros(len(x), bool)
    seen = trimesh.Trimesh(vertices, faces[open_up], process=False)
    top = vertices[:, 2].max() + 0.1 * np.max(np.ptp(vertices, axis=0))
    face = _first_hits(seen, x, y, top)
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        missed = np.flatnonzero(face < 0)
        if len(missed):
            shifted = x[missed] + dx * JITTER, y[missed] + dy * JITTER
            face[missed] = _first_hits(seen, *shifted, top)
    hit = face >= 0
    first, normal = corners[face, 0], normals[face]
    slope = (x - first[:, 0]) * normal[:, 0] + (y - first[:, 1]) * normal[:, 1]
    z = first[:, 2] - slope / normal[:, 2]
    z = np.clip(z, corners[face, :, 2].min(axis=1), corners[face, :, 2].max(axis=1))
    return np.where(hit, z, 0), hit


def _first_hits(mesh: trimesh.Trimesh, x: Array, y: Array, top: float) -> Faces:
    """First face under each place, from that height, shape (n,); -1 where none."""
    origins = np.column_stack([x, y, np.full(len(x), top)])
    down = np.broadcast_to([0.0, 0.0, -1.0], origins.shape)
    return np.array(mesh.ray.intersects_first(origins, down), dtype=np.int64)
