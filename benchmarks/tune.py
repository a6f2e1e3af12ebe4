"""Tuning: throughput of the engine, rollouts a second, and what is gained on scenes."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml

from benchmarks.front import planned, rollouts, settled_rollouts
from benchmarks.robustness import SCENES
from drapeplan.cell import read_sources
from drapeplan.engine import Engine
from drapeplan.noise import Spread, draw
from drapeplan.planner import make_plan
from drapeplan.robustness import make_course
from drapeplan.rolling import Course, roll
from drapeplan.scene import Scene, scene_from
from drapeplan.trial import Question, Trials

TUNED = ("saddle (-1.5, 1.8)", "KinDrape 0.3 x 1.0 m", "ridge", "step")
EFFORT = {"budget": 64, "samples": 16, "held-out": 200}
QUICK = {"budget": 8, "samples": 4, "held-out": 20}
PACES = {"one sample": 1e-9, "0.2 s": 0.2, "1 s": 1.0}  # of a batch
SAMPLES = 256
WORKERS = (1, 2)


class Timed:
    """Samples of a plan, each with the time that it took."""

    def __init__(self, course: Course, spread: Spread) -> None:
        """Take what all samples share."""
        self.course, self.spread = course, spread

    def __call__(self, index: int) -> float:
        """Seconds of a sample."""
        start = time.perf_counter()
        poses, cups = self.course.rests.fixed.shape
        roll(self.course, draw(0, index, cups, poses), self.spread)
        return time.perf_counter() - start


def run(quick: bool) -> dict:
    """Engine, trials, rollouts, scenes."""
    case, repeats = planned(), 2 if quick else 20
    result: dict[str, Any] = {"cores": os.cpu_count(), "load": os.getloadavg()[0]}
    result |= rollouts(case, repeats) | settled_rollouts(case, repeats)
    result["engine"] = engine_rows(32 if quick else SAMPLES)
    result["trial"] = trial_rows()
    names = TUNED[:1] if quick else TUNED
    result["scenes"] = {name: gain(name, QUICK if quick else EFFORT) for name in names}
    return result


def engine_rows(samples: int) -> dict[str, Any]:
    """Samples a second by workers and size of batches, and what is not work."""
    read = scene("convex (1, 2)", fidelity="kinematic")
    spread = Spread.of(read.uncertainty)
    course = make_course(make_plan(read, Path(), "benchmark").plan, spread)
    task = Timed(course, spread)
    rows: dict[str, Any] = {}
    for workers in WORKERS:
        for label, pace in PACES.items():
            with Engine(workers, pace=pace) as engine:
                engine.map(task, range(2 * workers))  # processes and kernels are there
                batches: list[int] = []
                start = time.perf_counter()
                took = engine.map(
                    task, range(samples), lambda k, _, b=batches: b.append(len(k))
                )
                wall = time.perf_counter() - start
            rows[f"{workers} at work, batches of {label}"] = {
                "samples_per_s": samples / wall,
                "largest_batch": max(batches),
                "overhead_share": 1 - sum(took) / (wall * workers),
            }
    return rows


def trial_rows() -> dict[str, float]:
    """Processor seconds of a path with 16 samples, by fidelity."""
    read = scene("saddle (-1.5, 1.8)")
    sources = read_sources(read, Path())
    rows = {}
    for fidelity in ("kinematic", "equilibrium"):
        trials = Trials(read, sources, 0, fidelity)
        trials(Question(read.path, (0,), "search"))
        path = read.path.model_copy(update={"bend_mm": 130.0})
        for count in (1, 16):
            start = time.process_time()
            trials(Question(path, tuple(range(count)), "search"))
            rows[f"{fidelity}_{count}_s"] = time.process_time() - start
            path = read.path.model_copy(update={"bend_mm": 125.0})
    return rows


def gain(name: str, effort: dict[str, int], workers: int = 2) -> dict[str, Any]:
    """P before and after tuning a scene, by the command itself."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "scene.yaml"
        data = scene(name).model_dump(mode="json", exclude_defaults=True)
        file.write_text(yaml.safe_dump({"format": "drapeplan-scene/1", **data}))
        command = [sys.executable, "-m", "drapeplan", "tune", str(file), "--json"]
        command += ["-o", f"{folder}/tuned.yaml", "--workers", str(workers)]
        command += ["--rollouts", f"{folder}/rollouts.parquet"]
        command += [x for k, v in effort.items() for x in (f"--{k}", str(v))]
        start = time.perf_counter()
        ended = subprocess.run(command, capture_output=True, text=True, check=False)
        wall = time.perf_counter() - start
    if ended.returncode not in (0, 1):
        return {"failed": ended.stderr}
    found = json.loads(ended.stdout)
    if "gain" not in found:
        return {"refused": found["error"], "wall_s": wall}
    chosen = next(one for one in found["finalists"] if one["chosen"])
    row = {**found["gain"], "taken": chosen["name"], "wall_s": wall}
    row |= {"trials": found["trials"], "set": chosen["path"]}
    print(name, json.dumps(row), file=sys.stderr)
    return row


def scene(name: str, **sections: Any) -> Scene:
    """A scene of the robustness benchmark, with the rigid tool."""
    surface, take_up = SCENES[name]
    data = {"format": "drapeplan-scene/1", "mold": {"surface": surface}}
    return scene_from({**data, "ply": {"take_up_mm": take_up}, **sections}, name)
