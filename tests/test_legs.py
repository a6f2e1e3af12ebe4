import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from drapeplan.legs import (
    FACE,
    STROKE,
    SX,
    UX,
    LegGeometry,
    cross,
    cup_poses,
    grid_universals,
    leg_coordinates,
    leg_twists,
    rotation,
)

EXACT = 1e-12  # [m, rad] a few thousand roundings at 1 m
STEP = 1e-6  # [rad, m] of central differences: error about 1e-10, from both sides
DIFFERENCE = 2e-9  # [m, m/rad] of central differences at that step

ROWS, COLUMNS, PITCH, DEPTH = 3, 4, 0.110, 0.060
N = ROWS * COLUMNS
GEOMETRY = LegGeometry(
    grid_universals(ROWS, COLUMNS, PITCH, DEPTH), 0.150, 0.450, 0.005
)
LIMITS = np.array([15, 15, 0, 40, 40, 15]) * np.pi / 180
LOWER, UPPER = -LIMITS, LIMITS.copy()
UPPER[STROKE] = 0.300

seeds = st.integers(0, 2**32 - 1)


def random_legs(rng, *batch):
    return rng.uniform(LOWER, UPPER, (*batch, N, 6))


def random_placements(rng, *batch):
    """Tool placements, any orientation, shape (*batch, 4, 4)."""
    T = np.zeros((*batch, 4, 4))
    angles = rng.uniform(-np.pi, np.pi, (3, *batch))
    T[..., :3, :3] = (
        rotation("z", angles[0]) @ rotation("y", angles[1]) @ rotation("x", angles[2])
    )
    T[..., :3, 3] = rng.uniform(-1, 1, (*batch, 3))
    T[..., 3, 3] = 1
    return T


def test_straight_legs_reproduce_the_flat_grid():
    """Tool straight down, s along +x and t along +y of the world."""
    T = np.eye(4)
    T[:3, :3] = FACE
    T[:3, 3] = 0.5, 0.25, 0.8
    legs = np.zeros((N, 6))
    legs[:, STROKE] = 0.1
    p, R = cup_poses(GEOMETRY, T, legs)
    grid = p.reshape(ROWS, COLUMNS, 3)
    assert_allclose(p.mean(axis=0), [0.5, 0.25, 0.8 - 0.06 - 0.25 - 0.005], atol=EXACT)
    assert_allclose(
        np.diff(grid, axis=1) - [PITCH, 0, 0], np.zeros((3, 3, 3)), atol=EXACT
    )
    assert_allclose(
        np.diff(grid, axis=0) - [0, PITCH, 0], np.zeros((2, 4, 3)), atol=EXACT
    )
    assert_allclose(R, np.broadcast_to(np.eye(3), (N, 3, 3)), atol=EXACT)


def test_signs_of_the_joints():
    """Positive ux swings a cup toward -y of the tool; positive sx turns the face so."""
    legs = np.zeros((N, 6))
    legs[:, UX] = 0.1
    swung = cup_poses(GEOMETRY, np.eye(4), legs)[0] - GEOMETRY.universals
    assert_allclose(swung, np.tile([0, -np.sin(0.1), np.cos(0.1)], (N, 1)) * 0.155)
    legs[:, UX], legs[:, SX] = 0, 0.1
    n = cup_poses(GEOMETRY, np.eye(4), legs)[1][..., 2]
    assert_allclose(n, np.tile([0, np.sin(0.1), -np.cos(0.1)], (N, 1)))


@given(seed=seeds)
def test_coordinates_undo_poses(seed):
    rng = np.random.default_rng(seed)
    legs, T = random_legs(rng, 2), random_placements(rng, 2)
    poses = cup_poses(GEOMETRY, T, legs)
    assert_allclose(leg_coordinates(GEOMETRY, T, *poses), legs, atol=EXACT)


@given(seed=seeds)
def test_poses_undo_coordinates_anywhere(seed):
    """Any pose is met, however far outside the limits its coordinates are."""
    rng = np.random.default_rng(seed)
    T, cups = random_placements(rng), random_placements(rng, N)
    p, R = cups[:, :3, 3], cups[:, :3, :3]
    legs = leg_coordinates(GEOMETRY, T, p, R)
    assert_allclose(cup_poses(GEOMETRY, T, legs)[0], p, atol=EXACT)
    assert_allclose(cup_poses(GEOMETRY, T, legs)[1], R, atol=EXACT)


def test_tool_and_cups_moved_together_keep_the_coordinates():
    rng = np.random.default_rng(0)
    legs, (T, M) = random_legs(rng), random_placements(rng, 2)
    p, R = cup_poses(GEOMETRY, T, legs)
    moved = leg_coordinates(GEOMETRY, M @ T, p @ M[:3, :3].T + M[:3, 3], M[:3, :3] @ R)
    assert_allclose(moved, legs, atol=EXACT)


def test_batches_equal_single_poses():
    rng = np.random.default_rng(1)
    legs, T = random_legs(rng, 2, 3), random_placements(rng, 3)
    p, R = cup_poses(GEOMETRY, T, legs)
    back = leg_coordinates(GEOMETRY, T, p, R)
    twists = leg_twists(GEOMETRY, T, legs)
    assert (p.shape, R.shape) == ((2, 3, N, 3), (2, 3, N, 3, 3))
    for k in np.ndindex(2, 3):
        single = cup_poses(GEOMETRY, T[k[1]], legs[k])
        assert_allclose(p[k], single[0], atol=EXACT)
        assert_allclose(R[k], single[1], atol=EXACT)
        assert_allclose(back[k], legs[k], atol=EXACT)
        alone = leg_twists(GEOMETRY, T[k[1]], legs[k])
        assert_allclose(twists[k], alone, atol=EXACT)


def test_ball_in_the_universal_joint_is_finite():
    R = np.broadcast_to(FACE, (N, 3, 3))
    p = GEOMETRY.universals - GEOMETRY.ball_height * R[..., 2]
    legs = leg_coordinates(GEOMETRY, np.eye(4), p, R)
    assert_allclose(legs[:, STROKE], -GEOMETRY.leg_min, atol=EXACT)
    assert np.isfinite(legs).all()


@settings(max_examples=20)
@given(seed=seeds)
def test_twists_agree_with_finite_differences(seed):
    rng = np.random.default_rng(seed)
    legs, T = random_legs(rng), random_placements(rng)
    p, R = cup_poses(GEOMETRY, T, legs)
    twists = leg_twists(GEOMETRY, T, legs)
    for k, step in enumerate(np.eye(6) * STEP):
        (p1, R1), (p0, R0) = (cup_poses(GEOMETRY, T, legs + d) for d in (step, -step))
        v, w = twists[:, k, :3], twists[:, k, 3:]
        velocity = (p1 - p0) / (2 * STEP)
        spin = (R1 - R0) / (2 * STEP)
        assert_allclose(v + np.cross(w, p), velocity, atol=DIFFERENCE)
        columns = np.cross(w[:, :, None], R, axis=1)
        assert_allclose(columns, spin, atol=DIFFERENCE)


def test_cross_is_the_cross_product():
    a, b = np.random.default_rng(2).normal(size=(2, 5, 4, 3))
    assert_allclose(cross(a, b[:, :1]), np.cross(a, b[:, :1]))
