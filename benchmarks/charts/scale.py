"""Time and memory against cups, samples of the ply, and poses at a time.

Each point is measured in a process of its own, so that its peak of memory is its own.
Processor times; exponents are fitted over the upper half of each row of sizes.
"""

import json
import os
import subprocess
import sys

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.charts.drawing import WIDTH, log_log, scatter
from benchmarks.charts.results import Results, made_with

CUPS = ((2, 2), (4, 3), (6, 4), (8, 6), (10, 10), (14, 14), (20, 20))
FINER = (1, 2, 4, 8, 16)  # times finer than 10 mm: 5e3 to 1.2e6 samples
BATCHES = (1, 4, 16, 64, 256)
STAGES = ("robot and mold", "net and wave", "strokes", "rest", "contact")
PARTS = ("ply", "gap", "margins", "fibers", "points")
PANELS = {
    "cups": ("a plan", "cups", "time [ms]"),
    "samples": ("a pose of 6 x 8 cups", "samples of the ply", "time [ms]"),
    "batch": ("a pose of 6 x 8 cups", "poses at a time", "time a pose [ms]"),
}
REPEATS = 5  # [-] of which the least time of each stage counts
LONGEST = 1800  # [s] of one point, past which it is missing
PLANNED = {"cups": 48, "samples": 4697}  # sizes of a plan's own tool


def measure(quick: bool) -> Results:
    """Every size in a process of its own."""
    asked = [("cups", *size) for size in CUPS[: 1 if quick else None]]
    asked += [("samples", n) for n in FINER[: 1 if quick else None]]
    asked += [("batch", n) for n in BATCHES[: 1 if quick else None]]
    rows, missing = [], {}
    for kind, *sizes in asked:
        name = f"{kind} {' x '.join(map(str, sizes))}"
        print(f"  {name}", file=sys.stderr)
        found = _child(1 if quick else REPEATS, kind, *sizes)
        if isinstance(found, str):
            missing[name] = found
            continue
        seconds = {f"{k}_s": v for k, v in found.pop("seconds").items()}
        rows.append({"set": kind, **found, **seconds})
    made = made_with("osqp", "pin", quick=quick)
    return Results("scale", rows + fits(rows), made, missing)


def fits(rows: list[dict]) -> list[dict]:
    """Exponents of every stage and of memory, by the kind of size."""
    found = []
    for kind in PANELS:
        own = [row for row in rows if row["set"] == kind]
        for name in own[0] if len(own) > 1 else ():
            if name == "peak_MB" or name.endswith("_s"):
                x, y = [row["count"] for row in own], [row[name] for row in own]
                found.append({"set": kind, "fit": name, "exponent": exponent(x, y)})
    return found


def exponent(x: list[float], y: list[float]) -> float:
    """Slope in the logarithms over the upper half of sizes."""
    half = len(x) // 2 if len(x) > 3 else 0
    a, b = np.log(np.array(x[half:])), np.log(np.maximum(y[half:], 1e-12))
    return float(np.polyfit(a, b, 1)[0]) if len(a) > 1 else 0.0


def draw(results: Results) -> Figure:
    """Time by stages for each kind of size, and memory; each panel has its legend."""
    figure = Figure(figsize=(WIDTH, 5.8), layout="constrained")
    panels = figure.subplots(2, 2)
    for axes, (kind, (title, x_label, y_label)) in zip(
        panels.flat, PANELS.items(), strict=False
    ):
        rows = _points(results, kind)
        log_log(axes, title + _power(kind, results), x_label, y_label)
        stages = [name for name in (*STAGES, *PARTS) if rows[0].get(f"{name}_s")]
        for k, stage in enumerate(stages):
            x, y = [r["count"] for r in rows], [1e3 * r[f"{stage}_s"] for r in rows]
            scatter(axes, x, y, stage, k, joined=True)
        axes.legend(frameon=False)
    _memory(panels[1, 1], results)
    return figure


def _memory(axes: Axes, results: Results) -> None:
    title, x_label = "peak memory, libraries included", "cups, samples or poses"
    log_log(axes, title, x_label, "[MB]")
    for k, kind in enumerate(PANELS):
        rows = _points(results, kind)
        x, y = [row["count"] for row in rows], [row["peak_MB"] for row in rows]
        notes = [""] * (len(y) - 1) + [f"{y[-1]:.0f} MB"]
        scatter(axes, x, y, f"by {kind}", k, joined=True, notes=notes)
    axes.legend(frameon=False)


def _points(results: Results, kind: str) -> list[dict]:
    return [row for row in results.where(set=kind) if "fit" not in row]


def _power(kind: str, results: Results) -> str:
    """The fitted exponent of all stages together, as a part of the title."""
    fitted = [r["exponent"] for r in results.where(set=kind, fit="total_s")]
    return f": size to the {fitted[0]:.1f}" if fitted else ""


def _child(repeats: int, kind: str, *sizes: int) -> dict | str:
    """What a process found, or why it found nothing."""
    asked = map(str, (repeats, kind, *sizes))
    command = [sys.executable, "-m", "benchmarks.charts._scale", *asked]
    environment = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", **os.environ}
    try:
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=LONGEST
        )
    except subprocess.TimeoutExpired:
        return f"more than {LONGEST} s"
    if done.returncode:
        return done.stderr.strip().splitlines()[-1]
    return json.loads(done.stdout)
