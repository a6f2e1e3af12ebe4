"""URDFs of arms: found by name, and made fit for a planner that adds to angles."""

import importlib.metadata
import math
from pathlib import Path
from xml.etree import ElementTree

from drapeplan.errors import InputError

TURN = f"{2 * math.pi:.12g}"  # [rad] either way, for joints that name no limits
END = "_robot.urdf"
NO_ARM = "none"  # the name that takes tool0 wherever a path has it
_SLIDE = '<limit lower="-100" upper="100" effort="1e5" velocity="1"/>'
_TURN = f'<limit lower="-{TURN}" upper="{TURN}" effort="1e5" velocity="1"/>'
_JOINTS = (  # kind, axis and roll, pitch; the angles of a UR10's home hang the tool
    *(("prismatic", axis, "0 0") for axis in ("1 0 0", "0 1 0", "0 0 1")),
    ("revolute", "1 0 0", f"{math.pi + 1.97:.12g} 0"),
    ("revolute", "0 1 0", f"0 {math.pi / 2:.12g}"),
    ("revolute", "0 0 1", "0 0"),
)
PAYLOADS = {  # [kg] by the robot's name in its URDF, as the maker states them
    "ur3": 3.0,
    "ur3e": 3.0,
    "ur5": 5.0,
    "ur5e": 5.0,
    "ur10": 10.0,
    "ur10e": 12.5,
    "ur16e": 16.0,
}


def arm_names() -> dict[str, importlib.metadata.PackagePath]:
    """Arms of example-robot-data by name, each with the place of its URDF.

    The package ships data and no Python module, so its record of files is asked.
    """
    try:
        stored = importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError:
        stored = []
    arms = [f for f in stored if f.name.endswith(END) and "ur_description" in f.parts]
    return {f.name.removesuffix(END): f for f in sorted(arms)}


def read_arm(name_or_path: str | Path) -> str:
    """Read the text of an arm's URDF.

    Args:
        name_or_path: A name such as "ur10", "none" for three slides and three turns
            without a body, or the path of a URDF. Anything with a folder or the suffix
            .urdf in it is a path.

    Returns:
        Text of the URDF.

    Raises:
        InputError: The name is unknown or the file cannot be read.
    """
    path = Path(name_or_path)
    if str(path) == NO_ARM:
        return _no_arm()
    try:
        if path.suffix == ".urdf" or len(path.parts) > 1:
            return path.read_text("utf-8")
        known = arm_names()
        if str(path) in known:
            return Path(str(known[str(path)].locate())).read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise InputError(str(path), "", f"cannot be read: {reason}") from error
    remedy = f"use {', '.join(known) or 'pip install example-robot-data'}, or a path"
    raise InputError("robot", "name", f"no arm is called {str(path)!r}", remedy)


def _no_arm() -> str:
    """Six joints that take tool0 anywhere, none of which is a body."""
    links = ["base_link", *(f"frame_{k}" for k in range(1, 6)), "tool0"]
    joints = [
        f'<joint name="arm_{k}" type="{kind}"><parent link="{links[k]}"/>'
        f'<child link="{links[k + 1]}"/><origin xyz="0 0 0" rpy="{turned} 0"/>'
        f'<axis xyz="{axis}"/>{_SLIDE if kind == "prismatic" else _TURN}</joint>'
        for k, (kind, axis, turned) in enumerate(_JOINTS)
    ]
    bodies = "".join(f'<link name="{link}"/>' for link in links)
    return f'<robot name="{NO_ARM}">{bodies}{"".join(joints)}</robot>'


def bound_joints(urdf: str, source: str = "arm URDF") -> str:
    """Turn continuous joints into revolute ones that may turn once either way.

    A continuous joint would be a point on a circle, with two numbers for one angle.

    Args:
        urdf: Text of a URDF.
        source: What error messages call it.

    Returns:
        The same text where no joint is continuous, else an equivalent one.

    Raises:
        InputError: The text is no XML, or such a joint has no velocity limit.
    """
    try:
        root = ElementTree.fromstring(urdf.encode())
    except ElementTree.ParseError as error:
        raise InputError(source, "", f"no valid XML: {error}") from error
    endless = [j for j in root.findall("joint") if j.get("type") == "continuous"]
    for joint in endless:
        limit = joint.find("limit")
        if limit is None:
            problem = "is continuous and has no velocity limit"
            remedy = "add <limit effort=... velocity=.../>"
            raise InputError(source, str(joint.get("name")), problem, remedy)
        joint.set("type", "revolute")
        limit.set("lower", f"-{TURN}")
        limit.set("upper", TURN)
    return ElementTree.tostring(root, "unicode") if endless else urdf


def payload_of(urdf: str) -> float | None:
    """What an arm may carry, in [kg]; None where its name is not known.

    Args:
        urdf: Text of a URDF.
    """
    name = ElementTree.fromstring(urdf.encode()).get("name", "")
    return PAYLOADS.get(name.lower().removesuffix("_robot"))


def mass_of(urdf: str) -> float:
    """Sum of the masses of all links, in [kg].

    Args:
        urdf: Text of a URDF.
    """
    root = ElementTree.fromstring(urdf.encode())
    return sum(float(m.get("value", 0)) for m in root.findall("link/inertial/mass"))
