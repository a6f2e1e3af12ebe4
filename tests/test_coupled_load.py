"""Weight and take-up of the coupled ply (D8)."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from ply.coupled import CoupledModel, CoupledStatus
from ply.coupled_energy import next_foreseen
from ply.errors import PlyError
from ply.grid import CupGrid, Region
from ply.shape import evaluate, ply_fibers
from tests.test_coupled import (
    ALL,
    CENTERS,
    GRID,
    MODEL,
    ROUNDED,
    UPRIGHT,
    check_differences,
    disturbed,
    refined,
    rotation,
)

SAME = 1e-9  # [m] a take-up of a thousandth of that changes no shape by more
EXACT = 1e-9  # [-] sag of a clamped strip: a quartic, which the basis contains
ORDERS = 0.01  # [-] sag of a clamped patch by orders 5 and 9
FIBER = 2e-5  # [m] five modes against five bubbles, the sag of 30 N/m^2 being 0.1 mm
NATURAL = 0.02  # [-] energy of a strip in its band: arc of a radius that is 0.4 % off
PAIR = [0, 1]
LENGTH, HALF, STIFFNESS = 0.07, 0.02, 5e-3
LOADED = CoupledModel(GRID, weight=(1.0, -2.0, -30.0), take_up=4e-4)
LIMP = CoupledModel(GRID, take_up=4e-4)


@pytest.mark.parametrize("region", [Region.PATCH, Region.S_STRIP, Region.T_STRIP])
def test_forces_and_stiffness_against_differences_of_the_energy(region):
    check_differences(LOADED, region)


@pytest.mark.parametrize("weight", [3.0, 30.0])
def test_clamped_strip_sags_as_a_beam(weight):
    """The weave gives what the sag needs of length."""
    model = CoupledModel(GRID, weight=(0, 0, -weight), take_up=1e-4)
    strip = model.solve_strips(CENTERS[PAIR], UPRIGHT[PAIR])
    assert strip.status == CoupledStatus.CONVERGED
    sag = -model.points(strip, 0.055, 0.0)[2]
    expected = weight * LENGTH**4 / (384 * STIFFNESS)
    assert sag == pytest.approx(expected, rel=EXACT)
    assert strip.strain == 0
    assert strip.energy == pytest.approx(
        -(weight**2) * LENGTH**5 / (1440 * STIFFNESS) * 2 * HALF, rel=EXACT
    )


def test_sag_of_a_clamped_patch_converges():
    """Beyond 2.8 sags of a strip, which an endless ply has: the rim is free here."""
    sags = []
    for order in (5, 9):
        model = CoupledModel(GRID, order, weight=(0, 0, -4.0), take_up=1e-4)
        patch = model.solve(CENTERS, UPRIGHT)
        sags.append(-model.points(patch, 0.055, 0.055)[2])
    assert sags[0] == pytest.approx(sags[1], rel=ORDERS)
    strip = 4 * LENGTH**4 / (384 * STIFFNESS)
    assert 2.8 < sags[1] / strip < 3.4


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("share", [0.99, 0.999])
def test_slack_strip_under_weight_is_the_modal_fiber(side, share):
    gravity, grid = (0.0, 0.0, -30.0), CupGrid(1, 2, pitch=0.11, half_width=HALF)
    held = share * CENTERS[PAIR], np.array(UPRIGHT[PAIR])
    settings = {"sides": (np.full((1, 1), side), np.zeros((0, 2)))}
    settings |= {"model": "modal", "modes": 5, "gravity": gravity}
    fibers = ply_fibers(
        grid, *held, stiffness=STIFFNESS, softness=1 / MODEL.stretch, **settings
    )
    expected = evaluate(grid, fibers, *held, np.array([[0.055, 0.0]]))[0, 2]
    model = CoupledModel(GRID, weight=gravity)
    heights = [
        m.points(m.solve_strips(*held, side), 0.055, 0.0)[2] for m in (model, MODEL)
    ]
    assert heights[0] == pytest.approx(expected, abs=FIBER)
    assert heights[0] < heights[1]


def arc(radius, span):
    """Two cups on a circle, in line along s, so many meters of arc apart."""
    turn = rotation(np.array([0, span / radius / 2, 0]))
    end = np.array([radius * np.sin(span / (2 * radius)), 0, 0])
    first, second = -end - HALF * turn.T[:, 0], end + HALF * turn[:, 0]
    return np.array([first, second]), np.array([turn.T, turn])


@pytest.mark.parametrize("surplus", [-3e-4, 3e-4])
def test_lengths_within_the_take_up_cost_nothing(surplus):
    radius = 0.3
    strip = LIMP.solve_strips(*arc(radius, LENGTH + surplus))
    assert strip.status == CoupledStatus.CONVERGED
    assert strip.strain == 0
    bending = STIFFNESS / (2 * radius**2) * LENGTH * 2 * HALF
    assert strip.energy == pytest.approx(bending, rel=NATURAL + abs(surplus) / LENGTH)
    beyond = LIMP.solve_strips(*arc(radius, LENGTH + 2 * surplus))
    assert beyond.strain > 1e-5


def test_patch_within_the_take_up_does_not_bow():
    """0.3 mm of slack bow a patch without take-up by millimeters."""
    bowed, flat = (
        model.points(model.solve((1 - 3e-4 / 0.11) * CENTERS, UPRIGHT), *ALL)[..., 2]
        for model in (MODEL, LIMP)
    )
    assert abs(bowed).max() > 1e-3
    assert abs(flat).max() < 1e-12


def test_slack_beyond_the_take_up_bows_by_the_rest():
    share = 1 - 1.1e-3 / 0.11
    rest = 1 - 0.7e-3 / 0.11
    held = LIMP.solve_strips(share * CENTERS[PAIR], UPRIGHT[PAIR], 1)
    free = MODEL.solve_strips(rest * CENTERS[PAIR], UPRIGHT[PAIR], 1)
    heights = [
        m.points(strip, 0.055, 0.0)[2] for m, strip in ((LIMP, held), (MODEL, free))
    ]
    assert heights[0] == pytest.approx(heights[1], rel=0.01)


def test_no_take_up_is_the_limit_of_a_small_one():
    small = CoupledModel(GRID, take_up=1e-3 * SAME)
    patches = MODEL.solve(*disturbed(4, shape=(3,)), sides=(1, 1, 1, 1))
    found = [refined(patches, model) for model in (MODEL, small)]
    rows, _ = MODEL.rows(Region.PATCH, *ALL)
    assert_allclose(rows @ found[1], rows @ found[0], rtol=0, atol=SAME)


def test_hard_poses_converge():
    """Fibers that pull and let go by turns."""
    patches = LIMP.solve(*disturbed(4, shape=(16,)))
    assert (patches.status == CoupledStatus.CONVERGED).mean() > 0.9
    assert np.isfinite(patches.energy).all()


def test_batch_equals_single():
    positions, rotations = disturbed(9, 0.1, 0.01, shape=(9,))
    together = LOADED.solve(positions, rotations)
    for k in (0, 7, 8):
        alone = LOADED.solve(positions[k], rotations[k])
        assert alone.iterations == together[k].iterations
        difference = alone.coefficients - together[k].coefficients
        assert_allclose(difference, 0, atol=ROUNDED)


def test_weight_turns_with_the_ply():
    positions, rotations = disturbed(6, 0.1, 0.01)
    turn = rotation(np.array([0.5, -1.0, 2.0]))
    weight = tuple(turn @ LOADED.weight)
    turned = CoupledModel(GRID, weight=weight, take_up=LOADED.take_up)
    one = LOADED.solve(positions, rotations)
    other = turned.solve(positions @ turn.T, turn @ rotations)
    assert one.status == other.status == CoupledStatus.CONVERGED
    assert other.energy == pytest.approx(one.energy, rel=1e-5)


def test_strain_foreseen_stops_where_a_fiber_begins_to_pull():
    piece = LIMP.body(Region.PATCH).core
    low, high = piece.low, piece.high
    inside, beyond, far = 0.5 * high, 3 * high, 3 * low
    assert_allclose(next_foreseen(piece, inside, beyond, 1.0), high, rtol=1e-8)
    assert_allclose(next_foreseen(piece, beyond, far, 1.0), low, rtol=1e-8)
    assert_array_equal(next_foreseen(piece, beyond, 2 * beyond, 1.0), 2 * beyond)
    assert_allclose(next_foreseen(piece, beyond, 2 * beyond, 0.5), 1.5 * beyond)
    rigid = MODEL.body(Region.PATCH).core
    assert_array_equal(next_foreseen(rigid, beyond, far, 0.5), far)


@pytest.mark.parametrize(
    ("name", "value"),
    [("weight", (0, 0)), ("weight", (0, 0, np.nan)), ("take_up", -1e-4)],
)
def test_errors_name_the_argument(name, value):
    with pytest.raises(PlyError) as error:
        CoupledModel(GRID, **{name: value})
    assert error.value.argument == name
