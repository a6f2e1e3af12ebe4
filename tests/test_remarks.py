"""What a verdict says beside the order of contact: the same on terminal and page."""

import copy

import pytest

from drapeplan.console import show_verdict
from drapeplan.remarks import Remark, remarks
from tests.spoiled import good_plan

pytestmark = pytest.mark.xdist_group("spoiled")  # one worker makes the plan


@pytest.fixture
def verdict():
    return copy.deepcopy(good_plan().verdict)


def warnings(verdict):
    return [one.text for one in remarks(verdict) if one.warns]


def test_the_terminal_prints_them_all(verdict, capsys):
    show_verdict(verdict, [], as_json=False)
    printed = capsys.readouterr().out
    assert all(f"  {one.text}\n" in printed for one in remarks(verdict))
    assert "Pads land" in printed


def test_an_overloaded_arm_is_warned_of(verdict):
    load = {"tool_kg": 20.0, "ply_kg": 0.5, "payload_kg": 10.0, "exceeded": True}
    verdict["arm"]["payload"] = load
    weight = "Warning: tool and ply weigh 20.5 kg, the arm may carry 10 kg."
    assert weight in warnings(verdict)
    verdict["arm"]["payload"] = {**load, "payload_kg": 60.0, "exceeded": False}
    assert not any("weigh" in one.text for one in remarks(verdict))


def test_an_arm_that_was_not_looked_at_is_warned_of(verdict):
    load = verdict["arm"]["payload"]
    verdict["arm"] = {"checked": False, "problem": "no shape", "payload": load}
    assert "clearance not checked" in warnings(verdict)[0]
    verdict["arm"] = {"checked": False, "problem": "there is none"}  # by wish
    assert not warnings(verdict)


def test_the_arms_sentence_is_of_its_nearest_waypoint(verdict):
    (arm,) = [one for one in remarks(verdict) if one.text.startswith("Arm: ")]
    assert arm.waypoint == verdict["arm"]["waypoint"]


def test_coupled_patches_beyond_the_tolerance_are_warned_of(verdict):
    facts = verdict["ply_model"]
    patch = {"patch": [1, 0], "waypoint": 7, "largest_mm": 1.0}
    (effect,) = [one for one in facts["effects"] if one["cause"] == "coupling"]
    effect |= {"patch": [1, 0], "size_mm": 0.9, "waypoint": 7}
    for size, warned in ((0.1, False), (0.4, True), (None, True)):
        facts["coupled"] = [{**patch, "measured_mm": size}]
        (told,) = [one for one in remarks(verdict) if "hold each other" in one.text]
        assert told == Remark(told.text, warned, 7)
        assert ("read the margins against it" in told.text) == warned
