"""Estimates: closed forms against their equations, and against finite elements."""

from dataclasses import fields

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import sparse
from scipy.sparse.linalg import spsolve

from ply.errors import PlyError
from ply.gravity import PATCH_SAG, cantilever_droop, clamped_sag
from ply.grid import CupGrid
from ply.measures import estimates, measures, shear_effect
from tests.scans import truth_cups

MASS, SOFT = 0.31, 5e-4  # [kg/m^2], [N m] as in the figures of the derivation
TRUTH_BENDING = 5e-3  # [N m] of the finite-element ply
PUBLISHED = 0.01  # [mm] half a unit of the last digit of 0.38, 1.14 and 0.12
ROOT = 1e-8  # [m] square root of rounding in a length of 70 mm
WITHIN = 2.0  # [-] an estimate is that near, either way, to what it estimates
GRID = CupGrid(3, 4, 0.11, 0.02)
FLAT = np.column_stack([GRID.centers, np.zeros(GRID.n_cups)])
LEVEL = np.tile(np.eye(3), (GRID.n_cups, 1, 1))


def measured(case):
    cups, surface = truth_cups(case)
    found = measures(cups.grid, cups.positions, cups.rotations, TRUTH_BENDING, 0.0)
    return cups, surface, found


def test_published_sags_and_droops():
    found = measures(GRID, FLAT, LEVEL, SOFT, MASS, overhang=0.035)
    assert 1e3 * found.s_sag.max() == pytest.approx(0.38, abs=PUBLISHED)
    assert 1e3 * found.t_sag.max() == pytest.approx(0.38, abs=PUBLISHED)
    assert 1e3 * found.droop.max() == pytest.approx(1.14, abs=PUBLISHED)
    near = measures(GRID, FLAT, LEVEL, SOFT, MASS, overhang=0.020)
    assert 1e3 * near.droop.max() == pytest.approx(0.12, abs=PUBLISHED)


def test_droop_solves_the_beam_equation():
    """D w'''' = q, clamped at the cup, no moment and no force at the free end."""
    end, load, bending = 0.03, 3.0, 2e-3
    y = np.linspace(0.0, end, 7)
    w = np.polynomial.Polynomial.fit(y, cantilever_droop(y, end, load, bending), 4)
    assert_allclose(bending * w.deriv(4)(y), load, rtol=1e-6)
    assert_allclose([w(0.0), w.deriv()(0.0)], 0.0, atol=1e-12)
    assert_allclose([w.deriv(2)(end), w.deriv(3)(end)], 0.0, atol=1e-6)
    assert w(end) == pytest.approx(load * end**4 / (8 * bending))


def test_sag_is_that_of_a_clamped_beam():
    length, load, bending = 0.07, 3.0, 2e-3
    x = length / 2
    beam = load / (24 * bending) * x**2 * (length - x) ** 2
    assert clamped_sag(load, length, bending) == pytest.approx(beam)


def plate_sag(step):
    """Sag amid four cups of an endless flat plate over that of a strip."""
    n = round(0.11 / step)
    ones = np.ones(n - 1)
    second = sparse.lil_array(
        sparse.diags_array([ones, -2 * np.ones(n), ones], offsets=[-1, 0, 1])
    )
    second[0, -1] = second[-1, 0] = 1
    one, second = sparse.eye_array(n), sparse.csr_array(second) / step**2
    laplace = sparse.kron(second, one) + sparse.kron(one, second)
    on_cup = np.arange(n) * step <= 0.04 + step / 9
    free = np.flatnonzero(~np.outer(on_cup, on_cup))
    square = sparse.csr_array(laplace @ laplace)[free][:, free]
    w = np.zeros(n * n)
    w[free] = spsolve(square.tocsc(), np.ones(len(free)))
    middle = round(0.075 / step)
    return w.reshape(n, n)[middle, middle] / clamped_sag(1.0, 0.07, 1.0)


def test_sag_of_a_patch_is_that_of_a_plate():
    """Finite differences clamp a cup a bit inside its edge: an error of first order."""
    coarse, fine = plate_sag(0.005), plate_sag(0.0025)
    assert 2 * fine - coarse == pytest.approx(PATCH_SAG, rel=0.05)


def test_gravity_counts_along_the_normal_alone():
    turned = np.tile([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]], (GRID.n_cups, 1, 1))
    upright = np.column_stack([FLAT[:, 0], FLAT[:, 2], FLAT[:, 1]])
    found = measures(GRID, upright, turned, SOFT, MASS, overhang=0.02)
    for array in (found.s_sag, found.t_sag, found.sag, found.droop):
        assert_allclose(array, 0.0, atol=1e-12)


@pytest.mark.parametrize("angle", [0.05, -0.2])
def test_sheared_flat_net_shows_its_angle(angle):
    """Rows slide over each other: chords along t lean, chords along s do not."""
    s, t = GRID.centers.T
    moved = np.column_stack([s + t * np.sin(angle), t * np.cos(angle), 0 * s])
    found = measures(GRID, moved, LEVEL, SOFT, MASS)
    lean = np.arctan2(0.11 * np.sin(angle), 0.11 * np.cos(angle) - 0.04)
    assert_allclose(found.t_shear, abs(lean), rtol=1e-12)
    assert_allclose(found.s_shear, 0.0, atol=1e-12)
    assert_allclose(found.shear, abs(lean), rtol=1e-12)
    assert_allclose(found.shear_effect, 0.0, atol=1e-12)  # flat: nothing to amplify


