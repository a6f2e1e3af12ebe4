"""Scenes with what was identified, as new files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import yaml

from drapeplan.files import write_text
from drapeplan.reading import read_yaml
from drapeplan.scene import scene_from

PATHS = (("mold", "mesh", "path"), ("robot", "urdf"), ("tool", "urdf"))


def write_scene(
    output: Path, found: dict[str, dict[str, float]], scene: Path | None, origin: str
) -> None:
    """Write a scene with sections brought up to date, or the sections alone.

    Args:
        output: File to write.
        found: Values by section and key.
        scene: Scene that the other keys are taken from, or None for none; paths in it
            are written as seen from the output's folder.
        origin: What the values were found in, for a comment.

    Raises:
        InputError: The scene does not hold with those values, or a file cannot be read
            or written.
    """
    data: dict[str, Any] = read_yaml(scene) if scene else {}
    if scene:
        scene_from(data, str(scene))  # its own mistakes first
        for path in PATHS:
            _move(data, path, scene.parent, output.parent)
    for section, values in found.items():
        if values:
            data[section] = {**(data.get(section) or {}), **values}
    if scene:
        scene_from(data, str(output))
    head = f"# {' and '.join(found)}: identified from {origin}\n"
    text = yaml.safe_dump(data, sort_keys=False, allow_unicode=True)
    write_text(output, head + text)


def _move(data: dict[str, Any], keys: tuple[str, ...], old: Path, new: Path) -> None:
    """A path of the scene as seen from another folder, where it has that path."""
    *sections, last = keys
    place: Any = data
    for key in sections:
        place = (place or {}).get(key)
    if place and place.get(last) and not os.path.isabs(place[last]):
        place[last] = Path(os.path.relpath(old / place[last], new)).as_posix()
