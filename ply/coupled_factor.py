"""Many symmetric matrices at once: which are positive definite, and their solutions.

numpy factors by Cholesky but cannot solve with the factor, and a second factorization
takes twice as long as the first. Small blocks on the diagonal, inverted all together,
do it in a few products.
"""

import numpy as np
from numpy.typing import NDArray

from ply.fiber import Array

BLOCK = (
    16  # [-] largest block on the diagonal: smaller ones cost calls, larger inverses
)


def factors(matrices: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Lower factors of symmetric matrices, by Cholesky.

    Args:
        matrices: Matrices, shape (b, n, n).

    Returns:
        Factors, shape (b, n, n), the unit matrix where there is none, and which of the
        matrices are positive definite, shape (b,).
    """
    good = np.ones(len(matrices), dtype=bool)
    try:
        return np.asarray(np.linalg.cholesky(matrices)), good
    except np.linalg.LinAlgError:  # numpy does not say which of a batch failed
        out = np.empty_like(matrices)
    for k, matrix in enumerate(matrices):
        try:
            out[k] = np.linalg.cholesky(matrix)
        except np.linalg.LinAlgError:
            out[k], good[k] = np.eye(matrices.shape[-1]), False
    return out, good


def solve_factored(lower: Array, right: Array) -> Array:
    """Solutions x of L L' x = r.

    Args:
        lower: Lower factors L, shape (b, n, n).
        right: Right sides r, shape (b, n, k).

    Returns:
        Solutions, shape (b, n, k).
    """
    n = lower.shape[-1]
    size = max(m for m in range(1, min(n, BLOCK) + 1) if n % m == 0)
    first = range(0, n, size)
    diagonal = np.stack([lower[:, i : i + size, i : i + size] for i in first])
    inverse = np.linalg.inv(diagonal)
    x = np.array(right)
    for k, i in enumerate(first):
        own = slice(i, i + size)
        x[:, own] = inverse[k] @ (x[:, own] - lower[:, own, :i] @ x[:, :i])
    for k, i in reversed(list(enumerate(first))):
        own, later = slice(i, i + size), slice(i + size, n)
        x[:, own] = inverse[k].mT @ (x[:, own] - lower[:, later, own].mT @ x[:, later])
    return x