@pytest.mark.parametrize("reverse", [False, True])
def test_one_cup_turned_in_its_plane(reverse):
    """Either cup shows the shear; of both edges the one further from 70 mm counts."""
    angle = 0.03
    yaw = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0]]
    )
    yaw = np.vstack([yaw, [0, 0, 1]])
    rotations = np.stack([yaw, np.eye(3)] if reverse else [np.eye(3), yaw])
    grid, flat = CupGrid(1, 2, 0.11, 0.02), np.array([[0.0, 0, 0], [0.1097, 0, 0]])
    found = measures(grid, flat, rotations, SOFT, MASS)
    r0, r1 = flat[0] + 0.02 * rotations[0, :, 0], flat[1] - 0.02 * rotations[1, :, 0]
    chord = (r1 - r0) / np.linalg.norm(r1 - r0)
    lateral = abs(np.einsum("c,ncs->ns", chord, rotations)[:, 1])
    assert_allclose(found.s_shear, np.arcsin(lateral.max()), rtol=1e-12)
    differences = 0.02 * np.array([-1, 1]) * np.sin(angle) * (-1 if reverse else 1)
    surplus = (
        found.s_surplus.item()
    )  # 0.3 mm nearer, and 0.6 mm more or less at an edge
    assert surplus == pytest.approx(3e-4 + abs(differences[0]), abs=3e-5)


def test_shear_effect_grows_and_stays_finite():
    angles = np.array([0.0, 0.01, 0.1, 0.2, 1.0, 1.5])
    effect = shear_effect(angles, 0.1, 0.07, TRUTH_BENDING, 300.0)
    assert effect[0] == 0
    assert (np.diff(effect) >= 0).all()
    assert effect[-1] == pytest.approx(9 * 0.1 * 0.07 / 4)
    x = 300.0 * 0.01 / (14.71 * np.pi**2 * TRUTH_BENDING / 0.07**2)
    assert effect[1] == pytest.approx(0.1 * 0.07 / 4 * x / (1 - x))


def test_cylinder_shows_its_turn():
    _, _, found = measured("B_cyl1000")
    turns = np.sort([found.s_turn.max(), found.t_turn.max()])
    assert_allclose(turns, [0.0, 0.11], atol=1e-3)


def test_surplus_is_what_the_truth_was_given():
    for case, slack in (("B_flat_slack0.1", 1e-4), ("B_flat_slack1", 1e-3)):
        _, _, found = measured(case)
        assert_allclose(found.s_surplus, slack, atol=1e-7)
        assert_allclose(found.t_surplus, slack, atol=1e-7)


@pytest.mark.parametrize(
    "case",
    ["B_lift20_flatcup", "B_flat_slack1", "B_saddle_xy1000_sheared", "B_sph2000"],
)
def test_coupling_foretells_the_error_amid_the_patch(case):
    """The lifted cup foremost: no model of independent fibers sees its bow of 4 mm."""
    from ply.shape import PlySampling, ply_fibers

    cups, surface, found = measured(case)
    poses = cups.positions, cups.rotations
    middle = np.array([cups.grid.pitch / 2])
    sampling = PlySampling(cups.grid, middle, middle)
    point = sampling.points(ply_fibers(cups.grid, *poses), *poses)[0, 0]
    error = np.linalg.norm(surface.points([(middle[0], middle[0])])[0] - point)
    assert 1 / WITHIN < found.coupling.max() / error < WITHIN


def test_flat_patch_has_nothing_to_report():
    found = measures(GRID, FLAT, LEVEL, SOFT, 0.0)
    for field in fields(found):
        assert_allclose(getattr(found, field.name), 0.0, atol=ROOT, err_msg=field.name)


def test_batch_is_each_pose_by_itself():
    cups, _ = truth_cups("C_wave")
    grid, turn = cups.grid, np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    positions = np.stack([cups.positions, cups.positions @ turn.T])
    rotations = np.stack([cups.rotations, turn @ cups.rotations])
    both = measures(grid, positions, rotations, SOFT, MASS, overhang=0.02)
    one = measures(grid, cups.positions, cups.rotations, SOFT, MASS, overhang=0.02)
    for field in fields(both):
        for pose in getattr(both, field.name):  # the second is turned about gravity
            assert_allclose(pose, getattr(one, field.name), atol=1e-9)
    assert estimates(both, grid)[0].value == pytest.approx(
        estimates(one, grid)[0].value
    )


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 3), (3, 1), (2, 2)])
def test_every_array_has_its_lines(rows, columns):
    grid = CupGrid(rows, columns, 0.11, 0.02)
    flat = np.column_stack([grid.centers, np.zeros(grid.n_cups)])
    found = measures(grid, flat, np.tile(np.eye(3), (grid.n_cups, 1, 1)), SOFT, MASS)
    lines = estimates(found, grid)
    assert all(np.isfinite(line.value) and line.value >= 0 for line in lines)
    assert any(line.name.startswith("coupling") for line in lines) == (
        rows > 1 and columns > 1
    )
    sag = [line.value for line in lines if line.name == "gravity sag, strips"]
    assert sag == ([] if rows * columns == 1 else pytest.approx([0.38], abs=PUBLISHED))


@pytest.mark.parametrize(
    ("change", "argument"),
    [
        ({"bending": 0.0}, "bending"),
        ({"areal_mass": -1.0}, "areal_mass"),
        ({"overhang": np.nan}, "overhang"),
        ({"shear_stiffness": 0.0}, "shear_stiffness"),
    ],
)
def test_numbers_that_no_ply_has(change, argument):
    numbers = {"bending": SOFT, "areal_mass": MASS, **change}
    with pytest.raises(PlyError) as caught:
        measures(GRID, FLAT, LEVEL, **numbers)
    assert caught.value.argument == argument
