import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from ply.errors import PlyError
from ply.free_edge import CORNER_TIP, free_edge_droop, tip_droop
from ply.grid import CupGrid
from ply.shape import PlySampling
from tests.test_shape import poses, rotations

GRID = CupGrid(3, 4, 0.11, 0.02)
OVERHANG, STIFFNESS, WEIGHT = 0.03, 5e-4, np.array([0.0, 0.0, -3.04])
TIP = 3.04 * OVERHANG**4 / (8 * STIFFNESS)  # [m] 0.62 mm
ROUNDING = 1e-15  # [m] of droops below 2 mm
FLAT = np.broadcast_to(np.eye(3), (GRID.n_cups, 3, 3))
PLATE = 0.05  # [-] of an edge's droop: corner tip against the plate
BESIDE = 0.6  # [-] of an edge's droop: elsewhere along a corner
SLOPE, BEND = 0.1, 10.0  # [-, 1/m] of droops: a kink of 1e-4 would show
LAST = np.array([3, 2]) * 0.11 + 0.02  # [m] outer corner of the last cup


def droop(points_st, frames=FLAT, weight=WEIGHT, **settings):
    return free_edge_droop(
        GRID, frames, points_st, weight, STIFFNESS, OVERHANG, **settings
    )


def test_edges_are_cantilevers():
    """Against the beam equation: D w'''' = q, clamped at 0, free at the end."""
    x = np.linspace(0, OVERHANG, 61)
    step = x[1]
    for points_st, sign in (
        (np.stack([LAST[0] + x, 0 * x + 0.11], axis=-1), 1),
        (np.stack([-0.02 - x, 0 * x], axis=-1), 1),
        (np.stack([0 * x + 0.22, LAST[1] + x], axis=-1), 1),
        (np.stack([0 * x + 0.17, -0.02 - x], axis=-1), 1),
    ):
        w = -droop(points_st)[:, 2] * sign
        fit = np.polynomial.Polynomial.fit(x, w, 4).convert()
        assert fit.deriv(4)(0.0) * STIFFNESS == pytest.approx(3.04, rel=1e-6)
        ends = [w[0], step * fit.deriv(1)(0.0)]
        ends += [step**k * fit.deriv(k)(OVERHANG) for k in (2, 3)]
        assert_allclose(ends, 0, rtol=0, atol=1e-9 * TIP)
        assert w[-1] == pytest.approx(TIP)


def hermite(nodes):
    """Products of C1 cubics on a line, of values, slopes and bends; their integrals."""
    size = 2 * len(nodes)
    forms, load = np.zeros((3, size, size)), np.zeros(size)
    x, weights = np.polynomial.legendre.leggauss(4)
    for k, h in enumerate(np.diff(nodes)):
        u, w, part = (x + 1) / 2, weights * h / 2, slice(2 * k, 2 * k + 4)
        coefficients = np.array(
            [[1, 0, -3, 2], [0, h, -2 * h, h], [0, 0, 3, -2], [0, 0, -h, h]]
        )
        for order, form in enumerate(forms):
            rates = [
                np.polynomial.Polynomial(c).deriv(order)(u) / h**order
                for c in coefficients
            ]
            form[part, part] += (np.array(rates) * w) @ np.array(rates).T
        load[part] += (
            np.array([np.polynomial.Polynomial(c)(u) for c in coefficients]) @ w
        )
    return forms, load


def plate(x, y, held):
    """Droop over q / D at the nodes of a plate in mm, and its slope along x.

    No cross-contraction, as of woven ply; symmetric about the first lines of x and y,
    free beyond the last ones; value and slopes vanish where held, shape (x, y).
    """
    ((vx, sx, bx), qx), ((vy, sy, by), qy) = hermite(x), hermite(y)
    stiff = np.kron(bx, vy) + np.kron(vx, by) + 2 * np.kron(sx, sy)
    fixed = np.zeros((len(x), 2, len(y), 2), dtype=bool)
    fixed |= held[:, None, :, None]
    fixed[0, 1], fixed[:, :, 0, 1] = True, True
    free = np.flatnonzero(~fixed.ravel())
    w = np.zeros(fixed.size)
    w[free] = np.linalg.solve(stiff[np.ix_(free, free)], np.kron(qx, qy)[free])
    w = w.reshape(fixed.shape)
    return w[:, 0, :, 0], w[:, 1, :, 0]


def plate_corner(half_width, overhang, count):
    """Droop of a corner over q / D, held by one cup, shape (count + 1, count + 1)."""
    cup = np.linspace(-half_width, 0, count + 1)
    x = np.append(cup, np.linspace(0, overhang, count + 1)[1:])
    return plate(x, x, np.outer(x <= 0, x <= 0))[0][count:, count:]


def plate_edge(overhang, count=4):
    """Droop of the edge over q / D in the middle of a strip, and what continues it.

    Cups of 40 mm, 70 mm apart, in a row at the ply's edge, others behind them: y runs
    from the middle of a strip to that of a cup, x from the middle of a patch outwards.
    """
    y = np.append(np.linspace(0, 35, count + 1), np.linspace(35, 55, count + 1)[1:])
    x = np.append(np.linspace(-75, -40, count + 1), np.linspace(-40, 0, count + 1)[1:])
    lone = plate(x, y, on_cups(x, y))
    x = np.append(x, np.linspace(0, overhang, count + 1)[1:])
    extended = lone[0][-1, 0] + overhang * lone[1][-1, 0]
    return plate(x, y, on_cups(x, y))[0][-1, 0], extended


def on_cups(x, y):
    """Nodes on the cup of plate_edge, shape (x, y)."""
    return np.outer((x >= -40) & (x <= 0), y >= 35)


