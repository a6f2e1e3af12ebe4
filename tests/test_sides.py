import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from ply.fiber import FiberStatus
from ply.grid import CupGrid
from ply.sides import alternatives, bending_energy
from ply.weave import Sides, ply_fibers
from tests.test_shape import poses, rotations

CELL = CupGrid(2, 2, 0.11, 0.02)


def flat(grid, slack):
    """Level cups, nearer than the ply between them by some slack."""
    positions = np.zeros((grid.n_cups, 3))
    positions[:, :2] = grid.centers * (1 - slack / grid.pitch)
    return positions, np.tile(np.eye(3), (grid.n_cups, 1, 1))


def test_slack_flat_ply_has_its_bowls_first():
    """All strips one way bend the patch least; the mirror image costs the same."""
    cups = flat(CELL, 1e-3)
    found = alternatives(CELL, *cups)
    energy = [one[1] for one in found]
    assert len(found) == 4
    assert energy == sorted(energy)
    assert energy[1] == pytest.approx(energy[0], rel=1e-9)
    first, second = (np.append(one.sides.s, one.sides.t) for one, _ in found[:2])
    assert len(set(first.tolist())) == 1
    assert_array_equal(first, -second)


def test_energies_are_those_of_each_shape_alone():
    positions, frames = flat(CELL, 1e-3)
    for fibers, energy in alternatives(CELL, positions, frames):
        again = ply_fibers(CELL, positions, frames, model="modal", sides=fibers.sides)
        assert_allclose(again.s, fibers.s, rtol=0, atol=1e-15)
        alone = bending_energy(CELL, again, positions, frames)
        assert alone == pytest.approx(energy, rel=1e-12)


def test_a_ply_without_slack_has_one_shape():
    cups = flat(CELL, 0.0)
    found = alternatives(CELL, *cups)
    assert len(found) == 1
    assert found[0][1] == pytest.approx(0, abs=1e-12)


def test_energy_of_a_cylinder():
    """Half of curvature squared times the bent area: flat cups leave their share."""
    grid, radius = CupGrid(1, 2, 0.11, 0.02), 0.5
    edge = np.array([[0, 0, 0], [2 * radius * np.sin(0.07 / radius / 2), 0, 0]])
    tilt = 0.07 / radius / 2
    turn = np.stack([rotations(np.array([0, way * tilt, 0])) for way in (-1, 1)])
    arm = turn[:, :, 0] * np.array([[-0.02], [0.02]])
    fibers = ply_fibers(grid, edge + arm, turn, model="modal")
    energy = bending_energy(grid, fibers, edge + arm, turn)
    assert energy == pytest.approx(0.07 * 0.04 / radius**2 / 2, rel=0.1)


def test_arrays_weigh_rows_columns_and_families():
    grid = CupGrid(3, 4, 0.11, 0.02)
    found = alternatives(grid, *flat(grid, 0.5e-3), count=6)
    assert len(found) == 6
    for side in (-1, 1):
        assert any((one.sides.s == side).all() for one, _ in found)


def test_a_trajectory_carries_its_sides():
    """Cups that lean the other way, a little, do not snap the ply through."""
    positions, frames = flat(CELL, 1e-3)
    up = Sides(np.ones((2, 1)), np.ones((1, 2)))
    fibers = ply_fibers(CELL, positions, frames, model="modal", sides=up)
    assert (fibers.sides.s == 1).all()
    assert (fibers.s_status == FiberStatus.WEAK_DIRECTION).all()
    for step in range(4):
        lean = rotations(np.array([0.0, 0.004 * step, 0.0]))
        tilted = frames.copy()
        tilted[[0, 2]], tilted[[1, 3]] = lean, lean.T
        alone = ply_fibers(CELL, positions, tilted, model="modal")
        fibers = ply_fibers(CELL, positions, tilted, model="modal", sides=fibers.sides)
        assert (alone.sides.s == -1).all()
        assert (fibers.sides.s == 1).all()


def test_sides_of_a_batch():
    grid = CupGrid(2, 3, 0.11, 0.02)
    positions, frames = poses(grid, 0, batch=(5,), play=1e-3)
    fibers = ply_fibers(grid, positions, frames, model="modal")
    assert fibers.sides.s.shape == (5, 2, 2)
    again = ply_fibers(grid, positions, frames, model="modal", sides=fibers.sides)
    assert_array_equal(again.s, fibers.s)
    assert_array_equal(fibers.pose(3).s, fibers.s[3])
