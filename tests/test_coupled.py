import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from ply.coupled import CoupledModel, CoupledStatus
from ply.coupled_array import coupled_points
from ply.coupled_basis import AxisBasis
from ply.coupled_body import tangent
from ply.coupled_choice import coupled_alternatives
from ply.coupled_energy import strain_changes, strains, tangents
from ply.coupled_solve import TOLERANCE, newton
from ply.coupled_start import STRIP_CUPS, cup_rows, patch_start
from ply.errors import PlyError
from ply.grid import CupGrid, Region

LEFT = 1e-6  # [m] way to the shape that the last step of 2e-5 m leaves
SAME = 2e-6  # [m] two roads to one shape: each stops up to 1e-6 m before it
ROUNDED = 1e-9  # [m] one road, coordinates rotated: roundings, amplified by E_h / D
ARC = 1e-7  # [m] a quintic arc of 20 deg; and r_ss is no curvature by 1e-4 of itself
SLOPE = 1e-6  # [-] relative error of central differences of the energy
GRID = CupGrid(2, 2, pitch=0.11, half_width=0.02)
MODEL = CoupledModel(GRID)
CENTERS = np.array([[0, 0, 0], [0.11, 0, 0], [0, 0.11, 0], [0.11, 0.11, 0]])
UPRIGHT = np.broadcast_to(np.eye(3), (4, 3, 3))
LINES = np.linspace(-0.02, 0.13, 16)
ALL = LINES[:, None], LINES  # s and t of points all over the patch


def rotation(vector):
    """Rotation about a vector by its length, shapes (..., 3) to (..., 3, 3)."""
    vector = np.asarray(vector, dtype=float)
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = 0 * x
    k = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    k = k.reshape(*vector.shape, 3)
    return np.eye(3) + np.sinc(angle / np.pi) * k + versine(angle) * k @ k


def versine(angle):
    """(1 - cos angle) / angle^2, also at zero."""
    return np.sinc(angle / (2 * np.pi)) ** 2 / 2


def disturbed(seed, millimeters=0.5, angle=0.03, shape=()):
    """Cups on a slack ply, displaced and turned at random."""
    rng = np.random.default_rng(seed)
    shift = 1e-3 * millimeters * rng.normal(size=(*shape, 4, 3))
    turned = rotation(angle * rng.normal(size=(*shape, 4, 3)))
    return 0.99 * CENTERS + shift, turned


@pytest.mark.parametrize("derivative", [1, 2])
def test_functions_and_their_derivatives(derivative):
    basis = AxisBasis(0.02, 0.07, 5)
    x, h = np.linspace(-0.0193, 0.1287, 40), 1e-6
    before, after = (basis.evaluate(x + e, derivative - 1) for e in (-h, h))
    found = basis.evaluate(x, derivative)
    assert_allclose((after - before) / (2 * h), found, atol=1e-6 * abs(found).max())


def test_functions_and_slopes_are_continuous():
    basis = AxisBasis(0.02, 0.07, 5)
    for derivative in (0, 1):
        left, right = (
            basis.evaluate(basis.edges + e, derivative) for e in (-1e-12, 1e-12)
        )
        assert_allclose(left, right, atol=1e-8)


def test_cups_are_met_exactly():
    positions, rotations = disturbed(1)
    patch = MODEL.solve(positions, rotations)
    local = np.linspace(-0.02, 0.02, 5)
    for cup, (row, column) in enumerate([(0, 0), (0, 1), (1, 0), (1, 1)]):
        s, t = 0.11 * column + local[:, None], 0.11 * row + local
        found = MODEL.points(patch, s, t)
        x, y = rotations[cup, :, 0], rotations[cup, :, 1]
        plane = positions[cup] + local[:, None, None] * x + local[:, None] * y
        assert_allclose(found, plane, atol=1e-15)


@pytest.mark.parametrize("region", [Region.PATCH, Region.S_STRIP, Region.T_STRIP])
def test_forces_and_stiffness_against_differences_of_the_energy(region):
    check_differences(MODEL, region)


