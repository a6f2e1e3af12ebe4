"""Words for a plan under uncertainty: lines for a reader, plain data for a program."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drapeplan.robustness import Effect, Robustness
from drapeplan.rolling import CAP

Array = NDArray[np.float64]

DIGITS = 6  # decimals of what is recorded: a nanometer
QUANTILES = (0.05, 0.5, 0.95)
NAMES = {
    "position": "cup position",
    "angle": "cup angle",
    "tilt": "tilt of all cups",
    "take_up": "take-up",
    "stiffness": "bending stiffness",
    "registration": "mold registration",
}
POSES = (
    "Cup errors stay for the whole drape, save for the share redrawn at each waypoint.",
    "Placed cups and the ply between them are as planned.",
    "Waypoints are judged, and the way on which cups come to stand; no more between.",
    "Strips that noise makes slack bulge to the side that their cups favor.",
)
TABLE = "Stiffness moves the cups along a parabola through rests at two spreads off."
STILL = "A mold that stands elsewhere is met by the tool as planned."
AGAIN = "The tool of each sample is settled anew on its own ply and mold."


def approximations(found: Robustness) -> list[str]:
    """What the samples leave out, one sentence each."""
    depth = [AGAIN] if found.depth == "tool" else [TABLE, STILL]
    return [*POSES, *depth]


def sentences(found: Robustness) -> list[str]:
    """A plan under uncertainty: P, margins, press depth, the worst step.

    Args:
        found: What became of the samples.
    """
    return [*_answer(found), *_margins(found), _press(found), _worst_step(found)]


def document(found: Robustness) -> dict[str, Any]:
    """The same as plain data, the unit in the key: `plan_file.RobustnessBlock`."""
    low, high = found.interval
    rollouts = found.rollouts
    step = found.worst_step
    depth = _press_of(found)
    return {
        "samples": len(rollouts),
        "seed": found.seed,
        "depth": found.depth,
        "uncertainty": found.stated.model_dump(mode="json"),
        "wrong_order": {
            "samples": found.wrong,
            "share": _number(found.wrong / len(rollouts)),
            "low_95": _number(low),
            "high_95": _number(high),
            "premature": _count(found, "premature"),
            "air_pocket": _count(found, "air"),
            "no_rest": sum(not one.stable for one in rollouts),
        },
        "planned_margin_mm": _millimeters(found.planned.margin),
        "margin_mm": {
            name: _quantiles(_least(found, name)) for name in ("premature", "air")
        },
        "press": {
            "depth_mm": _quantiles(depth),
            "planned_depth_mm": _millimeters(_deepest(found)),
            "force_N": {
                key: _number(found.stated.press_N_per_mm * (value or 0.0))
                for key, value in _quantiles(depth).items()
            },
        },
        "worst_step": None if step is None else _step(found, step),
        "parameters": [_effect(one) for one in found.effects],
        "largest_link_error_mm": _millimeters(max(r.link_error for r in rollouts)),
        "approximations": approximations(found),
    }


def _answer(found: Robustness) -> list[str]:
    low, high = found.interval
    count = len(found.rollouts)
    head = f"Under uncertainty, {found.wrong} of {count} samples touch in the wrong "
    head += f"order: P = {found.wrong / count:.3f}, 95 % within {low:.3f} to {high:.3f}"
    kinds = [
        f"{_count(found, 'premature')} premature",
        f"{_count(found, 'air')} air pocket",
        f"{sum(not one.stable for one in found.rollouts)} without stable rest",
    ]
    return [f"{head}." if not found.wrong else f"{head} ({', '.join(kinds)})."]


def _margins(found: Robustness) -> list[str]:
    names = {"premature": "a premature contact", "air": "an air pocket"}
    rows = []
    for key, name in names.items():
        least = _least(found, key)
        threatened = int((least < CAP).sum())
        if not threatened:
            rows.append(f"No sample comes within {1e3 * CAP:g} mm of {name}.")
            continue
        values = _quantiles(least)
        text = ", ".join(_shown(values[k]) for k in values)
        rows.append(f"To {name} (5, 50, 95 % of samples): {text} mm.")
    return rows


def _press(found: Robustness) -> str:
    stiffness = found.stated.press_N_per_mm
    middle, deep = np.quantile(_press_of(found), QUANTILES[1:]) * 1e3
    return (
        f"Ply is pressed in by {middle:.2f} mm (median) to {deep:.2f} mm (95 %): "
        f"{stiffness * middle:.1f} to {stiffness * deep:.1f} N on a cup and ply of "
        f"{stiffness:g} N/mm (assumed)."
    )


def _worst_step(found: Robustness) -> str:
    step = found.worst_step
    if step is None:
        return f"No step comes within {1e3 * CAP:g} mm of a wrong order."
    facts = _step(found, step)
    cups = ", ".join(f"({i}, {j})" for i, j in facts["cups"][:3])
    more = len(facts["cups"]) - 3
    cups += f" and {more} more" if more > 0 else ""
    place = f"step {step} (cups {cups})" if step else f"the start cup {cups}"
    return (
        f"Worst is {place}: {facts['wrong']} samples go wrong there, mean margin "
        f"{_shown(facts['mean_margin_mm'])} mm."
    )


def table(found: Robustness) -> list[str]:
    """What each parameter does alone, a row each; none where nobody looked.

    Args:
        found: What became of the samples.
    """
    if not found.effects:
        return []
    count = len(found.effects[0].rollouts)
    rows = [
        f"Each parameter alone, {count} samples, the one that hurts most first:",
        "parameter            P  margin mm, 5 to 95 %  pressed mm, 50 to 95 %",
    ]
    for one in found.effects:
        facts = _effect(one)
        margin, press = facts["margin_mm"], facts["press_mm"]
        low, high = _capped(margin["5"]), _capped(margin["95"])
        rows.append(
            f"{NAMES[one.parameter]:<17} {facts['P']:5.2f}  {low:>9} to {high:<9} "
            f"{press['50']:9.2f} to {press['95']:.2f}"
        )
    return rows


def _effect(one: Effect) -> dict[str, Any]:
    return {
        "parameter": one.parameter,
        "samples": len(one.rollouts),
        "P": _number(one.wrong_share),
        "margin_mm": _quantiles(one.margins),
        "press_mm": _quantiles(one.press),
    }


def _step(found: Robustness, step: int) -> dict[str, Any]:
    least = [min(r.premature[step], r.air[step]) for r in found.rollouts]
    return {
        "step": step,
        "cups": [list(cup) for cup in found.steps[step]],
        "wrong": sum(bool(margin <= 0) for margin in least),
        "mean_margin_mm": _millimeters(float(np.minimum(least, CAP).mean())),
    }


def _least(found: Robustness, name: str) -> Array:
    """Least margin of one kind of each sample, in [m]."""
    return np.array([getattr(one, name).min() for one in found.rollouts])


def _count(found: Robustness, name: str) -> int:
    return int((_least(found, name) <= 0).sum())


def _press_of(found: Robustness) -> Array:
    return np.array([max(r.span_press, r.pad_press) for r in found.rollouts])


def _deepest(found: Robustness) -> float:
    return max(found.planned.span_press, found.planned.pad_press)


def _quantiles(values: Array) -> dict[str, float | None]:
    """Quantiles in [mm] that are samples themselves; None where infinite."""
    found = np.quantile(values, QUANTILES, method="lower")
    names = [f"{100 * q:g}" for q in QUANTILES]
    return {n: _millimeters(float(x)) for n, x in zip(names, found, strict=True)}


def _millimeters(length: float) -> float | None:
    return _number(1e3 * length) if np.isfinite(length) else None


def _number(value: float) -> float:
    return round(float(value), DIGITS) + 0.0


def _shown(value: float | None) -> str:
    return "none near" if value is None else f"{value:.2f}"


def _capped(value: float | None) -> str:
    beyond = value is None or value >= 1e3 * CAP
    return f">= {1e3 * CAP:g}" if beyond else f"{value:.2f}"
