"""Words: a verdict in sentences that a laminator would use."""

from __future__ import annotations

from typing import Any

from drapeplan.arm_words import arm_failures
from drapeplan.path import CupState
from drapeplan.sentences import sentences
from drapeplan.track import Track
from drapeplan.verdict import FrontVerdict

KINEMATIC = (
    "Fidelity kinematic: the passive joints follow the request, as if something "
    "steered them; the real tool's cups lag in tilt, so the margins are optimistic."
)
EQUILIBRIUM = (
    "Fidelity equilibrium: the passive joints rest where weight, ply and links leave "
    "them, and strokes lead the tilt lag. Strokes that do not would leave cups "
    "{:.2f} mm and {:.1f} deg off before they land."
)


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
    lines += _laid_lines(verdict["laid"])
    limits = verdict["limits"]
    if not limits["good"]:
        lines.append(
            f"Joint {limits['tightest_joint']} passes its limit at waypoint "
            f"{limits['waypoint']}, or a rate is passed "
            f"({100 * limits['largest_rate_share']:.0f} % of what is allowed)."
        )
    lines += arm_failures(verdict["arm"], names)
    return lines + _fiber_lines(verdict["fibers"]) + _tool_lines(verdict)


def _tool_lines(verdict: dict[str, Any]) -> list[str]:
    """How pads land, and whether the tool rests where the plan has it."""
    lines, touch, rest = [], verdict["touch"], verdict.get("rest")
    if touch["largest_fall_mm"] > touch["fall_limit_mm"]:
        cup, fall = tuple(touch["fall_cup"]), touch["largest_fall_mm"]
        lines.append(
            f"Cup {cup} is {fall:.1f} mm above the mold at the last waypoint before it "
            "stands: how it lands was not looked at; lower path.last_gap_mm."
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
        where = rest["unsettled_waypoint"]
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


def _laid_lines(laid: dict[str, Any]) -> list[str]:
    """What keeps the laid ply from lying on the mold."""
    if laid["good"]:
        return []
    if laid["pads_beside_mold"]:
        cup = tuple(laid["pads_beside_mold"][0])
        count = len(laid["pads_beside_mold"])
        return [f"The pads of {count} cups hang over the mold's edge, first {cup}."]
    return [
        f"Laid, the ply bridges {laid['bridges_mm']:.1f} mm or sinks "
        f"{laid['sinks_mm']:.1f} mm: the mold is too curved or hollow between the cups."
    ]


def _fiber_lines(fibers: dict[str, Any]) -> list[str]:
    """What the length gate found."""
    guilty = fibers["infeasible"]
    if not guilty:
        return []
    band = fibers["take_up_mm"]
    need = max(abs(x["need_mm"]) for x in guilty)
    surplus = max(x["surplus_mm"] for x in guilty)
    worst = max(guilty, key=lambda x: max(x["need_mm"], x["surplus_mm"]))
    text = f"Length-infeasible: {len(guilty)} fibers leave the take-up of {band:g} mm"
    if worst["need_mm"] >= worst["surplus_mm"]:
        text += f"; the worst, {worst['fiber']}, is {need:.2f} mm too short"
    else:
        bubble = worst["bubble_mm"]
        text += f"; the worst, {worst['fiber']}, has {surplus:.2f} mm too much"
        text += f" and would bow {bubble:.1f} mm"
    remedy = "a flatter mold, a weave with more take-up or less lift would help"
    return [f"{text}: {remedy}."]


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
