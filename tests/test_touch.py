"""How pads meet the mold: the toe-down of a cup right before it stands."""

from types import SimpleNamespace

import numpy as np
import pytest

from drapeplan.touch import judge_touch
from drapeplan.words import touch_sentence

ROWS, COLUMNS, N = 3, 3, 9
ROBOT = SimpleNamespace(
    rows=ROWS, columns=COLUMNS, n_cups=N, pitch=0.11, half_width=0.02
)
TOUCH = 0.5e-3


def about_y(angle):
    """Turn about t: lowers what lies along +s."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def track(order, leans):
    """Cups land in an order, each leaning about t by an angle in degrees before."""
    placed = np.zeros((len(order) + 1, N), bool)
    rotations = np.tile(np.eye(3), (len(order) + 1, N, 1, 1))
    for k, (cup, lean) in enumerate(zip(order, leans, strict=True)):
        placed[k + 1 :, cup] = True
        rotations[k, cup] = about_y(np.radians(lean))
    return SimpleNamespace(
        robot=ROBOT, placed=placed, poses=(np.zeros((*placed.shape, 3)), rotations)
    )


def test_toe_down_of_inner_and_border_cups():
    """Cup (1, 1) lands beside (1, 0), then border cup (1, 2); both lean outward."""
    facts = judge_touch(track([3, 4, 5], [9.0, 0.4, 1.0]), TOUCH)
    assert facts["inner_toe_down_deg"] == pytest.approx(0.4, abs=1e-6)
    assert facts["border_toe_down_deg"] == pytest.approx(1.0, abs=1e-6)
    assert facts["cup"] == [1, 2]
    assert facts["border"]
    assert facts["waypoint"] == 2
    assert facts["good"]
    assert facts["limit_deg"] == pytest.approx(np.degrees(3 * 0.5 / 70))


def test_toe_up_is_no_fault():
    """A cup that leans back lands heel first."""
    facts = judge_touch(track([3, 4], [0.0, -5.0]), TOUCH)
    assert facts["good"]
    assert facts["inner_toe_down_deg"] == 0


def test_too_much_toe_down_is_no_good():
    """Past three touch heights over a span the order is lost."""
    assert not judge_touch(track([3, 4], [0.0, 1.3]), TOUCH)["good"]
    assert judge_touch(track([3, 4], [0.0, 1.2]), TOUCH)["good"]


def test_the_side_decides_what_is_outward():
    """The same lean is toe-up for a cup on the other side."""
    facts = judge_touch(track([4, 3], [0.0, 3.0]), TOUCH)
    assert facts["border_toe_down_deg"] == 0


def test_a_cup_looked_at_too_high_is_no_good():
    """Toe-down far above the mold says nothing of how a cup lands."""
    drape = track([3, 4], [0.0, 0.0])
    drape.poses[0][1, 4] += [0.0, 0.0, 5e-3]
    facts = judge_touch(drape, TOUCH)
    assert facts["largest_fall_mm"] == pytest.approx(5.0)
    assert facts["fall_cup"] == [1, 1]
    assert not facts["good"]


def test_a_cup_that_jumps_onto_its_target_is_no_good():
    """It hangs beside its target right before it stands."""
    drape = track([3, 4], [0.0, 0.0])
    drape.poses[0][0, 3] += [3e-3, 4e-3, 0.0]
    facts = judge_touch(drape, TOUCH)
    assert facts["largest_slide_mm"] == pytest.approx(5.0)
    assert facts["slide_cup"] == [1, 0]
    assert facts["largest_fall_mm"] == pytest.approx(0.0)
    assert not facts["good"]


def test_the_landing_in_one_sentence():
    facts = judge_touch(track([3, 4, 5], [9.0, 0.4, 1.0]), TOUCH)
    words = touch_sentence(facts)
    assert "0.4 deg toe first inside, 1.0 at the rim, of 1.2" in words
    assert "slide up to 0.0 mm" in words
