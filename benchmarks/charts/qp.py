"""QP solvers on recorded QPs: worst violation and success against time.

The QPs are those of real plans, recorded anew each time: strokes of a wave, the same
from the waypoint before, as a differential IK has them, a ply that hardly reaches
around its mold, and that ply cut so short that a linear program finds no point at all:
these must be refused. Every solver gets the same numbers; they take turns on each QP.
"""

import time
import warnings
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import qpsolvers
from matplotlib.figure import Figure
from scipy.optimize import linprog
from scipy.sparse import csc_matrix

from benchmarks._timing import uncollected
from benchmarks.charts.drawing import WIDTH, front, legend, log_log, scatter
from benchmarks.charts.results import Results, made_with
from benchmarks.qp import record, record_taut
from drapeplan.qp import QpSolver, QuadraticProgram

SCENES = ("panel", "kindrape", "saddle")
KEPT = 30  # [-] consecutive QPs of a scene and kind: the middle of its wave
PASSES = 3  # [-] times that all QPs are solved
TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9)
ALIVE, AFRESH = "osqp, kept alive", "osqp"  # as the planner does; as qpsolvers does
SPARSE = ("piqp", "proxqp", "clarabel", "highs")
DENSE = ("daqp", "quadprog")  # solvers that want full matrices
FIXED = ("quadprog",)  # that take no tolerance
SETS = {
    "planned": "from the closed-form inverse",
    "stepped": "from the waypoint before",
    "taut": "ply hardly reaches",
    "contradictory": "to be refused",
}
CUTS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)  # [mm] by which fibers are shortened
VIOLATION = "worst violation of solved QPs [mm]"
HIGHEST = 1e-2  # [mm] upper end of the axis
LEAST = 1e-13  # [mm] violations below are drawn there
REACHED = 1e-9  # [mm] violation of points that others' cost is compared with


def measure(quick: bool) -> Results:
    """Record QPs and have every solver solve them."""
    names, keep = (SCENES[:1], 3) if quick else (SCENES, KEPT)
    recorded = [record(name) for name in names]
    taut = record_taut()[:: 18 if quick else 1]
    problems = {
        "planned": [p for planned, _ in recorded for p in _middle(planned, keep)],
        "stepped": [p for _, stepped in recorded for p in _middle(stepped, keep)],
        "taut": taut,
        "contradictory": [cut for p in taut[::4] if (cut := _contradictory(p))],
    }
    installed = qpsolvers.available_solvers
    missing = {
        name: "not installed"
        for name in (AFRESH, *SPARSE, *DENSE)
        if name not in installed
    }
    rows = []
    for title, each in problems.items():
        tried = list(_solvers(missing, TOLERANCES[:: 2 if quick else 1]))
        rows += _rows(title, each, tried, 1 if quick else PASSES)
    made = made_with(
        *("qpsolvers", "osqp", "piqp", "proxsuite", "clarabel", "daqp"),
        *("quadprog", "highspy"),
        quick=quick,
    )
    return Results("qp", rows, made, missing)


def draw(results: Results) -> Figure:
    """A panel for each set: violation against time, and how soon is refused."""
    figure = Figure(figsize=(WIDTH, 5.8), layout="constrained")
    panels = figure.subplots(2, 2)
    methods = list(dict.fromkeys(str(row["solver"]) for row in results.rows))
    for axes, (title, text) in zip(panels.flat, SETS.items(), strict=True):
        of_set = results.where(set=title)
        text, refusal = f"{of_set[0]['qps']} QPs, {text}", title == "contradictory"
        log_log(axes, text, "median time of a QP [ms]", "" if refusal else VIOLATION)
        for k, method in enumerate(methods):
            rows = results.where(set=title, solver=method)
            x = [row["median_ms"] for row in rows]
            y = [float(k) if refusal else _height(row) for row in rows]
            notes = _notes(rows, "refused" if refusal else "solved")
            scatter(axes, x, y, method, k, joined=True, notes=notes)
        if refusal:
            axes.set(yscale="linear", ylim=(len(methods) - 0.5, -0.5))
            axes.set_yticks(range(len(methods)), methods)
            continue
        axes.set_ylim(LEAST / 4, HIGHEST)
        rows = [row for row in of_set if row["solved"] == 1]
        front(axes, [r["median_ms"] for r in rows], [_height(r) for r in rows])
    legend(figure)
    return figure


def _height(row: dict) -> float:
    return max(row["worst_violation_mm"], LEAST)


def _notes(rows: list[dict], name: str) -> list[str]:
    """What share is solved, or refused, beside the first point of which it is so."""
    notes = [f"{100 * row[name]:.0f} %" if row[name] < 1 else "" for row in rows]
    return [note if note not in notes[:k] else "" for k, note in enumerate(notes)]


def _contradictory(problem: QuadraticProgram) -> QuadraticProgram | None:
    """The same with fibers so short that no point is left, if there is such a cut."""
    cuts = (replace(problem, h=problem.h - cut) for cut in CUTS)
    return next((cut for cut in cuts if not _feasible(cut)), None)


