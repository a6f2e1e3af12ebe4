"""The front's verdict in plain sentences: where, when, how much, what to change."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from drapeplan.verdict import EventKind, FrontEvent, FrontVerdict, Spot

NEAR = 0.01  # [m] margins beyond are no danger
SHOWN = 5e-6  # [m] half of the last decimal that a sentence shows
REMEDIES = {
    EventKind.PREMATURE: "lift the cups outside the front further, or turn them toe-up",
    EventKind.AIR_POCKET: "place the cups around it from the start outward, or lift "
    "the outer ones further",
    EventKind.PENETRATION: "raise the cups around it until their step, or bring them "
    "down in smaller steps",
    EventKind.PAD_PENETRATION: "turn the cup along the mold before it lands, or land "
    "it heel first",
}

PLY_MODELS = {
    "cubic": "Ply model cubic: fibers as long as their cups ask",
    "modal": "Ply model modal: fibers bulge with what the take-up leaves",
}
CAUSES = {
    "take_up": "fibers beyond the take-up",
    "gravity": "sag between the cups",
    "droop": "droop of the overhang",
}


def sentences(verdict: FrontVerdict, labels: Sequence[str]) -> list[str]:
    """Say where, when and how much, and what to change.

    Args:
        verdict: Verdict of the front check.
        labels: What to call each pose, such as "Step 3", shape (K,).

    Returns:
        Sentences: the verdict, each event, the margins, the laid state, doubts.
    """
    start = _cup(verdict.start_cup)
    if not verdict.in_order:
        verdict_line = f"Out of order: the ply does not spread outward from {start}."
    elif verdict.penetrates:
        verdict_line = f"In order from {start}, but the ply is pushed into the mold."
    else:
        verdict_line = f"In order: the ply touches the mold outward from {start}."
    lines = [verdict_line]
    known: set[EventKind] = set()
    for event in verdict.events:
        lines.append(f"{labels[event.pose]}: {_event(event, event.kind in known)}.")
        known.add(event.kind)
    for spot, what in (
        (verdict.worst_premature, "a premature contact"),
        (verdict.worst_air, "an air pocket"),
    ):
        if spot is None or spot.value > NEAR:
            lines.append(f"Nothing comes near {what}.")
        elif spot.pose is not None and spot.value > 0:
            when, how_near = labels[spot.pose], _mm(spot.value)
            lines.append(f"Nearest to {what}: {how_near} left, {when}, {near(spot)}.")
    return lines + _laid_sentences(verdict, labels)


def ply_sentences(facts: dict[str, Any]) -> list[str]:
    """Say which ply model a verdict rests on, and what it leaves out.

    Args:
        facts: What the verdict says of the ply model, as plain data.

    Returns:
        Sentences: the model, what is left out, and how far coupled patches lie off.
    """
    tolerance = f"{facts['tolerance_mm']:g} mm"
    lines = [f"{PLY_MODELS[facts['model']]}; {_asked(facts, tolerance)}."]
    parts = {effect["cause"]: effect for effect in facts["effects"]}
    texts = [
        f"{words} {parts[cause]['size_mm']:.2f} mm ({_fate(parts[cause])})"
        for cause, words in CAUSES.items()
        if parts[cause]["size_mm"]
    ]
    if not parts["take_up"]["size_mm"]:
        texts.insert(0, "no fiber leaves the take-up")
    lines.append(f"Estimated, at most: {', '.join(texts)}.")
    return [*lines, *_coupling_sentences(facts, parts["coupling"], tolerance)]


def _fate(effect: dict[str, Any]) -> str:
    """What became of an effect, in a few words."""
    if not effect["modeled"]:
        return "left out"
    left = effect["left_out_mm"]
    return f"modeled but for {left:.2f} mm" if left else "modeled"


def _asked(facts: dict[str, Any], tolerance: str) -> str:
    """Why this model, as half a sentence."""
    if facts["asked"] != "auto":
        return f"the scene asks for {facts['asked']}"
    return f"the cheapest model within {tolerance} for the whole path"


def _coupling_sentences(
    facts: dict[str, Any], effect: dict[str, Any], tolerance: str
) -> list[str]:
    """How far patches whose strips hold each other lie off."""
    if effect["patch"] is None:
        return []
    i, j = effect["patch"]
    size = f"{effect['size_mm']:.2f} mm"
    line = f"Strips that hold each other, left out: estimated {size} rms over"
    line += f" patch ({i}, {j}) at waypoint {effect['waypoint'] + 1}"
    solved = [one for one in facts["coupled"] if one["measured_mm"] is not None]
    if not facts["coupled"]:
        return [f"{line}, within {tolerance}."]
    if not solved:
        return [f"{line}; no stable coupled shape: read the margins against it."]
    worst = max(solved, key=lambda one: (one["measured_mm"], one["patch"]))
    i, j = worst["patch"]
    line += f"; solved for {len(solved)} of the worst patches, they lie up to "
    line += f"{worst['measured_mm']:.2f} mm rms off, {worst['largest_mm']:.2f} mm at a "
    line += f"point: patch ({i}, {j}), waypoint {worst['waypoint'] + 1}"
    if worst["measured_mm"] > facts["tolerance_mm"]:
        line += f". That is beyond {tolerance}: read the margins against it"
    return [f"{line}."]


def _laid_sentences(verdict: FrontVerdict, labels: Sequence[str]) -> list[str]:
    """The laid state, and what casts doubt on the verdict."""
    high, low = verdict.highest, verdict.lowest
    line = f"Laid, the ply bridges up to {_mm(max(high.value, 0.0))} {near(high)}"
    if low.value < -SHOWN:
        line += f" and sinks up to {_mm(-low.value)} {near(low)}"
    lines = [f"{line}."]
    k = int(np.argmax(verdict.laid_deviation))
    deviation = verdict.laid_deviation[k]
    if deviation > verdict.tolerance.touch + verdict.tolerance.barrier:
        lines.append(
            f"{labels[k]}: placed cups leave the ply {_mm(deviation)} from its laid "
            "state: they are off target, or the ply bulges to the other side."
        )
    if not verdict.starts_free:
        lines.append(
            "The path starts in contact: how the ply came there was not judged; start "
            "it above the mold."
        )
    return lines


def _event(event: FrontEvent, again: bool) -> str:
    """One event as half a sentence: the first of its kind with its remedy."""
    where = near(event)
    area, volume, depth = _area(event.area), _volume(event.volume), _mm(event.depth)
    what = {
        EventKind.PREMATURE: f"the ply touches {area} {where}, apart from the contact "
        "around the start",
        EventKind.AIR_POCKET: f"an air pocket of {area} ({volume}, {depth} deep) "
        f"closes {where}",
        EventKind.PENETRATION: f"the ply between the cups is pushed {depth} into the "
        f"mold {where}, over {area}",
        EventKind.PAD_PENETRATION: f"a landing cup is pressed {depth} into the mold "
        f"{where}, over {area}",
    }[event.kind]
    return f"at its worst, {what}" if again else f"{what}: {REMEDIES[event.kind]}"


def near(place: FrontEvent | Spot) -> str:
    """Nearest cup and material coordinates, in words.

    Args:
        place: An event, or a value with its place.
    """
    s, t = (1e3 * x for x in place.place_st)
    return f"near {_cup(place.cup)} (s {s:.0f}, t {t:.0f} mm)"


def _cup(cup: tuple[int, int]) -> str:
    return f"cup ({cup[0]}, {cup[1]})"


def _mm(length: float) -> str:
    return f"{1e3 * length:.2f} mm" if length < 1e-3 else f"{1e3 * length:.1f} mm"


def _area(area: float) -> str:
    return f"{1e4 * area:.1f} cm2" if area >= 1e-4 else f"{1e6 * area:.0f} mm2"


def _volume(volume: float) -> str:
    return f"{1e6 * volume:.1f} cm3" if volume >= 1e-6 else f"{1e9 * volume:.0f} mm3"
