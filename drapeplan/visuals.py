"""What the arm looks like: colored bodies from its URDF, and where they are."""

import importlib.metadata
import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import trimesh
from numpy.typing import NDArray

from drapeplan.frames import pose, rpy
from urdf.arm import bound_joints

Array = NDArray[np.float64]

DETAIL = 2e-3  # [m] coarser cells let bodies that lie close show through each other
GRAY = (0.56, 0.60, 0.64)  # bodies without a color of their own
RADIUS = 0.045  # [m] of the rods that stand for an arm without meshes


class Body(NamedTuple):
    """A rigid body in the frame of the joint that moves it.

    Attributes:
        name: Name of the link.
        vertices: Shape (V, 3), in [m].
        faces: Vertex indices, shape (F, 3).
        colors: Red, green and blue from 0 to 1, shape (V, 3).
    """

    name: str
    vertices: Array
    faces: NDArray[np.int64]
    colors: Array


@dataclass(frozen=True)
class ArmVisuals:
    """Bodies of an arm, and the model that moves them.

    Attributes:
        bodies: The bodies; an arm whose meshes cannot be read is drawn as rods.
        joints: Pinocchio's index of the joint that moves each body.
        model: Pinocchio's model of the arm.
        simplified: True where rods stand for meshes.
    """

    bodies: list[Body]
    joints: list[int]
    model: pin.Model
    simplified: bool

    def placements(self, q: Array) -> Array:
        """Where the bodies are.

        Args:
            q: Joint angles of the arm, shape (K, 6), in [rad].

        Returns:
            T_base_body, shape (K, len(bodies), 4, 4), in [m].
        """
        data = self.model.createData()
        placed = np.empty((len(q), len(self.bodies), 4, 4))
        for k, angles in enumerate(np.asarray(q, float)):
            pin.forwardKinematics(self.model, data, angles)
            for n, joint in enumerate(self.joints):
                placed[k, n] = data.oMi[joint].homogeneous
        return placed


def arm_visuals(
    arm_urdf: str, package_dirs: Sequence[Path] | None = None, detail: float = DETAIL
) -> ArmVisuals:
    """Bodies of an arm from the meshes its URDF names.

    Args:
        arm_urdf: Text of the arm's URDF.
        package_dirs: Folders that package:// stands for; by default the one into which
            example-robot-data was installed.
        detail: Vertices nearer than this are merged, in [m]; 0 keeps all.

    Returns:
        The bodies. Where a mesh is missing or cannot be read, rods between the origins
        of the joints: a picture is never worth a failure.
    """
    model = pin.buildModelFromXML(bound_joints(arm_urdf))
    folders = installed_folders() if package_dirs is None else list(package_dirs)
    try:
        found = list(_meshes(arm_urdf, model, folders))
    except Exception:  # readers of mesh formats raise errors of any type
        found = []
    bodies = found or list(_rods(model))
    merged = [merge_vertices(body, detail) for _, body in bodies]
    return ArmVisuals(merged, [joint for joint, _ in bodies], model, not found)


def installed_folders() -> list[Path]:
    """Folder in which example-robot-data's meshes stand, if it is installed."""
    try:
        files = importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError:
        return []
    for file in files:
        if file.suffix == ".urdf" and "example-robot-data" in file.parts:
            depth = len(file.parts) - file.parts.index("example-robot-data")
            return [Path(str(file.locate())).parents[depth - 1]]
    return []


def _meshes(
    urdf: str, model: pin.Model, folders: list[Path]
) -> Iterable[tuple[int, Body]]:
    """Joint and body of each visual element of a URDF, in the URDF's order."""
    for link in ElementTree.fromstring(urdf.encode()).iter("link"):
        name = str(link.get("name"))
        for visual in link.iter("visual"):
            frame = model.frames[model.getFrameId(name, pin.FrameType.BODY)]
            shape = visual.find("geometry/*")
            if shape is None:
                continue
            scene = _shape(shape, folders)
            T_joint_body = frame.placement.homogeneous @ _origin(visual.find("origin"))
            yield int(frame.parentJoint), _body(name, scene, T_joint_body)


def _origin(element: ElementTree.Element | None) -> Array:
    """Transform of a URDF's <origin>; the identity where there is none."""
    values = {} if element is None else element.attrib
    angles, place = (
        np.array(values.get(key, "0 0 0").split(), float) for key in ("rpy", "xyz")
    )
    return pose(rpy(angles), place)