def check_differences(model, region):
    """The plain tangent: with the stresses of its own strains."""
    rng = np.random.default_rng(2)
    body = model.body(region)
    q = 1e-3 * rng.normal(size=(1, body.size, 3))
    cups = MODEL.solve(*disturbed(3)).cups[None]
    direction = 1e-3 * rng.normal(size=q.shape)
    now = tangent(body, q, cups)
    core, strips = body.split(direction)
    slope = (now.core_force * core).sum() + (now.strip_force * strips).sum()
    h = 1e-5
    before, after = (body.energy(q + k * h * direction, cups)[0] for k in (-1, 1))
    assert slope == pytest.approx((after - before) / (2 * h), rel=SLOPE)
    ends = [tangent(body, q + k * h * direction, cups) for k in (-1, 1)]
    parts = (("core", "core_force", core), ("strips", "strip_force", strips))
    for matrix, force, part in parts:
        flat = part.mT.reshape(*part.shape[:-2], 3 * part.shape[-2], 1)
        found = (getattr(now, matrix) @ flat)[..., 0]
        difference = (getattr(ends[1], force) - getattr(ends[0], force)) / (2 * h)
        expected = difference.mT.reshape(found.shape)
        assert_allclose(found, expected, atol=SLOPE * abs(found).max(initial=1))


def test_strain_changes_against_differences():
    rng = np.random.default_rng(15)
    piece = MODEL.body(Region.PATCH).core
    q, direction = 1e-3 * rng.normal(size=(2, piece.ds.shape[-1], 3))
    cups = MODEL.solve(*disturbed(3)).cups
    found = strain_changes(piece, *tangents(piece, q, cups), direction)
    h = 1e-4
    ends = [strains(*tangents(piece, q + k * h * direction, cups)) for k in (-1, 1)]
    assert_allclose(found, (ends[1] - ends[0]) / (2 * h), atol=SLOPE * abs(found).max())


@pytest.mark.parametrize(
    ("stiffness", "factor", "steps"),
    [("bending", 1, [(2, 0), (0, 2)]), ("torsion", 4, [(1, 1)])],
)
def test_bending_and_torsion_by_another_quadrature(stiffness, factor, steps):
    """Stiffness times half of the squared second derivatives, by the midpoint rule."""
    patch = MODEL.solve(*disturbed(16))
    q, cups = patch.coefficients[None], patch.cups[None]
    own = getattr(MODEL, stiffness)
    doubled = CoupledModel(GRID, **{stiffness: 2 * own})
    added = doubled.body(Region.PATCH).energy(q, cups) - MODEL.body(
        Region.PATCH
    ).energy(q, cups)
    x = -0.02 + 0.15 * (np.arange(300) + 0.5) / 300
    s, t = np.repeat(x, 300), np.tile(x, 300)
    total = 0.0
    for step in steps:
        free, frames = MODEL.basis.rows(MODEL.basis.functions, s, t, *step)
        total += ((free @ q[0] + frames @ cups[0]) ** 2).sum()
    expected = own / 2 * factor * total * (0.15 / 300) ** 2
    assert added[0] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("strip", range(4))
def test_start_has_the_length_of_its_fibers_on_the_side_asked(strip):
    positions, rotations = disturbed(17, 0.1, 0.01)
    own = STRIP_CUPS[strip]
    heights, bulges = [], []
    for side in (1, -1, 0):
        q, _ = patch_start(MODEL.basis, positions, rotations, np.full(4, side))
        rows = cup_rows(positions, rotations)
        nodes, weights = np.polynomial.legendre.leggauss(6)
        along = 0.055 + 0.035 * nodes
        normal = rotations[own, :, 2].sum(0)
        center = positions[own].mean(0)
        height = 0.0
        for across in (-0.02, 0.02):
            fixed = np.full(6, across + 0.11 * (strip % 2))
            st_, steps = (
                ((along, fixed), (1, 0)) if strip < 2 else ((fixed, along), (0, 1))
            )
            free, frames = MODEL.basis.rows(MODEL.basis.functions, *st_, *steps)
            speed = ((free @ q + frames @ rows) ** 2).sum(-1)
            assert weights @ speed / 2 == pytest.approx(1, abs=1e-12)
            free, frames = MODEL.basis.rows(MODEL.basis.functions, *st_)
            height += weights @ ((free @ q + frames @ rows - center) @ normal)
        heights.append(height)
        bulges.append(np.linalg.norm(q[20 * strip : 20 * strip + 20]))
    assert heights[1] < heights[0]
    assert bulges[2] == min(bulges)


def refined(patches, model=MODEL):
    """Unknowns after Newton's method has gone on for a few steps."""
    body, q = model.body(patches.region), patches.coefficients
    for _ in range(4):
        q = newton(body, q, patches.cups, body.strains(q, patches.cups)).q
    return q


