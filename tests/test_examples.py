"""Every example scene is planned as its user would, with the answer it stands for."""

import json

import pytest

from tests.plans import EXAMPLES

ANSWERS = {
    "border_first": 1,
    "kindrape": 0,
    "panel": 0,
    "paraboloid": 0,
    "saddle": 0,
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
    if code:
        assert ended.line.startswith("not drapable: ")
        return
    assert ended.err == ""
    assert json.loads(output.read_text())["verdict"] == ended.document["verdict"]
