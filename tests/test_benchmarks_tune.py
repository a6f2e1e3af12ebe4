"""The study of what tuning gains keeps each scene as soon as it is done."""

import pytest

from benchmarks import tune
from benchmarks._kept import kept
from drapeplan.scene import read_scene


@pytest.fixture
def study(tmp_path, monkeypatch):
    """The study in a folder of the test, its tunings toys."""

    def tuned(name, effort):
        if name == "step":
            raise KeyboardInterrupt
        return {"wall_s": 1.0, "effort": effort}

    monkeypatch.setattr(tune, "RESULTS", tmp_path / "tune.json")
    monkeypatch.setattr(tune, "ROLLOUTS", tmp_path)
    monkeypatch.setattr(tune, "tuned", tuned)
    return tune


def test_a_stop_loses_no_scene_that_is_done(study):
    with pytest.raises(KeyboardInterrupt):
        study.run(False, ("ridge", "step", "panel"))
    assert list(kept(study.RESULTS)) == ["ridge"]
    study.run(False, ("panel",))
    assert list(kept(study.RESULTS)) == ["panel", "ridge"]
    study.run(True, ("saddle",))
    assert "saddle" not in kept(study.RESULTS)


@pytest.mark.parametrize("name", tune.NAMES)
def test_every_scene_can_be_read(study, name):
    read = read_scene(study.scene_file(name))
    assert read.tool.name == "drape_tool_6x8"


def test_counts_have_their_interval():
    found = tune.counted({"wrong": 5, "good": True}, 200)
    assert (found["P"], found["low"], found["high"]) == (0.025, 0.0082, 0.0574)
    assert "P" not in tune.counted({"wrong": None, "good": False}, 200)
