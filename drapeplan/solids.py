"""Solids: convex bodies of arm, tool, mold and table, for distances between them.

With drapeplan.body_pairs this is the home of coal. Every solid contains what it stands
for: links are the convex hulls of their collision geometry, legs are capsules, and the
mold is a mosaic of prisms that rise to its highest points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import coal
import numpy as np
from numpy.typing import NDArray

from drapeplan.chain import Chain, origin, read_chain
from drapeplan.mold import HeightGrid
from drapeplan.visuals import installed_folders

Array = NDArray[np.float64]
ROUND = 24  # [-] corners of the prism around a cylinder
FLAT = 1e-4  # [m] thickness of what has none, such as a sheet
TILE = 0.05  # [m] side of the mold's prisms: they rise 0.3 mm too high at R = 1 m
FLOOR = 0.0  # [m] plane of base_link: mold and table are solid down to it


class NoGeometryError(Exception):
    """A URDF names no geometry, or a mesh of it cannot be read; says which."""


@dataclass(frozen=True)
class Solid:
    """A convex body in the frame of the joint that moves it.

    Attributes:
        name: Name of the link.
        joint: Number of the arm's joints before it.
        geometry: Coal's convex hull.
        axis: Ends of a segment, shape (2, 3), in [m].
        radius: Distance from the axis within which all points lie, [m].
        extent: Largest distance of a point from the joint's origin, [m].
    """

    name: str
    joint: int
    geometry: Any
    axis: Array
    radius: float
    extent: float


def solid(name: str, joint: int, points: Array) -> Solid:
    """Convex hull of points with a capsule around it.

    Args:
        name: Name of the link.
        joint: Number of the arm's joints before it.
        points: Shape (p, 3), in [m].
    """
    center = points.mean(axis=0)
    along = np.linalg.svd(points - center, full_matrices=False)[2][0]
    x = (points - center) @ along
    across = np.linalg.norm(points - center - x[:, None] * along, axis=1)
    axis = center + np.array([[x.min()], [x.max()]]) * along
    extent = float(np.linalg.norm(points, axis=1).max())
    return Solid(name, joint, hull(points), axis, float(across.max()), extent)


def hull(points: Array) -> Any:
    """Coal's convex hull of points, shape (p, 3), in [m].

    Flat sets get the thickness FLAT first: coal ends the process on them.
    """
    for axis in np.linalg.eigh(np.cov(points.T, bias=True))[1].T:
        if np.ptp(points @ axis) < FLAT:
            points = np.concatenate(
                [points - FLAT / 2 * axis, points + FLAT / 2 * axis]
            )
    vector = coal.StdVec_Vec3s()
    vector.extend(list(points))
    return coal.Convex.convexHull(vector, False, "")


@lru_cache(maxsize=4)
def arm_solids(urdf: str) -> tuple[Chain, tuple[Solid, ...]]:
    """Chain of an arm and the solids of its links.

    Args:
        urdf: Text of the arm's URDF.

    Raises:
        NoGeometryError: A link that moves has no geometry, or it cannot be read.
    """
    chain = read_chain(urdf)
    solids = []
    for link, points in link_points(urdf):
        if link in chain.links:
            joint, T = chain.links[link]
            solids.append(solid(link, joint, _moved(T, points)))
    bare = set(range(1, 1 + len(chain.names))) - {s.joint for s in solids}
    if bare:
        name = chain.names[min(bare) - 1]
        raise NoGeometryError(f"what joint {name} moves has no geometry")
    return chain, tuple(solids)


def link_points(urdf: str) -> Iterator[tuple[str, Array]]:
    """Link and points, shape (p, 3), in [m], of each part of a URDF's geometry.

    Collision geometry goes before what a link looks like.

    Raises:
        NoGeometryError: A mesh cannot be found or read.
    """
    for link in ElementTree.fromstring(urdf.encode()).findall("link"):
        parts = link.findall("collision") or link.findall("visual")
        for part in parts:
            shape = part.find("geometry/*")
            if shape is not None:
                yield (
                    str(link.get("name")),
                    _moved(origin(part.find("origin")), _points(shape)),
                )


def _moved(T: Array, points: Array) -> Array:
    """Points, shape (..., 3), taken through a rigid transform, shape (4, 4)."""
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])


def _points(shape: ElementTree.Element) -> Array:
    """Points whose hull contains a shape of a URDF, shape (p, 3), in [m]."""
    values = {
        key: np.array(text.split(), float)
        for key, text in shape.attrib.items()
        if key != "filename"
    }
    signs = np.array(list(np.ndindex(2, 2, 2))) - 0.5
    if shape.tag == "box":
        return np.asarray(signs * values["size"])
    if shape.tag == "sphere":
        return np.asarray(2 * signs * values["radius"])
    if shape.tag in ("cylinder", "capsule"):
        cap = values["radius"][0] if shape.tag == "capsule" else 0.0
        half = values["length"][0] / 2 + cap
        angle = 2 * np.pi * np.arange(ROUND) / ROUND
        rim = values["radius"][0] / np.cos(np.pi / ROUND)
        ring = rim * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        ends = [np.column_stack([ring, np.full(ROUND, z)]) for z in (-half, half)]
        return np.concatenate(ends)
    if shape.tag != "mesh":
        raise NoGeometryError(f"geometry {shape.tag!r} is unknown")
    scale = values.get("scale", np.ones(3)) * np.ones(3)
    return _mesh_points(str(shape.get("filename")), scale)


def _mesh_points(name: str, scale: Array) -> Array:
    """Vertices of a mesh file, shape (p, 3), in [m]."""
    relative = name.removeprefix("package://").removeprefix("file://")
    places = [*(folder / relative for folder in installed_folders()), Path(relative)]
    found = [path for path in places if path.is_file()]
    if not found:
        raise NoGeometryError(f"mesh {name} is missing")
    try:
        mesh = coal.MeshLoader().load(str(found[0]), scale)
        return np.unique(np.array(mesh.vertices()), axis=0)
    except (ValueError, RuntimeError) as error:
        raise NoGeometryError(f"mesh {name} cannot be read") from error


def mold_prisms(mold: HeightGrid, world_mold: Array) -> Array:
    """Corners of prisms that contain the mold and what carries it, in the world.

    Args:
        mold: The mold; prisms stand where it covers.
        world_mold: Placement of its frame, shape (4, 4), in [m].

    Returns:
        Shape (p, 8, 3), in [m]: four on top, and the same on the floor.
    """
    step, shape = np.array(mold.step), np.array(mold.heights.shape)
    width = np.maximum(1, np.rint(TILE / step).astype(int))
    tops = []
    for i in range(0, shape[0] - 1, width[0]):
        for j in range(0, shape[1] - 1, width[1]):
            part = slice(i, i + width[0] + 1), slice(j, j + width[1] + 1)
            if mold.covered[part].any():
                corner = np.array(mold.origin) + step * (i, j)
                top = _lid(mold.heights[part], mold.covered[part], step)
                top[:, :2] += corner
                tops.append(top)
    top = _moved(world_mold, np.array(tops))
    low = top.copy()
    low[..., 2] = min(FLOOR, float(top[..., 2].min()))
    return np.concatenate([top, low], axis=1)


def _lid(heights: Array, covered: NDArray[np.bool_], step: Array) -> Array:
    """Corners of a plane that no covered node of a patch rises above, shape (4, 3).

    It has the patch's mean slopes: any others would do, and lie higher.
    """
    i, j = np.nonzero(covered)
    count = np.array(heights.shape) - 1
    rise = (heights[-1] - heights[0]).mean(), (heights[:, -1] - heights[:, 0]).mean()
    slopes = np.array(rise) / count
    level = (heights[i, j] - slopes[0] * i - slopes[1] * j).max()
    ends = [(i.min(), j.min()), (i.min(), j.max()), (i.max(), j.min())]
    nodes = np.array([*ends, (i.max(), j.max())], float)
    return np.column_stack([nodes * step, level + nodes @ slopes])


def table_prism(size: Array, placement: Array) -> Array:
    """Corners of the pick table, solid down to the floor, shape (1, 8, 3), in [m].

    Args:
        size: Sides of the table, shape (2,), in [m].
        placement: Placement of the middle of its top, shape (4, 4), in [m].
    """
    signs = np.array(list(np.ndindex(2, 2))) - 0.5
    top = _moved(placement, np.column_stack([signs * size, np.zeros(4)]))
    low = top.copy()
    low[:, 2] = min(FLOOR, float(top[:, 2].min()) - TILE)
    return np.concatenate([top, low])[None]


def herd(prisms: Array) -> Any:
    """Coal's tree of fixed convex bodies with the corners given, (p, 8, 3), in [m]."""
    tree = coal.DynamicAABBTreeCollisionManager()
    for corners in prisms:
        tree.registerObject(coal.CollisionObject(hull(corners)))
    tree.setup()
    return tree


