"""Known answers of the front check, cup poses fed to it directly.

Ply, mold and front are the product's; molds are analytic unless a test says mesh.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

from drapeplan.front_grid import FrontGrid
from drapeplan.lift import WeightedSum
from drapeplan.mold import HeightGrid
from drapeplan.refine import MOVED, Stops, judge_between
from drapeplan.surfaces import AbstractSurface, Paraboloid, Plane, Ridge
from drapeplan.verdict import EventKind, Tolerance
from ply.grid import CupGrid
from ply.sampling import PlySampling
from ply.shape import ply_fibers
from tests.plans import scene, stages

MM = 1e-3
SAME = 1e-12  # [m] float64 noise of sums at ply scale, far below any margin
MESHED = 0.05e-3  # [m] a mesh of 5 mm facets, read at nodes that moved with it
SAMPLED = 0.15e-3  # [m] margins with samples of 10 mm, against four times as many
AREA = 0.05  # [-] of a pocket's area: a sample's cell at its rim
TAKE_UP = 0.4e-3  # [m] the default of scenes
CUPS = CupGrid(rows=8, columns=6, pitch=0.11, half_width=0.02)
PLY = PlySampling.regular(CUPS, 0.01, 0.02)
NAMES = ("premature_margin", "air_margin", "span_penetration", "pad_penetration")


@dataclass(frozen=True)
class Case:
    """A path over a mold: K poses of n cups.

    Attributes:
        mold: The mold.
        sampling: The ply's samples.
        positions: Cup positions, shape (K, n, 3), in [m].
        rotations: Cup rotations, shape (K, n, 3, 3).
        placed: Placed cups, shape (K, n).
        landing: Landing cups, shape (K, n).
        start: Index of the start cup.
    """

    mold: AbstractSurface
    sampling: PlySampling
    positions: np.ndarray
    rotations: np.ndarray
    placed: np.ndarray
    landing: np.ndarray
    start: int

    def gap(self, positions, rotations):
        """Gaps of the ply, shape (K, nt, ns), in [m]."""
        poses, grid = (positions, rotations), self.sampling.grid
        fibers = ply_fibers(grid, *poses, model="cubic", take_up=TAKE_UP)
        return self.mold.gap(self.sampling.points(fibers, *poses))

    def verdict(self, final_gap=None):
        """Verdict with what happens between; by default the last pose is laid."""
        ply, poses = self.sampling, (self.positions, self.rotations)
        cups = ply.cup_index, ply.cups_around, ply.grid.columns, self.start
        grid, gap = FrontGrid(ply.s, ply.t, *cups), self.gap(*poses)
        return judge_between(
            Stops.at_waypoints(poses, self.placed, self.landing),
            gap,
            gap[-1] if final_gap is None else final_gap,
            grid,
            Tolerance(),
            lambda stops, new: self.gap(*stops.some(new).poses),
        )


def flat_case(heights, placed, start, mold=None):
    """One pose of level cups at heights, shape (n,), in [m], over a plane."""
    positions = np.concatenate([CUPS.centers, heights[:, None]], axis=1)[None]
    rotations = np.tile(np.eye(3), (1, CUPS.n_cups, 1, 1))
    nothing = np.zeros((1, CUPS.n_cups), bool)
    mold = mold or Plane()
    return Case(mold, PLY, positions, rotations, placed[None], nothing, start)


def cup_ring(low, high):
    """Cups whose rows and columns lie in closed ranges, shape (n,)."""
    i, j = np.divmod(np.arange(CUPS.n_cups), CUPS.columns)
    return (low[0] <= i) & (i <= high[0]) & (low[1] <= j) & (j <= high[1])


def ramp(height):
    """Way from a placed cup's edge to where a lifted neighbor's ply stops touching."""
    u = brentq(lambda u: height * (3 * u**2 - 2 * u**3) - Tolerance().touch, 0, 1)
    return u * CUPS.span


# ---------------------------------------------------------------- known answers


@pytest.mark.parametrize("height", [5 * MM, 20 * MM, 60 * MM])
def test_border_first_traps_one_pocket_of_the_area_inside(height):
    inside = cup_ring((1, 1), (6, 4))
    case = flat_case(np.where(inside, height, 0.0), ~inside, start=0)
    verdict = case.verdict(0.0 * PLY.cup_index)
    (pocket,) = verdict.events
    assert pocket.kind is EventKind.AIR_POCKET
    sides = (n * CUPS.pitch - 2 * CUPS.half_width - 2 * ramp(height) for n in (7, 5))
    assert pocket.area == pytest.approx(np.prod(list(sides)), rel=AREA)
    assert pocket.depth == pytest.approx(height, rel=0.2)
    assert verdict.air_margin[0] == pytest.approx(-Tolerance().touch, abs=SAME)


def test_one_far_cup_down_is_premature_and_traps_nothing():
    heights = np.full(CUPS.n_cups, 30 * MM)
    start, far = 21, 47
    heights[[start, far]] = 0.0
    placed = np.arange(CUPS.n_cups) == start
    verdict = flat_case(heights, placed, start).verdict(0.0 * PLY.cup_index)
    (event,) = verdict.events
    assert event.kind is EventKind.PREMATURE
    assert event.cup == (7, 5)
    corner = CUPS.half_width * 2 + ramp(30 * MM)  # to the ply's edge on two sides
    assert event.area == pytest.approx((corner + 0.02) ** 2, rel=0.25)


def test_a_start_cup_lifted_inside_placed_rings_traps_a_pocket():
    start, ring = 21, cup_ring((2, 2), (4, 4))
    heights = np.where(ring, 0.0, 30 * MM)
    placed = ring.copy()
    heights[start], placed[start] = 10 * MM, False
    verdict = flat_case(heights, placed, start).verdict(0.0 * PLY.cup_index)
    (pocket,) = (e for e in verdict.events if e.kind is EventKind.AIR_POCKET)
    side = 2 * CUPS.pitch - 2 * CUPS.half_width - 2 * ramp(10 * MM)
    assert pocket.cup == (3, 3)
    assert pocket.area == pytest.approx(side**2, rel=2 * AREA)  # its corners are round


def test_a_flat_ply_pushed_through_a_concave_mold_penetrates():
    """Every sample is in the mold: that hangs together, and depth alone tells."""
    bowl = Paraboloid(-1.0, -1.0)
    center = np.array([0.275, 0.385])
    nobody = np.zeros(CUPS.n_cups, bool)
    case = flat_case(np.full(CUPS.n_cups, -10 * MM), nobody, 21, bowl)
    shifted = replace(case, positions=case.positions - [*center, 0.0])
    verdict = shifted.verdict(0.0 * PLY.cup_index)
    assert verdict.in_order
    assert verdict.penetrates
    r = np.hypot(0.275 + 0.04, 0.385 + 0.04)  # the ply's corner
    deepest = (10 * MM + r**2 / 2) / np.sqrt(1 + r**2)
    assert verdict.span_penetration[0] == pytest.approx(deepest, abs=SAME)
    assert {event.kind for event in verdict.events} == {EventKind.PENETRATION}


# ---------------------------------------------------------------- invariance


class Mapped(AbstractSurface):
    """A surface turned, mirrored and moved: f(A xy + b) + c."""

    def __init__(self, surface, A, b=(0.0, 0.0), c=0.0):
        """Take the surface and the map."""
        self.surface, self.A, self.b, self.c = surface, np.array(A, float), b, c

    def evaluate(self, x, y):
        """Height and slopes."""
        (p, q), (r, s) = self.A
        u, v = p * x + q * y + self.b[0], r * x + s * y + self.b[1]
        z, zu, zv = self.surface.evaluate(u, v)
        return z + self.c, p * zu + r * zv, q * zu + s * zv


@pytest.fixture(scope="module")
def uneven():
    """A wave with errors of poses over a mold without symmetry."""
    cell, sequence, _, wave = stages(scene())
    bumps = WeightedSum(((1.0, cell.mold), (0.05, Ridge(0.05, 0.09, 0.03))))
    rng = np.random.default_rng(4)
    some = slice(2, None, 3)
    positions = wave.positions[some].copy()
    free = ~wave.placed[some]
    positions[free] += rng.normal(size=(int(free.sum()), 3)) * 0.5 * MM
    rotations = wave.rotations[some].copy()
    positions[1:9, 47] = wave.positions[-1, 47]  # a level dip far away, to 0..2 mm
    positions[1:9, 47, 2] += np.linspace(0, 2, 8) * MM
    rotations[1:9, 47] = wave.rotations[-1, 47]
    case = Case(
        bumps,
        cell.sampling,
        positions,
        rotations,
        wave.placed[some],
        wave.landing[some],
        sequence.index(sequence.start_cup),
    )
    found = case.verdict()
    assert found.premature_margin.min() < 3 * MM
    assert found.span_penetration.max() > 0.1 * MM
    return case, found


def assert_same(found, expected, tolerance=SAME):
    """All measures of all poses agree."""
    for name in NAMES:
        assert_allclose(getattr(found, name), getattr(expected, name), atol=tolerance)
    if tolerance == SAME:
        assert found.poses_between == expected.poses_between


def reordered(case, index, columns, **changes):
    """The case with cups counted anew; index: old cup of each new one."""
    rows = len(index) // columns
    small = CupGrid(rows, columns, CUPS.pitch, CUPS.half_width)
    arrays = {
        name: getattr(case, name)[:, index]
        for name in ("positions", "rotations", "placed", "landing")
    }
    start = int(np.flatnonzero(index == case.start)[0])
    sampling = PlySampling.regular(small, 0.01, 0.02)
    return replace(case, sampling=sampling, start=start, **arrays | changes)


def test_a_mirrored_plan_keeps_its_margins(uneven):
    """Columns run the other way, so that s, t and n stay right-handed."""
    case, expected = uneven
    index = np.arange(48).reshape(8, 6)[:, ::-1].ravel()
    mirror = np.diag([-1.0, 1.0, 1.0])
    turned = mirror @ case.rotations[:, index] * [-1.0, 1.0, 1.0]
    mold = Mapped(case.mold, mirror[:2, :2])
    positions = case.positions[:, index] @ mirror
    other = reordered(case, index, 6, mold=mold, positions=positions, rotations=turned)
    assert_allclose(np.linalg.det(turned), 1.0)
    assert_same(other.verdict(), expected)


def test_a_ply_turned_by_90_degrees_keeps_its_margins(uneven):
    """Rows become columns: s runs along t, and t against s."""
    case, expected = uneven
    index = np.arange(48).reshape(8, 6).T[::-1].ravel()  # new (row, column): old cup
    frames = case.rotations[:, index]
    turned = np.stack([frames[..., 1], -frames[..., 0], frames[..., 2]], axis=-1)
    other = reordered(case, index, 8, rotations=turned)
    assert_same(other.verdict(), expected)


@pytest.mark.parametrize("angle", [90.0, 33.0])
def test_a_plan_moved_with_its_mold_keeps_its_margins(uneven, angle):
    case, expected = uneven
    assert_same(moved_case(case, angle).verdict(), expected)


def moved_case(case, angle, shift=(0.3, -0.2, 0.1)):
    """Mold and cups turned about z, by an angle in degrees, and moved."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    back = turn[:2, :2].T
    mold = Mapped(case.mold, back, -back @ shift[:2], shift[2])
    positions = case.positions @ turn.T + shift
    return replace(
        case, mold=mold, positions=positions, rotations=turn @ case.rotations
    )


