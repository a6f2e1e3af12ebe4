"""Quadratic programs: one adapter to the solvers, one honest look at their answers."""

from __future__ import annotations

import signal
import warnings
from collections import OrderedDict
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
import osqp
from numpy.typing import NDArray
from scipy.sparse import csc_matrix, eye, vstack

from drapeplan.errors import InputError

Array = NDArray[np.float64]

TOLERANCE = 1e-7  # [-] asked of a solver, in the rows' own units (mm in the strokes)
TRUSTED = 1e4  # [-] tolerances by which a row may stay open in what counts as solved
PROXIMAL_STEPS = 50  # [-] of proxqp: it never refuses strokes' QPs by itself
KEPT = 8  # OSQP objects that stay alive, one for each pattern, the latest used
PACKAGES = {"piqp": "piqp", "proxqp": "proxsuite", "clarabel": "clarabel"}
PACKAGES |= {"daqp": "daqp"}  # modules that bring the solvers of the extra
BACKENDS = ("osqp", *PACKAGES)


@dataclass(frozen=True)
class QuadraticProgram:
    """minimise x'Hx/2 + c'x subject to Gx <= h, Ax = b, lower <= x <= upper."""

    H: csc_matrix
    c: Array
    G: csc_matrix
    h: Array
    A: csc_matrix
    b: Array
    lower: Array
    upper: Array

    def violation(self, x: Array) -> float:
        """Largest violation of a constraint at x, in the constraint's unit."""
        parts = [
            np.abs(self.A @ x - self.b),
            self.G @ x - self.h,
            self.lower - x,
            x - self.upper,
        ]
        return max(float(part.max(initial=0.0)) for part in parts)


@dataclass(frozen=True)
class Multipliers:
    """Forces of the constraints: Hx + c + G'z + A'y + z_box = 0 at the solution.

    Attributes:
        z: Of the inequalities, not negative.
        y: Of the equalities.
        z_box: Of the bounds: positive at an upper one, negative at a lower one.
    """

    z: Array
    y: Array
    z_box: Array

    def residual(self, problem: QuadraticProgram, x: Array) -> float:
        """Largest entry of the Lagrangian's gradient, in cost per unit of x."""
        gradient = problem.H @ x + problem.c + problem.G.T @ self.z
        gradient += problem.A.T @ self.y + self.z_box
        return float(np.abs(gradient).max(initial=0.0))

    def gap(self, problem: QuadraticProgram, x: Array) -> float:
        """Cost by which primal and dual objective differ."""
        up, down = np.maximum(self.z_box, 0.0), np.minimum(self.z_box, 0.0)
        gap = x @ (problem.H @ x) + problem.c @ x
        gap += problem.h @ self.z + problem.b @ self.y
        gap += _dot(problem.upper, up) + _dot(problem.lower, down)
        return float(abs(gap))


@dataclass(frozen=True)
class QpSolution:
    """What a solver returned, judged by residuals recomputed from the problem.

    Attributes:
        x: Best point, shape (n,); zero if the solver found none.
        found: Whether the solver says that it converged, and its point bears it out.
        violation: Largest violation of a constraint at x, in the constraint's unit.
        dual: Largest entry of the Lagrangian's gradient, in cost per unit of x.
        gap: Difference of primal and dual objective, in units of cost.
        iterations: Iterations of the solver, 0 where it does not tell.
    """

    x: Array
    found: bool
    violation: float
    dual: float = np.inf
    gap: float = np.inf
    iterations: int = 0