def _middle(problems: list, keep: int) -> list:
    first = max(0, (len(problems) - keep) // 2)
    return problems[first : first + keep]


def _rows(title: str, problems: list, tried: list, passes: int) -> list[dict]:
    """Figures of every solver and tolerance on one set of QPs."""
    times = np.empty((len(tried), passes, len(problems)))
    answers = [[] for _ in tried]
    for _, _, solve in tried:
        solve(problems[0])  # loads what it loads
    with uncollected():
        for n in range(passes):
            for k, problem in enumerate(problems):
                for m, (_, _, solve) in enumerate(tried):
                    start = time.process_time()
                    answer = solve(problem)
                    times[m, n, k] = time.process_time() - start
                    if n == 0:
                        answers[m].append(answer)
    times = times.min(axis=1)  # what others do on the machine only adds
    best = _best(problems, answers)
    rows = []
    for m, (name, tolerance, _) in enumerate(tried):
        found = float(np.mean([x is not None for x in answers[m]]))
        off = [
            problem.violation(x)
            for problem, x in zip(problems, answers[m], strict=True)
            if x is not None
        ]
        excess = [
            _cost(problem, x) - least
            for problem, x, least in zip(problems, answers[m], best, strict=True)
            if x is not None and np.isfinite(least)
        ]
        rows.append(
            {
                "set": title,
                "solver": name,
                "tolerance": tolerance,
                "qps": len(problems),
                "median_ms": 1e3 * float(np.median(times[m])),
                "p95_ms": 1e3 * float(np.percentile(times[m], 95)),
                "worst_violation_mm": max(off, default=LEAST),
                "worst_excess_cost": max(excess, default=0.0),
                "solved": found,
                "refused": 1 - found,
            }
        )
    return rows


def _solvers(missing: dict, tolerances: tuple) -> Iterator[tuple]:
    """Name, tolerance and solver; a solver returns a point, or None."""
    for tolerance in tolerances:
        alive = QpSolver("osqp", tolerance)
        yield ALIVE, tolerance, lambda problem, s=alive: _point(s.solve(problem))
    for name in (AFRESH, *SPARSE, *DENSE):
        for tolerance in tolerances[:1] if name in FIXED else tolerances:
            if name not in missing:
                options = _options(name, tolerance)
                yield (
                    *(name, None if name in FIXED else tolerance),
                    lambda problem, n=name, o=options: _afresh(problem, n, o),
                )


def _point(solution):
    return solution.x if solution.found else None


def _afresh(problem: QuadraticProgram, name: str, options: dict):
    """A solver's own word and point, without the planner's look at it."""
    H, G, A = problem.H.copy(), problem.G, problem.A
    H.sort_indices()
    if name in DENSE:
        H, G, A = H.toarray(), G.toarray(), A.toarray()
    sides = problem.lower, problem.upper
    asked = qpsolvers.Problem(H, problem.c, G, problem.h, A, problem.b, *sides)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            found = qpsolvers.solve_problem(asked, name, **options)
        except (qpsolvers.exceptions.QPError, ValueError):
            return None
    return found.x if found.found and found.x is not None else None


def _options(name: str, tolerance: float) -> dict:
    """A tolerance in the words of a solver; no solver has a limit of time."""
    match name:
        case "osqp":
            fixed = {"max_iter": 10000, "adaptive_rho_interval": 50}
            return {"eps_abs": tolerance, "eps_rel": tolerance, **fixed}
        case "piqp":
            return {"eps_abs": tolerance, "eps_rel": tolerance}
        case "proxqp":
            outer = {"max_iter": 50}  # by default 10000: a minute to refuse one QP
            return {"backend": "sparse", "eps_abs": tolerance, "eps_rel": 0.0, **outer}
        case "clarabel":
            names = "tol_feas", "tol_gap_abs", "tol_gap_rel"
            return dict.fromkeys(names, tolerance)
        case "highs":
            names = "primal_feasibility_tolerance", "dual_feasibility_tolerance"
            return dict.fromkeys(names, tolerance)
        case "daqp":
            return {"primal_tol": tolerance, "dual_tol": tolerance}
    return {}


def _feasible(problem: QuadraticProgram) -> bool:
    """Whether a linear program finds a point."""
    bounds = np.column_stack([problem.lower, problem.upper])
    sides = problem.G, problem.h, problem.A, problem.b, bounds
    return linprog(np.zeros_like(problem.c), *sides, method="highs").status == 0


def _best(problems: list, answers: list) -> list[float]:
    """Least cost of each QP among points that meet its rows."""
    return [
        min(
            (
                _cost(problem, each[k])
                for each in answers
                if each[k] is not None and problem.violation(each[k]) < REACHED
            ),
            default=np.inf,
        )
        for k, problem in enumerate(problems)
    ]


def _cost(problem: QuadraticProgram, x: np.ndarray) -> float:
    return float(x @ (csc_matrix(problem.H) @ x) / 2 + problem.c @ x)
