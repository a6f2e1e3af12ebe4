import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from ply.coupled_factor import factors, solve_factored

ROUNDING = 1e-11  # [-] of matrices of condition below 1e3


@pytest.mark.parametrize("size", [1, 7, 30, 60, 195])
def test_solutions_are_those_of_the_matrix(size):
    rng = np.random.default_rng(size)
    half = rng.normal(size=(3, size, size))
    matrices = half @ half.mT + size * np.eye(size)
    right = rng.normal(size=(3, size, 2))
    lower, good = factors(matrices)
    assert good.all()
    found = solve_factored(lower, right)
    assert_allclose(found, np.linalg.solve(matrices, right), rtol=0, atol=ROUNDING)


def test_indefinite_matrices_spoil_no_other():
    matrices = np.stack([np.eye(4), np.diag([1.0, 1, 1, -1]), 4 * np.eye(4)])
    lower, good = factors(matrices)
    assert_array_equal(good, [True, False, True])
    assert_array_equal(lower[2], 2 * np.eye(4))
    assert np.isfinite(lower).all()