def forces(q, cups):
    """Gradient of the energy of patches: outer edges, then the core."""
    now = tangent(MODEL.body(Region.PATCH), q, cups)
    core, half = now.core_force.copy(), now.strip_force.shape[2] // 2
    inner = now.strip_force[:, :, half:].reshape(len(q), -1, 3)
    core[:, : inner.shape[1]] += inner
    outer = now.strip_force[:, :, :half].reshape(len(q), -1, 3)
    return np.concatenate([outer, core], axis=1)


def test_forces_vanish_at_a_shape():
    patches = MODEL.solve(*disturbed(4, shape=(3,)), sides=(1, 1, 1, 1))
    assert_array_equal(patches.status, CoupledStatus.CONVERGED)
    q = refined(patches)
    still, pushed = (forces(q + push, patches.cups) for push in (0, TOLERANCE))
    assert abs(still).max() < 1e-6 * abs(pushed).max()


def test_last_step_leaves_a_micrometer():
    patches = MODEL.solve(*disturbed(5, shape=(6,)), sides=(1, 1, 1, 1))
    assert_array_equal(patches.status, CoupledStatus.CONVERGED)
    rows, _ = MODEL.rows(Region.PATCH, *ALL)
    left = rows @ (refined(patches) - patches.coefficients)
    assert abs(left).max() < LEFT


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 1000), side=st.sampled_from([-1, 1]))
def test_rigid_motion_moves_the_shape(seed, side):
    rng = np.random.default_rng(seed)
    positions, rotations = disturbed(seed)
    turn, shift = rotation(rng.normal(size=3)), rng.normal(size=3)
    sides = np.full(4, side)
    one = MODEL.solve(positions, rotations, sides)
    other = MODEL.solve(positions @ turn.T + shift, turn @ rotations, sides)
    assert one.status == other.status
    if one.status == CoupledStatus.CONVERGED:
        moved = MODEL.points(one, *ALL) @ turn.T + shift
        assert_allclose(MODEL.points(other, *ALL), moved, atol=10 * SAME)
        assert other.energy == pytest.approx(one.energy, rel=1e-5)


def test_exchange_of_s_and_t():
    positions, rotations = disturbed(6)
    order = [0, 2, 1, 3]
    swap = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    sides = np.array([1, -1, 1, 1])
    one = MODEL.solve(positions, rotations, sides)
    # exchanged directions turn the normal over, so the sides turn as well
    other = MODEL.solve(positions[order], rotations[order] @ swap, -sides[[2, 3, 0, 1]])
    assert one.status == other.status == CoupledStatus.CONVERGED
    mirrored = MODEL.points(other, *ALL).swapaxes(0, 1)
    assert_allclose(mirrored, MODEL.points(one, *ALL), atol=SAME)


def test_reversal_of_s():
    positions, rotations = disturbed(7)
    order = [1, 0, 3, 2]
    flip = np.diag([-1, 1, -1])
    sides = np.array([1, 1, -1, 1])
    one = MODEL.solve(positions, rotations, sides)
    other = MODEL.solve(positions[order], rotations[order] @ flip, -sides[[0, 1, 3, 2]])
    assert one.status == other.status == CoupledStatus.CONVERGED
    reversed_s = MODEL.points(other, 0.11 - ALL[0], ALL[1])
    assert_allclose(reversed_s, MODEL.points(one, *ALL), atol=SAME)


def test_flat_ply_stays_flat():
    patch = MODEL.solve(CENTERS, UPRIGHT)
    assert patch.status == CoupledStatus.CONVERGED
    expected = np.stack(np.broadcast_arrays(*ALL, 0.0), axis=-1)
    assert_allclose(MODEL.points(patch, *ALL), expected, atol=1e-12)
    assert abs(patch.energy) < 1e-15


def test_a_fiber_length_apart_from_the_span():
    """Cups 1 mm nearer along s than the pitch: flat with fibers of 69 mm."""
    grid = CupGrid(2, 2, pitch=0.11, half_width=0.02, s_length=0.069)
    model = CoupledModel(grid)
    positions = CENTERS - np.array([1e-3, 0, 0]) * (CENTERS[:, :1] > 0)
    patch = model.solve(positions, UPRIGHT)
    assert patch.status == CoupledStatus.CONVERGED
    assert abs(patch.energy) < 1e-15
    middle = model.points(patch, 0.055, 0.055)
    assert_allclose(middle, [0.0545, 0.055, 0], atol=1e-12)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("radius", [0.2, 0.5])
