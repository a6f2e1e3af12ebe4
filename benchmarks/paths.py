"""Path families and their parameters: P(wrong order), margins and what they cost.

Each variant changes a few keys of a scene of `benchmarks.robustness`; all see the same
samples, with the rigid tool.
"""

import sys
from collections.abc import Iterator

import numpy as np

from benchmarks.robustness import FIRST, SCENES, plan_facts, planned
from benchmarks.robustness import figures as probability
from drapeplan.errors import InfeasibleError
from drapeplan.plan import Plan

SAMPLES, FEW = 60, 4  # [-] to compare by; when quick
QUICK = ("flat", "saddle (-1.5, 1.8)")
STEEP = {"lift_per_m": 0.6}  # a path that states a key has the usual ones for others
VARIANTS: dict[str, dict] = {
    "from the mold": {},
    "steep": {"path": STEEP},
    "wide along s": {
        "path": {
            "lift_per_m": [0.205, 0.475],
            "bend_mm": 325,
            "rim_offset_mm": -11,
            "toe_up_deg": 4.44,
        }
    },
    "twice the poses": {"path": {**STEEP, "poses_per_step": 20}},
    "lift 0.35": {"path": {"lift_per_m": 0.35}},
    "lift 1.0": {"path": {"lift_per_m": 1.0}},
    "lift 1.0 along s": {"path": {"lift_per_m": [1.0, 0.6]}},
    "bend 60 mm": {"path": {"bend_mm": 60}},
    "bend 250 mm": {"path": {"bend_mm": 250}},
    "rim + 10 mm": {"path": {"rim_offset_mm": 10}},
    "rim - 10 mm": {"path": {"rim_offset_mm": -10}},
    "toe-up 0": {"path": {"toe_up_deg": 0}},
    "toe-up 1": {"path": {"toe_up_deg": 1}},
    "toe-up 2": {"path": {"toe_up_deg": 2}},
    "toe-up 2, twice the poses": {"path": {"toe_up_deg": 2, "poses_per_step": 20}},
    "all sides": {"path": STEEP, "sequence": {"pattern": "all_sides"}},
    "spine along s": {"path": STEEP, "sequence": {"pattern": "spine_s"}},
    "spine along t": {"path": STEEP, "sequence": {"pattern": "spine_t"}},
    "radial": {"path": {"family": "radial"}},
    "radial, ties alone": {
        "path": {"family": "radial"},
        "sequence": {"ring_pitches": 0},
    },
    "hover": {"path": {"family": "hover"}},
}
HEAD = (
    f"{'scene':<22}{'variant':<27}{'P':>6}  {'95 %':<12}{'margin':>7}{'span':>6}"
    f"{'pad':>6}{'need':>6}{'inner':>7}{'border':>7}{'fall':>6}"
)


def run(quick: bool) -> dict:
    """All variants on all scenes; two of each when quick."""
    scenes = QUICK if quick else tuple(SCENES)
    variants = list(VARIANTS)[:2] if quick else list(VARIANTS)
    lines, figures = [HEAD], {}
    for scene in scenes:
        for variant in variants:
            found = row(scene, variant, FEW if quick else SAMPLES)
            lines.append(_line(found))
            print(lines[-1], file=sys.stderr)
            figures[f"{scene}, {variant}"] = found
    return {"table": lines, "figures": figures}


def row(scene: str, variant: str, samples: int) -> dict:
    """One variant on one scene, or why there is no plan."""
    found = {"scene": scene, "variant": variant}
    sections = {"path": {"family": "rectangle_blend"}, "sequence": {}}
    for name, keys in VARIANTS[variant].items():
        sections[name] = sections[name] | keys
    try:
        plan = planned(scene, "drape_tool_6x8", **sections)
    except InfeasibleError as error:
        return found | {"refused": str(error)}
    return found | plan_facts(plan) | nominal(plan) | probability(plan, FIRST, samples)


def nominal(plan: Plan) -> dict:
    """Margins and depths of the plan itself, in [mm]."""
    front = plan.judged[1].front
    margins = np.append(front.premature_margin, front.air_margin)
    least = float(margins.min())
    return {
        "margin_mm": round(1e3 * least, 3) if np.isfinite(least) else None,
        "span_mm": round(1e3 * float(front.span_penetration.max()), 3),
        "pad_mm": round(1e3 * float(front.pad_penetration.max()), 3),
    }


def _line(found: dict) -> str:
    return "".join(_cells(found))


def _cells(found: dict) -> Iterator[str]:
    yield f"{found['scene']:<22}{found['variant']:<27}"
    if "refused" in found:
        yield f"  {found['refused']}"
        return
    touch, margin = found["touch"], found["margin_mm"]
    yield f"{found['P']:6.3f}  {found['low']:.3f}-{found['high']:.3f} "
    yield "      -" if margin is None else f"{margin:7.2f}"
    yield f"{found['span_mm']:6.2f}{found['pad_mm']:6.2f}{found['fibers_mm'][1]:6.2f}"
    yield f"{touch['inner_toe_down_deg']:7.2f}{touch['border_toe_down_deg']:7.2f}"
    yield f"{touch['largest_fall_mm']:6.2f}"
    if found["not_good"] or not found["in_order"]:
        yield "  no: " + ", ".join(found["not_good"] or ["order"])
