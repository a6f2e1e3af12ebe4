"""Arm check: room to limits, singularities, clearance and payload along a drape."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drapeplan.arm_clearance import SAFE, SELF, clearances, ply_size
from drapeplan.cell import Cell
from drapeplan.chain import Chain, read_chain
from drapeplan.clearance import Least, between
from drapeplan.solids import NoGeometryError
from drapeplan.track import Track
from urdf.arm import mass_of, payload_of

Array = NDArray[np.float64]

SINGULAR = 0.05  # [m] least singular value: a UR10 within 11 deg of a straight wrist
FINEST = np.radians(3)  # [rad] largest joint travel between looks at the Jacobian
LIMIT = 1e-6  # [rad] largest excess over a joint limit
DECIMALS = 2  # of clearances in [mm]: what GJK repeats on any machine


def judge_arm(cell: Cell, track: Track) -> dict[str, Any]:
    """What the arm has left along a drape, and whether that is enough.

    Args:
        cell: Robot, mold and ply.
        track: The drape.

    Returns:
        Plain data with units in the keys. `good` is None where all that could be
        checked is good, yet a geometry is missing. Without an arm nothing is looked at.
    """
    if cell.robot.armless:
        problem = "there is none: tool0 is taken where the path has it"
        return {"good": True, "checked": False, "problem": problem}
    chain = read_chain(cell.sources.arm_urdf)
    facts = {**_limits(track), **_singularity(cell, chain, track)}
    good = facts.pop("within") and facts["least_singular_value_m"] >= SINGULAR
    try:
        rows = [_row(kind, least) for kind, least in clearances(cell, track)]
    except NoGeometryError as error:
        facts |= {"checked": False, "problem": str(error)}
        return {"good": None if good else False, **facts, "payload": payload(cell)}
    tight = [row for row in rows if row["least_mm"] < row["needed_mm"]]
    told = tight or [row for row in rows if not _by_design(str(row["what"]))]
    worst = min(told, key=lambda row: float(row["least_mm"]))
    return {
        "good": bool(good and not tight),
        "checked": True,
        "least_clearance_mm": worst["least_mm"],
        **{key: worst[key] for key in ("between", "waypoint", "share", "needed_mm")},
        "clearances": rows,
        **facts,
        "payload": payload(cell),
    }


def _row(kind: str, least: Least) -> dict[str, Any]:
    """One kind of clearance as plain data."""
    return {
        "what": kind,
        "least_mm": round(1e3 * least.distance, DECIMALS) + 0.0,
        "needed_mm": 1e3 * (SELF if kind == "arm to arm" else SAFE),
        "between": list(least.between),
        "waypoint": least.waypoint,
        "share": round(least.share, 6),
    }


def _by_design(kind: str) -> bool:
    """Whether bodies are always near: links of the arm, legs over what cups touch."""
    return kind == "arm to arm" or kind.startswith("legs to")


def _limits(track: Track) -> dict[str, Any]:
    """Room of the arm's joints."""
    robot, columns = track.robot, track.robot.arm_columns
    lower, upper = robot.lower[columns], robot.upper[columns]
    room = np.minimum(track.arm - lower, upper - track.arm)
    k, joint = np.unravel_index(room.argmin(), room.shape)
    return {
        "within": bool(room.min() >= -LIMIT),
        "least_joint_room_deg": round(float(np.degrees(room.min())), 9),
        "tightest_joint": robot.arm_names[int(joint)],
        "tightest_waypoint": int(k),
    }


def _singularity(cell: Cell, chain: Chain, track: Track) -> dict[str, Any]:
    """The least singular value along the way, looked at every FINEST."""
    steps = np.abs(np.diff(track.arm, axis=0)).max(axis=1, initial=0.0)
    looks = np.maximum(1, np.ceil(steps / FINEST)).astype(int)
    k = np.append(np.repeat(np.arange(len(looks)), looks), len(looks))
    first = np.cumsum(np.append(0, looks))
    share = (np.arange(len(k)) - first[k]) / np.append(looks, 1)[k]
    q, where = np.unique(between(track.arm, k, share), axis=0, return_inverse=True)
    span = tool_span(cell)
    singular, volume = least_singular_value(chain, q, span)
    i = int(singular[where.ravel()].argmin())
    return {
        "least_singular_value_m": round(float(singular.min()), 9),
        "needed_singular_value_m": SINGULAR,
        "singular_waypoint": int(k[i]),
        "rotation_length_m": round(span, 9),
        "least_manipulability_m6": round(float(volume.min()), 9),
    }


def least_singular_value(chain: Chain, q: Array, length: float) -> tuple[Array, Array]:
    """Distance of configurations from a singularity.

    Turns are made lengths by the distance from tool0 of an outermost leg, so that a
    singular value is how far the tool moves, at its rim, for a radian of the joints:
    at 0 there is a motion that no joint speed gives it.

    Args:
        chain: The arm.
        q: Joint angles, shape (m, 6), in [rad].
        length: That distance, in [m].

    Returns:
        Least singular value of the Jacobian of tool0 with its lower rows times the
        length, in [m], and manipulability |det|, in [m^6] [Yoshikawa1985]; (m,) each.
    """
    J = chain.jacobians(chain.frames(q))
    scaled = J * np.repeat([1.0, length], 3)[:, None]
    values = np.linalg.svd(scaled, compute_uv=False)
    return values[:, -1], values.prod(axis=1)


def tool_span(cell: Cell) -> float:
    """Distance of an outermost leg from the tool's axis, [m]."""
    grid = cell.grid
    return float(grid.pitch * np.hypot(grid.rows - 1, grid.columns - 1) / 2)


def payload(cell: Cell) -> dict[str, Any]:
    """Mass of tool and ply against what the arm may carry.

    Args:
        cell: Robot, mold and ply.

    Returns:
        Masses in [kg]; `payload_kg` and `exceeded` are None for an unknown arm.
    """
    links = cell.robot.tool.interlinks
    tool = mass_of(cell.sources.tool_urdf) + links.mass * len(links.pairs)
    ply = float(np.prod(ply_size(cell)))
    ply *= cell.scene.ply.areal_mass_kg_m2
    allowed = cell.scene.robot.payload_kg or payload_of(cell.sources.arm_urdf)
    return {
        "tool_kg": round(tool, 6),
        "ply_kg": round(ply, 6),
        "payload_kg": allowed,
        "exceeded": None if allowed is None else bool(tool + ply > allowed),
    }
