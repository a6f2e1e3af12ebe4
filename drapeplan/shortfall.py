"""Shortfall: how far a plan is from good, so that a search knows the way there."""

from __future__ import annotations

from typing import Any

MOST = 9.0  # [-] of one criterion's excess: none drowns the others


def shortfall(verdict: dict[str, Any]) -> dict[str, float]:
    """What is not good, each as one plus its excess over what is allowed, relative.

    Criteria that have no size of their own count as one.

    Args:
        verdict: Verdict of a plan, plain data.

    Returns:
        Sizes by criterion; empty for a good plan.
    """
    front, steps = verdict["front"], verdict["steps"]
    tolerance, touch, fibers = front["tolerance"], verdict["touch"], verdict["fibers"]
    band = max(fibers["take_up_mm"], 0.1)
    pairs = {
        "touch": (
            (touch["inner_toe_down_deg"], touch["limit_deg"]),
            (touch["border_toe_down_deg"], touch["limit_deg"]),
            (touch["largest_fall_mm"], touch["fall_limit_mm"]),
            (touch["largest_slide_mm"], touch["slide_limit_mm"]),
        ),
        "fibers": (
            (fibers["longest_need_mm"], band),
            (fibers["largest_surplus_mm"], band),
        ),
        "penetration": (
            (_most(steps, "span_penetration_mm"), tolerance["penetration_mm"]),
            (_most(steps, "pad_penetration_mm"), tolerance["pad_penetration_mm"]),
        ),
        "order": (
            (-_least(steps, "premature_margin_mm"), tolerance["touch_mm"]),
            (-_least(steps, "air_margin_mm"), tolerance["touch_mm"]),
        ),
    }
    parts = {k: v for k, v in verdict.items() if isinstance(v, dict) and "good" in v}
    bad = {name for name, part in parts.items() if part["good"] is False}
    if front["penetrates"]:
        bad.add("penetration")
    if not front["in_order"]:
        bad.add("order")
    if not front["starts_free"]:
        bad.add("starts_free")
    sizes = {}
    for name in sorted(bad):
        excess = [value / limit - 1 for value, limit in pairs.get(name, ()) if limit]
        sizes[name] = 1 + min(max([0.0, *excess]), MOST)
    return sizes


def _most(steps: list[dict[str, Any]], key: str) -> float:
    return max(float(step[key]) for step in steps)


def _least(steps: list[dict[str, Any]], key: str) -> float:
    """Least margin of all steps, zero or more where nothing threatens."""
    return min([0.0, *(float(step[key]) for step in steps if step[key] is not None)])
