"""Error and time of every rung against finite elements."""

import csv
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drapeplan.compare import Surface, rms
from ply.coupled import CoupledModel, CoupledStatus
from ply.coupled_array import coupled_points
from ply.coupled_choice import coupled_alternatives
from ply.fiber import Array
from ply.grid import CupGrid
from ply.ladder import Rung, ladder_alternatives
from ply.reconcile import reconcile
from ply.shape import evaluate, ply_fibers
from ply.sides import alternatives

DATA = Path(__file__).parents[1] / "tests" / "data" / "truth"
FAILURES = ("A.over", "B.over", "B.rnd_over", "B.rnd_big", "B.sheared")
SET_APART = "B_lift40_tilt"  # its fibers do not reach either
FINER = "B_lift20_flatcup"  # its finer mesh is the truth
RUNGS = ("cubic", "quartic", "modal", "coupled", "auto")
COUNT = 4  # [-] shapes offered, of which the nearest counts
ALIKE = 0.01  # [mm] two shapes that score alike are one
MM = 1e-3
SIGMA, ANGLE = 0.25e-3, np.deg2rad(0.25)  # [m], [rad] noise of poses


class Case(NamedTuple):
    """One case: cups, and its truth with the alternatives listed."""

    name: str
    kind: str
    grid: CupGrid
    positions: Array
    rotations: Array
    truths: list[dict]
    st: Array
    fe_seconds: float


class Score(NamedTuple):
    """Errors in [mm] of the nearest shape and of the first, time in [s]."""

    rms: float
    worst: float
    material: float
    first: bool
    seconds: float


