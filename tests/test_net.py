from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from drapeplan.errors import InfeasibleError
from drapeplan.geodesic import geodesic_net
from drapeplan.mold import HeightGrid
from drapeplan.net import frame_net, least_shear_net, nearest_net
from drapeplan.shear import corner_shear
from drapeplan.surfaces import (
    AbstractSurface,
    Cylinder,
    KinDrape,
    Paraboloid,
    Plane,
    Ridge,
    Sphere,
    Step,
)

ROWS, COLUMNS, PITCH = 8, 6, 0.11
LINK = 1e-11  # [m] float64 noise after the last Newton step
PLACE = 1e-9  # [m] step at which the nets stop
ANGLE = 1e-9  # [rad] that step over the pitch

MOLDS = [
    Plane(),
    Paraboloid(1.2, 2.5),
    Paraboloid(-1.0, -1.0),
    Paraboloid(-1.5, 1.8),
    Sphere(1.0),
    Cylinder(0.5),
    KinDrape(0.3, 1.0),
    Ridge(),
    Step(),
]
radii = st.floats(0.8, 6) | st.floats(-6, -0.8)


@dataclass(frozen=True)
class Lifted(AbstractSurface):
    """A mold with its far sides lifted by c d^2, as a wave lifts them."""

    mold: AbstractSurface
    front: float
    c: float = 0.4

    def evaluate(self, x, y):
        z, zx, zy = self.mold.evaluate(x, y)
        dx = np.sign(x) * np.maximum(0, abs(x) - self.front)
        dy = np.sign(y) * np.maximum(0, abs(y) - self.front)
        c = self.c
        return z + c * (dx**2 + dy**2), zx + 2 * c * dx, zy + 2 * c * dy


def least(surface, *args, **keys):
    """Least-shear net of the default tool's size."""
    return least_shear_net(surface, ROWS, COLUMNS, PITCH, *args, **keys)


def link_error(net):
    """Largest link error, measured anew, in [m]."""
    p = net.positions.reshape(net.rows, net.columns, 3)
    s, t = np.diff(p, axis=1).reshape(-1, 3), np.diff(p, axis=0).reshape(-1, 3)
    return abs(np.linalg.norm(np.concatenate([s, t]), axis=1) - PITCH).max()


def shear_energy(positions):
    """Sum of squared corner cosines."""
    return np.sum(np.sin(corner_shear(positions.reshape(ROWS, COLUMNS, 3))) ** 2)


@given(
    radius_x=radii,
    radius_y=radii,
    x=st.floats(-0.05, 0.05),
    y=st.floats(-0.05, 0.05),
    warp=st.floats(-3, 3),
)
@settings(max_examples=25, deadline=None)
def test_least_shear_nets_keep_links_anchor_and_warp(radius_x, radius_y, x, y, warp):
    surface = Paraboloid(radius_x, radius_y)
    net = least(surface, (x, y), warp=warp)
    assert net.converged
    assert link_error(net) < LINK
    assert net.residual < LINK
    assert_allclose(net.positions, surface.point(*net.xy.T), atol=LINK)
    assert_allclose(net.xy.mean(axis=0), (x, y), atol=LINK)
    rows = net.xy.reshape(ROWS, COLUMNS, 2)
    s = (rows[:, -1] - rows[:, 0]).sum(axis=0)
    assert_allclose(s / np.hypot(*s), (np.cos(warp), np.sin(warp)), atol=ANGLE)


def test_an_anchor_cup_meets_its_point():
    net = least(KinDrape(0.3, 1.0), (0.02, -0.03), anchor_cup=(3, 2), warp=0.1)
    assert_allclose(net.xy[3 * COLUMNS + 2], (0.02, -0.03), atol=LINK)


