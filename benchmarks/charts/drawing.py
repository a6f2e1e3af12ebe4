"""How charts look: one marker a method, readable in print and for the color-blind."""

import io
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, Formatter, LogLocator, NullFormatter

from benchmarks.charts._notes import GRAY, SIZE, note, spread
from benchmarks.charts.results import Results
from drapeplan.files import write_bytes

COLORS = (  # Okabe and Ito, told apart by the color-blind; yellow is too pale
    *("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"),
)
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "p", "*", "h")
STYLE = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.labelsize": 9,
    "legend.fontsize": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "lines.markersize": 6,
    "svg.hashsalt": "drapeplan",  # the same ids, so the same bytes
    "svg.fonttype": "none",  # text stays text
}
WIDTH = 7.2  # [in] of a figure: two columns of a journal
DPI = 150  # [1/in] of the PNG
ROOM = 0.37  # [in] along an axis for a label
LONG = 1e4  # [-] numbers beyond are written as powers, which are wider
LINE = 132  # [-] characters of a note's line


def save(draw: Callable[[Results], Figure], results: Results, stem: Path) -> list[Path]:
    """Draw results with their provenance below, as PNG and SVG; returns the files."""
    with matplotlib.rc_context(STYLE):
        figure = draw(results)
        figure.supxlabel(
            provenance(results), fontsize=SIZE, color=GRAY, x=0.01, ha="left"
        )
        finish(figure)
        files = []
        for kind, metadata in (("png", {"Software": None}), ("svg", {"Date": None})):
            content = io.BytesIO()
            figure.savefig(content, format=kind, dpi=DPI, metadata=metadata)
            files.append(stem.with_suffix(f".{kind}"))
            write_bytes(files[-1], content.getvalue())
    return files


def provenance(results: Results) -> str:
    """What a figure was measured with, and what is missing in it."""
    made = results.made
    lines = [
        f"{made['processor']}, Python {made['python']}, {made['versions']}; "
        f"{made['date']}" + (", quick run" if made["quick"] else "")
    ]
    lines += [
        f"Not in the chart: {name}: {why}" for name, why in results.missing.items()
    ]
    return "\n".join(textwrap.fill(line, LINE) for line in lines)


def look(index: int) -> dict[str, str]:
    """Color and marker of a method; both differ from those of its neighbors."""
    return {
        "color": COLORS[index % len(COLORS)],
        "marker": MARKERS[index % len(MARKERS)],
    }


def log_log(axes: Axes, title: str, x: str, y: str) -> None:
    """Title and labels of a panel with logarithmic axes."""
    axes.set(title=title, xlabel=x, ylabel=y, xscale="log", yscale="log")


def finish(figure: Figure) -> None:
    """Label logarithmic axes and put notes where they hide nothing."""
    figure.set_dpi(DPI)
    _tick(figure)
    spread(figure)
    figure.set_layout_engine("none")  # all stays where notes found it


def _tick(figure: Figure) -> None:
    """Labels of logarithmic axes: 1, 2, 5 in every decade where there is room."""
    for axes in figure.axes:
        sides = axes.get_window_extent()  # nearly: the layout is not known yet
        for axis, length in ((axes.xaxis, sides.width), (axes.yaxis, sides.height)):
            low, high = np.sort(axis.get_view_interval())
            fixed = isinstance(axis.get_major_locator(), FixedLocator)
            if axis.get_scale() != "log" or fixed:
                continue
            room = ROOM * (2 if axis is axes.xaxis and high > LONG else 1)
            if length > room * 3 * np.log10(high / low) * DPI:
                axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(_Plain())
            axis.set_minor_formatter(NullFormatter())


class _Plain(Formatter):
    """Plain numbers near one, powers of ten elsewhere."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Label of a tick."""
        if 1e-3 < x < LONG:
            return f"{x:g}"
        digit, power = f"{x:.0e}".split("e")
        times = "" if digit == "1" else rf"{digit} \cdot "
        return f"${times}10^{{{int(power)}}}$"


def legend(figure: Figure, columns: int = 5) -> None:
    """One legend above all panels, each method once."""
    entries = {
        label: handle
        for axes in figure.axes
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(
        entries.values(),
        entries.keys(),
        loc="outside upper center",
        ncols=columns,
        frameon=False,
    )


def scatter(
    axes: Axes,
    x: Sequence[float],
    y: Sequence[float],
    label: str,
    method: int,
    *,
    joined: bool = False,
    hollow: bool = False,
    notes: Sequence[str] = (),
) -> None:
    """Points of one method, joined if they are settings of one knob.

    Args:
        axes: The panel.
        x: Where along.
        y: Where up.
        label: Name in the legend.
        method: Which look.
        joined: Whether a line joins the points in their order.
        hollow: Whether markers are not filled: what is published or recorded elsewhere.
        notes: A few words beside each point, placed when all is drawn.
    """
    face = {"markerfacecolor": "white"} if hollow else {}
    line = "-" if joined else ""
    axes.plot(x, y, label=label, linestyle=line, linewidth=0.9, **look(method), **face)
    for a, b, text in zip(x, y, notes, strict=False):
        if text:
            note(axes, a, b, text)


def ends(notes: Sequence[str]) -> list[str]:
    """The first and the last of a knob's settings, a common unit once."""
    if len(notes) < 2:
        return [""] * len(notes)
    (*value, unit), (*_, same) = notes[0].split(), notes[-1].split()
    first = " ".join(value) if unit == same else notes[0]
    return [first, *[""] * (len(notes) - 2), notes[-1]]


def published(axes: Axes, x: float, y: float, text: str) -> None:
    """A point that others published, which lies at x or left of it."""
    axes.plot([x], [y], "*", color=GRAY, markerfacecolor="white", markersize=11)
    axes.annotate(
        "", (x / 3, y), (x, y), arrowprops={"arrowstyle": "->", "color": GRAY}
    )
    place = {"textcoords": "offset points", "ha": "center", "va": "top"}
    axes.annotate(text, (x, y), (-8, -7), fontsize=SIZE, color=GRAY, **place)


def upright(axes: Axes, x: float, text: str) -> None:
    """A time that has no error of its own, as that of the reference."""
    axes.axvline(x, color=GRAY, linestyle=":", linewidth=1.2)
    axes.annotate(
        text,
        (x, 0.02),
        (-3, 0),
        xycoords=("data", "axes fraction"),
        textcoords="offset points",
        rotation=90,
        ha="right",
        va="bottom",
        fontsize=SIZE,
        color=GRAY,
    )


def pareto(x: Sequence[float], y: Sequence[float]) -> list[int]:
    """Indices of points that no other beats in both, from left to right."""
    order = sorted(range(len(x)), key=lambda k: (x[k], y[k]))
    front: list[int] = []
    for k in order:
        if not front or y[k] < y[front[-1]]:
            front.append(k)
    return front


def front(axes: Axes, x: Sequence[float], y: Sequence[float]) -> None:
    """Draw the Pareto front of points, as steps behind them."""
    best = pareto(x, y)
    a, b = np.array(x, float)[best], np.array(y, float)[best]
    axes.step(
        a, b, where="post", color=GRAY, linewidth=3.5, alpha=0.3, label="Pareto front"
    )
