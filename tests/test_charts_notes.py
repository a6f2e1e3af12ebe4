"""Notes of charts: beside their points, hiding neither each other nor the points."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from benchmarks import charts
from benchmarks.charts import _notes, drawing

NAMES = ("ply", "verdict")  # those with the most notes
HIDDEN = 1.0  # [px] boxes of texts may overlap by their empty rims


def settled(draw):
    """A figure as it is saved."""
    with drawing.matplotlib.rc_context(drawing.STYLE):
        figure = draw()
        drawing.finish(figure)
    return figure


def boxes(figure):
    renderer = figure._get_renderer()
    for axes in figure.axes:
        texts = [t for t in axes.texts if t.get_text() and axes.get_visible()]
        yield axes, [Text.get_window_extent(text, renderer) for text in texts]


def overlap(a, b):
    return min(a.x1 - b.x0, b.x1 - a.x0, a.y1 - b.y0, b.y1 - a.y0)


@pytest.mark.parametrize("name", NAMES)
def test_no_text_of_a_released_chart_hides_another(name):
    chart = charts.importlib.import_module(f"benchmarks.charts.{name}")
    results = charts.read(charts.RELEASED / f"chart-{name}")
    for _, texts in boxes(settled(lambda: chart.draw(results))):
        assert all(overlap(a, b) < HIDDEN for a, b in combinations(texts, 2))


def test_notes_of_points_that_lie_close_part():
    def draw():
        figure = Figure(layout="constrained")
        axes = figure.subplots()
        drawing.log_log(axes, "", "x", "y")
        x = [1, 1.001, 1.002, 1.003, 9]
        drawing.scatter(axes, x, x, "a", 0, notes=["one", "two", "three", "four", "5"])
        return figure

    figure = settled(draw)
    (axes, texts), *_ = boxes(figure)
    assert all(overlap(a, b) < 0 for a, b in combinations(texts, 2))
    frame = axes.get_window_extent()
    for text, note in zip(texts, axes.texts, strict=True):
        assert frame.contains(text.x0, text.y0)
        assert frame.contains(text.x1, text.y1)
        at = axes.transData.transform(note.xy)
        away = np.maximum([text.x0, text.y0] - at, at - [text.x1, text.y1]).max()
        assert 0 < away < 1.1 * _notes.REACH[-1] * figure.dpi / _notes.PIXELS