def cases() -> list[Case]:
    """The accuracy references."""
    with open(DATA / "paper.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    good = [r for r in rows if r["class"] not in FAILURES and r["case"] != SET_APART]
    return [_read(row) for row in good]


def _read(row: dict[str, str]) -> Case:
    name = row["case"]
    truths = [] if name == FINER else [dict(np.load(DATA / f"{name}.npz"))]
    others = sorted((DATA / "alt").glob(f"{name}__*.npz"))
    truths += [dict(np.load(path)) for path in others]
    first = truths[0]
    half, length = float(first["d"]) * MM, float(first["L"]) * MM
    grid = CupGrid(int(first["ny"]), int(first["nx"]), 2 * half + length, half)
    a, b = np.nonzero(first["cupid"] < 0)
    st = np.stack([first["S"][a], first["T"][b]], axis=-1)
    poses = first["poses"][:, :3, 3] * MM, first["poses"][:, :3, :3]
    return Case(name, row["class"], grid, *poses, truths, st, float(row["fe_seconds"]))


def shapes(case: Case, rung: str) -> list[Array]:
    """Points of the shapes that a rung offers, first the one that it prefers."""
    grid, held, st = case.grid, (case.positions, case.rotations), case.st * MM
    if rung == "auto":
        return list(ladder_alternatives(grid, *held, COUNT).points(*st.T))
    if rung == "coupled" and grid.n_cups > 4:
        return [coupled_points(grid, *held, *st.T, model=MODELS[grid])[0]]
    if rung == "coupled":
        found = coupled_alternatives(MODELS[grid], *held, COUNT)
        found = found[found.status != CoupledStatus.ABSENT]
        return list(MODELS[grid].points(found, *st.T))
    if rung == "modal":
        offered = [fibers for fibers, _ in alternatives(grid, *held, COUNT)]
    else:
        offered = [ply_fibers(grid, *held, model=rung)]
    return [evaluate(grid, fibers, *held, st) for fibers in offered]


MODELS: dict[CupGrid, CoupledModel] = {}


def scores(
    every: list[Case], repeats: int, rungs: tuple[str, ...] = RUNGS
) -> dict[str, dict[str, Score]]:
    """Score of each case by each rung; rungs take turns, so that load is shared."""
    for case in every:
        if case.grid not in MODELS:
            MODELS[case.grid] = CoupledModel(case.grid)
            for rung in rungs:
                shapes(case, rung)  # fills constant matrices
    found: dict[str, dict[str, Score]] = {}
    for case in every:
        times: dict[str, list[float]] = {rung: [] for rung in rungs}
        offered: dict[str, list[Array]] = {}
        for _ in range(repeats):
            for rung in rungs:
                start = time.perf_counter()
                offered[rung] = shapes(case, rung)
                times[rung].append(time.perf_counter() - start)
        found[case.name] = {
            rung: _score(case, offered[rung], min(times[rung])) for rung in rungs
        }
    return found


def _score(case: Case, offered: list[Array], seconds: float) -> Score:
    rows = []
    for points in offered:
        rows.append(min(errors(case, truth, points) for truth in case.truths))
    best = min(rows)
    return Score(*best, rows[0][0] <= best[0] + ALIKE, seconds)


def errors(case: Case, truth: dict, points: Array) -> tuple[float, float, float]:
    """Rms and worst normal distance, rms distance of material points, in [mm]."""
    surface = Surface(truth["S"], truth["T"], np.swapaxes(truth["xyz"], 0, 1))
    away = surface.closest(points / MM, case.st).distance
    tracked = np.linalg.norm(points / MM - surface.points(case.st), axis=-1)
    return rms(away), float(abs(away).max()), rms(tracked)


def table(every: list[Case], found: dict[str, dict[str, Score]]) -> list[str]:
    """Classes averaged, rms / worst normal distance in mm, as a table."""
    lines = ["| class | " + " | ".join(RUNGS) + " |", "|---" * (1 + len(RUNGS)) + "|"]
    kinds = list(dict.fromkeys(case.kind for case in every))
    for kind in [*kinds, "all"]:
        names = [case.name for case in every if kind in (case.kind, "all")]
        cells = []
        for rung in RUNGS:
            own = [found[name][rung] for name in names]
            mean, worst = np.mean([s.rms for s in own]), max(s.worst for s in own)
            cells.append(f"{mean:.3f} / {worst:.2f}")
        lines.append(f"| {kind} ({len(names)}) | " + " | ".join(cells) + " |")
    return lines


def rung_shares(every: list[Case]) -> dict[str, float]:
    """Share of the patches and strips that stand on each rung with auto."""
    rungs = [
        ladder_alternatives(case.grid, case.positions, case.rotations, COUNT).rung[0]
        for case in every
    ]
    flat = np.concatenate([rung.ravel() for rung in rungs])
    return {
        f"auto_share_{rung.name.lower()}": float((flat == rung).mean()) for rung in Rung
    }


def noisy_sphere(every: list[Case], seeds: int) -> dict[str, float]:
    """Median rms under pose noise on the 5 x 3 sphere, in [mm]."""
    case = next(case for case in every if case.name == "C_sph2000")
    rng, found = np.random.default_rng(0), []
    for _ in range(seeds):
        held = _disturbed(case, rng)
        mended = reconcile(case.grid, *held, SIGMA, ANGLE)
        poses = mended.positions, mended.rotations
        trials = (
            (held, {"model": "quartic"}),
            (held, {"model": "modal"}),
            (poses, {"model": "modal", "take_up": mended.take_up}),
        )
        row = []
        for where, settings in trials:
            fibers = ply_fibers(case.grid, *where, **settings)  # type: ignore[arg-type]
            points = evaluate(case.grid, fibers, *where, case.st * MM)
            row.append(min(errors(case, truth, points)[0] for truth in case.truths))
        found.append(row)
    names = ("paper", "modal", "reconciled")
    medians = np.median(found, axis=0).tolist()
    return {
        f"noise_sphere_{name}_median_rms_mm": value
        for name, value in zip(names, medians, strict=True)
    }


def _disturbed(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """Poses with noise in positions and, to first order, directions."""
    moved = case.positions + SIGMA * rng.normal(size=case.positions.shape)
    turn = ANGLE * rng.normal(size=case.positions.shape)
    columns = np.swapaxes(case.rotations, -1, -2)
    turned = np.swapaxes(columns + np.cross(turn[:, None], columns), -1, -2)
    q, r = np.linalg.qr(turned)
    return moved, q * np.sign(np.diagonal(r, axis1=-2, axis2=-1))[:, None, :]


def run_truth(quick: bool) -> dict:
    """Figures of all rungs over the accuracy references."""
    every = cases()
    found = scores(every, 1 if quick else 3)
    result: dict[str, object] = {}
    for rung in RUNGS:
        own = [found[case.name][rung] for case in every]
        result[f"{rung}_mean_rms_mm"] = float(np.mean([s.rms for s in own]))
        result[f"{rung}_worst_rms_mm"] = max(s.rms for s in own)
        result[f"{rung}_mean_material_rms_mm"] = float(
            np.mean([s.material for s in own])
        )
        result[f"{rung}_first_is_nearest"] = float(np.mean([s.first for s in own]))
        seconds = sum(s.seconds for s in own)
        result[f"{rung}_seconds"] = seconds
        result[f"finite_elements_over_{rung}"] = (
            sum(case.fe_seconds for case in every) / seconds
        )
    result["auto_over_coupled_time"] = (
        result["auto_seconds"] / result["coupled_seconds"]  # type: ignore[operator]
    )
    result |= rung_shares(every) | noisy_sphere(every, 5 if quick else 25)
    result["table"] = table(every, found)
    result["cases"] = {
        name: {rung: score._asdict() for rung, score in row.items()}
        for name, row in found.items()
    }
    return result