class QpSolver:
    """One solver for a sequence of sparse convex QPs.

    OSQP stays alive: one object for each sparsity pattern, whose numbers are updated
    and which starts from its last solution. It has no time limit and adapts its step
    at fixed iterations, so the same sequence of problems gives the same bytes. The
    other back ends go through qpsolvers and start afresh each time.
    """

    def __init__(self, backend: str = "osqp", tolerance: float = TOLERANCE) -> None:
        """Check that the back end is there.

        Args:
            backend: "osqp", "piqp", "proxqp", "clarabel" or "daqp".
            tolerance: What is asked of the solver; rows should be of order one.

        Raises:
            InputError: If the back end is unknown or not installed.
        """
        if backend not in BACKENDS:
            problem = f"no QP solver is called {backend!r}"
            raise InputError("solver", "", problem, f"use {', '.join(BACKENDS)}")
        if backend in PACKAGES and find_spec(PACKAGES[backend]) is None:
            remedy = "pip install 'drapeplan[solvers]' brings it"
            raise InputError("solver", "", f"{backend} is not installed", remedy)
        self.backend, self.tolerance = backend, tolerance
        self._alive: OrderedDict[tuple[bytes, ...], _Alive] = OrderedDict()

    def solve(self, problem: QuadraticProgram) -> QpSolution:
        """Solve a QP.

        Args:
            problem: The program; keep explicit zeros, so that the pattern stays.

        Returns:
            The solution, with x = 0 and infinite residuals where there is none.
        """
        if self.backend == "osqp":
            return self._solve_alive(problem)
        return _solve_afresh(problem, self.backend, self.tolerance)

    def _solve_alive(self, problem: QuadraticProgram) -> QpSolution:
        key = _pattern(problem)
        alive = self._alive.pop(key, None)
        if alive:
            alive.update(problem)
            solution = alive.solve(problem, self.tolerance)
            if solution.found:
                self._alive[key] = alive
                return solution
        # What failed keeps iterates of 1e9: a fresh object decides, and never stays.
        alive = _Alive(problem, self.tolerance)
        solution = alive.solve(problem, self.tolerance)
        if solution.found:
            self._alive[key] = alive
            if len(self._alive) > KEPT:
                self._alive.popitem(last=False)
        return solution


class _Alive:
    """An OSQP object and where the entries of a problem go in its matrices."""

    def __init__(self, problem: QuadraticProgram, tolerance: float) -> None:
        H, n = problem.H, len(problem.c)
        column = np.repeat(np.arange(n), np.diff(H.indptr))
        self._upper = np.flatnonzero(H.indices <= column)
        starts = np.concatenate(
            [[0], np.cumsum(np.bincount(column[self._upper], None, n))]
        )
        triangle = H.data[self._upper], H.indices[self._upper], starts
        rows = vstack(
            [
                _numbered(problem.G, 0),
                _numbered(problem.A, problem.G.nnz),
                _numbered(eye(n, format="csc"), problem.G.nnz + problem.A.nnz),
            ],
            format="csc",
        )
        self._order = rows.data.astype(int) - 1
        self._ones = np.ones(n)
        rows = csc_matrix(
            (self._entries(problem), rows.indices, rows.indptr), rows.shape
        )
        self._solver = osqp.OSQP()
        self._solver.setup(
            csc_matrix(triangle, (n, n)),
            problem.c,
            rows,
            *self._sides(problem),
            eps_abs=tolerance,
            eps_rel=tolerance,
            max_iter=10000,
            verbose=False,
            adaptive_rho_interval=50,  # a count: by default it is measured in time
            polishing=False,
        )

    def update(self, problem: QuadraticProgram) -> None:
        """Put the numbers of another problem of the same pattern in place."""
        low, high = self._sides(problem)
        self._solver.update(
            q=problem.c,
            l=low,
            u=high,
            Px=problem.H.data[self._upper],
            Ax=self._entries(problem),
        )

    def solve(self, problem: QuadraticProgram, tolerance: float) -> QpSolution:
        """Solve from the last solution, if there is one.

        OSQP takes Ctrl-C for itself while it solves: it is handed on, and where that
        ends nothing, as in workers, the solver goes on.
        """
        result = self._solver.solve(raise_error=False)
        while result.info.status_val == osqp.SolverStatus.OSQP_SIGINT:
            signal.raise_signal(signal.SIGINT)
            result = self._solver.solve(raise_error=False)
        says = result.info.status_val == osqp.SolverStatus.OSQP_SOLVED
        split = np.cumsum([len(problem.h), len(problem.b)])
        forces = Multipliers(*np.split(np.array(result.y), split))
        x = np.array(result.x)
        return _judged(problem, says, x, forces, tolerance, result.info.iter)

    def _entries(self, problem: QuadraticProgram) -> Array:
        parts = [problem.G.data, problem.A.data, self._ones]
        entries: Array = np.concatenate(parts)[self._order]
        return entries

    @staticmethod
    def _sides(problem: QuadraticProgram) -> tuple[Array, Array]:
        low = [np.full(len(problem.h), -np.inf), problem.b, problem.lower]
        return np.concatenate(low), np.concatenate(
            [problem.h, problem.b, problem.upper]
        )


