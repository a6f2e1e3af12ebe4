"""Time of the coupled patch: cold, warm, alone and batched, against finite elements."""

import csv
from pathlib import Path

import numpy as np

from benchmarks._timing import median_time
from ply.coupled import CoupledModel
from ply.coupled_choice import coupled_alternatives
from ply.coupled_jacobian import coupled_jacobian
from ply.grid import CupGrid

DATA = Path(__file__).parents[1] / "tests" / "data" / "truth"
GRID = CupGrid(rows=2, columns=2, pitch=0.11, half_width=0.02)
CLASSES = ("cyl", "cyl_rot", "flatslack", "lift", "rnd_small")
CLASSES += ("saddle", "sph", "sph_slack", "step")
STEP = 2e-4  # [m] way of a cup between two poses of a path
POINTS = 50
LOADED: dict[str, dict] = {
    "weight": {"weight": (0.0, 0.0, -4.0)},
    "take_up": {"take_up": 4e-4},
}
COPIES = 4  # [-] of all cells in a batch


def run(quick: bool) -> dict:
    """Milliseconds a patch over the truth's cells of 2 x 2 cups whose fibers fit."""
    repeats = 3 if quick else 15
    names, fe_seconds = cells()
    poses = np.stack([np.load(DATA / f"{name}.npz")["poses"] for name in names])
    p, frames = poses[..., :3, 3] / 1e3, poses[..., :3, :3]
    shift = STEP * np.random.default_rng(0).normal(size=(len(p), 4, 1))
    moved = p + shift * frames[..., 2]
    result: dict[str, float] = {"cells": len(p)}
    for order in (5, 4):
        model = CoupledModel(GRID, order=order)
        before = model.solve(p, frames)
        tasks = {
            "cold": lambda k, model=model: model.solve(p[k], frames[k]),
            "warm": lambda k, model=model, before=before: model.solve(
                moved[k], frames[k], start=before[k]
            ),
            "alternatives": lambda k, model=model: coupled_alternatives(
                model, p[k], frames[k]
            ),
        }
        many = np.tile(np.arange(len(p)), COPIES)
        for name, task in tasks.items():
            alone = [
                median_time(lambda k=k, task=task: task(k), repeats)
                for k in range(len(p))
            ]
            batched = median_time(
                lambda task=task, many=many: task(many), 1 + repeats // 3
            )
            key = f"order_{order}_{name}"
            result[f"{key}_alone_ms"] = 1e3 * float(np.mean(alone))
            result[f"{key}_batched_ms"] = 1e3 * batched / len(many)
        result[f"order_{order}_cold_steps"] = float(before.iterations.mean())
        points = np.random.default_rng(1).uniform(0, GRID.pitch, (POINTS, 2))
        seconds = median_time(
            lambda model=model, before=before, points=points: coupled_jacobian(
                model, before, points
            ),
            repeats,
        )
        result[f"order_{order}_jacobian_{POINTS}_points_ms"] = 1e3 * seconds / len(p)
    for name, settings in LOADED.items():
        model = CoupledModel(GRID, **settings)
        seconds = median_time(lambda model=model: model.solve(p, frames), repeats)
        result[f"order_5_{name}_cold_batched_ms"] = 1e3 * seconds / len(p)
    for name in ("cold_alone", "cold_batched"):
        result[f"finite_elements_over_{name}"] = (
            1e3 * float(np.mean(fe_seconds)) / result[f"order_5_{name}_ms"]
        )
    return result


def cells() -> tuple[list[str], list[float]]:
    """Names and seconds of finite elements of the cells."""
    with open(DATA / "paper.csv", newline="") as file:
        rows = [
            row
            for row in csv.DictReader(file)
            if row["class"] in [f"B.{name}" for name in CLASSES]
            and row["case"] != "B_lift40_tilt"
        ]
    return [row["case"] for row in rows], [float(row["fe_seconds"]) for row in rows]
