import os
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.sparse import csc_matrix

from drapeplan import qp
from drapeplan.errors import InputError
from drapeplan.qp import Multipliers, QpSolver, QuadraticProgram

INSTALLED = [n for n in qp.BACKENDS if find_spec(qp.PACKAGES.get(n, "osqp"))]
SEQUENCE = """
import hashlib
from tests.test_qp import sequence
from drapeplan.qp import QpSolver
solver = QpSolver()
digest = hashlib.sha256()
for problem in sequence():
    digest.update(solver.solve(problem).x.tobytes())
print(digest.hexdigest())
"""


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


def test_ctrl_c_within_a_solve_is_not_lost():
    """OSQP has a handler of its own while it solves."""
    problem, _ = program(0, n=300)
    alive = qp._Alive(problem, 1e-300)  # it would iterate for a second
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT))
    try:
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            alive.solve(problem, 1e-300)
    finally:
        timer.join()
        signal.signal(signal.SIGINT, before)


def sequence():
    """Programs of two patterns in turn, one of them without a solution."""
    made = [program(seed, n, 3)[0] for seed in range(6) for n in (8, 12)]
    made.insert(5, contradiction(made[2]))
    return made


def contradiction(made):
    """Two rows that say x0 = 0 and x0 = 1."""
    rows = csc_matrix(np.eye(len(made.c))[[0, 0]])
    return replace(made, A=rows, b=np.array([0.0, 1.0]))


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 1000))
def test_solution_satisfies_the_kkt_system(seed):
    made, expected = program(seed)
    found = QpSolver().solve(made)
    assert found.found
    assert_allclose(found.x, expected, atol=1e-5)
    assert found.violation < 1e-6


@pytest.mark.parametrize("backend", INSTALLED)
def test_every_back_end_meets_the_kkt_system(backend):
    solver = QpSolver(backend, 1e-9)
    for seed in range(4):
        made, expected = program(seed)
        found = solver.solve(made)
        assert found.found
        assert_allclose(found.x, expected, atol=1e-6)
        assert max(found.violation, found.dual) < 1e-6
        assert found.gap < 1e-5


@pytest.mark.parametrize("backend", INSTALLED)
def test_active_box(backend):
    made, _ = program(3)
    tight = replace(made, A=made.A[:0], b=made.b[:0], upper=0 * made.c)
    found = QpSolver(backend).solve(tight)
    assert found.found
    assert found.x.max() < 1e-6
    gradient = made.H @ found.x + made.c
    assert (gradient < 1e-4).all()  # at an upper bound the cost still falls outward
    assert_allclose(gradient * found.x, 0, atol=1e-4)
    assert max(found.dual, found.gap) < 1e-4


@pytest.mark.parametrize("backend", INSTALLED)
def test_contradiction_is_not_found_and_moves_nothing(backend):
    found = QpSolver(backend).solve(contradiction(program(1)[0]))
    assert not found.found
    assert not found.x.any()
    assert found.violation == np.inf


@pytest.mark.skipif("proxqp" not in INSTALLED, reason="proxsuite is not installed")
def test_proxqp_gives_up_after_its_steps(monkeypatch):
    problem = program(1)[0]
    assert QpSolver("proxqp").solve(problem).found
    monkeypatch.setattr(qp, "PROXIMAL_STEPS", 1)
    assert not QpSolver("proxqp").solve(problem).found


@pytest.mark.parametrize("part", ["A", "G", "lower", "upper"])
def test_violation_sees_every_kind_of_row(part):
    made, x = program(2)
    assert made.violation(x) < 1e-9
    if part == "A":
        moved = replace(made, b=made.b + 0.5)
    elif part == "G":
        moved = replace(made, h=np.array([x[0] - 0.5]))
    else:
        shift = 0.5 if part == "lower" else -0.5
        moved = replace(made, **{part: x + shift})
    assert moved.violation(x) == pytest.approx(0.5)


