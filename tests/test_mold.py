import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import minimize

from drapeplan.errors import InputError
from drapeplan.mold import HeightGrid, read_mesh
from drapeplan.surfaces import KinDrape, Paraboloid, Ridge, Sphere, Step

HEIGHT = 3e-9  # [m] the spline at 5 mm, rounding of its heights included
SLOPE = 2e-6  # [-] its slope; rounding 1e-9 m over 5 mm is a tenth of that
CONTACT = 2e-6  # [m] gaps near contact: a hundredth of what the front check resolves
COSINE = 2e-5  # [-] of a far gap: the slope between the nodes
STEP = 1e-6  # [m] of central differences
MOLDS = Path(__file__).parents[1] / "examples" / "molds"


def places(n=2000, half_x=0.4, half_y=0.5):
    """Random places, x and y of shape (n,), in [m]."""
    r = np.random.default_rng(2)
    return r.uniform(-half_x, half_x, n), r.uniform(-half_y, half_y, n)


@pytest.mark.parametrize(
    "surface",
    [Sphere(1.0), Paraboloid(-1.2, 2.5), KinDrape(0.3, 1.0), Ridge(), Step()],
    ids=repr,
)
def test_the_spline_follows_a_surface_and_its_slopes(surface):
    x, y = places()
    grid = HeightGrid.from_surface(surface, 0.4, 0.5)
    found, expected = grid.evaluate(x, y), surface.evaluate(x, y)
    assert_allclose(found[0], expected[0], atol=HEIGHT)
    assert_allclose(found[1:], expected[1:], atol=SLOPE)
    assert_allclose(grid.normal(x, y), surface.normal(x, y), atol=2 * SLOPE)


def test_the_spline_converges_at_fourth_order():
    surface, (x, y) = Ridge(0.05, 0.06, 0.0), places(half_x=0.2, half_y=0.1)
    steps = np.array([0.04, 0.02, 0.01])
    error = [
        abs(
            HeightGrid.from_surface(surface, 0.2, 0.1, h).height(x, y)
            - surface.height(x, y)
        ).max()
        for h in steps
    ]
    assert np.polyfit(np.log(steps), np.log(error), 1)[0] == pytest.approx(4, abs=0.5)


def test_slopes_are_derivatives_on_the_mold_and_far_beyond_it():
    grid = HeightGrid.from_surface(KinDrape(0.3, 0.5), 0.1, 0.12)
    x, y = places(500, 0.4, 0.4)
    z, zx, zy = grid.evaluate(x, y)
    fx = (grid.height(x + STEP, y) - grid.height(x - STEP, y)) / (2 * STEP)
    fy = (grid.height(x, y + STEP) - grid.height(x, y - STEP)) / (2 * STEP)
    assert_allclose(zx, fx, atol=1e-5)  # [-] central differences at bends of 2 / m
    assert_allclose(zy, fy, atol=1e-5)
    assert np.isfinite(z).all()
    assert abs(z).max() < 1  # [m] straight on, no cubic growth


def test_shapes_and_scalars_pass():
    grid = HeightGrid.from_surface(Sphere(1.0), 0.1, 0.1)
    assert grid.height(0.01, 0.02).shape == ()
    assert grid.gap(np.zeros((2, 3, 3))).shape == (2, 3)
    assert grid.evaluate(np.zeros((2, 1)), np.zeros(3))[0].shape == (2, 3)
    assert grid.gap(np.zeros((0, 3))).shape == (0,)


def test_gap_is_the_distance_near_contact():
    """Against the nearest point by brute force, where the first order is a bound."""
    surface = KinDrape(0.3, 1.0)
    grid = HeightGrid.from_surface(surface, 0.4, 0.5)
    x, y = places(40, 0.3, 0.4)
    height = np.linspace(-2e-3, 2e-3, 40)
    points = surface.point(x, y) + height[:, None] * surface.normal(x, y)
    for point, gap in zip(points, grid.gap(points), strict=True):

        def squared(xy, point=point):
            return 1e6 * np.sum((surface.point(*xy) - point) ** 2)

        nearest = minimize(squared, point[:2], method="Nelder-Mead", tol=1e-10)
        distance = np.sign(gap) * np.sqrt(nearest.fun) * 1e-3
        assert_allclose(gap, distance, atol=4e-6)  # [m] gap^2 over a radius of 1 m


