"""Tuned: a scene tells what tuning gained, as long as its path is the tuned one."""

from drapeplan.families import RectangleBlendPath
from drapeplan.scene import TunedSection, scene_from
from drapeplan.tuned import path_hash, tuned_lines
from tests.plans import scene

PATH = RectangleBlendPath(lift_per_m=(0.4, 0.5))
COUNTS = {"before": {"wrong": 40, "good": False}, "after": {"wrong": 5, "good": True}}


def tuned_scene(path=PATH, **counts):
    """A scene that says it was tuned for PATH."""
    tuned = TunedSection(samples=200, path=path_hash(PATH), **{**COUNTS, **counts})
    return scene(path=path.model_dump(), tuned=tuned.model_dump())


def test_gain_is_told_with_its_bounds():
    (line,) = tuned_lines(tuned_scene())
    assert "before P(wrong order) 0.200 (0.147 to 0.262), the plan itself not" in line
    assert "after P(wrong order) 0.025 (0.008 to 0.057)." in line


def test_no_plan_has_no_share():
    assert (
        "before no plan;"
        in tuned_lines(tuned_scene(before={"wrong": None, "good": False}))[0]
    )


def test_another_path_says_so():
    other = PATH.model_copy(update={"bend_mm": 121.0})
    assert "changed since" in tuned_lines(tuned_scene(other))[0]


def test_nothing_is_said_of_other_scenes():
    assert tuned_lines(scene()) == []


def test_the_hash_survives_the_file():
    read = tuned_scene()
    again = scene_from(read.model_dump(mode="json"), "test")
    assert path_hash(again.path) == read.tuned.path