@pytest.mark.parametrize(("overhang", "extra"), [(20.0, 1.9), (35.0, 0.6)])
def test_what_strips_yield_is_as_noted(overhang, extra):
    """D17's figures for the middle of a strip, which the droop leaves out."""
    whole, extended = plate_edge(overhang)
    left_out = (whole - extended) / (overhang**4 / 8) - 1
    assert left_out == pytest.approx(extra, abs=0.1)


@pytest.mark.parametrize("overhang", [0.01, 0.02, 0.035])
def test_corner_is_near_a_plate_on_a_cup(overhang):
    count = 8
    plate = plate_corner(20.0, 1e3 * overhang, count) / ((1e3 * overhang) ** 4 / 8)
    x = np.linspace(0, overhang, count + 1)
    points_st = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2) + LAST
    found = free_edge_droop(GRID, FLAT, points_st, WEIGHT, STIFFNESS, overhang)[:, 2]
    found = found.reshape(plate.shape) / (-3.04 * overhang**4 / (8 * STIFFNESS))
    assert found[-1, -1] == pytest.approx(CORNER_TIP)
    assert plate[-1, -1] == pytest.approx(CORNER_TIP, abs=PLATE)
    assert_allclose(found, plate, rtol=0, atol=BESIDE)
    assert (found < plate + PLATE).all()


def test_added_to_points_it_leaves_no_step_and_no_kink():
    """Across every line where cups, strips, edges and corners meet."""
    frames = poses(GRID, 0)[1]
    near = 1e-6 * np.array([-2, -1, 0, 1, 2])
    lines = (GRID.centers[:4, 0, None] + [-0.02, 0.0, 0.02]).ravel()
    for line in lines:
        for fixed in (-0.03, -0.045, LAST[1] + 0.02):
            s = line + near
            w = droop(np.stack([s, 0 * s + fixed], axis=-1), frames)
            assert abs(np.diff(w, axis=0)).max() < SLOPE * 1e-6
            assert abs(np.diff(w, 2, axis=0)).max() < BEND * 1e-12


def test_nothing_droops_between_the_cups():
    sampling = PlySampling.regular(GRID, 0.01, OVERHANG)
    points_st = sampling.points_st.reshape(-1, 2)
    w = droop(points_st)
    inside = ((points_st > -0.02 - 1e-9) & (points_st < LAST + 1e-9)).all(axis=-1)
    assert not w[inside].any()
    assert (w[~inside, 2] < 0).all()


def test_droop_follows_the_normal_part_of_gravity():
    frames = poses(GRID, 1)[1]
    points_st = np.array([[LAST[0] + OVERHANG, 0.11], [-0.05, -0.05]])
    w = droop(points_st, frames)
    for row, cup, times in ((0, 7, 1), (1, 0, CORNER_TIP)):
        normal = frames[cup, :, 2]
        tip = tip_droop(frames[cup], WEIGHT, STIFFNESS, OVERHANG)
        assert_allclose(w[row], times * tip * normal, rtol=0, atol=ROUNDING)
    assert_array_equal(droop(points_st, weight=np.array([3.0, 2.0, 0.0])), 0)
    turn = rotations(np.array([0.4, -1.2, 0.7]))
    turned = droop(points_st, turn @ frames, turn @ WEIGHT)
    assert_allclose(turned, w @ turn.T, rtol=0, atol=ROUNDING)


def test_tolerance_asks_for_the_poses_that_droop_more():
    """The second pose hangs upright: its edges do not droop."""
    upright = np.broadcast_to(rotations(np.array([1.55, 0, 0])), FLAT.shape)
    frames = np.stack([FLAT, upright])
    points_st = np.array([[-0.05, -0.05], [-0.05, 0.05], [0.05, 0.05]])
    whole = droop(points_st, frames)
    assert whole.shape == (2, 3, 3)
    assert whole[1, 0].any()
    some = droop(points_st, frames, tolerance=1e-4)
    assert_array_equal(some[0], whole[0])
    assert_array_equal(some[1], 0)
    assert_array_equal(droop(points_st, tolerance=CORNER_TIP * TIP * 1.01), 0)
    assert droop(points_st, tolerance=CORNER_TIP * TIP * 0.99).any()


def test_cups_inside_do_not_ask_for_a_droop():
    """All cups upright but those in the middle, which hold no free edge."""
    frames = np.array(np.broadcast_to(rotations(np.array([1.55, 0, 0])), FLAT.shape))
    frames[[5, 6]] = np.eye(3)
    assert not droop([[-0.05, -0.05]], frames, tolerance=1e-4).any()
    frames[4] = np.eye(3)
    assert droop([[-0.05, -0.05]], frames, tolerance=1e-4).any()


@pytest.mark.parametrize(
    ("argument", "values"),
    [
        ("points_st", {"points_st": [[-0.06, 0.0]]}),
        ("points_st", {"points_st": [0.0, 0.0]}),
        ("weight", {"weight": [0, np.nan, 0]}),
        ("weight", {"weight": 3.0}),
        ("stiffness", {"stiffness": 0.0}),
        ("overhang", {"overhang": -1e-3}),
        ("tolerance", {"tolerance": np.inf}),
    ],
)
def test_bad_arguments_are_named(argument, values):
    given = {
        **{"points_st": [[-0.03, 0.0]], "weight": WEIGHT},
        **{"stiffness": STIFFNESS, "overhang": OVERHANG},
    }
    with pytest.raises(PlyError) as caught:
        free_edge_droop(GRID, FLAT, **given | values)
    assert caught.value.argument == argument
