"""Words for a tuning: what was tried, what is taken, what is gained."""

from __future__ import annotations

from typing import Any

from drapeplan.judged import Judged
from drapeplan.scene import CountedSection, TunedSection
from drapeplan.tune import Finalist, Tuning
from drapeplan.tuned import gain_sentence, path_hash
from drapeplan.tuning_space import Space

NAMES = {
    "scene": "the scene's own",
    "mean": "mean of the search",
    "luckiest": "luckiest trial",
    "steps": "steps by themselves",
    "surrogate": "surrogate's proposal",
}


def tuning_lines(found: Tuning, space: Space, surrogate: list[str]) -> list[str]:
    """What tuning found, one line each.

    Args:
        found: The tuning.
        space: Its parameters.
        surrogate: Lines about the surrogate.
    """
    lines = [f"{found.trials} paths tried; finalists on samples of their own:"]
    lines += [_finalist(one, one is found.chosen) for one in found.finalists]
    lines += surrogate
    if not found.changed:
        return [*lines, "Nothing is gained: the path stays as it is."]
    before = space.values(found.before.path)
    after = space.values(found.after.path)
    moved = [name for name in after if after[name] != before[name]]
    changes = (f"{name} {before[name]:g} to {after[name]:g}" for name in moved)
    leans = [one for one in _steps(found.after) if one not in _steps(found.before)]
    lean = [f"toe-up of step {k} {angle:g} deg" for k, angle in leans]
    lines.append("Path: " + ", ".join([*changes, *lean]) + ".")
    lines.append(gain_sentence(gain(found)))
    return lines


def gain(found: Tuning) -> TunedSection:
    """Before and after, as the scene keeps it."""
    return TunedSection(
        samples=max(len(found.before.rows), len(found.after.rows), 1),
        before=CountedSection(**_counted(found.before)),
        after=CountedSection(**_counted(found.after)),
        path=path_hash(found.after.path),
    )


def tuning_document(found: Tuning, space: Space) -> dict[str, Any]:
    """The same as plain data."""
    finalists = [
        {
            "name": one.name,
            "loss": one.judged.loss,
            "chosen": one is found.chosen,
            "path": space.values(one.judged.path),
            "toe_up_steps": _steps(one.judged),
            "samples": len(one.judged.rows),
            **_counted(one.judged),
        }
        for one in found.finalists
    ]
    return {
        "trials": found.trials,
        "finalists": finalists,
        "gain": gain(found).model_dump(),
    }


def _steps(judged: Judged) -> tuple[tuple[int, float], ...]:
    """Steps whose cups lean by themselves."""
    return judged.path.toe_up_steps


def _counted(judged: Judged) -> dict[str, Any]:
    refused = bool(judged.plan["refused"])
    return {
        "wrong": None if refused else judged.wrong,
        "good": bool(judged.plan["good"]),
    }


def _finalist(one: Finalist, chosen: bool) -> str:
    judged = one.judged
    mark = "*" if chosen else " "
    if judged.plan["refused"]:
        return f" {mark} {NAMES[one.name]:<20}  no plan: {judged.plan['refused']}"
    missing = ", ".join(judged.plan["not_good"])
    verdict = f"  not good: {missing}" if missing else ""
    count = f"{judged.wrong:3d} of {len(judged.rows)} wrong"
    return f" {mark} {NAMES[one.name]:<20}  {count}, loss {judged.loss:.3f}{verdict}"
