"""What the command line prints: verdicts, errors, progress, the first-touch picture."""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drapeplan.errors import DrapeplanError
from drapeplan.files import unwritable

if TYPE_CHECKING:
    from drapeplan.planner import Progress
    from drapeplan.robustness import Robustness


def say_error(error: DrapeplanError, as_json: bool) -> None:
    """One line on stderr; what was found beside it follows, indented.

    Args:
        error: What ended the command; it may carry a report and sentences.
        as_json: Whether stdout gets one JSON document.
    """
    report, lines = getattr(error, "report", None), getattr(error, "sentences", ())
    if as_json:
        document = {"good": False, "error": str(error), "exit_code": error.exit_code}
        print(json.dumps({**document, **({"report": report} if report else {})}))
    name = "not drapable" if error.exit_code == 1 else "error"
    print(f"{name}: {error}", file=sys.stderr)
    if lines:
        print("On the requested poses, whatever the tool says:", file=sys.stderr)
    for line in lines:
        print(f"  {line}", file=sys.stderr)


@contextmanager
def show_progress(quiet: bool) -> Iterator[Progress | None]:
    """Progress on stderr, only where somebody watches.

    Args:
        quiet: Whether to show none at all.
    """
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress as Bar

    with Bar(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda stage, share: bar.update(task, description=stage, completed=share)


def draw_first_touch(path: Path, result: Any, contact: Any, title: str) -> None:
    """The first-touch picture of a plan.

    Args:
        path: PNG to write.
        result: The plan.
        contact: The ply that its verdict rests on.
        title: Title of the picture.

    Raises:
        InputError: If the file cannot be written.
    """
    import numpy as np

    from drapeplan.report import first_touch_figure

    track, sampling = result.track, result.cell.sampling
    span = track.held
    step = np.maximum.accumulate(np.maximum(track.step[span] + track.tau[span], 0.0))
    step = np.where(np.array(track.phase[span]) == "wave", step, 0.0)
    front = contact.front
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Glyph")  # titles in any script
            first_touch_figure(
                path,
                sampling.s,
                sampling.t,
                front.first_touch,
                step,
                sampling.grid.centers,
                result.sequence.index(result.sequence.start_cup),
                front.events,
                title,
                front.premature_region,
                front.pocket_region,
                sampling.grid.half_width,
            )
    except OSError as error:
        raise unwritable(path, error) from error


def show_verdict(
    verdict: dict[str, Any],
    lines: list[str],
    as_json: bool,
    robust: Robustness | None = None,
    written: list[Path] | None = None,
) -> None:
    """Verdict with its margins, and the files written, on stdout.

    Args:
        verdict: The verdict as plain data.
        lines: The same in words.
        as_json: Whether one JSON document is wanted.
        robust: What becomes of the plan under uncertainty, where that was asked.
        written: Files written.
    """
    from drapeplan.remarks import remarks
    from drapeplan.robustness_words import document
    from drapeplan.robustness_words import sentences as doubts

    files = [str(path) for path in written or []]
    if as_json:
        lines = [*lines, *(doubts(robust) if robust else [])]
        good = verdict["good"]
        facts = {"good": good, "sentences": lines, "written": files, "verdict": verdict}
        more = {"robustness": document(robust)} if robust else {}
        print(json.dumps({**facts, **more}))
        return
    print("good" if verdict["good"] else "not good")
    for line in lines:
        print(f"  {line}")
    for remark in remarks(verdict):
        print(f"  {remark.text}")
    print("  step  cups  premature mm  air pocket mm  penetration mm")
    for row in verdict["steps"]:
        early, air = (
            "-" if row[key] is None else f"{row[key]:.2f}"
            for key in ("premature_margin_mm", "air_margin_mm")
        )
        depth = max(row["span_penetration_mm"], row["pad_penetration_mm"])
        count = len(row["cups"])
        print(f"  {row['step']:4d}  {count:4d}  {early:>12}  {air:>13}  {depth:14.3f}")
    print("  (-: nothing threatens)")
    if robust:
        show_robustness(robust)
    for name in files:
        print(f"wrote {name}")


def show_robustness(robust: Robustness) -> None:
    """What becomes of a plan under uncertainty, on stdout."""
    from drapeplan.robustness_words import approximations, sentences, table

    print(*sentences(robust), *table(robust), sep="\n")
    for line in approximations(robust):
        print(f"  ({line})")
