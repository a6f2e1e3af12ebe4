from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from drapeplan.closures import Chords, Closures
from drapeplan.equilibrium import Equilibrium, SettledStatus
from drapeplan.frames import rotation_vectors
from tests.cartesian import CartesianTool
from tests.tool_samples import PLY, rich_tool, shaped, small_tool

REST = 1e-9  # [N m] moment left at rest
CLOSED = 1e-9  # [m] error of a length: 1e-6 mm
SAME = 1e-8  # [m, rad] two formulations: rests of 1e-9 N m over 0.03 N m/rad and 0.3 m
FORCE = 1e-5  # [N] forces of both: stiffnesses of 1e3 N/m times the above
STEP = 1e-5  # [m] central differences of settled poses
SLOPE = 1e-6  # [-, rad/m] of them: their third derivatives times the squared step
SHAPES = {"flat": (1e9, 1e9), "convex": (1.0, 2.0), "saddle": (-1.0, 1.5)}
TAUT = {"convex": 0.0701, "saddle": 0.07015}  # [m] some fibers are, not all


@pytest.fixture(scope="module")
def robot():
    return small_tool()


@pytest.fixture(scope="module")
def tool(robot):
    return Equilibrium(robot, PLY)


@pytest.fixture(scope="module")
def fixed():
    """One cup stands on the mold."""
    return np.arange(12) == 4


def twisted(robot, fixed_cup=4):
    """A saddle's strokes, and some noise: no symmetry left."""
    q = shaped(robot, -1.0, 1.5, fixed_cup)
    noise = np.random.default_rng(5).uniform(-4e-3, 4e-3, robot.n_cups)
    q[robot.leg_columns[:, 2]] += np.where(np.arange(12) == fixed_cup, 0, noise)
    return q


def poses(robot, q):
    state = robot.kinematics(q)
    return state.positions, state.rotations


@pytest.mark.parametrize(
    ("kind", "shape"),
    [(kind, "saddle") for kind in ("rigid", "resilient", "taut")]
    + [("rigid", "flat"), ("rigid", "convex"), ("taut", "convex")],
)
def test_free_poses_of_all_cups_come_to_the_same_rest(kind, shape, fixed):
    robot, ply = small_tool(), PLY
    if kind == "resilient":
        robot = small_tool(
            interlink_kind=kind,
            interlink_bending_stiffness=0.1,
            interlink_height=0.004,
            ball_height=0.010,
        )
    if kind == "taut":
        ply = replace(PLY, longest_fiber=TAUT[shape])
    q = shaped(robot, *SHAPES[shape], 4)
    settled = Equilibrium(robot, ply).settle(q, fixed)
    assert settled.status == SettledStatus.SETTLED
    taut = np.flatnonzero(settled.chord_forces)
    assert (taut.size > 0) == (kind == "taut")
    p, R = poses(robot, settled.q)
    other = CartesianTool(robot, ply, settled.q, taut)
    rng = np.random.default_rng(6)
    start = other.poses(np.where(fixed, 0, rng.normal(size=(6, 12)) * 2e-4).T, (p, R))
    q_p, q_R, forces = other.rest(*start, fixed)
    assert_allclose(q_p, p, atol=SAME)
    assert_allclose(rotation_vectors(R, q_R), np.zeros((12, 3)), atol=SAME)
    assert_allclose(forces[12:29], settled.multipliers, atol=FORCE)
    assert_allclose(forces[29:], settled.chord_forces[taut], atol=FORCE)


def test_links_and_fibers_hold(tool, robot, fixed):
    settled = tool.settle(twisted(robot), fixed)
    p, R = poses(robot, settled.q)
    closure = np.abs(Closures(robot).values(p, R)).max()
    chords = Chords(robot).values(p, R)
    assert closure < CLOSED
    assert settled.closure == pytest.approx(closure, abs=1e-13)
    assert settled.residual < REST
    assert chords.max() <= PLY.longest_fiber + CLOSED
    assert settled.chord_forces.min() >= 0


def test_what_is_given_stays(tool, robot, fixed):
    q = twisted(robot)
    settled = tool.settle(q, fixed)
    given = [*robot.arm_columns, *robot.leg_columns[:, 2], *robot.leg_columns[4]]
    assert_array_equal(settled.q[given], q[given])
    assert np.abs(settled.q - q).max() > 1e-2


