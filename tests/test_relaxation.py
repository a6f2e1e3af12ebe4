"""What a step cannot meet is named: the row broken on purpose, and no other."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csc_matrix, diags, eye, hstack, vstack

from drapeplan.legs import leg_coordinates
from drapeplan.path import plan_path
from drapeplan.qp import QpSolver, QuadraticProgram
from drapeplan.relaxation import RowKind, _Parts, relax_step
from drapeplan.strokes import CLOSED, StrokeSolver, StrokeStatus
from tests.plans import scene, stages

LONGEST = 0.0708  # [m] span of 70 mm with 0.8 mm of take-up
FREE = np.zeros(48, bool)
SEED = 3e-3  # [m] error of the link that is broken on purpose
BANDS = 0.4e-3  # [m] of it that both cups' tolerances may hide


@pytest.fixture(scope="module")
def sphere():
    """Robot, joints and request with every cup at its target, on R = 1 m."""
    read = scene({"kind": "sphere", "radius_m": 1.0})
    cell, sequence, targets, wave = stages(read)
    path = plan_path(cell, targets, wave, sequence.index(sequence.start_cup))
    k = len(path.phase) - 1 - path.phase[::-1].index("wave")
    arm = cell.robot.arm_inverse(path.tool[k], np.array(read.robot.home_rad))
    poses = path.positions[k], path.rotations[k]
    legs = leg_coordinates(cell.robot.geometry, path.tool[k], *poses)
    return cell.robot, cell.robot.configuration(arm, legs), poses


def seeded(robot, row, error):
    """A solver one of whose interlinks is longer than all others."""
    solver = StrokeSolver(robot, LONGEST)
    rest = np.full(len(solver.closures), solver.closures._rest)
    rest[row] += error
    solver.closures._rest = rest
    return solver


@pytest.mark.parametrize(("row", "error"), [(0, SEED), (17, -SEED), (61, SEED)])
def test_one_bad_row_among_82_is_the_one_that_is_named(sphere, row, error):
    robot, q, poses = sphere
    solver = seeded(robot, row, error)
    found = relax_step(solver, solver.step(q, None, poses, FREE, ~FREE, np.inf))
    assert [(r.kind, r.index) for r in found.rows] == [(RowKind.INTERLINK, row)]
    assert found.rows[0].excess == pytest.approx(-error, abs=BANDS)
    assert found.rows[0].size == pytest.approx(1e3 * SEED, abs=1e3 * BANDS)


def test_squares_would_smear_it_over_its_neighbors(sphere):
    """The same rows with squared slacks: the bad one does not stand out alone."""
    robot, q, poses = sphere
    solver = seeded(robot, 17, SEED)
    step = solver.step(q, None, poses, FREE, ~FREE, np.inf)
    parts = _Parts(solver, step)
    rows = parts.rows(q[parts.columns])
    m, n = rows.matrix.shape
    slack = -eye(m, format="csc")
    sides = [hstack([rows.matrix, slack]), hstack([-rows.matrix, slack])]
    limits = np.concatenate([rows.upper - rows.value, rows.value - rows.lower])
    there = np.isfinite(limits)
    squares = QuadraticProgram(
        diags(np.concatenate([np.full(n, 1e-6), rows.price]), format="csc"),
        np.zeros(n + m),
        vstack(sides, format="csr")[there].tocsc(),
        limits[there],
        csc_matrix((0, n + m)),
        np.zeros(0),
        np.full(n + m, -np.inf),
        np.full(n + m, np.inf),
    )
    x = QpSolver("piqp").solve(squares).x[:n]
    excess = np.abs(rows.excess(rows.value + rows.matrix @ x))
    assert np.count_nonzero(excess > 0.01) > 10  # [mm]; one with the sum
    assert excess.max() < 0.8 * 1e3 * SEED


def test_a_stroke_beyond_its_limit_is_named_with_its_excess(sphere):
    robot, q, poses = sphere
    solver = StrokeSolver(robot, LONGEST)
    step = solver.step(q, None, poses, FREE, ~FREE, np.inf)
    column = int(robot.leg_columns[29, 2])
    upper = step.upper.copy()
    upper[column] = q[column] - 5e-3
    limited = replace(step, upper=upper)
    found = relax_step(solver, limited)
    assert [r.index for r in found.rows] == [column]
    assert found.rows[0].kind == RowKind.RATE  # the limit itself is farther away
    assert found.rows[0].excess == pytest.approx(5e-3, abs=BANDS)


def test_a_stall_is_a_failure_and_its_fibers_are_named(sphere):
    """Sphere R = 1 m: 0.3 mm of take-up stalls, 0.5 mm reaches 1e-9 m."""
    robot, q, poses = sphere
    short, long = (StrokeSolver(robot, 0.07 + x) for x in (0.3e-3, 0.5e-3))
    step = short.step(q, None, poses, FREE, ~FREE, np.inf)
    stalled = short.solve(step)
    assert stalled.status == StrokeStatus.STALLED
    assert not stalled.found
    assert max(np.abs(stalled.closure).max(), stalled.chord_excess.max()) > 10 * CLOSED
    found = relax_step(short, step)
    assert {r.kind for r in found.rows} <= {RowKind.FIBER, RowKind.ANGLE}
    assert found.rows[0].kind == RowKind.FIBER
    followed = long.solve(step)
    assert followed.status == StrokeStatus.FOLLOWED
    assert np.abs(followed.closure).max() < 1e-9


def test_a_point_where_all_rows_hold_is_held(sphere):
    robot, q, poses = sphere
    solver = StrokeSolver(robot, LONGEST)
    step = solver.step(q, None, poses, FREE, ~FREE, np.inf)
    disturbed = q.copy()
    rng = np.random.default_rng(0)
    disturbed[robot.leg_columns] += rng.normal(0, 0.005, (48, 6))
    found = relax_step(solver, replace(step, guess=disturbed))
    assert not found.rows
    held = solver.hold(step, found.q)
    assert held.found
    assert np.abs(held.closure).max() < CLOSED
    assert held.position_error.max() < 1e-4
