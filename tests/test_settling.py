"""Settled paths: at rest, within limits, led where asked; and the lag of the others."""

from dataclasses import fields, replace
from functools import lru_cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from drapeplan.closures import Chords, Closures
from drapeplan.equilibrium import Equilibrium, SettledStatus
from drapeplan.frames import rotation_vectors
from drapeplan.hanging import kinematic_lag, tool_physics
from drapeplan.legs import STROKE, cup_poses, leg_coordinates
from drapeplan.motion import duration
from drapeplan.path import CupState
from drapeplan.rings import outward, toe_down
from drapeplan.settling import FADE, GIVEN, _Walk, settle_path
from drapeplan.touch import judge_touch
from tests.plans import scene
from tests.settled import DOME, drape, settled, settled_track, small

LINK = 1e-9  # [m] error of an interlink: joints are rounded to 1e-12 rad
BELIEVED = 0.2e-3  # [m] hovering cups against what the leading QP believed
ROUNDED = 1e-11  # [m] a stroke at its limit, or at its fastest, once it is rounded
FLAT = 1e-9  # [m], [rad] a flat tool at rest against the same flat tool
TOUCH = 0.5e-3  # [m]


def strokes(made, motion):
    return motion.q[:, made.cell.robot.leg_columns[:, STROKE]]


def toe(made, track):
    """Toe-down of each landing cup at the last waypoint before it stands, [rad]."""
    size, placed = (made.cell.grid.rows, made.cell.grid.columns), track.placed
    angles = []
    for k in np.flatnonzero((placed[1:] & ~placed[:-1]).any(axis=1)):
        asked = made.request.path.rotations[k]
        down = toe_down(track.poses[1][k], asked, outward(*size, placed[k]))
        angles.append(down[placed[k + 1] & ~placed[k]])
    return np.concatenate(angles)


@pytest.mark.parametrize("name", ["dome", "saddle"])
def test_interlinks_hold_and_fibers_are_long_enough(name):
    made, track = small(name), settled_track(name)
    robot = made.cell.robot
    assert np.abs(Closures(robot).values(*track.poses)).max() <= LINK
    longest = tool_physics(made.cell).longest_fiber
    assert Chords(robot).values(*track.poses).max() <= longest + LINK


@pytest.mark.parametrize("name", ["dome", "saddle"])
def test_placed_cups_stand_where_the_kinematic_solution_put_them(name):
    made = small(name)
    columns = made.cell.robot.leg_columns
    placed = made.request.path.states == CupState.PLACED
    assert placed.any()
    found = settled(name).motion.q[:, columns][placed]
    assert_array_equal(found, made.motion.q[:, columns][placed])


@pytest.mark.parametrize("name", ["dome", "saddle"])
def test_what_was_believed_of_the_cups_comes_true(name):
    found = settled(name)
    assert 0 < found.believed.max() < BELIEVED
    assert (found.least_eigenvalue > 0.01).all()
    assert found.iterations.max() < 10


def test_the_first_and_the_last_phases_are_left_alone():
    made, found = small("dome"), settled("dome")
    given = np.isin(made.request.path.phase, GIVEN)
    assert given.any()
    assert_array_equal(found.motion.q[given], made.motion.q[given])
    assert (found.iterations[given] == 0).all()


def test_without_the_lead_strokes_are_those_asked_for():
    made, found = small("saddle"), settled("saddle", lead=False)
    asked = strokes(made, made.motion)
    assert_allclose(strokes(made, found.motion), asked, rtol=0, atol=ROUNDED)
    assert (found.believed == 0).all()
    led = strokes(made, settled("saddle").motion)
    assert np.abs(led - asked).max() > 1e-3


def test_the_lead_takes_the_tilt_off_the_landing_ring():
    """Toes that hang low without the lead come up, as they do on the average."""
    led, lagging = settled_track("saddle"), settled_track("saddle", lead=False)
    down = [judge_touch(t, TOUCH)["border_toe_down_deg"] for t in (led, lagging)]
    assert down[1] > 0.7
    assert down[0] < 0.4 * down[1]
    for name in ("dome", "saddle"):
        toes = [toe(small(name), settled_track(name, lead)) for lead in (True, False)]
        assert toes[0].mean() < toes[1].mean() - np.radians(0.15)


