"""Overhang: where a mesh is more than what is seen of it from above, and its mold.

A mesh without overhangs within the ply's reach stays a height field: distances to first
order are exact where it touches, and need no grid in space.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import distance_transform_edt

from drapeplan.distance_grid import DistanceGrid, face_samples
from drapeplan.distance_kernels import in_cells
from drapeplan.mesh import Faces, look_down
from drapeplan.mold import HeightGrid
from drapeplan.orient import oriented
from drapeplan.surfaces import Array, Mask

LEAST = 0.5e-3  # [m] overhangs below this are none: what counts as touching
OFF = 0.2e-3  # [m] how far off the surface the air beside it is looked at
LAYER = 2e-3  # [m] heights that share one look for the way out from under an edge
LOOKS = 400  # [-] looks between a hidden place and the open air beside it
WORST = 12  # [-] hidden places that are measured so closely
RIM_LOOKS = 16  # [-] looks around the rim of a pad
OPENING = 0.1e-3  # [m] by which a gap is more than the distance over an opening
SEEN = 1e-6  # [m] how near its highest point a face lies that is seen from above

Near = Callable[[Array, Array], Mask]


class Overhang(NamedTuple):
    """The largest overhang within the ply's reach.

    Attributes:
        size: How far the air goes in under the edge, in [m].
        x: Where the edge is, in [m].
        y: The same along y, in [m].
    """

    size: float
    x: float
    y: float


@dataclass(frozen=True, eq=False)
class OverhungGrid(HeightGrid):
    """A mold that goes on under its own edges.

    For all that looks from above, nets and waves, it is the height grid of what is
    seen; what touches is a matter of distances. It is a subclass because its gap is all
    that differs.

    Attributes:
        distances: Signed distances to the mesh.
    """

    distances: DistanceGrid

    @classmethod
    def from_mesh(cls, vertices: Array, faces: Faces, step: float = 0.005) -> Self:
        """Look at a mesh from above, and measure it all around.

        Args:
            vertices: Vertices in the mold frame, shape (v, 3), in [m].
            faces: Vertex indices of the triangles, however they are wound, (f, 3).
            step: Largest distance between nodes, in [m].

        Raises:
            InputError: Nothing of the mesh is seen from above.
        """
        shown = HeightGrid.from_mesh(vertices, faces, step)
        outward = outward_mesh(vertices, faces)
        floor = float(shown.heights[shown.covered].min())
        grid = DistanceGrid.from_mesh(*outward, step, floor)
        return cls(shown.origin, shown.step, shown.heights, shown.covered, grid)

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Self:
        """The mold that `to_data` wrote, the same to the last bit."""
        shown = HeightGrid.from_data(data)
        grid = DistanceGrid.from_data(data["distance"])
        return cls(shown.origin, shown.step, shown.heights, shown.covered, grid)

    def to_data(self) -> dict[str, Any]:
        """Height grid and distances as plain data."""
        return super().to_data() | {"distance": self.distances.to_data()}

    def gap(self, points: ArrayLike, beside: float | None = None) -> Array:
        """Signed distances to the mold, also under its edges.

        Args:
            points: Points in the mold frame, shape (..., 3), in [m].
            beside: The answer beside the mold; None measures on there.

        Returns:
            Distances, shape (...), positive outside, in [m].
        """
        points = np.asarray(points, float)
        gap = self.distances.gap(points)
        if beside is None:
            return gap
        flat, on = points.reshape(-1, 3), self.covered
        cells = on[1:, 1:] & on[:-1, 1:] & on[1:, :-1] & on[:-1, :-1]
        off = ~in_cells(np.ascontiguousarray(flat), cells, *self.origin, *self.step)
        off[off] = ~self.inside(*flat[off, :2].T)  # on a rim that is one row of nodes
        return np.where(off.reshape(gap.shape), beside, gap)

    def opening(self, points: ArrayLike) -> Mask:
        """Whether points lie over an opening: what is below is further than an edge.

        There the gap jumps from the edge to the floor, so a step aside of a tenth of a
        millimeter changes it by as much as the opening is deep.

        Args:
            points: Points in the mold frame, shape (..., 3), in [m].

        Returns:
            Shape (...).
        """
        grid = self.distances
        return np.asarray(grid.gap(points) - grid.nearest(points) > OPENING)


def mold_of(
    vertices: Array, faces: Faces, step: float, near: Near, reach: float
) -> tuple[HeightGrid, str]:
    """Mold of a mesh, no more modeled than needed, and what was chosen and why.

    Args:
        vertices: Vertices in the mold frame, shape (v, 3), in [m].
        faces: Vertex indices of the triangles, however they are wound, shape (f, 3).
        step: Largest distance between nodes, in [m].
        near: Whether the ply may come to places x, y.
        reach: How deep under an edge the ply may come, in [m].

    Raises:
        InputError: Nothing of the mesh is seen from above.
    """
    shown = HeightGrid.from_mesh(vertices, faces, step)
    found = find_overhang(*outward_mesh(vertices, faces), shown, near, reach)
    if found is None:
        return shown, "height field: nothing overhangs within the ply's reach"
    where = f"({1e3 * found.x:.0f}, {1e3 * found.y:.0f}) mm"
    why = f"distance grid, because of an overhang of {1e3 * found.size:.1f} mm"
    return OverhungGrid.from_mesh(vertices, faces, step), f"{why} at {where}"


def pads_over_edges(
    mold: HeightGrid, xy: Array, half_width: float, most: float
) -> list[tuple[int, float]]:
    """Cups through whose flat pads an edge would run under which the mold goes on.

    Args:
        mold: The mold; one without overhangs has no such edges.
        xy: Where the cups land, shape (n, 2), in [m].
        half_width: Half width of a pad, in [m].
        most: How far a pad may be off the mold, in [m].

    Returns:
        Index of each such cup and how far its pad is off what is seen of the mold, or
        off the mold itself, in [m].
    """
    if not isinstance(mold, OverhungGrid):
        return []
    center, normal = mold.point(*xy.T), mold.normal(*xy.T)
    along = np.stack([normal[:, 2], 0 * normal[:, 0], -normal[:, 0]], axis=-1)
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    angle = np.linspace(0, 2 * np.pi, RIM_LOOKS, endpoint=False)
    rim = half_width * np.stack([np.cos(angle), np.sin(angle)])
    frame = np.stack([along, np.cross(normal, along)], axis=1)
    pads = center[:, None] + np.einsum("ka,nkc->nac", rim, frame)
    places = np.concatenate([center[:, None], pads], axis=1)
    off = np.maximum(abs(mold.gap(places)), abs(HeightGrid.gap(mold, places)))
    worst = off.max(axis=1)
    return [(int(k), float(worst[k])) for k in np.flatnonzero(worst > most)]


def mold_from_data(data: dict[str, Any]) -> HeightGrid:
    """The mold that a plan holds."""
    return (OverhungGrid if "distance" in data else HeightGrid).from_data(data)


def outward_mesh(vertices: Array, faces: Faces) -> tuple[Array, Faces]:
    """The mesh with faces that look out of the mold; see `oriented`."""
    x, y, z = vertices[faces].mean(axis=1).T
    top, hit = look_down(vertices, faces, x, y)
    return oriented(vertices, faces, hit & (abs(top - z) < SEEN))


def find_overhang(
    vertices: Array, faces: Faces, shown: HeightGrid, near: Near, reach: float
) -> Overhang | None:
    """The largest overhang that the ply can come to.

    Air just off the surface that the mold hides from above is hidden; the overhang is
    how far it is from there to open air, at the same height.

    Args:
        vertices: Vertices in the mold frame, shape (v, 3), in [m].
        faces: Triangles that look out of the mold, shape (f, 3).
        shown: What is seen from above.
        near: Whether the ply may come to places x, y: where the edges are.
        reach: How deep under an edge the ply may come, in [m].

    Returns:
        The overhang; None if there is none of more than 0.5 mm.
    """
    hidden = _hidden_air(vertices, faces, shown.step[0], reach)
    if not len(hidden):
        return None
    way = _ways_out(hidden, shown)
    found = np.isfinite(way[:, 0])
    found[found] &= near(*way[found].T)
    hidden, way = hidden[found], way[found]
    length = np.linalg.norm(way - hidden[:, :2], axis=1)
    best: Overhang | None = None
    for k in np.argsort(-length, kind="stable")[:WORST]:
        size, x, y = _measured(vertices, faces, hidden[k], way[k])
        if size > max(LEAST, best.size if best else 0.0):
            best = Overhang(size, x, y)
    return best


def _hidden_air(vertices: Array, faces: Faces, step: float, reach: float) -> Array:
    """Places just off the surface with the mold above, within reach, shape (n, 3)."""
    corners = vertices[faces]
    points, owners = face_samples(corners, 2 * step)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    air = points + OFF * normals[owners]
    top, hit = look_down(vertices, faces, air[:, 0], air[:, 1])
    depth = np.where(hit, top - air[:, 2], 0)
    ground = vertices[:, 2].min() + LEAST  # below stands what carries the mold
    return np.asarray(air[(depth > OFF) & (depth < reach) & (air[:, 2] > ground)])


def _ways_out(hidden: Array, shown: HeightGrid) -> Array:
    """Nearest node with open air at a place's height, (n, 2) in [m]; infinite: none."""
    count = np.array(shown.heights.shape) - 1
    nodes = np.rint((hidden[:, :2] - shown.origin) / shown.step).astype(int)
    i, j = np.clip(nodes, 0, count).T
    layer = np.ceil(hidden[:, 2] / LAYER).astype(int)
    out = np.full((len(hidden), 2), np.inf)
    for level in np.unique(layer):
        closed = shown.covered & (shown.heights > level * LAYER)
        if closed.all():
            continue
        mine = layer == level
        _, (near_i, near_j) = distance_transform_edt(
            closed, sampling=shown.step, return_indices=True
        )
        ends = np.stack([v[i[mine], j[mine]] for v in (near_i, near_j)], axis=1)
        out[mine] = shown.origin + ends * np.array(shown.step)
    return out


def _measured(
    vertices: Array, faces: Faces, place: Array, way: Array
) -> tuple[float, float, float]:
    """Distance from a hidden place to the edge on the way out, and the edge."""
    share = np.linspace(0, 1, LOOKS)
    x, y = (place[:2] + share[:, None] * (way - place[:2])).T
    top, hit = look_down(vertices, faces, x, y)
    clear = np.flatnonzero(~hit | (top < place[2] + LAYER))
    k = int(clear[0]) if len(clear) else LOOKS - 1
    return float(np.hypot(x[k] - place[0], y[k] - place[1])), float(x[k]), float(y[k])
