"""Floods against brute force, and what their margins mean.

No deadlines: the first call compiles, and loads what was compiled.
"""

import heapq

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_array_equal
from scipy.ndimage import gaussian_filter, label

from drapeplan.flood import (
    air_margins,
    edge_mask,
    escape_level,
    least_margins,
    pass_level,
    placed_margins,
    premature_margins,
)

# Heights are whole numbers here, so that every comparison is exact: no tolerances.
TOUCH, BARRIER = 2.0, 3.0
SIDES = [(0, 1), (1, 0), (0, -1), (-1, 0)]
CORNERS = [(1, 1), (1, -1), (-1, 1), (-1, -1)]

heights = arrays(
    np.float64,
    st.tuples(st.integers(2, 7), st.integers(2, 7)),
    elements=st.integers(-3, 9).map(float),
)
either = st.booleans()


def shortest_ways(h, seed, eight_connected):
    """Pass levels by Dijkstra's algorithm with a heap, in plain Python."""
    level = np.full(h.shape, np.inf)
    queue = [(h[p], p) for p in zip(*map(list, np.nonzero(seed)), strict=True)]
    heapq.heapify(queue)
    while queue:
        v, (i, j) = heapq.heappop(queue)
        if v >= level[i, j]:
            continue
        level[i, j] = v
        for di, dj in SIDES + CORNERS * eight_connected:
            p = i + di, j + dj
            if 0 <= p[0] < h.shape[0] and 0 <= p[1] < h.shape[1]:
                heapq.heappush(queue, (max(v, h[p]), p))
    return level


def rising_water(h, seed, eight_connected):
    """Pass levels by labeling every sublevel set: no ways at all."""
    level = np.full(h.shape, np.inf)
    for v in np.unique(h)[::-1]:
        wet, _ = label(h <= v, np.ones((3, 3)) if eight_connected else None)
        reached = np.isin(wet, wet[seed & (h <= v)]) & (wet > 0)
        level[reached] = v
    return level


def random_smooth(seed, shape=(18, 23)):
    """A smooth random field of whole numbers from about -12 to 12."""
    noise = np.random.default_rng(seed).normal(size=shape)
    field = gaussian_filter(noise, 1.5)
    return np.round(4 * field / field.std())


@settings(deadline=None)
@given(h=heights, eight_connected=either, data=st.data())
def test_pass_level_equals_both_brute_forces(h, eight_connected, data):
    seed = data.draw(arrays(bool, h.shape))
    level = pass_level(h, seed, eight_connected)
    assert_array_equal(level, shortest_ways(h, seed, eight_connected))
    assert_array_equal(level, rising_water(h, seed, eight_connected))


@settings(max_examples=25, deadline=None)
@given(number=st.integers(0, 10**6), eight_connected=either)
def test_pass_level_equals_dijkstra_on_smooth_fields(number, eight_connected):
    h = random_smooth(number)
    seed = np.zeros(h.shape, dtype=bool)
    seed[5:8, 10:13] = True
    level = pass_level(h, seed, eight_connected)
    assert_array_equal(level, shortest_ways(h, seed, eight_connected))


def test_spiral_needs_many_sweeps_and_gets_them():
    """A walled corridor that winds inward: one way, against every sweep's direction."""
    n = 25
    h = np.ones((n, n))
    i, j, di, dj, length = 0, 0, 0, 1, n - 1
    h[0, 0] = 0
    for leg in range(2 * n):
        for _ in range(length):
            i, j = i + di, j + dj
            h[i, j] = 0
        di, dj = dj, -di
        length -= 2 * (leg % 2 == 0 and leg > 0)
        if length <= 0:
            break
    seed = np.zeros_like(h, dtype=bool)
    seed[0, 0] = True
    assert_array_equal(pass_level(h, seed, False), shortest_ways(h, seed, False))
    assert pass_level(h, seed, False)[i, j] == 0


def test_ways_over_corners_only_when_asked():
    h = 9.0 - 9.0 * np.eye(4)
    seed = np.zeros((4, 4), dtype=bool)
    seed[0, 0] = True
    assert pass_level(h, seed, True)[3, 3] == 0
    assert pass_level(h, seed, False)[3, 3] == 9


