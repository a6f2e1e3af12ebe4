import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from ply.errors import PlyError
from ply.fiber import FiberStatus, LengthStatus
from ply.grid import CupGrid
from ply.jacobian import point_jacobian
from ply.shape import PlySampling, evaluate, ply_fibers
from tests.test_shape import poses, rotations

GRID = CupGrid(3, 3, 0.11, 0.02)
UNEVEN = CupGrid(2, 3, 0.1, 0.015, s_length=0.0702, t_length=0.0699)
STEP = 1e-6  # [m, rad] of fourth-order differences: rounding then adds 1e-9
WIDE = 5e-4  # [rad] past which a fiber's length error counts: STRAIGHT of ply.fiber
EXACT = 1e-6  # [-, m/rad] analytic against finite differences; relative above 1
SETTLED = 1e-7  # [-, m/rad] differences whose error is known to be below
FEW = 0.03  # [-] share of differences that do not settle: slack at its limits
RIGID = 1e-9  # [-, m/rad] relative to the largest derivative
ROUNDING = 1e-12  # [-, m/rad] relative to the largest derivative: other order of sums
WEIGHTS = np.array([1.0, -8.0, 8.0, -1.0]) / 12  # of differences at -2, -1, 1, 2 steps
GRAVITY = {"gravity": (0.5, -0.3, -4.0), "stiffness": 5e-3}
SETTINGS = {
    "cubic": {"model": "cubic"},
    "cubic, band": {"model": "cubic", "take_up": 2e-4},
    "quartic": {"model": "quartic"},
    "quartic, band": {"model": "quartic", "take_up": 2e-4},
    "modal": {"model": "modal"},
    "modal, two across": {"model": "modal", "across": 2},
    "modal, one mode": {"model": "modal", "modes": 1},
    "modal, four modes": {"model": "modal", "modes": 4},
    "modal, band": {"model": "modal", "take_up": 2e-4},
    "modal, gravity": {"model": "modal", **GRAVITY},
    "modal, soft": {"model": "modal", "softness": 1e-4, "stiffness": 5e-3},
    "modal, all": {"model": "modal", "take_up": 2e-4, "softness": 1e-4, **GRAVITY},
}


def points_of(grid, seed=0):
    """Points of every region, overhang and corners included, shape (n, 2)."""
    far = [(n - 1) * grid.pitch + grid.half_width for n in (grid.columns, grid.rows)]
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.05, np.array(far) + 0.03, (80, 2))


def moved(cups, moves):
    """Cups after twists, shape (..., n_cups, 6)."""
    return cups[0] + moves[..., :3], rotations(moves[..., 3:]) @ cups[1]


def differences(grid, cups, points_st, settings, step):
    """Derivatives by all cups, shape (n, 3, n_cups, 6), by moving them."""
    moves = np.zeros((4, grid.n_cups, 6, grid.n_cups, 6))
    for k, size in enumerate((-2, -1, 1, 2)):
        for cup, axis in np.ndindex(grid.n_cups, 6):
            moves[k, cup, axis, cup, axis] = size * step
    there = moved(cups, moves)
    points = evaluate(grid, ply_fibers(grid, *there, **settings), *there, points_st)
    return np.einsum("k,kcanx->nxca", WEIGHTS, points) / step


def dense(jacobian, n_cups):
    """Derivatives by the twists of all cups, shape (..., n, 3, n_cups, 6)."""
    values, n = jacobian.values, len(jacobian.cups)
    full = np.zeros((*values.shape[:-4], n, n_cups, 3, 6))
    every = np.arange(n)
    for k in range(4):
        full[..., every, jacobian.cups[:, k], :, :] += values[..., k, :, :]
    return np.swapaxes(full, -2, -3)


def analytic(grid, cups, points_st, settings):
    """The Jacobian and its fibers."""
    fibers = ply_fibers(grid, *cups, **settings)
    known = ("across", "modes", "sides")
    given = {k: v for k, v in settings.items() if k not in known}
    return point_jacobian(grid, fibers, *cups, points_st, **given), fibers


def check_against_differences(grid, cups, points_st, settings):
    """Compare where two steps say that finite differences are right."""
    jacobian, fibers = analytic(grid, cups, points_st, settings)
    found = dense(jacobian, grid.n_cups)
    rough = differences(grid, cups, points_st, settings, 2 * STEP)
    fine = differences(grid, cups, points_st, settings, STEP)
    scale = np.maximum(abs(fine), 1)
    settled = abs(fine - rough) < SETTLED * scale
    assert (~settled).mean() < FEW
    assert_allclose((found / scale)[settled], (fine / scale)[settled], 0, EXACT)
    assert np.isfinite(found).all()
    return fibers


