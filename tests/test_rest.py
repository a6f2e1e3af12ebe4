"""A drape that does not rest where its plan has it is found out."""

import copy
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from drapeplan.check import check_plan
from drapeplan.closures import Closures
from drapeplan.plan import Plan, document_hash
from drapeplan.planner import NotDrapableError, make_plan
from drapeplan.rest import AT_REST, judge_rest
from drapeplan.settling import UnsettledError
from drapeplan.tool_energy import PASSIVE
from tests.plans import scene
from tests.settled import SADDLE, settled_track, small, tool_section

FORGED = 1e-4  # [rad] largest change of a joint in a forged waypoint
TIPPING = {"cup_center_of_mass": 0.012}  # [m] above the ball: a counterweight
LIMP = {"bending_stiffness_Nm": 5e-4}  # a ply that does not hold it


def hovering(track):
    """A waypoint in the middle of the wave, and a cup that hovers there."""
    k = int(np.flatnonzero((track.step == 1) & (track.tau > 0.5))[0])
    return k, int(np.flatnonzero(~track.placed[k])[0])


def ways_out(track, k):
    """Changes of the passive joints that keep all links to first order, (n, 6, m)."""
    robot, free = track.robot, ~track.placed[k]
    J = Closures(robot).jacobian(robot.kinematics(track.q[k])).toarray()
    columns = robot.leg_columns[free][:, PASSIVE].ravel()
    _, size, V = np.linalg.svd(J[:, columns])
    rank = int((size > 1e-9 * size[0]).sum())
    legs = np.zeros((robot.n_cups, 6, len(columns) - rank))
    legs[np.ix_(free, PASSIVE)] = V[rank:].T.reshape(free.sum(), 5, -1)
    return FORGED * legs / np.abs(legs).max(axis=(0, 1))


def forged(track, k, change):
    """The drape with other legs at one waypoint."""
    legs = track.legs.copy()
    legs[k] += change
    return replace(track, legs=legs)


@pytest.mark.parametrize("lead", [True, False])
@pytest.mark.parametrize("name", ["dome", "saddle"])
def test_a_settled_path_is_at_rest(name, lead):
    found = judge_rest(small(name).cell, settled_track(name, lead))
    assert found["good"]
    assert found["stable"]
    assert 0.02 < found["least_stiffness_Nm_per_rad"] < 0.05
    assert "unsettled_waypoint" not in found


def test_every_way_off_the_rest_is_found():
    """Links hold, strokes are those of the plan: only the rest tells."""
    track, cell = settled_track("saddle"), small("saddle").cell
    k, _ = hovering(track)
    ways = ways_out(track, k)
    for m in np.linspace(0, ways.shape[-1] - 1, 6).astype(int):
        altered = forged(track, k, ways[..., m])
        assert np.abs(Closures(track.robot).values(*altered.poses)[k]).max() < 1e-6
        found = judge_rest(cell, altered)
        assert not found["good"]
        assert found["stable"]
        assert found["unsettled_waypoint"] == k


def test_a_stroke_altered_without_settling_is_found():
    track = settled_track("saddle")
    k, cup = hovering(track)
    change = np.zeros_like(track.legs[k])
    change[cup, 2] = 20 * AT_REST
    found = judge_rest(small("saddle").cell, forged(track, k, change))
    assert not found["good"]
    assert found["unsettled_waypoint"] == k


def test_rounded_joints_are_at_rest():
    """Changes of a micrometer's hundredth are none."""
    track = settled_track("saddle")
    legs = track.legs + np.random.default_rng(0).uniform(-1e-8, 1e-8, track.legs.shape)
    legs[track.placed] = track.legs[track.placed]
    found = judge_rest(small("saddle").cell, replace(track, legs=legs))
    assert found["good"]


@lru_cache
def document():
    """The saddle's plan."""
    with TemporaryDirectory() as folder:
        read = scene(SADDLE, tool=tool_section(folder))
        return make_plan(read, Path(folder), "test").plan.document


def remade(alter):
    """The plan with a drape altered, and all that follows from it made anew."""
    made = copy.deepcopy(document())
    track = Plan(made).track
    k, cup = hovering(track)
    legs = track.legs[k] + alter(track, k, cup)
    waypoint = made["waypoints"][k]
    waypoint["legs"], waypoint["strokes_m"] = legs.tolist(), legs[:, 2].tolist()
    positions, rotations = Plan(made).track.poses
    waypoint["position_m"] = positions[k].tolist()
    waypoint["rotation"] = rotations[k].tolist()
    made["verdict"] = Plan(made).judged[0]
    made["hash"] = document_hash(made)
    return k, check_plan(Plan(made))


def test_an_honest_plan_passes():
    assert check_plan(Plan(document())).passed


def off_rest(track, k, cup):
    """Passive joints where nothing holds them."""
    return ways_out(track, k)[..., 3]


def other_stroke(track, k, cup):
    """A hovering cup's stroke, its joints left as they were."""
    change = np.zeros_like(track.legs[k])
    change[cup, 2] = 20 * AT_REST
    return change


@pytest.mark.parametrize("alter", [off_rest, other_stroke])
def test_a_consistent_forgery_fails_the_check(alter):
    k, found = remade(alter)
    assert not found.passed
    assert not found.broken
    words = f"The tool moves when it is let go at waypoint {k + 1}."
    assert words in found.violated


def test_an_altered_lag_is_seen():
    """The lag of the kinematic fidelity is recomputed."""
    made = copy.deepcopy(document())
    made["kinematic_lag"]["largest_angle_deg"] += 0.01
    made["hash"] = document_hash(made)
    found = check_plan(Plan(made))
    assert any("kinematic_lag.largest_angle_deg" in line for line in found.differing)


def test_cups_that_tip_over_are_refused(tmp_path):
    """A counterweight that gravity tips, on a ply too limp to hold it."""
    read = scene(SADDLE, tool=tool_section(tmp_path, **TIPPING), ply=LIMP)
    with pytest.raises(NotDrapableError) as stop:
        make_plan(read, tmp_path, "test")
    error = stop.value
    assert isinstance(error.__cause__, UnsettledError)
    assert error.exit_code == 1
    assert "no stable rest" in error.what
    report = error.report["strokes"]
    assert report["problem"] == error.what
    assert report["waypoint"] == error.__cause__.waypoint
    assert report["phase"] == error.__cause__.phase
    assert report["remedy"]
    assert not error.report["good"]


def test_the_command_says_so_in_one_line(drapeplan, write_scene, tmp_path):
    mold, tool = {"surface": SADDLE}, tool_section(tmp_path, **TIPPING)
    path = write_scene(mold=mold, tool=tool, ply=LIMP)
    ended = drapeplan("plan", path, "-o", tmp_path / "plan.json")
    assert ended.code == 1
    assert "no stable rest" in ended.line
    assert "Traceback" not in ended.err
    assert not (tmp_path / "plan.json").exists()
