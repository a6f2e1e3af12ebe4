import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from drapeplan.inverse import nearest_solution, nearest_turn, newton, spread

EXACT = 1e-12  # [rad, m] of a residual without roundings to speak of
LIMIT = np.full(2, 2 * np.pi)


def planar(x, y):
    """Residual of an arm of two unit links whose tip is wanted at (x, y)."""

    def residual(q):
        a, b = q[0], q[0] + q[1]
        tip = np.array([np.cos(a) + np.cos(b), np.sin(a) + np.sin(b)])
        second = np.array([-np.sin(b), np.cos(b)])
        first = np.array([-np.sin(a), np.cos(a)]) + second
        return np.array([x, y]) - tip, np.stack([first, second], axis=1)

    return residual


@given(
    radius=st.floats(0.2, 1.9), angle=st.floats(-3, 3), side=st.sampled_from([-1, 1])
)
def test_newton_meets_both_elbows(radius, angle, side):
    """Law of cosines: the elbow's angle has cosine radius^2 / 2 - 1."""
    elbow = side * np.arccos(radius**2 / 2 - 1)
    exact = np.array([angle - elbow / 2, elbow])
    residual = planar(radius * np.cos(angle), radius * np.sin(angle))
    q, reached = newton(residual, exact + 0.05)
    assert reached
    assert_allclose(residual(q)[0], np.zeros(2), atol=EXACT)


def test_the_near_elbow_wins_and_needs_no_search():
    seed = np.array([0.4, -1.2])
    calls = []
    starts = (calls.append(k) or np.array([-0.5, 1.2]) for k in range(2))
    q, _ = nearest_solution(planar(1.6, 0.1), -LIMIT, LIMIT, seed, starts)
    assert q[1] < 0
    assert not calls


def test_limits_send_the_search_to_the_other_elbow():
    seed = np.array([0.4, -1.2])
    lower, upper = np.array([-3.0, 0.0]), np.array([3.0, 3.0])
    starts = np.array([[-0.5, 1.2], [-0.4, 0.9]])
    q, ends = nearest_solution(planar(1.6, 0.1), lower, upper, seed, starts)
    assert q[1] > 0
    assert len(ends) == 1


def test_of_several_solutions_the_nearest_wins():
    """Both elbows are farther than NEAR: an elbow of +1 is nearer to +1.3."""
    seed = np.array([-2.0, 1.0])
    starts = np.array([[0.7, -1.3], [-0.5, 1.2], [0.6, -1.2]])
    q, ends = nearest_solution(planar(1.6, 0.1), -LIMIT, LIMIT, seed, starts)
    assert_allclose(q[1], np.arccos((1.6**2 + 0.1**2) / 2 - 1), atol=EXACT)
    assert not ends


def test_no_solution_returns_where_the_starts_ended():
    starts = spread(-LIMIT, LIMIT, 3)
    residual = planar(2.5, 0.0)
    q, ends = nearest_solution(residual, -LIMIT, LIMIT, np.array([0.3, 0.3]), starts)
    assert q is None
    assert len(ends) == 4


def test_turns_are_chosen_near_the_seed_and_within_limits():
    q = np.array([7.0, -1.0, 3.0, 1.0])
    seed = np.array([0.5, 5.0, -3.0, 9.0])
    limit = np.array([6.0, 6.0, 3.1, 4.0])
    turned = nearest_turn(q, -limit, limit, seed)
    wanted = [7 - 2 * np.pi, 2 * np.pi - 1, 3.0, 1.0]
    assert_allclose(turned, wanted, atol=EXACT)


def test_starts_are_spread_evenly():
    """Any half of any axis holds about half of the starts, and none comes twice."""
    points = spread(np.full(6, -1.0), np.full(6, 3.0), 64)
    assert (points >= -1).all()
    assert (points <= 3).all()
    assert_allclose((points < 1).sum(axis=0), np.full(6, 32), atol=3)
    assert len(np.unique(points.round(6), axis=0)) == 64
    assert_array_equal(points, spread(np.full(6, -1.0), np.full(6, 3.0), 64))
