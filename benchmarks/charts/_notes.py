"""Notes beside points, moved to where they hide neither each other nor the points."""

from collections.abc import Iterator
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text
from matplotlib.transforms import Bbox

NOTE = "note"  # mark of texts that may be moved
SIZE, GRAY = 6.5, "#595959"  # [pt], and 7 : 1 on white
REACH = (5.0, 9.0, 15.0, 23.0, 33.0)  # [pt] from a point to its note
SIDES = ((1, 1), (1, 0), (1, -1), (-1, 1), (-1, 0), (-1, -1), (0, 1), (0, -1))
NEAR = 10.0  # [pt] beyond, a line leads to the note
HALF = 4.0  # [pt] half a marker
STEP = 3.0  # [pt] between the places of a line that are looked at
TEXT, POINT, LINE, OUTSIDE = 60.0, 20.0, 1.0, 1e3  # cost of what a note hides
PIXELS = 72.0  # [pt/in]


def note(axes: Axes, x: float, y: float, text: str) -> None:
    """A few words beside a point, in data coordinates; `spread` finds their place."""
    arrow = {"arrowstyle": "-", "color": GRAY, "linewidth": 0.5}
    made = axes.annotate(
        text,
        (x, y),
        (REACH[0], 0),
        textcoords="offset points",
        fontsize=SIZE,
        color=GRAY,
        arrowprops=arrow | {"shrinkA": 0.0, "shrinkB": HALF},
        gid=NOTE,
    )
    made.set_in_layout(False)


def spread(figure: Figure) -> None:
    """Move the notes of all panels; everything else must stand where it will."""
    figure.draw_without_rendering()
    renderer = figure._get_renderer()
    for axes in figure.axes:
        notes = [text for text in axes.texts if text.get_gid() == NOTE]
        if notes and axes.get_visible():
            _spread(axes, notes, renderer)


def _spread(axes: Axes, notes: list[Annotation], renderer: RendererBase) -> None:
    scale = axes.figure.dpi / PIXELS
    points, lines = _drawn(axes, STEP * scale)
    others = [text for text in axes.texts if text not in notes and text.get_text()]
    taken = [text.get_window_extent(renderer) for text in others]
    if axes.get_legend():
        taken.append(axes.get_legend().get_window_extent(renderer))
    inside = axes.get_window_extent(renderer)
    for each in notes:
        x, y = axes.transData.transform(each.xy)
        size = Text.get_window_extent(each, renderer)  # without its line
        best = np.inf
        for place, box in _places(x, y, size.width, size.height, scale):
            hidden = sum(box.overlaps(other) for other in taken)
            near = np.abs(points - [(box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2])
            half = np.array([box.width, box.height]) / 2 + HALF * scale
            cost = TEXT * hidden + POINT * (near < half).all(axis=1).sum()
            cost += LINE * box.count_contains(lines)
            cost += OUTSIDE * (box.x0 < inside.x0 or box.x1 > inside.x1)
            cost += OUTSIDE * (box.y0 < inside.y0 or box.y1 > inside.y1)
            cost += place[0]
            if cost < best:
                best, chosen, kept = cost, place, box
        taken.append(kept)
        _put(each, *chosen)


def _put(each: Annotation, reach: float, a: int, b: int) -> None:
    each.set(
        ha={1: "left", 0: "center", -1: "right"}[a],
        va={1: "bottom", 0: "center", -1: "top"}[b],
    )
    each.xyann = reach * a, reach * b * (0.6 if a else 1.0)
    each.arrow_patch.set_visible(reach > NEAR)


def _places(
    x: float, y: float, width: float, height: float, scale: float
) -> Iterator[tuple[tuple[float, int, int], Bbox]]:
    """Places of a note around a point, the nearest first, with their boxes, in px."""
    for reach, (a, b) in product(REACH, SIDES):
        left = x + scale * reach * a + (a - 1) / 2 * width
        low = y + scale * reach * b * (0.6 if a else 1.0) + (b - 1) / 2 * height
        yield (reach, a, b), Bbox.from_bounds(left, low, width, height)


def _drawn(axes: Axes, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Markers and places along the lines of a panel, shapes (m, 2), in px."""
    points, places = [np.empty((0, 2))], [np.empty((0, 2))]
    for line in axes.lines:
        path = line.get_path()
        corners = line.get_transform().transform(path.vertices)
        if line.get_marker() not in ("None", "", " ", None):
            points.append(corners)
        if line.get_linestyle() != "None" and len(corners) > 1:
            along = np.append(0.0, np.hypot(*np.diff(corners, axis=0).T).cumsum())
            at = np.arange(0.0, along[-1], step)
            places.append(
                np.column_stack([np.interp(at, along, axis) for axis in corners.T])
            )
    return np.concatenate(points), np.concatenate(places)
