import numpy as np
import pytest
from numpy.testing import assert_allclose

from ply.errors import PlyError
from ply.grid import CupGrid
from ply.reconcile import _excess, reconcile
from ply.weave import ply_fibers
from tests.test_shape import poses, rotations

GRID = CupGrid(3, 4, 0.11, 0.02)
SIGMA, ANGLE = 0.25e-3, np.deg2rad(0.25)  # [m], [rad] as stated for measured poses
SETTLED = 1.5e-4  # [m] of excess left: three times the difference between lengths


def noise(grid, seed, spacing=0.0, batch=()):
    """A flat ply with cups nearer by `spacing`, and the same with noise."""
    rng = np.random.default_rng(seed)
    true = np.zeros((grid.n_cups, 3))
    true[:, :2] = grid.centers * (1 - spacing / grid.pitch)
    shape = (*batch, *true.shape)
    positions = true + SIGMA * rng.normal(size=shape)
    return true, positions, rotations(ANGLE * rng.normal(size=shape))


def test_rates_of_natural_lengths_are_finite_differences():
    positions, frames = poses(GRID, 1)
    excess, rates = _excess(GRID, positions, frames)
    fibers = ply_fibers(GRID, positions, frames)
    natural = [np.moveaxis(one, -1, 0) for one in (fibers.s_natural, fibers.t_natural)]
    expected = np.concatenate([one.ravel() for one in natural]) - GRID.s_length
    assert_allclose(excess, expected, rtol=0, atol=1e-15)
    step = 1e-6
    for cup, k in np.ndindex(GRID.n_cups, 6):
        both = []
        for way in (step, -step):
            p, turn = positions.copy(), np.zeros(3)
            if k < 3:
                p[cup, k] += way
            else:
                turn[k - 3] = way
            turned = frames.copy()
            turned[cup] = rotations(turn) @ frames[cup]
            both.append(_excess(GRID, p, turned)[0])
        slope = (both[0] - both[1]) / (2 * step)
        assert_allclose(rates[:, cup, k], slope, rtol=0, atol=1e-8)


def test_noise_is_taken_out_of_the_lengths():
    _, positions, frames = noise(GRID, 2, batch=(20,))
    found = reconcile(GRID, positions, frames, SIGMA, ANGLE)
    assert (found.slack == 0).mean() > 0.8
    assert found.misfit.max() < 1
    settled = found.slack == 0
    excess = _excess(GRID, found.positions, found.rotations)[0][settled]
    before = _excess(GRID, positions, frames)[0][settled]
    assert before.std() > 3e-4
    assert np.quantile(abs(excess), 0.99) < SETTLED
    chord = ply_fibers(GRID, found.positions, found.rotations).s[..., 1:, :].sum(-2)
    over = np.linalg.norm(chord, axis=-1)[settled] > GRID.s_length + SETTLED
    assert over.mean() < 0.01


def test_poses_move_towards_the_truth():
    true, positions, frames = noise(GRID, 3, batch=(20,))
    found = reconcile(GRID, positions, frames, SIGMA, ANGLE)

    def in_plane(p):
        error = (p - true)[..., :2]
        return (error - error.mean(axis=-2, keepdims=True)).std()

    assert in_plane(found.positions) < 0.8 * in_plane(positions)


def test_real_slack_is_kept():
    _, positions, frames = noise(GRID, 4, spacing=1e-3, batch=(20,))
    found = reconcile(GRID, positions, frames, SIGMA, ANGLE)
    assert_allclose(found.slack, 1e-3, rtol=0, atol=4e-4)
    assert found.slack.mean() == pytest.approx(1e-3, abs=1e-4)


def test_what_noise_does_not_explain_stays():
    _, positions, frames = noise(GRID, 5)
    positions[0] -= [3e-3, 0, 0]
    found = reconcile(GRID, positions, frames, SIGMA, ANGLE)
    excess = _excess(GRID, found.positions, found.rotations)[0]
    assert excess.max() > 1e-3


def test_rigid_motion_moves_the_poses():
    _, positions, frames = noise(GRID, 6)
    turn, shift = rotations(np.array([0.3, -0.5, 1.0])), np.array([0.1, 0.2, 0.3])
    found = reconcile(GRID, positions, frames, SIGMA, ANGLE)
    moved = reconcile(GRID, positions @ turn.T + shift, turn @ frames, SIGMA, ANGLE)
    expected = found.positions @ turn.T + shift
    assert_allclose(moved.positions, expected, rtol=0, atol=1e-11)
    assert_allclose(moved.rotations, turn @ found.rotations, rtol=0, atol=1e-9)


def test_batch_equals_single_and_rotations_stay_rotations():
    _, positions, frames = noise(GRID, 7, batch=(2, 3))
    found = reconcile(GRID, positions, frames, SIGMA, ANGLE)
    one = reconcile(GRID, positions[1, 2], frames[1, 2], SIGMA, ANGLE)
    assert_allclose(found.positions[1, 2], one.positions, rtol=0, atol=1e-14)
    product = np.swapaxes(found.rotations, -1, -2) @ found.rotations
    assert_allclose(product, np.broadcast_to(np.eye(3), product.shape), atol=1e-14)


def test_exact_poses_and_single_cups_are_left_alone():
    positions, frames = poses(GRID, 8)
    found = reconcile(GRID, positions, frames, 0.0, 0.0)
    assert (found.positions == positions).all()
    assert found.take_up == 0
    alone = reconcile(
        CupGrid(1, 1, 0.11, 0.02), positions[:1], frames[:1], SIGMA, ANGLE
    )
    assert (alone.positions == positions[:1]).all()


def test_bad_uncertainty_is_refused_by_name():
    positions, frames = poses(GRID, 9)
    with pytest.raises(PlyError, match="sigma_angle"):
        reconcile(GRID, positions, frames, SIGMA, -1.0)