@pytest.mark.parametrize("mold", MOLDS, ids=repr)
def test_no_net_nearby_has_less_shear(mold):
    """Steps along the constraints' null space raise the energy both ways."""
    net = least(mold)
    grown = geodesic_net(mold, ROWS, COLUMNS, PITCH, (4, 3), net.xy[27], within=False)
    energy = shear_energy(net.positions)
    assert energy <= shear_energy(grown) + 1e-12
    size = 1e-3  # [m] energy is flat to first order: its change is of second
    for seed in range(3):
        noise = np.random.default_rng(seed).normal(0, size, net.xy.shape)
        moved = nearest_net(
            mold, net.xy + noise, ROWS, COLUMNS, PITCH, np.zeros(48, bool)
        )
        assert moved.converged
        assert energy <= shear_energy(moved.positions) + 1e-12


def test_least_shear_is_symmetric_where_the_mold_is():
    net = least(Paraboloid(1.0, 1.7))
    xy = net.xy.reshape(ROWS, COLUMNS, 2)
    assert_allclose(xy[:, ::-1] * [-1, 1], xy, atol=10 * PLACE)
    assert_allclose(xy[::-1] * [1, -1], xy, atol=10 * PLACE)
    shear = corner_shear(net.positions.reshape(ROWS, COLUMNS, 3))
    assert_allclose(shear[::-1, ::-1][..., [2, 3, 0, 1]], shear, atol=100 * ANGLE)
    assert net.shear == pytest.approx(abs(shear).max())


def test_a_flat_net_is_a_square_grid():
    net = least(Plane(), (0.1, 0.2))
    i, j = np.indices((ROWS, COLUMNS)).reshape(2, -1)
    expected = np.stack([PITCH * (j - 2.5) + 0.1, PITCH * (i - 3.5) + 0.2], axis=-1)
    assert_allclose(net.xy, expected, atol=LINK)
    assert_allclose(net.rotations, np.broadcast_to(np.eye(3), (48, 3, 3)), atol=LINK)
    assert net.shear < ANGLE


@pytest.mark.parametrize("radius", [0.5, 0.4, 0.35])
def test_nets_exist_down_to_small_spheres(radius):
    net = least(Sphere(radius))
    assert link_error(net) < LINK


def test_nets_lie_on_grids_as_on_their_surfaces():
    surface = Paraboloid(1.2, 2.5)
    grid = HeightGrid.from_surface(surface, 0.4, 0.5)
    assert_allclose(least(grid).xy, least(surface).xy, atol=1e-6)  # [m] heights 1e-9
    assert link_error(least(grid)) < LINK


@pytest.mark.parametrize("mold", MOLDS, ids=repr)
def test_frames_are_orthonormal_with_symmetric_shear(mold):
    net = least(mold, warp=0.2)
    s, t, n = np.moveaxis(net.rotations, -1, 0)
    assert_allclose(np.cross(s, t), n, atol=1e-12)
    assert_allclose(
        np.swapaxes(net.rotations, 1, 2) @ net.rotations, [np.eye(3)] * 48, atol=1e-12
    )
    assert_array_equal(n, net.normals)
    assert_allclose(n, mold.normal(*net.xy.T), atol=1e-12)
    p = net.positions.reshape(ROWS, COLUMNS, 3)
    along_s, along_t = p[1:-1, 2:] - p[1:-1, :-2], p[2:, 1:-1] - p[:-2, 1:-1]
    inner = (slice(1, -1), slice(1, -1))
    s, t, n = (v.reshape(ROWS, COLUMNS, 3)[inner] for v in (s, t, n))
    turn_s = np.sum(np.cross(s, along_s) * n, axis=-1) / np.sum(s * along_s, axis=-1)
    turn_t = np.sum(np.cross(t, along_t) * n, axis=-1) / np.sum(t * along_t, axis=-1)
    assert_allclose(turn_s, -turn_t, atol=1e-3)  # [rad] chords against unit chords


