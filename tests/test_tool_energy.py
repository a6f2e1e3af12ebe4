import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

from drapeplan.closures import Chords, Closures
from drapeplan.legs import cup_poses
from drapeplan.tool_energy import ToolEnergy, ToolPhysics
from tests.tool_samples import PLY, random_legs, rich_tool, small_tool

EXACT = 1e-12  # [m, J, N m] a few thousand roundings of terms of order one
STEP = 1e-6  # [rad, m] of central differences
SLOPE = 1e-8  # [N m, N] of them: energies of 10 J, rounded, over the step
SMALL = 1e-4  # [rad, m] angles at which cubics are exact but for their squares
CURVE = 1e-7  # [N m/rad] of them: gradients of 100 N, rounded, over the step


@pytest.fixture(scope="module")
def robot():
    return rich_tool()


@pytest.fixture(scope="module")
def case(robot):
    """A tool's energy, placement, legs and forces in its rows."""
    rng = np.random.default_rng(0)
    energy = ToolEnergy(robot, PLY)
    q_arm = robot.home()[robot.arm_columns] + 0.1 * rng.normal(size=6)
    forces = rng.normal(size=len(energy.row_pairs))
    return energy, robot.arm_forward(q_arm), random_legs(robot, rng), forces


def differences(function, legs):
    """Central differences by all coordinates, one more axis of shape (n * 6,)."""
    columns = []
    for place in np.ndindex(legs.shape):
        step = np.zeros_like(legs)
        step[place] = STEP
        columns.append((function(legs + step) - function(legs - step)) / (2 * STEP))
    return np.stack(columns, axis=-1)


def spread(terms, energy):
    """Whole Hessian and whole row Jacobian of the terms."""
    n = len(terms.own)
    H, J = np.zeros((n, 6, n, 6)), np.zeros((len(terms.rows), n, 6))
    H[range(n), :, range(n)] = terms.own
    for (i, j), block in zip(energy.pairs, terms.mixed, strict=True):
        H[i, :, j], H[j, :, i] = block, block.T
    for k, (i, j) in enumerate(energy.row_pairs):
        J[k, i], J[k, j] = terms.rows[k]
    return H.reshape(6 * n, 6 * n), J.reshape(len(J), -1)


def test_rows_are_interlinks_then_chords(robot, case):
    energy, T, legs, forces = case
    poses = cup_poses(robot.geometry, T, legs)
    lengths = energy.evaluate(T, legs, forces).lengths
    links = Closures(robot).values(*poses) + robot.tool.interlinks.length
    assert_allclose(lengths[: energy.n_links], links, atol=EXACT)
    assert_allclose(lengths[energy.n_links :], Chords(robot).values(*poses), atol=EXACT)


def test_gradient_agrees_with_finite_differences(case):
    energy, T, legs, forces = case

    def lagrangian(legs):
        terms = energy.evaluate(T, legs, forces)
        return terms.energy + forces @ terms.lengths

    slope = differences(lagrangian, legs).reshape(legs.shape)
    assert_allclose(energy.evaluate(T, legs, forces).gradient, slope, atol=SLOPE)


def test_hessian_agrees_with_finite_differences(case):
    energy, T, legs, forces = case
    H, J = spread(energy.evaluate(T, legs, forces), energy)

    def gradient(legs):
        return energy.evaluate(T, legs, forces).gradient.ravel()

    def lengths(legs):
        return energy.evaluate(T, legs, forces).lengths

    assert_allclose(H, differences(gradient, legs), atol=CURVE)
    assert_allclose(J, differences(lengths, legs), atol=SLOPE)


def test_weight_agrees_with_pinocchio(robot):
    """Legs without links and without ply: gravity alone, by the rigid-body library."""
    bare = small_tool(interlink_mass=0.0)
    energy = ToolEnergy(bare, ToolPhysics(0.0, 0.0, 1.0, 0.0))
    rng = np.random.default_rng(1)
    q = bare.configuration(bare.home()[:6] + 0.1, random_legs(bare, rng))
    data = bare.model.createData()
    slope = pin.computeGeneralizedGravity(bare.model, data, q)
    curve = pin.computeGeneralizedGravityDerivatives(bare.model, data, q)
    T, legs = bare.arm_forward(q[bare.arm_columns]), q[bare.leg_columns]
    terms = energy.evaluate(T, legs, np.zeros(len(energy.row_pairs)))
    assert_allclose(terms.gradient, slope[bare.leg_columns], atol=EXACT)
    own = curve[bare.leg_columns[:, :, None], bare.leg_columns[:, None, :]]
    assert_allclose(terms.own, own, atol=EXACT)
    assert not terms.mixed.any()


