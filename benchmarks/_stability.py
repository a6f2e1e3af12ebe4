"""Which stroke jumps the equilibrium survives, from which mold: counts and a figure."""

import json
from pathlib import Path

import numpy as np

from drapeplan.equilibrium import Equilibrium, SettledStatus, ToolPhysics
from drapeplan.legs import STROKE

RESULTS = Path(__file__).parent / "results"
JUMPS = (0.010, 0.020, 0.030, 0.040, 0.060)  # [m] largest change of a stroke
RADII = (np.inf, 2.0, 1.0, 0.5, 0.35)  # [m] convex along both sides
FREE = 1.0  # [m] fibers that never bind
TIGHTEST = 1.0  # [m] least radius of the tool's envelope, doubly curved
HOLDING = 20  # the one cup that stands
FITTING = ("settled", "saddle", "failed")


def stability_maps(robot, ply: ToolPhysics, samples: int, jumps=JUMPS, radii=RADII):
    """Counts by kind of jump, radius and size, with and without parts.

    Smooth jumps are tilts and bends of the whole array, rough ones change every stroke
    by itself; rough ones tear any ply, so fibers do not bind there.
    """
    loose = ToolPhysics(ply.bending, ply.areal_mass, FREE, ply.yaw)
    maps = {}
    for name, physics, field in (
        ("smooth", ply, smooth_jump),
        ("smooth, fibers free", loose, smooth_jump),
        ("rough, fibers free", loose, rough_jump),
    ):
        tool = Equilibrium(robot, physics)
        rng = np.random.default_rng(0)
        cells, starts = [], {}
        for radius in radii:
            start = settle_mold(tool, radius)
            starts[f"{radius:g} m"] = start.status.name.lower()
            for jump in jumps if start.status == SettledStatus.SETTLED else ():
                cells.append(count(tool, start, radius, jump, field, samples, rng))
        maps[name] = {"starts": starts, "cells": cells}
    return maps


def settle_mold(tool, radius):
    """The tool at rest over a paraboloid, reached in steps."""
    robot, fixed = tool.robot, np.arange(tool.robot.n_cups) == HOLDING
    settled, x, y = tool.settle(robot.home(), fixed), *plan(robot)
    for share in np.linspace(0, 1, 9)[1:]:
        z = -share * (x * x + y * y) / (2 * radius)
        q = settled.q.copy()
        strokes = robot.home()[robot.leg_columns[:, STROKE]] - (z - z[HOLDING])
        q[robot.leg_columns[:, STROKE]] = strokes
        settled = tool.settle(q, fixed, settled)
    return settled


def count(tool, start, radius, jump, field, samples, rng):
    """One cell of the map."""
    robot, fixed = tool.robot, np.arange(tool.robot.n_cups) == HOLDING
    strokes = robot.leg_columns[:, STROKE]
    cell = {"radius_m": radius if radius < np.inf else None, "jump_mm": 1e3 * jump}
    cell |= {way: dict.fromkeys(FITTING, 0) for way in ("at_once", "in_parts")}
    cell |= {"inside": 0, "inside_failed": 0}
    for _ in range(samples):
        q = start.q.copy()
        change = field(robot, rng)
        q[strokes] += jump * change / np.abs(change).max()
        at_once = tool.settle_once(q, fixed, start)
        in_parts = tool.settle(q, fixed, start)
        cell["at_once"][at_once.status.name.lower()] += 1
        cell["in_parts"][in_parts.status.name.lower()] += 1
        if inside(robot, q[strokes]):
            cell["inside"] += 1
            cell["inside_failed"] += in_parts.status != SettledStatus.SETTLED
    return cell


def plan(robot):
    """Cups of a flat array about its middle, x and y, in [m]."""
    i, j = np.divmod(np.arange(robot.n_cups), robot.columns)
    x = (j - (robot.columns - 1) / 2) * robot.pitch
    return x, (i - (robot.rows - 1) / 2) * robot.pitch


def smooth_jump(robot, rng):
    """Random tilt, bend and wave of the array, zero at the cup that stands."""
    x, y = (side / np.abs(side).max() for side in plan(robot))
    shapes = np.stack([x, y, x * x, y * y, x * y, np.sin(3 * x), np.sin(3 * y)])
    change = (rng.normal(size=7) * [1, 1, 1, 1, 1, 0.2, 0.2]) @ shapes
    return change - change[HOLDING]


def rough_jump(robot, rng):
    """Every stroke by itself."""
    change = rng.uniform(-1, 1, robot.n_cups)
    change[HOLDING] = 0.0
    return change


def inside(robot, strokes):
    """Whether strokes lie in their range and bend the array no more than 1 / 1 m."""
    z = strokes.reshape(robot.rows, robot.columns) / robot.pitch**2
    bends = [np.abs(np.diff(z, 2, axis=k)).max() for k in (0, 1)]
    twist = np.abs(np.diff(np.diff(z, axis=0), axis=1)).max()
    travel = robot.geometry.leg_max - robot.geometry.leg_min
    good = strokes.min() >= 0 and strokes.max() <= travel
    return bool(good and max(*bends, twist) <= 1 / TIGHTEST)


def write_maps(maps, name):
    """Write counts as JSON and as a figure; returns their names."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    RESULTS.mkdir(exist_ok=True)
    stem = RESULTS / f"stability-{name}"
    stem.with_suffix(".json").write_text(json.dumps(maps, indent=1) + "\n", "utf-8")
    ways = {"at_once": "in one jump", "in_parts": "in parts"}
    figure, axes = plt.subplots(
        len(maps), 2, figsize=(9, 2.6 * len(maps)), layout="constrained", squeeze=False
    )
    for row, (kind, found) in zip(axes, maps.items(), strict=True):
        for axis, (way, title) in zip(row, ways.items(), strict=True):
            draw(axis, found["cells"], way)
            axis.set_title(f"{kind}, {title}", fontsize=9)
    figure.suptitle(
        "Share of stroke jumps that settle; s saddle, f failed", fontsize=10
    )
    figure.savefig(stem.with_suffix(".png"), dpi=130)
    plt.close(figure)
    return [f"{RESULTS.name}/{stem.name}{end}" for end in (".json", ".png")]


def draw(axis, cells, way):
    """One panel: radius down, jump across, share that settled as color."""
    radii = list(dict.fromkeys(cell["radius_m"] for cell in cells))
    jumps = list(dict.fromkeys(cell["jump_mm"] for cell in cells))
    share = np.zeros((len(radii), len(jumps)))
    for cell in cells:
        i, j = radii.index(cell["radius_m"]), jumps.index(cell["jump_mm"])
        counts = cell[way]
        share[i, j] = counts["settled"] / sum(counts.values())
        text = " ".join(f"{v}{k[0]}" for k, v in counts.items() if v and k != "settled")
        color = "black" if share[i, j] > 0.5 else "white"
        axis.text(j, i, text, ha="center", va="center", fontsize=8, color=color)
    axis.imshow(share, vmin=0, vmax=1, cmap="cividis", aspect="auto")
    axis.set_xticks(range(len(jumps)), [f"{jump:.0f}" for jump in jumps])
    axis.set_yticks(
        range(len(radii)), ["flat" if r is None else f"{r:g}" for r in radii]
    )
    axis.set_xlabel("largest jump of a stroke [mm]", fontsize=8)
    axis.set_ylabel("radius [m]", fontsize=8)
