"""Maps, scale and needs: what the charts tell is what theory and tables say."""

import numpy as np
import pytest

from benchmarks import charts
from benchmarks.charts import (
    _drapes,
    _maps,
    _sampled,
    maps,
    needs,
    scale,
    tool,
    verdict,
)
from benchmarks.charts._sampled import LINES
from benchmarks.charts.results import Results, read
from drapeplan import refine
from ply.fiber import length_error
from ply.grid import CupGrid
from ply.sampling import PlySampling

MM = 1e-3
STEP = 4.5 / 24  # [mm] of slack between cells of the released map
EDGE = 1e-9  # [m] edges of cups, as asked
GRID = CupGrid(rows=3, columns=2, pitch=0.11, half_width=0.02)


def released(name):
    return read(charts.RELEASED / f"chart-{name}")


def test_paper_fails_below_its_analytic_boundary():
    """Where c > 196 the root is complex, and elsewhere the paper has one."""
    rows = _maps.fiber(quick=True)
    edge = {row["x"]: row["y"] for row in rows if row.get("boundary") == "c = 196"}
    angles, slack = np.array(list(edge)), np.array(list(edge.values()))
    assert np.ptp(slack + slack[::-1]) > 1  # it is a curve
    seen = set()
    for row in (r for r in rows if "outcome" in r and abs(r["x"]) > 5 and r["y"] > 0):
        above = row["y"] > np.interp(row["x"], angles, slack)
        assert (row["outcome"] in ("all", "side")) == above
        seen.add(above)
    assert seen == {True, False}
    assert all(r["outcome"] == "none" for r in rows if "outcome" in r and r["y"] < 0)


def test_length_error_is_that_of_the_model():
    angle, chord = 0.3, np.array([0.97, 1.0])
    tangents = np.array([[np.cos(angle), 0, up * np.sin(angle)] for up in (1, -1)])
    ends = chord[:, None] * [_maps.L, 0, 0]
    model = length_error(ends, *tangents, _maps.L)
    assert _maps._length_error(chord, angle) == pytest.approx(model, abs=1e-12)


@pytest.mark.parametrize("slack", [-0.3 * MM, 0.0, 1 * MM])
def test_cups_on_a_sphere_leave_the_slack_asked_for(slack):
    p, R = _maps._on_sphere(0.8, slack)
    for (a, b), axis in (((0, 1), 0), ((2, 3), 0), ((0, 2), 1), ((1, 3), 1)):
        edges = p[b] - _maps.HALF * R[b, :, axis] - p[a] - _maps.HALF * R[a, :, axis]
        assert np.linalg.norm(edges) == pytest.approx(_maps.L - slack, abs=EDGE)
    assert np.allclose(np.linalg.norm(p, axis=1), 0.8)
    assert np.allclose(R.swapaxes(1, 2) @ R, np.eye(3))


def test_nets_end_above_the_equator():
    """No net where the middle column would pass it, one on a much larger sphere."""
    rows = [row for row in released("maps").rows if row["map"] == "net"]
    edge = [(r["x"], r["y"]) for r in rows if "boundary" in r]
    offset, radius = np.array(edge).T
    for row in (r for r in rows if "outcome" in r):
        least = np.interp(row["x"], offset, radius)
        assert row["outcome"] == "failed" or row["y"] > least
        assert row["outcome"] == "solved" or row["y"] < 2 * least


def test_sampling_lines_lie_on_cups_and_spans():
    own = _sampled.lines_over(GRID, 3, *LINES[10])
    assert own == pytest.approx(PlySampling.regular(GRID, 0.01, 0.02).t)
    assert np.diff(_sampled.lines_over(GRID, 3, *LINES[35])).max() == pytest.approx(
        0.04
    )


def test_constants_come_back():
    before, seen = refine.ROUNDS, []
    with _drapes.swapped(refine, ROUNDS=0):
        seen.append(refine.ROUNDS)
    assert (seen, refine.ROUNDS) == ([0], before)


def test_exponent_is_that_of_the_upper_half():
    sizes = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0]
    times = [7.0, 7.0, 7.0, *(n**1.5 for n in sizes[3:])]
    assert scale.exponent(sizes, times) == pytest.approx(1.5)


@pytest.mark.parametrize(
    "chart", [tool, verdict, scale, maps, needs], ids=lambda m: m.__name__
)
def test_released_tables_are_drawn(chart):
    figure = chart.draw(released(chart.__name__.rsplit(".", 1)[1]))
    assert all(axes.has_data() for axes in figure.axes)


def test_page_of_needs_is_that_of_the_table():
    page = (charts.ROOT / "docs" / "needs.md").read_text(encoding="utf-8")
    assert page.strip() == needs.page(released("needs")).strip()


def test_page_of_needs_tells_what_is_left_out():
    row = {"scene": "one", "tolerance_mm": 0.2, "cause": "droop", "estimated_mm": 0.01}
    found = needs.page(
        Results("needs", [row | {"modeled": False, "measured_mm": 3}], {})
    )
    assert "| the overhang droops | 0.01 | leaves it out | 3 |" in found
