"""Scene text: what is not changed stays as it was written."""

import pytest
import yaml

from drapeplan.scene import read_scene
from drapeplan.scene_text import write_scene_like

HEAD = "format: drapeplan-scene/1\nmold: {surface: {kind: plane}}  # flat\n"
NEW = {"path": {"family": "rectangle_blend", "lift_per_m": [0.7, 0.8]}}
BLOCK = """path:  # rolled
  family: rectangle_blend
  lift_per_m:
  - 0.5
  - 0.5

# of the ply
ply: {take_up_mm: 0.7}  # measured
"""
FLOW = "path: {family: rectangle_blend,\n  bend_mm: 100}  # rolled\nseed: 3\n"
LAST = "seed: 3  # drawn\npath:\n  family: hover\n  height_mm: 5"


@pytest.mark.parametrize("rest", [BLOCK, FLOW, LAST, "seed: 3", ""])
def test_rest_stays_as_written(tmp_path, rest):
    scene, output = tmp_path / "a.yaml", tmp_path / "b.yaml"
    scene.write_text(HEAD + rest)
    assert write_scene_like(output, scene, NEW)
    text, read = output.read_text(), read_scene(output)
    assert read.path.lift_per_m == (0.7, 0.8)
    before = read_scene(scene)
    assert read.model_copy(update={"path": before.path}) == before
    for line in (HEAD + rest).splitlines():
        if "#" in line and not line.startswith(("path", "  bend")):
            assert line in text


def test_sections_are_added(tmp_path):
    scene, output = tmp_path / "a.yaml", tmp_path / "b.yaml"
    scene.write_text(HEAD)
    counted = {"wrong": 1, "good": True}
    tuned = {"samples": 9, "before": counted, "after": counted, "path": "sha256:1"}
    assert write_scene_like(output, scene, {**NEW, "tuned": tuned})
    assert read_scene(output).tuned.samples == 9
    assert write_scene_like(scene, output, NEW)
    assert read_scene(scene).tuned.samples == 9


@pytest.mark.parametrize(
    "text",
    [
        '{"format": "drapeplan-scene/1", "mold": {"surface": {"kind": "plane"}}}',
        HEAD + "motion: {lift_mm: &h 100.0, clearance_mm: *h}\n",
    ],
)
def test_what_is_not_simple_is_written_plainly(tmp_path, text):
    scene, output = tmp_path / "a.yaml", tmp_path / "b.yaml"
    scene.write_text(text)
    assert not write_scene_like(output, scene, NEW)
    expected = {**yaml.safe_load(text), **NEW}
    assert yaml.safe_load(output.read_text()) == expected


def test_files_are_named_as_seen_from_the_output(tmp_path):
    scene, output = tmp_path / "a.yaml", tmp_path / "deep" / "b.yaml"
    mesh = "  mesh: {path: molds/panel.stl, unit: mm}  # scanned\n"
    scene.write_text("format: drapeplan-scene/1\nmold:\n" + mesh)
    assert write_scene_like(output, scene, NEW)
    assert read_scene(output).mold.mesh.path == "../molds/panel.stl"
    assert "# scanned" in output.read_text()
