"""The figure of a validation: scan, model and error map over the plane of the cups.

As Figures 7 and 8 of [Nielsen2018], with the error that its Table 1 sums up.
"""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from drapeplan.compare import Array
from drapeplan.cups_file import MM
from drapeplan.figure_file import write_png
from drapeplan.surface_fit import KNOTS_A_SPAN
from drapeplan.validate import Validation
from ply.grid import Region

GRAY = "#e6e6e6"  # no data
INK = "#222222"
STEPS = np.array([0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50])  # [mm] between contours
LEVELS = 12  # about as many contours as can be counted
BAR = {"pad": 0.015, "fraction": 0.05, "aspect": 18, "shrink": 0.88}
STYLE = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same on every machine
    "font.size": 8,
    "axes.titlesize": 8.5,
    "axes.linewidth": 0.7,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "contour.negative_linestyle": "solid",
}


def validation_figure(path: str | Path, validation: Validation, title: str) -> None:
    """Draw scan, model and error, as a PNG.

    The same validation gives the same bytes; the file appears whole or not at all.

    Args:
        path: Where to write.
        validation: The validation.
        title: Title of the figure.

    Raises:
        InputError: The file cannot be written.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    evidence = validation.evidence
    surface = evidence.surface
    plan = evidence.frame.local(surface.samples) / MM
    width, depth = np.ptp(plan[..., 0]), np.ptp(plan[..., 1])
    stacked = width > 1.25 * depth
    span = 5.0 / width if stacked else 2.3 / width  # [in/mm]
    rows, columns = (3, 1) if stacked else (1, 3)
    size = columns * (width * span + 0.85) + 0.4, rows * (depth * span + 0.62) + 0.35
    with matplotlib.rc_context(STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # titles in any script
        figure = Figure(figsize=size, dpi=220, layout="constrained")
        FigureCanvasAgg(figure)
        panels = figure.subplots(rows, columns, sharex=True, sharey=True)
        figure.suptitle(title, x=0.02, ha="left", fontweight="bold", fontsize=9.5)
        _draw_heights(figure, panels[:2], validation, plan)
        _draw_error(figure, panels[2], validation, plan)
        for n, axes in enumerate(panels):
            _dress(axes, validation, plan)
            axes.label_outer()
            axes.text(
                *(0.0, 1.03, f"({'abc'[n]})"), transform=axes.transAxes, weight="bold"
            )
        write_png(figure, Path(path))


def _draw_heights(
    figure: Any, panels: Any, validation: Validation, plan: Array
) -> None:
    """Scan and model with one scale of height."""
    points = validation.evidence.points / MM
    levels = _levels(plan[..., 2].min(), plan[..., 2].max())
    scale = {"vmin": levels[0], "vmax": levels[-1], "cmap": "cividis"}
    size = float(np.clip(2.5e4 / max(len(points), 1), 0.3, 9))
    order = np.argsort(points[:, 2], kind="stable")
    x, y, z = points[order].T
    panels[0].scatter(x, y, c=z, s=size, linewidths=0, rasterized=True, **scale)
    panels[0].set_title(f"scan, {len(points)} points", loc="left", x=0.06)
    x, y, z = np.moveaxis(plan, -1, 0)
    filled = panels[1].contourf(x, y, z, levels=levels, **scale)
    lines = panels[1].contour(x, y, z, levels=levels, colors="white", linewidths=0.4)
    panels[1].clabel(lines, levels[::2], fontsize=5.5, fmt="%g")
    panels[1].set_title(f"model: {validation.model}", loc="left", x=0.06)
    for axes in panels:
        bar = figure.colorbar(filled, ax=axes, **BAR)
        bar.set_label("height (mm)")
        bar.outline.set_linewidth(0.5)


def _draw_error(figure: Any, axes: Any, validation: Validation, plan: Array) -> None:
    """Smoothed error along the normal over the free ply that the scan covers."""
    from matplotlib.patheffects import withStroke

    error = _error_map(validation)
    x, y = plan[..., 0], plan[..., 1]
    largest = max(float(abs(error).max()), 0.1)
    step = STEPS[np.searchsorted(STEPS, largest / 5)]
    bound = step * np.ceil(largest / step)
    count = round(2 * bound / step)
    levels = np.linspace(-bound, bound, 4 * count + 1)
    filled = axes.contourf(x, y, error, levels=levels, cmap="RdBu_r")
    whole = np.linspace(-bound, bound, count + 1)
    axes.contour(x, y, error, levels=whole, colors=INK, linewidths=0.3)
    score = validation.z
    words = (
        f"error, scan less model: z RMS {score.rms / MM:.2f}, max {score.max / MM:.2f}"
    )
    words += f" mm; noise {validation.noise / MM:.2f} mm"
    axes.set_title(words, loc="left", x=0.06)
    worst = validation.worst
    place = validation.evidence.surface.points([(worst.s, worst.t)])
    at = validation.evidence.frame.local(place)[0] / MM
    axes.plot(*at[:2], "x", color=INK, markersize=5, markeredgewidth=1.1)
    words = axes.annotate(
        f"{worst.error / MM:+.2f}",
        at[:2],
        xytext=(4, 4),
        textcoords="offset points",
        fontsize=7,
        zorder=7,
    )
    words.set_path_effects([withStroke(linewidth=2, foreground="white")])
    bar = figure.colorbar(filled, ax=axes, **BAR)
    middle = count // 2  # zero is among the ticks
    bar.set_ticks(whole[middle % 2 :: 2] if count > 6 else whole)
    bar.set_label("normal error (mm)")
    bar.outline.set_linewidth(0.5)


def _error_map(validation: Validation) -> Any:
    """Error in [mm] on the lines of the surface, masked on cups and in holes."""
    evidence, grid = validation.evidence, validation.grid
    surface = evidence.surface
    st = np.stack(np.meshgrid(surface.s, surface.t), axis=-1)
    near = cKDTree(evidence.comparison.st[evidence.comparison.free])
    hole = near.query(st)[0] > grid.span / KNOTS_A_SPAN / 2
    masked = hole | _inside_cups(validation, st)
    return np.ma.array(evidence.error(st) / MM, mask=masked)


def _inside_cups(validation: Validation, st: Array) -> NDArray[np.bool_]:
    """Points in a cup's square and not on its rim, where free ply begins."""
    grid = validation.grid
    s, t = grid.place_s(st[..., 0]), grid.place_t(st[..., 1])
    rim = np.maximum(abs(s.y), abs(t.y)) > grid.half_width * (1 - 1e-6)
    return (grid.regions(st) == Region.CUP) & ~rim


