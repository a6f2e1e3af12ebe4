from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drapeplan.arm_clearance import _grounds
from drapeplan.body_pairs import (
    GroundPairs,
    LegGroundPairs,
    LegPairs,
    SolidPairs,
    _segments,
)
from drapeplan.cell import build_cell, read_sources
from drapeplan.clearance import (
    FINE,
    AbstractPairs,
    AbstractPath,
    Moments,
    between,
    least_clearance,
    travel,
)
from drapeplan.scene import read_scene
from drapeplan.solids import Legs, arm_solids, herd, table_prism
from tests.plans import EXAMPLES
from urdf.arm import read_arm

EXACT = 1e-12  # [m] float64 at 1 m
TOUCH = 2e-5  # [m] GJK stops at 1e-6, and at overlaps EPA at 1e-5
MANY = 400  # [-] looks between two waypoints: joints turn by less than 0.3 deg
CHAIN, LINKS = arm_solids(read_arm("ur10"))
COLLISION = [(a, b) for a in LINKS for b in LINKS if b.joint > a.joint + 1]


class ArmPath(AbstractPath):
    """The arm alone, or with two legs that stand out of its flange."""

    def __init__(self, q):
        """Keep the waypoints, shape (K, 6), in [rad]."""
        self.q, self.count = q, len(q)

    def __call__(self, k, share):
        frames = CHAIN.frames(between(self.q, k, share))
        tool = frames[:, -1] @ CHAIN.tip
        local = np.array(
            [[[0.3, 0, 0.0], [0.3, 0, 0.3]], [[-0.3, 0.1, 0], [-0.3, 0, 0.2]]]
        )
        turned = np.einsum("mij,naj->mnai", tool[:, :3, :3], local)
        return Moments(frames, lambda: turned + tool[:, None, None, :3, 3])


def swing(seed, count=4):
    """Waypoints of an arm near its home posture."""
    home = np.array([0, -1.2, 1.6, -1.97, -1.57, 0])
    return home + np.random.default_rng(seed).uniform(-0.9, 0.9, (count, 6))


def brute(pairs, path):
    """The least distance over many moments, all of them exact."""
    k = np.repeat(np.arange(path.count - 1), MANY)
    share = np.tile(np.linspace(0, 1, MANY), path.count - 1)
    p = len(pairs.names)
    rows, pair = (x.ravel() for x in np.indices((len(k), p)))
    return pairs.distances(path(k, share), rows, pair, np.inf).min()


def legs_for(path):
    legs = Legs(np.full(2, 0.01), np.zeros((2, 2)), np.zeros((2, 2)), 0.3)
    far = float(np.linalg.norm(CHAIN.tip[:3, 3])) + 0.5
    return legs, travel(CHAIN, path.q, 0, 6, far)[:, None] * np.ones(2), far


def ground_tree():
    place = np.eye(4)
    place[:3, 3] = 0.6, 0.1, 0.25
    return herd(table_prism(np.array([0.5, 0.5]), place))


def arm_pairs(path):
    return SolidPairs(CHAIN, path.q, COLLISION)


def table_pairs(path):
    return GroundPairs(CHAIN, path.q, list(LINKS), "table", ground_tree())


def leg_pairs(path):
    legs, _, far = legs_for(path)
    moves = [
        travel(CHAIN, path.q, s.joint, 6, far)[:, None] * [1, 1] for s in LINKS[:5]
    ]
    return LegPairs(["leg a", "leg b"], legs, list(LINKS[:5]), np.stack(moves, axis=1))


def leg_table_pairs(path):
    legs, motion, _ = legs_for(path)
    names = [("leg a", "table"), ("leg b", "table")]
    none = lambda points: np.full(points.shape[:-1], -1.0)  # noqa: E731
    return LegGroundPairs(names, legs, none, ground_tree(), motion, np.inf)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("make", [arm_pairs, table_pairs, leg_pairs, leg_table_pairs])
def test_the_least_clearance_is_found_between_waypoints(make, seed):
    path = ArmPath(swing(seed, count=3))
    pairs = make(path)
    found, truth = least_clearance(pairs, path), brute(pairs, path)
    assert found.distance >= truth - FINE - TOUCH
    assert found.distance <= truth + FINE + TOUCH
    k, share = np.array([found.waypoint]), np.array([found.share])
    pair = np.array([pairs.names.index(found.between)])
    there = pairs.distances(path(k, share), np.array([0]), pair, np.inf)
    assert there[0] == pytest.approx(found.distance, abs=TOUCH)


class Pendulum(AbstractPairs, AbstractPath):
    """A point that passes another at a depth, halfway between two waypoints."""

    def __init__(self, depth):
        """Keep the depth, in [m]."""
        self.depth, self.count = depth, 2
        self.names, self.motion = [("a", "b")], np.array([[2.0]])
        self.asked = 0

    def __call__(self, k, share):
        return Moments(np.asarray(k + share), lambda: np.zeros(0))

    def distances(self, moments, rows, pairs, limit):
        self.asked += len(rows)
        return np.hypot(2 * (moments.frames[rows] - 0.437), self.depth)


