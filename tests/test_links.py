import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from drapeplan.links import corner_cosines, corner_links, measure_links, neighbor_pairs
from drapeplan.shear import corner_shear
from drapeplan.surfaces import KinDrape

PITCH = 0.11  # [m]
STEP = 1e-6  # [m] of central differences


def bent_grid(rows=4, columns=3):
    """Plan view of a disturbed grid, shape (n, 2), in [m]."""
    i, j = np.indices((rows, columns))
    noise = np.random.default_rng(3).normal(0, 0.004, (rows * columns, 2))
    return np.stack([PITCH * j, PITCH * i], axis=-1).reshape(-1, 2) - 0.15 + noise


def differences(function, xy):
    """Jacobian of a function of xy, by central differences."""
    columns = []
    for k in range(xy.size):
        step = np.zeros(xy.size)
        step[k] = STEP
        step = step.reshape(xy.shape)
        columns.append((function(xy + step) - function(xy - step)) / (2 * STEP))
    return np.stack(columns, axis=-1)


def test_pairs_come_along_s_first_in_row_major_order():
    s, t = neighbor_pairs(8, 6)
    assert (len(s), len(t)) == (40, 42)
    assert_array_equal(s[[0, 4, 5, 39]], [[0, 1], [4, 5], [6, 7], [46, 47]])
    assert_array_equal(t[[0, 1, 41]], [[0, 6], [1, 7], [41, 47]])


def test_every_corner_joins_two_links_at_one_cup():
    pairs = np.concatenate(neighbor_pairs(5, 4))
    corners = corner_links(5, 4)
    assert len(corners) == len({tuple(c) for c in corners.tolist()}) == 4 * 4 * 3
    for along_s, along_t in corners:
        assert along_s < 15 <= along_t
        assert len({*pairs[along_s], *pairs[along_t]}) == 3


def test_link_jacobian():
    surface, xy = KinDrape(0.5, 1.0), bent_grid()
    offsets = np.linspace(0, 0.03, len(xy))
    links = measure_links(surface, xy, 4, 3, PITCH, offsets)
    points = surface.point(*xy.T) + offsets[:, None] * [0, 0, 1]
    i, j = links.pairs.T
    length = np.linalg.norm(points[j] - points[i], axis=1)
    assert_allclose(links.error, length - PITCH, atol=1e-15)
    numeric = differences(
        lambda q: measure_links(surface, q, 4, 3, PITCH, offsets).error, xy
    )
    assert_allclose(links.jacobian, numeric, atol=1e-8)


def test_corner_jacobian():
    surface, xy = KinDrape(0.5, 1.0), bent_grid()

    def cosines(q):
        return corner_cosines(measure_links(surface, q, 4, 3, PITCH), 4, 3, PITCH)

    value, jacobian = cosines(xy)
    numeric = differences(lambda q: cosines(q)[0], xy)
    assert_allclose(jacobian, numeric, atol=1e-6)
    points = surface.point(*xy.T).reshape(4, 3, 3)
    expected = np.sin(corner_shear(points))
    assert np.sum(value**2) == pytest.approx(
        np.sum(expected**2), rel=0.2
    )  # lengths vary