def test_forces_prove_a_solution_and_see_one_that_is_off():
    """By hand: 1 at an upper bound, 2 by an equality, 3 by a row."""
    n, eye = 3, np.eye(3)
    side = np.array([1.0, np.inf, np.inf])
    made = QuadraticProgram(
        csc_matrix(eye), np.full(n, -10.0), csc_matrix(eye[2:]), np.array([3.0]),
        csc_matrix(eye[1:2]), np.array([2.0]), np.full(n, -np.inf), side,
    )  # fmt: skip
    forces = Multipliers(np.array([7.0]), np.array([8.0]), np.array([9.0, 0.0, 0.0]))
    x = np.array([1.0, 2.0, 3.0])
    assert forces.residual(made, x) == 0
    assert forces.gap(made, x) == 0
    assert forces.residual(made, x + 0.1) == pytest.approx(0.1)
    assert replace(forces, z=np.array([6.5])).residual(made, x) == pytest.approx(0.5)
    assert replace(forces, y=np.array([8.5])).gap(made, x) == pytest.approx(1.0)


def test_kept_alive_it_gives_what_a_fresh_one_gives():
    solver = QpSolver()
    for made in sequence():
        alive, fresh = solver.solve(made), QpSolver().solve(made)
        assert alive.found == fresh.found
        assert_allclose(alive.x, fresh.x, atol=1e-5)


def test_one_object_lives_for_each_pattern_and_starts_from_its_last_solution():
    solver, first = QpSolver(), program(5)[0]
    cold = solver.solve(first)
    solver.solve(program(5, 12)[0])
    objects = list(solver._alive.values())
    again = solver.solve(first)
    assert len(objects) == 2
    assert set(map(id, solver._alive.values())) == set(map(id, objects))
    assert again.iterations < cold.iterations


def test_what_failed_does_not_stay():
    """After a contradiction, OSQP holds iterates of 1e9; the next must not see them."""
    solver, made = QpSolver(), program(1)[0]
    bad = contradiction(made)
    good = replace(bad, b=np.zeros(2))
    first = solver.solve(good)
    assert not solver.solve(bad).found
    assert solver.solve(good).x.tobytes() == first.x.tobytes()


def test_few_objects_are_kept():
    solver = QpSolver()
    for n in range(4, 5 + qp.KEPT):
        assert solver.solve(program(0, n)[0]).found
    assert len(solver._alive) == qp.KEPT


def test_same_sequence_same_bytes_in_two_processes():
    command = [sys.executable, "-c", SEQUENCE]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE) for _ in range(2)]
    digests = [process.communicate(timeout=60)[0] for process in both]
    assert len(digests[0]) > 60
    assert digests[0] == digests[1]


def test_an_unknown_back_end_is_one_line():
    with pytest.raises(InputError, match=r"no QP solver is called 'cplex'.*osqp, piqp"):
        QpSolver("cplex")


def test_a_missing_back_end_names_the_extra(monkeypatch):
    monkeypatch.setattr(qp, "find_spec", lambda name: None)
    with pytest.raises(
        InputError, match=r"piqp is not installed.*drapeplan\[solvers\]"
    ):
        QpSolver("piqp")
    assert QpSolver("osqp").backend == "osqp"


def test_a_new_cost_reaches_the_object_that_is_alive():
    """The constraints hold at the old answer too: no residual of theirs would tell."""
    solver, made = QpSolver(), program(5)[0]
    solver.solve(made)
    turned = replace(made, c=-made.c, H=2.0 * made.H)
    found = solver.solve(turned)
    assert found.dual < 1e-4
    assert_allclose(found.x, QpSolver().solve(turned).x, atol=1e-5)


def test_a_solver_is_not_believed_where_its_point_is_off(monkeypatch):
    monkeypatch.setattr(qp, "TRUSTED", 0.0)
    found = QpSolver("osqp", 1e-3).solve(program(4)[0])
    assert (found.found, found.violation) == (False, np.inf)
