"""Rank tables of start cups and patterns, and what ranking takes.

The scenes of the robustness benchmark and those of examples/ that leave a choice; the
tool, path, noise and fidelity are the defaults of a scene. Each scene is written as
soon as it is done; `python -m benchmarks._choosing` prints docs/choosing.md from them.
"""

import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks._kept import keep
from benchmarks.charts.results import made_with
from benchmarks.robustness import SCENES
from drapeplan.engine import Engine
from drapeplan.errors import InfeasibleError
from drapeplan.plan_file import CandidatesBlock
from drapeplan.ranking import rank_scene
from drapeplan.ranking_words import cells
from drapeplan.scene import Scene, read_scene, scene_from

EXAMPLES = Path(__file__).parent.parent / "examples"
RESULTS = Path(__file__).parent / "results" / "ranking.json"
SHIPPED = ("panel", "kindrape", "saddle", "paraboloid", "channel")
NAMES = (*SHIPPED, *SCENES)  # that can be asked for
WORKERS = 2


def run(quick: bool, names: Sequence[str] = NAMES) -> dict:
    """Tables by scene; quick: a few samples of the first, which are not kept."""
    result: dict = {}
    for name in names[:1] if quick else names:
        found = ranked(scene(name), 4 if quick else 64)
        if not quick:
            keep(RESULTS, name, found, NAMES)
        result[name] = {k: v for k, v in found.items() if k not in ("made", "block")}
        if "block" in found:
            result[name]["table"] = table(CandidatesBlock(**found["block"]))
        print(name, json.dumps(result[name]), file=sys.stderr)
    return result


def scene(name: str) -> Scene:
    """A scene by its name."""
    if name in SHIPPED:
        return read_scene(EXAMPLES / f"{name}.yaml")
    surface, take_up = SCENES[name]
    mold, ply = {"surface": surface}, {"take_up_mm": take_up}
    return scene_from({"format": "drapeplan-scene/1", "mold": mold, "ply": ply}, name)


def ranked(read: Scene, samples: int) -> dict:
    """Candidates of a scene as a plan keeps them; time, and the machine's load."""
    start = time.perf_counter()
    found: dict = {"made": made_with(quick=False)}
    try:
        ranking = rank_scene(read, EXAMPLES, "scene", Engine(WORKERS), samples)
        found["block"] = ranking.block().model_dump(mode="json")
    except InfeasibleError as error:
        found["refused"] = str(error)
    wall = round(time.perf_counter() - start, 1)
    load = round(os.getloadavg()[0], 1)
    return {"wall_s": wall, "workers": WORKERS, "load": load, **found}


def table(block: CandidatesBlock) -> list[str]:
    """The candidates in lines, the best first."""
    return ["  ".join(cells(row)) for row in block.rows]
