"""The figure of an identification: what was measured against what was fitted."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm

from drapeplan.cantilever import load_of_drop, steepest
from drapeplan.cups_file import EARTH
from drapeplan.figure_file import PLAIN, write_png
from drapeplan.identify import Identified
from drapeplan.identify_file import Measurements

COLORS = {"warp": "#0072b2", "weft": "#d55e00"}
BLUE, RED, GRAY = "#0072b2", "#d55e00", "#999999"
STYLE = PLAIN | {"font.size": 8}
MM, DEG = 1e3, float(np.degrees(1.0))


def identify_figure(
    path: Path, found: Identified, measured: Measurements, title: str
) -> None:
    """Draw strips over an edge, lengths in the band and errors of poses, as a PNG.

    The same arguments give the same bytes; the file appears whole or not at all.

    Args:
        path: Where to write.
        found: The identification.
        measured: What it was made from.
        title: Title of the figure.

    Raises:
        InputError: The file cannot be written.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # titles in any script
        figure = Figure(figsize=(9.6, 3.3), dpi=170, layout="constrained")
        FigureCanvasAgg(figure)
        panels = figure.subplots(1, 3)
        figure.suptitle(title, x=0.01, ha="left", fontweight="bold", fontsize=9.5)
        _draw_overhangs(panels[0], found, measured)
        _draw_band(panels[1], found)
        _draw_poses(panels[2], found)
        for axes in panels:
            axes.grid(color="#e4e4e4", lw=0.6)
            axes.set_axisbelow(True)
            if axes.get_legend_handles_labels()[1]:
                axes.legend(frameon=False, fontsize=7)
            else:
                center = {"ha": "center", "transform": axes.transAxes, "color": GRAY}
                axes.text(0.5, 0.5, "not measured", **center)
        write_png(figure, path)


def _draw_overhangs(axes: Any, found: Identified, measured: Measurements) -> None:
    """Drop against overhang; each fitted stiffness is one curve."""
    axes.set_title("strips over an edge", loc="left")
    axes.set_xlabel("overhang (mm)")
    axes.set_ylabel("drop (mm)")
    if not measured.cantilever:
        return
    strips, share = measured.cantilever.strips, np.linspace(0, steepest().drop, 400)
    load = load_of_drop(share)
    reach = 1.15 * max(one.length.max() for one in strips.values())
    for name, one in strips.items():
        drop = np.interp(one.load, load, share) * one.length
        dots = {"color": COLORS[name], "label": f"{name}, measured", "s": 14}
        axes.scatter(MM * one.length, MM * drop, **dots)
        D = found.stiffness[name].value
        length = np.cbrt(load * D / (EARTH * measured.cantilever.areal_mass))
        short = length <= reach
        x, y = MM * length[short], MM * (share * length)[short]
        axes.plot(x, y, color=COLORS[name], lw=1, label=f"D = {D:.3g} N m")


def _draw_band(axes: Any, found: Identified) -> None:
    """Length that strips have against length that cups ask for: the band."""
    axes.set_title("strips between cups, likeliest poses", loc="left")
    axes.set_xlabel("length asked for, beyond rest (mm)")
    axes.set_ylabel("length seen, beyond rest (mm)")
    if not found.looks:
        return
    strips = [one.strips for one in found.looks]
    off = np.concatenate([one.rest for one in strips]) + np.concatenate(found.likely)
    asked = MM * (np.concatenate([one.asked for one in strips]) - off)
    length = MM * (np.concatenate([one.length for one in strips]) - off)
    out = np.concatenate([one.out != 0 for one in strips])
    for chosen, label, color in ((~out, "in the band", GRAY), (out, "out of it", BLUE)):
        x, y = asked[chosen], length[chosen]
        if len(x):
            axes.scatter(x, y, s=9, color=color, zorder=3, label=f"{len(x)} {label}")
    reach = 1.1 * float(abs(asked).max(initial=0.0))
    if found.take_up and reach:
        x, b = np.linspace(-reach, reach, 400), MM * found.take_up.value
        axes.plot(x, np.clip(x, -b, b), color=RED, lw=1.2, label=f"take-up {b:.2f} mm")
        low, high = MM * found.take_up.low, MM * found.take_up.high
        ends = np.clip(x, -low, low), np.clip(x, -high, high)
        axes.fill_between(x, *ends, color=RED, alpha=0.2, lw=0)


def _draw_poses(axes: Any, found: Identified) -> None:
    """Errors of recorded poses against normal quantiles: a straight line each."""
    axes.set_title("errors of recorded poses", loc="left")
    axes.set_xlabel("normal quantile")
    axes.set_ylabel("height (mm), tilt (deg)")
    seen = [one.cups for one in found.looks]
    for estimate, values, scale, unit, color in (
        (found.position, [c.heights[c.seen] for c in seen], MM, "mm", BLUE),
        (found.angle, [c.tilts[c.seen].ravel() for c in seen], DEG, "deg", RED),
    ):
        if estimate is None:
            continue
        y = scale * np.sort(np.concatenate(values))
        x = norm.ppf((np.arange(len(y)) + 0.5) / len(y))
        spread = scale * estimate.value
        axes.scatter(x, y, s=7, color=color)
        label = f"{spread:.3f} {unit}"
        axes.plot(x, spread * x, color=color, lw=1, label=label)
