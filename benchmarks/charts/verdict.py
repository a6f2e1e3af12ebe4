"""The order of contact: how finely path and ply are looked at, against errors.

Drapes of a small tool, cups as planned and off by a common error of their own each, are
judged coarsely and finely; the reference is the finest of path and ply together. Tries
of one wave step, as a tuner makes them by the thousand, are judged by labels or by
floods, on a window of cups or on the whole ply; there the reference is the whole ply,
sampled finer.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from benchmarks._timing import interleaved
from benchmarks.charts._drapes import DOME, cell_of, example, over, swapped
from benchmarks.charts._sampled import LINES, Case, Poses, case_of, off_by, sampled
from benchmarks.charts.drawing import WIDTH, ends, front, legend, log_log, scatter
from benchmarks.charts.results import Results, made_with
from drapeplan import refine
from drapeplan.contact import HIGH, front_tolerance, judge_contact
from drapeplan.faults import Fault
from drapeplan.front import pose_measures
from drapeplan.legs import Array
from drapeplan.rollout import StepWindow, Surroundings

SIZE = (5, 4)  # rows and columns of the tool
SURFACES = {
    "dome": DOME,
    "saddle": {"kind": "paraboloid", "radius_x_m": 1.5, "radius_y_m": -1.8},
}
POSES = (3, 5, 10, 20)  # [-] a step; a plan has 10
PLANNED = (10, 10, True)  # poses, spacing and refinement of a plan
FINEST = (20, 2.5, True)
SEEDS = 3  # [-] errors of the cups; the first is none
SHOWN = 3e-3  # [m] margins beyond are all alike
WINDOW = range(2, 6), range(1, 5)  # rows and columns of cups of a step
STEP_POSES, TRIES = 8, 32
ROUGHER = 1.8  # [-] times larger errors in a try: half of them are to fail
ORDER = Fault.PREMATURE | Fault.AIR_POCKET
METHODS = ("path, waypoints alone", "path, refined", "ply, refined")
WAYS = (
    *("floods, whole ply", "labels, whole ply", "labels, window"),
    "labels, window that knows its surroundings",
)
FLOOR = 1e-5  # [mm] errors below are drawn there


def measure(quick: bool) -> Results:
    """Verdicts on drapes, and tries of a step."""
    rows = _drapes(quick) + _tries(quick)
    return Results("verdict", rows, made_with(quick=quick))


def draw(results: Results) -> Figure:
    """Error of margins and of depths against time; wrong verdicts of tries."""
    figure = Figure(figsize=(WIDTH, 3.6), layout="constrained")
    panels = figure.subplots(1, 3)
    rows = results.where(set="drape")
    titles = {
        "margin_error_mm": "margins to a fault",
        "depth_error_mm": "depth of penetration",
    }
    for axes, (key, title) in zip(panels, titles.items(), strict=False):
        log_log(axes, title, "time of a verdict [ms]", "mean error [mm]")
        for k, method in enumerate(METHODS):
            own = [row for row in rows if row["method"] == method]
            notes = ends([str(row["setting"]) for row in own])
            x, y = [row["ms"] for row in own], [max(row[key], FLOOR) for row in own]
            scatter(axes, x, y, method, k, joined=True, notes=notes)
        front(axes, [row["ms"] for row in rows], [max(row[key], FLOOR) for row in rows])
    axes, rows = panels[2], results.where(set="tries")
    title = f"{rows[0]['tries']} tries of a wave step"
    log_log(axes, title, "tries a second", "wrong verdicts")
    axes.set(yscale="linear")
    axes.yaxis.set_major_locator(MultipleLocator(0.05))
    axes.yaxis.set_major_formatter(lambda x, _: f"{100 * x:.0f} %")
    for k, way in enumerate(WAYS):
        own = [row for row in rows if row["method"] == way]
        x, y = [row["tries_per_s"] for row in own], [row["wrong"] for row in own]
        notes = ends([str(row["setting"]) for row in own])
        scatter(axes, x, y, way, k + len(METHODS), joined=True, notes=notes)
    legend(figure, columns=3)
    return figure


def _drapes(quick: bool) -> list[dict]:
    """Every sampling on every drape, in turns."""
    surfaces = list(SURFACES.items())[: 1 if quick else None]
    seeds, finest = (2, (5, 5, True)) if quick else (SEEDS, FINEST)
    settings = {("path, refined", p): (p, PLANNED[1], True) for p in POSES}
    settings |= {("path, waypoints alone", p): (p, PLANNED[1], False) for p in POSES}
    settings |= {
        ("ply, refined", mm): (PLANNED[0], mm, True) for mm in LINES if mm > FINEST[1]
    }
    if quick:
        settings = {k: v for k, v in settings.items() if v[0] <= 5}
    every = settings | {finest: finest}
    tasks: dict[tuple, list[Callable]] = {key: [] for key in every}
    for _, surface in surfaces:
        paths = {p: _path(surface, p) for p in {s[0] for s in settings.values()}}
        paths[finest[0]] = paths.get(finest[0]) or _path(surface, finest[0])
        for seed in range(seeds):
            off = {p: _off(case, seed) for p, case in paths.items()}
            for key, setting in every.items():
                tasks[key].append(partial(_judged, off[setting[0]], *setting[1:]))
    found: dict[tuple, list] = {}
    runs = {key: partial(_all, found, key, each) for key, each in tasks.items()}
    runs.pop(finest)()  # the reference, of which no time is told
    times = interleaved(runs, 1 if quick else 3)
    truth = np.array([facts for facts, _ in found[finest]])
    right = [good for _, good in found[finest]]
    rows = []
    for method, value in settings:
        facts = np.array([facts for facts, _ in found[method, value]])
        good = [good for _, good in found[method, value]]
        error = 1e3 * np.abs(facts - truth)
        rows.append(
            {
                "set": "drape",
                "method": method,
                "setting": f"{value:g} {'mm' if method.startswith('ply') else 'poses'}",
                "drapes": len(good),
                "ms": 1e3 * times[method, value] / len(good),
                "margin_error_mm": float(error[:, :2].mean()),
                "worst_margin_error_mm": float(error[:, :2].max()),
                "depth_error_mm": float(error[:, 2:].mean()),
                "wrong": float(np.mean(np.not_equal(good, right))),
                "passed": float(np.mean(right)),
            }
        )
    return rows


def _all(found: dict, key: tuple, tasks: list[Callable]) -> None:
    found[key] = [task() for task in tasks]


def _path(surface: dict, poses: int) -> Case:
    """The requested path of the small tool, up to the last landing."""
    path = {"family": "rectangle_blend", "poses_per_step": poses}
    data = over(surface, path=path, ply={"model": "cubic"}, fidelity="kinematic")
    return case_of(cell_of(data, SIZE))


def _off(case: Case, seed: int) -> Case:
    """Each cup off by an error of its own until it is placed; none for seed 0."""
    rng, n = np.random.default_rng(seed), case.placed.shape[1]
    height, tilt = rng.normal(size=n) * bool(seed), rng.normal(size=(n, 2)) * bool(seed)
    return case._replace(poses=off_by(case.poses, ~case.placed, height, tilt))


def _judged(case: Case, spacing: float, refined: bool) -> tuple[list[float], bool]:
    """Least margins and largest depths, [m], and whether the order is right."""
    cell = sampled(case.cell, spacing)
    with swapped(refine, ROUNDS=refine.ROUNDS if refined else 0):
        found = judge_contact(cell, case.sequence, *case[2:]).front
    margins = [
        float(np.clip(each.min(), -SHOWN, SHOWN))
        for each in (found.premature_margin, found.air_margin)
    ]
    depths = [
        float(np.minimum(each.max(), SHOWN))
        for each in (found.span_penetration, found.pad_penetration)
    ]
    return margins + depths, bool(found.in_order)


def _tries(quick: bool) -> list[dict]:
    """Tries of a wave step of the panel: verdicts by every way, in turns."""
    case = case_of(cell_of(example("panel", ply={"model": "cubic"})))
    tries = 4 if quick else TRIES
    chosen = np.flatnonzero(case.placed.any(axis=1))[STEP_POSES : 2 * STEP_POSES]
    placed, landing = case.placed[chosen], case.landing[chosen]
    spacings = (20, 10) if quick else (20, 10, 5)
    windows = {(mm, True): _window(case, mm, *WINDOW) for mm in spacings}
    cups = next(iter(windows.values())).cups
    rng, n = np.random.default_rng(0), placed.shape[1]
    height, tilt = rng.normal(size=(tries, 1, n)), rng.normal(size=(tries, 1, n, 2))
    inside = ~placed & np.isin(np.arange(n), cups)
    asked = tuple(np.repeat(x[None, chosen], tries, axis=0) for x in case.poses)
    p, R = off_by(asked, inside, ROUGHER * height, ROUGHER * tilt)
    size = range(case.cell.grid.rows), range(case.cell.grid.columns)
    windows |= {(mm, False): _window(case, mm, *size) for mm in spacings}
    tasks: dict[tuple[str, str], Callable] = {}
    for (mm, small), window in windows.items():
        own = p[:, :, window.cups], R[:, :, window.cups]
        by_labels = partial(_by_labels, window, own, placed, landing)
        if small:
            whole = windows[mm, False]
            laid = whole.grid.laid(placed)
            planned = case.poses[0][chosen], case.poses[1][chosen]
            around = window.around(whole.heights(*planned, laid))
            tasks[WAYS[2], f"{mm} mm"] = by_labels
            tasks[WAYS[3], f"{mm} mm"] = partial(by_labels, around=around)
        else:
            tasks[WAYS[1], f"{mm} mm"] = by_labels
            by_floods = partial(_by_floods, window, own, placed, landing)
            tasks[WAYS[0], f"{mm} mm"] = by_floods
    truth = tasks[WAYS[0], f"{spacings[-1]} mm"]()
    times = interleaved(tasks, 1 if quick else 5)
    return [
        {
            "set": "tries",
            "method": way,
            "setting": setting,
            "tries": tries,
            "poses": len(chosen),
            "tries_per_s": tries / max(times[way, setting], 1e-9),
            "wrong": float(np.mean(task() != truth)),
            "faulty": float(np.mean(truth)),
        }
        for (way, setting), task in tasks.items()
    ]


def _window(case: Case, spacing: float, rows: range, columns: range) -> StepWindow:
    start = case.sequence.index(case.sequence.start_cup)
    laid = case.poses[0][-1], case.poses[1][-1]
    return StepWindow.of(sampled(case.cell, spacing), start, laid, rows, columns)


def _by_labels(
    window: StepWindow,
    poses: Poses,
    placed: Array,
    landing: Array,
    around: Surroundings | None = None,
) -> Array:
    """Whether each try loses the order, by labels alone, shape (tries,)."""
    faults = window.faults(*poses, placed, landing, around)
    return np.asarray(((faults & ORDER) > 0).any(axis=1))


def _by_floods(
    window: StepWindow, poses: Poses, placed: Array, landing: Array
) -> Array:
    """The same from the margins that floods find, as a plan's verdict has them."""
    limits = front_tolerance(window.cell)
    lost = []
    for one in zip(*poses, strict=True):
        none = np.zeros((len(placed), *window.final_gap.shape), bool)
        h = window.heights(*one, none)
        gap = np.minimum(h + window.final_gap, HIGH)
        cups = placed, landing, limits
        margins = pose_measures(gap, window.final_gap, window.grid, *cups)[:2]
        lost.append(margins.min() <= 0)
    return np.array(lost)
