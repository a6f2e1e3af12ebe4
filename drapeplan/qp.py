"""Quadratic programs: one call to the solver, one honest look at what it returned."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
import qpsolvers
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

Array = NDArray[np.float64]

# Accuracy in the problem's own units (mm and rad in the stroke problem), a fixed
# interval of step-size adaptation and no time limit: the same bytes every time.
OSQP_OPTIONS = {
    "eps_abs": 1e-7,
    "eps_rel": 1e-7,
    "max_iter": 10000,
    "adaptive_rho_interval": 50,
    "polishing": False,
}


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
class QpSolution:
    """What a solver returned, judged by its residual.

    Attributes:
        x: Best point, shape (n,); zero if the solver found none.
        found: Whether the solver says that it converged.
        violation: Largest violation of a constraint at x, recomputed.
    """

    x: Array
    found: bool
    violation: float


def solve(problem: QuadraticProgram, solver: str = "osqp") -> QpSolution:
    """Solve a sparse convex QP.

    Args:
        problem: The program; its rows should be of order one near the solution.
        solver: Any back end that qpsolvers knows.
    """
    options = OSQP_OPTIONS if solver == "osqp" else {}
    arguments = qpsolvers.Problem(
        problem.H,
        problem.c,
        problem.G,
        problem.h,
        problem.A,
        problem.b,
        problem.lower,
        problem.upper,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a failure is reported by its residual
        solution = qpsolvers.solve_problem(arguments, solver=solver, **options)
    x = solution.x
    # an infeasible problem may come back with a huge x, never mind its flag
    if not solution.found or x is None or not np.isfinite(x).all():
        return QpSolution(np.zeros_like(problem.c), False, np.inf)
    return QpSolution(x, True, problem.violation(x))