@pytest.mark.parametrize("longest", [0.0708, 0.0702])
def test_it_is_a_minimum(robot, fixed, longest):
    """Every small motion that links and fibers allow raises the energy."""
    tool = Equilibrium(robot, replace(PLY, longest_fiber=longest))
    settled = tool.settle(twisted(robot), fixed)
    links, chords = Closures(robot), Chords(robot)
    T, columns = robot.arm_forward(settled.q[:6]), robot.leg_columns
    passive = np.delete(columns[~fixed], 2, axis=1).ravel()
    none = np.zeros(len(tool.energy.row_pairs))
    rng, allowed = np.random.default_rng(7), 0
    least = tool.energy.evaluate(T, settled.q[columns], none).energy
    for _ in range(20):
        q = settled.q.copy()
        q[passive] += 3e-4 * rng.normal(size=passive.size)
        for _ in range(8):  # back to the links and, where passed, the fibers
            state = robot.kinematics(q)
            p, R = state.positions, state.rotations
            gap, over = links.values(p, R), chords.values(p, R) - longest
            passed = over > -CLOSED
            rows = links.jacobian(state).toarray(), chords.jacobian(state).toarray()
            J = np.vstack([rows[0], rows[1][passed]])[:, passive]
            gap = np.concatenate([gap, over[passed] + CLOSED / 2])
            q[passive] -= np.linalg.lstsq(J, gap, rcond=None)[0]
        rise = tool.energy.evaluate(T, q[columns], none).energy - least
        if max(np.abs(gap[: len(links)]).max(), over.max()) < CLOSED:
            assert rise > 0
            allowed += 1
    assert allowed > 10


@pytest.mark.parametrize("longest", [0.0708, 0.0702])
def test_sensitivities_agree_with_finite_differences(robot, fixed, longest):
    tool = Equilibrium(robot, replace(PLY, longest_fiber=longest))
    fixed = fixed | (np.arange(12) == 5)
    settled = tool.settle(twisted(robot), fixed)
    assert (settled.chord_forces.max() > 0) == (longest == 0.0702)
    found = tool.sensitivities(settled, fixed)
    assert_array_equal(found.free, np.flatnonzero(~fixed))
    assert found.position.shape == found.rotation.shape == (12, 3, 10)
    for k, cup in enumerate(found.free):
        ends = []
        for step in (STEP, -STEP):
            q = settled.q.copy()
            q[robot.leg_columns[cup, 2]] += step
            ends.append(tool.settle(q, fixed, settled, stability=False).q)
        (p1, R1), (p0, R0) = (poses(robot, end) for end in ends)
        scale = 1 / (2 * STEP)
        assert_allclose(found.q[:, k], scale * (ends[0] - ends[1]), atol=1e2 * SLOPE)
        assert_allclose(found.position[..., k], scale * (p1 - p0), atol=SLOPE)
        turn = scale * rotation_vectors(R0, R1)
        assert_allclose(found.rotation[..., k], turn, atol=1e2 * SLOPE)


def test_symmetric_strokes_give_symmetric_cups(tool, robot):
    """No leg placed; both middle planes of the tool are mirrors."""
    q = shaped(robot, 0.8, 1.5, 4)
    settled = tool.settle(q, np.zeros(12, bool))
    p, R = poses(robot, settled.q)
    T = robot.arm_forward(q[:6])
    local = ((p - T[:3, 3]) @ T[:3, :3]).reshape(4, 3, 3)
    normals = (R[:, :, 2] @ T[:3, :3]).reshape(4, 3, 3)
    for seen in (local, normals):
        assert_allclose(seen[:, ::-1] * [-1, 1, 1], seen, atol=SAME)
        assert_allclose(seen[::-1] * [1, -1, 1], seen, atol=SAME)


def test_turning_about_the_vertical_changes_nothing(tool, robot, fixed):
    q = twisted(robot)
    settled = tool.settle(q, fixed)
    turned = q.copy()
    turned[robot.arm_columns[0]] += 0.7
    other = tool.settle(turned, fixed)
    legs = robot.leg_columns
    assert_allclose(other.q[legs], settled.q[legs], atol=SAME)


def test_a_tilted_tool_settles_elsewhere(tool, robot, fixed):
    q = twisted(robot)
    tilted = q.copy()
    tilted[robot.arm_columns[4]] += 0.1
    legs = robot.leg_columns
    moved = tool.settle(tilted, fixed).q[legs] - tool.settle(q, fixed).q[legs]
    assert np.abs(moved).max() > 0.01


def test_warm_start_takes_few_steps_and_leads_to_the_same(tool, robot, fixed):
    q = twisted(robot)
    first = tool.settle(q, fixed)
    moved = first.q.copy()
    moved[robot.leg_columns[:, 2]] += np.where(fixed, 0, 2e-3)
    warm = tool.settle(moved, fixed, first)
    cold = tool.settle(moved, fixed)
    assert 0 < warm.iterations <= 4
    assert tool.settle(warm.q, fixed, warm).iterations == 0
    assert_allclose(warm.q, cold.q, atol=SAME)


