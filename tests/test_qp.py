import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.sparse import csc_matrix

from drapeplan.qp import QuadraticProgram, solve


def program(seed, n=8, m=3):
    """A random program whose box is wide, with its solution from the KKT system."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, n))
    H = root @ root.T + np.eye(n)
    c, A, b = rng.normal(size=n), rng.normal(size=(m, n)), rng.normal(size=m)
    far = np.full(n, 100.0)
    G, h = csc_matrix(np.eye(n)[:1]), np.array([100.0])
    made = QuadraticProgram(csc_matrix(H), c, G, h, csc_matrix(A), b, -far, far)
    KKT = np.block([[H, A.T], [A, np.zeros((m, m))]])
    return made, np.linalg.solve(KKT, np.concatenate([-c, b]))[:n]


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 1000))
def test_solution_satisfies_the_kkt_system(seed):
    made, expected = program(seed)
    found = solve(made)
    assert found.found
    assert_allclose(found.x, expected, atol=1e-5)
    assert found.violation < 1e-6


def test_active_box():
    made, _ = program(3)
    tight = QuadraticProgram(
        made.H, made.c, made.G, made.h, made.A[:0], made.b[:0], made.lower, 0 * made.c
    )
    found = solve(tight)
    assert found.found
    assert found.x.max() < 1e-6
    gradient = made.H @ found.x + made.c
    assert (gradient < 1e-4).all()  # at an upper bound the cost still falls outward
    assert_allclose(gradient * found.x, 0, atol=1e-4)


def test_contradiction_is_not_found_and_moves_nothing():
    made, _ = program(1)
    rows, sides = csc_matrix(np.eye(8)[[0, 0]]), np.array([0.0, 1.0])
    bad = QuadraticProgram(
        made.H, made.c, made.G, made.h, rows, sides, made.lower, made.upper
    )
    found = solve(bad)
    assert not found.found
    assert not found.x.any()
    assert found.violation == np.inf


@pytest.mark.parametrize("part", ["A", "G", "lower", "upper"])
def test_violation_sees_every_kind_of_row(part):
    made, x = program(2)
    assert made.violation(x) < 1e-9
    if part == "A":
        moved = QuadraticProgram(**{**vars(made), "b": made.b + 0.5})
    elif part == "G":
        moved = QuadraticProgram(**{**vars(made), "h": np.array([x[0] - 0.5])})
    else:
        shift = 0.5 if part == "lower" else -0.5
        moved = QuadraticProgram(**{**vars(made), part: x + shift})
    assert moved.violation(x) == pytest.approx(0.5)


def test_same_problem_same_bytes():
    made, _ = program(5)
    assert solve(made).x.tobytes() == solve(made).x.tobytes()
