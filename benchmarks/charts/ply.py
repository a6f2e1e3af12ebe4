"""Ply models and other programs against finite elements: error against time.

Errors are normal distances to the finite elements' surface at the points between the
cups, rms over a case, the nearest of the shapes offered and of the equilibria known;
times are processor times of a case whose cups are given, taken in turns.
"""

import csv
from collections.abc import Callable
from functools import lru_cache, partial

import numpy as np
from matplotlib.figure import Figure

from benchmarks import _truth
from benchmarks._timing import interleaved
from benchmarks._truth import COUNT, MM, Case
from benchmarks.charts._cloth import cloth
from benchmarks.charts._relax import Peer, peers, relax
from benchmarks.charts._whole_ply import whole_ply
from benchmarks.charts.drawing import (
    WIDTH,
    ends,
    front,
    legend,
    log_log,
    published,
    scatter,
    upright,
)
from benchmarks.charts.results import Results, made_with
from ply.coupled import CoupledModel, CoupledStatus
from ply.coupled_array import coupled_points
from ply.coupled_choice import coupled_alternatives
from ply.elastica import ElasticaStatus, elastica
from ply.fiber import Array
from ply.grid import CupGrid
from ply.ladder import ladder_alternatives

COMPARED = (  # one of each class that other programs relax, none with many equilibria
    *("A_bend20_arc", "A_bend20_slack2", "A_asym_0_-20", "A_S_dz20"),
    *("A_3d_bend15_twist10", "B_cyl300", "B_cyl500_rot45", "B_sph2000"),
    *("B_saddle1000", "B_step15", "B_lift20_flatcup"),
)
QUICK = ("A_bend20_slack2",)
PLANAR = (
    "A.bend",
    "A.bend_slack",
    "A.taut",
    "A.asym",
    "A.asym_slack",
    "A.S",
    "A.S_slack",
)
PLANAR += ("A.comp",)
ORDERS = (4, 5)  # [-] bubbles a span of the coupled patch
TOLERANCES = (1.0, 0.3, 0.1, 0.03)  # [mm] of auto
PAPER_RMS, PAPER_MS = 1.6, 1000.0  # [mm], [ms] published: "less than a second"
QUICK_STEPS = 10  # [-] of a cloth
SETS = {
    "all": "cases, all references",
    "compared": "cases, other programs too",
    "planar": "planar strips",
    "whole": "poses of 6 x 8 cups at a time",
}
REFERENCE = "CalculiX"
COARSE = "CalculiX, coarser mesh"
EXACT = "CalculiX, against the elastica"
LOOKS = ("cubic", "quartic", "modal", "coupled, one shape", "coupled", "auto")
LOOKS += ("elastica",)
Shapes = Callable[[Case], list[Array]]


def measure(quick: bool) -> Results:
    """All methods on all cases, cloths on some of them, and the whole ply."""
    every = {case.name: case for case in _truth.cases()}
    compared = [every[name] for name in (QUICK if quick else COMPARED)]
    planar = [case for case in every.values() if case.kind in PLANAR]
    if quick:
        planar = planar[:1]
    repeats = 1 if quick else 5
    rows = [] if quick else _rows("all", list(every.values()), _methods(), repeats)
    rows += _rows("compared", compared, _methods(), repeats)
    rows += _rows("planar", planar, _methods() | {("elastica", ""): _elastica}, repeats)
    found, missing = peers(quick)
    for name, peer in found.items():
        rows += _cloth_rows(name, peer, compared, quick)
    rows += whole_ply(quick)
    made = made_with("mujoco-core", "newton", "warp-lang", quick=quick)
    return Results("ply", rows, made, missing)


def draw(results: Results) -> Figure:
    """A panel for each set of cases, and one for the whole ply."""
    figure = Figure(figsize=(WIDTH, 6.6), layout="constrained")
    panels = figure.subplots(2, 2)
    methods = list(dict.fromkeys([*LOOKS, *(str(r["method"]) for r in results.rows)]))
    for axes, (title, text) in zip(panels.flat, SETS.items(), strict=True):
        rows = results.where(set=title)
        axes.set_visible(bool(rows))  # a quick run leaves one out
        whole = title == "whole"
        count = f"{rows[0]['cases']} " if rows else ""
        x_label = f"time a {'pose' if whole else 'case'} [ms]"
        y_label = "worst error of facets [mm]" if whole else "mean rms error [mm]"
        log_log(axes, count + text, x_label, y_label)
        for k, method in enumerate(methods):
            own = [row for row in rows if row["method"] == method]
            if not own:
                continue
            x, y = [row["ms"] for row in own], [row["rms_mm"] for row in own]
            notes = [str(row["setting"]) for row in own]
            if method == REFERENCE:
                upright(axes, x[0], "the truth's own time")
            else:
                foreign = method not in LOOKS and not whole
                settings = {
                    "joined": True,
                    "hollow": foreign,
                    "notes": [] if foreign and method != COARSE else ends(notes),
                }
                scatter(axes, x, y, method, k, **settings)
        drawn = [row for row in rows if row["method"] != REFERENCE]
        front(axes, [row["ms"] for row in drawn], [row["rms_mm"] for row in drawn])
        if title in ("all", "compared"):
            published(axes, PAPER_MS, PAPER_RMS, "the paper's scan,\nas published")
    legend(figure, columns=4)
    return figure


