"""Clearance: the least distances between arm, tool, mold and table along a path.

Joints move evenly between waypoints. No point of a body moves faster than the joints
before it allow, so distances at two moments bound those between them; where the bound
is not good enough, the moment in the middle is looked at too [Mirtich2000].
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from drapeplan.chain import Chain

Array = NDArray[np.float64]
Index = NDArray[np.int_]
FINE = 1e-3  # [m] least clearances between waypoints are found to this
HALVINGS = 24  # of the time between two waypoints; bodies that move 1 m need ten


@dataclass(frozen=True)
class Moments:
    """Where everything is at m moments.

    Attributes:
        frames: Of base_link and the arm's joints, shape (m, 7, 4, 4), in [m].
        find_ends: Finds the ends of the legs' axes, for those who need them.
    """

    frames: Array
    find_ends: Callable[[], Array]

    @cached_property
    def ends(self) -> Array:
        """Ends of the legs' axes, shape (m, n, 2, 3), in [m]."""
        return self.find_ends()


class AbstractPath(ABC):
    """A path of `count` waypoints."""

    count: int

    @abstractmethod
    def __call__(self, k: Index, share: Array) -> Moments:
        """Where everything is at shares of the way from waypoints to the next.

        Args:
            k: Waypoints, shape (m,).
            share: From 0 to 1, shape (m,).
        """

    @cached_property
    def waypoints(self) -> Moments:
        """Where everything is at the waypoints."""
        return self(np.arange(self.count), np.zeros(self.count))


@dataclass(frozen=True)
class Least:
    """The least clearance of some bodies.

    Attributes:
        distance: Negative where they overlap, in [m].
        between: Names of the two bodies.
        waypoint: The waypoint, or the one before the moment.
        share: Of the way to the next waypoint.
    """

    distance: float
    between: tuple[str, str]
    waypoint: int
    share: float


class AbstractPairs(ABC):
    """Pairs of bodies whose clearance is wanted.

    Attributes:
        names: Names of the bodies of each pair.
        motion: How far a point of one moves for the other from each waypoint to the
            next at most, shape (K - 1, p), in [m].
    """

    names: list[tuple[str, str]]
    motion: Array

    @abstractmethod
    def distances(
        self, moments: Moments, rows: Index, pairs: Index, limit: float
    ) -> Array:
        """Distances of pairs, or lower bounds of those that exceed a limit.

        Args:
            moments: Where everything is.
            rows: Moments asked for, shape (r,).
            pairs: Pairs asked for, shape (r,).
            limit: What is of interest, in [m].
        """


def least_clearance(pairs: AbstractPairs, path: AbstractPath) -> Least:
    """The least clearance of pairs of bodies along a path.

    Args:
        pairs: The pairs.
        path: The path.

    Returns:
        The least distance found; nothing comes nearer than it less FINE.
    """
    distance = _at_waypoints(pairs, path)
    i, j = np.unravel_index(distance.argmin(), distance.shape)
    best = Least(float(distance[i, j]), pairs.names[int(j)], int(i), 0.0)
    k, pair = np.nonzero(pairs.motion > 0)
    spans = np.stack([0.0 * k, 1.0 + 0.0 * k], axis=1)
    ends = np.stack([distance[k, pair], distance[k + 1, pair]], axis=1)
    for _ in range(HALVINGS):
        motion = pairs.motion[k, pair] * (spans[:, 1] - spans[:, 0])
        open_ = (ends.sum(axis=1) - motion) / 2 < best.distance - FINE
        if not open_.any():
            break
        k, pair, spans, ends = (x[open_] for x in (k, pair, spans, ends))
        middle = spans.mean(axis=1)
        moment, row = np.unique(
            np.stack([k, middle], axis=1), axis=0, return_inverse=True
        )
        there = path(moment[:, 0].astype(int), moment[:, 1])
        found = pairs.distances(there, row.ravel(), pair, best.distance)
        w = int(found.argmin())
        if found[w] < best.distance:
            name = pairs.names[int(pair[w])]
            best = Least(float(found[w]), name, int(k[w]), float(middle[w]))
        k, pair = np.tile(k, 2), np.tile(pair, 2)
        halves = [spans[:, 0], middle], [middle, spans[:, 1]]
        spans = np.concatenate([np.stack(half, axis=1) for half in halves])
        sides = [ends[:, 0], found], [found, ends[:, 1]]
        ends = np.concatenate([np.stack(side, axis=1) for side in sides])
    return best


def _at_waypoints(pairs: AbstractPairs, path: AbstractPath) -> Array:
    """Distances at the waypoints, shape (K, p); bounds where they are not the least.

    Pairs that did not move keep their distance. Of the rest bounds come first, then
    the distance of the nearest, then those that might be less.
    """
    still = np.zeros((path.count, len(pairs.names)), bool)
    still[1:] = pairs.motion == 0
    k, pair = np.nonzero(~still)
    found = pairs.distances(path.waypoints, k, pair, -np.inf)
    first = np.array([found.argmin()])
    limit = pairs.distances(path.waypoints, k[first], pair[first], np.inf)[0]
    near = np.flatnonzero(found < limit)
    found[near] = pairs.distances(path.waypoints, k[near], pair[near], limit)
    found[first] = limit
    distance = np.empty(still.shape)
    distance[k, pair] = found
    for i in range(1, path.count):
        distance[i] = np.where(still[i], distance[i - 1], distance[i])
    return distance


def travel(chain: Chain, q: Array, first: int, joint: int, radius: float) -> Array:
    """How far points of a body move for an earlier body, between waypoints.

    Args:
        chain: The arm.
        q: Joint angles at the waypoints, shape (K, m), in [rad].
        first: Number of joints before the earlier body.
        joint: Number of joints before the body.
        radius: Largest distance of its points from its joint's origin, [m].

    Returns:
        Upper bounds, shape (K - 1,), in [m].
    """
    reach = chain.reach(joint, radius)
    reach[:first] = 0
    return np.asarray(np.abs(np.diff(q, axis=0)) @ reach)


def between(values: Array, k: Index, share: Array) -> Array:
    """Values at shares of the way from waypoints to the next.

    Args:
        values: At the waypoints, shape (K, ...).
        k: Waypoints, shape (m,).
        share: From 0 to 1, shape (m,).

    Returns:
        Shape (m, ...).
    """
    after = np.minimum(k + 1, len(values) - 1)
    f = share.reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray((1 - f) * values[k] + f * values[after])
