import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from ply import window as module
from ply.errors import PlyError
from ply.grid import CupGrid
from ply.shape import PlySampling, evaluate, ply_fibers
from ply.window import PlyWindow, window
from tests.test_shape import poses

GRID = CupGrid(8, 6, 0.11, 0.02, s_length=0.0702)
SAME = 1e-13  # [m] the same sums in another order
SAMPLING = PlySampling.regular(GRID, 0.01, 0.015)
MODELS = [
    {"model": "cubic"},
    {"model": "quartic"},
    {"model": "modal"},
    {"model": "modal", "take_up": 2e-4},
]


def nudge(cups, which, seed):
    """Cups after a few of them have moved."""
    other = poses(GRID, seed + 1, cups[0].shape[:-2])
    out = cups[0].copy(), cups[1].copy()
    for array, new in zip(out, other, strict=True):
        axis = cups[0].ndim - 2
        index = (slice(None),) * axis + (which,)
        array[index] = new[index]
    return out


def whole(cups, **settings):
    return SAMPLING.points(ply_fibers(GRID, *cups, **settings), *cups)


@pytest.mark.parametrize("settings", MODELS)
def test_window_is_a_part_of_the_whole(settings):
    small, cups = window(GRID, range(2, 6), range(1, 5))
    assert (small.rows, small.columns) == (4, 4)
    assert (small.s_length, small.t_length) == (GRID.s_length, GRID.t_length)
    assert_array_equal(cups[:5], [13, 14, 15, 16, 19])
    positions, frames = poses(GRID, 0, (2,))
    start = np.array([1, 2]) * GRID.pitch
    points_st = np.random.default_rng(0).uniform(-0.02, 0.35, (200, 2))
    part = positions[:, cups], frames[:, cups]
    fibers = ply_fibers(small, *part, **settings)
    found = evaluate(small, fibers, *part, points_st)
    fibers = ply_fibers(GRID, positions, frames, **settings)
    expected = evaluate(GRID, fibers, positions, frames, points_st + start)
    assert_allclose(found, expected, rtol=0, atol=SAME)


@settings(deadline=None, max_examples=25)
@given(
    moved=st.lists(st.integers(0, GRID.n_cups - 1), max_size=9),
    seed=st.integers(0, 10**6),
    model=st.sampled_from(MODELS),
)
def test_update_equals_the_whole_ply(moved, seed, model):
    before = poses(GRID, seed)
    after = nudge(before, moved, seed)
    updated = PlyWindow(SAMPLING, model).update(whole(before, **model), moved, *after)
    assert_allclose(updated, whole(after, **model), rtol=0, atol=SAME)


def test_batches_and_given_sides():
    before = poses(GRID, 3, (2, 3))
    moved = [8, 14, 40]
    after = nudge(before, moved, 3)
    rng = np.random.default_rng(0)
    shapes = (2, 3, 8, 5), (2, 3, 7, 6)
    sides = tuple(rng.choice([-1, 1], shape) for shape in shapes)
    settings = {"model": "modal", "sides": sides}
    points = whole(before, **settings)
    old = points.copy()
    ply = PlyWindow(SAMPLING, {"model": "modal"})
    updated = ply.update(points, moved, *after, sides=sides)
    assert_allclose(updated, whole(after, **settings), rtol=0, atol=SAME)
    assert_array_equal(points, old)
    assert abs(updated - points).max() > 1e-4


def test_points_away_from_moved_cups_are_not_touched():
    """Marks in place of points survive exactly where no cup around has moved."""
    before = poses(GRID, 0)
    marks = np.full((len(SAMPLING.t), len(SAMPLING.s), 3), 7.0)
    updated = PlyWindow(SAMPLING).update(marks, [21, 22], *before)
    near = np.isin(SAMPLING.cups_around, [21, 22]).any(axis=-1)
    assert_array_equal((updated != 7).all(axis=-1), near)
    assert_array_equal((updated == 7).all(axis=-1), ~near)


def test_near_cups_share_a_box_and_far_ones_do_not():
    boxes = module._boxes_around(GRID, [0, 1, 6, 7, 47])
    assert sorted(box.size(GRID) for box in boxes) == [4, 9]
    assert len(module._boxes_around(GRID, range(GRID.n_cups))) == 1


@pytest.mark.parametrize(
    ("rows", "columns", "argument"),
    [
        (range(0, 9), range(0, 2), "rows"),
        (range(0, 4, 2), range(0, 2), "rows"),
        (range(0, 2), range(3, 3), "columns"),
        (range(0, 2), range(-1, 3), "columns"),
    ],
)
def test_windows_that_do_not_exist_are_named(rows, columns, argument):
    with pytest.raises(PlyError) as caught:
        window(GRID, rows, columns)
    assert caught.value.argument == argument


@pytest.mark.parametrize("cup", [-1, 48])
def test_cups_that_do_not_exist_are_named(cup):
    with pytest.raises(PlyError, match="48 cups"):
        PlyWindow(SAMPLING).update(whole(poses(GRID, 0)), cup, *poses(GRID, 0))
