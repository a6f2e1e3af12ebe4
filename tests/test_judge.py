import numpy as np
import pytest
import trimesh
import yaml
from numpy.testing import assert_allclose

from drapeplan.contact import FAR, judge_contact, ply_over_mold
from drapeplan.mold import HeightGrid
from drapeplan.noise import Spread, draw
from drapeplan.overhang import OverhungGrid
from drapeplan.planner import make_plan
from drapeplan.robustness import make_course
from drapeplan.rolling import roll
from drapeplan.scene import scene_from
from drapeplan.words import summary
from tests.plans import EXAMPLES, panel, scene, stages
from tests.settled import tool_section

FAST = "kinematic"  # three times faster, where passive joints do not matter
TIGHT = {"kind": "paraboloid", "radius_x_m": -0.8, "radius_y_m": -0.8}
GENTLE = {"family": "rectangle_blend", "lift_per_m": 0.35}


@pytest.fixture(scope="module")
def convex():
    return stages(scene())


def contact(made, positions=None, rotations=None, **changes):
    cell, sequence, _, wave = made
    poses = (
        wave.positions if positions is None else positions,
        wave.rotations if rotations is None else rotations,
    )
    placed, landing = wave.placed, wave.landing
    return judge_contact(cell, sequence, poses, placed, landing)


def test_the_wave_is_in_order(convex):
    found = contact(convex)
    assert found.front.passed
    assert found.front.contact_area[0] < 0.05
    assert found.front.contact_area[-1] == pytest.approx(1)


def test_a_cup_that_dips_early_is_premature(convex):
    cell, _, _, wave = convex
    positions = wave.positions.copy()
    x, y = positions[3:6, 47, 0], positions[3:6, 47, 1]
    positions[3:6, 47, 2] = cell.mold.height(x, y)
    found = contact(convex, positions).front
    assert not found.in_order
    assert {event.cup for event in found.events} == {(7, 5)}


def test_a_cup_that_stays_up_leaves_an_air_pocket(convex):
    wave = convex[3]
    positions = wave.positions.copy()
    middle = 21  # neighbor of the start cup, inside the placed rectangle
    last = wave.step == wave.step[-1]
    positions[last, middle, 2] += 0.01
    flying = wave.placed.copy()
    flying[last, middle] = False
    cell, sequence = convex[:2]
    positions[-1] = wave.positions[-1]
    found = judge_contact(
        cell, sequence, (positions, wave.rotations), flying, wave.landing
    ).front
    assert any(event.kind == "air_pocket" for event in found.events)


def test_a_ply_pushed_into_the_mold_penetrates(convex):
    wave = convex[3]
    positions = wave.positions.copy()
    positions[4][~wave.placed[4]] -= [0, 0, 0.05]
    assert contact(convex, positions).front.penetrates


def test_ply_beside_the_mold_meets_nothing(convex):
    cell, _, _, wave = convex
    away = wave.positions[:1] + np.array([3.0, 0.0, -1.0])
    gap = ply_over_mold(cell, away, wave.rotations[:1])[1]
    assert_allclose(gap, FAR)


def small_plan(folder, surface=None, **sections):
    """The kinematic plan of the tool of 3 x 4 cups."""
    asked = scene(surface, tool=tool_section(folder), fidelity=FAST, **sections)
    return make_plan(asked, EXAMPLES, "test")


def test_fibers_outside_the_take_up_are_named(tmp_path):
    made = small_plan(tmp_path, TIGHT, path=GENTLE)
    fibers = made.plan.verdict["fibers"]
    assert not made.plan.verdict["good"]
    assert fibers["infeasible"]
    assert fibers["longest_need_mm"] > 0.8
    names = [entry["fiber"] for entry in fibers["infeasible"]]
    assert all(name[0] in "st" and "fiber (" in name for name in names)


@pytest.mark.xdist_group("panel")  # tests that share one plan
def test_steps_carry_the_least_margins():
    verdict = panel().plan.verdict
    margins = verdict["front"]["per_pose"]["premature_margin_mm"]
    least = min(m for m in margins if m is not None)
    per_step = [row["premature_margin_mm"] for row in verdict["steps"]]
    assert min(m for m in per_step if m is not None) == least
    assert [row["step"] for row in verdict["steps"]] == list(range(8))
    assert sum(len(row["cups"]) for row in verdict["steps"]) == 48


def test_a_ply_picked_where_the_mold_stands_is_refused(tmp_path):
    near = {"position_m": [0.7, 0.1, 0.2], "yaw_deg": 0}
    verdict = small_plan(tmp_path, pick=near).plan.verdict
    assert not verdict["front"]["starts_free"]
    assert not verdict["good"]