def test_gap_agrees_with_its_definition():
    surface, (x, y) = Sphere(1.0), places(half_x=0.3, half_y=0.3)
    grid = HeightGrid.from_surface(surface, 0.3, 0.3)
    points = np.stack([x, y, np.linspace(-0.5, 0.5, x.size)], axis=-1)
    assert_allclose(grid.gap(points), surface.gap(points), rtol=COSINE, atol=1e-8)


@pytest.mark.parametrize(
    "surface",
    [
        Sphere(1.0),
        Paraboloid(-0.5, 0.5),
        KinDrape(0.3, 1.0),
        Ridge(0.015, 0.05),
        Step(),
    ],
    ids=repr,
)
@pytest.mark.parametrize("step", [0.005, 0.008])
def test_gaps_near_contact_are_the_surface_s(surface, step):
    x, y = places()
    points = surface.point(x, y)
    points[:, 2] += np.linspace(-2e-3, 2e-3, x.size)
    grid = HeightGrid.from_surface(surface, 0.4, 0.5, step)
    assert_allclose(grid.gap(points), surface.gap(points), atol=CONTACT)


def test_gaps_of_a_coarse_mesh_are_the_spline_s():
    """Slopes turn over one step at the edges between facets of 100 mm."""
    grid = HeightGrid.from_mesh(*mesh_of(Sphere(0.7), 0.3, 7))
    x, y = places(half_x=0.28, half_y=0.28)
    points = np.stack([x, y, grid.height(x, y) + 1e-3], axis=-1)
    _, zx, zy = grid.evaluate(x, y)
    expected = 1e-3 / np.sqrt(1 + zx**2 + zy**2)
    assert_allclose(grid.gap(points), expected, atol=CONTACT)


def test_gap_beside_the_mold_is_what_one_asks_for():
    """In the same pass, and by the same rule as `inside`; nodes and edges included."""
    grid = HeightGrid.from_mesh(*mesh_of(Sphere(0.7), 0.1, 31, hole=0.02))
    (x0, y0), (hx, hy) = grid.origin, grid.step
    i, j = np.indices(grid.covered.shape) + 0.0
    shift = np.random.default_rng(0).uniform(0, 1, (2, *i.shape))
    for a, b in (
        (i, j),
        (i + shift[0], j),
        (i, j + shift[1]),
        (i + shift[0], j + shift[1]),
    ):
        x, y = x0 + hx * a, y0 + hy * b
        points = np.stack([x, y, 0.1 + 0 * x], axis=-1)
        over = grid.inside(x, y)
        expected = np.where(over, grid.gap(points), 7.0)
        assert 0.1 < over.mean() < 0.9
        assert_array_equal(grid.gap(points, beside=7.0), expected)


def test_gap_goes_on_straight_beyond_the_nodes():
    grid = HeightGrid.from_surface(Paraboloid(1.2, -0.8), 0.1, 0.12)
    x, y = places(500, 0.4, 0.4)
    points = np.stack([x, y, grid.height(x, y)], axis=-1)
    assert_allclose(grid.gap(points), 0.0, atol=CONTACT)


def test_inside_respects_the_rectangle_and_the_surface():
    grid = HeightGrid.from_surface(Sphere(0.3), 0.4, 0.2, 0.01)
    inside = grid.inside([0.0, 0.29, 0.31, 0.0, 0.0], [0.0, 0.0, 0.0, 0.2, 0.201])
    assert inside.tolist() == [True, True, False, True, False]
    assert_allclose(grid.extent, (0.29, 0.2), atol=1e-6)


