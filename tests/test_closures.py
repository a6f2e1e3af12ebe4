import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from drapeplan.closures import Chords, Closures
from drapeplan.legs import cup_poses, rotation
from drapeplan.robot import Robot, arm_description
from urdf import read_tool
from urdf.generate import tool_sidecar, tool_urdf
from urdf.spec import ToolSpec

EXACT = 1e-12  # [m] a few thousand roundings at 1 m
STEP = 1e-6  # [rad, m] of central differences: error about 1e-10, from both sides
DIFFERENCE = 2e-9  # [m/rad, -] of central differences at that step
RANK = 1e-6  # [m/rad, -] least singular value that counts: far above rounding

seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def robot():
    return Robot(arm_description("ur10"), *read_tool("drape_tool_6x8"))


@pytest.fixture(scope="module")
def high_links():
    """A tool of 3 columns by 4 rows with links 7 mm above the suction faces."""
    spec = ToolSpec("small", rows=4, columns=3, interlink_height=0.007)
    return Robot(arm_description("ur10"), tool_urdf(spec), tool_sidecar(spec))


@pytest.fixture(scope="module", params=[Closures, Chords])
def kind(request):
    return request.param


def random_q(robot, seed, share=0.8):
    """Within the limits, in the middle `share` of every range."""
    rng = np.random.default_rng(seed)
    mid, half = (robot.upper + robot.lower) / 2, (robot.upper - robot.lower) / 2
    return mid + rng.uniform(-share, share, robot.nq) * half


def test_flat_pick_closes_all_links_and_stretches_no_fiber(robot):
    state = robot.kinematics(robot.home())
    closures, chords = Closures(robot), Chords(robot)
    poses = state.positions, state.rotations
    assert (len(closures), len(chords)) == (82, 164)
    assert_allclose(closures.values(*poses), np.zeros(82), atol=EXACT)
    assert_allclose(chords.values(*poses), np.full(164, 0.070), atol=EXACT)


def test_rows_are_pairs_along_s_then_along_t(robot):
    pairs = Closures(robot).pairs
    assert_array_equal(pairs[:6], [[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [6, 7]])
    assert_array_equal(pairs[40:42], [[0, 6], [1, 7]])
    assert_array_equal(Chords(robot).pairs[::2], pairs)


def test_chords_join_near_edges_at_both_laterals(robot):
    """Against the definition, cup by cup, at an arbitrary state."""
    state = robot.kinematics(random_q(robot, 0))
    chords, d = Chords(robot), robot.half_width
    p, R = state.positions, state.rotations
    values = chords.values(p, R)
    for row, (i, j) in enumerate(chords.pairs):
        lateral = -d if row % 2 == 0 else d
        if row < 80:
            ends = p[i] + R[i] @ [d, lateral, 0], p[j] + R[j] @ [-d, lateral, 0]
        else:
            ends = p[i] + R[i] @ [lateral, d, 0], p[j] + R[j] @ [lateral, -d, 0]
        assert values[row] == pytest.approx(np.linalg.norm(ends[1] - ends[0]))


def test_links_end_on_the_axes_above_the_faces(high_links):
    state = high_links.kinematics(random_q(high_links, 1))
    closures = Closures(high_links)
    ends = state.positions + 0.007 * state.rotations[:, :, 2]
    gaps = ends[closures.pairs[:, 1]] - ends[closures.pairs[:, 0]]
    values = closures.values(state.positions, state.rotations)
    assert_allclose(values, np.linalg.norm(gaps, axis=1) - 0.110, atol=EXACT)


@settings(max_examples=5, deadline=None)
@given(seed=seeds)
def test_jacobian_agrees_with_finite_differences(high_links, kind, seed):
    robot, rows = high_links, kind(high_links)
    q = random_q(robot, seed)
    J = rows.jacobian(robot.kinematics(q)).toarray()
    for k, step in enumerate(np.eye(robot.nq) * STEP):
        ends = [robot.kinematics(q + d) for d in (step, -step)]
        values = [rows.values(s.positions, s.rotations) for s in ends]
        slope = (values[0] - values[1]) / (2 * STEP)
        assert_allclose(J[:, k], slope, atol=DIFFERENCE)


@given(seed=seeds)
@settings(max_examples=10, deadline=None)
def test_rigid_motion_changes_nothing(robot, kind, seed):
    state, rows = robot.kinematics(random_q(robot, seed)), kind(robot)
    p, R = state.positions, state.rotations
    turn = rotation("z", 1.0) @ rotation("x", 0.3)
    moved = rows.values(p @ turn.T + [1, 2, 3], turn @ R)
    assert_allclose(moved, rows.values(p, R), atol=EXACT)


def test_pattern_is_fixed_and_leaves_the_arm_out(robot, kind):
    rows = kind(robot)
    first, second = (
        rows.jacobian(robot.kinematics(q)) for q in (robot.home(), random_q(robot, 2))
    )
    assert first.shape == (len(rows), 294)
    assert first.nnz == second.nnz == 12 * len(rows)
    assert_array_equal(first.indices, second.indices)
    assert_array_equal(first.indptr, second.indptr)
    assert first.indices.min() == 6
    dense = second.toarray()
    first.data[:] = first.indices[:] = 0
    third = rows.jacobian(robot.kinematics(random_q(robot, 2)))
    assert_array_equal(third.toarray(), dense)


def test_closures_are_independent(robot):
    for q in (robot.home(), random_q(robot, 3, 0.3)):
        J = Closures(robot).jacobian(robot.kinematics(q)).toarray()
        assert np.linalg.matrix_rank(J, RANK) == 82


def test_batches_equal_single_poses(robot, kind):
    rows = kind(robot)
    qs = np.stack([random_q(robot, k) for k in range(3)])
    T = robot.arm_forward(qs[0, :6])
    p, R = cup_poses(robot.geometry, T, qs[:, robot.leg_columns])
    batch = rows.values(p, R)
    assert batch.shape == (3, len(rows))
    for k in range(3):
        assert_allclose(batch[k], rows.values(p[k], R[k]), atol=EXACT)


def test_coinciding_ends_have_zero_rows(robot):
    """Two cups in one place: no direction, no NaN."""
    state = robot.kinematics(robot.home())
    same = np.broadcast_to(state.positions[0], state.positions.shape)
    squeezed = type(state)(**{**vars(state), "positions": same})
    assert_array_equal(Closures(robot).gradients(squeezed), np.zeros((82, 12)))


def test_missing_links_are_missing_rows():
    spec = ToolSpec("small", rows=2, columns=2)
    sidecar = tool_sidecar(spec)
    sidecar["interlinks"]["pairs"].pop(1)
    robot = Robot(arm_description("ur10"), tool_urdf(spec), sidecar)
    assert (len(Closures(robot)), len(Chords(robot))) == (3, 8)
