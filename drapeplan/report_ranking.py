"""The figure of a ranking: robustness against cycle time, and what nothing beats."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

from drapeplan.figure_file import PLAIN, write_png
from drapeplan.intervals import share_interval
from drapeplan.plan_file import CandidateRow, CandidatesBlock

GOOD, BAD, GRAY = "#0072b2", "#d55e00", "#999999"
STYLE = PLAIN | {"font.size": 9}


def pareto(rows: list[CandidateRow]) -> list[CandidateRow]:
    """Good rows that no other good one beats in P(wrong order) and in time.

    Args:
        rows: Candidates that were looked at on samples.

    Returns:
        The fastest first.
    """
    found: list[CandidateRow] = []
    for row in sorted(rows, key=lambda one: (round(one.time_s or 0.0, 1), one.wrong)):
        if row.good and (not found or row.wrong < found[-1].wrong):
            found.append(row)
    return found


def pareto_figure(path: Path, block: CandidatesBlock, title: str) -> None:
    """Draw P(wrong order) against the time of the whole cycle, as a PNG.

    The same arguments give the same bytes; the file appears whole or not at all.

    Args:
        path: Where to write.
        block: The candidates; those without samples are not drawn.
        title: Title of the figure.

    Raises:
        InputError: The file cannot be written.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    shown = [(k + 1, row) for k, row in enumerate(block.rows) if row.samples]
    with matplotlib.rc_context(STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # titles in any script
        figure = Figure(figsize=(7.2, 4.0), dpi=150, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots()
        figure.suptitle(title, x=0.01, ha="left", fontsize=10, fontweight="bold")
        front = pareto([row for _, row in shown])
        if front:
            x = [row.time_s or 0.0 for row in front]
            y = [row.wrong_share for row in front]
            label = "fastest at its risk"
            style: Any = {"color": GRAY, "where": "post", "lw": 1.0, "label": label}
            axes.step(x, y, **style)
        for good, color, label in ((True, GOOD, "good"), (False, BAD, "not good")):
            some = [(k, row) for k, row in shown if row.good == good]
            if some:
                _draw(axes, some, color, label)
        axes.set_xlabel("time of the whole drape (s)")
        axes.set_ylabel(f"P(wrong order), 95 % of {block.samples} samples")
        axes.set_ylim(
            -0.02, 1.02 if any(r.wrong_share > 0.3 for _, r in shown) else 0.5
        )
        axes.grid(color="#e4e4e4", lw=0.6)
        axes.set_axisbelow(True)
        if shown:
            axes.legend(frameon=False, fontsize=8, loc="upper right")
        write_png(figure, path)


def _draw(
    axes: Any, some: list[tuple[int, CandidateRow]], color: str, label: str
) -> None:
    """Points with their intervals; those at one place share a label."""
    x = [row.time_s or 0.0 for _, row in some]
    y = [row.wrong_share for _, row in some]
    ends = [share_interval(row.wrong, row.samples) for _, row in some]
    low = [share - low for share, (low, _) in zip(y, ends, strict=True)]
    high = [high - share for share, (_, high) in zip(y, ends, strict=True)]
    bars: Any = {"fmt": "o", "ms": 5, "lw": 1.0, "capsize": 2, "alpha": 0.9}
    axes.errorbar(x, y, yerr=[low, high], color=color, label=label, **bars)
    places: dict[tuple[float, float], list[str]] = {}
    for k, row in some:
        place = round(row.time_s or 0.0), row.wrong_share
        places.setdefault(place, []).append(str(k))
    for (at, share), names in places.items():
        text = ", ".join(names)
        offset = {"textcoords": "offset points", "xytext": (5, 4), "fontsize": 8}
        axes.annotate(text, (at, share), color=color, **offset)
