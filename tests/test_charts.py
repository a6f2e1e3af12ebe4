"""Charts: figures come back as they were written, and drawings repeat."""

import csv
import gc
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from benchmarks import _timing, charts
from benchmarks.charts import drawing
from benchmarks.charts.results import Results, made_with, read

MADE = {
    "processor": "one of a kind",
    "cores": 2,
    "python": "3.13",
    "versions": "numpy 2",
    "date": "2026-11-22",
    "seed": 0,
    "quick": True,
}
ROWS = [{"method": "a", "time_ms": 1 / 3, "rms_mm": 2e-3}, {"method": "b", "n": 4}]
RESULTS = Results("made up", ROWS, MADE, {"peer": "not installed"})


def draw(results):
    figure = Figure(layout="constrained")
    axes = figure.subplots()
    drawing.log_log(axes, "title", "time [ms]", "error [mm]")
    drawing.scatter(axes, [1, 2], [2, 1], "a method", 0, joined=True, notes=["x", "y"])
    drawing.front(axes, [1, 2], [2, 1])
    drawing.legend(figure)
    return figure


def test_results_come_back_as_written(tmp_path):
    table, document = RESULTS.write(tmp_path / "new" / "chart-a")
    rows = list(csv.DictReader(table.open()))
    assert rows[0] == {"method": "a", "time_ms": "0.333333", "rms_mm": "0.002", "n": ""}
    found = read(tmp_path / "new" / "chart-a")
    assert found.missing == RESULTS.missing
    assert found.made == MADE
    assert found.where(method="b") == [{"method": "b", "n": 4}]
    assert json.loads(document.read_text())["rows"][0]["time_ms"] == 0.333333


def test_nan_is_no_figure(tmp_path):
    with pytest.raises(ValueError, match="JSON"):
        Results("x", [{"a": np.nan}], MADE).write(tmp_path / "chart-x")


def test_figures_say_what_they_were_made_with():
    made = made_with("matplotlib", "no-such-package", quick=False)
    assert made["processor"]
    assert "matplotlib 3" in made["versions"]
    assert "no-such-package" not in made["versions"]
    text = drawing.provenance(RESULTS)
    for part in ("one of a kind", "2026-11-22", "quick run", "peer: not installed"):
        assert part in text


def test_drawings_repeat_to_the_byte(tmp_path):
    first = drawing.save(draw, RESULTS, tmp_path / "one")
    second = drawing.save(draw, RESULTS, tmp_path / "two")
    assert [file.suffix for file in first] == [".png", ".svg"]
    for a, b in zip(first, second, strict=True):
        assert a.read_bytes() == b.read_bytes()
    assert "not installed" in first[1].read_text()


def test_looks_of_methods_differ():
    looks = [tuple(drawing.look(n).values()) for n in range(20)]
    assert len(set(looks)) == 20


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=1))
def test_front_holds_what_no_other_beats(points):
    x, y = np.array(points).T
    found = drawing.pareto(x, y)
    beaten = [any((x <= a) & (y <= b) & ((x < a) | (y < b))) for a, b in points]
    assert {points[k] for k in found} == {
        p for p, lost in zip(points, beaten, strict=True) if not lost
    }
    assert (np.diff(x[found]) > 0).all()


def test_tasks_take_turns():
    order = []
    tasks = {name: lambda name=name: order.append(name) for name in "ab"}
    assert list(_timing.interleaved(tasks, 1)) == ["a", "b"]
    assert "".join(order) == "abab"
    _timing.interleaved(tasks, 2)  # so short that more turns are taken
    assert "".join(order[4:10]) == "ababba"
    assert len(order) == 4 + 2 * (1 + _timing.MOST)
    assert gc.isenabled()


def test_least_time_counts(monkeypatch):
    spent = iter([9.0, 3.0, 2.0, 4.0])
    monkeypatch.setattr(_timing, "seconds", lambda task: next(spent))
    assert _timing.interleaved({"a": lambda: None}, 4) == {"a": 2.0}


def test_quick_charts_replace_no_released_ones(tmp_path, monkeypatch):
    folders = []
    monkeypatch.setattr(charts, "CHARTS", ("one",))
    monkeypatch.setattr(charts, "make", lambda _, f, *rest: folders.append(f) or [])
    for arguments in (["--quick"], ["--full"], ["-o", str(tmp_path), "--quick"]):
        assert charts.main(arguments) == 0
    assert folders == [charts.TRIED, charts.RELEASED, tmp_path]