def _shape(element: ElementTree.Element, folders: list[Path]) -> trimesh.Scene:
    """Geometry of a visual element as a scene of colored meshes."""
    values = {key: np.array(value.split(), float) for key, value in _sizes(element)}
    if element.tag == "box":
        return trimesh.Scene(trimesh.creation.box(values["size"]))
    if element.tag == "sphere":
        return trimesh.Scene(trimesh.creation.icosphere(2, float(values["radius"][0])))
    if element.tag == "cylinder":
        radius, length = float(values["radius"][0]), float(values["length"][0])
        return trimesh.Scene(trimesh.creation.cylinder(radius, length))
    scene = trimesh.load_scene(_locate(str(element.get("filename")), folders))
    scale = values.get("scale", np.ones(3))
    scene.apply_transform(np.diag([*(scale * np.ones(3)), 1.0]))
    return scene


def _sizes(element: ElementTree.Element) -> Iterable[tuple[str, str]]:
    return ((k, v) for k, v in element.attrib.items() if k != "filename")


def _locate(name: str, folders: list[Path]) -> Path:
    """Find a mesh by its package:// address or its path.

    Raises:
        FileNotFoundError: If it is nowhere.
    """
    relative = name.removeprefix("package://").removeprefix("file://")
    for path in (*(folder / relative for folder in folders), Path(relative)):
        if path.is_file():
            return path
    raise FileNotFoundError(name)


def _body(name: str, scene: trimesh.Scene, T_joint_body: Array) -> Body:
    """One body from all meshes of a scene, with the color of each mesh's material."""
    vertices, faces, colors, count = [], [], [], 0
    for mesh in scene.dump():
        placed = mesh.vertices @ T_joint_body[:3, :3].T + T_joint_body[:3, 3]
        vertices.append(placed)
        faces.append(np.asarray(mesh.faces) + count)
        colors.append(np.tile(_color(mesh), (len(placed), 1)))
        count += len(placed)
    parts = (np.concatenate(part) for part in (vertices, faces, colors))
    return Body(name, *parts)


def _color(mesh: trimesh.Trimesh) -> Array:
    material = getattr(mesh.visual, "material", None)
    if material is None:
        return np.array(GRAY)
    return np.asarray(material.main_color[:3]) / 255


def _rods(model: pin.Model) -> Iterable[tuple[int, Body]]:
    """Rods from each joint's origin to the origins of what it carries."""
    ends = [
        (model.parents[j], model.jointPlacements[j]) for j in range(1, model.njoints)
    ]
    ends += [
        (f.parentJoint, f.placement)
        for f in model.frames
        if f.type == pin.FrameType.BODY
    ]
    seen = set()
    for (joint, placement), count in zip(ends, itertools.count()):
        end = np.array(placement.translation)
        key = (int(joint), *np.round(end / RADIUS).tolist())
        if key in seen or np.linalg.norm(end) < RADIUS:
            continue
        seen.add(key)
        rod = trimesh.creation.capsule(np.linalg.norm(end), RADIUS, count=[12, 12])
        rod.apply_translation(-rod.bounds.mean(axis=0))
        T_joint_rod = np.array(trimesh.geometry.align_vectors([0, 0, 1], end))
        T_joint_rod[:3, 3] = end / 2
        yield int(joint), _body(f"rod {count}", trimesh.Scene(rod), T_joint_rod)


def merge_vertices(body: Body, detail: float) -> Body:
    """Merge vertices of one color that share a cell of a grid, drop what collapses.

    Args:
        body: The body.
        detail: Edge of the cells, in [m]; 0 changes nothing.

    Returns:
        A body whose vertices are the means of the cells.
    """
    if detail == 0:
        return body
    key = np.hstack([np.rint(body.vertices / detail), np.rint(255 * body.colors)])
    _, cell = np.unique(key, axis=0, return_inverse=True)
    cell = cell.ravel()
    size = np.bincount(cell)[:, None]
    means = [
        np.stack([np.bincount(cell, column) for column in values.T], axis=1) / size
        for values in (body.vertices, body.colors)
    ]
    faces = cell[body.faces]
    faces = faces[np.all(faces != np.roll(faces, 1, axis=1), axis=1)]
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    used, faces = np.unique(faces[np.sort(first)], return_inverse=True)
    return Body(body.name, means[0][used], faces.reshape(-1, 3), means[1][used])