def test_a_big_move_is_made_in_parts(tool, robot, fixed):
    """From flat to 0.4 m and back, where one Newton run would not do."""
    flat = tool.settle(robot.home(), fixed)
    tool = Equilibrium(robot, replace(PLY, longest_fiber=0.075))
    far = tool.settle(shaped(robot, 0.25, 0.3, 4), fixed, flat)
    assert far.status == SettledStatus.SETTLED
    back = tool.settle(robot.home(), fixed, far)
    assert_allclose(back.q, flat.q, atol=1e-7)


def test_impossible_strokes_fail_and_say_by_how_much(tool, robot, fixed):
    q = robot.home()
    q[robot.leg_columns[0, 2]] += 0.12  # more than a link is long
    settled = tool.settle(q, fixed, tool.settle(robot.home(), fixed))
    assert settled.status == SettledStatus.FAILED
    assert settled.least_eigenvalue is None
    assert settled.closure > 1e-5 or settled.residual > 1e-3
    strokes = robot.leg_columns[:, 2]
    assert_array_equal(settled.q[strokes], q[strokes])


def test_all_legs_fixed_leave_nothing_to_settle(tool, robot):
    everything = np.ones(12, bool)
    settled = tool.settle(robot.home(), everything)
    assert settled.status == SettledStatus.SETTLED
    assert (settled.iterations, settled.least_eigenvalue) == (0, None)
    found = tool.sensitivities(settled, everything)
    assert found.position.shape == (12, 3, 0)


def top_heavy():
    """Cups with their mass 20 mm above the balls: level, they stand on their heads."""
    return small_tool(cup_center_of_mass=0.02)


def test_a_saddle_is_left(fixed):
    robot = top_heavy()
    tool = Equilibrium(robot, replace(PLY, bending=1e-3, longest_fiber=0.08))
    level = tool.settle(robot.home(), fixed, stability=False)
    assert level.status == SettledStatus.SETTLED  # nobody asked
    assert level.least_eigenvalue is None
    settled = tool.settle(robot.home(), fixed)
    assert settled.status == SettledStatus.SETTLED
    assert settled.least_eigenvalue > 0
    assert np.abs(settled.q - level.q).max() > 0.05


def test_a_saddle_that_cannot_be_left_is_reported(fixed, monkeypatch):
    robot = top_heavy()
    tool = Equilibrium(robot, replace(PLY, bending=1e-3, longest_fiber=0.08))

    def stay(T, rest, start, free, stability):
        return rest, tool._least(rest, free), 0

    monkeypatch.setattr(tool, "_leave", stay)
    settled = tool.settle(robot.home(), fixed)
    assert settled.status == SettledStatus.SADDLE
    assert settled.least_eigenvalue < 0
    assert settled.residual < REST


def test_links_with_a_range_pull_only_at_its_ends(fixed):
    rigid, loose = small_tool(), small_tool(interlink_length_range=2e-4)
    q = twisted(rigid)
    settled = Equilibrium(loose, PLY).settle(q, fixed)
    assert settled.status == SettledStatus.SETTLED
    p, R = poses(loose, settled.q)
    error, force = Closures(loose).values(p, R), settled.multipliers
    assert np.abs(error).max() <= 2e-4 + CLOSED
    assert 0 < np.count_nonzero(force) < len(force)
    assert_allclose(error[force > 0], 2e-4, atol=CLOSED)
    assert_allclose(error[force < 0], -2e-4, atol=CLOSED)
    assert (np.abs(error[force == 0]) < 2e-4).all()
    stiff = Equilibrium(rigid, PLY).settle(q, fixed)
    assert np.abs(settled.q - stiff.q).max() > 1e-4


def test_springs_pull_the_legs_upright(fixed):
    q = twisted(small_tool())
    leans = []
    for spring in (0.0, 5.0):
        robot = small_tool(ball_stiffness=spring)
        settled = Equilibrium(robot, PLY).settle(q, fixed)
        leans.append(np.abs(settled.q[robot.leg_columns[:, 3:5]]).max())
    assert leans[1] < 0.5 * leans[0]


def test_rich_tool_settles(fixed):
    robot = rich_tool()
    settled = Equilibrium(robot, PLY).settle(twisted(robot), fixed)
    assert settled.status == SettledStatus.SETTLED
    assert settled.residual < REST


def test_same_input_gives_the_same_bytes(tool, robot, fixed):
    q = twisted(robot)
    first, second = (Equilibrium(robot, PLY).settle(q, fixed) for _ in range(2))
    assert first.q.tobytes() == second.q.tobytes()
    assert first.least_eigenvalue == second.least_eigenvalue


def test_results_are_read_only(tool, robot, fixed):
    settled = tool.settle(robot.home(), fixed)
    for array in (settled.q, settled.multipliers, settled.chord_forces):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
