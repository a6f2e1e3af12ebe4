"""Distances against surfaces whose distance is known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize

from drapeplan.compare import Place, Surface, compare, rms
from ply.grid import CupGrid
from tests.scans import truth_cups

SPLINE = 2e-8  # [m] of a sphere sampled every 10 mm: h^4 / R^3
GRID = CupGrid(2, 3, 0.11, 0.02)
LINES = np.linspace(-0.02, 0.24, 27), np.linspace(-0.02, 0.13, 16)


def sphere(radius=0.5):
    """A cap over the grid: s and t are x and y; its top is the origin."""
    s, t = np.meshgrid(*LINES)
    z = np.sqrt(radius**2 - s**2 - t**2) - radius
    return Surface(*LINES, np.stack([s, t, z], axis=-1))


def scattered(seed, count=300, edge=0.01):
    random = np.random.default_rng(seed)
    return np.column_stack(
        [random.uniform(lines[0] + edge, lines[-1] - edge, count) for lines in LINES]
    )


def test_surface_passes_its_samples_and_the_sphere():
    surface, st = sphere(), scattered(0)
    grid_st = np.stack(np.meshgrid(*LINES), axis=-1).reshape(-1, 2)
    assert_allclose(surface.points(grid_st), surface.samples.reshape(-1, 3), atol=1e-15)
    center = np.array([0, 0, -0.5])
    away = np.linalg.norm(surface.points(st) - center, axis=1)
    assert_allclose(away, 0.5, atol=SPLINE)


def test_normal_distance_to_a_sphere():
    surface, st = sphere(), scattered(1)
    out = np.random.default_rng(2).uniform(-0.02, 0.02, len(st))
    center = np.array([0, 0, -0.5])
    normals = (surface.points(st) - center) / 0.5
    points = surface.points(st) + out[:, None] * normals
    feet = surface.closest(points)
    assert feet.inside.all()
    assert_allclose(feet.distance, out, atol=SPLINE)
    assert_allclose(feet.st, st, atol=1e-5)


def test_distance_along_a_direction():
    surface, st = sphere(), scattered(3)
    direction = np.array([0.3, -0.2, 0.9]) / np.linalg.norm([0.3, -0.2, 0.9])
    out = np.random.default_rng(4).uniform(-0.01, 0.01, len(st))
    points = surface.points(st) + out[:, None] * direction
    feet = surface.along(points, direction, surface.closest(points).st)
    assert feet.inside.all()
    assert_allclose(feet.distance, out, atol=1e-8)


def test_lines_that_miss_the_surface_say_so():
    surface = sphere()
    points = np.array([[0.1, 0.05, 0.01], [0.5, 0.05, 0.0]])
    feet = surface.along(points, [0, 0, 1], np.array([[0.1, 0.05], [0.24, 0.05]]))
    assert feet.inside.tolist() == [True, False]


@pytest.mark.parametrize("case", ["B_lift20_flatcup", "B_cyl500_rot30_sheared"])
def test_closest_points_against_a_minimizer(case):
    """Also at the edge, where one coordinate is held and the other is free."""
    _, surface = truth_cups(case)
    random = np.random.default_rng(5)
    low, high = (np.array([surface.s[k], surface.t[k]]) for k in (0, -1))
    st = random.uniform(low - 0.01, high + 0.01, (40, 2))
    points = surface.points(np.clip(st, low, high))
    points[:, :2] += st - np.clip(st, low, high)
    points += random.normal(0, 0.003, points.shape)
    feet = surface.closest(points)
    for point, distance in zip(points, feet.distance, strict=True):
        starts = [np.clip(start, low, high) for start in (point[:2], feet.st[0])]
        found = [
            minimize(
                lambda x, p=point: 1e6 * np.sum((surface.points([x])[0] - p) ** 2),
                start,
                bounds=list(zip(low, high, strict=True)),
                tol=1e-12,
            )
            for start in starts
        ]
        least = np.sqrt(min(f.fun for f in found)) * 1e-3
        assert abs(distance) == pytest.approx(least, abs=2e-6)


def test_distances_do_not_see_a_rigid_motion():
    _, surface = truth_cups("C_wave")
    st = np.column_stack([np.linspace(0, 0.44, 50), np.linspace(0.2, 0.0, 50)])
    points = surface.points(st) + np.array([0.001, -0.002, 0.003])
    axis, angle = np.array([[0, -0.6, 0.8], [0.6, 0, 0], [-0.8, 0, 0]]), 1.1
    turn = np.eye(3) + np.sin(angle) * axis + (1 - np.cos(angle)) * axis @ axis
    moved = Surface(surface.s, surface.t, surface.samples @ turn.T + 0.4)
    one, other = surface.closest(points), moved.closest(points @ turn.T + 0.4)
    assert_allclose(one.distance, other.distance, atol=1e-10)


def test_each_point_has_its_place():
    points = np.array(
        [
            [0.055, 0.055, 0.0],  # in the patch
            [0.055, 0.0, 0.001],  # on a strip
            [0.01, -0.01, 0.001],  # on a cup
            [0.3, 0.0, 0.0],  # beyond
            [0.055, 0.055, 0.2],  # on the ceiling
        ]
    )
    surface = Surface(*LINES, np.dstack([*np.meshgrid(*LINES), np.zeros((16, 27))]))
    found = compare(surface, GRID, points)
    expected = [Place.FREE, Place.FREE, Place.ON_CUP, Place.FAR, Place.FAR]
    assert found.place.tolist() == expected
    nearer = compare(surface, GRID, points[3:4] - [0.05, 0, 0])
    assert nearer.place.tolist() == [Place.BEYOND]


def test_nothing_compares_to_nothing():
    found = compare(sphere(), GRID, np.empty((0, 3)))
    assert found.free.shape == (0,)
    assert rms(found.normal) == 0.0
    assert rms([3.0, -4.0]) == pytest.approx(np.sqrt(12.5))