@pytest.mark.parametrize("height", [12, -15])
def test_a_ply_that_does_not_lie_on_the_mold_is_not_good(height, tmp_path):
    """A narrow ridge or groove between two columns of cups."""
    surface = {"kind": "ridge", "height_mm": height, "sigma_mm": 12, "offset_mm": 55}
    verdict = small_plan(tmp_path, surface).plan.verdict
    assert verdict["front"]["passed"]
    assert not verdict["laid"]["good"]
    assert not verdict["good"]
    side = "sinks_mm" if height > 0 else "bridges_mm"
    assert verdict["laid"][side] > 5


def mesh_scene(folder, size, hole=None):
    """A flat mold of a size, with a square hole at a place if asked for."""
    x, y = (np.arange(-s / 2, s / 2 + 1e-9, 0.01) for s in size)
    grid = np.stack(np.meshgrid(x, y, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    i = np.arange(len(grid)).reshape(len(x), len(y))
    a, b, c, d = (q.ravel() for q in (i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    if hole:
        middle = grid[faces].mean(axis=1)[:, :2]
        faces = faces[(np.abs(middle - hole) > 0.022).any(axis=1)]
    path = folder / "mold.stl"
    trimesh.Trimesh(grid, faces, process=False).export(path)
    mold = {"mesh": {"path": str(path), "unit": "m"}}
    data = {"format": "drapeplan-scene/1", "mold": mold, "fidelity": FAST}
    data["tool"] = tool_section(folder)
    return scene_from(data, "test")


def test_pads_over_the_edge_of_the_mold_are_named(tmp_path):
    made = make_plan(mesh_scene(tmp_path, (0.25, 0.36)), EXAMPLES, "test")
    laid = made.plan.verdict["laid"]
    assert not made.plan.verdict["good"]
    assert len(laid["pads_beside_mold"]) == 10
    assert 0.2 < laid["beside_mold_share"] < 0.4
    words = " ".join(_summary(made))
    assert "10 cups" in words
    assert "beside the mold" in words


def test_ply_over_the_edge_is_told_and_fine(tmp_path):
    made = make_plan(mesh_scene(tmp_path, (0.27, 0.38)), EXAMPLES, "test")
    assert made.plan.verdict["good"]
    assert made.plan.verdict["laid"]["beside_mold_share"] > 0
    assert made.contact.front.laid_deviation.max() < 1e-3


def test_a_hole_in_the_mold_vents(tmp_path):
    hole = (0.055, 0.0)  # between four cups
    made = make_plan(mesh_scene(tmp_path, (0.5, 0.6), hole), EXAMPLES, "test")
    assert made.plan.verdict["good"]
    assert 0.01 < made.plan.verdict["laid"]["beside_mold_share"] < 0.02


def channel_scene(folder):
    """A channel between two columns of cups, a column of samples on each edge."""
    data = yaml.safe_load((EXAMPLES / "channel.yaml").read_text(encoding="utf-8"))
    data |= {"sequence": {"start": [1, 1]}, "ply": {"sample_mm": 5}, "fidelity": FAST}
    data |= {"placement": {"mold_point_m": [0.055, 0.0]}, "robot": {"name": "none"}}
    return scene_from(data | {"tool": tool_section(folder)}, "test")


def test_edges_of_an_opening_are_not_met_from_the_side(tmp_path, monkeypatch):
    """Cups 0.3 mm aside: the gap at the edges jumps by millimeters."""
    made = stages(channel_scene(tmp_path))
    wave = made[3]
    aside = wave.positions.copy()
    aside[1:-1, :, 0] += 0.3e-3
    found = contact(made, aside).front
    assert found.passed
    assert found.span_penetration.max() < 0.2e-3
    assert found.highest.value == pytest.approx(0.0257, abs=1e-4)
    monkeypatch.setattr(OverhungGrid, "opening", HeightGrid.opening)
    assert contact(made, aside).front.span_penetration.max() > 5e-3


def test_samples_see_openings_as_their_plan_does(tmp_path):
    made = make_plan(channel_scene(tmp_path), EXAMPLES, "test")
    course = make_course(made.plan, Spread())
    poses, cups = course.rests.fixed.shape
    found = roll(course, draw(0, 0, cups, poses), Spread())
    deepest = made.contact.front.span_penetration.max()
    assert course.lid is not None
    assert found.span_press == pytest.approx(deepest, abs=20e-6)
    assert not found.wrong


def _summary(made):
    plan = made.plan
    lag = plan.document["kinematic_lag"]
    return summary(plan.verdict, made.contact.front, plan.track, lag)
