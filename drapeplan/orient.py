"""Outward sides of a mesh: consistent winding, and normals that tell inside from out.

With angle-weighted normals at vertices and summed ones at edges, the side of a point
follows from the nearest feature alone, exactly for closed meshes [Baerentzen2005].
"""

import numba
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from drapeplan.mesh import WELD, Faces
from drapeplan.surfaces import Array, Mask

SIDES = np.array([[0, 1], [1, 2], [2, 0]])  # corners of a triangle's edges


def oriented(vertices: Array, faces: Faces, seen: Mask) -> tuple[Array, Faces]:
    """Mesh with its faces turned so that they look out of the mold.

    Neighbors are made to agree. A closed part then encloses a positive volume; an open
    one looks up where it is seen from above.

    Args:
        vertices: Vertices in the mold frame, shape (v, 3), in [m].
        faces: Vertex indices of the triangles, in any order, shape (f, 3).
        seen: Faces that are seen from above, shape (f,).

    Returns:
        Vertices with the nearly equal ones made one, and the turned faces; faces that
        collapse are left out.
    """
    same = _same_vertices(vertices)
    faces = same[faces]
    whole = np.all(faces != np.roll(faces, 1, axis=1), axis=1)
    faces, seen = faces[whole], seen[whole]
    pairs, agree, shared = _adjacent(faces)
    part, flip = _settle_flips(len(faces), pairs, agree)
    faces = np.where(flip[:, None], faces[:, ::-1], faces)
    cross = _crosses(vertices, faces)
    count = int(part.max()) + 1
    volume = np.bincount(part, np.sum(vertices[faces[:, 0]] * cross, axis=1), count)
    up = np.bincount(part, np.where(seen, cross[:, 2], 0.0), count)
    border = np.bincount(part, np.where(shared == 2, 0, 1).max(axis=1), count)
    inward = np.where(border == 0, volume < 0, up < 0)[part]
    return vertices, np.where(inward[:, None], faces[:, ::-1], faces)


def is_closed(faces: Faces) -> bool:
    """Whether each edge belongs to exactly two faces."""
    return bool((_adjacent(faces)[2] == 2).all())


def outward_normals(vertices: Array, faces: Faces) -> Array:
    """Normals of the features of each face, for the side of points near them.

    Args:
        vertices: Vertices, shape (v, 3), in [m].
        faces: Consistently turned faces, shape (f, 3).

    Returns:
        Directions (not of unit length) for the face, its edges 01, 12, 20 and its
        corners 0, 1, 2, shape (f, 7, 3).
    """
    cross = _crosses(vertices, faces)
    normal = cross / np.linalg.norm(cross, axis=1, keepdims=True)
    keys, _ = _edge_keys(faces)
    _, edge = np.unique(keys, axis=0, return_inverse=True)
    edge = edge.reshape(-1, 3)
    corners = vertices[faces]
    after, before = (np.roll(corners, k, axis=1) - corners for k in (-1, 1))
    turn = np.linalg.norm(np.cross(after, before), axis=2)
    angle = np.arctan2(turn, np.sum(after * before, axis=2))
    at_edge = _gathered(edge, np.ones_like(angle), normal)
    at_vertex = _gathered(faces, angle, normal)
    return np.concatenate([normal[:, None], at_edge[edge], at_vertex[faces]], axis=1)


def _gathered(index: Faces, weight: Array, normal: Array) -> Array:
    """Weighted normals summed where faces meet, shape (n, 3)."""
    count = int(index.max()) + 1
    parts = (weight * normal[:, None, k] for k in range(3))
    parts = (np.broadcast_to(part, index.shape).ravel() for part in parts)
    return np.stack([np.bincount(index.ravel(), p, count) for p in parts], axis=1)


def _crosses(vertices: Array, faces: Faces) -> Array:
    """Normals of twice the area, shape (f, 3), in [m^2]."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def _same_vertices(vertices: Array) -> Faces:
    """For each vertex the first of those that lie where it does, shape (v,)."""
    near = cKDTree(vertices).query_pairs(WELD, output_type="ndarray")
    shape = (len(vertices), len(vertices))
    graph = coo_array((np.ones(len(near), bool), (near[:, 0], near[:, 1])), shape)
    _, group = connected_components(graph, directed=False)
    _, first = np.unique(group, return_index=True)
    return np.asarray(first[group], np.int64)


def _edge_keys(faces: Faces) -> tuple[Faces, Mask]:
    """Ordered vertex pairs of all edges, (3 f, 2), and whether faces run along them."""
    ends = faces[:, SIDES].reshape(-1, 2)
    return np.sort(ends, axis=1), ends[:, 0] < ends[:, 1]


def _adjacent(faces: Faces) -> tuple[Faces, Mask, Faces]:
    """Faces that share an edge, (n, 2), whether they agree, and faces at each edge."""
    keys, along = _edge_keys(faces)
    _, edge, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    edge = edge.ravel()
    order = np.argsort(edge, kind="stable")
    face = order // 3
    follow = np.flatnonzero(edge[order][1:] == edge[order][:-1])
    pairs = np.stack([face[follow], face[follow + 1]], axis=1)
    agree = along[order][follow] != along[order][follow + 1]
    return pairs, agree, count[edge].reshape(-1, 3)


def _settle_flips(count: int, pairs: Faces, agree: Mask) -> tuple[Faces, Mask]:
    """Connected part of each face, and the faces to flip so that neighbors agree."""
    both = np.concatenate([pairs, pairs[:, ::-1]])
    turn = np.concatenate([~agree, ~agree])
    order = np.argsort(both[:, 0], kind="stable")
    start = np.searchsorted(both[order, 0], np.arange(count + 1))
    return _walk(start, both[order, 1], turn[order])


@numba.njit(cache=True)
def _walk(start, other, turn):  # type: ignore[no-untyped-def]  # numba
    """Part and flip of each face, neighbor by neighbor."""
    count = len(start) - 1
    part, flip = np.full(count, -1), np.zeros(count, np.bool_)
    todo, parts = np.empty(count, np.int64), 0
    for first in range(count):
        if part[first] >= 0:
            continue
        part[first], todo[0], size = parts, first, 1
        while size:
            size -= 1
            face = todo[size]
            for k in range(start[face], start[face + 1]):
                near = other[k]
                if part[near] < 0:
                    part[near], flip[near] = parts, flip[face] ^ turn[k]
                    todo[size] = near
                    size += 1
        parts += 1
    return part, flip
