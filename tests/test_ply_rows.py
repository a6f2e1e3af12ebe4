"""Low ply: which samples, and how their height changes with cups and strokes."""

from functools import lru_cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from drapeplan.contact import ply_over_mold
from drapeplan.equilibrium import Equilibrium
from drapeplan.frames import inverse, moved
from drapeplan.hanging import tool_physics
from drapeplan.legs import STROKE, cup_poses
from drapeplan.path import CupState
from drapeplan.ply_rows import LOW, MOST, PlyRows
from tests.settled import drape, settled, small
from tests.test_shape import rotations as turns

EXACT = 1e-6  # [-] of the largest derivative; a flat mold has one normal
CURVED = 2e-3  # [-] the same: gaps of 1 mm see the normal turn along a curved mold
STEP = 1e-5  # [m, rad] of fourth-order differences
STROKE_STEP = 1e-4  # [m] strokes move at most this far: rests are true to 1e-9
WEIGHTS = np.array([1.0, -8.0, 8.0, -1.0]) / 12  # of differences at -2, -1, 1, 2 steps
PRESS = 2e-3  # [m] a cup pushed down


@lru_cache
def plane():
    """A mold that is flat, but leans and is turned."""
    return drape({"kind": "plane"}, mold={"rotation_deg": (8.0, -5.0, 20.0)})


def laid(made):
    """Cup poses at the end of the wave, world."""
    path = made.request.path
    last = len(path.phase) - 1 - path.phase[::-1].index("wave")
    return path.positions[last], path.rotations[last]


def heights(cell, poses):
    """Gaps of all samples to the mold, flat."""
    p, R = moved(inverse(cell.world_mold), *poses)
    return ply_over_mold(cell, p[None], R[None])[1].ravel()


def differences(function, step):
    """Fourth-order differences of a function of one number."""
    return np.tensordot(WEIGHTS, [function(k * step) for k in (-2, -1, 1, 2)], 1) / step


def waved(made, rng):
    """Cups somewhat above their targets, tilted and turned a little."""
    positions, R = laid(made)
    n = len(positions)
    lifted = positions + R[..., 2] * rng.uniform(0.0, 1e-3, (n, 1))
    return lifted, turns(rng.normal(0, 0.01, (n, 3))) @ R


@pytest.mark.parametrize(("name", "accuracy"), [("plane", EXACT), ("dome", CURVED)])
def test_slopes_are_the_derivatives_by_the_cups(name, accuracy):
    """Against differences: all cups move and turn at once, in five random ways."""
    made = plane() if name == "plane" else small("dome")
    rng = np.random.default_rng(3)
    poses = waved(made, rng)
    n = len(poses[0])
    response = rng.normal(size=(2, n, 3, 5))
    rows = PlyRows(made.cell, laid(made))
    samples = rng.permutation(heights(made.cell, poses).size)[:200]
    found = rows.slopes(poses, samples, tuple(response))

    def there(k, h):
        step = response[..., k] * h
        return heights(made.cell, (poses[0] + step[0], turns(step[1]) @ poses[1]))

    truth = [differences(lambda h, k=k: there(k, h), STEP)[samples] for k in range(5)]
    assert np.abs(found).max() > 0.5
    error = np.abs(found - np.transpose(truth)).max()
    assert error <= accuracy * np.abs(found).max()


def test_slopes_through_the_equilibrium_are_those_of_the_strokes():
    """Strokes moved, the tool settled anew: the ply goes where the rows say."""
    made = small("dome")
    cell, robot, path = made.cell, made.cell.robot, made.request.path
    k = int(np.flatnonzero((path.step == 1) & (path.tau > 0.9))[0])
    fixed = path.states[k] == CupState.PLACED
    tool = Equilibrium(robot, tool_physics(cell))
    rest = tool.settle(settled("dome").motion.q[k], fixed)
    response = tool.sensitivities(rest, fixed)
    direction = np.random.default_rng(1).uniform(-1, 1, (~fixed).sum())

    def poses(q):
        T = robot.arm_forward(q[robot.arm_columns])
        return cup_poses(robot.geometry, T, q[robot.leg_columns])

    def there(h):
        q = rest.q.copy()
        q[robot.leg_columns[~fixed, STROKE]] += h * direction
        return heights(cell, poses(tool.settle(q, fixed, rest).q))

    rows = PlyRows(cell, laid(made))
    samples = np.arange(heights(cell, poses(rest.q)).size)
    motion = response.position, response.rotation
    found = rows.slopes(poses(rest.q), samples, motion) @ direction
    truth = differences(there, STROKE_STEP)
    assert np.abs(truth).max() > 0.5
    assert_allclose(found, truth, atol=CURVED * np.abs(truth).max())


def test_low_finds_a_pushed_cup():
    """The lowest samples lie on the cup that is pushed down, as deep as that."""
    made = small("dome")
    cell = made.cell
    positions, R = laid(made)
    cup, n = 7, len(positions)
    pushed = positions - np.where(np.arange(n) == cup, PRESS, 0.0)[:, None] * R[..., 2]
    none = np.zeros(n, bool)
    samples, height = PlyRows(cell, (positions, R)).low((pushed, R), none)
    assert len(samples) == MOST
    assert (np.diff(height) >= 0).all()
    assert height[0] == pytest.approx(-PRESS, rel=0.1)
    assert cell.sampling.cup_index.ravel()[samples[0]] == cup


def test_low_leaves_out_what_stands_and_what_is_high():
    """Placed patches are not watched, nor is ply that hangs well above."""
    made = small("dome")
    cell = made.cell
    positions, R = laid(made)
    rows = PlyRows(cell, (positions, R))
    standing = np.ones(len(positions), bool)
    assert not rows.low((positions, R), standing)[0].size
    raised = positions + 2 * LOW * R[..., 2]
    samples, height = rows.low((raised, R), ~standing)
    assert not samples.size
    standing[7] = False
    samples, height = rows.low((positions, R), standing)
    around = cell.sampling.cups_around.reshape(-1, 4)[samples]
    assert (around == 7).any(axis=1).all()
    assert_allclose(height, 0.0, atol=1e-12)
