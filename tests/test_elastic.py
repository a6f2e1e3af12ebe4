import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.sparse import csc_matrix

from drapeplan.elastic import Rows, least_open, relax

HELD = 1e-5  # [mm] what is left open of rows that can hold
NEAR = 5e-3  # [mm] a thousandth of the sum is not worth another step


def rows(value, matrix, lower, upper, price=None):
    price = np.ones(len(value)) if price is None else np.asarray(price, float)
    parts = (np.asarray(x, float) for x in (lower, upper))
    return Rows(np.asarray(value, float), csc_matrix(matrix), *parts, price)


def test_excess_is_signed_and_zero_between_the_sides():
    found = rows([1, 2, 3, 4], np.zeros((4, 1)), [2, 2, 2, -np.inf], [2, 3, 2, np.inf])
    assert_allclose(found.excess(), [-1, 0, 1, 0])
    assert found.cost() == 2


def test_one_of_three_that_agree_gives_way():
    """Rows x = 0, x = 0 and x = 3: least in sum where the odd one gives all 3."""
    made = rows([0, 0, 0], [[1], [1], [1]], [0, 0, 3], [0, 0, 3])
    assert relax(made, 10.0) == pytest.approx(0)
    dear = rows([0, 0, 0], [[1], [1], [1]], [0, 0, 3], [0, 0, 3], [1, 1, 2.5])
    assert relax(dear, 10.0) == pytest.approx(3)
    assert relax(dear, 2.0) == pytest.approx(2)  # no farther than the region


def test_what_can_hold_holds_on_a_curve():
    """The circle of radius 5 and the line x = 3 meet at (3, 4)."""

    def linearize(u):
        value = [np.hypot(*u), u[0]]
        return rows(value, [u / np.hypot(*u), [1, 0]], [5, 3], [5, 3])

    u, found = least_open(linearize, np.array([4.0, 1.0]))
    assert_allclose(u, [3, 4], atol=1e-5)
    assert found.cost() < HELD


def test_a_line_beside_a_circle_stays_open_by_their_distance():
    """The line x = 7 misses the circle by 2; the dearer row is the one that holds."""
    for price, point in ([10, 1], 5), ([1, 10], 7):

        def linearize(u, price=price):
            value = [np.hypot(*u), u[0]]
            matrix = [u / np.hypot(*u), [1, 0]]
            return rows(value, matrix, [5, 7], [5, 7], price)

        u, found = least_open(linearize, np.array([4.0, 1.0]))
        assert u[0] == pytest.approx(point, abs=NEAR)
        assert np.abs(found.excess()).max() == pytest.approx(2, abs=NEAR)
        assert np.abs(found.excess()).min() < NEAR