@dataclass(frozen=True)
class Legs:
    """Legs as capsules about the lines from universal joint to ball.

    Attributes:
        radius: Of each capsule, shape (n,), in [m].
        tube: First and last point beyond the universal joint, shape (n, 2), in [m].
        rod: The same beyond the ball, negative above it, shape (n, 2), in [m].
        longest: Largest distance of a point from the universal joint, [m].
    """

    radius: Array
    tube: Array
    rod: Array
    longest: float

    def ends(self, universals: Array, balls: Array, bare: float = 0.0) -> Array:
        """Ends of the capsules' axes.

        Args:
            universals: Upper ends of the legs, shape (..., n, 3), in [m].
            balls: Lower ends, shape (..., n, 3), in [m].
            bare: Length above the ball that is left out, in [m].

        Returns:
            Shape (..., n, 2, 3), in [m].
        """
        line = balls - universals
        length = np.linalg.norm(line, axis=-1)
        top = np.minimum(self.tube[:, 0], length + self.rod[:, 0])
        low = np.maximum(self.tube[:, 1], length + self.rod[:, 1])
        low = np.maximum(np.minimum(low, length - bare), top)
        share = np.stack([top, low], axis=-1) / length[..., None]
        return np.asarray(
            universals[..., None, :] + share[..., None] * line[..., None, :]
        )


