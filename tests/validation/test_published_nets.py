"""Shear of geodesic-grown nets against the sphere's equation and KinDrape."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from drapeplan.geodesic import geodesic_net, strip_net
from drapeplan.shear import cell_shear, node_shear
from drapeplan.surfaces import KinDrape, Sphere

SPHERE = 0.05  # [deg] asked of the sphere table; 0.005 is met at 60 nodes a radius
TABLE = 0.001  # [deg] the table's last digit and rounding
PUBLISHED = 0.02  # [-] asked of KinDrape's figures; 0.002 is met
STEPS = 60  # [-] nodes a radius; divisible so that every u v of the table is a node

# Node (row, column) with u v / R^2 = row * column / STEPS^2, and its shear in [deg].
SHEAR = {
    (18, 20): 5.726,
    (24, 30): 11.434,
    (30, 36): 17.103,
    (40, 45): 28.257,
    (45, 56): 39.051,
    (60, 60): 54.318,
}


@pytest.fixture(scope="module", params=[(-0.42, -0.42, -0.1), (-0.45, -0.4, -0.2)])
def sphere_net(request):
    """Net that fills a quadrant of a unit sphere, two nodes beyond u = v = 1."""
    *origin, heading = request.param
    chord = 2 * np.sin(1 / STEPS / 2)
    size = STEPS + 2
    return geodesic_net(Sphere(1.0), size, size, chord, (0, 0), origin, heading)


def test_sphere_table(sphere_net):
    """Central corner means, second order in the spacing, wherever the net starts."""
    shear = np.degrees(node_shear(sphere_net))
    found = [shear[node] for node in SHEAR]
    assert_allclose(found, list(SHEAR.values()), atol=SPHERE)


def test_sphere_table_solves_the_equation_of_chebyshev_nets():
    """w_uv = -sin(w) / R^2, w = pi / 2 on both arms: w(z), z = u v / R^2, of one ODE.

    Shear is pi / 2 - w, and z w'' + w' = -sin(w) starts with w' = -1.
    """

    def slope(z, w):
        return [w[1], -(np.sin(w[0]) + w[1]) / z]

    z = np.array([i * j for i, j in SHEAR]) / STEPS**2
    start = 1e-8
    w = solve_ivp(
        slope, (start, 1), [np.pi / 2 - start, -1], t_eval=z, rtol=1e-10, atol=1e-12
    ).y[0]
    assert_allclose(90 - np.degrees(w), list(SHEAR.values()), atol=TABLE)


@pytest.mark.parametrize(
    ("surface", "nodes", "spacing", "node", "xy", "largest", "mean"),
    [
        (KinDrape(), 21, 0.022, (10, 10), (0.0, 0.0), 20.10, 1.77),
        (KinDrape(), 21, 0.022, (0, 0), (-0.22, -0.22), 17.53, 7.95),
        (Sphere(1.0), 24, 0.075, (11, 11), (-0.0375, -0.0375), 38.02, 10.53),
    ],
    ids=["generic from the middle", "generic from the corner", "hemisphere"],
)
def test_kindrape_cell_shear(surface, nodes, spacing, node, xy, largest, mean):
    """Nets of generator strips, as KinDrape grows them from the same first node."""
    net = strip_net(surface, nodes, nodes, spacing, node, xy)
    shear = np.degrees(abs(cell_shear(net)))
    assert_allclose(shear.max(), largest, rtol=PUBLISHED)
    assert_allclose(shear.mean(), mean, rtol=PUBLISHED)


def test_nets_of_strips_and_of_lines_agree_in_the_limit():
    """On the hemisphere, strips at twice the spacing are every other node of lines."""
    half = 2 * np.sin(np.arcsin(0.0375) / 2)
    fine = geodesic_net(Sphere(1.0), 47, 47, half, (23, 23), (0.0, 0.0))
    shear = np.degrees(abs(cell_shear(fine[::2, ::2])))
    assert_allclose([shear.max(), shear.mean()], [38.02, 10.53], rtol=PUBLISHED)
