import copy

import pytest

from drapeplan.check import check_plan
from drapeplan.plan import Plan, document_hash
from tests.settled import small_panel

WAVE = 53  # a waypoint in the middle of the wave


@pytest.fixture(scope="module")
def document():
    return small_panel().plan.document


def changed(document, path, change):
    """A copy of the plan with one value changed."""
    made = copy.deepcopy(document)
    *folders, last = path
    place = made
    for key in folders:
        place = place[key]
    place[last] = change(place[last])
    return made


def mended(document, path, change):
    """Check of a plan with one value changed and its hash mended."""
    made = changed(document, path, change)
    made["hash"] = document_hash(made)
    return check_plan(Plan(made))


def test_an_untouched_plan_holds(document):
    found = check_plan(Plan(document))
    assert found.passed
    assert found.verdict == document["verdict"]


LEAST = {"stroke": 1e-6, "leg": 1e-6}  # [m] even a micrometer is seen
PLACES = {
    "stroke": ["waypoints", WAVE, "strokes_m", 7],
    "leg": ["waypoints", WAVE, "legs", 7, 2],
    "arm": ["waypoints", WAVE, "arm_rad", 3],
    "position": ["waypoints", WAVE, "position_m", 10, 1],
    "rotation": ["waypoints", WAVE, "rotation", 10, 0, 1],
    "time": ["waypoints", WAVE, "time_s"],
    "tau": ["waypoints", WAVE, "tau"],
    "target": ["targets", "position_m", 11, 0],
    "target rotation": ["targets", "rotation", 11, 0, 1],
    "net": ["net", "largest_cell_shear_deg"],
    "margin": ["verdict", "front", "per_pose", "contact_area", 30],
    "fibers": ["verdict", "fibers", "longest_need_mm"],
    "ply estimate": ["verdict", "ply_model", "effects", 3, "size_mm"],
    "ply tolerance": ["scene", "tolerance", "shape_mm"],
    "mold": ["mold", "heights_m", 100, 100],
    "mold position": ["scene", "mold", "position_m", 2],
    "take-up": ["scene", "ply", "take_up_mm"],
}


@pytest.mark.parametrize("place", PLACES)
def test_a_number_altered_breaks_the_hash(document, place):
    made = changed(document, PLACES[place], lambda x: x + 1e-3)
    assert document_hash(made) != made["hash"]


def test_a_broken_hash_fails_the_check(document):
    made = changed(document, PLACES["time"], lambda x: x + 1e-3)
    found = check_plan(Plan(made))
    assert "hash" in found.broken[0]
    assert not found.passed


@pytest.mark.parametrize("place", PLACES)
def test_a_mended_hash_does_not_hide_an_altered_number(document, place):
    found = mended(document, PLACES[place], lambda x: x + LEAST.get(place, 1e-3))
    assert not found.passed
    assert found.differing


def test_a_turned_verdict_is_seen(document):
    found = mended(document, ["verdict", "good"], lambda x: not x)
    assert "verdict.good" in found.differing[0]


@pytest.mark.parametrize(
    ("path", "change", "word"),
    [
        (["waypoints", WAVE, "cups"], lambda x: "h" + x[1:-1] + "p", "cups"),
        (["waypoints", WAVE, "step"], lambda x: x + 1, "waypoints"),
        (["sequence", "pattern"], lambda x: "spine_s", "sequence.pattern"),
        (["sequence", "steps", 0], lambda x: x[:1], "sequence.steps"),
        (["arm", "joint_names"], lambda x: x[::-1], "arm.joint_names"),
        (["scene", "robot", "name"], lambda x: None, "recomputed"),
        (["verdict", "ply_model", "model"], lambda x: "modal", "ply_model.model"),
        (["verdict", "ply_model", "gravity"], lambda x: not x, "ply_model.gravity"),
        (["scene", "ply", "model"], lambda x: "modal", "verdict."),
    ],
)
def test_other_alterations_are_named(document, path, change, word):
    found = mended(document, path, change)
    assert any(word in line for line in found.differing), found


def test_rates_beyond_the_limits_are_violated(document):
    made = copy.deepcopy(document)
    for k, waypoint in enumerate(made["waypoints"]):
        waypoint["time_s"] = 1e-3 * k
    made["hash"] = document_hash(made)
    found = check_plan(Plan(made))
    assert not found.passed
    assert any("rate" in line for line in found.violated)


def test_a_stroke_altered_with_its_pose_is_seen(document):
    """Joints, strokes and poses agree with one another, but a placed cup has moved."""
    made = copy.deepcopy(document)
    waypoint = made["waypoints"][WAVE]
    cup = waypoint["cups"].index("p")
    waypoint["legs"][cup][2] += 5e-4
    waypoint["strokes_m"][cup] += 5e-4
    plan = Plan(made)
    positions, rotations = plan.track.poses
    waypoint["position_m"] = positions[WAVE].tolist()
    waypoint["rotation"] = rotations[WAVE].tolist()
    made["hash"] = document_hash(made)
    found = check_plan(Plan(made))
    assert not found.passed
    assert any("Placed cups" in line for line in found.violated)
    assert any("interlink" in line for line in found.violated)


def test_embedded_sources_are_hashed(document):
    def swap(text):
        return text.replace("<mass", "<mass ", 1)

    found = mended(document, ["tool", "urdf"], swap)
    assert any("sources_sha256" in line for line in found.broken)


def remade(document, alter):
    """A plan altered, then given the verdict and the hash that follow from it."""
    made = copy.deepcopy(document)
    alter(made)
    plan = Plan(made)
    made["verdict"] = plan.judged[0]
    made["hash"] = document_hash(made)
    return check_plan(Plan(made))


def lift_mold(made):
    """Mold and targets moved apart: the ply would lie 50 mm above the mold."""
    made["scene"]["mold"]["position_m"][2] -= 0.05
    for position in made["targets"]["position_m"]:
        position[2] += 0.05


def drop_waypoints(made):
    """All but the ends of the wave steps left out: nothing between them is judged."""
    made["waypoints"] = [
        waypoint
        for waypoint in made["waypoints"]
        if waypoint["phase"] != "wave" or waypoint["tau"] == 1
    ]


def hide_a_jump(made):
    """A waypoint of the wave called an approach, with its cups in the air."""
    made["waypoints"][WAVE]["phase"] = "approach"
    made["waypoints"][WAVE]["cups"] = "h" * 12


def move_pick(made):
    made["scene"]["pick"]["position_m"][0] -= 0.1


def change_lift(made):
    made["scene"]["path"]["lift_per_m"] = 0.3


def drop_retreat(made):
    made["waypoints"] = made["waypoints"][:-2]


@pytest.mark.parametrize(
    "alter",
    [lift_mold, drop_waypoints, hide_a_jump, move_pick, change_lift, drop_retreat],
)
def test_a_plan_that_agrees_with_itself_but_not_with_its_scene(document, alter):
    found = remade(document, alter)
    assert not found.passed
    assert found.differing
