"""What `drapeplan check` does."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drapeplan.check import Check, check_plan
from drapeplan.console import draw_first_touch, show_verdict
from drapeplan.errors import InputError
from drapeplan.files import check_outputs
from drapeplan.plan import Plan
from drapeplan.words import summary

if TYPE_CHECKING:
    from drapeplan.robustness import Robustness


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
    sound = found.verdict and not (found.broken or found.differing)
    robust = _robustness(plan, doubt) if doubt and sound else None
    if figure and robust:
        _draw_tornado(figure, robust, plan_file.stem)
    elif figure and found.verdict:
        draw_first_touch(figure, plan, plan.judged[1], plan_file.stem)
    if as_json:
        print(json.dumps(_document(found, robust)))
    else:
        _show(plan_file, plan, found, robust, doubt)
    return 0 if found.passed else 1


def _check_options(doubt: Doubt) -> None:
    """Refuse options before the work."""
    if doubt.depth not in ("poses", "tool"):
        problem = f"no depth is called {doubt.depth!r}"
        raise InputError("--depth", "", problem, "poses, tool")
    if doubt.samples < 1:
        problem = f"must be at least 1 (found {doubt.samples})"
        raise InputError("--robustness", "", problem, "64 give a first idea")
    if doubt.seed is not None and doubt.seed < 0:
        raise InputError("--seed", "", f"must be at least 0 (found {doubt.seed})")
    if doubt.workers is not None and doubt.workers < 1:
        raise InputError("--workers", "", f"must be at least 1 (found {doubt.workers})")


def _robustness(plan: Plan, doubt: Doubt) -> Robustness:
    from drapeplan.robustness import robustness

    return robustness(
        plan,
        doubt.samples,
        seed=doubt.seed,
        workers=doubt.workers,
        depth="tool" if doubt.depth == "tool" else "poses",
    )


def _draw_tornado(figure: Path, robust: Robustness, title: str) -> None:
    from drapeplan.report_robustness import tornado_figure

    tornado_figure(figure, robust, title)


def _document(found: Check, robust: Robustness | None) -> dict[str, Any]:
    """One JSON document."""
    document: dict[str, Any] = {"good": found.passed, "broken": found.broken}
    document |= {"differing": found.differing, "violated": found.violated}
    document |= {"verdict": found.verdict}
    if robust:
        from drapeplan.robustness_words import document as plain

        document["robustness"] = plain(robust)
    return document


def _show(
    plan_file: Path,
    plan: Plan,
    found: Check,
    robust: Robustness | None,
    doubt: Doubt | None,
) -> None:
    """Lines on stdout."""
    for name in ("broken", "differing", "violated"):
        label = "differs" if name == "differing" else name
        for line in getattr(found, name):
            print(f"{label}: {line}")
    if found.passed:
        print(f"{plan_file}: holds; everything recomputed agrees.")
        front, lag = plan.judged[1].front, plan.document["kinematic_lag"]
        facts = summary(found.verdict, front, plan.track, lag)
        show_verdict(found.verdict, facts, False)
    if doubt and not robust:
        print("not judged under uncertainty: the file does not hold")
    if robust:
        from drapeplan.robustness_words import approximations, lines

        print(*lines(robust), sep="\n")
        for line in approximations(robust):
            print(f"  ({line})")
