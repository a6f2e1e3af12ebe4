import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from ply.fiber import FiberStatus, cubic_fibers, length_error, powers, quartic_fibers
from ply.modal import modal_fibers
from ply.modes import bending_modes

L = 0.07  # [m] free length between neighboring cups [Nielsen2018, Section 2]
X, Y, Z = np.eye(3)
CLOSED_FORM = 1e-12  # [-] of L: the paper's closed form, c < 190
SPEED = (
    1e-11  # [-] mean squared speed: rounding, and fibers with STRAIGHT ends left out
)
STRAIGHT = 1.01e-9  # [-] the same where the cubic is left as it is
INVARIANT = 1e-12  # [m] rigid motions and reversal
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)  # exact for degree 15
SEEDS = st.integers(0, 10**6)


def random_ends(seed, count=200, tilt=0.3, play=0.03, origin=1.0):
    """Ends and tangents of fibers between disturbed cups, and mean normals."""
    rng = np.random.default_rng(seed)
    r0 = origin * rng.normal(size=(count, 3))
    r1 = r0 + L * (X + play * rng.normal(size=(count, 3)))
    dr = X + tilt * rng.normal(size=(2, count, 3))
    dr /= np.linalg.norm(dr, axis=-1, keepdims=True)
    return r0, r1, dr[0], dr[1], Z + 0.2 * rng.normal(size=(count, 3))


def fibers(ends, **settings):
    """Modal fibers of single-fiber strips."""
    *curve, normal = (one[..., None, :] for one in ends)
    found = modal_fibers(*curve, L, normal, **settings)
    return found._replace(
        coefficients=found.coefficients[..., 0, :, :],
        status=found.status[..., 0],
        side=found.side[..., 0],
        force=found.force[..., 0],
    )


def velocity(a, u):
    last = a.shape[-2] - 1
    return (powers(u, last) * np.arange(1, last + 1)) @ a[..., 1:, :] / L


def mean_squared_speed(a):
    return (velocity(a, (NODES + 1) / 2) ** 2).sum(-1) @ WEIGHTS / 2


def bending(a):
    """Half the integral of squared second derivatives over u, of coefficients."""
    last = a.shape[-2] - 1
    k = np.arange(2, last + 1)
    second = (powers((NODES + 1) / 2, last - 1) * k * (k - 1)) @ a[..., 2:, :]
    return (second**2).sum(-1) @ WEIGHTS / 4


def is_met(found):
    return np.isin(found.status, [FiberStatus.MET, FiberStatus.WEAK_DIRECTION])


@settings(deadline=None, max_examples=30)
@given(seed=SEEDS)
def test_one_mode_is_the_closed_form_of_the_paper(seed):
    *ends, normal = random_ends(seed)
    quartic, _ = quartic_fibers(*ends, L)
    modal = modal_fibers(*ends, L, normal, modes=1, ribbon=False)
    turn = (ends[2] - ends[3]) / 8
    c = 52.5 * length_error(ends[1] - ends[0], *ends[2:], L) / (turn**2).sum(-1)
    solved = c < 190
    assert 20 < solved.sum() < 190
    assert (modal.status[solved] == FiberStatus.MET).all()
    error = abs(modal.coefficients - quartic)[solved].max()
    assert error < CLOSED_FORM * L


@settings(deadline=None, max_examples=30)
@given(seed=SEEDS, modes=st.integers(1, 4), ribbon=st.booleans())
def test_curves_meet_ends_tangents_and_length(seed, modes, ribbon):
    ends = random_ends(seed)
    found = fibers(ends, modes=modes, ribbon=ribbon)
    a = found.coefficients
    assert_allclose(
        powers([0.0, 1.0], modes + 4) @ a, np.stack(ends[:2], 1), atol=1e-13
    )
    assert_allclose(velocity(a, [0.0, 1.0]), np.stack(ends[2:4], 1), atol=1e-10)
    assert_allclose(mean_squared_speed(a[is_met(found)]), 1, rtol=0, atol=SPEED)
    assert 0 < is_met(found).sum() < len(a)


@settings(deadline=None, max_examples=20)
@given(seed=SEEDS)
def test_no_neighbor_of_the_same_length_has_less_energy(seed):
    """Stationary: the gradient of the energy is along that of the length."""
    found = fibers(random_ends(seed, count=50), ribbon=False)
    a, basis = found.coefficients[is_met(found)], bending_modes(3)
    forces = found.force[is_met(found)]
    step = 1e-5
    for axis, mode in np.ndindex(3, 3):
        change = np.zeros_like(a)
        change[..., axis] = step * basis.powers[4 + mode]
        slope = (bending(a + change) - bending(a - change)) / (2 * step)
        longer = mean_squared_speed(a + change) - mean_squared_speed(a - change)
        pull = forces * longer * L**2 / 2 / (2 * step)
        scale = 1 + abs(forces)
        assert (abs(slope + pull) < 1e-8 * scale).all()


