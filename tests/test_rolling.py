"""Rolling: samples without errors are the plan; with errors they do what they must."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from drapeplan.contact import FAR, HIGH
from drapeplan.frames import inverse, moved
from drapeplan.front import check_front
from drapeplan.held_ply import held_fibers, held_points
from drapeplan.noise import Spread, draw
from drapeplan.refine import Stops
from drapeplan.robustness import make_course
from drapeplan.rolling import CAP, disturbed, roll
from tests.courses import wave_plan

EXACT = 1e-12  # [m] of the same numbers computed in another order
LINKED = 1e-9  # [m] error of a link
SEEN = 1e-5  # [m] table of heights, and slopes of a mold that is moved


@pytest.fixture(scope="module")
def flat():
    return make_course(wave_plan(), Spread())


@pytest.fixture(scope="module")
def steep():
    """Fibers beyond a small take-up: the ply bulges."""
    return make_course(wave_plan("steep", 0.1), Spread())


def sample(course, index=0):
    poses, cups = course.rests.fixed.shape
    return draw(0, index, cups, poses)


def at_stops(plan, course):
    """The front check on the plan's own gaps, at waypoints and where cups land."""
    contact, track = plan.judged[1], plan.track
    cups = track.placed[track.held], track.landing[track.held]
    to_mold = inverse(plan.cell.world_mold)
    poses = moved(to_mold, *(pose[track.held] for pose in track.poses))
    stops = Stops.at_waypoints(poses, *cups)
    first = len(stops.time) - len(course.rests.fixed)
    stops = stops.joined(stops.between(course.landings + first))[0]
    fibers = held_fibers(plan.cell, *stops.poses, course.model)
    points = held_points(plan.cell, fibers, *stops.poses, course.model)
    gap = plan.cell.mold.gap(points, beside=FAR)
    final = np.where(contact.beside, 0.0, contact.gap[-1])
    gap = np.where(contact.beside, HIGH, np.minimum(gap, HIGH))
    cups = stops.placed, stops.landing
    return check_front(gap, final, course.grid, *cups, course.tolerance)


@pytest.mark.parametrize(("kind", "take_up"), [("flat", 0.4), ("steep", 0.1)])
def test_without_errors_it_is_the_plan(kind, take_up):
    plan = wave_plan(kind, take_up)
    course = make_course(plan, Spread())
    assert course.model.name == ("cubic" if kind == "flat" else "modal")
    found = roll(course, sample(course), Spread())
    assert len(course.landings) == 3 * (course.steps - 1)  # the start stands already
    front = at_stops(plan, course)
    for margins, planned in (
        (found.premature, front.premature_margin),
        (found.air, front.air_margin),
    ):
        least = planned.min() if planned.min() < CAP else np.inf
        assert margins.min() == pytest.approx(least, EXACT)
    spans, pads = front.span_penetration.max(), front.pad_penetration.max()
    assert found.span_press == pytest.approx(spans, abs=EXACT)
    assert found.pad_press == pytest.approx(pads, abs=EXACT)
    assert found.stable


def test_errors_keep_links_and_placed_cups(steep):
    planned, fixed = steep.rests.poses, steep.rests.fixed
    spread = Spread(position=3e-4, angle=0.01, tilt=0.01)
    (positions, rotations), error = disturbed(steep, planned, sample(steep), spread)
    points = wave_plan("steep", 0.1).cell.robot.tool.interlinks.pairs
    length = np.linalg.norm(
        positions[:, points[:, 1]] - positions[:, points[:, 0]], axis=-1
    )
    live = ~fixed[:, points].all(axis=-1)
    assert_allclose(length[live], 0.11, atol=LINKED)
    assert error <= LINKED
    assert_array_equal(positions[fixed], planned[0][fixed])
    assert_array_equal(rotations[fixed], planned[1][fixed])
    assert np.abs(positions - planned[0]).max() > 1e-4


def test_errors_that_break_links_are_far_worse(flat):
    """Nearly all samples go wrong on a flat mold, where kept links spoil none."""
    loose = replace(flat, keeper=None)
    spread = Spread(position=3e-4)
    kept = [roll(flat, sample(flat, k), spread).wrong for k in range(10)]
    broken = [roll(loose, sample(loose, k), spread).wrong for k in range(10)]
    assert sum(kept) <= 1
    assert sum(broken) >= 7


def test_more_noise_does_more_harm(flat):
    """Common random numbers: the same samples, larger."""
    counts, press = [], []
    for size in (0.3, 1.0, 4.0):
        spread = Spread(position=size * 3e-4, angle=size * np.radians(0.5))
        found = [roll(flat, sample(flat, k), spread) for k in range(8)]
        counts.append(sum(one.wrong for one in found))
        press.append(np.median([one.span_press for one in found]))
    assert counts == sorted(counts)
    assert counts[-1] > counts[0]
    assert press == sorted(press)


def test_a_mold_that_stands_high_presses_into_the_pads(flat):
    """Flat, so that pads and spans feel the height alone."""
    one = replace(sample(flat), registration=np.array([0.0, 0.0, 1.0, 0.0]))
    higher, lower = (
        roll(
            flat,
            replace(one, registration=sign * one.registration),
            Spread(mold_z=4e-4),
        )
        for sign in (1, -1)
    )
    planned = roll(flat, one, Spread())
    assert higher.pad_press == pytest.approx(planned.pad_press + 4e-4, abs=SEEN)
    assert higher.span_press > planned.span_press + 3e-4
    assert lower.span_press <= planned.span_press


def test_moving_a_flat_mold_along_itself_changes_nothing(flat):
    one = replace(sample(flat), registration=np.array([1.0, -1.0, 0.0, 1.0]))
    moved = roll(flat, one, Spread(mold_xy=5e-4, mold_yaw=1e-3))
    planned = roll(flat, one, Spread())
    assert moved.span_press == pytest.approx(planned.span_press, abs=EXACT)
    assert moved.margin == pytest.approx(planned.margin, abs=EXACT)


def test_less_take_up_bulges_more(steep):
    """Slack that the weave does not take up becomes a bubble."""
    one = replace(sample(steep), take_up=1.0)
    more, less = (
        roll(steep, replace(one, take_up=x), Spread(take_up=0.9)) for x in (1.0, -1.0)
    )
    assert more.margin > less.margin


def test_a_tool_without_rest_is_wrong(flat):
    class Fallen:
        def poses(self, planned, spreads):
            return None

    lost = replace(flat, table=Fallen())
    found = roll(lost, sample(lost), Spread(stiffness=0.2))
    assert not found.stable
    assert found.wrong
    assert roll(lost, sample(lost), Spread()).stable


@pytest.mark.parametrize(("i", "j"), [(6, 1), (1, 4)])
def test_the_place_is_where_the_ply_comes_too_early(flat, i, j):
    """One cup hangs low and leads: the place is on its pad or the ply around it."""
    loose = replace(flat, keeper=None)
    numbers = sample(loose)
    low = 0 * numbers.position
    low[i * flat.cell.grid.columns + j, 2] = -1.0
    numbers = replace(numbers, position=low, angle=0 * numbers.angle)
    found = roll(loose, numbers, Spread(position=15e-3))
    pitch = flat.cell.grid.pitch
    assert found.wrong
    assert_allclose(found.place, (j * pitch, i * pitch), atol=pitch / 2)
    level = replace(numbers, position=0 * low)
    assert roll(loose, level, Spread(position=15e-3)).place is None
