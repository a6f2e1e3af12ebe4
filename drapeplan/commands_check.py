"""What `drapeplan check` does."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from drapeplan.check import Check, check_plan
from drapeplan.console import draw_first_touch, show_robustness, show_verdict
from drapeplan.errors import InputError
from drapeplan.files import check_outputs
from drapeplan.plan import Plan
from drapeplan.report_robustness import tornado_figure
from drapeplan.robustness import Depth, Robustness, check_samples, robustness
from drapeplan.robustness_words import document as plain
from drapeplan.words import summary


@dataclass(frozen=True)
class Doubt:
    """How a plan is looked at under uncertainty.

    Attributes:
        samples: Number of samples.
        seed: Seed of the samples; None for the scene's.
        workers: Processes; None leaves it to the amount of work.
        depth: "poses" or "tool".
    """

    samples: int
    seed: int | None
    workers: int | None
    depth: str


def check_command(
    plan_file: Path, figure: Path | None, doubt: Doubt | None, as_json: bool
) -> int:
    """Recompute a plan from its file alone and say what does not hold.

    Args:
        plan_file: Plan file; it is not changed.
        figure: Picture to write: the first touch, or the tornado of a doubt.
        doubt: Whether and how it is judged under uncertainty.
        as_json: One JSON document instead of lines.

    Returns:
        The exit code: 1 where something does not hold. P(wrong order) is told, and
        left to the reader.

    Raises:
        InputError: A file or an option is not right.
    """
    if figure:
        check_outputs([figure], [plan_file])
    if doubt:
        _check_options(doubt)
    plan = Plan.read(plan_file)
    found = check_plan(plan)
    if doubt and found.holds_together:
        found = replace(found, robust=_doubted(plan, doubt, found.robust))
    if figure and doubt and found.robust:
        tornado_figure(figure, found.robust, plan_file.stem)
    elif figure and found.verdict:
        draw_first_touch(figure, plan, plan.judged[1], plan_file.stem)
    if as_json:
        print(json.dumps(_document(found)))
    else:
        _show(plan_file, plan, found, doubt)
    return 0 if found.passed else 1


def _check_options(doubt: Doubt) -> None:
    """Refuse options before the work."""
    if doubt.depth not in ("poses", "tool"):
        problem = f"no depth is called {doubt.depth!r}"
        raise InputError("--depth", "", problem, "poses, tool")
    check_samples(doubt.samples)
    if doubt.seed is not None and doubt.seed < 0:
        raise InputError("--seed", "", f"must be at least 0 (found {doubt.seed})")
    if doubt.workers is not None and doubt.workers < 1:
        raise InputError("--workers", "", f"must be at least 1 (found {doubt.workers})")


def _doubted(plan: Plan, doubt: Doubt, known: Robustness | None) -> Robustness:
    """Samples as asked for, those that the check has drawn already if they are."""
    seed = plan.scene.seed if doubt.seed is None else doubt.seed
    asked = doubt.samples, seed, doubt.depth
    if known and (len(known.rollouts), known.seed, known.depth) == asked:
        return known
    depth: Depth = "tool" if doubt.depth == "tool" else "poses"
    return robustness(plan, asked[0], seed=seed, workers=doubt.workers, depth=depth)


def _document(found: Check) -> dict[str, Any]:
    """One JSON document."""
    document: dict[str, Any] = {"good": found.passed, "broken": found.broken}
    document |= {"differing": found.differing, "violated": found.violated}
    document |= {"verdict": found.verdict}
    return document | ({"robustness": plain(found.robust)} if found.robust else {})


def _show(plan_file: Path, plan: Plan, found: Check, doubt: Doubt | None) -> None:
    """Lines on stdout."""
    for name in ("broken", "differing", "violated"):
        label = "differs" if name == "differing" else name
        for line in getattr(found, name):
            print(f"{label}: {line}")
    if found.passed:
        print(f"{plan_file}: holds; everything recomputed agrees.")
        front, lag = plan.judged[1].front, plan.document["kinematic_lag"]
        facts = summary(found.verdict, front, plan.track, lag)
        show_verdict(found.verdict, facts, False, found.robust)
    elif found.robust:
        show_robustness(found.robust)
    elif doubt:
        print("not judged under uncertainty: the file does not hold")