def _numbered(matrix: csc_matrix, first: int) -> csc_matrix:
    """The pattern of a matrix with the running numbers of its entries, from 1."""
    data = np.arange(first + 1, first + 1 + matrix.nnz, dtype=float)
    return csc_matrix((data, matrix.indices, matrix.indptr), matrix.shape)


def _pattern(problem: QuadraticProgram) -> tuple[bytes, ...]:
    """Where a problem has entries, as a key."""
    parts = problem.H, problem.G, problem.A
    return tuple(a.tobytes() for m in parts for a in (m.indptr, m.indices))


def _solve_afresh(
    problem: QuadraticProgram, backend: str, tolerance: float
) -> QpSolution:
    """Solve by a back end of qpsolvers, from nothing."""
    import qpsolvers  # imports every solver that is installed

    H, G, A = problem.H.copy(), problem.G, problem.A
    H.sort_indices()  # piqp reads them in order
    if backend == "daqp":  # dense only
        H, G, A = H.toarray(), G.toarray(), A.toarray()
    sides = problem.lower, problem.upper
    arguments = qpsolvers.Problem(H, problem.c, G, problem.h, A, problem.b, *sides)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a failure is reported by its residual
        try:
            options = _options(backend, tolerance)
            solution = qpsolvers.solve_problem(arguments, solver=backend, **options)
        except (qpsolvers.exceptions.QPError, ValueError):
            return _judged(problem, False, None, None, tolerance)
    forces = Multipliers(solution.z, solution.y, solution.z_box)
    return _judged(problem, solution.found, solution.x, forces, tolerance)


def _options(backend: str, tolerance: float) -> dict[str, Any]:
    """A tolerance in the words of a back end."""
    match backend:
        case "daqp":
            return {"primal_tol": tolerance, "dual_tol": tolerance}
        case "clarabel":
            names = "tol_feas", "tol_gap_abs", "tol_gap_rel"
            return dict.fromkeys(names, tolerance)
        case "proxqp":
            steps = {"backend": "sparse", "max_iter": PROXIMAL_STEPS}
            return {**steps, "eps_abs": tolerance, "eps_rel": 0.0}
        case _:
            return {"eps_abs": tolerance, "eps_rel": tolerance}


def _judged(
    problem: QuadraticProgram,
    says: bool,
    x: Array | None,
    forces: Multipliers | None,
    tolerance: float,
    iterations: int = 0,
) -> QpSolution:
    """A solver's word against the residuals."""
    # an infeasible problem may come back with a huge x, or daqp's with "found"
    if not says or x is None or forces is None or not np.isfinite(x).all():
        return QpSolution(
            np.zeros_like(problem.c), False, np.inf, iterations=iterations
        )
    violation = problem.violation(x)
    if violation > TRUSTED * tolerance:
        return QpSolution(
            np.zeros_like(problem.c), False, np.inf, iterations=iterations
        )
    residuals = forces.residual(problem, x), forces.gap(problem, x)
    return QpSolution(x, True, violation, *residuals, iterations)


def _dot(bound: Array, force: Array) -> float:
    """Product of bounds and forces; a bound at infinity has no force."""
    finite = np.isfinite(bound)
    return float(bound[finite] @ force[finite])
