import numpy as np
from numpy.testing import assert_allclose
from scipy.optimize import brentq

from ply.secular import Secular, least_energy, other_side

LOADS = np.array([39.5, 90.0, 200.5])  # of three modes, ply.modes
GAPS = (LOADS[1:] - LOADS[0])[:, None]
SEED, COUNT = 0, 100_000
ROUNDING = 3e-15  # [-] float64 noise of a sum of three shares over the room
LOGARITHM = 3e-15  # [-] the same in the logarithm of the first share
DOUBLE = 1e-6  # [-] roots that nearly meet lose half of the digits


def equations(slope, count=COUNT):
    """Hard ones included: vanishing shares, and room within 1e-14 of the crossing."""
    rng = np.random.default_rng(SEED)
    first = 10.0 ** rng.uniform(-40, 4, count)
    first[::5] = 0
    rest = 10.0 ** rng.uniform(-12, 3, (2, count))
    rest[:, ::7] = 0
    drawn = (rest / GAPS**2).sum(axis=0)
    near = drawn * (1 + rng.choice([-1, 1], count) * 10.0 ** rng.uniform(-14, 2, count))
    room = np.where(rng.random(count) < 0.5, near, 10.0 ** rng.uniform(-8, 1, count))
    if slope == 0:
        room = abs(room) + 1e-14
    return Secular(first, rest, GAPS, room, slope)


def check(slope):
    equation = equations(slope)
    x, share = least_energy(equation)
    assert np.isfinite(x).all()
    assert (x >= 0).all()
    total = share + (equation.rest / (GAPS + x) ** 2).sum(axis=0)
    room = equation.room + slope * x
    scale = np.maximum(abs(room), abs(equation.room))
    assert (abs(total - room) <= ROUNDING * scale).all()
    held = equation.first > 1e-50
    found = np.log(x[held] ** 2 * (share[held] / equation.first[held]))
    assert_allclose(found, 0, rtol=0, atol=LOGARITHM)


def test_least_energy_meets_its_equation_for_rigid_lengths():
    check(0.0)


def test_least_energy_meets_its_equation_for_soft_lengths():
    for slope in (1e-6, 1e-3, 1.0):
        check(slope)


def test_buckling_takes_what_the_further_modes_leave():
    rest = np.array([[20.0], [0.0]])
    equation = Secular(np.zeros(1), rest, GAPS, np.ones(1), 0.0)
    x, share = least_energy(equation)
    assert x < 1e-25
    assert_allclose(share, 1 - 20 / 50.5**2, rtol=1e-15)


def test_taut_fibers_have_infinite_force_and_no_share():
    equation = Secular(np.ones(2), np.ones((2, 2)), GAPS, np.array([0.0, -1.0]), 0.0)
    x, share = least_energy(equation)
    assert np.isinf(x).all()
    assert (share == 0).all()
    assert np.isfinite(least_energy(equation._replace(slope=1e-3))).all()


def test_the_other_side_is_the_root_next_to_buckling():
    """Against brute force: the first sign change left of x = 0, or none."""
    rng = np.random.default_rng(SEED)
    first, rest = 10.0 ** rng.uniform(-8, 2, 300), rng.uniform(0, 500, (2, 300))
    equation = Secular(first, rest, GAPS, rng.uniform(0.1, 1, 300), 0.0)
    x, share, exists = other_side(equation)
    assert 100 < exists.sum() < 280
    for n in range(300):

        def excess(e, n=n):
            drawn = (rest[:, n, None] / (GAPS - e) ** 2).sum(axis=0)
            return first[n] / np.square(e) + drawn - equation.room[n]

        path = np.concatenate(
            [np.geomspace(1e-6, 0.5, 1000), np.linspace(0.5, 50, 5000)]
        )
        below = np.flatnonzero(excess(path) < 0)
        if below.size:
            assert exists[n]
            root = brentq(lambda e: excess(e)[0], 1e-9, path[below[0]], xtol=1e-15)
            assert_allclose(-x[n], root, rtol=DOUBLE)
            assert_allclose(share[n] * root**2, first[n], rtol=DOUBLE)
        elif exists[n]:  # two roots between two steps of the path
            assert abs(excess(-x[n])) < DOUBLE
