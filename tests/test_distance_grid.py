import json

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal

from drapeplan.distance_grid import DistanceGrid, face_samples
from drapeplan.distance_kernels import closest
from drapeplan.errors import InputError
from tests.mold_meshes import box, cap, channel, torus

STEP = 0.005  # [m]
QUANTUM = 1e-6  # [m] rounding of stored distances near the surface
SMOOTH = 2e-5  # [m] near contact on smooth parts
EDGE = 0.5 * STEP  # [m] near edges, which trilinear cells round off
FACETED = 4e-4  # [m] where faces meet at 15 deg every 10 mm
SWEPT = 5e-4  # [m] coarse nodes, whose triangle is handed on by neighbors
FAR = 0.012  # [m] the same of the coarse grid, 4 steps wide
SLOPE = 1e-6  # [-] finite differences inside one cell
HEIGHT = 2e-5  # [m] heights that are seen, found between quanta


@pytest.fixture(scope="module")
def boxed():
    """Grid of a box that stands askew to it, and the turn that straightens it."""
    vertices, faces = box()
    turn = trimesh.transformations.euler_matrix(0.3, 0.5, 0.7)[:3, :3]
    return DistanceGrid.from_mesh(vertices @ turn.T, faces, STEP, -1.0), turn


@pytest.fixture(scope="module")
def ring():
    return DistanceGrid.from_mesh(*torus(), STEP, -1.0)


@pytest.fixture(scope="module")
def ditch():
    return DistanceGrid.from_mesh(*channel(), STEP, -0.025)


def cloud(count, half, seed=0):
    """Random points, shape (count, 3), in [m]."""
    return np.random.default_rng(seed).uniform(-1, 1, (count, 3)) * half


def test_distances_to_a_box(boxed):
    grid, turn = boxed
    local = cloud(20_000, (0.14, 0.12, 0.09))
    beyond = abs(local) - np.array([0.1, 0.08, 0.05])
    outside = np.linalg.norm(np.maximum(beyond, 0), axis=1)
    exact = outside + np.minimum(beyond.max(axis=1), 0)
    error = abs(grid.distance(local @ turn.T)[0] - exact)
    near = abs(exact) < 2 * STEP
    one_side = np.sort(beyond, axis=1)[:, 1] < -4 * STEP
    assert (near & one_side).sum() > 500
    assert error[near & one_side].max() < QUANTUM
    assert error[near].max() < EDGE
    assert error.max() < FAR


def test_distances_to_a_sphere():
    grid = DistanceGrid.from_mesh(*cap(), STEP, -1.0)
    rng = np.random.default_rng(1)
    x, y, gap = rng.uniform(-1, 1, (3, 20_000)) * [[0.03], [0.03], [0.008]]
    way = np.stack([x, y, np.sqrt(1 - x**2 - y**2)], axis=-1)
    points = (1 + gap)[:, None] * way - [0, 0, 1]
    error = abs(grid.distance(points)[0] - gap)
    assert error.max() < SMOOTH
    assert_allclose(grid.gap(points), gap, atol=SMOOTH)


def test_distances_are_those_of_trimesh(ring):
    """All features of a mesh that overhangs, by brute force; the sign by rays."""
    mesh = trimesh.Trimesh(*torus(), process=False)
    points = cloud(300, (0.16, 0.16, 0.06))
    _, distance, _ = trimesh.proximity.closest_point_naive(mesh, points)
    sign = np.where(mesh.ray.contains_points(points), -1, 1)
    error = abs(ring.distance(points)[0] - sign * distance)
    near = distance < 2 * STEP
    assert near.sum() > 50
    assert error[near].max() < FACETED
    assert error.max() < FAR


def test_nodes_are_exact(ring):
    """The band misses no triangle; the sweep one that is hardly nearer."""
    mesh = trimesh.Trimesh(*torus(), process=False)
    rng = np.random.default_rng(2)
    for level, off in ((ring.fine, 0.0), (ring.coarse, SWEPT)):
        known = np.argwhere(level.counts > -32768)
        node = rng.choice(known, 200, replace=False)
        points = np.array(level.origin) + level.step * node
        _, distance, _ = trimesh.proximity.closest_point_naive(mesh, points)
        stored = level.quantum * level.counts[tuple(node.T)]
        assert_allclose(abs(stored), distance, atol=off + 0.55 * level.quantum)


