"""Gravity on the ladder: modeled where it counts, and honest where it is left out."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from ply.coupled import CoupledModel, CoupledStatus
from ply.errors import PlyError
from ply.gravity import gravity_sags
from ply.grid import CupGrid
from ply.ladder import Rung, climb, ladder_alternatives
from ply.ladder_rungs import cell_rms, probes
from tests.test_ladder import GRID, flat, slack
from tests.validation.test_ladder_truth import drawn

TOLERANCE = 1e-4  # [m] asked of the ladder
CELL = CupGrid(2, 2, 0.11, 0.02)
STRIP = CupGrid(1, 2, 0.11, 0.02)


def ply(grid, mass, bending=5e-3, up=(0.0, 0.0, 1.0)):
    return CoupledModel(
        grid, bending=bending, weight=tuple(-9.81 * mass * np.array(up))
    )


def probed(grid, found):
    lines = probes(grid)
    return found.points(*np.meshgrid(lines.s, lines.t))


def test_a_light_ply_is_the_weightless_one():
    found = climb(GRID, *flat(), model=ply(GRID, 0.2))
    assert not found.heavy.any()
    assert 0 < found.sag.max() < TOLERANCE
    assert_array_equal(probed(GRID, found), probed(GRID, climb(GRID, *flat())))


@pytest.mark.parametrize("lowest", [Rung.CUBIC, Rung.MODAL, Rung.COUPLED])
def test_a_heavy_ply_hangs_down(lowest):
    """By the estimate at most, whichever rung it stands on."""
    model = ply(GRID, 0.5, 1e-3, up=(0, 0, -1))
    found = climb(GRID, *flat(), model=model, lowest=lowest)
    assert found.heavy.all()
    assert found.rung.min() >= Rung.MODAL
    up = probed(GRID, found)[..., 2].max()
    sags = gravity_sags(GRID, flat()[1], model.weight, model.bending)
    assert sags.s.max() / 2 < up < found.sag.max()


def test_gravity_counts_where_it_bears_on_the_ply():
    """A row of upright cups carries the weight within the ply."""
    positions, frames = flat()
    model = ply(GRID, 0.5, 1e-3, up=(0, 1, 0))
    assert not climb(GRID, positions, frames, model=model).heavy.any()


def test_the_weight_chooses_the_side_of_slack():
    for way in (1, -1):
        found = ladder_alternatives(
            CELL, *slack(CELL), model=ply(CELL, 0.3, up=(0, 0, way))
        )
        assert np.sign(found.points(0.055, 0.055)[0, 2]) == -way


def test_heavy_and_light_cells_share_their_edges():
    positions, frames = flat()
    for cup in (3, 7, 11):  # upright: no weight along their normals
        frames[cup] = frames[cup] @ [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    found = climb(GRID, positions, frames, model=ply(GRID, 0.3), lowest=Rung.MODAL)
    edge = GRID.half_width
    t = np.linspace(0, 2 * GRID.pitch, 41)
    for s in (GRID.pitch + edge, 2 * GRID.pitch - edge):
        apart = found.points(s - 1e-9, t) - found.points(s + 1e-9, t)
        assert_allclose(apart, 0, atol=1e-8)


def test_the_overhang_droops_where_it_counts():
    for mass, droops in ((0.1, False), (3.0, True)):
        poses, model = flat(), ply(GRID, mass, 2e-3)
        hung = climb(GRID, *poses, model=model, overhang=0.025)
        free = climb(GRID, *poses, model=model)
        s, t = np.array([-0.045, -0.045, 0.05]), np.array([0.0, -0.045, 0.05])
        fall = (free.points(s, t) - hung.points(s, t))[:, 2]
        assert (fall[:2] > TOLERANCE).all() == droops
        assert fall[2] == 0
        assert hung.effects()[1].modeled == droops
        with pytest.raises(PlyError, match="points_st"):
            hung.points(-0.05, 0.0)


@pytest.mark.parametrize(("grid", "relief"), [(CELL, 0.3), (STRIP, 1.0)])
@pytest.mark.parametrize(("bending", "mass"), [(5e-3, 0.25), (5e-4, 0.02)])
def test_gravity_left_out_is_below_the_tolerance(grid, relief, bending, mass):
    """Coupled patches with and without it, and what stays low against the top."""
    poses, model = drawn(grid, relief, 7), ply(grid, mass, bending)
    poses = poses[0][:80], poses[1][:80]
    found = climb(grid, *poses, model=model)
    top = climb(grid, *poses, model=model, lowest=Rung.COUPLED)
    every = climb(grid, *poses, model=model, lowest=Rung.COUPLED, tolerance=1e-9)
    stable = [one.patches.status == CoupledStatus.CONVERGED for one in (top, every)]
    stable = stable[0] & stable[1]
    light, low = stable & ~found.heavy, stable & (found.rung < Rung.COUPLED)
    assert min(light.sum(), low.sum()) >= 1
    surfaces = [probed(grid, one) for one in (found, top, every)]
    assert cell_rms(grid, surfaces[1], surfaces[2])[light].max() < TOLERANCE
    assert cell_rms(grid, surfaces[0], surfaces[1])[low].max() < TOLERANCE