@settings(deadline=None, max_examples=20)
@given(seed=SEEDS)
def test_more_modes_never_cost_more_energy(seed):
    ends = random_ends(seed)
    found = [fibers(ends, modes=m, ribbon=False) for m in (1, 2, 3, 4)]
    energy = [bending(one.coefficients) for one in found]
    for n in range(3):
        met = is_met(found[n])
        assert is_met(found[n + 1])[met].all()
        assert (energy[n + 1][met] <= energy[n][met] * (1 + 1e-9)).all()


def hard_ends(count, seed=0):
    """Random fibers with parallel, nearly parallel, taut, slack and folded ones."""
    rng = np.random.default_rng(seed)
    r0, r1, dr0, dr1, n = random_ends(seed, count, origin=0.1)
    kind = rng.integers(0, 8, count)[:, None]
    near = dr0 + 10.0 ** rng.uniform(-16, -2, (count, 1)) * rng.normal(size=(count, 3))
    near /= np.linalg.norm(near, axis=-1, keepdims=True)
    dr1 = np.where(kind == 1, dr0, np.where(kind == 2, near, dr1))
    chord = 10.0 ** rng.uniform(-9, -2, (count, 1))
    r1 = np.where(kind == 3, r0 + L * (1 - chord) * X, r1)
    r1 = np.where(kind == 4, r0 + 0.7 * (r1 - r0), r1)
    r1 = np.where(kind == 5, r0, r1)
    r1 = np.where(kind == 6, r0 - (r1 - r0), r1)
    dr0 = np.where(kind == 7, X, dr0)
    dr1 = np.where(kind == 7, X, dr1)
    return r0, r1, dr0, dr1, n


def test_a_million_fibers_keep_the_promise():
    """No NaN, ends and length met, or a status that says why not."""
    for seed in range(10):
        ends = hard_ends(100_000, seed)
        with np.errstate(all="raise", under="ignore"):
            found = fibers(ends, side=seed % 3 - 1)
        assert np.isfinite(found.coefficients).all()
        met = is_met(found)
        error = abs(mean_squared_speed(found.coefficients[met]) - 1)
        assert error.max() < STRAIGHT
        assert (error[found.side[met] != 0] < SPEED).all()
        over = np.linalg.norm(ends[1] - ends[0], axis=-1) > L * (1 + 1e-9)
        assert_array_equal(found.status == FiberStatus.OVERSTRETCHED, over)
        taut = found.status == FiberStatus.TAUT
        assert (mean_squared_speed(found.coefficients[taut]) > 1).all()
        assert_array_equal(met, ~(over | taut))


@settings(deadline=None, max_examples=20)
@given(seed=SEEDS, side=st.sampled_from([-1, 0, 1]))
def test_reversed_fiber_is_the_same_curve(seed, side):
    r0, r1, dr0, dr1, n = random_ends(seed, origin=0.1)
    found = fibers((r0, r1, dr0, dr1, n), side=side)
    turned = fibers((r1, r0, -dr1, -dr0, n), side=side)
    safe = ~near_threshold(found)
    u = np.linspace(0, 1, 9)
    assert_array_equal(found.status, turned.status)
    assert_array_equal(found.side[safe], turned.side[safe])
    there, back = powers(u, 7) @ found.coefficients, powers(1 - u, 7)
    error = abs(there - back @ turned.coefficients).max(axis=(-1, -2))
    assert (error[safe] < INVARIANT).all()


@settings(deadline=None, max_examples=20)
@given(seed=SEEDS, side=st.sampled_from([-1, 0, 1]))
def test_rigid_motion_moves_the_curve(seed, side):
    ends = random_ends(seed, origin=0.1)
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    shift = np.array([0.1, -0.2, 0.3])
    found = fibers(ends, side=side)
    moved = [end @ turn.T for end in ends]
    moved[0], moved[1] = moved[0] + shift, moved[1] + shift
    again = fibers(moved, side=side)
    safe = ~near_threshold(found)
    u = np.linspace(0, 1, 9)
    expected = powers(u, 7) @ found.coefficients @ turn.T + shift
    assert_array_equal(found.status, again.status)
    error = abs(powers(u, 7) @ again.coefficients - expected).max(axis=(-1, -2))
    assert (error[safe] < INVARIANT).all()