def test_a_plan_moved_with_a_mesh_keeps_its_margins(uneven):
    """Facets stay what they are; rays hit them at other places."""
    case, expected = uneven
    x, y = np.meshgrid(np.linspace(-0.4, 0.4, 161), np.linspace(-0.5, 0.5, 201))
    k = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (v.ravel() for v in (k[:-1, :-1], k[:-1, 1:], k[1:, 1:], k[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    vertices = case.mold.point(x, y).reshape(-1, 3)
    still = replace(case, mold=HeightGrid.from_mesh(vertices, faces)).verdict()
    assert_same(still, expected, MESHED)
    moved = moved_case(case, 33.0, (0.3013, -0.2027, 0.1))
    turn = moved.rotations[0, 0] @ case.rotations[0, 0].T
    mesh = vertices @ turn.T + [0.3013, -0.2027, 0.1]
    there = replace(moved, mold=HeightGrid.from_mesh(mesh, faces)).verdict()
    assert_same(there, still, MESHED)


def test_four_times_as_many_samples_move_no_margin(uneven):
    """Those near contact; far ones decide nothing, and are at another place."""
    case, _ = uneven
    poses = [0, 1, 3, 5, 8, 11, 15, -1]
    names = ("positions", "rotations", "placed", "landing")
    case = replace(case, **{name: getattr(case, name)[poses] for name in names})
    expected = case.verdict()
    fine = PlySampling.regular(CUPS, 0.0025, 0.02)
    found = replace(case, sampling=fine).verdict()
    near = expected.premature_margin < 5 * MM
    assert near.sum() >= 4
    for name in NAMES[:2]:
        pair = (np.minimum(getattr(v, name), 5 * MM) for v in (found, expected))
        assert_allclose(*pair, atol=SAMPLED)


def test_four_times_as_many_waypoints_tell_the_same(uneven):
    """What is found between waypoints stands for all that is there."""
    case, _ = uneven
    names = ("positions", "rotations", "placed", "landing")
    poses = [*range(12), -1]
    case = replace(case, **{name: getattr(case, name)[poses] for name in names})
    expected = case.verdict()
    rough = Stops.at_waypoints(
        (case.positions, case.rotations), case.placed, case.landing
    )
    quarters = np.arange(0, len(case.placed) - 1, 0.25)
    dense, _ = rough.joined(rough.between(quarters[quarters % 1 > 0]))
    found = replace(case, **{name: getattr(dense, name) for name in names}).verdict()
    assert found.passed == expected.passed
    assert {e.kind for e in found.events} == {e.kind for e in expected.events}
    for name, of in zip(NAMES, (np.min, np.min, np.max, np.max), strict=True):
        pair = (np.minimum(of(getattr(v, name)), 5 * MM) for v in (found, expected))
        assert_allclose(*pair, atol=MOVED)
