import dataclasses

import numpy as np
import pytest
import yaml

from drapeplan.arm_check import (
    SINGULAR,
    _limits,
    judge_arm,
    least_singular_value,
    payload,
)
from drapeplan.arm_words import arm_failures, arm_lines
from drapeplan.chain import read_chain
from drapeplan.planner import make_plan
from drapeplan.scene import scene_from
from drapeplan.words import labels
from tests.arms import six_axes
from tests.plans import panel
from urdf.arm import mass_of, payload_of, read_arm
from urdf.generate import tool_urdf, write_tool
from urdf.spec import RIGID, ToolSpec

FOUND = 1.0  # [mm] how finely the least clearance between waypoints is found
SMALL = ToolSpec(name="small", rows=4, columns=3, leg_max=0.35)


@pytest.fixture(scope="module")
def drape():
    plan = panel().plan
    return plan.cell, plan.track, plan.verdict["arm"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder with a 3 x 4 tool and an arm that is no UR, with boxes and without."""
    path = tmp_path_factory.mktemp("cell")
    write_tool(SMALL, path)
    (path / "six.urdf").write_text(six_axes())
    (path / "bare.urdf").write_text(six_axes(geometry=False))
    return path


def small_plan(folder, robot, fidelity="kinematic"):
    mold = {"kind": "paraboloid", "radius_x_m": 1.5, "radius_y_m": 2.5}
    data = {
        "format": "drapeplan-scene/1",
        "robot": robot,
        "fidelity": fidelity,
        "tool": {"urdf": "small.urdf"},
        "mold": {"surface": mold, "position_m": [0.55, 0.0, 0.05]},
        "pick": {"position_m": [0.0, 0.6, 0.05], "yaw_deg": 90},
    }
    return make_plan(scene_from(data, "test"), folder, "test").plan


def standing(cell, lift=0.0, forward=0.0):
    """The cell with its mold moved."""
    moved = cell.world_mold.copy()
    moved[:3, 3] += forward, 0, lift
    return dataclasses.replace(cell, world_mold=moved)


def least(arm, what):
    return next(row for row in arm["clearances"] if row["what"] == what)


def test_the_panel_is_clear(drape):
    _, _, arm = drape
    assert arm["good"] is True
    assert least(arm, "arm to mold")["least_mm"] > 110
    assert arm["least_clearance_mm"] > 30
    assert arm["least_singular_value_m"] > 4 * SINGULAR
    assert arm["least_joint_room_deg"] > 80


def test_a_higher_mold_comes_nearer_to_the_platform_as_much(drape):
    cell, track, arm = drape
    lifted = judge_arm(standing(cell, lift=0.1), track)
    before, after = (least(x, "platform to mold")["least_mm"] for x in (arm, lifted))
    assert before - after == pytest.approx(100, abs=FOUND)


def test_a_mold_in_the_arm_names_both_bodies_and_what_helps(drape):
    cell, track, _ = drape
    arm = judge_arm(standing(cell, lift=0.25, forward=-0.35), track)
    assert arm["good"] is False
    assert arm["least_clearance_mm"] < 0
    worst = least(arm, "arm to mold")
    text = " ".join(arm_failures(arm, labels(track)))
    assert f"{worst['between'][0]} and mold overlap by" in text
    assert f"waypoint {worst['waypoint'] + 1}" in text or "waypoints" in text
    assert "mold.position_m" in text


def test_a_jump_through_the_platform_is_seen_between_waypoints(drape):
    """Both ends are clear; on the way the wrist folds onto the platform."""
    cell, track, _ = drape
    arm = track.arm[[60, 60]].copy()
    arm[1, 3] += 2 * np.pi
    jump = dataclasses.replace(
        track,
        phase=("wave", "wave"),
        arm=arm,
        legs=track.legs[[60, 60]],
        states=track.states[[60, 60]],
    )
    found = judge_arm(cell, jump)
    assert found["good"] is False
    row = least(found, "arm to platform")
    assert row["least_mm"] < 0
    assert 0 < row["share"] < 1


@pytest.mark.parametrize(("joint", "value"), [(4, 0.0), (2, 0.0)])
def test_wrist_and_elbow_singularities_have_no_distance(joint, value):
    chain = read_chain(read_arm("ur10"))
    q = np.array([-0.2, -1.4, 1.6, -1.7, -1.6, -1.8])
    offsets = np.radians([30, 20, 10, 5, 0])
    rows = np.tile(q, (5, 1))
    rows[:, joint] = value + offsets
    singular, volume = least_singular_value(chain, rows, 0.5)
    assert (np.diff(singular) < 0).all()
    assert singular[-1] < 1e-3
    assert singular[-2] < SINGULAR < least_singular_value(chain, q[None], 0.5)[0][0]
    assert volume[-1] < 1e-3 * volume[0]


def test_a_drape_through_a_singularity_is_not_good(drape):
    cell, track, _ = drape
    arm = track.arm[[60, 60]].copy()
    arm[1, 4] = -arm[1, 4]  # the wrist passes 0 on the way
    bent = dataclasses.replace(
        track, arm=arm, legs=track.legs[[60, 60]], states=track.states[[60, 60]]
    )
    found = judge_arm(cell, bent)
    assert found["least_singular_value_m"] < SINGULAR
    assert any("singularity" in line for line in arm_failures(found, ["A", "B"]))


def test_a_joint_past_its_limit_is_named(drape):
    cell, track, _ = drape
    arm = track.arm.copy()
    arm[50, 2] = np.pi + 0.01
    found = judge_arm(cell, dataclasses.replace(track, arm=arm))
    assert found["good"] is False
    assert not _limits(dataclasses.replace(track, arm=arm))["within"]
    assert _limits(track)["within"]
    words = " ".join(arm_failures(found, labels(track)))
    assert "elbow_joint of the arm passes its limit by 0.57 deg at waypoint 51" in words


def test_payload_of_tool_and_ply(drape):
    cell, _, arm = drape
    masses = 12 + 48 * (0.45 + 0.10 + 0.06) + 82 * 0.02  # [kg] urdf/README.md
    assert arm["payload"]["tool_kg"] == pytest.approx(masses)
    assert arm["payload"]["ply_kg"] == pytest.approx(0.63 * 0.85 * 0.31)
    assert arm["payload"]["exceeded"] is True
    assert "may carry 10 kg" in " ".join(arm_lines(arm))
    robot = cell.scene.robot.model_copy(update={"payload_kg": 60.0})
    strong = cell.scene.model_copy(update={"robot": robot})
    assert payload(dataclasses.replace(cell, scene=strong))["exceeded"] is False
    assert payload_of(six_axes()) is None
    assert payload_of(read_arm("ur5")) == 5
    assert mass_of(tool_urdf(RIGID)) == pytest.approx(masses - 82 * 0.02)


def test_meshes_that_are_missing_are_told_and_never_good(drape):
    cell, track, _ = drape
    lost = cell.sources.arm_urdf.replace("/ur10/collision/wrist1", "/nowhere/wrist1")
    sources = dataclasses.replace(cell.sources, arm_urdf=lost)
    arm = judge_arm(dataclasses.replace(cell, sources=sources), track)
    assert arm["good"] is None
    assert arm["checked"] is False
    assert "not checked" in arm_lines(arm)[0]
    assert "wrist1" in arm_lines(arm)[0]
    assert not arm_failures(arm, labels(track))


@pytest.mark.parametrize(
    ("robot", "fidelity"),
    [({"name": "ur5"}, "kinematic"), ({"urdf": "six.urdf"}, "equilibrium")],
)
def test_other_arms_plan_with_a_tool_of_3_x_4(folder, robot, fidelity):
    plan = small_plan(folder, robot, fidelity)
    assert plan.verdict["good"]
    arm = plan.verdict["arm"]
    assert arm["good"] is True
    assert arm["least_clearance_mm"] > 30
    known = 5.0 if "name" in robot else None
    assert arm["payload"]["payload_kg"] == known


def test_an_arm_without_geometry_plans_and_says_what_was_not_checked(folder):
    plan = small_plan(folder, {"urdf": "bare.urdf"})
    assert plan.verdict["good"]
    assert plan.verdict["arm"]["good"] is None
    assert "not checked" in " ".join(arm_lines(plan.verdict["arm"]))


def test_a_saddle_picked_straight_meets_the_forearm(drapeplan, write_scene, tmp_path):
    """Carried high past the corner of the table, the platform meets the forearm."""
    saddle = {"kind": "paraboloid", "radius_x_m": 1.8, "radius_y_m": -1.5}
    pick = {"position_m": [0.0, 0.75, 0.2], "yaw_deg": 0}
    mold = {"surface": saddle}
    scene = write_scene(mold=mold, pick=pick, fidelity="kinematic")
    assert yaml.safe_load(scene.read_text())["mold"]["surface"] == saddle
    ended = drapeplan("plan", scene, "-o", tmp_path / "plan.json")
    assert ended.code == 1
    assert "forearm_link and platform overlap" in ended.out
    assert "pick.yaw_deg" in ended.out


def test_a_home_beyond_the_limits_of_another_arm_names_the_key(folder):
    from drapeplan.errors import InputError

    robot = {"urdf": "six.urdf", "home_rad": [0, -2.5, 1, 0, 0, 0]}
    with pytest.raises(InputError, match=r"robot\.home_rad.*a2"):
        small_plan(folder, robot)