@given(depth=st.floats(0, 0.5))
def test_a_dip_far_from_any_waypoint_is_found(depth):
    pendulum = Pendulum(depth)
    found = least_clearance(pendulum, pendulum)
    assert depth - EXACT <= found.distance <= depth + FINE
    assert pendulum.asked < 150  # 2000 even looks would be needed


@settings(deadline=None)
@given(st.integers(0, 10**6))
def test_segments_against_many_points(seed):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, 1, 2, 3))
    if seed % 3 == 0:
        b = a + [0, 0.3, 0] + 0.4 * (a[:, 1:] - a[:, :1])  # parallel
    u, v = (x.ravel() for x in np.meshgrid(*[np.linspace(0, 1, 201)] * 2))
    points = [s[0, 0] + x[:, None] * (s[0, 1] - s[0, 0]) for s, x in ((a, u), (b, v))]
    least = np.linalg.norm(points[0] - points[1], axis=1).min()
    found = _segments(a, b)[0]
    assert found <= least + EXACT
    assert found >= least - 0.03  # [m] the points stand 1/200 of a segment apart


def test_bounds_never_exceed_distances():
    path = ArmPath(swing(7, count=12))
    for pairs in (arm_pairs(path), leg_pairs(path)):
        rows, pair = (x.ravel() for x in np.indices((path.count, len(pairs.names))))
        exact = pairs.distances(path.waypoints, rows, pair, np.inf)
        bound = pairs.distances(path.waypoints, rows, pair, -np.inf)
        apart = exact > 0  # the depth of an overlap is another length
        assert (bound <= exact + TOUCH)[apart].all()
        assert (bound < TOUCH)[~apart].all()


def test_travel_bounds_what_a_body_moves():
    q = swing(8, count=6)
    link = LINKS[4]
    bound = travel(CHAIN, q, 1, link.joint, link.extent)
    frames = CHAIN.frames(q)
    seen = np.linalg.inv(frames[:, 1]) @ frames[:, link.joint]  # from the shoulder
    ends = link.axis @ np.swapaxes(seen[:, :3, :3], 1, 2) + seen[:, None, :3, 3]
    moved = np.linalg.norm(np.diff(ends, axis=0), axis=-1).max(axis=1)
    assert (moved <= bound).all()
    q[:, 1:] = q[0, 1:]  # the shoulder alone turns: both bodies ride on it
    assert not travel(CHAIN, q, 1, link.joint, link.extent).any()
    assert travel(CHAIN, q, 0, link.joint, link.extent).all()


@pytest.mark.parametrize("ground", [0, 1])
def test_heights_over_mold_and_table_bound_the_distance_of_legs(ground):
    read = read_scene(EXAMPLES / "panel.yaml")
    cell = build_cell(read, read_sources(read, EXAMPLES))
    name, prisms, bound = list(_grounds(cell))[ground]
    rng = np.random.default_rng(9)
    middle = prisms.reshape(-1, 3).mean(axis=0)
    ends = middle + rng.uniform(-0.6, 0.6, (120, 1, 3)) + [0, 0, 0.4]
    ends = np.concatenate([ends, ends + rng.uniform(-0.3, 0.3, (120, 1, 3))], axis=1)
    legs = Legs(np.full(1, 0.01), np.zeros((1, 2)), np.zeros((1, 2)), 0.3)
    pairs = LegGroundPairs(
        [("leg", name)], legs, bound, herd(prisms), np.zeros((1, 1)), np.inf
    )
    moments = Moments(np.zeros(0), lambda: ends[:, None])
    rows, pair = np.arange(120), np.zeros(120, int)
    exact = pairs.distances(moments, rows, pair, np.inf)
    found = pairs.distances(moments, rows, pair, -np.inf)
    apart = exact > 0
    assert apart.sum() > 30
    assert (~apart).sum() > 10
    assert (found <= exact + TOUCH)[apart].all()
    assert (found < TOUCH)[~apart].all()
    assert (found > 0).sum() > 10  # bounds that tell something


@pytest.mark.parametrize("make", [leg_pairs, leg_table_pairs])
def test_a_thicker_leg_is_nearer_by_what_its_radius_grew(make):
    path = ArmPath(swing(10, count=3))
    thin, thick = make(path), make(path)
    thick.legs = replace(thick.legs, radius=thick.legs.radius + 0.02)
    rows, pair = (x.ravel() for x in np.indices((path.count, len(thin.names))))
    near, far = (
        pairs.distances(path.waypoints, rows, pair, np.inf) for pairs in (thick, thin)
    )
    np.testing.assert_allclose(far - near, 0.02, atol=EXACT)
