"""QPs recorded from real waves: time, worst violation and success of each solver."""

import json
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import qpsolvers

from drapeplan.cell import build_cell, read_sources
from drapeplan.legs import leg_coordinates
from drapeplan.motion import follow
from drapeplan.path import CupState
from drapeplan.planner import make_request
from drapeplan.qp import PACKAGES, QpSolution, QpSolver
from drapeplan.scene import read_scene, scene_from
from drapeplan.sequence import make_sequence
from drapeplan.strokes import StrokeSolver

EXAMPLES = Path(__file__).parent.parent / "examples"
SCENES = ("panel", "saddle")
TOLERANCES = (1e-3, 1e-5, 1e-6, 1e-7)
SPHERE = {
    "format": "drapeplan-scene/1",
    "mold": {"surface": {"kind": "sphere", "radius_m": 1.0}},
}
TAKE_UPS = (0.3e-3, 0.35e-3, 0.4e-3, 0.45e-3, 0.5e-3)  # [m]
OTHERS = 1e-8  # [-] tolerance asked of the other solvers
TOOLS = ((4, 3), (8, 6))  # rows and columns of the tools that Pink moves
HEAD = "    solver          median ms   p95 ms   worst mm   success"


class Recorder(QpSolver):
    """A solver that keeps what it is asked."""

    def __init__(self):
        """OSQP, kept alive."""
        super().__init__()
        self.problems = []

    def solve(self, problem):
        """Keep, then solve."""
        self.problems.append(problem)
        return super().solve(problem)


class Cold:
    """OSQP as qpsolvers runs it: set up anew at each call."""

    def __init__(self, tolerance):
        """Ask for a tolerance."""
        self.options = {"eps_abs": tolerance, "eps_rel": tolerance, "max_iter": 10000}
        self.options["adaptive_rho_interval"] = 50  # the same bytes each time

    def solve(self, problem):
        """Set up and solve."""
        sides = problem.G, problem.h, problem.A, problem.b, problem.lower, problem.upper
        asked = qpsolvers.Problem(problem.H, problem.c, *sides)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = qpsolvers.solve_problem(asked, "osqp", **self.options)
        return QpSolution(found.x, found.found, problem.violation(found.x))


def run(quick: bool) -> dict:
    """Every solver on the recorded QPs, then Pink on one of the steps."""
    names = SCENES[:1] if quick else SCENES
    recorded = [record(name) for name in names]
    missing = [name for name in PACKAGES if name not in qpsolvers.available_solvers]
    result = {"scenes": ", ".join(names), "missing": ", ".join(missing) or "none"}
    sets = {
        "planned": [problem for planned, _ in recorded for problem in planned],
        "from the waypoint before": [p for _, stepped in recorded for p in stepped],
        "taut fibers": record_taut(),
    }
    for title, problems in sets.items():
        rows = {name: score(solver, problems) for name, solver in solvers(missing)}
        result[f"QPs, {title}"] = len(problems)
        result[f"figures, {title}"] = rows
        lines = [_line(name, row) for name, row in rows.items()]
        result[f"table, {title}"] = [f"  {title}", HEAD, *lines]
    steps = [pink(*tool) for tool in (TOOLS[:1] if quick else TOOLS)]
    result["pink"] = {str(k): step for k, step in enumerate(steps)}
    result["pink, table"] = ["  against Pink", *(_pink_line(step) for step in steps)]
    return result