@pytest.mark.parametrize("mold", MOLDS, ids=repr)
def test_nearest_nets_exist_on_lifted_molds_with_placed_cups_pinned(mold):
    target = least(mold)
    i, j = np.divmod(np.arange(48), COLUMNS)
    placed = (abs(i - 3.5) < 2) & (abs(j - 2.5) < 1)
    front = abs(target.xy[placed]).max() + 0.02
    lifted = Lifted(mold, front)
    net = nearest_net(lifted, target.xy, ROWS, COLUMNS, PITCH, placed)
    assert net.converged
    assert link_error(net) < LINK
    assert_array_equal(net.xy[placed], target.xy[placed])
    assert_array_equal(net.normals, lifted.normal(*net.xy.T))
    assert abs(net.xy - target.xy).max() < 0.02  # [m] it follows the previous net


def test_nearest_nets_are_nearest():
    """The move is a combination of link gradients: no component along the net."""
    mold, placed = Lifted(Paraboloid(1.0, 2.0), 0.15), np.zeros(48, bool)
    previous = least(Paraboloid(1.0, 2.0)).xy
    net = nearest_net(mold, previous, ROWS, COLUMNS, PITCH, placed)
    moved = np.sum((net.xy - previous) ** 2)
    for seed in range(5):
        noise = np.random.default_rng(seed).normal(0, 1e-3, net.xy.shape)
        other = nearest_net(mold, net.xy + noise, ROWS, COLUMNS, PITCH, placed)
        assert other.residual < LINK
        assert moved <= np.sum((other.xy - previous) ** 2) + 1e-12


def test_a_net_is_nearest_to_itself():
    mold = KinDrape(0.3, 1.0)
    target = least(mold)
    placed = np.arange(48) == 20
    net = nearest_net(mold, target.xy, ROWS, COLUMNS, PITCH, placed)
    assert_allclose(net.xy, target.xy, atol=PLACE)


def test_offsets_raise_cups_and_tighten_the_plan_view():
    flat = least(Plane())
    offsets = np.where(np.arange(48) % COLUMNS > 3, 0.03, 0.0)
    placed = np.arange(48) % COLUMNS < 2
    net = nearest_net(Plane(), flat.xy, ROWS, COLUMNS, PITCH, placed, offsets)
    assert net.converged
    assert link_error(net) < LINK
    assert_allclose(net.positions[:, 2], offsets)
    run = np.diff(net.xy.reshape(ROWS, COLUMNS, 2)[:, 3:5, 0], axis=1)
    assert_allclose(run, np.sqrt(PITCH**2 - 0.03**2), atol=1e-3)


def test_contradictions_come_back_as_a_residual():
    """All but one cup pinned a little off, or all of them: nothing raises."""
    flat = least(Plane())
    shifted = flat.xy.copy()
    shifted[0] += 0.003
    everything = np.ones(48, bool)
    net = nearest_net(Plane(), shifted, ROWS, COLUMNS, PITCH, everything)
    assert net.residual > 1e-3
    assert_array_equal(net.xy, shifted)
    inner = everything.copy()
    inner[20] = False
    shifted[[14, 19]] -= 0.002
    net = nearest_net(Plane(), shifted, ROWS, COLUMNS, PITCH, inner)
    assert not net.converged
    assert net.residual > 1e-3
    assert np.isfinite(net.xy).all()


def test_redundant_links_that_agree_converge():
    """One free cup among four pinned ones has four links and two coordinates."""
    flat = least(Plane())
    placed = np.ones(48, bool)
    placed[20] = False
    start = flat.xy.copy()
    start[20] += 0.004
    net = nearest_net(Plane(), start, ROWS, COLUMNS, PITCH, placed)
    assert_allclose(net.xy, flat.xy, atol=1e-8)


def test_what_cannot_be_draped_is_infeasible():
    with pytest.raises(InfeasibleError) as failure:
        least(Sphere(0.2))
    assert failure.value.remedy
    with pytest.raises(InfeasibleError, match=r"cup \(0, 0\) would land off the mold"):
        least(KinDrape(0.3, 0.7))


def test_a_frame_net_of_two_by_two_works():
    net = least_shear_net(Sphere(1.0), 2, 2, PITCH)
    assert net.residual < LINK
    again = frame_net(Sphere(1.0), net.xy, 2, 2, PITCH)
    assert_array_equal(again.rotations, net.rotations)
