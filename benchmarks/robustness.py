"""P(wrong order) on the scenes of docs/limits.md, with both tools that are shipped.

Cup poses have the errors stated there and keep their links' lengths; the plan rests on
the tool's equilibrium. The better tool is the one with fewer samples in the wrong
order; it alone is asked the rest. Each scene is written as soon as it is done;
`python -m benchmarks._limits` prints the table of docs/limits.md from them.
"""

import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks._kept import keep
from drapeplan.errors import InfeasibleError
from drapeplan.plan import Plan
from drapeplan.planner import make_plan
from drapeplan.robustness import Robustness, robustness
from drapeplan.scene import UncertaintySection, scene_from

TOOLS = ("drape_tool_6x8", "drape_tool_6x8_resilient")
RESULTS = Path(__file__).parent / "results" / "robustness.json"
SAMPLES, MORE, FEW = 200, 100, 8  # [-] at the first noise, at others, when quick
ACCEPTED = 0.1  # [-] upper end of the interval of P(wrong order)
KNOWN = {
    "tilt_deg": 0.0,
    "take_up_share": 0.0,
    "stiffness_log": 0.0,
    "mold_xy_mm": 0.0,
    "mold_z_mm": 0.0,
    "mold_yaw_deg": 0.0,
}
NOISE = {
    "0.3 mm / 0.5 deg": UncertaintySection(position_mm=0.3, angle_deg=0.5, **KNOWN),
    "0.5 mm / 1 deg": UncertaintySection(position_mm=0.5, angle_deg=1.0, **KNOWN),
    "all of a scene's defaults": UncertaintySection(),
}
FIRST = next(iter(NOISE))


def paraboloid(x: float, y: float) -> dict:
    """Surface of given radii, in [m]."""
    return {"kind": "paraboloid", "radius_x_m": x, "radius_y_m": y}


SCENES = {  # surface, take-up in [mm]
    "flat": ({"kind": "plane"}, 0.4),
    "convex (1, 2)": (paraboloid(1.0, 2.0), 0.4),
    "saddle (-1.5, 1.8)": (paraboloid(-1.5, 1.8), 0.4),
    "saddle (-1, 2)": (paraboloid(-1.0, 2.0), 0.4),
    "KinDrape 0.3 x 1.0 m": ({"kind": "kindrape", "relief": 0.3, "size_m": 1.0}, 0.4),
    "ridge": ({"kind": "ridge"}, 0.4),
    "step": ({"kind": "step"}, 0.4),
    "sphere R = 1": ({"kind": "sphere", "radius_m": 1.0}, 0.8),
    "concave R = -1": ({"kind": "sphere", "radius_m": -1.0}, 0.8),
}


def run(quick: bool, names: Sequence[str] = tuple(SCENES)) -> dict:
    """Shares of samples in the wrong order; quick: a few of two, which are not kept."""
    samples = FEW if quick else SAMPLES
    result: dict = {"samples": samples, "seed": 0}
    for name in names[:2] if quick else names:
        result[name] = scene_row(name, samples)
        if not quick:
            keep(RESULTS, name, result[name], tuple(SCENES))
        print(name, json.dumps(result[name]), file=sys.stderr)
    return result


def scene_row(name: str, samples: int) -> dict:
    """One scene: both tools at the first noise, the better one at all."""
    row: dict = {}
    plans = {}
    for tool in TOOLS:
        start = time.perf_counter()
        try:
            plan = planned(name, tool)
        except InfeasibleError as error:
            row[tool] = {"refused": str(error)}
            continue
        seconds = {"plan_s": round(time.perf_counter() - start, 1)}
        row[tool] = {
            **plan_facts(plan),
            **seconds,
            FIRST: figures(plan, FIRST, samples),
        }
        plans[tool] = plan
    if not plans:
        return row | {"better": None, "met": False}
    better = min(plans, key=lambda tool: (row[tool][FIRST]["wrong"], tool))
    for noise in NOISE:
        if noise != FIRST:
            row[better][noise] = figures(plans[better], noise, min(samples, MORE))
    met = row[better][FIRST]["high"] <= ACCEPTED
    return row | {"better": better, "met": met}


def planned(name: str, tool: str, **sections: dict) -> Plan:
    """The plan of a scene with a tool; further sections of the scene as given."""
    surface, take_up = SCENES[name]
    data = {
        "format": "drapeplan-scene/1",
        "mold": {"surface": surface},
        "tool": {"name": tool},
        "ply": {"take_up_mm": take_up},
        **sections,
    }
    return make_plan(scene_from(data, name), Path(), name).plan


def plan_facts(plan: Plan) -> dict:
    """What the plan itself is."""
    verdict = plan.judged[0]
    parts = [(k, v) for k, v in verdict.items() if isinstance(v, dict)]
    fibers = verdict["fibers"]
    return {
        "wide": plan.document.get("path_choice", {}).get("wide"),
        "good": verdict["good"],
        "in_order": verdict["front"]["in_order"],
        "not_good": [k for k, v in parts if v.get("good") is False],
        "touch": verdict["touch"],
        "fibers_mm": [-fibers["largest_surplus_mm"], fibers["longest_need_mm"]],
    }


def figures(plan: Plan, noise: str, samples: int) -> dict:
    """P(wrong order) with its interval, depth of press, and where it goes wrong."""
    start = time.perf_counter()
    found = robustness(plan, samples, seed=0, stated=NOISE[noise], tornado=False)
    low, high = found.interval
    return {
        "wrong": found.wrong,
        "P": found.wrong / samples,
        "low": round(low, 4),
        "high": round(high, 4),
        **causes(found),
        "sample_ms": round(1e3 * (time.perf_counter() - start) / samples, 1),
    }


def causes(found: Robustness) -> dict:
    """Kinds of failure, press depth, and the step that is tightest."""
    rollouts = found.rollouts
    press = [1e3 * max(r.span_press, r.pad_press) for r in rollouts]
    return {
        "premature": sum(bool(r.premature.min() <= 0) for r in rollouts),
        "air_pocket": sum(bool(r.air.min() <= 0) for r in rollouts),
        "no_rest": sum(not r.stable for r in rollouts),
        "press_mm": [round(float(np.quantile(press, p)), 3) for p in (0.5, 0.95)],
        "worst_step": found.worst_step,
    }
