"""Every example scene is planned as its user would, with the answer it stands for."""

import json
import re

import pytest
import yaml

from drapeplan.scene import read_scene, scene_from
from drapeplan.sequence import make_sequence
from tests.plans import EXAMPLES
from tests.test_readme import blocks

ANSWERS = {"channel": 1, "kindrape": 0, "saddle": 0}
ANSWERS |= {"air_pocket": 1, "far_cup": 1}
ALONE = {"border_first", "panel", "paraboloid"}  # below, or tests/test_cli.py
SAYS = {
    "air_pocket": [r"^Wave step 3 of 4: an air pocket of 1\d\d\.\d cm2 .* closes near"],
    "far_cup": [r"^Wave step 1 of 2: the ply touches .* apart from the contact around"],
    # the channel is 25 mm deep, and the ply's span within 1 mm of the land
    "channel": [
        r"^Laid, the ply bridges 25\.\d mm or sinks 0\.0 mm",
        r"^In order: the ply touches the mold outward from cup \(3, 2\)",
        r"^distance grid, because of an overhang of 7\.8 mm at \(-?20, -?\d+\) mm$",
    ],
}


def test_every_example_is_listed():
    assert ALONE | set(ANSWERS) == {path.stem for path in EXAMPLES.glob("*.yaml")}


def test_paraboloid_is_the_first_plan_of_the_readme():
    """Made there by its commands; here the defaults are what that scene spells out."""
    example = read_scene(EXAMPLES / "paraboloid.yaml")
    spelled = scene_from(yaml.safe_load(blocks("yaml")[0]), "README.md")
    sequences = [make_sequence(s.sequence, 8, 6, "test") for s in (example, spelled)]
    assert sequences[0] == sequences[1]
    assert spelled.model_copy(update={"sequence": example.sequence}) == example


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("name", "code"), ANSWERS.items(), ids=list(ANSWERS))
def test_example(drapeplan, tmp_path, name, code):
    output = tmp_path / "plan.json"
    ended = drapeplan("plan", EXAMPLES / f"{name}.yaml", "-o", output, "--json")
    assert ended.code == code, ended.err
    assert ended.document["good"] is (code == 0)
    for pattern in SAYS.get(name, []):
        verdict = ended.document["verdict"]
        lines = [verdict["mold"], *ended.document["sentences"]]
        assert any(re.search(pattern, line) for line in lines), pattern
    assert ended.err == ""
    assert json.loads(output.read_text())["verdict"] == ended.document["verdict"]


@pytest.mark.filterwarnings("error")
def test_border_ring_first_names_interlink_and_air_pocket(drapeplan, tmp_path):
    output = tmp_path / "plan.json"
    ended = drapeplan("plan", EXAMPLES / "border_first.yaml", "-o", output, "--json")
    assert ended.code == 1
    assert ended.document["good"] is False
    assert ended.line.startswith("not drapable: ")
    assert "rigid interlinks cannot reach it" in ended.line
    assert "cup (" in ended.line
    assert not output.exists()  # no waypoints exist beyond what the links reach
    pockets = [line for line in ended.err.splitlines() if "an air pocket of" in line]
    assert len(pockets) == 1
    for word in (" cm2", " cm3", "near cup (", "mm)"):
        assert word in pockets[0]
    report = ended.document["report"]
    events = report["front_on_requested_poses"]["events"]
    areas = [event for event in events if "pocket" in str(event).lower()]
    assert areas
    assert ended.document["exit_code"] == 1
