"""Noise: samples that can be compared, and cups that stay on their links."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from drapeplan.noise import (
    CLOSED,
    PARAMETERS,
    YAW,
    LinkKeeper,
    Spread,
    as_registered,
    draw,
    registered,
    turned,
)
from drapeplan.scene import UncertaintySection
from urdf.sidecar import neighbor_pairs

ROWS, COLUMNS, PITCH = 4, 5, 0.11
CUPS = ROWS * COLUMNS
SECOND_ORDER = 0.05  # [-] of a projection: what a retraction changes of it
STATED = Spread.of(UncertaintySection())


def links(height=0.0, give=0.0):
    """Interlinks of a small tool."""
    return SimpleNamespace(
        pairs=neighbor_pairs(ROWS, COLUMNS),
        height=height,
        shortest=PITCH - give,
        longest=PITCH + give,
    )


def flat(poses=1):
    """Level cups on a square grid, shapes (K, n, 3) and (K, n, 3, 3)."""
    i, j = np.divmod(np.arange(CUPS), COLUMNS)
    positions = np.stack([j, i, 0 * i], axis=1) * PITCH
    return (
        np.tile(positions, (poses, 1, 1)),
        np.tile(np.eye(3), (poses, CUPS, 1, 1)),
    )


def free_but(placed, poses=1):
    """All cups but some are free, shape (K, n)."""
    free = np.ones((poses, CUPS), bool)
    free[:, placed] = False
    return free


def one(seed=0, index=0, poses=1, redrawn=0.0):
    return draw(seed, index, CUPS, poses, redrawn)


def same(a, b):
    """Whether two samples are the same to the last bit."""
    return all(np.array_equal(getattr(a, f), getattr(b, f)) for f in vars(a))


def test_a_sample_is_named_by_seed_and_index():
    assert same(one(3, 5), one(3, 5))
    for other in (one(4, 5), one(3, 6)):
        assert not any(
            np.array_equal(getattr(one(3, 5), f), getattr(other, f)) for f in PARAMETERS
        )


def test_parameters_do_not_share_their_numbers():
    sample = one()
    assert sample.take_up != sample.stiffness
    assert not np.array_equal(sample.tilt, sample.registration[:2])
    assert not np.array_equal(sample.position, sample.angle)


def test_what_is_redrawn_changes_no_other_parameter():
    still, anew = one(), one(poses=3, redrawn=0.5)
    for name in ("tilt", "take_up", "stiffness", "registration"):
        assert_array_equal(getattr(still, name), getattr(anew, name))
    assert anew.position.shape == (3, CUPS, 3)
    assert not np.array_equal(anew.position[0], anew.position[1])


def test_redrawn_errors_keep_their_spread_and_their_common_part():
    samples = [draw(0, k, 200, 2, 0.36).position for k in range(20)]
    first, second = np.swapaxes(samples, 0, 1)
    assert first.std() == pytest.approx(1.0, abs=0.03)
    shared = np.mean(first * second)
    assert shared == pytest.approx(0.64, abs=0.03)


@pytest.mark.parametrize("name", PARAMETERS)
def test_only_one_parameter_is_left(name):
    alone = STATED.only(name)
    assert [other for other in PARAMETERS if alone.has(other)] == [name]
    whole = {k: v for k, v in vars(alone).items() if v}
    assert whole.items() <= vars(STATED).items()


def test_stated_units():
    spread = Spread.of(UncertaintySection(position_mm=2.0, mold_yaw_deg=180.0 / 9))
    assert spread.position == pytest.approx(2e-3)
    assert spread.mold_yaw == pytest.approx(np.pi / 9)


@settings(max_examples=25, deadline=None)
@given(
    index=st.integers(0, 1000),
    placed=st.sampled_from([[0], [7, 8], [5, 6, 7, 8, 9], [6, 7, 8, 11, 12, 13]]),
    height=st.sampled_from([0.0, 0.012]),
    size=st.floats(1e-5, 1e-3),
)
def test_links_hold_exactly_and_placed_cups_stay(index, placed, height, size):
    positions, rotations = flat()
    free, sample = free_but(placed), one(index=index)
    spread = Spread(position=size, angle=0.01)
    tilted = turned(rotations, free, sample, spread)
    keeper = LinkKeeper(links(height), positions, rotations, free)
    noisy = positions + size * sample.position * free[..., None]
    kept, error = keeper.keep(noisy, tilted)
    ends = kept + height * tilted[..., 2]
    i, j = links().pairs.T
    length = np.linalg.norm(ends[:, j] - ends[:, i], axis=-1)
    live = free[:, links().pairs].any(axis=-1)
    assert_allclose(length[live], PITCH, atol=2 * CLOSED)
    assert error <= CLOSED
    assert_array_equal(kept[~free], positions[~free])


def test_the_shortest_way_back_is_the_projection():
    """What is taken away lies in the links' row space, by an independent null space."""
    positions, rotations = flat()
    free, sample = free_but([7]), one()
    size = 2e-5  # [m] errors so small that second order hardly shows
    keeper = LinkKeeper(links(), positions, rotations, free)
    noise = size * sample.position * free[..., None]
    kept, _ = keeper.keep(positions + noise, rotations)
    i, j = links().pairs.T
    e = (positions[0, j] - positions[0, i]) / PITCH
    J = np.zeros((len(i), CUPS, 3))
    J[np.arange(len(i)), i], J[np.arange(len(i)), j] = -e, e
    J = (J * free[0, :, None]).reshape(len(i), -1)
    _, size_of, V = np.linalg.svd(J)
    null = V[(size_of > 1e-9).sum() :]
    projected = null.T @ (null @ (noise.ravel()))
    moved = (kept - positions).ravel()
    assert_allclose(moved, projected, atol=SECOND_ORDER * size)
    assert np.abs(noise.ravel() - projected).max() > 0.3 * size


