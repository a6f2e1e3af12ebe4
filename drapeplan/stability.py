r"""How stable a rest is: least curvature of the energy while all rows hold.

Rows in force are held by springs so stiff that they act as rigid. What is left is the
least eigenvalue of the banded :math:`H + k J^T J`, see docs/derivations.md, D22: where
that has a Cholesky factor it is positive, and Lanczos' method on its inverse finds it.
Where it has none, a dense solver says how far the rest is from stable.
"""

import numpy as np
from scipy.linalg import eigh
from scipy.linalg.lapack import dpbtrf, dpbtrs

from drapeplan.kkt import Layout
from drapeplan.legs import Array
from drapeplan.tool_energy import ToolTerms

HOLD = 1e7  # [N/m] springs that hold rows: 1e-8 of the curvature is lost by them
STEPS = 28  # of Lanczos' method; 26 bring the default tool to 1e-10
MOST_STEPS = 4 * STEPS  # for larger tools, whose least curvatures lie closer together
SURE = 1e-4  # [-] error of an eigenvalue, by its residual, that is good enough


def least_curvature(layout: Layout, terms: ToolTerms) -> float | None:
    """Least curvature of the energy along motions that keep the rows in force.

    Args:
        layout: Places of the free coordinates and of the rows in force.
        terms: Energy of the tool at rest.

    Returns:
        The curvature, [N m/rad]; None if the rows leave no motion.
    """
    if 5 * len(layout.cups) <= len(layout.rows):
        return None
    factor, info = dpbtrf(layout.held(terms, HOLD), lower=1)
    found = None if info else lanczos(factor)
    return dense_curvature(*layout.dense(terms)) if found is None else found


def lanczos(factor: Array) -> float | None:
    """Least eigenvalue of a positive matrix from its banded Cholesky factor.

    Args:
        factor: As LAPACK's dpbtrf leaves it, lower, shape (bands, k).

    Returns:
        The eigenvalue; None if it is not known well enough.
    """
    size = factor.shape[1]
    steps = min(MOST_STEPS, size)
    basis, tridiagonal = np.zeros((steps, size)), np.zeros((steps, steps))
    vector = np.random.default_rng(0).normal(size=size)  # no symmetry to fall for
    length = np.linalg.norm(vector)
    for k in range(steps):
        basis[k] = vector / length
        vector = dpbtrs(factor, basis[k], lower=1)[0]
        tridiagonal[k, k] = vector @ basis[k]
        for _ in range(2):  # once loses orthogonality
            vector = vector - (basis[: k + 1] @ vector) @ basis[: k + 1]
        length = np.linalg.norm(vector)
        done = k + 1
        if done % STEPS == 0 or done == steps:
            values, parts = np.linalg.eigh(tridiagonal[:done, :done])
            left = 0.0 if done == size else length * abs(parts[-1, -1])
            if left < SURE * values[-1]:
                return float(1 / values[-1])
        if done < steps:
            if length <= np.finfo(float).eps * tridiagonal[k, k]:
                return None
            tridiagonal[k, k + 1] = tridiagonal[k + 1, k] = length
    return None


def dense_curvature(H: Array, J: Array) -> float:
    """The same from dense arrays, of either sign.

    Args:
        H: Second derivatives, shape (k, k), in [N m/rad].
        J: Rows, shape (r, k), in [m/rad].

    Returns:
        The curvature, [N m/rad].
    """
    held = H + HOLD * (J.T @ J)
    values = eigh(held, eigvals_only=True, subset_by_index=[0, 0], check_finite=False)
    return float(values[0])
