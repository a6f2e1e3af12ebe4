"""Words: a verdict in sentences that a laminator would use.

Sentences count waypoints from 1, as the preview does; plain data holds indices, from 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from drapeplan.arm_words import arm_failures
from drapeplan.path import CupState
from drapeplan.sentences import near, sentences
from drapeplan.track import Track
from drapeplan.verdict import FrontVerdict

KINEMATIC = (
    "Fidelity kinematic: the passive joints follow the request, as if something "
    "steered them; the real tool's cups lag in tilt, so the margins are optimistic."
)
EQUILIBRIUM = (
    "Fidelity equilibrium: the passive joints rest where weight, ply and links leave "
    "them, and strokes lead the tilt lag. Without that lead, cups would be up to "
    "{:.2f} mm and {:.1f} deg off before they land."
)

ROUNDED = 1e-6  # [-] of a last decimal: what rounding leaves


def labels(track: Track) -> list[str]:
    """A name for each waypoint, such as "Wave step 3, row 5 lands"."""
    steps = max(int(track.step.max()) + 1, 1)
    names = []
    for k, phase in enumerate(track.phase):
        if phase != "wave":
            names.append(phase.capitalize())
        elif track.step[k] < 0:
            names.append("Start cup")
        else:
            names.append(f"Wave step {track.step[k] + 1} of {steps}")
    return names


def describe(track: Track) -> list[str]:
    """A longer name for each waypoint, for the preview."""
    columns = track.robot.columns
    texts = []
    for k, name in enumerate(labels(track)):
        landing = (track.states[k] == CupState.LANDING).nonzero()[0]
        if len(landing) == 1:
            i, j = divmod(int(landing[0]), columns)
            texts.append(f"{name}: cup ({i}, {j}) lands")
        elif len(landing):
            texts.append(f"{name}: {len(landing)} cups land")
        else:
            texts.append(name)
    return texts


def failures(verdict: dict[str, Any], front: FrontVerdict, track: Track) -> list[str]:
    """One sentence for each thing that makes a verdict bad, worst kind first."""
    lines = []
    names = labels(track)
    if not front.passed:
        lines += sentences(front, names)[: 1 + len(front.events)]
    if not front.starts_free:
        lines.append("The ply is picked where the mold stands: move one of them.")
    links = verdict["interlinks"]
    if not links["good"]:
        a, b = links["between"]
        error = links["worst_error_mm"]
        lines.append(
            f"The interlink between cups {a} and {b} is off by {error:.3g} mm."
        )
    landing = verdict["landing"]
    if not landing["good"]:
        lines.append(
            f"Placed cups stand up to {landing['worst_distance_mm']:.3g} mm and "
            f"{landing['worst_angle_deg']:.3g} deg from their targets, or slide by "
            f"{landing['worst_slide_mm']:.3g} mm, or some are never placed."
        )
    lines += _laid_lines(verdict["laid"], front)
    limits = verdict["limits"]
    if not limits["good"]:
        lines.append(
            f"Joint {limits['tightest_joint']} passes its limit at waypoint "
            f"{limits['waypoint'] + 1}, or a rate is passed "
            f"({100 * limits['largest_rate_share']:.0f} % of what is allowed)."
        )
    lines += arm_failures(verdict["arm"], names)
    return lines + _fiber_lines(verdict["fibers"], names) + _tool_lines(verdict)


def _tool_lines(verdict: dict[str, Any]) -> list[str]:
    """How pads land, and whether the tool rests where the plan has it."""
    lines, touch, rest = [], verdict["touch"], verdict.get("rest")
    if touch["largest_fall_mm"] > touch["fall_limit_mm"]:
        cup, fall = tuple(touch["fall_cup"]), touch["largest_fall_mm"]
        lines.append(
            f"Cup {cup} is {fall:.1f} mm above the mold at the last waypoint before it "
            "stands: how it lands was not looked at; lower path.toe_up_deg where it "
            "is above 2, or path.last_gap_mm."
        )
    if touch["largest_slide_mm"] > touch["slide_limit_mm"]:
        cup, slide = tuple(touch["slide_cup"]), touch["largest_slide_mm"]
        lines.append(
            f"Cup {cup} hangs {slide:.1f} mm beside its target right before it stands, "
            f"{touch['slide_limit_mm']:g} are the most: a start nearer to the middle "
            "or a mold that lies flatter would help."
        )
    if (
        max(touch["inner_toe_down_deg"], touch["border_toe_down_deg"])
        > touch["limit_deg"]
    ):
        kind = "border cup" if touch["border"] else "cup"
        angle = max(touch["inner_toe_down_deg"], touch["border_toe_down_deg"])
        lines.append(
            f"{kind.capitalize()} {tuple(touch['cup'])} lands toe first by "
            f"{angle:.1f} deg, {touch['limit_deg']:.1f} are the most: resilient "
            "interlinks, a stiffer ply or another start would help."
        )
    if rest and not rest["good"]:
        where = rest["unsettled_waypoint"] + 1
        problem = "moves when it is let go" if rest["stable"] else "has no stable rest"
        lines.append(f"The tool {problem} at waypoint {where}.")
    return lines


def touch_sentence(touch: dict[str, Any]) -> str:
    """How pads come down, in one sentence.

    Args:
        touch: The verdict's part on it.
    """
    inner, border = touch["inner_toe_down_deg"], touch["border_toe_down_deg"]
    limit, slide = touch["limit_deg"], touch["largest_slide_mm"]
    return (
        f"Pads land up to {inner:.1f} deg toe first inside, {border:.1f} at the rim, "
        f"of {limit:.1f}; cups slide up to {slide:.1f} mm onto their targets."
    )


def _laid_lines(laid: dict[str, Any], front: FrontVerdict) -> list[str]:
    """What keeps the laid ply from lying on the mold."""
    if laid["good"]:
        return []
    if laid["pads_beside_mold"]:
        pads = laid["pads_beside_mold"]
        cups = "1 cup hangs" if len(pads) == 1 else f"{len(pads)} cups hang"
        return [
            f"The pads of {cups} over the mold's edge, first that of {tuple(pads[0])}: "
            "place the ply elsewhere (placement.mold_point_m), or use a larger mold or "
            "a smaller tool."
        ]
    bridges = laid["bridges_mm"] >= laid["sinks_mm"]
    place, key = (front.highest, "bridge") if bridges else (front.lowest, "sink")
    return [
        f"Laid, the ply bridges {laid['bridges_mm']:.1f} mm or sinks "
        f"{laid['sinks_mm']:.1f} mm {near(place)}: the mold is too curved or hollow "
        "between the cups there; turn or shift the ply so that cups reach into it "
        f"(placement), or allow for more (tolerance.laid_{key}_mm)."
    ]


def _fiber_lines(fibers: dict[str, Any], names: list[str]) -> list[str]:
    """What the length gate found: the worst fiber, when, and what comes of it."""
    guilty, take_up = fibers["infeasible"], fibers["take_up_mm"]
    if not guilty:
        return []
    worst, count = guilty[0], fibers["infeasible_count"]
    short = worst["need_mm"] >= worst["surplus_mm"]
    excess = max(worst["need_mm"], worst["surplus_mm"])
    verb = "fiber leaves" if count == 1 else "fibers leave"
    text = f"Length-infeasible: {count} {verb} the take-up of {take_up:g} mm; the worst"
    text += f", {worst['fiber']}, is {excess:.2f} mm too {'short' if short else 'long'}"
    text += f" at its worst ({_inside(names[worst['worst_waypoint']])})"
    if worst["duration_s"]:
        text += f", outside for {worst['duration_s']:.1f} s"
    if short:
        what = f"it holds its cups back, or slips by {worst['short_mm']:.2f} mm"
    else:
        what = f"it would bow {worst['bubble_mm']:.1f} mm off the mold"
    enough = np.ceil(100 * excess - ROUNDED) / 100
    remedy = f"A weave that takes up {enough:g} mm, a flatter mold or less lift"
    return [f"{text}: {what}. {remedy} would help."]


def _inside(name: str) -> str:
    """A waypoint's name within a sentence."""
    return name[0].lower() + name[1:]


def summary(
    verdict: dict[str, Any],
    front: FrontVerdict,
    track: Track,
    lag: dict[str, float],
) -> list[str]:
    """The verdict, what it rests on, and its margins.

    Args:
        verdict: The verdict.
        front: Its part on the order of contact.
        track: The drape.
        lag: What the kinematic fidelity would miss, as a plan has it.
    """
    names = labels(track)
    lines = failures(verdict, front, track)
    if not lines:
        lines = sentences(front, names)
    elif front.passed:
        lines = [*lines, *sentences(front, names)]
    else:
        lines = [*lines, *sentences(front, names)[1 + len(front.events) :]]
    share = verdict["laid"]["beside_mold_share"]
    if share:
        lines.append(f"{100 * share:.1f} % of the ply hangs beside the mold.")
    if verdict["fidelity"] == "kinematic":
        return [*lines, KINEMATIC]
    off = lag["largest_distance_mm"], lag["largest_angle_deg"]
    return [*lines, EQUILIBRIUM.format(*off)]
