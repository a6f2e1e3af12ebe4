"""The first-touch figure: when each place of the ply first meets the mold."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drapeplan.figure_file import write_png
from drapeplan.flood import Bools, Floats
from drapeplan.verdict import EventKind, FrontEvent

RED = "#d62728"  # what went wrong: far from every color of Cividis
GRAY = "#e3e3e3"  # what never touches
ORDER_FAULTS = (EventKind.PREMATURE, EventKind.AIR_POCKET)
SHADES = 48  # most shades of the filled contours: finer ones cannot be told apart
STYLE = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same on every machine
    "font.size": 9,
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.linewidth": 0.8,
    "hatch.linewidth": 0.9,
    "hatch.color": RED,
}


def first_touch_figure(
    path: str | Path,
    s: Floats,
    t: Floats,
    first_touch: Floats,
    steps_of_pose: Floats,
    cup_centers: Floats,
    start_cup: int,
    events: Sequence[FrontEvent],
    title: str,
    premature_region: Bools | None = None,
    pocket_region: Bools | None = None,
    half_width: float = 0.020,
) -> None:
    """Draw when each place of the ply first touches the mold, as a PNG.

    The same arguments give the same bytes; the file appears whole or not at all.

    Args:
        path: Where to write.
        s: Material coordinates along s, shape (ns,), in [m].
        t: Material coordinates along t, shape (nt,), in [m].
        first_touch: Pose of the first touch, shape (nt, ns), infinite for never.
        steps_of_pose: Wave step of each pose, shape (K,), not falling; 2.25 is a
            quarter through the step from 2 to 3.
        cup_centers: Middles (s, t) of the cups, shape (n_cups, 2), in [m].
        start_cup: Index of the cup placed first.
        events: What went wrong; each is marked at its place.
        title: Title of the figure.
        premature_region: Samples ever in a premature contact, shape (nt, ns).
        pocket_region: Samples ever in an air pocket, shape (nt, ns).
        half_width: Half side of the square that a cup holds, in [m].
    """
    import matplotlib

    step = np.interp(first_touch, np.arange(len(steps_of_pose)), steps_of_pose)
    step = np.ma.array(step, mask=np.isinf(first_touch))
    s, t, centers = 1e3 * s, 1e3 * t, 1e3 * cup_centers
    with matplotlib.rc_context(STYLE):
        figure, axes = _page(s, t, centers, title)
        _draw_steps(figure, axes, s, t, step)
        _draw_cups(axes, centers, start_cup, 1e3 * half_width)
        for region, hatch, label in (
            (premature_region, "////", "premature contact"),
            (pocket_region, "....", "air pocket"),
        ):
            if region is not None and region.any():
                _draw_region(axes, s, t, region, hatch, label)
        _draw_events(axes, events)
        if step.mask.any():
            axes.fill([], [], color=GRAY, label="never touches")
        figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=8)
        write_png(figure, Path(path))


def _page(s: Floats, t: Floats, centers: Floats, title: str) -> tuple[Any, Any]:
    """Figure and axes in millimeters, with cup rows and columns at the far sides."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    scale = 6.0 / max(np.ptp(s), np.ptp(t))
    size = np.ptp(s) * scale + 2.0, np.ptp(t) * scale + 1.6
    figure = Figure(figsize=size, dpi=200, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot(facecolor=GRAY)
    axes.set(aspect="equal", xlim=(s[0], s[-1]), ylim=(t[0], t[-1]))
    axes.set(xlabel="s, along the columns (mm)", ylabel="t, along the rows (mm)")
    axes.set_title(title, loc="left", pad=10)
    top, right = axes.secondary_xaxis("top"), axes.secondary_yaxis("right")
    columns, rows = np.unique(centers[:, 0]), np.unique(centers[:, 1])
    top.set_xticks(columns, [f"{j}" for j in range(len(columns))])
    right.set_yticks(rows, [f"{i}" for i in range(len(rows))])
    top.set_xlabel("cup column", fontsize=8)
    right.set_ylabel("cup row", fontsize=8)
    for names in (top, right):
        names.tick_params(length=0, labelsize=8, colors="#555555")
    return figure, axes


def _draw_steps(figure: Any, axes: Any, s: Floats, t: Floats, step: Any) -> None:
    """Filled contours of the first touch, a line at each whole step, a color bar."""
    if step.count() == 0:
        return
    low = np.floor(step.min())
    high = max(np.ceil(step.max()), low + 1)
    shade = 1 / max(1, SHADES // (high - low))
    count = max(1, int(np.ceil((step.max() - low) / shade)))
    levels = low + shade * np.arange(count + 1)  # whole steps are among them
    levels[-1] = max(levels[-1], step.max())  # rounding must not drop the last touch
    filled = axes.contourf(s, t, step, levels=levels, cmap="cividis")
    whole = np.arange(low + 1, high)
    lines = axes.contour(s, t, step, levels=whole, colors="white", linewidths=0.9)
    axes.clabel(lines, fmt="%d", fontsize=7)
    bar = figure.colorbar(filled, ax=axes, pad=0.02, fraction=0.04, aspect=40)
    bar.set_label("first touch (wave step)")
    bar.set_ticks(
        np.arange(low, levels[-1] + shade / 2, max(1, np.ceil((high - low) / 12)))
    )
    bar.outline.set_linewidth(0.6)


def _draw_cups(axes: Any, centers: Floats, start_cup: int, half: float) -> None:
    """Squares that the cups hold, the start cup with a star."""
    from matplotlib.patches import Rectangle

    for index, (x, y) in enumerate(centers):
        for color, width in (("white", 1.8), ("black", 0.7)):
            box = Rectangle((x - half, y - half), 2 * half, 2 * half, fill=False)
            box.set(edgecolor=color, zorder=4)
            box.set_linewidth(width * (2 if index == start_cup else 1))
            axes.add_patch(box)
    axes.plot(
        *centers[start_cup],
        marker="*",
        markersize=13,
        markerfacecolor="white",
        markeredgecolor="black",
        zorder=5,
        linestyle="none",
        label="start cup",
    )


def _draw_region(
    axes: Any, s: Floats, t: Floats, region: Bools, hatch: str, label: str
) -> None:
    """Outline of a region in red, hatched."""
    field = np.pad(region.astype(float), 1)  # closes the outline at the ply's edge
    s = np.concatenate([[s[0]], s, [s[-1]]])
    t = np.concatenate([[t[0]], t, [t[-1]]])
    axes.contourf(s, t, field, levels=[0.5, 2], colors="none", hatches=[hatch])
    axes.contour(s, t, field, levels=[0.5], colors="white", linewidths=3.0)
    axes.contour(s, t, field, levels=[0.5], colors=RED, linewidths=1.6)
    axes.fill([], [], facecolor="none", edgecolor=RED, hatch=hatch, label=label)


def _draw_events(axes: Any, events: Sequence[FrontEvent]) -> None:
    """Crosses where things went wrong, triangles where the ply was pushed in."""
    order = [event for event in events if event.kind in ORDER_FAULTS]
    depth = [event for event in events if event.kind not in ORDER_FAULTS]
    for chosen, marker, label in (
        (depth, "v", "pushed into the mold"),
        (order, "X", "deepest place"),
    ):
        if chosen:
            size = 8 if marker == "X" else 13
            axes.plot(
                *np.transpose([1e3 * np.array(event.place_st) for event in chosen]),
                marker=marker,
                markersize=size,
                markerfacecolor=RED,
                markeredgecolor="white",
                zorder=6,
                linestyle="none",
                label=label,
            )