def tight(grid, seed, chord, settings, batch=()):
    """Cups drawn nearer, so that fibers bow, and disturbed; settings with sides."""
    positions, frames = poses(grid, seed, batch, play=2e-4)
    positions = positions * chord
    if settings["model"] == "modal":
        sides = ply_fibers(grid, positions, frames, **settings).sides
        settings = settings | {"sides": tuple(np.where(a == 0, 1, a) for a in sides)}
    return (positions, frames), settings


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("grid", [GRID, UNEVEN], ids=["even", "uneven"])
def test_derivatives_agree_with_finite_differences(name, grid):
    for seed, chord in enumerate((0.99, 0.996, 0.999)):
        cups, settings = tight(grid, seed, chord, SETTINGS[name])
        check_against_differences(grid, cups, points_of(grid, seed), settings)


@pytest.mark.parametrize("name", ["cubic, band", "quartic, band", "modal, band"])
def test_band_is_met_inside_and_outside(name):
    """One pose has fibers within the band and beyond both of its edges."""
    cups, settings = tight(GRID, 1, 0.9995, SETTINGS[name])
    cups[0][4, :2] += 4e-4
    fibers = check_against_differences(GRID, cups, points_of(GRID), settings)
    assert set(fibers.s_band.ravel()) == set(LengthStatus)


@pytest.mark.parametrize("name", ["quartic", "modal", "modal, soft"])
@pytest.mark.parametrize("chord", [1.001, 1.005])
def test_fibers_without_a_curve_change_as_what_they_keep(name, chord):
    cups, settings = tight(GRID, 0, chord, SETTINGS[name])
    fibers = check_against_differences(GRID, cups, points_of(GRID), settings)
    assert (fibers.s_status == FiberStatus.OVERSTRETCHED).any() or chord < 1.002


def test_taut_fibers_change_as_what_they_keep():
    """Chords shorter than L that three modes cannot follow."""
    grid = CupGrid(1, 2, 0.11, 0.02)
    frames = rotations(np.array([[0, -0.4, 0], [0, 0.4, 0.0]]))
    chord = np.array([grid.s_length - 2e-4, 0, 0])
    reach = grid.half_width * (frames[0, :, 0] + frames[1, :, 0])
    cups = np.stack([0 * chord, chord + reach]), frames
    settings = {"model": "modal", "sides": (np.ones((1, 1)), np.ones((0, 2)))}
    fibers = check_against_differences(grid, cups, points_of(grid), settings)
    assert (fibers.s_status == FiberStatus.TAUT).all()


@pytest.mark.parametrize("side", [1, -1])
def test_buckled_fibers_of_parallel_cups(side):
    """The hard case: no lean at all, slack, and a side that the caller chose."""
    positions, frames = poses(GRID, 0, play=0, tilt=0)
    sides = np.full((3, 2), side), np.full((2, 3), side)
    settings = {"model": "modal", "sides": sides}
    cups = positions * 0.99, frames
    fibers = check_against_differences(GRID, cups, points_of(GRID), settings)
    assert (fibers.s_side == side).all()


@pytest.mark.parametrize("take_up", [None, 1e-4])
@pytest.mark.parametrize("turn", [0.0, 0.1])
def test_cups_in_line_that_turn_about_their_normals(take_up, turn):
    """A strip does not bend in its own plane, but the cubic inside the band does."""
    grid = CupGrid(1, 2, 0.11, 0.02)
    angle = turn * np.array([[0, -1, 0], [0, 1.0, 0]])
    frames = rotations(angle)
    out = grid.half_width * (frames[0, :, 0] + frames[1, :, 0])
    span = np.array([grid.span, 0, 0])
    settings = {"model": "modal", "take_up": take_up}
    for _ in range(40):  # until the cubic has its length
        cups = np.stack([0 * span, span + out]), frames
        wrong = ply_fibers(grid, *cups, **settings).s_natural[0, 0, 1] - grid.span
        span[0] -= wrong
    settings["sides"] = np.ones((1, 1)), np.ones((0, 2))
    points_st = points_of(grid)
    jacobian, fibers = analytic(grid, cups, points_st, settings)
    assert not fibers.s_side.any()
    step = STEP if take_up else WIDE
    expected = differences(grid, cups, points_st, settings, step)
    yaw = dense(jacobian, 2)[:, 1, :, 5] - expected[:, 1, :, 5]
    assert_allclose(yaw, 0, rtol=0, atol=EXACT)


@pytest.mark.parametrize("side", [1, -1])
def test_both_sides_of_an_open_strip(side):
    cups, _ = tight(GRID, 3, 0.985, SETTINGS["modal"])
    sides = np.full((3, 2), side), np.full((2, 3), side)
    settings = {"model": "modal", "sides": sides}
    fibers = check_against_differences(GRID, cups, points_of(GRID), settings)
    assert (fibers.s_side == side).mean() > 0.7