def _methods() -> dict[tuple[str, str], Shapes]:
    """Our models by name and setting; each offers shapes of a case."""
    methods: dict[tuple[str, str], Shapes] = {
        (rung, ""): lambda case, rung=rung: _truth.shapes(case, rung)
        for rung in ("cubic", "quartic", "modal")
    }
    methods["coupled, one shape", ""] = lambda case: _coupled(case, ORDERS[-1], 1)
    for order in ORDERS:
        methods["coupled", f"order {order}"] = lambda case, n=order: _coupled(case, n)
    for tolerance in TOLERANCES:
        methods["auto", f"{tolerance:g} mm"] = lambda case, mm=tolerance: _auto(
            case, mm
        )
    return methods


def _auto(case: Case, tolerance: float) -> list[Array]:
    held, st = (case.positions, case.rotations), case.st * MM
    found = ladder_alternatives(case.grid, *held, COUNT, tolerance=tolerance * MM)
    return list(found.points(*st.T))


@lru_cache
def _model(grid: CupGrid, order: int) -> CoupledModel:
    return CoupledModel(grid, order=order)


def _coupled(case: Case, order: int, count: int = COUNT) -> list[Array]:
    grid, held, st = case.grid, (case.positions, case.rotations), case.st * MM
    model = _model(grid, order)
    if grid.n_cups > 4 or count == 1:
        return [coupled_points(grid, *held, *st.T, model=model)[0]]
    found = coupled_alternatives(model, *held, count)
    return list(model.points(found[found.status != CoupledStatus.ABSENT], *st.T))


def _elastica(case: Case) -> list[Array]:
    """Exact fibers of a strip between two cups in one plane, bowed up or down."""
    half, length = case.grid.half_width, case.grid.s_length
    (first, second), (one, two) = case.positions, case.rotations
    begin, end = first + half * one[:, 0], second - half * two[:, 0]
    chord = (end - begin)[[0, 2]]
    angles = [np.full(2, np.arctan2(frame[2, 0], frame[0, 0])) for frame in (one, two)]
    bow = 2 / np.pi * np.sqrt(max(0.0, 1 - np.linalg.norm(chord) / length))
    curves = elastica(np.stack([chord, chord]), *angles, length, np.array([bow, -bow]))
    u, place = np.unique((case.st[:, 0] * MM - half) / length, return_inverse=True)
    shapes = []
    for plane in curves.points(u)[curves.status != ElasticaStatus.NOT_CONVERGED]:
        points = np.column_stack([plane[place, 0], case.st[:, 1] * MM, plane[place, 1]])
        shapes.append(points + begin * [1, 0, 1])
    return shapes


def _rows(
    title: str, cases: list[Case], methods: dict[tuple[str, str], Shapes], repeats: int
) -> list[dict]:
    """Figures of methods on cases, in turns, and the finite elements' own time."""
    seconds = {key: [] for key in methods}
    errors = {key: [] for key in methods}
    for case in cases:
        tasks = {key: partial(shapes, case) for key, shapes in methods.items()}
        for key, took in interleaved(tasks, repeats).items():
            seconds[key].append(took)
            errors[key].append(_error(case, tasks[key]()))
    rows = [_row(title, *key, cases, seconds[key], errors[key]) for key in methods]
    recorded = [case.fe_seconds for case in cases]
    rows.append(_row(title, REFERENCE, "", cases, recorded, [0.0] * len(cases)))
    if title == "planar":  # where there is an exact shape, the truth has an error too
        own = errors["elastica", ""]
        rows.append(_row(title, EXACT, "", cases, recorded, own))
    return rows + _coarse_rows(title, cases)


def _coarse_rows(title: str, cases: list[Case]) -> list[dict]:
    """Figures of finite elements on coarser meshes, where they are recorded."""
    with open(_truth.DATA / "coarse.csv", newline="") as file:
        every = list(csv.DictReader(file))
    names, rows = {case.name for case in cases}, []
    for level in dict.fromkeys(row["mesh"] for row in every):
        own = [row for row in every if row["mesh"] == level and row["case"] in names]
        if len(own) == len(cases):
            figures = (
                [float(row[key]) for row in own] for key in ("seconds", "rms_mm")
            )
            rows.append(_row(title, COARSE, f"mesh {level}", cases, *figures))
    return rows


def _cloth_rows(name: str, peer: Peer, cases: list[Case], quick: bool) -> list[dict]:
    """Figures of another program, at each number of steps."""
    steps = (QUICK_STEPS,) if quick else peer.steps
    seconds, errors = np.empty((2, len(cases), len(steps)))
    for n, case in enumerate(cases):
        mesh = cloth(case, peer.per_span)
        for k, (took, vertices) in enumerate(relax(peer.make(mesh), steps, mesh.start)):
            seconds[n, k] = took
            errors[n, k] = _error(case, [mesh.points(vertices, case)])
    return [
        _row("compared", name, f"{count} steps", cases, seconds[:, k], errors[:, k])
        for k, count in enumerate(steps)
    ]


def _error(case: Case, shapes: list[Array]) -> float:
    """Rms normal distance of the nearest shape to the nearest equilibrium, in [mm]."""
    return min(
        _truth.errors(case, truth, points)[0]
        for points in shapes
        for truth in case.truths
    )


def _row(title, method, setting, cases, seconds, errors) -> dict:
    return {
        "set": title,
        "method": method,
        "setting": setting,
        "cases": len(cases),
        "ms": 1e3 * float(np.mean(seconds)),
        "rms_mm": float(np.mean(errors)),
        "worst_case_rms_mm": float(np.max(errors)),
    }
