"""Rings around the placed cups, and the way outward."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drapeplan.rings import outward, ring_of, toe_down

ROWS, COLUMNS = 8, 6


def mask(*cups):
    """Mask of cups given as (row, column)."""
    out = np.zeros(ROWS * COLUMNS, bool)
    out[[i * COLUMNS + j for i, j in cups]] = True
    return out


def test_rings_grow_from_what_stands_and_lands():
    """Placed cups are ring 0, landing ones 1, a king's move further each ring."""
    ring = ring_of(ROWS, COLUMNS, mask((3, 2)), mask((3, 3))).reshape(ROWS, COLUMNS)
    assert ring[3, 2] == 0
    assert ring[3, 3] == 1
    assert ring[3, 4] == ring[4, 4] == ring[2, 2] == 2
    assert ring[7, 2] == 5


def test_nothing_down_is_one_ring():
    """Before the first cup lands all cups count alike."""
    assert (ring_of(ROWS, COLUMNS, mask(), mask()) == 1).all()


def test_outward_from_a_rectangle():
    """Beside a placed rectangle outward is straight, at its corner diagonal."""
    away = outward(ROWS, COLUMNS, mask((3, 2), (3, 3), (4, 2), (4, 3)))
    away = away.reshape(ROWS, COLUMNS, 2)
    np.testing.assert_allclose(away[3, 5], [1, 0])
    np.testing.assert_allclose(away[0, 2], [0, -1])
    np.testing.assert_allclose(away[5, 1], np.array([-1, 1]) / np.sqrt(2))
    np.testing.assert_array_equal(away[3, 2], 0)


def test_no_way_outward_without_a_placed_cup():
    """Nothing stands, so there is no direction."""
    assert not outward(ROWS, COLUMNS, mask()).any()


@given(
    angle=st.floats(-0.2, 0.2),
    direction=st.floats(0, 2 * np.pi),
)
def test_toe_down_reads_the_lean_of_a_cup(angle, direction):
    """A cup turned about the axis across the way outward lowers its outer edge."""
    along = np.array([np.cos(direction), np.sin(direction)])
    axis = np.array([-along[1], along[0], 0.0])
    K = np.cross(np.eye(3), axis)
    turn = np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
    edge = turn @ np.append(along, 0.0)
    found = toe_down(turn[None], np.eye(3)[None], along[None])
    assert found[0] == pytest.approx(angle, abs=1e-12)
    assert np.sign(np.round(edge[2], 12)) == -np.sign(np.round(angle, 12))