def mesh_of(surface, half=0.3, n=121, hole=0.0):
    """Open mesh over a square without the faces near the middle; [m]."""
    line = np.linspace(-half, half, n)
    x, y = np.meshgrid(line, line, indexing="ij")
    k = np.arange(n * n).reshape(n, n)
    a, b, c, d = (v.ravel() for v in (k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    vertices = surface.point(x, y).reshape(-1, 3)
    away = np.hypot(*vertices[faces].mean(axis=1)[:, :2].T) >= hole
    return vertices, faces[away]


def test_a_mesh_gives_the_surface_less_its_facets():
    surface, (x, y) = Sphere(1.0), places(half_x=0.3, half_y=0.3)
    grid = HeightGrid.from_mesh(*mesh_of(surface))
    off = surface.height(x, y) - grid.height(x, y)
    assert off.min() > -1e-6  # [m] facets lie below a convex surface
    assert off.max() < 1e-5  # [m] edge^2 / (4 R), edge 5 mm, and its slope
    assert_allclose(grid.normal(x, y), surface.normal(x, y), atol=5e-3)  # edge / R
    assert grid.inside(x, y).all()
    assert_allclose(grid.extent, (0.3, 0.3), atol=2e-6)


def test_holes_are_not_the_mold_and_are_bridged_smoothly():
    surface = Paraboloid(1.0, -1.5)
    grid = HeightGrid.from_mesh(*mesh_of(surface, hole=0.05))
    x, y = places(half_x=0.3, half_y=0.3)
    r = np.hypot(x, y)
    inside = grid.inside(x, y)
    assert not inside[r < 0.043].any()
    assert inside[r > 0.062].all()  # a cell's diagonal of 7 mm and a face beyond
    assert_allclose(grid.height(x, y), surface.height(x, y), atol=3e-4)  # r^2 / (8 R)
    assert_allclose(
        grid.height(x, y)[r > 0.062], surface.height(x, y)[r > 0.062], atol=2e-5
    )


def test_a_mesh_goes_on_straight_beyond_its_outline():
    grid = HeightGrid.from_mesh(*mesh_of(Paraboloid(1.0, 1.0)))
    x = 0.3 + np.linspace(0, 0.1, 50)
    straight = -(0.3**2) / 2 - 0.3 * (x - 0.3)
    assert_allclose(grid.height(x, 0 * x), straight, atol=8e-4)  # [m] slope of a facet
    assert not grid.inside(x[1:], 0 * x[1:]).any()


def test_a_solid_block_shows_its_top():
    box = trimesh.creation.box(extents=(0.4, 0.3, 0.2))
    grid = HeightGrid.from_mesh(np.asarray(box.vertices), np.asarray(box.faces))
    x, y = places(half_x=0.1999, half_y=0.1499)
    assert_allclose(grid.height(x, y), 0.1, atol=HEIGHT)
    assert grid.inside(x, y).all()


def test_meshes_that_show_nothing_are_refused():
    vertices, faces = mesh_of(Paraboloid(1.0, 1.0), n=5)
    upright = vertices[:, [0, 2, 1]] * [1, 0, 1]
    with pytest.raises(InputError, match="outline has no width"):
        HeightGrid.from_mesh(upright, faces)
    box = trimesh.creation.box()
    walls = np.asarray(box.faces)[abs(box.face_normals[:, 2]) < 0.5]
    with pytest.raises(InputError, match="no face looks up"):
        HeightGrid.from_mesh(np.asarray(box.vertices), walls)


def test_a_grid_beyond_reason_is_refused():
    with pytest.raises(InputError, match="use a coarser step"):
        HeightGrid.from_surface(Sphere(50.0), 10.0, 10.0, 0.001)


@pytest.mark.parametrize("source", ["surface", "mesh"])
def test_data_give_back_the_same_grid_to_the_last_bit(source):
    if source == "surface":
        grid = HeightGrid.from_surface(Sphere(0.7), 0.11, 0.13, 0.007)
    else:
        grid = HeightGrid.from_mesh(*mesh_of(Sphere(0.7), 0.1, 31, hole=0.02))
    text = json.dumps(grid.to_data())
    again = HeightGrid.from_data(json.loads(text))
    x, y = places(half_x=0.15, half_y=0.15)
    for a, b in zip(grid.evaluate(x, y), again.evaluate(x, y), strict=True):
        assert_array_equal(a, b)
    assert_array_equal(grid.inside(x, y), again.inside(x, y))
    assert json.dumps(again.to_data()) == text


def test_example_molds_are_what_their_script_makes():
    spec = importlib.util.spec_from_file_location("make_molds", MOLDS / "make_molds.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    for name, make in script.MOLDS.items():
        vertices, faces = read_mesh(MOLDS / name, "mm")
        made = np.asarray(make().triangles) * 1e-3
        assert_allclose(vertices[faces], made, atol=1e-7)  # [m] single precision
        assert (MOLDS / name).stat().st_size < 2e6


def test_the_panel_has_its_radii_and_size():
    vertices, faces = read_mesh(MOLDS / "panel.stl", "mm")
    assert_allclose(np.ptp(vertices[:, :2], axis=0), (0.8, 1.0), atol=1e-7)
    grid = HeightGrid.from_mesh(vertices, faces)
    x, y = places()
    exact = np.sqrt(1.2**2 - x**2) - 1.2 + np.sqrt(2.5**2 - y**2) - 2.5
    assert_allclose(grid.height(x, y), exact, atol=2e-5)  # [m] facets of 8 x 10 mm
    assert_allclose(grid.height(0, 0), 0, atol=2e-6)