def _dress(axes: Any, validation: Validation, plan: Array) -> None:
    """Outlines of the cups, limits and names of the axes."""
    from matplotlib.patches import Polygon

    evidence, half = validation.evidence, validation.grid.half_width
    ring = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    cups = evidence.cups
    corners = cups.positions[:, None] + ring @ np.swapaxes(
        cups.rotations[:, :, :2], 1, 2
    )
    for square in evidence.frame.local(corners)[..., :2] / MM:
        axes.add_patch(
            Polygon(square, fill=False, edgecolor="white", linewidth=1.8, zorder=4)
        )
        axes.add_patch(
            Polygon(square, fill=False, edgecolor=INK, linewidth=0.8, zorder=5)
        )
    low, high = plan.min(axis=(0, 1)) - 6, plan.max(axis=(0, 1)) + 6
    axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axes.set(
        xlabel="x, along the rows of cups (mm)",
        ylabel="y, along the columns (mm)",
        facecolor=GRAY,
    )


def _levels(low: float, high: float) -> Array:
    """Levels at round heights that take in both ends."""
    index = np.searchsorted(STEPS, (high - low) / LEVELS)
    step = STEPS[min(int(index), len(STEPS) - 1)]
    return step * np.arange(np.floor(low / step), np.ceil(high / step) + 1)
