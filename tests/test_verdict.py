"""The verdict's plain form."""

import json

import numpy as np
import pytest

from drapeplan.front import check_front
from drapeplan.verdict import Tolerance
from tests.front_samples import MM, growing_disk, make_grid, no_cups


def pocket_verdict():
    """A pocket, 2 mm high, and a dip beyond it; other poses without any threat."""
    grid = make_grid(start_cup=0)
    h = np.zeros((3, *grid.areas.shape))
    h[0] = 30 * MM
    h[1, 8, 8] = 2 * MM
    cups = no_cups(grid, 3)
    return check_front(h + 1e-4, 0 * h[0] + 1e-4, grid, cups, cups)


def test_units_are_in_the_keys():
    plain = pocket_verdict().to_dict()
    (event,) = plain["events"]
    assert event["kind"] == "air_pocket"
    assert event["pose"] == 1
    assert event["area_mm2"] == pytest.approx(100)
    assert event["volume_mm3"] == pytest.approx(200)
    assert event["depth_mm"] == pytest.approx(2)
    assert event["place_mm"] == [40.0, 40.0]
    assert plain["highest"] == {
        "value_mm": 0.1,
        "place_mm": plain["highest"]["place_mm"],
        "cup": [1, 2],
    }
    assert plain["per_pose"]["air_margin_mm"] == [None, pytest.approx(-0.5), None]
    assert plain["worst_premature"] is None
    assert plain["worst_air"]["pose"] == 1
    assert plain["tolerance"]["penetration_mm"] == 0.3


def test_plain_form_is_json_without_infinities_and_always_the_same():
    texts = {json.dumps(pocket_verdict().to_dict(), allow_nan=False) for _ in range(3)}
    assert len(texts) == 1
    assert "-0.0," not in texts.pop()


def test_plain_form_says_what_the_verdict_says():
    grid = make_grid()
    gap, placed, landing = growing_disk(grid)
    good = check_front(gap, 0 * gap[0], grid, placed, landing)
    assert good.to_dict()["passed"] is True
    plain = pocket_verdict().to_dict()
    assert (plain["passed"], plain["in_order"], plain["penetrates"]) == (
        False,
        False,
        False,
    )
    assert len(good.to_dict()["per_pose"]["contact_area"]) == len(gap)


def test_arrays_are_read_only():
    verdict = pocket_verdict()
    with pytest.raises(ValueError, match="read-only"):
        verdict.air_margin[0] = 1.0


def test_penetration_is_judged_by_the_verdicts_tolerance():
    grid = make_grid(start_cup=0)
    h = np.full((1, *grid.areas.shape), -0.4 * MM)
    cups = no_cups(grid, 1)
    for allowed, penetrates in ((0.3 * MM, True), (0.5 * MM, False)):
        tolerance = Tolerance(penetration=allowed)
        verdict = check_front(h, 0 * h[0], grid, cups, cups, tolerance)
        assert verdict.in_order
        assert verdict.penetrates == penetrates
        assert bool(verdict.events) == penetrates
