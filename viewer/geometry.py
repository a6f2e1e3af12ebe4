"""Shapes of the preview: the mold as a block, its grid lines, boxes, what to frame."""

import numpy as np

from viewer.plan_view import PlanView

Array = np.ndarray

STAND = 0.06  # [-] of the mold's size: how far its block reaches below its surface


def bounds(points: Array) -> Array:
    """Lowest and highest corner of points of shape (..., 3), shape (2, 3), in [m]."""
    flat = np.reshape(points, (-1, 3))
    return np.stack([flat.min(axis=0), flat.max(axis=0)])


def boundary_edges(faces: Array) -> Array:
    """Edges that belong to one face only, in the order of that face, shape (B, 2)."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    _, first, count = np.unique(
        np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True
    )
    return edges[np.sort(first[count == 1])]


def skirt(vertices: Array, faces: Array, bottom: float) -> tuple[Array, Array]:
    """Walls from the rim of an open mold straight down, so that it reads as a block.

    Args:
        vertices: Shape (V, 3), in [m].
        faces: Vertex indices, shape (F, 3).
        bottom: Height of the lower edge, in [m].

    Returns:
        Vertices, shape (4 B, 3), and faces, shape (2 B, 3), for B boundary edges; the
        vertices are not shared with the surface, which keeps the rim sharp.
    """
    rim = vertices[boundary_edges(faces)]
    low = np.concatenate([rim[..., :2], np.full((*rim.shape[:2], 1), bottom)], axis=-1)
    corners = np.stack([rim[:, 0], rim[:, 1], low[:, 1], low[:, 0]], axis=1)
    first = 4 * np.arange(len(rim))[:, None]
    quads = np.concatenate([first + np.array(half) for half in ((0, 2, 1), (0, 3, 2))])
    return corners.reshape(-1, 3), quads


def round_spacing(extent: float, lines: int = 16) -> float:
    """Spacing 1, 2 or 5 times a power of ten that gives at most so many lines, [m]."""
    least = extent / lines
    decade = 10.0 ** np.floor(np.log10(least))
    steps = decade * np.array([1, 2, 5, 10])
    return float(steps[np.searchsorted(steps, least * (1 - 1e-9))])


def plane_sections(vertices: Array, faces: Array, height: Array) -> Array:
    """Where a mesh meets the plane on which a linear height vanishes.

    Args:
        vertices: Shape (V, 3), in [m].
        faces: Vertex indices, shape (F, 3).
        height: Signed distance of each vertex from the plane, shape (V,), in [m].

    Returns:
        Segments, shape (S, 2, 3), in [m].
    """
    above = height[faces] >= 0
    cut = np.flatnonzero(above.any(axis=1) != above.all(axis=1))
    alone = above[cut] == (above[cut].sum(axis=1) == 1)[:, None]
    k = np.argmax(alone, axis=1)[:, None]  # the corner on a side of its own
    corner = np.take_along_axis(faces[cut], (k + np.arange(3)) % 3, axis=1)
    h, x = height[corner], vertices[corner]
    share = h[:, :1] / (h[:, :1] - h[:, 1:])
    ends = x[:, :1] + share[..., None] * (x[:, 1:] - x[:, :1])
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)
    return ends[length > 1e-9 * np.max(length, initial=0.0)]  # not a corner alone


def _multiples(low: float, high: float, spacing: float) -> Array:
    """Multiples of a spacing strictly between two numbers."""
    first, last = low / spacing + 1e-6, high / spacing - 1e-6
    return spacing * np.arange(np.ceil(first), np.floor(last) + 1)


def mold_grid(view: PlanView) -> tuple[Array, float]:
    """Grid lines on the mold along its own x and y, and its rim.

    Returns:
        Segments, shape (S, 2, 3), in [m], and the spacing of the lines, in [m].
    """
    rotation, origin = view.mold_placement[:3, :3], view.mold_placement[:3, 3]
    local = (view.mold_vertices - origin) @ rotation
    low, high = bounds(local)
    spacing = round_spacing(float(np.max(high[:2] - low[:2])))
    sections = [
        plane_sections(view.mold_vertices, view.mold_faces, local[:, axis] - at)
        for axis in (0, 1)
        for at in _multiples(low[axis], high[axis], spacing)
    ]
    rim = view.mold_vertices[boundary_edges(view.mold_faces)]
    return np.concatenate([rim, *sections]), spacing


def box_edges(size: Array) -> Array:
    """The twelve edges of a box around the origin, shape (12, 2, 3), in [m]."""
    corners = np.array(np.meshgrid(*3 * [[-0.5, 0.5]], indexing="ij")).reshape(3, -1).T
    a, b = np.triu_indices(8, 1)
    edge = np.sum(corners[a] != corners[b], axis=1) == 1
    return np.stack([corners[a[edge]], corners[b[edge]]], axis=1) * size


def grid_triangles(rows: int, columns: int) -> Array:
    """Two triangles a cell of a grid in row-major order, shape (F, 3)."""
    i = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]
    cells = [np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]
    return np.stack(cells, axis=2).reshape(-1, 3)


def fiber_lines(rows: int, columns: int, lines: int = 18) -> Array:
    """Index pairs that draw some fibers of both families and the ply's outline.

    Args:
        rows: Samples along t.
        columns: Samples along s.
        lines: Lines wanted along the longer side.

    Returns:
        Vertex indices, shape (S, 2).
    """
    i = np.arange(rows * columns).reshape(rows, columns)
    every = max(1, round(max(rows, columns) / lines))
    along_s = np.unique(np.append(np.arange(0, rows, every), rows - 1))
    along_t = np.unique(np.append(np.arange(0, columns, every), columns - 1))
    pairs = [
        np.stack([i[along_s, :-1], i[along_s, 1:]], axis=-1).reshape(-1, 2),
        np.stack([i[:-1, along_t], i[1:, along_t]], axis=-1).reshape(-1, 2),
    ]
    return np.concatenate(pairs)


def _draping(view: PlanView) -> Array:
    """Poses at which cups land or stand on the mold; all, if there is none."""
    draping = np.any((view.cup_states == 1) | (view.cup_states == 2), axis=1)
    return draping if draping.any() else np.ones(view.poses, bool)


def drape_box(view: PlanView) -> Array:
    """Box around the mold's block and the ply on it, shape (2, 3), in [m]."""
    points = view.ply_points[_draping(view)].reshape(-1, 3)
    box = bounds(np.concatenate([view.mold_vertices, points]))
    box[0, 2] = min(box[0, 2], block_bottom(view))
    return box


def tool_box(view: PlanView) -> Array:
    """Box around mold, ply and tool while the ply is draped, shape (2, 3), in [m]."""
    upper = view.universals[_draping(view)].reshape(-1, 3)
    return bounds(np.concatenate([drape_box(view), upper]))


def block_bottom(view: PlanView) -> float:
    """Height of the mold block's underside, in [m]."""
    low, high = bounds(view.mold_vertices)
    return float(low[2] - STAND * np.max(high - low))


def cell_box(view: PlanView) -> Array:
    """Box around everything at every pose, shape (2, 3), in [m]."""
    points = [drape_box(view), bounds(view.ply_points), bounds(view.universals)]
    for k, mesh in enumerate(view.arm_meshes):
        corners = np.array(np.meshgrid(*bounds(mesh.vertices).T)).reshape(3, -1)
        T_world_body = view.arm_placements[:, k]
        turned = T_world_body[:, :3, :3] @ corners + T_world_body[:, :3, 3:]
        points.append(bounds(np.moveaxis(turned, 1, -1)))
    return bounds(np.concatenate(points))
