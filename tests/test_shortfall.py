"""Shortfall: zero for a good plan, and more the further a plan is from good."""

import copy

import pytest

from drapeplan.shortfall import MOST, shortfall
from tests.settled import small_panel

GOOD = small_panel().plan.verdict


def spoiled(change):
    """The shortfall of a good verdict with something changed."""
    verdict = copy.deepcopy(GOOD)
    change(verdict)
    return shortfall(verdict)


def test_a_good_plan_is_short_of_nothing():
    assert GOOD["good"]
    assert shortfall(GOOD) == {}


def slide(by):
    def change(verdict):
        limit = verdict["touch"]["slide_limit_mm"]
        verdict["touch"] |= {"good": False, "largest_slide_mm": by * limit}

    return change


def depth(by):
    def change(verdict):
        verdict["front"]["penetrates"] = True
        allowed = verdict["front"]["tolerance"]["penetration_mm"]
        verdict["steps"][2]["span_penetration_mm"] = by * allowed

    return change


def margin(by):
    def change(verdict):
        verdict["front"]["in_order"] = False
        verdict["steps"][1]["air_margin_mm"] = -by * 0.5

    return change


@pytest.mark.parametrize(
    ("kind", "name"), [(slide, "touch"), (depth, "penetration"), (margin, "order")]
)
def test_further_off_is_worse(kind, name):
    near, far, absurd = (spoiled(kind(by)) for by in (1.2, 2.5, 1e6))
    assert set(near) == {name}
    assert 1 < near[name] < far[name] < absurd[name] == 1 + MOST
    assert near[name] == pytest.approx(1.2)


def test_what_has_no_size_counts_as_one():
    assert spoiled(lambda v: v["arm"].update(good=False)) == {"arm": 1.0}
    assert spoiled(lambda v: v["front"].update(starts_free=False)) == {"starts_free": 1}