def test_clamped_strip_is_the_arc(sign, radius):
    """Tangents of one circle: curvature 1 / R, energy D / (2 R^2) an area."""
    d, span = 0.02, 0.07
    turn = rotation(np.array([0, sign * span / radius / 2, 0]))
    chord = 2 * radius * np.sin(span / (2 * radius))
    first = np.array([-chord / 2, 0, 0]) - d * turn.T[:, 0]
    second = np.array([chord / 2, 0, 0]) + d * turn[:, 0]
    strip = MODEL.solve_strips([first, second], [turn.T, turn])
    assert strip.status == CoupledStatus.CONVERGED
    s, t = d + span * np.linspace(0, 1, 21)[:, None], np.linspace(-d, d, 5)
    points = MODEL.points(strip, s, t)
    center = np.array([0, -sign * radius * np.cos(span / (2 * radius))])
    assert_allclose(points[..., 1], np.broadcast_to(t, (21, 5)), atol=1e-9)
    distance = np.linalg.norm(points[..., [0, 2]] - center, axis=-1)
    assert_allclose(distance, radius, atol=ARC)
    energy = 5e-3 / (2 * radius**2) * span * 2 * d
    assert strip.energy == pytest.approx(energy, rel=1e-4)


def test_order_converges():
    """One lifted cup: errors against p = 9 fall, and p = 5 is within 0.1 mm."""
    positions, rotations = CENTERS + 0.0, UPRIGHT
    positions[3] = 0.10629, 0.10629, 0.02
    shapes = {}
    for order in (3, 5, 9):
        model = CoupledModel(GRID, order=order)
        patch = model.solve(positions, rotations)
        assert patch.status == CoupledStatus.CONVERGED
        shapes[order] = model.points(patch, *ALL)
    errors = [np.sqrt(((shapes[p] - shapes[9]) ** 2).sum(-1).mean()) for p in (3, 5)]
    assert errors[1] < 1e-4
    assert errors[1] < errors[0] / 2


def test_warm_start_follows_a_shape():
    """A path with small steps: a few iterations each, and the shape of a cold start."""
    patch, steps = None, []
    for lift in np.linspace(0, 0.006, 13):
        positions = CENTERS * [1, 1, 0]
        positions[3] += [-(lift**2) / 0.14, -(lift**2) / 0.14, lift]
        before, patch = patch, MODEL.solve(positions, UPRIGHT, start=patch)
        assert patch.status == CoupledStatus.CONVERGED
        if before is not None:
            moved = MODEL.points(patch, *ALL) - MODEL.points(before, *ALL)
            steps.append(abs(moved).max())
            assert patch.iterations <= 6
    assert max(steps) < 3e-3
    cold = MODEL.solve(positions, UPRIGHT)
    assert_allclose(MODEL.points(patch, *ALL), MODEL.points(cold, *ALL), atol=SAME)


@pytest.mark.parametrize("cups", [[0, 1], [0, 1, 2, 3]])
def test_warm_start_goes_along_with_a_rigid_motion(cups):
    """Far more than Newton's method would go, and the side is kept."""
    positions, rotations = (array[cups] for array in disturbed(8))
    solve = MODEL.solve if len(cups) == 4 else MODEL.solve_strips
    down = solve(positions, rotations, np.full(4, -1) if len(cups) == 4 else -1)
    turn, shift = rotation(np.array([1.0, -2.0, 0.5])), np.array([0.2, 0, 0.5])
    again = solve(positions @ turn.T + shift, turn @ rotations, start=down)
    assert again.status == CoupledStatus.CONVERGED
    assert again.iterations == 2
    held = LINES[:, None], LINES if len(cups) == 4 else LINES[:5]
    expected = MODEL.points(down, *held) @ turn.T + shift
    assert_allclose(MODEL.points(again, *held), expected, atol=SAME)


def test_batch_equals_single():
    positions, rotations = disturbed(9, shape=(3, 4))
    sides = np.ones((3, 4, 4))
    together = MODEL.solve(positions, rotations, sides)
    assert together.coefficients.shape == (3, 4, 105, 3)
    for index in ((0, 0), (1, 3), (2, 2)):
        alone = MODEL.solve(positions[index], rotations[index], sides[index])
        assert alone.iterations == together[index].iterations
        difference = alone.coefficients - together[index].coefficients
        assert_allclose(difference, 0, atol=ROUNDED)


