"""The engine: throughput by workers and size of batches, and what is no work.

The work are samples of a plan under uncertainty, 10 to 30 ms each. Overhead is the
share of the workers' time in which none of them works: packing, handing over, and the
end, where one waits for another. Beside it: rollouts on one thread, and the memory of
a worker.
"""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any

import loky
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks import front
from benchmarks.charts._drapes import cell_of, order_of, over
from benchmarks.charts.drawing import WIDTH, legend, look, scatter, upright
from benchmarks.charts.results import Results, made_with
from drapeplan.candidates import Candidate
from drapeplan.cell import Cell
from drapeplan.engine import Engine
from drapeplan.noise import Spread
from drapeplan.noise import draw as numbers
from drapeplan.orders import SequenceSection
from drapeplan.planner import plan_drape
from drapeplan.ranking import Judge
from drapeplan.robustness import make_course
from drapeplan.rolling import Course, roll
from drapeplan.trial import Question, Trials

SURFACE = {"kind": "paraboloid", "radius_x_m": 1.0, "radius_y_m": 2.0}
PACES = (1e-9, 0.1, 0.25, 1.0)  # [s] of work in a batch
WORKERS, SAMPLES, ROUNDS = 2, 192, 3
SMALL = (4, 3)  # rows and columns of the tool when quick
ASKED = 500  # [1/s] rollouts from given poses that one thread should do
HERE, PROCESSES = "1, in this process", f"{WORKERS} processes"
DASK = f"{WORKERS} on a Dask cluster"
CREWS = (HERE, PROCESSES, DASK)
RATES = {
    "given poses": "a wave step, from given poses of the cups",
    "tool at rest": "a wave step, from strokes: the tool settles",
    "whole plan": "a whole plan under uncertainty",
}


@dataclass(frozen=True)
class Timed:
    """Samples of a plan, each with the time that it took."""

    course: Course
    spread: Spread

    def __call__(self, index: int) -> float:
        """Seconds of a sample."""
        start = time.perf_counter()
        poses, cups = self.course.rests.fixed.shape
        roll(self.course, numbers(0, index, cups, poses), self.spread)
        return time.perf_counter() - start


@dataclass(frozen=True)
class Weighed:
    """A task that answers with the peak memory of who does it."""

    task: Callable[[Any], Any]

    def __call__(self, item: Any) -> float:
        """Megabytes of this process, libraries included, after an item."""
        self.task(item)
        status = Path("/proc/self/status").read_text("utf-8")
        return int(status.split("VmHWM:")[1].split()[0]) / 1024


def measure(quick: bool) -> Results:
    """Throughput and overhead, rollouts a second, memory."""
    task, missing = _samples(quick), {}
    crews = [HERE, PROCESSES]
    if quick:
        missing[DASK] = "left out of quick runs"
    elif not find_spec("distributed"):
        missing[DASK] = "not installed: pip install 'drapeplan[cluster]'"
    else:
        crews.append(DASK)
    rows = _rates(task, quick) + _crews(task, crews, quick)
    if Path("/proc/self/status").exists():
        rows += _memory(task, quick)
    else:
        missing["memory of a worker"] = "needs /proc"
    return Results(
        "engine", rows, made_with("loky", "distributed", quick=quick), missing
    )


def draw(results: Results) -> Figure:
    """Throughput and overhead by size of batches; rates and memory as bars."""
    figure = Figure(figsize=(WIDTH, 5.2), layout="constrained")
    panels = figure.subplots(2, 2)
    titles = {"samples_per_s": "samples a second", "overhead": "overhead"}
    for axes, (key, title) in zip(panels[0], titles.items(), strict=True):
        most = max(row[key] for row in results.where(set="crew"))
        axes.set(title=title, xscale="log", ylim=(min(0, most), 1.15 * abs(most)))
        axes.set_xlabel("samples in the largest batch")
        axes.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
        for k, crew in enumerate(CREWS):
            rows = results.where(set="crew", method=crew)
            x, y = ([row[name] for row in rows] for name in ("batch", key))
            if rows:
                scatter(axes, x, y, crew, k, joined=True)
    panels[0, 1].yaxis.set_major_formatter(lambda y, _: f"{100 * y:g} %")
    rows = results.where(set="rate")
    left, right = panels[1]
    _bars(left, [(RATES[row["method"]], row["per_s"]) for row in rows])
    left.set(title="rollouts a second on one thread", xscale="log")
    left.set_xlim(left=1)
    upright(left, ASKED, "aim")
    rows = results.where(set="memory")
    _bars(right, [(row["method"], row["peak_MB"]) for row in rows])
    right.set_title("memory of a worker [MB], libraries included")
    legend(figure)
    return figure