def test_links_with_a_range_leave_errors_within_it():
    positions, rotations = flat()
    free = free_but([7])
    noisy = positions + 1e-4 * one().position * free[..., None]
    keeper = LinkKeeper(links(give=2e-3), positions, rotations, free)
    kept, error = keeper.keep(noisy, rotations)
    assert_array_equal(kept, noisy)
    assert error == 0.0


def test_poses_without_errors_are_left_alone():
    positions, rotations = flat(2)
    keeper = LinkKeeper(links(), positions, rotations, free_but([3], 2))
    assert keeper.keep(positions, rotations)[0] is positions
    assert turned(rotations, free_but([3], 2), one(), Spread()) is rotations
    assert registered(positions, one(), Spread()) is positions


def test_yaw_has_less_spread_than_tilt():
    _, rotations = flat()
    free, spread = free_but([0]), Spread(angle=0.01)
    found = turned(rotations, free, one(), spread)
    skew = (found - np.swapaxes(found, -1, -2)) / 2
    turn = np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1)
    expected = 0.01 * one().angle * (1.0, 1.0, YAW)
    assert_allclose(turn[0, 1:], expected[1:], rtol=2e-3)
    assert_array_equal(found[0, 0], np.eye(3))


def test_the_tilt_of_all_cups_is_one():
    _, rotations = flat()
    found = turned(rotations, free_but([0]), one(), Spread(tilt=0.01))
    assert_allclose(found[0, 1:], np.broadcast_to(found[0, 1], (CUPS - 1, 3, 3)))
    assert found[0, 1, 1, 2] == pytest.approx(-0.01 * one().tilt[0], rel=1e-3)


def test_registration_takes_points_back_to_where_the_mold_went():
    """A point that rides on the mold has the same coordinates in its frame."""
    sample = replace(one(), registration=np.array([1.0, -2.0, 3.0, 1.0]))
    spread = Spread(mold_xy=1e-3, mold_z=1e-3, mold_yaw=np.pi / 2)
    on_mold = np.array([[0.2, 0.1, 0.05]])
    in_cell = np.array([[-0.099, 0.198, 0.053]])  # a quarter turn, then the shift
    assert_allclose(registered(in_cell, sample, spread), on_mold, atol=1e-15)


def test_cups_turn_with_the_points_that_they_hold():
    """Registration of a cup's pose takes along any point fixed to the cup."""
    sample = replace(one(), registration=np.array([1.0, -2.0, 3.0, 1.0]))
    spread = Spread(mold_xy=1e-3, mold_z=1e-3, mold_yaw=0.3)
    (positions, rotations), arm = flat(2), np.array([0.03, -0.02, 0.01])
    p, R = as_registered((positions, rotations), sample, spread)
    held = registered(positions + rotations @ arm, sample, spread)
    assert_allclose(p + R @ arm, held, atol=1e-15)
    assert as_registered((positions, rotations), sample, Spread())[1] is rotations
