import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from drapeplan.errors import InputError
from drapeplan.plan import Plan, canonical, document_hash
from tests.plans import panel
from tests.tolerances import ALIGNED, CLOSED, EXACT, LANDED


@pytest.fixture(scope="module")
def plan():
    return panel().plan


def test_reading_gives_what_was_written(plan, tmp_path):
    path = tmp_path / "plan.json"
    plan.write(path)
    again = Plan.read(path)
    assert again.document == plan.document
    assert again.document["hash"] == document_hash(again.document)
    assert path.read_text() == canonical(plan.document) + "\n"


def test_the_file_alone_gives_the_verdict(plan, tmp_path):
    path = tmp_path / "plan.json"
    plan.write(path)
    assert Plan.read(path).judged[0] == plan.verdict


def test_panel_meets_what_a_plan_promises(plan):
    verdict = plan.verdict
    assert verdict["good"]
    assert verdict["fidelity"] == "equilibrium"
    assert verdict["interlinks"]["worst_error_mm"] <= 1e3 * CLOSED
    assert verdict["landing"]["worst_distance_mm"] <= 1e3 * LANDED
    assert verdict["landing"]["worst_angle_deg"] <= ALIGNED
    assert verdict["landing"]["worst_slide_mm"] <= 1e3 * LANDED
    assert verdict["front"]["in_order"]
    assert plan.document["net"]["worst_link_error_mm"] <= 1e-6


def test_poses_follow_from_the_joints_by_pinocchio(plan):
    track = plan.track
    for k in (0, 30, 60, len(track.phase) - 1):
        state = plan.cell.robot.kinematics(track.q[k])
        assert_allclose(state.positions, track.poses[0][k], atol=EXACT)
        assert_allclose(state.rotations, track.poses[1][k], atol=EXACT)


def test_times_increase_and_rates_are_kept(plan):
    track = plan.track
    duration = np.diff(track.time)
    assert (duration > 0).all()
    rate = np.abs(np.diff(track.q, axis=0)) / duration[:, None]
    assert (rate <= track.robot.velocity * (1 + 1e-6)).all()


def test_the_wave_is_sampled_finely_before_contact(plan):
    """The lowest corner of each landing pad has little left to fall."""
    track, cell = plan.track, plan.cell
    mold, half = cell.mold, track.robot.half_width
    corners = half * np.array([[-1, -1, 0], [-1, 1, 0], [1, -1, 0], [1, 1, 0]])
    arms = np.einsum("knij,cj->knci", track.poses[1], corners)
    points = track.poses[0][:, :, None] + arms - cell.world_mold[:3, 3]
    height = points[..., 2] - mold.height(points[..., 0], points[..., 1])
    for k in range(1, len(track.phase)):
        if track.phase[k] == "wave" and track.tau[k] == 1:
            landing = track.landing[k - 1]
            fall = (height[k - 1] - height[k])[landing]
            assert fall.min(axis=-1).max() <= 0.3e-3


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "is not JSON"),
        ("[]", "valid dictionary"),
        ('{"format": "drapeplan-plan/1"}', "required"),
        ('{"format": "other"}', "drapeplan-plan/1"),
    ],
)
def test_files_that_are_no_plans(tmp_path, content, words):
    path = tmp_path / "plan.json"
    path.write_text(content)
    with pytest.raises(InputError, match=words) as caught:
        Plan.read(path)
    assert "\n" not in str(caught.value)


def test_missing_plan(tmp_path):
    with pytest.raises(InputError, match="cannot read it"):
        Plan.read(tmp_path / "none.json")


def test_no_clock_in_a_plan(plan):
    text = json.dumps(plan.document)
    assert "created" not in text
    assert "date" not in plan.document
