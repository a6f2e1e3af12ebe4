import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.testing import assert_allclose

from ply.modes import bending_modes

ROUNDING = 1e-11  # [-] float64 noise of integrals of polynomials with terms of 1e4
NODES, WEIGHTS = np.polynomial.legendre.leggauss(10)


def polynomials(modes):
    return [Polynomial(row) for row in modes.powers[4:]]


def integral(*factors):
    values = [one((NODES + 1) / 2) for one in factors]
    return np.prod(values, axis=0) @ WEIGHTS / 2


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_modes_are_orthogonal_in_slope_and_bending(count):
    modes = bending_modes(count)
    phi = polynomials(modes)
    slopes = [[integral(a.deriv(), b.deriv()) for a in phi] for b in phi]
    bends = [[integral(a.deriv(2), b.deriv(2)) for a in phi] for b in phi]
    assert_allclose(slopes, np.eye(count), rtol=0, atol=ROUNDING)
    assert_allclose(bends, np.diag(modes.loads), rtol=0, atol=1e3 * ROUNDING)
    for one in phi:
        ends = [one(0.0), one(1.0), one.deriv()(0.0), one.deriv()(1.0)]
        assert_allclose(ends, 0, rtol=0, atol=ROUNDING)


def test_areas_and_tilts_are_integrals():
    modes = bending_modes(4)
    for area, tilt, one in zip(
        modes.areas, modes.tilts, polynomials(modes), strict=True
    ):
        assert integral(one) == pytest.approx(area, abs=ROUNDING)
        assert integral(one, Polynomial([-1, 2])) == pytest.approx(tilt, abs=ROUNDING)
    assert (modes.areas[::2] > 0).all()
    assert (modes.tilts[1::2] > 0).all()
    assert (modes.areas[1::2] == 0).all()
    assert (modes.tilts[::2] == 0).all()


def test_loads_converge_to_the_buckling_loads_of_a_clamped_strip():
    exact = np.array([4 * np.pi**2, 4 * 4.493409457909064**2])  # tan x = x
    assert bending_modes(1).loads == pytest.approx(42)
    assert_allclose(bending_modes(3).loads[0], exact[0], rtol=6e-4)
    assert_allclose(bending_modes(8).loads[:2], exact, rtol=1e-6)
