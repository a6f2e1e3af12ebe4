"""Remarks: what a verdict says beyond the order of contact, and what it warns of."""

from __future__ import annotations

from typing import Any, NamedTuple

from drapeplan.arm_words import arm_lines
from drapeplan.sentences import ply_sentences
from drapeplan.words import touch_sentence


class Remark(NamedTuple):
    """A sentence on what a verdict rests on.

    Attributes:
        text: The sentence.
        warns: Whether it speaks of something that a good verdict does not vouch for.
        waypoint: Index of the waypoint it speaks of, or None.
    """

    text: str
    warns: bool = False
    waypoint: int | None = None


def remarks(verdict: dict[str, Any]) -> list[Remark]:
    """Links, landing, room, fibers, mold, ply model and arm, in sentences.

    Args:
        verdict: The verdict as plain data.
    """
    links, landing = verdict["interlinks"], verdict["landing"]
    limits, fibers = verdict["limits"], verdict["fibers"]
    low, high = limits["stroke_range_mm"]
    return [
        Remark(
            f"At the waypoints, interlinks within {_bound(links['worst_error_mm'])} "
            f"mm; placed cups within {_bound(landing['worst_distance_mm'])} mm and "
            f"{_bound(landing['worst_angle_deg'])} deg of their targets."
        ),
        Remark(touch_sentence(verdict["touch"])),
        Remark(
            f"Strokes {low:.0f} to {high:.0f} mm, "
            f"{limits['least_stroke_room_mm']:.0f} mm from the nearest end; "
            f"{limits['least_joint_room_deg']:.1f} deg to the nearest joint limit."
        ),
        Remark(
            f"Fibers have up to {max(0.0, fibers['largest_surplus_mm']):.2f} mm too "
            f"much between cups and {max(0.0, fibers['longest_need_mm']):.2f} mm too "
            f"little; the weave takes up {fibers['take_up_mm']:g} mm."
        ),
        Remark(f"Mold: {verdict['mold']}."),
        *_ply_remarks(verdict["ply_model"]),
        *_arm_remarks(verdict["arm"]),
    ]


def _ply_remarks(facts: dict[str, Any]) -> list[Remark]:
    """The ply model; where coupled patches lie off, the last sentence is on them."""
    *lines, last = ply_sentences(facts)
    (effect,) = (one for one in facts["effects"] if one["cause"] == "coupling")
    off = [one["measured_mm"] for one in facts["coupled"]]
    solved = [size for size in off if size is not None]
    far = bool(off) and (not solved or max(solved) > facts["tolerance_mm"])
    waypoint = None if effect["patch"] is None else effect["waypoint"]
    return [*map(Remark, lines), Remark(last, far, waypoint)]


def _arm_remarks(arm: dict[str, Any]) -> list[Remark]:
    """What the arm has left, and what it is to carry; no arm is no doubt."""
    clearance, *load = arm_lines(arm)
    unchecked = "payload" in arm and not arm["checked"]
    return [
        Remark(clearance, unchecked, arm.get("waypoint")),
        *(Remark(line, bool(arm["payload"]["exceeded"])) for line in load),
    ]


def _bound(value: float) -> str:
    """A small number as a bound: what is recorded ends at nine decimals."""
    return f"{max(value, 1e-9):.0e}"
