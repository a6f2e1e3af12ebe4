"""The ladder: who climbs, who stays, and no step between neighbors."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ply.grid import CupGrid
from ply.ladder import Reason, Rung, climb

GRID = CupGrid(3, 4, 0.11, 0.02)
STEP = 1e-9  # [m] between neighbors on different rungs: rounding of degree 8


def flat(grid=GRID):
    """Cups on a plane, exactly as far apart as the ply asks for."""
    positions = np.pad(grid.centers, ((0, 0), (0, 1)))
    return positions, np.tile(np.eye(3), (grid.n_cups, 1, 1))


def lifted(grid=GRID, cup=0, height=0.01):
    """One cup lifted, drawn toward the others so that its fibers reach."""
    positions, frames = flat(grid)
    positions[cup, 2] += height
    positions[cup, :2] += 0.6 * height**2 / grid.span
    return positions, frames


def lines(grid, overhang=0.0):
    ends = [-grid.half_width - overhang, grid.half_width + overhang]
    return [
        np.linspace(ends[0], (cups - 1) * grid.pitch + ends[1], 8 * cups)
        for cups in (grid.columns, grid.rows)
    ]


def test_flat_ply_stays_on_the_lowest_rung():
    found = climb(GRID, *flat())
    assert (found.rung == Rung.CUBIC).all()
    assert (found.reason == Reason.ALIKE).all()
    assert found.patches is None


def test_only_what_a_lifted_cup_touches_climbs():
    found = climb(GRID, *lifted())
    high = found.rung == Rung.COUPLED
    assert high[0, 0]
    assert not high[:, 2].any()


@pytest.mark.parametrize("cup", [0, 5])
def test_no_step_between_neighbors_on_different_rungs(cup):
    found = climb(GRID, *lifted(cup=cup, height=0.02))
    assert len(np.unique(found.rung)) > 1
    half, pitch, span = GRID.half_width, GRID.pitch, GRID.span
    s = np.linspace(-half, 3 * pitch + half, 97)
    for k in range(GRID.rows - 1):
        for edge in (k * pitch + half, k * pitch + half + span):
            inside, outside = found.points(s, edge - 1e-8), found.points(s, edge + 1e-8)
            assert_allclose(inside, outside, rtol=0, atol=1e-7)
