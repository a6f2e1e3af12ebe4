"""The chart of the engine, on work that does nothing but wait."""

import time
from dataclasses import dataclass

import pytest

from benchmarks import charts
from benchmarks.charts import engine
from benchmarks.charts.results import read

WORK = 0.01  # [s] of an item


@dataclass(frozen=True)
class Wait:
    """Takes its time and says how much."""

    def __call__(self, _):
        start = time.perf_counter()
        time.sleep(WORK)
        return time.perf_counter() - start


def test_two_workers_do_more_and_what_is_no_work_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(engine, "_samples", lambda quick: Wait())
    rates = [{"set": "rate", "method": name, "per_s": 9.0} for name in engine.RATES]
    monkeypatch.setattr(engine, "_rates", lambda task, quick: rates)
    files = charts.make("engine", tmp_path, quick=True)
    results = read(tmp_path / "chart-engine")
    assert results.made["took_s"] >= 0
    (here,) = results.where(method=engine.HERE)
    two = results.where(method=engine.PROCESSES)
    assert here["overhead"] < 0.2
    assert [row["batch"] for row in two] == sorted(row["batch"] for row in two)
    assert two[0]["batch"] == 1
    for row in (here, *two):  # workers = throughput x work / share of it
        workers = 1 if row is here else engine.WORKERS
        share = row["samples_per_s"] * WORK / workers
        assert 0.99 * share < 1 - row["overhead"] < 2 * share  # waits last longer
    (memory,) = results.where(set="memory")
    assert 20 < memory["peak_MB"] < 4000
    assert engine.DASK in files[-1].read_text()


def test_a_chart_that_fails_stops_no_other(tmp_path, monkeypatch, capsys):
    def make(name, *_):
        if name == "one":
            raise RuntimeError("a fault")
        return [name]

    monkeypatch.setattr(charts, "CHARTS", ("one", "two"))
    monkeypatch.setattr(charts, "make", make)
    assert charts.main(["--quick", "-o", str(tmp_path)]) == 1
    told = capsys.readouterr()
    assert told.out == "two\n"
    assert "failed: chart one" in told.err
    with pytest.raises(RuntimeError, match="a fault"):
        charts.main(["one", "-o", str(tmp_path)])
