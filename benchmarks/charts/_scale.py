"""One point of the chart of scale, in a process of its own; prints JSON.

`python -m benchmarks.charts._scale REPEATS cups ROWS COLUMNS`, or `samples FINER`, or
`batch N`; the least time of each stage counts.
"""

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks._timing import seconds, uncollected
from benchmarks.charts._drapes import cell_of, order_of, over
from benchmarks.ply import GRID, poses
from drapeplan.contact import HIGH, judge_contact
from drapeplan.frames import inverse, moved
from drapeplan.front import Tolerance, pose_measures
from drapeplan.front_grid import FrontGrid
from drapeplan.motion import follow
from drapeplan.path import CupState
from drapeplan.planner import make_request, make_track
from drapeplan.settling import settle_path
from ply.sampling import PlySampling
from ply.weave import ply_fibers

FALL = 0.06  # [m] from the mold's middle to the farthest cup
LEAST_RADIUS = 1.5  # [m] of the mold below small tools
POSES = 4  # [-] a wave step
LIFT = 0.6  # [1/m] of the path, as in a scene
LARGE = 0.72  # [m] half a side beyond which less lift keeps within the strokes
ON_CUP, ON_SPAN = 4, 7  # intervals of 10 mm
START = 21  # cup that the front starts from
LONG = 10.0  # [s] past which a plan is not made again


def main(repeats: int, kind: str, *sizes: int) -> dict:
    """Seconds of the stages, peak memory in [MB], and what there was to do."""
    stages = {"cups": _cups, "samples": _samples, "batch": _batch}[kind](
        repeats, *sizes
    )
    status = Path("/proc/self/status").read_text("utf-8")
    peak = int(status.split("VmHWM:")[1].split()[0]) / 1024
    return {**stages, "peak_MB": peak}


def _cups(repeats: int, rows: int, columns: int) -> dict:
    """A whole plan of a tool of any size, again and again if that is quick."""
    found = _plan(rows, columns)
    spent = found["total_s"]
    for _ in range(repeats - 1):
        if spent > LONG:
            break
        again = _plan(rows, columns)
        spent += again["total_s"]
        pairs = (found["seconds"], again["seconds"])
        least = {name: min(each[name] for each in pairs) for name in pairs[0]}
        found |= _stages(least)
    return found


def _plan(rows: int, columns: int) -> dict:
    """A whole plan of a tool of any size, its frame where the arm has it."""
    half = np.array([rows - 1, columns - 1]) * 0.11 / 2
    radius = max(LEAST_RADIUS, float(half @ half) / (2 * FALL))
    surface = {"kind": "paraboloid", "radius_x_m": radius, "radius_y_m": radius}
    lift = LIFT * min(1.0, LARGE / float(half.max()))
    path = {"family": "rectangle_blend", "poses_per_step": POSES, "lift_per_m": lift}
    data = over(surface, path=path, robot={"name": "none"})
    spent: dict[str, float] = {}

    def timed(stage: str, task: Callable):
        begin = time.process_time()
        result = task()
        spent[stage] = time.process_time() - begin
        return result

    cell = timed("robot and mold", lambda: cell_of(data, (rows, columns)))
    sequence = order_of(cell)
    request = timed("net and wave", lambda: make_request(cell, sequence))
    path = request.path
    motion = timed("strokes", lambda: follow(cell, path))
    settled = timed("rest", lambda: settle_path(cell, path, motion))
    track = make_track(cell, path, settled.motion)
    held = track.held
    cups = moved(inverse(cell.world_mold), *(pose[held] for pose in track.poses))
    states = path.states[held]
    down = states == CupState.PLACED, states == CupState.LANDING
    timed("contact", lambda: judge_contact(cell, sequence, cups, *down))
    return {"count": rows * columns, "poses": len(path.tau), **_stages(spent)}


def _samples(repeats: int, finer: int) -> dict:
    """One pose of the whole ply, from the cups' poses to the margins."""
    ply = PlySampling.regular(GRID, 0.01 / finer)
    held = poses(1)
    size = len(ply.t), len(ply.s)
    grid = FrontGrid(ply.s, ply.t, ply.cup_index, ply.cups_around, GRID.columns, START)
    mold = cell_of(over({"kind": "paraboloid", "radius_x_m": 1.2, "radius_y_m": 2.5}))
    placed = np.zeros((1, GRID.n_cups), bool)
    found: dict[str, np.ndarray] = {}

    def shape() -> None:
        fibers = ply_fibers(GRID, *held, model="modal")
        found["points"] = ply.points(fibers, *held)

    def gap() -> None:
        found["gap"] = np.minimum(mold.mold.gap(found["points"], beside=HIGH), HIGH)

    def margins() -> None:
        final = np.zeros(size)
        pose_measures(found["gap"], final, grid, placed, ~placed, Tolerance())

    stages = {"ply": shape, "gap": gap, "margins": margins}
    return {"count": int(np.prod(size)), "poses": 1, **_stages(_least(stages, repeats))}


def _batch(repeats: int, count: int) -> dict:
    """Poses of the whole ply at a time: fibers and points at 10 mm."""
    ply, held = PlySampling.regular(GRID, 0.01), poses(count)
    found = {"fibers": ply_fibers(GRID, *held, model="modal")}
    stages = {
        "fibers": lambda: ply_fibers(GRID, *held, model="modal"),
        "points": lambda: ply.points(found["fibers"], *held),
    }
    each = {name: s / count for name, s in _least(stages, repeats).items()}
    return {"count": count, "poses": count, **_stages(each)}


def _least(stages: dict[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Least times of stages that need each other, in their order."""
    times: dict[str, list[float]] = {name: [] for name in stages}
    with uncollected():
        for _ in range(repeats + 1):  # the first one compiles
            for name, task in stages.items():
                times[name].append(seconds(task))
    return {name: min(each[1:]) for name, each in times.items()}


def _stages(spent: dict[str, float]) -> dict:
    return {"seconds": spent, "total_s": sum(spent.values())}


if __name__ == "__main__":
    print(json.dumps(main(int(sys.argv[1]), sys.argv[2], *map(int, sys.argv[3:]))))
