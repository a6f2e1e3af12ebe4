"""The leading QP, on responses whose optimum is known."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse import csc_matrix

import drapeplan.lead
from drapeplan.closures import Chords
from drapeplan.lead import (
    KEEP,
    LONGEST,
    OPEN,
    RESERVE,
    SINK,
    TILT_LEVER,
    StrokeLead,
    Task,
)
from drapeplan.legs import rotation
from drapeplan.qp import QpSolver, QuadraticProgram
from drapeplan.rings import outward, ring_of
from drapeplan.robot import Robot, arm_description
from tests.test_shape import rotations as turns
from urdf import read_tool

SPAN, HALF = 0.07, 0.02  # [m]
WIDE = (-0.1, 0.1)  # [m]
STEP = 1e-5  # [m], [rad] of fourth-order differences


@pytest.fixture(scope="module")
def robot():
    """Arm and tool of the examples."""
    return Robot(arm_description("ur10"), *read_tool("drape_tool_6x8"))


@pytest.fixture
def flat(robot):
    """All cups level on a square grid, nothing placed but cup (3, 2)."""
    i, j = np.divmod(np.arange(robot.n_cups), robot.columns)
    positions = np.stack([j, i, 0 * i], axis=1) * robot.pitch
    return positions, np.tile(np.eye(3), (robot.n_cups, 1, 1))


def respond(n, free, lift=1.0, lean=0.0):
    """Each stroke lifts its own cup, and leans it about t, in [rad/m]."""
    position, turn = np.zeros((2, n, 3, len(free)))
    position[free, 2, np.arange(len(free))] = -lift
    turn[free, 1, np.arange(len(free))] = lean
    return SimpleNamespace(position=position, rotation=turn)


def task(robot, request, toe_up=0.0):
    """Cup (3, 2) stands, its neighbors on the right and left land."""
    placed, landing = np.zeros((2, robot.n_cups), bool)
    placed[3 * robot.columns + 2] = True
    landing[3 * robot.columns + np.array([1, 3])] = True
    size = robot.rows, robot.columns
    ring = ring_of(*size, placed, landing)
    return placed, Task(
        request, ring, outward(*size, placed), np.full(len(ring), toe_up), HALF
    )


def corrected(robot, flat, work, placed, response, room=WIDE, slack=1e-2):
    """Strokes of all cups, zero for placed ones."""
    free = np.flatnonzero(~placed)
    limits = tuple(np.full(len(free), x) for x in room)
    lead = StrokeLead(Chords(robot), SPAN + slack)
    x = lead.correction(flat, response, work, np.zeros(len(free)), limits)
    out = np.zeros(robot.n_cups)
    out[free] = x
    return out


def test_heights_follow_the_landing_ring(robot, flat):
    """A landing cup that stands 2 mm high is brought down, up to the pull of KEEP."""
    high = flat[0] + [0, 0, 2e-3], flat[1]
    placed, work = task(robot, flat)
    response = respond(robot.n_cups, np.flatnonzero(~placed))
    x = corrected(robot, high, work, placed, response)
    landing = work.ring == 1
    np.testing.assert_allclose(x[landing], 2e-3 / (1 + KEEP), rtol=1e-4)


def test_far_cups_may_not_sink(robot, flat):
    """A stroke that levels a far cup by lowering it stops at what it may sink."""
    request = flat[0], np.tile(rotation("y", np.array(0.1)), (robot.n_cups, 1, 1))
    placed, work = task(robot, request)
    response = respond(robot.n_cups, np.flatnonzero(~placed), lean=20.0)
    x = corrected(robot, flat, work, placed, response)
    far = work.ring > 1
    n = request[1][0][:, 2]
    np.testing.assert_allclose(x[far] * n[2], SINK, rtol=1e-3)
    assert (x[work.ring == 1] > 10 * SINK).all()


def test_tilts_are_led_against_height(robot, flat):
    """One stroke, one tilt, one height: the weighted least squares by hand."""
    lean, ask = 20.0, 0.02
    request = flat[0], np.tile(rotation("y", np.array(ask)), (robot.n_cups, 1, 1))
    placed, work = task(robot, request)
    response = respond(robot.n_cups, np.flatnonzero(~placed), lean=lean)
    x = corrected(robot, flat, work, placed, response)[work.ring == 1]
    n = request[1][0][:, 2]
    gain = TILT_LEVER * lean * 1e-3
    best = gain * TILT_LEVER * ask / (gain**2 + n[2] ** 2 + KEEP)
    np.testing.assert_allclose(1e3 * x, best, rtol=1e-3)


def test_toe_up_leans_outward_edges_up(robot, flat):
    """Cups on either side of the placed one lean to either side."""
    placed, work = task(robot, flat, toe_up=0.01)
    response = respond(robot.n_cups, np.flatnonzero(~placed), lift=0.0, lean=20.0)
    x = corrected(robot, flat, work, placed, response)
    left, right = 3 * robot.columns + np.array([1, 3])
    turn = 20.0 * x[[left, right]]  # about t: lowers what lies along +s
    assert turn[0] > 1e-3
    assert turn[1] < -1e-3


def test_strokes_stay_in_their_room(robot, flat):
    """Limits hold, and so does the longest correction."""
    high = flat[0] + [0, 0, 0.05], flat[1]
    placed, work = task(robot, flat)
    response = respond(robot.n_cups, np.flatnonzero(~placed))
    x = corrected(robot, high, work, placed, response, room=(-1e-3, 3e-3))
    np.testing.assert_allclose(x[work.ring == 1], 3e-3, rtol=1e-6)
    x = corrected(robot, high, work, placed, response)
    np.testing.assert_allclose(x[work.ring == 1], LONGEST, rtol=1e-6)


def test_fibers_are_not_stretched(robot, flat):
    """A pull apart stops where the fiber to the placed cup is taut."""
    wanted = flat[0] + 0.0
    placed, work = task(robot, (wanted, flat[1]))
    free = np.flatnonzero(~placed)
    response = respond(robot.n_cups, free)
    right = 3 * robot.columns + 3
    wanted[right, 2] = -5e-3
    column = int(np.flatnonzero(free == right)[0])
    response.position[right, 0, column] = 1.0  # its stroke also carries it outward
    slack = 0.5e-3
    x = corrected(robot, flat, work, placed, response, slack=slack)
    assert x[right] == pytest.approx(slack - RESERVE, rel=0.02)
    loose = corrected(robot, flat, work, placed, response, slack=1e-2)
    assert loose[right] > 4e-3


def bent(robot, seed=0):
    """Cups somewhat above a square grid, tilted and turned at random."""
    rng = np.random.default_rng(seed)
    i, j = np.divmod(np.arange(robot.n_cups), robot.columns)
    positions = np.stack([j, i, 0 * i], axis=1) * robot.pitch
    positions = positions + rng.normal(0, 1e-3, positions.shape)
    return positions, turns(rng.normal(0, 0.03, (robot.n_cups, 3)))


def test_natural_lengths_change_as_the_rows_say(robot):
    """Against differences: cups move and turn at once, in four random ways."""
    poses, rng = bent(robot), np.random.default_rng(1)
    motion = rng.normal(size=(2, robot.n_cups, 3, 4))
    lead = StrokeLead(Chords(robot), SPAN - 5e-3)  # all fibers are watched
    rates, room = lead._fibers(
        poses, SimpleNamespace(position=motion[0], rotation=motion[1])
    )
    assert len(rates) == len(lead.chords)
    natural = lead._lengths(poses)[2]
    np.testing.assert_allclose(room, SPAN - 5e-3 - RESERVE - natural, atol=1e-15)
    for k in range(4):

        def length(h, k=k):
            step = h * motion[..., k]
            return lead._lengths((poses[0] + step[0], turns(step[1]) @ poses[1]))[2]

        near, far = (length(h) - length(-h) for h in (STEP, 2 * STEP))
        truth = (8 * near - far) / (12 * STEP)
        np.testing.assert_allclose(rates[:, k], truth, atol=1e-6 * np.abs(truth).max())


def test_tilts_do_not_stretch_taut_fibers(robot, flat):
    """Tilted cups asked to tilt further than fibers allow: their true lengths hold."""

    def tilted(angles):
        return flat[0], turns(np.outer(angles, [0.0, 1.0, 0.0]))

    n = robot.n_cups
    start, request = tilted(np.full(n, 0.1)), tilted(np.full(n, 0.13))
    placed, work = task(robot, request)
    response = respond(n, np.flatnonzero(~placed), lift=0.0, lean=20.0)
    taut = StrokeLead(Chords(robot), SPAN).overlong(start)
    kept, free = taut + RESERVE + 0.01e-3, taut + 5e-3
    ends = []
    for slack in (kept, free):
        x = corrected(robot, start, work, placed, response, slack=slack)
        ends.append(StrokeLead(Chords(robot), SPAN).overlong(tilted(0.1 + 20.0 * x)))
    assert taut < ends[0] <= kept
    assert ends[1] > kept + 0.05e-3


def test_strokes_at_their_limits_are_not_passed_at_all(robot, flat):
    """Not even by what a solver leaves open."""
    high = flat[0] + [0, 0, 0.05], flat[1]
    placed, work = task(robot, flat)
    response = respond(robot.n_cups, np.flatnonzero(~placed))
    x = corrected(robot, high, work, placed, response, room=(-1e-3, 3e-3))
    assert x.max() == 3e-3


def test_many_rows_need_not_all_be_handed_on(robot, monkeypatch):
    """Rows that may bind give the minimum of all, by far fewer rows."""
    rng, n = np.random.default_rng(0), 30
    A, G = rng.normal(size=(n, n)), rng.normal(size=(2000, n))
    none = csc_matrix((0, n)), np.zeros(0)
    far = np.abs(rng.normal(size=2000)) + 1.5
    program = QuadraticProgram(
        csc_matrix(A.T @ A + np.eye(n)),
        3 * rng.normal(size=n),
        csc_matrix(G),
        far,
        *none,
        np.full(n, -20.0),
        np.full(n, 20.0),
    )
    whole = QpSolver(tolerance=1e-9).solve(program)
    monkeypatch.setattr(drapeplan.lead, "CLOSE", -1e9)  # none is handed on at first
    lead, sizes = StrokeLead(Chords(robot), SPAN), []
    lead.solver, solve = QpSolver(tolerance=1e-9), QpSolver.solve
    monkeypatch.setattr(
        QpSolver, "solve", lambda s, p: sizes.append(len(p.h)) or solve(s, p)
    )
    found = lead._solved(program)
    assert found.x == pytest.approx(whole.x, abs=OPEN)
    assert (G @ found.x < far + 2 * OPEN).all()
    assert (G @ found.x > far - 1e-6).sum() > 1  # some do bind
    assert sizes[0] == 0 < sizes[-1] < 1000