def test_interlinks_and_ply_hang_on_the_cups():
    """Their weight is that of masses at the ends and in the faces."""
    light = small_tool(interlink_mass=0.0)
    loaded = small_tool(interlink_mass=0.05, interlink_height=0.007)
    legs = random_legs(light, np.random.default_rng(2))
    T = light.arm_forward(light.home()[:6])
    energies = []
    for robot, mass in ((light, 0.0), (loaded, 0.4)):
        energy = ToolEnergy(robot, ToolPhysics(0.0, mass, 1.0, 0.0))
        energies.append(
            energy.evaluate(T, legs, np.zeros(len(energy.row_pairs))).energy
        )
    p, R = cup_poses(light.geometry, T, legs)
    z = (p + 0.007 * R[:, :, 2])[loaded.tool.interlinks.pairs, 2]
    added = 9.81 * (0.05 * z.mean(axis=1).sum() + 0.4 * 0.11**2 * p[:, 2].sum())
    assert energies[1] - energies[0] == pytest.approx(added, abs=EXACT)


def cubic_energy(p, R, pairs, d, L, bending):
    """Energy of cubics between tangents of near edges, heights alone, [J].

    Of y = a2 x^2 + a3 x^3, D w / 2 times the integral of y'' squared.
    """
    total = 0.0
    for i, j in pairs:
        along = 0 if j == i + 1 else 1
        for side in (-d, d):
            ends = [
                p[k] + R[k, :, along] * way * d + R[k, :, 1 - along] * side
                for k, way in ((i, 1), (j, -1))
            ]
            m0, m1 = R[i, 2, along], R[j, 2, along]
            rise = ends[1][2] - ends[0][2]
            a2 = (3 * rise / L - 2 * m0 - m1) / L
            a3 = (m0 + m1 - 2 * rise / L) / L**2
            integral = 4 * a2**2 * L + 12 * a2 * a3 * L**2 + 12 * a3**2 * L**3
            total += bending * d * integral / 2
    return total


def test_bending_is_that_of_cubics_between_the_near_edges():
    """Normals on our side, tangents and heights on the oracle's; small angles."""
    robot, rng = small_tool(), np.random.default_rng(3)
    legs = robot.home()[robot.leg_columns]
    legs += SMALL * rng.normal(size=legs.shape) * [1, 1, 0.1, 1, 1, 1]
    T = np.eye(4)
    T[:3, :3] = np.diag([1.0, -1.0, -1.0])
    p, R = cup_poses(robot.geometry, T, legs)
    none = np.zeros(17 + 34)
    with_ply, without = (
        ToolEnergy(robot, ToolPhysics(D, 0.0, 1.0, 0.0)).evaluate(T, legs, none).energy
        for D in (2e4, 0.0)
    )
    pairs = ToolEnergy(robot, PLY).pairs
    expected = cubic_energy(p, R, pairs, robot.half_width, 0.07, 2e4)
    assert with_ply - without == pytest.approx(expected, rel=20 * SMALL)


def test_clamped_links_bend_as_beams_between_cup_centers():
    """As wide as a held square: E I = 2 d B, over the length of the link."""
    angle = 1e-3
    energies = []
    for kind, stiffness in (("rigid", 0.0), ("resilient", 0.1)):
        robot = small_tool(interlink_kind=kind, interlink_bending_stiffness=stiffness)
        legs = robot.home()[robot.leg_columns]
        legs[0, 3:5] = angle  # turns about its ball, 5 mm above the face
        energy = ToolEnergy(robot, ToolPhysics(0.0, 0.0, 1.0, 0.0))
        T = np.eye(4)
        energies.append(energy.evaluate(T, legs, np.zeros(17 + 34)).energy)
    one = 2 * 0.1 * 0.04 / 0.11 * angle**2  # at one end of a link, two links
    assert energies[1] - energies[0] == pytest.approx(2 * one, rel=1e-3)


def test_yaw_stiffness_turns_a_strip_in_its_plane():
    """A cup turned by an angle: its rims move by d times it, its laterals by it."""
    robot, angle, d, L = small_tool(), 1e-3, 0.02, 0.07
    legs = robot.home()[robot.leg_columns]
    legs[0, 5] = angle
    flat, stiff = (
        ToolEnergy(robot, ToolPhysics(0.0, 0.0, 1.0, k))
        .evaluate(np.eye(4), legs, np.zeros(17 + 34))
        .energy
        for k in (0.0, 0.1)
    )
    slopes = np.array([(L + d) / L, d / L]) * angle  # at the turned cup, at the other
    assert stiff - flat == pytest.approx(2 * 0.1 / 2 * np.sum(slopes**2), rel=1e-2)