@settings(deadline=None)
@given(h=heights, eight_connected=either)
def test_batches_flips_and_transposes_change_nothing(h, eight_connected):
    seed = np.zeros(h.shape, dtype=bool)
    seed[0, 1] = True
    level = pass_level(h, seed, eight_connected)
    flipped = pass_level(h[::-1, ::-1], seed[::-1, ::-1], eight_connected)
    turned = pass_level(h.T, seed.T, eight_connected)
    batch = pass_level(np.stack([[h, h + 1], [h - 1, h]]), seed, eight_connected)
    assert_array_equal(flipped[::-1, ::-1], level)
    assert_array_equal(turned.T, level)
    assert_array_equal(batch, np.stack([[level, level + 1], [level - 1, level]]))


def test_nothing_is_reached_without_a_seed():
    assert np.isinf(pass_level(np.zeros((3, 4)), np.zeros((3, 4), bool), True)).all()


@settings(deadline=None)
@given(h=heights)
def test_escape_level_is_the_widest_way_to_the_edge(h):
    assert_array_equal(escape_level(h), -shortest_ways(-h, edge_mask(h.shape), False))


def test_escape_through_a_notch():
    """A hollow of height 8 inside a rim of height 0 with one notch of height 4."""
    h = np.full((7, 7), 7.0)
    h[1:6, 1:6] = 0.0
    h[2:5, 2:5] = 8.0
    h[1, 3] = 4.0
    assert_array_equal(escape_level(h)[2:5, 2:5], 4.0)
    assert air_margins(h, TOUCH, BARRIER).min() == 4.0 - TOUCH == 2.0
    h[1, 3] = 5.0  # now exactly one barrier below the hollow: no hollow at all
    assert np.isinf(air_margins(h, TOUCH, BARRIER).min())


def test_dip_beyond_a_hump():
    """From a start at 0 over a hump at 9 to a dip at 5: 3 left until it touches."""
    h = np.tile([0.0, 4.0, 9.0, 5.0, 7.0], (3, 1))
    start = np.zeros(h.shape, dtype=bool)
    start[:, 0] = True
    margins = premature_margins(h, start, TOUCH, BARRIER)
    assert_array_equal(np.isfinite(margins[0]), [False, False, False, True, False])
    assert margins.min() == 5.0 - TOUCH == 3.0
    h[1, 2] = 8.0  # a saddle in the hump, exactly one barrier above the dip
    assert np.isinf(premature_margins(h, start, TOUCH, BARRIER).min())


@pytest.mark.parametrize("which", ["premature", "air"])
@settings(max_examples=40, deadline=None)
@given(number=st.integers(0, 10**6))
def test_margin_is_the_descent_that_is_left(which, number):
    """Lowering the whole ply by the margin makes it happen; by one less does not."""
    h = random_smooth(number) + 20.0
    start = np.zeros(h.shape, dtype=bool)
    start[8:11, 10:13] = True

    def margin(h):
        if which == "air":
            return air_margins(h, TOUCH, BARRIER).min()
        return premature_margins(h, start, TOUCH, BARRIER).min()

    left = margin(h)
    if np.isinf(left):  # no dip and no hollow: it never happens, however low
        assert all(margin(h - fall) > 0 for fall in range(0, 40, 3))
    else:
        assert margin(h - left) == 0
        assert margin(h - (left - 1)) == 1


@settings(deadline=None)
@given(h=heights, data=st.data())
def test_least_margins_are_those_of_the_fields(h, data):
    start, vents = (data.draw(arrays(bool, h.shape)) for _ in range(2))
    both = np.stack([h, h.T[::-1].reshape(h.shape)])  # the second sees fresh arrays
    found = least_margins(both, start, vents, TOUCH, BARRIER)
    early = premature_margins(both, start, TOUCH, BARRIER).min(axis=(1, 2))
    air = air_margins(both, TOUCH, BARRIER, vents).min(axis=(1, 2))
    assert_array_equal(found, [early, air])
    least, places = placed_margins(both, start, vents, TOUCH, BARRIER)
    fields = (
        premature_margins(both, start, TOUCH, BARRIER),
        air_margins(both, TOUCH, BARRIER, vents),
    )
    for field, margin, place in zip(fields, least, places, strict=True):
        flat = field.reshape(len(both), -1)
        none = np.isposinf(margin)
        assert_array_equal(place, np.where(none, -1, flat.argmin(axis=1)))