def record(name: str) -> tuple[list, list]:
    """QPs of a plan's strokes, and of its wave from the joints of the waypoint before.

    The first start from the closed-form inverse of the legs, which is nearly the
    answer; the others have a whole waypoint to go, as a differential IK has.
    """
    path = EXAMPLES / f"{name}.yaml"
    scene = read_scene(path)
    cell = build_cell(scene, read_sources(scene, EXAMPLES))
    sequence = make_sequence(scene.sequence, cell.grid.rows, cell.grid.columns, "")
    asked = make_request(cell, sequence).path
    planned, stepped = Recorder(), Recorder()
    q = follow(cell, asked, qp=planned).q
    take_up = scene.ply.take_up_mm * 1e-3
    solver = StrokeSolver(cell.robot, cell.sampling.grid.span + take_up, stepped)
    columns = cell.robot.leg_columns
    for k in np.flatnonzero(np.array(asked.phase) == "wave"):
        landed = asked.states[k] == CupState.PLACED
        fixed = landed & (asked.states[k - 1] == CupState.PLACED)
        guess = q[k].copy()
        guess[columns[~fixed]] = q[k - 1][columns[~fixed]]
        poses = asked.positions[k], asked.rotations[k]
        landing = asked.states[k] >= CupState.LANDING
        solver.solve(solver.step(guess, None, poses, fixed, landing, np.inf))
    return planned.problems, stepped.problems


def record_taut() -> list:
    """QPs of a ply laid on a sphere that its fibers hardly reach around."""
    scene = scene_from(SPHERE, "benchmark")
    cell = build_cell(scene, read_sources(scene, EXAMPLES))
    sequence = make_sequence(scene.sequence, cell.grid.rows, cell.grid.columns, "")
    asked = make_request(cell, sequence).path
    k = int(np.flatnonzero(np.array(asked.phase) == "wave")[-1])
    poses, robot, recorder = (
        (asked.positions[k], asked.rotations[k]),
        cell.robot,
        Recorder(),
    )
    legs = leg_coordinates(robot.geometry, asked.tool[k], *poses)
    arm = robot.arm_inverse(asked.tool[k], np.array(scene.robot.home_rad))
    nobody = np.zeros(robot.n_cups, bool)
    for take_up in TAKE_UPS:
        solver = StrokeSolver(robot, cell.sampling.grid.span + take_up, recorder)
        q = robot.configuration(arm, legs)
        solver.solve(solver.step(q, None, poses, nobody, ~nobody, np.inf))
    return recorder.problems


def solvers(missing: list[str]):
    """Names and solvers, OSQP cold and kept alive first."""
    for tolerance in TOLERANCES:
        yield f"osqp {tolerance:.0e} cold", Cold(tolerance)
        yield f"osqp {tolerance:.0e} alive", QpSolver("osqp", tolerance)
    for name in PACKAGES:
        if name not in missing:
            yield f"{name} {OTHERS:.0e}", QpSolver(name, OTHERS)


def score(solver, problems: list) -> dict:
    """Times and residuals of one solver on all problems, in the order of the wave."""
    solver.solve(problems[0])  # loads what it loads
    times, found = [], []
    for problem in problems:
        start = time.perf_counter()
        found.append(solver.solve(problem))
        times.append(time.perf_counter() - start)
    solved = [solution.violation for solution in found if solution.found]
    return {
        "median_ms": round(1e3 * float(np.median(times)), 3),
        "p95_ms": round(1e3 * float(np.percentile(times, 95)), 3),
        "worst_violation_mm": float(f"{max(solved, default=np.inf):.2g}"),
        "success": round(len(solved) / len(problems), 4),
    }


def pink(rows: int, columns: int) -> dict:
    """Pink's differential IK and ours on one step, in a process of their own.

    Pinocchio's data of the 6 x 8 tool takes 820 MB, which the process gives back.
    """
    command = [sys.executable, "-m", "benchmarks._pink", str(rows), str(columns)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


def _line(name: str, row: dict) -> str:
    times = f"{row['median_ms']:9.2f} {row['p95_ms']:8.2f}"
    violation = row["worst_violation_mm"]
    return f"    {name:<16} {times}   {violation:8.1e} {100 * row['success']:7.1f} %"


def _pink_line(step: dict) -> str:
    if "missing" in step:
        return f"    missing: {step['missing']}"
    ours, theirs = step["ours"], step["pink"]
    tool = f"    {step['tool']}: {step['ratio']:.0f} times faster,"
    times = f"{ours['ms']:.2f} against {theirs['ms']:.1f} ms,"
    left = f"interlinks {ours['closure_mm']:.1e} against {theirs['closure_mm']:.1e} mm"
    return f"{tool} {times} {left}"
