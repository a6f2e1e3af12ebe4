"""Two runs of the charts: speed cancels, what moves among its like is told."""

import pytest

from benchmarks import charts
from benchmarks.charts._compare import moves
from benchmarks.charts.results import Results

TIMES = {"a": 1.0, "b": 2.0, "c": 8.0}


def chart(times, rates=()):
    rows = [{"set": "s", "method": m, "wave_ms": x, "n": 3} for m, x in times.items()]
    rows += [{"set": "r", "method": m, "per_s": x} for m, x in dict(rates).items()]
    return Results("one", rows, {"quick": True})


def test_the_speed_of_a_machine_cancels():
    slower = {name: 3 * x for name, x in TIMES.items()}
    found = moves(chart(TIMES, {"a": 10.0, "b": 20.0}), chart(slower, {"a": 5.0}))
    assert len(found) == 4
    assert all(move.size == pytest.approx(0) for move in found)


def test_a_time_that_moves_is_told_first():
    """Of three times one that doubles moves by 2 ^ (2 / 3) against their mean."""
    found = moves(chart(TIMES), chart({**TIMES, "b": 4.0}))
    assert found[0].name == "b, wave_ms"
    assert found[0].factor == pytest.approx(2 ** (2 / 3))
    assert found[1].factor == pytest.approx(2 ** (-1 / 3))
    rates = moves(chart({}, {"a": 1.0, "b": 1.0}), chart({}, {"a": 1.0, "b": 4.0}))
    assert {move.name: move.factor for move in rates} == {
        "a, per_s": pytest.approx(2.0),  # against their mean a takes longer
        "b, per_s": pytest.approx(0.5),
    }


@pytest.mark.parametrize(("factor", "code"), [(1.2, 0), (2.0, 1)])
def test_the_command_fails_where_a_ratio_moved(
    tmp_path, monkeypatch, capsys, factor, code
):
    chart(TIMES).write(tmp_path / "old" / "chart-one")
    moved = {**TIMES, "c": factor * TIMES["c"], "d": 1.0}
    chart(moved).write(tmp_path / "new" / "chart-one")
    folders = [str(tmp_path / name) for name in ("old", "new")]
    monkeypatch.setattr(charts, "CHARTS", ("one", "two"))
    assert charts.main(["--compare", *folders]) == code
    said = capsys.readouterr().out
    assert "c, wave_ms" in said
    assert ("beyond" in said) == bool(code)
    assert "1 times stand in one of the two alone" in said
    assert "two: not in" in said
