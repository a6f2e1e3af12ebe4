"""Benchmarks by name; rankings are kept scene by scene, and printed as a page."""

import json
import re
from pathlib import Path

import pytest

from benchmarks import __main__ as command
from benchmarks import _choosing, _kept, mold, plan, ranking
from drapeplan.errors import InfeasibleError
from drapeplan.plan_file import CandidatesBlock
from tests.toy_rows import row

FOLDER = Path(command.__file__).parent
ROWS = [
    row((3, 2), wrong=0, time_s=21.0),
    row((3, 0), wrong=0, time_s=40.0),
    row((0, 0), good=False, not_good=["touch"], wrong=9, time_s=9.0),
    row((0, 1), samples=0, fidelity="kinematic"),
]


class Ranked:
    """What ranking would find."""

    def block(self):
        return CandidatesBlock(samples=64, seed=0, rows=ROWS)


def test_every_benchmark_is_a_short_one_or_a_study():
    modules = {p.stem for p in FOLDER.glob("*.py") if not p.stem.startswith("_")}
    assert sorted((*command.SHORT, *command.STUDIES)) == sorted(modules)


def test_what_fails_stops_no_other_and_times_are_kept(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(command, "TOOK", tmp_path / "took.json")
    command.TOOK.write_text('{"old": 7}')
    monkeypatch.setattr(command, "GROUPS", {"all": ("mold", "plan")})
    monkeypatch.setattr(mold, "run", lambda quick: 1 / 0)
    monkeypatch.setattr(plan, "run", lambda quick: {"a_s": 1.5})
    assert command.main(["all", "--json"]) == 1
    told = capsys.readouterr()
    assert json.loads(told.out) == {"plan": {"a_s": 1.5}}
    assert "failed: mold" in told.err
    assert json.loads(command.TOOK.read_text()) == {"old": 7, "plan": 0}
    assert command.main(["plan", "--quick"]) == 0
    assert "plan, 0 s the last time" in capsys.readouterr().err
    with pytest.raises(ZeroDivisionError):
        command.main(["mold"])


def test_unknown_scenes_are_named(capsys):
    for words in (["ranking", "nope"], ["mold", "panel"]):
        with pytest.raises(SystemExit) as stop:
            command.main(words)
        assert stop.value.code == 2
    said = capsys.readouterr().err
    assert "no scene is called nope: panel, " in said
    assert "mold has no scenes to choose from" in said


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """Rankings of toys, kept in a folder of the test."""

    def rank_scene(scene, *rest):
        if scene == "ridge":
            raise InfeasibleError("no room", 1.0, "none")
        if scene == "step":
            raise KeyboardInterrupt
        return Ranked()

    monkeypatch.setattr(ranking, "RESULTS", tmp_path / "ranking.json")
    monkeypatch.setattr(ranking, "scene", lambda name: name)
    monkeypatch.setattr(ranking, "rank_scene", rank_scene)
    monkeypatch.setattr(ranking, "made_with", lambda **_: {})
    return lambda: _kept.kept(ranking.RESULTS)


def test_a_stop_loses_no_scene_that_is_done(kept):
    with pytest.raises(KeyboardInterrupt):
        ranking.run(False, ("ridge", "step", "panel"))
    assert list(kept()) == ["ridge"]
    ranking.run(False, ("panel",))
    assert list(kept()) == ["panel", "ridge"]
    ranking.run(True, ("saddle",))
    assert "saddle" not in kept()


def test_the_page_shows_what_was_looked_at_closely(kept):
    ranking.run(False, ("panel", "ridge"))
    page = _choosing.page()
    assert re.search(
        r"\| panel \| \[3, 2\] all_sides \| 0\.00 .*\| 21 \| 3 of 4 ", page
    )
    assert "| ridge | none: no room" in page
    assert "| **1** | 3, 2 | all_sides | yes | 0.00" in page
    assert "| 2 | 3, 0 |" in page
    assert "| 3 | 0, 0 | all_sides | no: touch |" in page
    assert "| 0, 1 |" not in page


def test_the_page_is_the_one_in_docs():
    page = (FOLDER.parent / "docs" / "choosing.md").read_text(encoding="utf-8")
    assert page == _choosing.page()
