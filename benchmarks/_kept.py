"""What studies keep, scene by scene, so that a stop loses nothing."""

import json
from collections.abc import Sequence
from pathlib import Path

from drapeplan.files import write_text


def kept(file: Path) -> dict[str, dict]:
    """What was written last, by scene.

    Args:
        file: JSON of a study.
    """
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}


def keep(file: Path, name: str, found: dict, names: Sequence[str]) -> None:
    """Put a scene's results among those of the others.

    Args:
        file: JSON of a study.
        name: Scene.
        found: Its results.
        names: All scenes, in their order; the file's others are dropped.
    """
    every = kept(file) | {name: found}
    ordered = {key: every[key] for key in names if key in every}
    write_text(file, json.dumps(ordered, indent=1, allow_nan=False) + "\n")
