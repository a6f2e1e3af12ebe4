"""Ranking words: the table of candidates, and what is said below it."""

from __future__ import annotations

from rich import box
from rich.console import Console
from rich.table import Table

from drapeplan.intervals import share_interval
from drapeplan.plan_file import CandidateRow, CandidatesBlock
from drapeplan.rolling import CAP

COLUMNS = (
    *("start", "pattern", "good", "P wrong (95 %)", "margin", "pressed"),
    *("strokes", "shear", "take-up", "steps", "time"),
)
UNITS = ("", "", "", "", "mm", "mm", "mm", "deg", "mm", "", "s")


WIDTH = 120  # [-] characters that the table may take


def show(block: CandidatesBlock) -> None:
    """Print table and lines on stdout.

    Args:
        block: The candidates.
    """
    console = Console(highlight=False)
    console.width = max(console.width, WIDTH)
    console.print(table(block))
    print(*lines(block), sep="\n")


def table(block: CandidatesBlock) -> Table:
    """One row for each candidate, the best first.

    Args:
        block: The candidates.
    """
    grid = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    grid.add_column("\n", justify="right")
    for k, (name, unit) in enumerate(zip(COLUMNS, UNITS, strict=True)):
        side = "left" if k in (1, 2) else "right"
        grid.add_column(f"{name}\n{unit}", justify=side, no_wrap=True)  # type: ignore[arg-type]
    for k, row in enumerate(block.rows):
        style = "bold" if k == 0 and row.good else "dim" if not row.good else ""
        grid.add_row(str(k + 1), *cells(row), style=style)
    return grid


def cells(row: CandidateRow) -> tuple[str, ...]:
    """A candidate in the table's columns.

    Args:
        row: The candidate.
    """
    start = f"{row.start[0]}, {row.start[1]}"
    answer = "yes" if row.good else "refused" if row.refused else "no"
    if row.good and not row.samples:
        answer = "perhaps"  # its kinematic plan is
    head = start, row.pattern, answer
    if row.refused:
        return *head, *("" for _ in range(6)), str(row.steps), ""
    chance = "-"
    if row.samples:
        low, high = share_interval(row.wrong, row.samples)
        chance = f"{row.wrong_share:.2f} ({low:.2f}-{high:.2f})"
    return (
        *head,
        chance,
        _margin(row.low_margin_mm if row.samples else row.margin_mm),
        f"{row.penetration_mm:.2f}",
        f"{row.stroke_mm:.0f}",
        f"{row.largest_shear_deg:.1f}",
        f"{row.take_up_left_mm:.2f}",
        str(row.steps),
        f"{row.time_s:.0f}",
    )


def _margin(value: float | None) -> str:
    most = 1e3 * CAP
    return f"{value:.2f}" if value is not None and value < most else f"> {most:g}"


def lines(block: CandidatesBlock) -> list[str]:
    """Why each is a candidate, what is wrong with it, and what the columns mean.

    Args:
        block: The candidates.
    """
    found = [f"{k + 1:2d}  {_said(row)}" for k, row in enumerate(block.rows)]
    found += [
        f"P wrong: share of {block.samples} samples under the scene's uncertainty that "
        "touch in the wrong order;",
        "margin: 5 % of them have less, or of the plan itself; pressed: deepest place "
        "of the plan;",
        "strokes: from the shortest to the longest; take-up: what is left of it.",
    ]
    if any(row.samples == 0 and not row.refused for row in block.rows):
        found.append(
            "Without P: judged by a kinematic plan alone, which is optimistic."
        )
    return found + safer(block)


def _said(row: CandidateRow) -> str:
    if row.refused:
        return f"{row.why}: {row.refused}"
    return f"{row.why}: {', '.join(row.not_good)}" if row.not_good else row.why


def safer(block: CandidatesBlock) -> list[str]:
    """A sentence if one that is not good is at clearly less risk than the best.

    Args:
        block: The candidates.
    """
    best, others = block.rows[0], [row for row in block.rows[1:] if row.samples]
    low = share_interval(best.wrong, best.samples)[0] if best.samples else 0.0
    less = [r for r in others if share_interval(r.wrong, r.samples)[1] < low]
    if not less:
        return []
    row = min(less, key=lambda one: one.wrong_share)
    why = "" if row.good else f", but not good ({', '.join(row.not_good)})"
    return [
        f"At less risk{why}: start {list(row.start)}, {row.pattern}, "
        f"P {row.wrong_share:.2f} instead of {best.wrong_share:.2f}."
    ]


def taken(block: CandidatesBlock) -> str:
    """What a plan was chosen from.

    Args:
        block: The candidates.
    """
    row, count = block.rows[0], len(block.rows)
    good = sum(one.good for one in block.rows)
    text = (
        f"Chosen from {count} candidates, {good} of them good: start {list(row.start)}"
    )
    return " ".join([f"{text}, {row.pattern} ({row.why}).", *safer(block)])
