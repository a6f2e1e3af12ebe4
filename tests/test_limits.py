"""docs/limits.md says what was measured."""

import json
from pathlib import Path

from benchmarks._limits import RESULTS, table

LIMITS = Path(__file__).parent.parent / "docs" / "limits.md"


def test_the_table_is_that_of_the_benchmark():
    found = json.loads(RESULTS.read_text(encoding="utf-8"))
    lines = table(found)
    assert len(lines) > 2
    assert "\n".join(lines) in LIMITS.read_text(encoding="utf-8")


def test_scenes_that_are_met_are_named_so():
    found = json.loads(RESULTS.read_text(encoding="utf-8"))
    for line in table(found)[2:]:
        name = line.split(" | ")[0].removeprefix("| ")
        assert line.endswith("| yes |") is found[name]["met"]