@lru_cache
def slow():
    """The dome with actuators barely as fast as its kinematic strokes are."""
    made = small("dome")
    asked, wave = strokes(made, made.motion), made.request.path.phase.index("wave")
    rates = [
        np.abs(asked[k] - asked[k - 1]).max()
        / duration(made.cell, made.request.path, k)
        for k in range(wave, len(asked))
        if made.request.path.phase[k] == "wave"
    ]
    return drape(DOME, tool={"stroke_velocity": 1.02 * max(rates)})


def test_strokes_keep_their_limits_and_rates():
    """Where actuators are slow, the lead of cups in the air takes what time allows."""
    made = slow()
    robot, path = made.cell.robot, made.request.path
    motion = settle_path(made.cell, path, made.motion).motion
    columns = robot.leg_columns[:, STROKE]
    found, speed = motion.q[:, columns], robot.velocity[columns]
    assert (found >= robot.lower[columns] - ROUNDED).all()
    assert (found <= robot.upper[columns] + ROUNDED).all()
    share = np.array(
        [
            np.abs(found[k] - found[k - 1]) / (speed * duration(made.cell, path, k))
            for k in range(1, len(found))
        ]
    )
    share[path.states[1:] == CupState.PLACED] = 0.0  # they meet their targets
    assert np.max(share) == pytest.approx(1.0, abs=1e-6)  # they do bind
    free = strokes(small("dome"), settled("dome").motion)
    assert np.abs(found - free).max() > 1e-4


def test_short_strokes_are_not_led_beyond_their_ends():
    """Legs as short as the kinematic strokes allow: the lead stays inside."""
    made = small("saddle")
    asked = strokes(made, made.motion)
    middle = (made.cell.robot.geometry.leg_max + made.cell.robot.geometry.leg_min) / 2
    reach = float(np.ptp(asked) / 2 + 1e-4)
    tool = {"leg_min": float(middle) - reach, "leg_max": float(middle) + reach}
    short = drape({"kind": "paraboloid", "radius_x_m": -0.8, "radius_y_m": 1.0}, tool)
    found = strokes(
        short, settle_path(short.cell, short.request.path, short.motion).motion
    )
    assert found.min() >= -ROUNDED
    assert found.max() <= 2 * reach + ROUNDED


def test_the_same_path_settles_to_the_same_bytes():
    made, first = small("dome"), settled("dome")
    again = settle_path(made.cell, made.request.path, made.motion)
    for name in ("believed", "iterations", "least_eigenvalue"):
        assert getattr(first, name).tobytes() == getattr(again, name).tobytes()
    assert first.motion.q.tobytes() == again.motion.q.tobytes()
    assert first.motion.time.tobytes() == again.motion.time.tobytes()


def only(path, chosen, **changes):
    """Some waypoints of a path, with fields replaced."""
    values = {f.name: np.asarray(getattr(path, f.name))[chosen] for f in fields(path)}
    values["phase"] = tuple(values["phase"])
    return replace(path, **{**values, **changes})


def test_a_flat_tool_does_not_lag():
    """On a flat mold, in a flat pose, every cup is where it is believed to be."""
    made = drape({"kind": "plane"})
    path, n = made.request.path, made.cell.robot.n_cups
    states = np.full((2, n), CupState.HOLDING, dtype=path.states.dtype)
    states[:, 4] = states[1, 5] = CupState.PLACED
    flat = only(path, [0, 0], states=states)
    distance, angle = kinematic_lag(made.cell, flat, made.motion.q[[0, 0], :6])
    assert distance <= FLAT
    assert angle <= FLAT


def test_the_lag_is_that_of_the_worst_cup_before_a_landing():
    """Strokes of the request, settled one by one from nothing: the same worst cup."""
    made = small("saddle")
    cell, robot, path = made.cell, made.cell.robot, made.request.path
    arm = made.motion.q[:, robot.arm_columns]
    found = kinematic_lag(cell, path, arm)
    placed = path.states == CupState.PLACED
    worst = np.zeros(2)
    for k in range(len(placed) - 1):
        if not placed[k].any() or placed[k].sum() == placed[k + 1].sum():
            continue
        poses = path.positions[k], path.rotations[k]
        legs = leg_coordinates(robot.geometry, path.tool[k], *poses)
        q = robot.configuration(arm[k], legs)
        rest = Equilibrium(robot, tool_physics(cell)).settle(q, placed[k])
        assert rest.status == SettledStatus.SETTLED
        p, R = cup_poses(robot.geometry, path.tool[k], rest.q[robot.leg_columns])
        apart = np.linalg.norm(p - poses[0], axis=1).max()
        turn = np.linalg.norm(rotation_vectors(R, poses[1]), axis=1).max()
        worst = np.maximum(worst, [apart, turn])
    assert_allclose(found, worst, rtol=1e-5)
    assert worst[0] > 1e-4
    assert np.degrees(worst[1]) > 1


