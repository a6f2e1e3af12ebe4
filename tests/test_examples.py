"""Every example scene is planned as its user would, with the answer it stands for."""

import json
import re

import pytest

from tests.plans import EXAMPLES

ANSWERS = {
    "border_first": 1,
    "channel": 1,
    "kindrape": 0,
    "panel": 0,
    "paraboloid": 0,
    "saddle": 0,
}
SAYS = {  # the channel is 25 mm deep, and the ply's span within 1 mm of the land
    "channel": [
        r"^Laid, the ply bridges 25\.\d mm or sinks 0\.0 mm",
        r"^In order: the ply touches the mold outward from cup \(3, 2\)",
        r"^distance grid, because of an overhang of 7\.8 mm at \(-?20, -?\d+\) mm$",
    ]
}


def test_every_example_is_listed():
    assert sorted(ANSWERS) == sorted(path.stem for path in EXAMPLES.glob("*.yaml"))


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
    if not output.exists():  # no waypoints, so the report alone
        assert ended.line.startswith("not drapable: ")
        return
    assert ended.err == ""
    assert json.loads(output.read_text())["verdict"] == ended.document["verdict"]
