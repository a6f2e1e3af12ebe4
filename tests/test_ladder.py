"""The ladder: who climbs, who stays, and no step between neighbors."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ply.coupled import CoupledModel
from ply.coupled_array import coupled_points
from ply.errors import PlyError
from ply.grid import CupGrid
from ply.ladder import Reason, Rung, climb, ladder_alternatives

GRID = CupGrid(3, 4, 0.11, 0.02)


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


def slack(grid=GRID, share=1e-3):
    positions, frames = flat(grid)
    return (1 - share) * positions, frames


def test_alternatives_rise_in_energy_and_differ():
    grid = CupGrid(2, 2, 0.11, 0.02)
    found = ladder_alternatives(grid, *slack(grid), count=4)
    energy = found.patches.energy.sum(axis=(-1, -2))
    assert len(energy) > 1
    assert (np.diff(energy) >= -1e-12).all()
    middle = found.points(0.055, 0.0)[:, 2]
    assert len(np.unique(middle.round(4))) > 1


@pytest.mark.parametrize("lowest", [Rung.CUBIC, Rung.COUPLED])
def test_every_rung_takes_up_slack(lowest):
    """0.1 mm of slack bows by 1.7 mm, and not at all where the weave takes it up."""
    bows = []
    for take_up in (0.0, 2e-4):
        model = CoupledModel(GRID, take_up=take_up)
        found = climb(GRID, *slack(), model=model, lowest=lowest)
        bows.append(abs(found.points(*np.meshgrid(*lines(GRID)))[..., 2]).max())
    assert bows[0] > 1e-3
    assert bows[1] < 1e-5
    assert (found.rung == lowest).all()


def test_a_cup_that_faces_away_is_no_patch_to_solve():
    positions, frames = flat()
    frames[5] = np.diag([-1.0, 1.0, -1.0])
    found = climb(GRID, positions, frames)
    assert (found.reason[:2, :2] == Reason.FAULT).all()
    assert np.isfinite(found.points(0.05, 0.05)).all()


def test_a_batch_is_its_poses():
    both = [np.stack(pair) for pair in zip(lifted(), slack(), strict=True)]
    many = climb(GRID, *both)
    for n, poses in enumerate((lifted(), slack())):
        one = climb(GRID, *poses)
        assert_allclose(many.rung[n], one.rung)
        s, t = np.meshgrid(*lines(GRID))
        assert_allclose(many.points(s, t)[n], one.points(s, t), atol=1e-9)
        assert many.pose(n).lines() == one.lines()


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 3), (3, 1), (2, 2)])
def test_arrays_of_every_shape(rows, columns):
    grid = CupGrid(rows, columns, 0.11, 0.02)
    found = climb(grid, *slack(grid), lowest=Rung.COUPLED)
    s, t = np.meshgrid(*lines(grid, overhang=0.01))
    assert np.isfinite(found.points(s, t)).all()
    assert found.lines()
    assert (found.rung == Rung.COUPLED).all()


def test_every_coupled_patch_is_what_the_array_of_patches_is():
    found = climb(GRID, *lifted(height=0.02), lowest=Rung.COUPLED)
    s, t = np.meshgrid(*lines(GRID))
    points, patches = coupled_points(GRID, *lifted(height=0.02), s, t)
    assert_allclose(found.patches.energy, patches.energy, rtol=1e-6, atol=1e-12)
    assert_allclose(found.points(s, t), points, rtol=0, atol=1e-7)


@pytest.mark.parametrize("tolerance", [0.0, -1e-3, np.nan])
def test_a_tolerance_is_positive(tolerance):
    with pytest.raises(PlyError, match="tolerance"):
        climb(GRID, *flat(), tolerance=tolerance)
