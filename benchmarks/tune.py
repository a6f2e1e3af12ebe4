"""What tuning gains: P(wrong order) before and after, on samples that chose nothing.

The scenes of the robustness benchmark on which the order is at risk, and examples; each
is tuned by the command itself, single steps at last, and written as soon as it is done.
The simulations stay in build/tune, one file a scene: what a surrogate learns from is
what somebody who tunes has.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from benchmarks._kept import keep
from benchmarks.charts.results import made_with
from benchmarks.robustness import SCENES
from drapeplan.errors import InputError
from drapeplan.intervals import share_interval
from drapeplan.rollout_file import read_rollouts
from drapeplan.surrogate import fit_surrogate

ROOT = Path(__file__).parent.parent
RESULTS = Path(__file__).parent / "results" / "tune.json"
ROLLOUTS = ROOT / "build" / "tune"
SHIPPED = ("panel", "saddle", "kindrape")  # of examples/
AT_RISK = (
    "saddle (-1.5, 1.8)",
    "saddle (-1, 2)",
    "KinDrape 0.3 x 1.0 m",
    "ridge",
    "step",
    "concave R = -1",
)
NAMES = (*SHIPPED, *AT_RISK)  # that can be asked for
EFFORT = {"budget": 32}  # half of the default: four minutes a scene on two cores
QUICK = {"budget": 8, "samples": 4, "held-out": 20}
WORKERS = 2


def run(quick: bool, names: Sequence[str] = NAMES) -> dict:
    """Gain by scene; quick: a few simulations of the first, which are not kept."""
    result: dict = {}
    for name in names[:1] if quick else names:
        found = result[name] = tuned(name, QUICK if quick else EFFORT)
        if not quick:
            keep(RESULTS, name, found, NAMES)
        print(name, json.dumps(found), file=sys.stderr)
    result["one surrogate of all these"] = learned([*map(rollouts, result)])
    return result


def tuned(name: str, effort: dict[str, int]) -> dict[str, Any]:
    """A scene before and after tuning; time, and the machine's load."""
    ROLLOUTS.mkdir(parents=True, exist_ok=True)
    file, scene = rollouts(name), scene_file(name)
    file.unlink(missing_ok=True)
    command = [sys.executable, "-m", "drapeplan", "tune", str(scene), "--json"]
    command += ["-o", str(file.with_suffix(".yaml")), "--rollouts", str(file)]
    by_step = [] if effort is QUICK else ["--per-step"]
    command += ["--workers", str(WORKERS), *by_step]
    command += [x for k, v in effort.items() for x in (f"--{k}", str(v))]
    start = time.perf_counter()
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    row: dict[str, Any] = {
        "wall_s": round(time.perf_counter() - start, 1),
        "workers": WORKERS,
        "load": round(os.getloadavg()[0], 1),
        "effort": effort,
        "made": made_with(quick=effort is QUICK),
    }
    if ended.returncode not in (0, 1):
        return row | {"failed": ended.stderr}
    found = json.loads(ended.stdout)
    if "gain" not in found:
        return row | {"refused": found["error"]}
    gain, chosen = found["gain"], next(f for f in found["finalists"] if f["chosen"])
    row |= {k: counted(gain[k], gain["samples"]) for k in ("before", "after")}
    row |= {"taken": chosen["name"], "trials": found["trials"]}
    row |= {key: chosen[key] for key in ("path", "toe_up_steps")}
    return row | {"finalists": found["finalists"], "surrogate": learned([file])}


def counted(found: dict[str, Any], samples: int) -> dict[str, Any]:
    """Share in the wrong order with its interval; none where there is no plan."""
    if found["wrong"] is None:
        return found
    low, high = (round(end, 4) for end in share_interval(found["wrong"], samples))
    share = {"P": found["wrong"] / samples, "low": low, "high": high}
    return found | share | {"samples": samples}


def learned(files: list[Path]) -> dict[str, Any]:
    """How well a surrogate knows margins of trials held out, beside their mean."""
    tables = [read_rollouts(file)[1] for file in files if file.exists()]
    try:
        found = fit_surrogate([row for table in tables for row in table.to_pylist()])
    except InputError as error:
        return {"refused": str(error)}
    return {"error_mm": round(found.error, 4), "naive_mm": round(found.naive, 4)}


def rollouts(name: str) -> Path:
    """File of a scene's simulations."""
    kept = "".join(c if c.isalnum() or c in ".-" else "_" for c in name)
    return ROLLOUTS / f"{kept}.parquet"


def scene_file(name: str) -> Path:
    """A scene's file; those that are no example are written, with the rigid tool."""
    if name in SHIPPED:
        return ROOT / "examples" / f"{name}.yaml"
    surface, take_up = SCENES[name]
    data = {"format": "drapeplan-scene/1", "mold": {"surface": surface}}
    file = rollouts(name).with_suffix(".scene.yaml")
    file.write_text(yaml.safe_dump(data | {"ply": {"take_up_mm": take_up}}))
    return file
