"""What happens between waypoints: found, and told of the waypoint that follows."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from drapeplan.front import check_front
from drapeplan.refine import Stops, judge_between, on_waypoints
from drapeplan.verdict import EventKind, Tolerance
from tests.front_samples import MM, box, growing_disk, make_grid

ROUNDING = 1e-12  # [m], [-] float64 noise at ply scale
HIGH = 30 * MM  # [m] a ply far above the mold
GRID = make_grid()
FLAT = 0.0 * GRID.areas
POSES = 8


def straight(poses=POSES, down=()):
    """Waypoints of cups that fall by 10 mm each; those in `down` land, the last in all.

    The start cup is placed all the time.
    """
    n = len(GRID.cup_centers)
    positions = np.zeros((poses, n, 3))
    positions[..., :2] = GRID.cup_centers
    positions[..., 2] = 10 * MM * np.arange(poses)[::-1, None]
    rotations = np.tile(np.eye(3), (poses, n, 1, 1))
    placed, landing = np.zeros((2, poses, n), bool)
    placed[:, GRID.start_cup] = True
    landing[list(down), 11] = True
    return Stops.at_waypoints((positions, rotations), placed, landing)


def judged(waypoints, gap_at):
    """Verdict where gap_at(time) gives the gaps, and the times that were asked for."""
    asked = []

    def gaps_of(stops, new):
        asked.extend(stops.time[new])
        return gap_at(stops.time[new])

    gap, tolerance = gap_at(waypoints.time), Tolerance()
    return judge_between(waypoints, gap, FLAT, GRID, tolerance, gaps_of), asked


def island(time, middle, margin, bend=10 * MM):
    """Gaps of a ply whose far corner comes down to a margin at a time, and goes up.

    Its height is quadratic in time, with bend in [m] a squared interval.
    """
    time = np.asarray(time)[:, None, None]
    low = Tolerance().touch + margin + bend * (time - middle) ** 2
    far = box(GRID, (0.3, 0.34), (0.2, 0.24))
    return np.where(GRID.start_pad, 0.0, np.where(far, np.minimum(low, HIGH), HIGH))


def test_cups_go_straight_and_turn_evenly():
    waypoints = straight()
    turn = Rotation.from_rotvec([0.02, -0.03, 0.04])
    waypoints.rotations[4:] = turn.as_matrix()
    made = waypoints.between(np.array([3.25, 3.5]))
    assert_allclose(made.positions[:, 0, 2], [37.5 * MM, 35 * MM], atol=ROUNDING)
    found = Rotation.from_matrix(made.rotations[:, 5]).as_rotvec()
    assert_allclose(found, np.outer([0.25, 0.5], turn.as_rotvec()), atol=ROUNDING)


def test_cups_land_until_they_are_placed_on_both_sides():
    waypoints = straight(down=[2])
    waypoints.placed[3:, 11] = True
    made = waypoints.between(np.array([1.5, 2.5, 3.5]))
    assert_array_equal(made.landing[:, 11], [True, True, False])
    assert_array_equal(made.placed[:, 11], [False, False, True])
    assert made.placed[:, GRID.start_cup].all()
    assert not made.landing[:, GRID.start_cup].any()


def test_a_contact_between_waypoints_is_premature_by_the_one_that_follows():
    waypoints = straight(down=[3, 4])
    verdict, asked = judged(waypoints, lambda time: island(time, 3.5, -0.3 * MM))
    assert [event.kind for event in verdict.events] == [EventKind.PREMATURE]
    assert verdict.events[0].pose == 4
    assert verdict.worst_premature.pose == 4
    assert_array_equal(np.flatnonzero(verdict.premature_margin <= 0), [4])
    assert verdict.poses_between == len(asked) > 0
    assert len(verdict.premature_margin) == POSES
    far = box(GRID, (0.3, 0.34), (0.2, 0.24))
    assert ((verdict.first_touch[far] > 3) & (verdict.first_touch[far] < 4)).all()
    alone = check_front(
        island(waypoints.time, 3.5, -0.3 * MM),
        FLAT,
        GRID,
        waypoints.placed,
        waypoints.landing,
    )
    assert alone.in_order  # at the waypoints nothing is to be seen


@settings(max_examples=60, deadline=None)
@given(
    middle=st.floats(2.0, 5.0),
    bend=st.floats(0.1, 8.0),
    margin=st.floats(0.1, 0.6),
    wrong=st.booleans(),
)
def test_faults_between_waypoints_are_found(middle, bend, margin, wrong):
    """Whatever comes down to a tenth of a millimeter beyond touch, and no other."""
    waypoints = straight(down=[3, 4, 5])
    margin = -margin * MM if wrong else margin * MM
    verdict, _ = judged(waypoints, lambda t: island(t, middle, margin, bend * MM))
    assert verdict.in_order != wrong
    assert verdict.premature_margin.min() >= margin - ROUNDING


def test_the_way_left_falls_in_equal_ratios():
    """A cup that lands is looked at closer to the mold than to where it comes from."""
    waypoints = straight(down=[6])
    waypoints.landing[7, 11] = True
    _, asked = judged(waypoints, lambda time: island(time, 20, MM))
    assert len(asked) == 2
    left = 10 * MM * (7 - np.array(asked))
    touch = Tolerance().touch
    ends = np.array([[20, 10], [10, 0]]) * MM + touch
    assert_allclose((left + touch) ** 2, ends.prod(axis=1), rtol=1e-9)


def test_an_orderly_path_stays_as_it_is():
    gap, placed, landing = growing_disk(GRID)
    verdict = check_front(gap, FLAT, GRID, placed, landing)
    same = on_waypoints(verdict, np.arange(len(gap), dtype=float))
    assert same.to_dict() == verdict.to_dict()
    assert_array_equal(same.first_touch, verdict.first_touch)


def test_stops_between_count_for_the_waypoint_that_follows():
    gap, placed, landing = growing_disk(GRID)
    verdict = check_front(gap, FLAT, GRID, placed, landing)
    time = np.arange(40) / 3.0  # every third is a waypoint
    few = on_waypoints(verdict, time)
    assert few.poses_between == 26
    margins = verdict.premature_margin
    wanted = [margins[0], *(margins[k : k + 3].min() for k in range(1, 40, 3))]
    assert_array_equal(few.premature_margin, wanted)
    assert_array_equal(few.contact_area, verdict.contact_area[::3])
    touched = np.isfinite(verdict.first_touch)
    assert_allclose(few.first_touch[touched], verdict.first_touch[touched] / 3)
    assert_array_equal(touched, np.isfinite(few.first_touch))