def near_threshold(found):
    """Fibers about to be taut, or about to lose their other side: square roots of 0."""
    a = found.coefficients
    slack_share = np.where(np.isfinite(found.force), found.force, 0)
    return (slack_share > 3e3) | ((found.force < -39.6) & (abs(a[:, 2]).max(1) < 1e-3))


def test_parallel_cups_buckle_to_the_side_that_is_asked_for():
    chord = 0.99 * L * X
    ends = [np.tile(one, (3, 1)) for one in (0 * X, chord, X, X, Z)]
    found = fibers(ends, side=np.array([[1], [-1], [0]]))
    assert (found.status == FiberStatus.WEAK_DIRECTION).all()
    assert_array_equal(found.side, [1, -1, -1])  # it hangs where nobody asks
    middle = powers(0.5, 7) @ found.coefficients
    assert_allclose(middle[0, 2], -middle[1, 2], rtol=1e-12)
    assert middle[0, 2] == pytest.approx(2 / np.pi * np.sqrt(0.01) * L, rel=0.02)
    assert_allclose(middle[:, 1], 0, atol=1e-15)
    assert_allclose(found.force, -bending_modes(3).loads[0], rtol=1e-12)


def test_the_other_side_costs_more_energy_and_ends_with_slack():
    tilt = 0.05
    dr0, dr1 = X + tilt * Z, X - tilt * Z
    dr0, dr1 = (one / np.linalg.norm(one) for one in (dr0, dr1))
    chord = np.array([0.97, 0.98, 0.9999])[:, None] * L * X
    ends = [np.broadcast_to(one, (3, 3)) for one in (0 * X, chord, dr0, dr1, Z)]
    up, down = fibers(ends), fibers(ends, side=-1)
    assert_array_equal(up.side, 1)
    assert_array_equal(down.side, [-1, -1, 1])  # too little slack to snap through
    assert (bending(down.coefficients) > bending(up.coefficients))[:2].all()
    assert_allclose(mean_squared_speed(down.coefficients), 1, rtol=0, atol=SPEED)


def test_fibers_of_a_strip_bulge_together():
    tilts = np.array([-0.01, 0.002, 0.015])[:, None]
    dr0, dr1 = X + tilts * Z, X - tilts * Z
    dr0, dr1 = (one / np.linalg.norm(one, axis=-1)[:, None] for one in (dr0, dr1))
    chord = np.tile(0.98 * L * X, (3, 1))
    together = modal_fibers(0 * chord, chord, dr0, dr1, L, Z)
    alone = modal_fibers(
        0 * chord, chord, dr0, dr1, L, np.tile(Z, (3, 1)), ribbon=False
    )
    assert_array_equal(together.side, [1, 1, 1])
    assert_array_equal(alone.side, [-1, 1, 1])


def test_gravity_bows_a_clamped_strip_as_beam_theory_says():
    weight = 1e-3  # [1/m^3] small: no axial force
    chord = np.tile(L * (1 - 1e-6) * X, (1, 1))
    ends = (0 * chord, chord, X[None], X[None], Z[None])
    soft = fibers(ends, load=-weight * Z, softness=1e6)
    sag = (powers(0.5, 7) @ soft.coefficients)[0, 2]
    assert sag == pytest.approx(-weight * L**4 / 384, rel=2e-3)


def test_gravity_chooses_the_side_of_parallel_cups():
    chord = np.tile(0.99 * L * X, (1, 1))
    ends = (0 * chord, chord, X[None], X[None], Z[None])
    for way in (-1, 1):
        assert fibers(ends, load=way * 600 * Z).side == way


def test_a_soft_length_gives_in_proportion_to_the_force():
    ends = random_ends(3)
    soft = fibers(ends, softness=1e-4)
    stretch = mean_squared_speed(soft.coefficients) - 1
    assert_allclose(stretch, 1e-4 * soft.force, rtol=1e-6, atol=2e-9)
    assert (soft.status != FiberStatus.TAUT).all()


def test_natural_length_asks_for_no_bulge():
    dr0, dr1 = X + 0.2 * Z, X - 0.2 * Z
    dr0, dr1 = (one / np.linalg.norm(one) for one in (dr0, dr1))
    ends = np.zeros((1, 3)), 0.9 * L * X[None], dr0[None], dr1[None]
    from ply.fiber import natural_length

    natural = natural_length(*ends)
    found = modal_fibers(*ends, natural, Z[None])
    expected = cubic_fibers(*ends, natural)
    assert_allclose(found.coefficients[:, :4], expected[:, :4], rtol=0, atol=1e-15)
    assert (found.coefficients[:, 4:] == 0).all()
    assert found.side == 0
