"""Length gate: which fibers, when, for how long, and what comes of it."""

from types import SimpleNamespace

import numpy as np
import pytest

from drapeplan.length_gate import judge_lengths
from drapeplan.words import _fiber_lines
from ply.fiber import LengthStatus
from tests.settled import small

BAND = 0.8  # [mm] the take-up of a scene, by default
WHEN = ("waypoint", "last_waypoint", "worst_waypoint")
ROUNDED = 1e-6  # [mm] decimals of a verdict


def gate(**asked):
    """The gate, where cups ask for so much more than the fibers have, in [mm].

    Args:
        asked: By family, for its first fiber and its last, a number for each waypoint.
    """
    made = small("dome")
    L, count = made.cell.sampling.grid.span, len(next(iter(asked.values()))[0])
    change = {"s": np.zeros((count, 4, 2, 2)), "t": np.zeros((count, 3, 3, 2))}
    for family, (first, last) in asked.items():
        change[family][:, 0, 0, 0] = first
        change[family][:, -1, -1, -1] = last
    band = {
        family: np.select(
            [off > BAND, off < -BAND],
            [LengthStatus.TOO_SHORT, LengthStatus.SLACK],
            LengthStatus.IN_BAND,
        )
        for family, off in change.items()
    }
    fibers = SimpleNamespace(
        s_natural=L + 1e-3 * change["s"],
        t_natural=L + 1e-3 * change["t"],
        s_band=band["s"],
        t_band=band["t"],
    )
    track = made.track(made.motion)
    return judge_lengths(made.cell, track, fibers), track


def test_a_fiber_is_told_with_its_cups_its_moments_and_its_bow():
    """Slack first, within the band between, too short at last."""
    off = [0.0, -1.3, -0.9, 0.0, 1.1, 0.0]
    found, track = gate(s=(off, 0.0 * np.array(off)))
    (one,) = found["infeasible"]
    assert not found["good"]
    assert one["cups"] == [[0, 0], [0, 1]]
    assert one["fiber"] == "s fiber (0, 0)-(0, 1), -20 mm"
    assert [one[key] for key in WHEN] == [1, 4, 1]
    lasts = np.diff(track.time)[[1, 2, 4]].sum()
    assert one["duration_s"] == pytest.approx(lasts, abs=1e-8)
    bow = 2 / np.pi * np.sqrt(70 * 0.5)
    assert one["bubble_mm"] == pytest.approx(bow, abs=ROUNDED)
    assert one["short_mm"] == pytest.approx(0.3, abs=ROUNDED)


def test_the_worst_comes_first():
    found, _ = gate(s=([1.0, 0.0], [0.9, 0.0]), t=([0.0, -1.2], [0.0, 1.1]))
    needs = [max(x["need_mm"], x["surplus_mm"]) for x in found["infeasible"]]
    assert needs == pytest.approx([1.2, 1.1, 1.0, 0.9], abs=ROUNDED)
    assert found["infeasible_count"] == 4
    assert found["infeasible"][1]["fiber"] == "t fiber (2, 2)-(3, 2), +20 mm"
    assert found["infeasible"][1]["bubble_mm"] == 0.0


def test_within_the_take_up_all_is_well():
    found, _ = gate(t=([0.7, -0.7], [0.0, 0.79]))
    assert found["good"]
    assert (found["infeasible"], found["infeasible_count"]) == ([], 0)
    assert _fiber_lines(found, ["Start", "End"]) == []


@pytest.mark.parametrize(
    ("off", "said"),
    [
        (1.1, "1.10 mm too short at its worst (end): it holds its cups back, or slips"),
        (-1.3, "1.30 mm too long at its worst (end): it would bow 3.8 mm off the mold"),
    ],
)
def test_words_say_what_comes_of_it_and_what_to_change(off, said):
    found, _ = gate(t=([0.0, off], [0.0, 0.0]))
    found["infeasible"][0]["duration_s"] = 0.0
    (line,) = _fiber_lines(found, ["Start", "End"])
    assert line.startswith("Length-infeasible: 1 fiber leaves the take-up of 0.8 mm")
    assert "t fiber (0, 0)-(1, 0), -20 mm, is " + said in line
    assert f"A weave that takes up {abs(off):g} mm" in line