def test_gradients_are_slopes_of_distances(ring):
    points = cloud(2000, (0.2, 0.2, 0.3), 3)
    d, slope = ring.distance(points)
    tiny = 1e-7
    for k, axis in enumerate(np.eye(3)):
        ahead, behind = (ring.distance(points + s * tiny * axis)[0] for s in (1, -1))
        numeric = (ahead - behind) / (2 * tiny)
        inside_cell = abs(ahead - 2 * d + behind) < 1e-13  # no face of a cell between
        assert inside_cell.mean() > 0.95
        assert_allclose(slope[inside_cell, k], numeric[inside_cell], atol=SLOPE)


def test_beyond_the_grid_distances_grow(ring):
    ways = cloud(50, 1.0, 4)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    d = ring.distance(np.linspace(0.5, 3.0, 26)[:, None, None] * ways)[0]
    assert (np.diff(d, axis=0) > 0).all()
    assert_allclose(d[-1], 3.0, rtol=0.06)


def test_over_a_channel_the_gap_falls_with_the_ply(ditch):
    """Its edges are no nearer for a ply that comes down between them."""
    x = np.linspace(-0.06, 0.06, 121)
    over = abs(x) < 0.02 - STEP / 4  # edges are a quarter of a step sharp
    land = abs(x) > 0.02 + STEP / 4
    for z in (0.0005, 0.002, 0.01):
        gap = ditch.gap(np.stack([x, 0 * x, 0 * x + z], axis=-1))
        assert_allclose(gap[land], z, atol=HEIGHT)
        assert_allclose(gap[over], z + 0.025, atol=HEIGHT)


def test_under_an_edge_the_gap_is_the_distance(ditch):
    """A height field has mold there; here is air, and the wall leaning over it."""
    lean = np.arctan2(0.008, 0.025)
    x, z = 0.0225, -0.012
    wall = (0.02 + 0.008 * (-z / 0.025) - x) * np.cos(lean)
    gap, _ = ditch.distance([x, 0, z])
    assert gap == pytest.approx(wall, abs=QUANTUM)
    assert ditch.gap([x, 0, z]) == gap
    assert ditch.gap([0.05, 0, -0.004]) == pytest.approx(-0.004, abs=QUANTUM)


def test_the_grid_comes_back_from_a_file_bit_by_bit(ring):
    text = json.dumps(ring.to_data())
    again = DistanceGrid.from_data(json.loads(text))
    assert json.dumps(again.to_data()) == text
    assert_array_equal(again.fine.counts, ring.fine.counts)
    points = cloud(100, 0.3)
    assert_array_equal(again.gap(points), ring.gap(points))
    assert json.dumps(DistanceGrid.from_mesh(*torus(), STEP, -1.0).to_data()) == text


def test_the_nearest_point_of_a_triangle_is_that_of_trimesh():
    """Beside its face, each edge and each corner."""
    rng = np.random.default_rng(5)
    seen = set()
    for triangle, point in zip(
        rng.normal(size=(300, 3, 3)), 1.5 * rng.normal(size=(300, 3)), strict=True
    ):
        nearest = trimesh.triangles.closest_point(triangle[None], point[None])[0]
        *way, feature = closest(*point, triangle)
        assert_allclose(way, point - nearest, atol=1e-12)
        seen.add(feature)
    assert seen == set(range(7))


@pytest.mark.parametrize(
    "damage",
    [
        {"deflated_int16": "no base64"},
        {"deflated_int16": "AAAA"},
        {"shape": [3, 3, 3]},
        {"shape": [10**6, 10**6, 10**6]},
        {"shape": [0, 4, 4]},
    ],
    ids=str,
)
def test_a_damaged_grid_is_refused(ring, damage):
    data = ring.to_data()
    data["fine"] |= damage
    with pytest.raises(InputError, match=r"mold: distance: the grid .*; plan again"):
        DistanceGrid.from_data(data)


def test_a_grid_too_large_is_refused():
    with pytest.raises(InputError, match="use a coarser step"):
        DistanceGrid.from_mesh(*box((20, 20, 20)), STEP, -10.0)


def test_samples_lie_spread_on_their_triangles():
    corners = np.array(
        [[[0, 0, 0], [1, 0, 0], [0, 1, 0.5]], [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]]
    )
    points, owner = face_samples(corners, 0.3)
    assert_array_equal(np.bincount(owner), [25, 1])
    assert_allclose(points[owner == 1], [[0.1 / 3, 0.1 / 3, 0]])
    assert_allclose(points[owner == 0].mean(axis=0), corners[0].mean(axis=0))
    assert_allclose(points[owner == 0] @ [0, -0.5, 1], 0, atol=1e-15)
