import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from ply.errors import PlyError
from ply.grid import CupGrid, Region

GRID = CupGrid(rows=8, columns=6, pitch=0.11, half_width=0.02)


def test_lengths_default_to_the_span():
    assert GRID.span == pytest.approx(0.07)
    assert (GRID.s_length, GRID.t_length) == (GRID.span, GRID.span)
    other = CupGrid(2, 2, 0.11, 0.02, s_length=0.071)
    assert (other.s_length, other.t_length) == (0.071, other.span)


def test_neighbors_stand_s_pairs_first_in_row_major_order():
    pairs = GRID.neighbors
    assert pairs.shape == (82, 2)
    assert GRID.n_s_pairs == 40
    assert_array_equal(pairs[[0, 4, 5, 39]], [[0, 1], [4, 5], [6, 7], [46, 47]])
    assert_array_equal(pairs[[40, 41, 81]], [[0, 6], [1, 7], [41, 47]])
    steps = np.diff(GRID.centers[pairs], axis=1)[:, 0]
    assert_allclose(steps[:40], [[0.11, 0]] * 40, atol=1e-15)
    assert_allclose(steps[40:], [[0, 0.11]] * 42, atol=1e-15)


def test_centers_run_along_s_first():
    assert GRID.n_cups == 48
    assert_allclose(
        GRID.centers[[0, 1, 6, 47]] / 0.11, [[0, 0], [1, 0], [0, 1], [5, 7]]
    )


def test_regions():
    points = [[0, 0], [0.055, 0], [0, 0.055], [0.055, 0.055], [-0.03, 0.05]]
    expected = [
        Region.CUP,
        Region.S_STRIP,
        Region.T_STRIP,
        Region.PATCH,
        Region.OVERHANG,
    ]
    assert_array_equal(GRID.regions(points), expected)


@pytest.mark.parametrize("column", range(6))
def test_edges_belong_to_the_cup_in_spite_of_rounding(column):
    for edge in (column * 0.11 - 0.02, column * 0.11 + 0.02):
        for s in (np.nextafter(edge, -1), edge, np.nextafter(edge, 1)):
            place = GRID.place_s(s)
            assert place.cup == column
            assert not place.in_span
            assert not place.overhang


def test_span_runs_from_zero_to_one():
    place = GRID.place_t([0.0200001, 0.055, 0.0899999, 0.1450001])
    assert_array_equal(place.cup, [0, 0, 0, 1])
    assert_allclose(place.u, [0, 0.5, 1, 0.2142857], atol=2e-6)


@pytest.mark.parametrize(
    ("argument", "values"),
    [
        ("rows", (0, 6, 0.11, 0.02)),
        ("columns", (8, -1, 0.11, 0.02)),
        ("pitch", (8, 6, np.nan, 0.02)),
        ("half_width", (8, 6, 0.11, 0.0)),
        ("half_width", (8, 6, 0.11, 0.055)),
        ("s_length", (8, 6, 0.11, 0.02, -1.0)),
        ("t_length", (8, 6, 0.11, 0.02, None, np.inf)),
    ],
)
def test_impossible_grids_are_refused_by_name(argument, values):
    with pytest.raises(PlyError) as caught:
        CupGrid(*values)
    assert caught.value.argument == argument