def _bars(axes: Axes, named: list[tuple[str, float]]) -> None:
    """Bars with name and value above each."""
    values = [value for _, value in named]
    bars = axes.barh(range(len(named)), values, 0.35, color=look(len(CREWS))["color"])
    axes.set(yticks=[], ylim=(max(len(named), 3) - 0.5, -0.8))
    axes.grid(axis="y", visible=False)
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}
    place: dict[str, Any] = {"fontsize": 8, "va": "bottom", "bbox": box}
    for bar, (name, value) in zip(bars, named, strict=True):
        at = 0.01, bar.get_y() - 0.02
        text = f"{name}: {value:.0f}" if value >= 100 else f"{name}: {value:.3g}"
        axes.annotate(text, at, xycoords=("axes fraction", "data"), **place)


def _samples(quick: bool) -> Timed:
    """What is handed out: samples of a kinematic plan."""
    data = over(SURFACE, fidelity="kinematic")
    cell = cell_of(data, SMALL if quick else None)
    made = plan_drape(cell, order_of(cell))
    plan = made.plan.known(cell, (made.plan.verdict, made.contact))
    spread = Spread.of(cell.scene.uncertainty)
    return Timed(make_course(plan, spread), spread)


def _rates(task: Timed, quick: bool) -> list[dict]:
    """Rollouts a second and thread."""
    case, repeats = front.planned(), 1 if quick else 10
    found = front.rollouts(case, repeats) | front.settled_rollouts(case, repeats)
    indices = iter(range(repeats + 2))
    rates = {
        "given poses": found["rollouts_per_s"],
        "tool at rest": found["settled_rollouts_per_s"],
        "whole plan": 1 / front.thread_time(lambda: task(next(indices)), repeats),
    }
    return [{"set": "rate", "method": name, "per_s": x} for name, x in rates.items()]


def _crews(task: Timed, crews: list[str], quick: bool) -> list[dict]:
    """Every crew with every size of batches, in turns; medians of the rounds."""
    samples = 32 if quick else SAMPLES
    found: dict[tuple[str, float], list[dict]] = {}
    for _ in range(1 if quick else ROUNDS):
        for crew in crews:
            paces = PACES[:1] if crew == HERE else PACES[:: 2 if quick else 1]
            for pace in paces:
                row = _at_work(task, crew, pace, samples)
                found.setdefault((crew, pace), []).append(row)
    return [
        {"set": "crew", "method": crew, "setting": f"{pace:g} s", "samples": samples}
        | {name: median(row[name] for row in rows) for name in rows[0]}
        for (crew, pace), rows in found.items()
    ]


def _at_work(task: Timed, crew: str, pace: float, samples: int) -> dict:
    """Samples a second of a crew, their batches, and the share that is not work."""
    with _engine(crew, pace) as engine:
        engine.map(task, range(2 * engine.workers))  # processes and kernels are there
        batches: list[int] = []
        start = time.perf_counter()
        took = engine.map(task, range(samples), lambda k, _: batches.append(len(k)))
        wall = time.perf_counter() - start
    return {
        "batch": max(batches),
        "samples_per_s": samples / wall,
        "overhead": 1 - sum(took) / (wall * engine.workers),
    }


@contextmanager
def _engine(crew: str, pace: float = 1.0) -> Iterator[Engine]:
    """Workers of a crew."""
    if crew != DASK:
        with Engine(1 if crew == HERE else WORKERS, pace=pace) as engine:
            yield engine
        return
    from distributed import LocalCluster

    size: dict[str, Any] = {"n_workers": WORKERS, "threads_per_worker": 1}
    quiet: dict[str, Any] = {
        "dashboard_address": None,
        "silence_logs": logging.CRITICAL,
    }
    with LocalCluster(**size, **quiet) as cluster:
        with Engine(cluster=cluster.scheduler_address, pace=pace) as engine:
            yield engine


def _memory(task: Timed, quick: bool) -> list[dict]:
    """Peak memory of workers, each with one kind of work; new ones unless quick."""
    kinds: dict[str, tuple[Callable, Any]] = {"samples of a plan": (task, 0)}
    if not quick:
        kinds |= _learning(task.course.rests.cell)
    rows = []
    for name, (work, item) in kinds.items():
        if not quick:
            loky.get_reusable_executor(WORKERS).shutdown(kill_workers=True)
        with Engine(WORKERS) as engine:
            peak = max(engine.map(Weighed(work), [item] * WORKERS))
        rows.append({"set": "memory", "method": name, "peak_MB": peak})
    return rows


def _learning(cell: Cell) -> dict[str, tuple[Callable, Any]]:
    """What rank and tune hand out, at equilibrium, with one sample."""
    scene, sources = cell.scene, cell.sources
    section = SequenceSection(start=(3, 2), pattern="all_sides")
    way = Candidate(section, ""), "equilibrium", 1
    tries = Trials(scene, sources, 0, "equilibrium"), Question(scene.path, (0,), "")
    return {
        "paths that tuning tries": tries,
        "candidates to rank": (Judge(scene, sources), way),
    }
