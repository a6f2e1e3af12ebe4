import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from drapeplan.errors import InputError
from drapeplan.front_grid import FrontGrid
from ply.grid import CupGrid
from ply.sampling import PlySampling
from tests.front_samples import HALF, PITCH, RIM, box, make_grid

ROUNDING = 1e-12  # [m], [m^2] float64 noise of coordinates below 1 m


def test_cells_add_up_to_the_ply_and_to_its_overhang():
    grid = make_grid(rows=3, columns=4)
    width = 3 * PITCH + 2 * (HALF + RIM)
    height = 2 * PITCH + 2 * (HALF + RIM)
    assert grid.areas.sum() == pytest.approx(width * height, abs=ROUNDING)
    assert grid.areas[0, 0] == pytest.approx(7.5e-3**2, abs=ROUNDING)
    inner = box(grid, (0.05, 0.06), (0.05, 0.05))
    assert_allclose(grid.areas[inner], 1e-4, atol=ROUNDING)


def test_cup_centers_are_multiples_of_the_pitch():
    grid = make_grid(rows=3, columns=4)
    i, j = np.divmod(np.arange(12), 4)
    assert_allclose(grid.cup_centers, PITCH * np.stack([j, i], -1), atol=ROUNDING)
    assert grid.cup_near((2.4 * PITCH, 1.6 * PITCH)) == (2, 2)
    assert grid.cup_at(7) == (1, 3)


def test_samples_are_laid_when_all_their_cups_are_placed():
    """Pads by one cup, strips by two, patches by four, the overhang by the nearest."""
    grid = make_grid(rows=3, columns=4)
    placed = np.zeros(12, dtype=bool)
    placed[[0, 1, 4]] = True
    laid = grid.laid(placed)
    pad_0 = box(grid, (-HALF, HALF), (-HALF, HALF))
    strip = box(grid, (HALF + 0.01, PITCH - HALF - 0.01), (-HALF, HALF))
    patch = box(grid, (0.03, 0.08), (0.03, 0.08))
    corner = box(grid, (-1, -HALF), (-1, -HALF))
    assert laid[pad_0].all()
    assert laid[strip].all()
    assert laid[corner].all()
    assert not laid[patch].any()
    placed[5] = True
    assert grid.laid(placed)[patch].all()
    assert not grid.laid(placed)[box(grid, (0.14, 0.19), (-1, 1))].any()


def test_pads_need_their_own_cup_alone():
    """Even where the caller lists the patch's four cups on pads too."""
    grid = make_grid()
    around = grid.cups_around.copy()
    around[grid.cup_index == 5] = [0, 1, 4, 5]
    other = FrontGrid(grid.s, grid.t, grid.cup_index, around, 4, 5)
    placed = np.arange(12) == 5
    assert_array_equal(other.laid(placed) & grid.start_pad, grid.start_pad)


def test_batches_of_poses():
    grid = make_grid()
    cups = np.random.default_rng(0).random((5, 12)) < 0.5
    assert_array_equal(grid.laid(cups), [grid.laid(row) for row in cups])
    assert_array_equal(grid.on_pads(cups), [grid.on_pads(row) for row in cups])
    assert_array_equal(grid.on_pads(np.arange(12) == 5), grid.start_pad)


def test_spot_of_a_flat_region_is_inside_it():
    grid = make_grid()
    values = np.where(grid.start_pad, 2.0, 0.0)
    spot = grid.spot(values, np.ones_like(grid.start_pad), pose=3)
    assert (spot.value, spot.cup, spot.pose) == (2.0, (1, 1), 3)
    assert_allclose(spot.place_st, (PITCH, PITCH), atol=ROUNDING)


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"s": np.arange(3.0)}, "cup_index"),
        ({"t": make_grid().t[::-1]}, "s, t"),
        ({"cup_index": np.where(make_grid().cup_index == 3, -1, 0)}, "cups_around"),
        ({"cup_index": np.where(make_grid().cup_index == 3, -1, 4)}, "cup_index"),
        ({"cup_index": np.where(make_grid().cup_index < 0, -2, 0)}, "cup_index"),
        (
            {"cups_around": np.full((*make_grid().cup_index.shape, 4), -1)},
            "cups_around",
        ),
        ({"start_cup": 12}, "start_cup"),
    ],
)
def test_refuses_what_is_no_ply(change, key):
    good = vars(make_grid())
    fields = ("s", "t", "cup_index", "cups_around", "columns", "start_cup")
    with pytest.raises(InputError) as error:
        FrontGrid(**{**{name: good[name] for name in fields}, **change})
    assert error.value.key == key


def test_reads_the_samples_of_the_ply_model():
    """The ply's own sampling is a front grid, overhang included."""
    cups = CupGrid(rows=3, columns=4, pitch=PITCH, half_width=HALF)
    ply = PlySampling.regular(cups, 0.01, RIM)
    grid = FrontGrid(ply.s, ply.t, ply.cup_index, ply.cups_around, 4, 5)
    assert_allclose(grid.cup_centers, cups.centers, atol=ROUNDING)
    placed = np.random.default_rng(1).random((20, 12)) < 0.6
    mine = make_grid(rows=3, columns=4)
    inner = (slice(2, -2), slice(2, -2))  # within the cups' outer edges
    ply_inner = [
        np.searchsorted(x, y[2:-2] - 1e-9)
        for x, y in ((ply.t, mine.t), (ply.s, mine.s))
    ]
    assert_array_equal(
        grid.laid(placed)[(slice(None), *np.ix_(*ply_inner))],
        mine.laid(placed)[(slice(None), *inner)],
    )
