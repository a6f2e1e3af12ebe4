import pytest
import yaml

from drapeplan.errors import InputError
from drapeplan.scene import Scene, read_scene, scene_from
from tests.plans import EXAMPLES, PARABOLOID

GOOD = {"format": "drapeplan-scene/1", "mold": {"surface": PARABOLOID}}


def changed(path, value):
    """The good scene with one key set, given by its dotted path."""
    data = yaml.safe_load(yaml.safe_dump(GOOD))
    *folders, last = path.split(".")
    place = data
    for name in folders:
        place = place.setdefault(name, {})
    place[last] = value
    return data


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("format", "drapeplan-scene/9", ["format", "drapeplan-scene/1"]),
        ("ply.take_up_mm", -1, ["ply.take_up_mm", "at least 0", "-1"]),
        ("ply.take_up_mm", float("inf"), ["ply.take_up_mm", "finite", "inf"]),
        ("ply.take_up_mm", float("nan"), ["ply.take_up_mm", "finite", "nan"]),
        ("ply.takeup_mm", 1, ["ply.takeup_mm", "unknown key", "take_up_mm?"]),
        ("mold.surface.radius_x_m", float("inf"), ["radius_x_m", "finite", "plane"]),
        ("mold.surface.radius_x_m", 0, ["mold.surface", "radius of 0"]),
        ("mold.surface.kind", "torus", ["mold.surface", "torus", "paraboloid"]),
        ("mold.mesh", {"path": "a.stl", "unit": "mm"}, ["mold", "either"]),
        ("mold.position_m", [0, 0], ["mold.position_m", "missing"]),
        ("mold.grid_step_mm", 0.001, ["mold.grid_step_mm", "at least 1"]),
        ("sequence.start", [-1, 2], ["sequence.start.0", "at least 0"]),
        ("path.family", "spiral", ["path", "spiral", "rectangle_blend"]),
        ("path", {"family": "hover", "height_mm": 0}, ["path.height_mm", "than 0"]),
        ("robot", {"name": "ur10", "urdf": "x.urdf"}, ["robot", "either"]),
        ("path", {"family": "radial", "bend_mm": 0}, ["path.bend_mm", "than 0"]),
        (
            "path",
            {"family": "rectangle_blend", "rim_offset_mm": -30},
            ["path.rim_offset_mm", "at least -20"],
        ),
        (
            "path",
            {"family": "rectangle_blend", "lift_per_m": [0.5, 0]},
            ["path.lift_per_m: must be one number or a pair", "greater than 0"],
        ),
        (
            "path",
            {"family": "rectangle_blend", "lift_per_m": [0.5, 0.6, 0.7]},
            ["path.lift_per_m: must be one number or a pair", "at most 5"],
        ),
        ("path", {"family": "radial", "lift_per_m": 5.1}, ["lift_per_m", "at most 5"]),
        (
            "path",
            {"family": "radial", "rim_offset_mm": 5},
            ["path.rim_offset_mm: is not a key of radial (found 5); remove it"],
        ),
        ("rim_offset_mm", 5, ["rim_offset_mm: is not a key of this place"]),
        ("sequence.pattern", "radial", ["pattern radial needs path.family"]),
        ("lead", {"toe_up_deg": 1}, ["lead", "unknown key"]),
        ("seed", -3, ["seed", "at least 0"]),
    ],
)
def test_bad_value_gets_one_line_that_names_the_key(path, value, words):
    with pytest.raises(InputError) as caught:
        scene_from(changed(path, value), "scene.yaml")
    line = str(caught.value)
    assert line.startswith("scene.yaml: ")
    assert "\n" not in line
    assert all(word in line for word in words), line
    assert caught.value.exit_code == 2


def test_defaults_are_filled_in_and_written_out_again():
    scene = scene_from(GOOD, "scene.yaml")
    data = scene.model_dump(mode="json")
    assert data["ply"]["take_up_mm"] == 0.8
    assert data["tool"]["name"] == "drape_tool_6x8"
    assert Scene.model_validate(data) == scene


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.yaml")), ids=lambda p: p.stem)
def test_examples_are_scenes(path):
    assert read_scene(path).format == "drapeplan-scene/1"


@pytest.mark.parametrize(
    ("text", "word"),
    [("a: [1", "line"), ("- 1\n- 2", "holds no keys"), ("", "holds no keys")],
)
def test_text_that_is_no_scene(tmp_path, text, word):
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=word):
        read_scene(path)


def test_missing_file(tmp_path):
    with pytest.raises(InputError, match="cannot read it"):
        read_scene(tmp_path / "none.yaml")


def test_binary_file(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not a text file"):
        read_scene(path)


@pytest.mark.parametrize("sequence", [[1], "middle", 3])
def test_the_radial_family_meets_a_sequence_that_is_none(sequence):
    data = GOOD | {"path": {"family": "radial"}, "sequence": sequence}
    with pytest.raises(InputError, match="sequence"):
        scene_from(data, "scene.yaml")


def test_the_radial_family_brings_its_order():
    scene = scene_from(GOOD | {"path": {"family": "radial"}}, "scene.yaml")
    assert scene.sequence.pattern == "radial"
    assert Scene.model_validate(scene.model_dump(mode="json")) == scene