def test_sides_of_slack_strips():
    shapes = MODEL.solve(0.99 * CENTERS, UPRIGHT, [[1, 1, 1, 1], [-1, -1, -1, -1]])
    assert_array_equal(shapes.status, CoupledStatus.CONVERGED)
    heights = MODEL.points(shapes, 0.055, 0.0)[:, 2]
    assert heights[0] > 3e-3
    assert heights[1] == pytest.approx(-heights[0], rel=1e-3)
    default = MODEL.solve(0.99 * CENTERS, UPRIGHT)
    assert MODEL.points(default, 0.055, 0.0)[2] == pytest.approx(heights[0], rel=1e-3)


def test_alternatives_are_stable_distinct_and_ordered():
    positions, rotations = disturbed(10, shape=(2,))
    found = coupled_alternatives(MODEL, positions, rotations)
    assert found.energy.shape == (2, 4)
    assert_array_equal(found.status, CoupledStatus.CONVERGED)
    assert (np.diff(found.energy, axis=-1) >= 0).all()
    points = MODEL.points(found, *ALL)
    away = points[:, :, None] - points[:, None]
    distance = np.sqrt((away**2).sum(-1).mean((-1, -2)))
    assert (distance[:, ~np.eye(4, dtype=bool)] > 1e-4).all()
    thorough = coupled_alternatives(MODEL, positions, rotations, thorough=True)
    assert_allclose(found.energy[:, 0], thorough.energy[:, 0], rtol=1e-4)


def test_no_slack_leaves_no_alternative():
    positions = CENTERS.copy()
    positions[1::2, 2] = 0.01
    positions[1::2, 0] = 0.04 + np.sqrt(0.07**2 - 0.0101**2)
    found = coupled_alternatives(MODEL, positions, UPRIGHT, count=3)
    expected = [CoupledStatus.CONVERGED, CoupledStatus.ABSENT, CoupledStatus.ABSENT]
    assert_array_equal(found.status, expected)
    assert_array_equal(found.coefficients[1], found.coefficients[0])


def test_bad_poses_in_a_batch_spoil_no_other():
    positions, rotations = disturbed(11, shape=(6,))
    good = MODEL.solve(positions[0], rotations[0])
    rotations[1, 2] *= 1.1
    positions[2, 0, 0] = np.nan
    rotations[3, 1] = np.diag([1, 1, -1])
    positions[4, 3] = 1e30
    rotations[5] = np.inf
    found = MODEL.solve(positions, rotations)
    assert_array_equal(found.status[1:], CoupledStatus.BAD_INPUT)
    assert found.status[0] == good.status
    assert found.energy[0] == pytest.approx(good.energy, rel=1e-9)
    assert np.isfinite(found.coefficients).all()
    assert np.isfinite(found.energy).all()
    others = coupled_alternatives(MODEL, positions[:3], rotations[:3], count=2)
    assert_array_equal(others.status[1:, 0], CoupledStatus.BAD_INPUT)
    assert_array_equal(others.status[1:, 1], CoupledStatus.ABSENT)
    assert np.isfinite(others.energy).all()


def test_hard_poses_have_a_status_and_no_nan():
    """Coincident, inverted and overstretched cups, and any turn of each."""
    rng = np.random.default_rng(12)
    positions, rotations = disturbed(12, 2.0, 0.1, shape=(6,))
    positions[0] = 0
    rotations[1, 3] = rotations[1, 3] @ np.diag([1, -1, -1])
    positions[2] *= 1.5
    rotations[3] = rotation(2 * rng.normal(size=(4, 3)))
    rotations[4, :2] = rotations[4, :2] @ np.diag([-1, 1, -1])
    positions[5, 3, 2] += 0.3
    found = MODEL.solve(positions, rotations)
    assert set(found.status) <= {
        CoupledStatus.CONVERGED,
        CoupledStatus.UNSTABLE,
        CoupledStatus.NOT_CONVERGED,
    }
    assert np.isfinite(found.coefficients).all()
    assert np.isfinite(found.energy).all()
    assert found.strain[2] > 0.1


@pytest.mark.parametrize("share", [0.99, 0.995, 0.9999])
def test_compression_without_a_bulge_is_called_unstable(share):
    """Cups nearer by much more than the 6e-5 of the length at which a strip buckles."""
    pair = [0, 1]
    flat = MODEL.solve(CENTERS, UPRIGHT)
    pressed = MODEL.solve(share * CENTERS, UPRIGHT, start=flat)
    assert pressed.status == CoupledStatus.UNSTABLE
    flat = MODEL.solve_strips(CENTERS[pair], UPRIGHT[pair])
    pressed = MODEL.solve_strips(share * CENTERS[pair], UPRIGHT[pair], start=flat)
    assert pressed.status == CoupledStatus.UNSTABLE


