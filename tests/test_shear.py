import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from drapeplan.shear import cell_shear, corner_shear, node_shear

ANGLE = 1e-12  # [rad] float64 noise


@given(shear=st.floats(-1, 1))
def test_a_flat_rhombus_net_has_one_shear_everywhere(shear):
    """Positive where the angle from s to t is less than a right angle."""
    i, j = np.indices((4, 5))
    points = np.stack([j + i * np.sin(shear), i * np.cos(shear), 0 * i], axis=-1)
    for measure, shape in ((corner_shear, (3, 4, 4)), (cell_shear, (3, 4))):
        assert measure(points).shape == shape
        assert_allclose(measure(points), shear, atol=ANGLE)
    assert node_shear(points).shape == (4, 5)
    assert_allclose(node_shear(points), shear, atol=ANGLE)


def test_a_symmetric_trapezoid_has_no_shear_in_the_mean():
    cell = np.array([[[0, 0, 0], [2, 0, 0]], [[0.5, 1, 0], [1.5, 1, 0]]], float)
    assert_allclose(cell_shear(cell), 0, atol=ANGLE)
    assert abs(corner_shear(cell)).min() > 0.4


def test_a_node_takes_the_corners_that_meet_there():
    points = np.random.default_rng(0).normal(size=(3, 3, 3))
    node = points[1, 1]
    s = [v / np.linalg.norm(v) for v in (points[1, 2] - node, node - points[1, 0])]
    t = [v / np.linalg.norm(v) for v in (points[2, 1] - node, node - points[0, 1])]
    four = [np.arcsin(a @ b) for a in s for b in t]
    assert_allclose(node_shear(points)[1, 1], np.mean(four))
    assert_allclose(node_shear(points)[0, 2], corner_shear(points)[0, 1, 1])


def test_batches_come_first():
    points = np.random.default_rng(0).normal(size=(2, 3, 4, 5, 3))
    for measure in (corner_shear, cell_shear, node_shear):
        assert_allclose(measure(points)[1, 2], measure(points[1, 2]))