def test_stiffness_and_take_up_come_from_the_scene():
    made = small("dome")
    ply = {"bending_stiffness_Nm": 0.005, "take_up_mm": 0.3, "areal_mass_kg_m2": 0.5}
    changed = replace(made.cell, scene=scene(DOME, ply=ply))
    physics = tool_physics(changed)
    assert physics.bending == 0.005
    assert physics.areal_mass == 0.5
    assert physics.longest_fiber == pytest.approx(0.0703)


def away(kinematic, own):
    """Largest way of a stroke from the nearest waypoint of the request, [m]."""
    apart = np.abs(own[:, None] - kinematic).max(axis=-1)
    return apart.min(axis=1).max()


class Fussy(Equilibrium):
    """Refuses to rest where a stroke is too far from those of the request."""

    most = np.inf  # [m]
    kinematic = None  # strokes that are always taken, shape (K, n)

    def settle(self, q, fixed, *rest, **options):
        found = super().settle(q, fixed, *rest, **options)
        own = q[self.robot.leg_columns[:, STROKE]]
        if away(self.kinematic, own[None]) <= self.most:
            return found
        return replace(found, status=SettledStatus.FAILED)


@pytest.fixture
def fussy(monkeypatch):
    """The saddle's path, settled by a tool that takes some corrections alone."""

    def settle(most):
        made = small("saddle")
        monkeypatch.setattr(Fussy, "kinematic", strokes(made, made.motion))
        monkeypatch.setattr(Fussy, "most", most)
        monkeypatch.setattr("drapeplan.settling.Equilibrium", Fussy)
        motion = settle_path(made.cell, made.request.path, made.motion).motion
        return away(strokes(made, made.motion), strokes(made, motion))

    return settle


def test_a_correction_without_a_rest_is_made_in_part(fussy):
    """Part of it is better than none, and the path goes on."""
    made = small("saddle")
    both = made.motion, settled("saddle").motion
    most = 0.6 * away(*(strokes(made, motion) for motion in both))
    assert 0.3 * most < fussy(most) <= most + ROUNDED


def test_where_no_correction_rests_the_strokes_of_the_request_stay(fussy):
    assert fussy(1e-9) <= 1e-9


def test_cups_lean_back_until_they_are_laid_flat():
    """In full from FADE on, half of it at half of FADE, not at all on the mold."""
    made = drape(DOME, path={"family": "rectangle_blend", "toe_up_deg": 3})
    path, n = made.request.path, made.cell.robot.n_cups
    last = len(path.phase) - 1 - path.phase[::-1].index("wave")
    heights = FADE * np.resize([0.0, 0.5, 1.0, 4.0], n)
    lifted = path.positions.copy()
    lifted[last - 1] = lifted[last] + heights[:, None] * path.rotations[last][..., 2]
    walk = _Walk(made.cell, replace(path, positions=lifted), made.motion, lead=True)
    expected = np.radians(3) * np.minimum(heights / FADE, 1.0)
    np.testing.assert_allclose(walk._lean(last - 1), expected, atol=1e-12)
    np.testing.assert_allclose(walk._lean(last), 0.0, atol=1e-12)


def test_one_step_leans_by_itself():
    """Up to that step nothing changes; in it, cups lean back by that angle."""
    made = small("dome")
    path = made.cell.scene.path.model_copy(update={"toe_up_steps": ((2, 5.0),)})
    cell = replace(made.cell, scene=made.cell.scene.model_copy(update={"path": path}))
    walks = [
        _Walk(one, made.request.path, made.motion, lead=True)
        for one in (made.cell, cell)
    ]
    steps = made.request.path.step
    first = int(np.flatnonzero(steps == 1)[0])
    leans = np.stack([[walk._lean(k) for k in range(len(steps))] for walk in walks])
    usual, other = leans
    assert_array_equal(other[steps != 1], usual[steps != 1])
    assert_allclose(other[first], usual[first] * 5.0 / path.toe_up_deg)
    assert usual[first].max() == pytest.approx(np.radians(path.toe_up_deg))
