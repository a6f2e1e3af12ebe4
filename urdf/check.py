"""Does a tool's URDF hold the legs that its sidecar describes?"""

from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from drapeplan.errors import InputError
from urdf.sidecar import Sidecar

LEG_JOINTS = ("ux", "uy", "stroke", "sx", "sy", "sz")
LEG_KINDS = (  # type and axis of each
    ("revolute", "1 0 0"),
    ("revolute", "0 1 0"),
    ("prismatic", "0 0 1"),
    ("revolute", "1 0 0"),
    ("revolute", "0 1 0"),
    ("revolute", "0 0 1"),
)
SAME = 1e-9  # [m, rad] URDF and sidecar agree: well above the URDF's 12 digits
SOURCE = "tool URDF"
WRITE_BOTH = "write URDF and sidecar with one call of drapeplan tool"


def cup_name(pattern: str, columns: int, cup: int) -> str:
    """Fill a name pattern of the sidecar in for one cup, by its index."""
    row, column = divmod(cup, columns)
    return pattern.replace("{row}", str(row)).replace("{column}", str(column))


def leg_names(tool: Sidecar) -> list[tuple[str, ...]]:
    """Names of each leg's joints, ux, uy, stroke, sx, sy, sz, by cup index."""
    patterns = [tool.leg_name] * 3 + [tool.cup_name] * 3
    parts = list(zip(patterns, LEG_JOINTS, strict=True))
    return [
        tuple(
            f"{cup_name(pattern, tool.columns, cup)}_{joint}"
            for pattern, joint in parts
        )
        for cup in range(tool.rows * tool.columns)
    ]


def check_tool(urdf: str, tool: Sidecar, universals: NDArray[np.float64]) -> None:
    """Check that every leg is the chain of drapeplan.legs, with the sidecar's sizes.

    The planner moves legs by their closed form, so a URDF that says otherwise would
    be drawn and built otherwise than planned.

    Args:
        urdf: Text of the tool's URDF, well-formed.
        tool: Its sidecar.
        universals: Universal joints in the tool frame, shape (n, 3), in [m].

    Raises:
        InputError: A joint is missing, or its type, parent, place, axis or stroke is
            another; there are other movable joints.
    """
    root = ElementTree.fromstring(urdf.encode())
    joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
    fixed = {_end(j, "child"): j for j in joints.values() if j.get("type") == "fixed"}
    children = {_end(joint, "child") for joint in joints.values()}
    roots = {link.get("name", "") for link in root.findall("link")} - children
    if len(roots) != 1:
        raise InputError(SOURCE, "", f"has {len(roots)} root links, not one")
    (base,) = roots
    zero, down = np.zeros(3), np.array([0.0, 0.0, tool.leg_min])
    drop = np.array([0.0, 0.0, tool.ball_height])
    for cup, names in enumerate(leg_names(tool)):
        places, link = [universals[cup], zero, down, zero, zero, zero], base
        for name, (kind, axis), place in zip(names, LEG_KINDS, places, strict=True):
            _check_joint(_found(joints, name), name, kind, link, place)
            _check_axis(joints[name], name, axis)
            link = _end(joints[name], "child")
        _check_stroke(joints[names[2]], names[2], tool.leg_max - tool.leg_min)
        face = cup_name(tool.face_name, tool.columns, cup)
        _check_joint(_found(fixed, face), face, "fixed", link, drop)
    movable = sum(joint.get("type") != "fixed" for joint in joints.values())
    if movable != 6 * tool.rows * tool.columns:
        problem = f"has {movable} movable joints, not six for each cup"
        raise InputError(SOURCE, "", problem, WRITE_BOTH)


def _found(joints: dict[str, Element], name: str) -> Element:
    """The joint of a name."""
    if name not in joints:
        raise InputError(SOURCE, name, "there is no such joint or frame", WRITE_BOTH)
    return joints[name]


def _end(joint: Element, end: str) -> str:
    """Link at one end of a joint, "parent" or "child"."""
    link = joint.find(end)
    return "" if link is None else link.get("link", "")


def _numbers(joint: Element, tag: str, key: str, default: str) -> NDArray[np.float64]:
    """Numbers in an attribute of a joint's child."""
    child = joint.find(tag)
    text = default if child is None else child.get(key, default)
    return np.array([float(word) for word in text.split()])


def _check_joint(
    joint: Element, name: str, kind: str, parent: str, place: NDArray[np.float64]
) -> None:
    """A joint has its type and its parent and stands in its place, not turned."""
    if joint.get("type") != kind:
        raise InputError(SOURCE, name, f"is {joint.get('type')}, not {kind}")
    if _end(joint, "parent") != parent:
        raise InputError(SOURCE, name, f"does not follow link {parent}")
    given = [_numbers(joint, "origin", key, "0 0 0") for key in ("xyz", "rpy")]
    error = float(np.abs(np.subtract(given, [place, np.zeros(3)])).max())
    if not error <= SAME:
        problem = f"is {error:.2g} m or rad from where the sidecar's sizes put it"
        raise InputError(SOURCE, name, problem, WRITE_BOTH)


def _check_axis(joint: Element, name: str, axis: str) -> None:
    """A joint moves about or along its axis."""
    given = _numbers(joint, "axis", "xyz", "1 0 0")
    if not np.array_equal(given, [float(word) for word in axis.split()]):
        raise InputError(SOURCE, name, f"its axis is not {axis}")


def _check_stroke(joint: Element, name: str, travel: float) -> None:
    """An actuator runs from zero to the travel that the sidecar gives it."""
    limits = [_numbers(joint, "limit", key, "0")[0] for key in ("lower", "upper")]
    if not np.abs(np.subtract(limits, [0.0, travel])).max() <= SAME:
        problem = "its limits are not those of the sidecar's leg"
        raise InputError(SOURCE, name, problem, WRITE_BOTH)
