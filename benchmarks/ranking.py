"""Rank tables of start cups and patterns, and what ranking takes.

The scenes of the robustness benchmark and those of examples/ that leave a choice; the
tool, path, noise and fidelity are the defaults of a scene.
"""

import json
import os
import sys
import time
from pathlib import Path

from benchmarks.robustness import SCENES
from drapeplan.engine import Engine
from drapeplan.errors import InfeasibleError
from drapeplan.plan_file import CandidateRow
from drapeplan.ranking import rank_scene
from drapeplan.scene import Scene, read_scene, scene_from

EXAMPLES = Path(__file__).parent.parent / "examples"
SHIPPED = ("panel", "kindrape", "saddle", "paraboloid", "channel")
QUICK = ("panel",)
KEPT = (  # of a row
    *("start", "pattern", "fidelity", "good", "refused", "not_good", "samples"),
    *("wrong", "low_margin_mm", "margin_mm", "penetration_mm", "stroke_mm"),
    *("largest_shear_deg", "take_up_left_mm", "steps", "time_s"),
)


def run(quick: bool) -> dict:
    """Tables by scene."""
    chosen = [name for name in scenes() if not quick or name in QUICK]
    result: dict = {"aim_s": 60, "workers": 2}
    for name in chosen:
        result[name] = ranked(scenes()[name])
        print(name, json.dumps(result[name]), file=sys.stderr)
    return result


def scenes() -> dict[str, Scene]:
    """Scenes by name."""
    found = {name: read_scene(EXAMPLES / f"{name}.yaml") for name in SHIPPED}
    for name, (surface, take_up) in SCENES.items():
        mold, ply = {"surface": surface}, {"take_up_mm": take_up}
        data = {"format": "drapeplan-scene/1", "mold": mold, "ply": ply}
        found[name] = scene_from(data, name)
    return found


def ranked(scene: Scene) -> dict:
    """Table of a scene, the best first; time, and the machine's load during it."""
    start = time.perf_counter()
    try:
        found = rank_scene(scene, EXAMPLES, "scene", engine=Engine(2))
    except InfeasibleError as error:
        return {"refused": str(error)}
    rows = [one.row for one in found.ranked]
    return {
        "wall_s": round(time.perf_counter() - start, 1),
        "load": round(os.getloadavg()[0], 1),
        "closely": sum(row.samples > 0 for row in rows),
        "good": sum(row.good for row in rows),
        "table": [_line(row) for row in rows],
        "rows": {str(k + 1): _figures(row) for k, row in enumerate(rows)},
    }


def _line(row: CandidateRow) -> str:
    chance = f"P {row.wrong_share:.2f}" if row.samples else row.fidelity
    answer = "good" if row.good else row.refused or ", ".join(row.not_good)
    return f"{list(row.start)} {row.pattern}: {chance}, {answer}"


def _figures(row: CandidateRow) -> dict:
    values = row.model_dump(mode="json")
    return {key: values[key] for key in KEPT}
