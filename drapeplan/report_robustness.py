"""The tornado figure: what each uncertainty alone does to a plan."""

from pathlib import Path
from typing import Any

import numpy as np

from drapeplan.figure_file import PLAIN, write_png
from drapeplan.robustness import Robustness
from drapeplan.robustness_words import NAMES
from drapeplan.rolling import CAP

BLUE, RED, GRAY = "#4477aa", "#d62728", "#777777"
BAR = 0.5  # [-] of a row's height
STYLE = PLAIN | {"font.size": 9}


def tornado_figure(path: str | Path, found: Robustness, title: str) -> None:
    """Draw margin and press depth under each parameter alone, as a PNG.

    Margins are left out where none comes within CAP of a wrong order.
    The same arguments give the same bytes; the file appears whole or not at all.

    Args:
        path: Where to write.
        found: A plan under uncertainty, each parameter looked at alone.
        title: Title of the figure.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    with matplotlib.rc_context(STYLE):
        height = 1.8 + 0.4 * max(1, len(found.effects))
        figure = Figure(figsize=(9.0, height), dpi=150, layout="constrained")
        FigureCanvasAgg(figure)
        low, high = found.interval
        share = found.wrong / len(found.rollouts)
        text = f"{title}: P(wrong order) = {share:.3f}, 95 % in {low:.3f} to {high:.3f}"
        near = any((one.margins < CAP).any() for one in found.effects)
        if not near:
            text += f"; alone, none comes within {1e3 * CAP:g} mm of it"
        figure.suptitle(text, x=0.01, ha="left", fontsize=10, fontweight="bold")
        *margins, press = figure.subplots(1, 1 + near, sharey=True, squeeze=False)[0]
        for margin in margins:
            _bars(margin, [one.margins for one in found.effects])
            planned = min(found.planned.margin, CAP)
            margin.axvline(1e3 * planned, color=GRAY, lw=1.0)
            margin.axvline(0.0, color=RED, lw=1.0)
            margin.set_xlabel(
                f"least margin (mm, {1e3 * CAP:g} where nothing threatens)"
            )
            margin.set_xlim(right=1.05e3 * CAP)
        _bars(press, [one.press for one in found.effects])
        depth = max(found.planned.span_press, found.planned.pad_press)
        press.axvline(1e3 * depth, color=GRAY, lw=1.0)
        press.set_xlabel("press depth (mm)")
        press.set_xlim(left=0.0)
        names = [f"{NAMES[e.parameter]}, P {e.wrong_share:.2f}" for e in found.effects]
        press.set_yticks(np.arange(len(names)), names)
        press.invert_yaxis()
        bar = Patch(color=BLUE, alpha=0.6, label="5 to 95 % of samples")
        lines = [("median", BLUE, 2.5), ("planned", GRAY, 1.0)]
        lines += [("wrong order", RED, 1.0)] * near
        drawn = [Line2D([], [], color=c, lw=w, label=name) for name, c, w in lines]
        figure.legend(
            handles=[bar, *drawn],
            loc="outside lower center",
            ncols=4,
            frameon=False,
            fontsize=8,
        )
        write_png(figure, Path(path))


def _bars(axes: Any, samples: list[Any]) -> None:
    """A bar from the 5 % to the 95 % quantile of each row, its median marked."""
    for row, values in enumerate(samples):
        low, middle, high = 1e3 * np.quantile(values, (0.05, 0.5, 0.95))
        axes.barh(row, high - low, BAR, left=low, color=BLUE, alpha=0.6)
        axes.plot([middle, middle], [row - BAR / 2, row + BAR / 2], color=BLUE, lw=2.5)
    axes.grid(axis="x", color="#dddddd", lw=0.6)
    axes.set_axisbelow(True)
