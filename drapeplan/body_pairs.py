"""Body pairs: distances of links, legs, platform, mold and table by coal.

With drapeplan.solids this is the home of coal. Cheap bounds come first: capsules around
the links, and heights of the legs above the ground.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import coal
import numpy as np
from numpy.typing import NDArray

from drapeplan.chain import Chain
from drapeplan.clearance import AbstractPairs, Moments, travel
from drapeplan.solids import Legs, Solid

Array = NDArray[np.float64]
Index = NDArray[np.int_]
POINTS = 16  # [-] along a leg, where its height above the ground is asked for
THIN = 1e-6  # [m] radius of a leg's axis for coal, which knows no bare segment


class SolidPairs(AbstractPairs):
    """Links of the arm against one another, and against the platform."""

    def __init__(
        self, chain: Chain, q: Array, pairs: list[tuple[Solid, Solid]]
    ) -> None:
        """Order each pair along the arm.

        Args:
            chain: The arm.
            q: Joint angles at the waypoints, shape (K, m), in [rad].
            pairs: The pairs.
        """
        self.pairs = [(a, b) if a.joint <= b.joint else (b, a) for a, b in pairs]
        self.names = [(a.name, b.name) for a, b in self.pairs]
        moves = [travel(chain, q, a.joint, b.joint, b.extent) for a, b in self.pairs]
        self.motion = np.stack(moves, axis=1)

    def distances(
        self, moments: Moments, rows: Index, pairs: Index, limit: float
    ) -> Array:
        """Distances, or those of the capsules around the bodies if these suffice."""
        found = np.empty(len(rows))
        for p in np.unique(pairs):
            mine = np.flatnonzero(pairs == p)
            a, b = self.pairs[p]
            T, U = (moments.frames[rows[mine], s.joint] for s in (a, b))
            gap = _segments(_moved(T, a.axis), _moved(U, b.axis)) - a.radius - b.radius
            for i in np.flatnonzero(gap < limit):
                gap[i] = _distance(a.geometry, T[i], b.geometry, U[i])
            found[mine] = gap
        return found


class GroundPairs(AbstractPairs):
    """Links of the arm and the platform against what stands in the cell."""

    def __init__(
        self, chain: Chain, q: Array, solids: list[Solid], ground: str, tree: Any
    ) -> None:
        """Pair each solid with the ground.

        Args:
            chain: The arm.
            q: Joint angles at the waypoints, shape (K, m), in [rad].
            solids: The solids.
            ground: What the ground is called.
            tree: Its prisms, from `herd`.
        """
        self.tree, self.solids = tree, solids
        self.names = [(s.name, ground) for s in solids]
        moves = [travel(chain, q, 0, s.joint, s.extent) for s in solids]
        self.motion = np.stack(moves, axis=1)

    def distances(
        self, moments: Moments, rows: Index, pairs: Index, limit: float
    ) -> Array:
        """Distances; there are no bounds."""
        found = np.full(len(rows), -np.inf)
        if limit == -np.inf:
            return found
        bodies = [coal.CollisionObject(s.geometry) for s in self.solids]
        for i, (row, p) in enumerate(zip(rows, pairs, strict=True)):
            T = moments.frames[row, self.solids[p].joint]
            found[i] = _to_tree(bodies[p], T, self.tree)
        return found


class LegPairs(AbstractPairs):
    """Legs against the links of the arm."""

    def __init__(
        self, names: list[str], legs: Legs, solids: list[Solid], motion: Array
    ) -> None:
        """Pair each leg with each solid.

        Args:
            names: Names of the legs.
            legs: Their capsules.
            solids: The links.
            motion: Of each leg for each link, shape (K - 1, len(solids), n), in [m].
        """
        self.legs, self.solids, self.count = legs, solids, len(names)
        self.names = [(s.name, name) for s in solids for name in names]
        self.motion = motion.reshape(len(motion), -1)

    def distances(
        self, moments: Moments, rows: Index, pairs: Index, limit: float
    ) -> Array:
        """Distances, or those of the capsules around the links if these suffice."""
        which, leg = np.divmod(pairs, self.count)
        ends, found = moments.ends[rows, leg], np.empty(len(rows))
        for w in np.unique(which):
            mine, body = np.flatnonzero(which == w), self.solids[w]
            T, radius = moments.frames[rows[mine], body.joint], self.legs.radius[leg]
            axis = _moved(T, body.axis)
            gap = _segments(axis, ends[mine]) - body.radius - radius[mine]
            near = np.flatnonzero(gap < limit)
            U, length = _upright(ends[mine[near]])
            for i, V, height in zip(near, U, length, strict=True):
                axis = coal.Capsule(THIN, height)
                gap[i] = _distance(body.geometry, T[i], axis, V) - radius[mine[i]]
            found[mine] = gap
        return found


class LegGroundPairs(AbstractPairs):
    """Legs, but for their ends, against what stands in the cell."""

    def __init__(
        self,
        names: list[tuple[str, str]],
        legs: Legs,
        bound: Callable[[Array], Array],
        tree: Any,
        motion: Array,
        enough: float,
    ) -> None:
        """Pair each leg with the ground.

        Args:
            names: Names of each leg and of the ground.
            legs: Capsules of the legs.
            bound: Lower bound of the distances of points, shape (..., 3), in [m].
            tree: The ground's prisms.
            motion: Of each leg, shape (K - 1, n), in [m].
            enough: Where a bound exceeds this, no distance is asked for, in [m].
        """
        self.names, self.motion = names, motion
        self.legs, self.bound, self.tree, self.enough = legs, bound, tree, enough

    def distances(
        self, moments: Moments, rows: Index, pairs: Index, limit: float
    ) -> Array:
        """Bounds, and distances where these do not suffice."""
        ends, radius = moments.ends[rows, pairs], self.legs.radius[pairs]
        share = np.linspace(0, 1, POINTS)[:, None]
        points = (1 - share) * ends[:, :1] + share * ends[:, 1:]
        spacing = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / (POINTS - 1)
        gap = self.bound(points).min(axis=1) - spacing / 2 - radius
        near = np.flatnonzero(gap < min(limit, self.enough))
        T, length = _upright(ends[near])
        for i, U, height in zip(near, T, length, strict=True):
            axis = coal.CollisionObject(coal.Capsule(THIN, height))
            gap[i] = _to_tree(axis, U, self.tree) - radius[i]
        return np.asarray(gap)


def _moved(T: Array, points: Array) -> Array:
    """Points, shape (p, 3), at each of many placements, shape (m, p, 3)."""
    return np.asarray(points @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3])


def _distance(a: Any, T: Array, b: Any, U: Array) -> float:
    """Signed distance of two convex bodies, [m]."""
    first, second = (coal.Transform3s(X[:3, :3], X[:3, 3]) for X in (T, U))
    request, result = coal.DistanceRequest(True, True), coal.DistanceResult()
    return float(coal.distance(a, first, b, second, request, result))


def _to_tree(body: Any, T: Array, tree: Any) -> float:
    """Signed distance of a body from the nearest of a tree, [m]."""
    body.setTransform(coal.Transform3s(T[:3, :3], T[:3, 3]))
    body.computeAABB()
    callback = coal.DistanceCallBackDefault()
    tree.distance(body, callback)
    return float(callback.data.result.min_distance)


def _upright(ends: Array) -> tuple[Array, Array]:
    """Placements whose z runs along segments (m, 2, 3), and lengths, (m,), in [m]."""
    line = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(line, axis=1)
    flat = length < THIN
    z = np.where(flat[:, None], [0.0, 0.0, 1.0], line)
    z /= np.where(flat, 1.0, length)[:, None]
    x = np.cross(z, np.eye(3)[np.abs(z).argmin(axis=1)])
    x /= np.linalg.norm(x, axis=1)[:, None]
    T = np.tile(np.eye(4), (len(ends), 1, 1))
    T[:, :3, :3] = np.stack([x, np.cross(z, x), z], axis=2)
    T[:, :3, 3] = ends.mean(axis=1)
    return T, length


def _segments(a: Array, b: Array) -> Array:
    """Distances between segments, each of shape (m, 2, 3), in [m]: [Ericson2005]."""
    d, e, r = a[:, 1] - a[:, 0], b[:, 1] - b[:, 0], a[:, 0] - b[:, 0]
    dd, ee, de = (np.einsum("mi,mi->m", x, y) for x, y in ((d, d), (e, e), (d, e)))
    dr, er = (np.einsum("mi,mi->m", x, r) for x in (d, e))
    dd, ee = np.maximum(dd, 1e-18), np.maximum(ee, 1e-18)
    across = dd * ee - de**2
    u = np.where(across > 0, de * er - dr * ee, 0) / np.where(across > 0, across, 1)
    u = np.clip(u, 0, 1)
    v = np.clip((de * u + er) / ee, 0, 1)
    u = np.clip((de * v - dr) / dd, 0, 1)
    gap = r + u[:, None] * d - v[:, None] * e
    return np.asarray(np.linalg.norm(gap, axis=1))
