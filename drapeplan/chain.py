"""Chain: the arm's links and joints for many configurations at once, from its URDF.

Pinocchio moves one configuration at a time, and its Data of arm and tool would hold
820 MB; clearances are asked for along a whole path. So the chain of six joints is read
once more here, and the tests hold it to Pinocchio.
"""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from drapeplan.frames import inverse, pose, rpy

Array = NDArray[np.float64]
MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class Chain:
    """Joints from the root to a tip, all revolute.

    Attributes:
        names: Names of the moving joints, m of them.
        steps: Placement of each joint in the frame of the one before, (m, 4, 4).
        axes: Axis of each joint in its own frame, unit vectors, shape (m, 3).
        tip: Placement of the tip in the frame of the last joint, shape (4, 4).
        links: Link to the number of moving joints before it and its placement in the
            frame of the last of them; 0 is the root. Links off the chain are left out.
    """

    names: tuple[str, ...]
    steps: Array
    axes: Array
    tip: Array
    links: dict[str, tuple[int, Array]]

    def frames(self, q: Array) -> Array:
        """Placements of the root and of each joint's frame in the root.

        Args:
            q: Joint angles, shape (..., m), in [rad].

        Returns:
            Shape (..., m + 1, 4, 4), in [m].
        """
        turns = np.zeros((*q.shape, 4, 4))
        turns[..., :3, :3], turns[..., 3, 3] = _turns(self.axes, q), 1.0
        frames = [np.broadcast_to(np.eye(4), (*q.shape[:-1], 4, 4))]
        for k, step in enumerate(self.steps):
            frames.append(frames[-1] @ step @ turns[..., k, :, :])
        return np.stack(frames, axis=-3)

    def jacobians(self, frames: Array) -> Array:
        """Velocity of the tip's origin over its angular velocity, by joint.

        Args:
            frames: What `frames` returned, shape (..., m + 1, 4, 4).

        Returns:
            In the root's directions, shape (..., 6, m), in [m] and [rad] per [rad].
        """
        axes = (frames[..., 1:, :3, :3] @ self.axes[..., None])[..., 0]
        tip = (frames[..., -1, :, :] @ self.tip)[..., None, :3, 3]
        linear = np.cross(axes, tip - frames[..., 1:, :3, 3])
        return np.swapaxes(np.concatenate([linear, axes], axis=-1), -1, -2)

    def reach(self, joint: int, radius: float) -> Array:
        """How far points of a body stay from the axes before it, whatever the angles.

        Args:
            joint: Number of moving joints before the body.
            radius: Largest distance of its points from that joint's origin, [m].

        Returns:
            Bound for each joint, 0 for those behind the body, shape (m,), in [m].
        """
        links = np.linalg.norm(self.steps[:, :3, 3], axis=1)
        bounds = np.zeros(len(self.names))
        for k in range(joint):
            bounds[k] = links[k + 1 : joint].sum() + radius
        return bounds


def read_chain(urdf: str, tip: str = "tool0", root: str = "base_link") -> Chain:
    """The chain of a URDF that a Robot has accepted.

    Args:
        urdf: Text of the URDF.
        tip: Link at the end.
        root: Link at the start.
    """
    joints = _joints(urdf)
    path: list[ElementTree.Element] = []
    link = tip
    while link != root and link in joints:
        path.insert(0, joints[link])
        link = _end(joints[link], "parent")
    names: list[str] = []
    steps, axes, here = [], [], np.eye(4)
    links = {root: (0, np.eye(4))}
    for joint in path:
        here = here @ origin(joint.find("origin"))
        if joint.get("type") in MOVING:
            names.append(str(joint.get("name")))
            steps.append(here)
            axes.append(_axis(joint))
            here = np.eye(4)
        links[_end(joint, "child")] = (len(names), here)
    _add_fixed(links, joints)
    shapes = np.reshape(steps, (-1, 4, 4)), np.reshape(axes, (-1, 3))
    return Chain(tuple(names), *shapes, links.get(tip, (0, np.eye(4)))[1], links)


def _add_fixed(
    links: dict[str, tuple[int, Array]], joints: dict[str, ElementTree.Element]
) -> None:
    """Links that fixed joints carry, before the root or beside the chain."""
    for _ in joints:
        before = len(links)
        for child, joint in joints.items():
            parent = _end(joint, "parent")
            if joint.get("type") != "fixed" or (child in links) == (parent in links):
                continue
            T = origin(joint.find("origin"))
            if parent in links:
                k, at = links[parent]
                links[child] = k, at @ T
            else:
                k, at = links[child]
                links[parent] = k, at @ inverse(T)
        if len(links) == before:
            return


def origin(element: ElementTree.Element | None) -> Array:
    """Transform of a URDF's <origin>, shape (4, 4); the identity where it is none."""
    values = {} if element is None else element.attrib
    angles, place = (
        np.array(values.get(key, "0 0 0").split(), float) for key in ("rpy", "xyz")
    )
    return pose(rpy(angles), place)


def _joints(urdf: str) -> dict[str, ElementTree.Element]:
    """Joint elements by the link that they carry."""
    root = ElementTree.fromstring(urdf.encode())
    joints = [j for j in root.findall("joint") if j.find("child") is not None]
    return {_end(joint, "child"): joint for joint in joints}


def _end(joint: ElementTree.Element, which: str) -> str:
    """Name of the link at one end of a joint."""
    end = joint.find(which)
    return "" if end is None else str(end.get("link"))


def _axis(joint: ElementTree.Element) -> Array:
    """Unit vector of a joint's axis; x where a URDF says nothing."""
    element = joint.find("axis")
    text = "1 0 0" if element is None else str(element.get("xyz", "1 0 0"))
    axis = np.array(text.split(), float)
    unit: Array = axis / np.linalg.norm(axis)
    return unit


def _turns(axes: Array, q: Array) -> Array:
    """Rotations by angles q, shape (..., m), about axes (m, 3): (..., m, 3, 3)."""
    x, y, z = axes.T
    zero = np.zeros_like(x)
    skew = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)
    sin, cos = (f(q)[..., None, None] for f in (np.sin, np.cos))
    return np.asarray(np.eye(3) + sin * skew + (1 - cos) * (skew @ skew))