def test_strip_alone_is_the_strip_turned():
    positions, rotations = disturbed(13)
    pair, turn = [0, 1], rotation(np.array([0, 0, np.pi / 2]))
    along_s = MODEL.solve_strips(positions[pair], rotations[pair], 1)
    p, frames = positions[pair] @ turn.T, turn @ rotations[pair] @ turn.T
    along_t = MODEL.solve_strips(p, frames, 1, along=Region.T_STRIP)
    assert along_s.status == along_t.status == CoupledStatus.CONVERGED
    across = np.linspace(-0.02, 0.02, 5)
    one = MODEL.points(along_s, LINES[:, None], across)
    other = MODEL.points(along_t, -across, LINES[:, None])
    assert_allclose(other, one @ turn.T, atol=SAME)


def test_array_joins_its_patches():
    grid = CupGrid(3, 4, pitch=0.11, half_width=0.02)
    rng = np.random.default_rng(14)
    positions = np.concatenate([grid.centers, np.zeros((12, 1))], axis=-1) * 0.995
    positions += 2e-4 * rng.normal(size=(12, 3))
    rotations = rotation(0.03 * rng.normal(size=(12, 3)))
    s, t = np.linspace(-0.02, 0.35, 75), np.linspace(-0.02, 0.24, 53)
    points, patches = coupled_points(grid, positions, rotations, s[:, None], t)
    assert points.shape == (75, 53, 3)
    assert patches.energy.shape == (2, 3)
    assert (patches.status == CoupledStatus.CONVERGED).all()
    alone = MODEL.solve(positions[[5, 6, 9, 10]], rotations[[5, 6, 9, 10]])
    k, m = (np.flatnonzero((x > 0.14) & (x < 0.19)) for x in (s, t))
    inside = MODEL.points(alone, s[k, None] - 0.11, t[m] - 0.11)
    assert_allclose(points[np.ix_(k, m)], inside, atol=SAME)
    # no steps, no kinks: neighbors stay 5 mm apart but for what two patches disagree in
    along = np.diff(points, axis=0)
    assert_allclose(np.linalg.norm(along, axis=-1), 0.005, rtol=0.06)
    assert np.linalg.norm(np.diff(along, axis=0), axis=-1).max() < 1.5e-3


@pytest.mark.parametrize(("rows", "columns"), [(1, 3), (3, 1)])
def test_array_of_one_row_is_strips(rows, columns):
    grid = CupGrid(rows, columns, pitch=0.11, half_width=0.02)
    positions = np.concatenate([grid.centers, np.zeros((3, 1))], axis=-1) * 0.99
    s, t = (0.22, 0.0) if rows == 1 else (0.0, 0.22)
    points, strips = coupled_points(grid, positions, UPRIGHT[:3], s, t)
    assert strips.energy.shape == (2,)
    assert_allclose(points, positions[-1], atol=1e-12)
    half = [0.055, 0.165]
    points, _ = coupled_points(
        grid, positions, UPRIGHT[:3], *((half, 0.0) if rows == 1 else (0.0, half))
    )
    assert (points[:, 2] > 3e-3).all()


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda: CoupledModel(GRID, order=1), "order"),
        (lambda: CoupledModel(GRID, bending=0.0), "bending"),
        (lambda: CoupledModel(GRID, stretch=np.nan), "stretch"),
        (lambda: MODEL.solve(CENTERS[:3], UPRIGHT), "positions"),
        (lambda: MODEL.solve(CENTERS, UPRIGHT[:3]), "rotations"),
        (lambda: MODEL.solve(CENTERS, UPRIGHT, [1, 1]), "sides"),
        (lambda: MODEL.solve([CENTERS] * 2, [UPRIGHT] * 3), "batch axes"),
        (lambda: coupled_points(GRID, CENTERS[:3], UPRIGHT, 0, 0), "positions"),
        (
            lambda: coupled_points(
                CupGrid(1, 1, 0.11, 0.02), [3 * [0]], [np.eye(3)], 0, 0
            ),
            "grid",
        ),
    ],
)
def test_errors_name_the_argument(call, argument):
    with pytest.raises(PlyError) as error:
        call()
    assert error.value.argument == argument