@lru_cache(maxsize=4)
def tool_solids(
    urdf: str, leg_names: tuple[tuple[str, ...], ...], leg_max: float
) -> tuple[Array, Legs]:
    """Points of a tool's platform in tool0, shape (p, 3), in [m], and its legs.

    Args:
        urdf: Text of the tool's URDF.
        leg_names: Joints of each leg: ux, uy, stroke, sx, sy, sz.
        leg_max: Longest leg, [m].

    Raises:
        NoGeometryError: Platform or a leg has no geometry, or it cannot be read.
    """
    joints = {
        str(joint.get("name")): str(child.get("link"))
        for joint in ElementTree.fromstring(urdf.encode()).findall("joint")
        if (child := joint.find("child")) is not None
    }
    root = read_chain(urdf, tip="", root=_root(urdf)).links
    parts: dict[str, list[Array]] = {}
    platform = []
    for link, points in link_points(urdf):
        parts.setdefault(link, []).append(points)
        if link in root:
            platform.append(_moved(root[link][1], points))
    if not platform:
        raise NoGeometryError("the tool's platform has no geometry")
    spans = np.empty((len(leg_names), 2, 3))
    for k, names in enumerate(leg_names):
        for part, joint in enumerate((names[1], names[2])):
            if joints[joint] not in parts:
                raise NoGeometryError(
                    f"the tool's link {joints[joint]} has no geometry"
                )
            points = np.concatenate(parts[joints[joint]])
            across = np.linalg.norm(points[:, :2], axis=1).max()
            spans[k, part] = points[:, 2].min(), points[:, 2].max(), across
    tube, rod = spans[:, 0, :2], spans[:, 1, :2]
    longest = max(abs(tube).max(), leg_max + abs(rod).max())
    return np.concatenate(platform), Legs(
        spans[..., 2].max(axis=1), tube, rod, float(longest)
    )


def _root(urdf: str) -> str:
    """Name of the link that no joint carries."""
    root = ElementTree.fromstring(urdf.encode())
    carried = {child.get("link") for child in root.findall("joint/child")}
    names = [str(link.get("name")) for link in root.findall("link")]
    return next(name for name in names if name not in carried)
