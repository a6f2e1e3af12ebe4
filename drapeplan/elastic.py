r"""Elastic rows: the least that constraints must give, summed without squares.

Constraints :math:`l \le r(u) \le h` that cannot all hold are relaxed by slacks,

.. math::
    \min_{u} \; \sum_i p_i \, \max(l_i - r_i(u),\; 0,\; r_i(u) - h_i) .

A sum of squares would spread a contradiction over every row that it touches; the sum
itself is least at a vertex, where few rows give and all others hold [Fletcher1981].
Each linearization within a trust region is a linear program; a step is taken if the
true sum falls, and the region shrinks if it does not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix, eye, hstack, vstack

Array = NDArray[np.float64]

REACH = 0.05  # [rad], [m] first trust region
SMALLEST = 1e-7  # [rad], [m] trust region at which nothing more is tried
PROGRAMS = 40  # most linear programs
WORTH = 0.1  # [-] share of the promised fall that must come true
GAIN = 1e-3  # [-] share of the sum whose promised fall is not worth another step


@dataclass(frozen=True)
class Rows:
    """Constraints linearized at a point: lower <= value + matrix x <= upper.

    Attributes:
        value: Values at the point, shape (m,), in [mm].
        matrix: Derivatives, shape (m, n).
        lower: Least allowed values, shape (m,), in [mm].
        upper: Largest allowed values, shape (m,), in [mm].
        price: What one mm of slack costs, shape (m,).
    """

    value: Array
    matrix: csc_matrix
    lower: Array
    upper: Array
    price: Array

    def excess(self, value: Array | None = None) -> Array:
        """By how much rows are open: above (positive) or below (negative), [mm]."""
        value = self.value if value is None else value
        above = np.maximum(value - self.upper, 0.0)
        return above - np.maximum(self.lower - value, 0.0)

    def cost(self, value: Array | None = None) -> float:
        """Sum of all excess, each at its price."""
        return float(self.price @ np.abs(self.excess(value)))


def relax(rows: Rows, reach: float) -> Array:
    """Least costly step of a linearization, a linear program.

    Args:
        rows: The constraints; all of them may give.
        reach: Largest change of a variable.

    Returns:
        The step, shape (n,).
    """
    from scipy.optimize import linprog  # slow to import, and needed by failures alone

    m, n = rows.matrix.shape
    slack = -eye(m, format="csc")
    sides = [hstack([rows.matrix, slack]), hstack([-rows.matrix, slack])]
    limits = np.concatenate([rows.upper - rows.value, rows.value - rows.lower])
    there = np.isfinite(limits)
    found = linprog(
        np.concatenate([np.zeros(n), rows.price]),
        vstack(sides, format="csr")[there],
        limits[there],
        bounds=[(-reach, reach)] * n + [(0, None)] * m,
        method="highs",
    )
    return np.zeros(n) if found.x is None else np.asarray(found.x[:n])


def least_open(
    linearize: Callable[[Array], Rows],
    start: Array,
    enough: Callable[[Rows], bool] = lambda rows: False,
) -> tuple[Array, Rows]:
    """Point nearby at which the constraints are open by the least sum.

    Args:
        linearize: Constraints at a point.
        start: Where to begin, shape (n,).
        enough: Whether rows are open by so little that the search may end.

    Returns:
        The point, and the constraints there.
    """
    u, rows, reach = start, linearize(start), REACH
    for _ in range(PROGRAMS):
        if enough(rows):
            break
        x = relax(rows, reach)
        promised = rows.cost() - rows.cost(rows.value + rows.matrix @ x)
        if promised <= GAIN * rows.cost() or reach < SMALLEST:
            break
        there = linearize(u + x)
        fall = rows.cost() - there.cost()
        if fall > WORTH * promised:
            u, rows = u + x, there
            reach = 2 * reach if fall > 0.75 * promised else reach
        else:
            reach = np.abs(x).max() / 4
    return u, rows
