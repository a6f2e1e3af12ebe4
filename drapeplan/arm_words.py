"""Arm words: what the arm check found, in sentences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

REMEDIES = {
    "mold": "move the mold away from the arm's base or lower it (mold.position_m), or "
    "pass it higher (motion.clearance_mm)",
    "pick table": "move the table away from the arm's base or lower it "
    "(pick.position_m), or pick further from the mold",
    "arm": "give another posture (robot.home_rad)",
    "tool": "carry the tool lower (mold.position_m, pick.position_m), pick with the "
    "tool turned (pick.yaw_deg), or give another posture (robot.home_rad)",
}


def arm_failures(arm: dict[str, Any], labels: Sequence[str]) -> list[str]:
    """One sentence for each thing that makes the arm's part of a verdict bad.

    Args:
        arm: That part.
        labels: What to call each waypoint.
    """
    if "least_singular_value_m" not in arm:  # no arm
        return []
    lines = []
    for row in arm.get("clearances", ()):
        if row["least_mm"] < row["needed_mm"]:
            lines.append(_near(row, labels))
    if arm["least_singular_value_m"] < arm["needed_singular_value_m"]:
        k = arm["singular_waypoint"]
        lines.append(
            f"The arm comes near a singularity at waypoint {k + 1} ({labels[k]}): its "
            f"least singular value is {1e3 * arm['least_singular_value_m']:.0f} mm, "
            f"{1e3 * arm['needed_singular_value_m']:.0f} mm are needed: move mold or "
            "pick table, or give another posture (robot.home_rad)."
        )
    if arm["least_joint_room_deg"] < 0:
        k = arm["tightest_waypoint"]
        lines.append(
            f"Joint {arm['tightest_joint']} of the arm passes its limit by "
            f"{-arm['least_joint_room_deg']:.2g} deg at waypoint {k + 1} "
            f"({labels[k]}): give another posture (robot.home_rad)."
        )
    return lines


def arm_lines(arm: dict[str, Any]) -> list[str]:
    """What the arm has left, and warnings.

    Args:
        arm: The arm's part of a verdict.
    """
    if "payload" not in arm:
        return [f"Arm: {arm['problem']}; platform and legs are not checked either."]
    lines = []
    if arm["checked"]:
        a, b = arm["between"]
        least = {row["what"]: row["least_mm"] for row in arm["clearances"]}
        lines.append(
            f"Arm: least clearance {arm['least_clearance_mm']:.0f} mm, between {a} and "
            f"{b}; {least['arm to mold']:.0f} mm to the mold, "
            f"{least['arm to pick table']:.0f} mm to the pick table."
        )
    else:
        lines.append(
            f"Arm: clearance not checked, as {arm['problem']}; install the meshes, or "
            "give each link of the URDF boxes or cylinders."
        )
    load = arm["payload"]
    if load["exceeded"]:
        lines.append(
            f"Warning: tool and ply weigh {load['tool_kg'] + load['ply_kg']:.1f} kg, "
            f"the arm may carry {load['payload_kg']:g} kg."
        )
    elif load["payload_kg"] is None:
        lines.append(
            f"Tool and ply weigh {load['tool_kg'] + load['ply_kg']:.1f} kg; what the "
            "arm may carry is not known (robot.payload_kg)."
        )
    return lines


def _near(row: dict[str, Any], labels: Sequence[str]) -> str:
    """A clearance that is too small."""
    a, b = row["between"]
    k, least = row["waypoint"], row["least_mm"]
    how = f"overlap by {-least:.1f} mm" if least < 0 else f"stand {least:.1f} mm apart"
    n = k + 1
    when = f"waypoint {n}" if row["share"] == 0 else f"waypoints {n} and {n + 1}"
    when = f"{'at' if row['share'] == 0 else 'between'} {when} ({labels[k]})"
    kind = row["what"].split(" to ")[1]
    remedy = REMEDIES.get(kind, REMEDIES["tool"])
    return f"{a} and {b} {how} {when}, {row['needed_mm']:g} mm are needed: {remedy}."