@pytest.mark.parametrize("name", SETTINGS)
def test_common_twist_of_all_cups_moves_the_ply_rigidly(name):
    settings = {k: v for k, v in SETTINGS[name].items() if k != "gravity"}
    cups, settings = tight(GRID, 5, 0.995, settings)
    points_st = points_of(GRID)
    jacobian, fibers = analytic(GRID, cups, points_st, settings)
    points = evaluate(GRID, fibers, *cups, points_st)
    twist = np.array([0.3, -0.2, 0.5, 0.7, 0.4, -0.6])
    each = np.broadcast_to(twist, (GRID.n_cups, 6)).copy()
    each[:, :3] += np.cross(twist[3:], cups[0])
    moves = np.einsum("nxca,ca->nx", dense(jacobian, GRID.n_cups), each)
    expected = twist[:3] + np.cross(twist[3:], points)
    size = max(1, abs(jacobian.values).max())
    assert_allclose(moves, expected, rtol=0, atol=RIGID * size)


def test_cups_are_those_of_the_sampling():
    sampling = PlySampling.regular(GRID, 0.01, 0.015)
    cups, settings = tight(GRID, 0, 0.99, SETTINGS["modal"])
    jacobian, _ = analytic(GRID, cups, sampling.points_st.reshape(-1, 2), settings)
    around = sampling.cups_around.reshape(-1, 4)
    assert_array_equal(jacobian.cups, around)
    first = np.array([[c not in row[:k] for k, c in enumerate(row)] for row in around])
    assert not jacobian.values[~first].any()
    assert abs(jacobian.values[first]).max(axis=(-1, -2)).min() > 0


@pytest.mark.parametrize("name", ["cubic", "quartic", "modal, all"])
def test_batch_is_each_pose_alone(name, monkeypatch):
    cups, settings = tight(UNEVEN, 0, 0.99, SETTINGS[name], (2, 3))
    points_st = points_of(UNEVEN)
    whole, _ = analytic(UNEVEN, cups, points_st, settings)
    assert whole.values.shape == (2, 3, len(points_st), 4, 3, 6)
    monkeypatch.setattr("ply.jacobian.BLOCK", 1000)
    size = abs(whole.values).max()
    for n in np.ndindex(2, 3):
        one = settings | {}
        if "sides" in one:
            one["sides"] = tuple(side[n] for side in one["sides"])
        alone, _ = analytic(UNEVEN, (cups[0][n], cups[1][n]), points_st, one)
        error = whole.values[n] - alone.values
        assert_allclose(error, 0, rtol=0, atol=ROUNDING * size)


def test_gap_rows_are_derivatives_of_the_height_above_a_sphere():
    center, radius = np.array([0.1, 0.1, -1.0]), 0.9
    cups, settings = tight(GRID, 0, 0.99, SETTINGS["quartic"])
    points_st = points_of(GRID)
    jacobian, fibers = analytic(GRID, cups, points_st, settings)
    normals = evaluate(GRID, fibers, *cups, points_st) - center
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    rows = jacobian.gap_rows(normals)
    twists = np.random.default_rng(0).normal(size=(GRID.n_cups, 6))
    expected = np.einsum("nka,nka->n", rows, twists[jacobian.cups])

    def gaps(step):
        there = moved(cups, step * twists)
        fibers = ply_fibers(GRID, *there)
        points = evaluate(GRID, fibers, *there, points_st)
        return np.linalg.norm(points - center, axis=-1) - radius

    steps = STEP * np.array([-2, -1, 1, 2])
    found = WEIGHTS @ np.stack([gaps(step) for step in steps]) / STEP
    scale = np.maximum(abs(found), 1)
    assert_allclose(expected / scale, found / scale, rtol=0, atol=EXACT)


@pytest.mark.parametrize(
    ("argument", "settings", "points_st"),
    [
        ("model", {"model": "spline"}, [[0, 0]]),
        ("points_st", {}, [0, 0]),
        ("stiffness", {"model": "modal", "gravity": (0, 0, -3)}, [[0, 0]]),
        ("stiffness", {"model": "modal", "softness": 1e-4}, [[0, 0]]),
    ],
)
def test_bad_arguments_are_named(argument, settings, points_st):
    cups = poses(GRID, 0)
    fibers = ply_fibers(GRID, *cups)
    with pytest.raises(PlyError) as caught:
        point_jacobian(GRID, fibers, *cups, points_st, **settings)
    assert caught.value.argument == argument


def test_single_row_and_points_on_cups_alone():
    grid = CupGrid(1, 1, 0.11, 0.02)
    cups = poses(grid, 0)
    jacobian, _ = analytic(grid, cups, np.array([[0.01, 0.03]]), SETTINGS["modal"])
    arm = cups[1][0] @ [0.01, 0.03, 0]
    assert_allclose(jacobian.values[0, 0, :, :3], np.eye(3), rtol=0, atol=0)
    expected = [np.cross(axis, arm) for axis in np.eye(3)]
    assert_allclose(jacobian.values[0, 0, :, 3:].T, expected, rtol=0, atol=ROUNDING)
