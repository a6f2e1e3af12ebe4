"""The heavy elastica of a strip over an edge."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_bvp

from drapeplan.cantilever import (
    bending_stiffness,
    load_of_drop,
    load_of_incline,
    steepest,
)
from drapeplan.cups_file import EARTH

SPLINE = 1e-6  # [-] of a load: between the strips of the table


def clamped(load):
    """Drop and incline of a strip, from its boundary value problem at the clamp."""

    def rates(s, y):
        return np.array(
            [y[1], -load * (1 - s) * np.cos(y[0]), np.sin(y[0]), np.cos(y[0])]
        )

    def ends(at, tip):
        return np.array([at[0], tip[1], at[2], at[3]])

    s = np.linspace(0, 1, 100)
    angle = min(load / 6, 1.3) * (1 - (1 - s) ** 3)
    guess = np.array(
        [angle, np.gradient(angle, s), s * np.sin(angle), s * np.cos(angle)]
    )
    drop, run = solve_bvp(rates, ends, s, guess, tol=1e-8, max_nodes=9999).y[2:, -1]
    return drop, np.arctan2(drop, run)


@pytest.mark.parametrize("load", [0.5, 4.0, 15.0, 30.0])
def test_loads_are_those_of_the_boundary_value_problem(load):
    drop, incline = clamped(load)
    assert_allclose(load_of_drop(drop), load, rtol=SPLINE)
    assert_allclose(load_of_incline(incline), load, rtol=SPLINE)


def test_small_drops_are_those_of_a_beam():
    """The drop is q l^4 / (8 D)."""
    assert load_of_drop(1e-4) == pytest.approx(8e-4, rel=1e-6)


def test_the_standard_instrument_halves_the_overhang():
    """ASTM D1388: at 41.5 degrees the bending length (D / q)^(1/3) is l / 2."""
    bending_length = load_of_incline(np.radians(41.5)) ** (-1 / 3)
    assert bending_length == pytest.approx(0.5, abs=2e-4)


def test_peirce_is_near():
    """His formula is off by 6 % at 41.5 degrees, by nothing at small angles."""
    angle = np.radians([1.0, 10.0, 41.5])
    peirce = 8 * np.tan(angle) / np.cos(angle / 2)
    off = load_of_incline(angle) / peirce - 1
    assert_allclose(off, [0.0, 0.0, 0.0575], atol=5e-3)


def test_stiffness_has_its_unit():
    assert bending_stiffness(8.0, 0.2, 0.31) == pytest.approx(EARTH * 0.31 * 1e-3)


def test_loads_rise_to_the_end():
    for of, most in zip((load_of_drop, load_of_incline), steepest(), strict=True):
        assert (np.diff(of(np.linspace(0, most, 400))) > 0).all()
