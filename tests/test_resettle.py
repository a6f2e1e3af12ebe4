"""Resettle: the tool on another ply or mold, with the strokes of the plan."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from drapeplan.frames import inverse, moved
from drapeplan.noise import Spread, draw, registered
from drapeplan.resettle import FAR_OFF, Rests, StiffnessTable
from tests.plans import panel

AT_REST = 1e-6  # [m] as in the plan's own check
PARABOLA = 2e-7  # [m] what a parabola over the logarithm of the stiffness misses
SPREAD = 0.3  # [-] of the logarithm


@pytest.fixture(scope="module")
def rests():
    """A few waypoints of the panel's wave, before cups are placed."""
    plan = panel().plan
    track = plan.track
    count = track.placed.sum(axis=1)
    chosen = np.flatnonzero((count[:-1] > 0) & (count[1:] > count[:-1]))[:3]
    to_mold = inverse(plan.cell.world_mold)
    poses = moved(to_mold, *(pose[chosen] for pose in track.poses))
    return Rests(
        plan.cell, track.q[chosen], track.tool[chosen], track.placed[chosen], poses
    )


def apart(a, b):
    """Largest distance of two sets of cup positions, in [m]."""
    return np.linalg.norm(a[0] - b[0], axis=-1).max()


def test_on_its_own_ply_and_mold_the_tool_rests_where_it_is(rests):
    assert apart(rests.settle(1.0), rests.poses) <= AT_REST
    assert apart(rests.settle(1.0, lambda points: points), rests.poses) <= AT_REST


def test_stiffness_moves_free_cups_alone(rests):
    found = rests.settle(3.0)
    assert apart(found, rests.poses) > 5 * AT_REST
    assert_allclose(found[0][rests.fixed], rests.poses[0][rests.fixed], atol=1e-12)


def test_the_table_is_the_equilibrium(rests):
    nodes = np.exp(SPREAD * FAR_OFF * np.array([-1.0, 1.0]))
    table = StiffnessTable.of(rests.poses, [rests.settle(f) for f in nodes])
    for spreads in (-1.0, 0.7):
        exact = rests.settle(float(np.exp(SPREAD * spreads)))
        found = table.poses(rests.poses, spreads)
        assert apart(found, exact) <= PARABOLA + AT_REST
        assert apart(found, exact) < 0.3 * apart(rests.poses, exact) + PARABOLA
        assert_allclose(found[1], exact[1], atol=1e-4)
    assert_array_equal(table.poses(rests.poses, 0.0)[0], rests.poses[0])


def test_a_side_without_rest_has_no_poses(rests):
    table = StiffnessTable.of(rests.poses, [None, rests.poses])
    assert table.poses(rests.poses, -0.1) is None
    assert table.poses(rests.poses, 0.1) is not None


def test_placed_cups_stand_on_the_mold_that_moved(rests):
    """The gap of each placed cup to the mold as it stands is what it was planned."""
    sample = draw(0, 0, rests.fixed.shape[1], len(rests.fixed))
    sample = replace(sample, registration=np.array([1.0, -1.0, 1.0, 1.0]))
    spread = Spread(mold_xy=5e-4, mold_z=1e-3, mold_yaw=1e-3)

    def real(points):
        return registered(points, sample, spread)

    positions, _ = rests.settle(1.0, real)
    gap = rests.cell.mold.gap
    now = gap(real(positions))[rests.fixed]
    assert_allclose(now, gap(rests.poses[0])[rests.fixed], atol=5e-6)
    rise = (positions - rests.poses[0])[rests.fixed][:, 2]
    assert_allclose(rise, 1e-3, atol=3e-4)
    moved_free = (positions - rests.poses[0])[~rests.fixed]
    assert np.linalg.norm(moved_free, axis=-1).max() > 1e-5
