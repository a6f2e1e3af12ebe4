"""Refine: the front judged between waypoints, where a fault could hide.

A path is given at waypoints; between two of them cups go straight and turn evenly. An
interval in which a cup lands, or in which a margin is thin, is halved, while it lands
in equal ratios of the height that is left; its halves are halved again as long as the
new pose shows worse than both its neighbors, or stays within reach of a tolerance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from drapeplan.flood import Bools, Floats
from drapeplan.frames import rotation_vectors
from drapeplan.front import check_front, pose_measures
from drapeplan.front_grid import FrontGrid
from drapeplan.verdict import FrontVerdict, Spot, Tolerance

Ints = NDArray[np.int64]

ROUNDS = 4  # most halvings of an interval: a sixteenth of it
THIN = 1.0e-3  # [m] margins below are looked at from close by
DEEP = 0.5  # [-] of the depth allowed, from which on depth is looked at
MOVED = 0.05e-3  # [m] worse than both neighbors by this: look again
LEAST = 0.1  # [-] least share of an interval on either side of its new pose


@dataclass(frozen=True)
class Stops:
    """Poses along a path, at waypoints and between them.

    Attributes:
        time: Waypoint, and share of the way to the next one, shape (K,), increasing.
        positions: Cup positions in the mold frame, shape (K, n, 3), in [m].
        rotations: Cup rotations in the mold frame, shape (K, n, 3, 3).
        placed: Placed cups, shape (K, n).
        landing: Landing cups, shape (K, n).
    """

    time: Floats
    positions: Floats
    rotations: Floats
    placed: Bools
    landing: Bools

    @classmethod
    def at_waypoints(
        cls, poses: tuple[Floats, Floats], placed: Bools, landing: Bools
    ) -> Stops:
        """The waypoints alone."""
        return cls(np.arange(len(placed), dtype=float), *poses, placed, landing)

    @property
    def poses(self) -> tuple[Floats, Floats]:
        """Positions and rotations."""
        return self.positions, self.rotations

    def some(self, which: Bools | Ints) -> Stops:
        """Some of the stops, in their order."""
        return Stops(*(getattr(self, f.name)[which] for f in fields(self)))

    def between(self, time: Floats) -> Stops:
        """Stops between waypoints; to be asked of waypoints alone.

        A cup is placed where it is so on both sides, and lands where it does on one.

        Args:
            time: Waypoint and share of the way to the next, shape (m,), none whole.
        """
        k = np.floor(time).astype(int)
        placed = self.placed[k] & self.placed[k + 1]
        landing = self.landing[k] | self.landing[k + 1] | self.placed[k + 1]
        poses = straight_between(self.poses, time)
        return Stops(time, *poses, placed, landing & ~placed)

    def joined(self, other: Stops) -> tuple[Stops, Ints]:
        """Both in the order of time, and that order."""
        both = Stops(
            *(
                np.concatenate([getattr(self, f.name), getattr(other, f.name)])
                for f in fields(self)
            )
        )
        order = np.argsort(both.time, kind="stable")
        return both.some(order), order


def straight_between(
    poses: tuple[Floats, Floats], time: Floats
) -> tuple[Floats, Floats]:
    """Cup poses between waypoints: they go straight and turn evenly.

    Args:
        poses: Positions and rotations at the waypoints, shapes (K, n, 3) in [m] and
            (K, n, 3, 3).
        time: Waypoint and share of the way to the next, shape (m,), none whole.

    Returns:
        The same there, shapes (m, n, 3) and (m, n, 3, 3).
    """
    positions, rotations = poses
    k = np.floor(time).astype(int)
    share = (time - k)[:, None, None]
    turn = share * rotation_vectors(rotations[k], rotations[k + 1])
    turned = Rotation.from_rotvec(turn.reshape(-1, 3)).as_matrix()
    step, frames = positions[k + 1] - positions[k], rotations[k]
    return positions[k] + share * step, turned.reshape(frames.shape) @ frames


def judge_between(
    waypoints: Stops,
    gap: Floats,
    final_gap: Floats,
    grid: FrontGrid,
    tolerance: Tolerance,
    gaps_of: Callable[[Stops, Bools], Floats],
) -> FrontVerdict:
    """Verdict on a path with what happens between its waypoints.

    Args:
        waypoints: The waypoints.
        gap: Their gaps, shape (K, nt, ns), in [m].
        final_gap: Gaps in the laid state, shape (nt, ns), in [m].
        grid: The ply's samples and their cups.
        tolerance: Tolerances of the check.
        gaps_of: Gives the gaps of the marked ones of some stops.

    Returns:
        The verdict on the waypoints; margins, depths and events of each hold for the
        way to it, too.
    """

    def measured(some: Stops, gap: Floats) -> Floats:
        cups = some.placed, some.landing
        return pose_measures(gap, final_gap, grid, *cups, tolerance)

    stops, measures = waypoints, measured(waypoints, gap)
    left = _left(waypoints)
    open_ = _landing_between(waypoints) | _thin(measures, tolerance)
    for _ in range(ROUNDS):
        first = np.flatnonzero(open_)
        if not first.size:
            break
        time = _middles(stops.time[first], stops.time[first + 1], left)
        stops, order = stops.joined(waypoints.between(time))
        new = order >= len(gap)
        gap = np.concatenate([gap, gaps_of(stops, new)])[order]
        found = measured(stops.some(new), gap[new])
        measures = np.concatenate([measures, found], axis=1)[:, order]
        worse = _worse(measures, np.flatnonzero(new))
        near = new[:-1] | new[1:]  # intervals that end at a new pose
        open_ = near & (_beside(new, worse) | _thin(measures, tolerance))
    cups = stops.placed, stops.landing
    found_all = check_front(gap, final_gap, grid, *cups, tolerance, measures)
    return on_waypoints(found_all, stops.time)


def on_waypoints(verdict: FrontVerdict, time: Floats) -> FrontVerdict:
    """A verdict on many stops as one on the waypoints among them.

    Args:
        verdict: Verdict on all stops.
        time: Their times; waypoints are whole numbers, the first and last among them.

    Returns:
        Margins and depths are the worst on the way to each waypoint; events and spots
        have the waypoint by which they happen.
    """
    owner = np.ceil(time).astype(int)
    at = np.flatnonzero(owner == time)
    first = np.append(0, at[:-1] + 1)

    def seen(spot: Spot | None) -> Spot | None:
        if spot is None or spot.pose is None:
            return spot
        return replace(spot, pose=int(owner[spot.pose]))

    count = np.arange(len(time))
    touched = np.isfinite(verdict.first_touch)
    when = np.interp(np.where(touched, verdict.first_touch, 0.0), count, time)
    return replace(
        verdict,
        premature_margin=np.minimum.reduceat(verdict.premature_margin, first),
        air_margin=np.minimum.reduceat(verdict.air_margin, first),
        span_penetration=np.maximum.reduceat(verdict.span_penetration, first),
        pad_penetration=np.maximum.reduceat(verdict.pad_penetration, first),
        laid_deviation=np.maximum.reduceat(verdict.laid_deviation, first),
        contact_area=verdict.contact_area[at],
        worst_premature=seen(verdict.worst_premature),
        worst_air=seen(verdict.worst_air),
        events=tuple(replace(e, pose=int(owner[e.pose])) for e in verdict.events),
        first_touch=np.where(touched, when, np.inf),
        poses_between=len(time) - len(at),
    )


def _landing_between(stops: Stops) -> Bools:
    """Intervals in which a cup is on its way down, shape (K - 1,)."""
    down = stops.landing | stops.placed
    return np.asarray((down[1:] & ~stops.placed[:-1]).any(axis=1))


def _thin(measures: Floats, tolerance: Tolerance) -> Bools:
    """Intervals that end with little room to a fault, or little beyond, (K - 1,)."""
    premature, air, spans, pads, _ = measures
    close = (np.abs(premature) <= THIN) | (np.abs(air) <= THIN)
    for depth, most in (
        (spans, tolerance.penetration),
        (pads, tolerance.pad_penetration),
    ):
        close |= (depth > DEEP * most) & (depth < most / DEEP)
    return np.asarray(close[:-1] | close[1:])


def _worse(measures: Floats, new: Ints) -> Bools:
    """Whether poses show worse than both their neighbors, by what counts, (m,)."""
    signs = np.array([-1.0, -1.0, 1.0, 1.0])[:, None]
    bad = signs * np.clip(measures[:4], -THIN, THIN)  # margins beyond are all alike
    ends = np.maximum(bad[:, new - 1], bad[:, new + 1])
    return np.asarray((bad[:, new] > ends + MOVED).any(axis=0))


def _beside(new: Bools, worse: Bools) -> Bools:
    """Intervals on both sides of the poses that are worse, shape (K - 1,)."""
    marked = np.zeros(len(new), dtype=bool)
    marked[np.flatnonzero(new)[worse]] = True
    return marked[:-1] | marked[1:]


def _left(stops: Stops) -> Floats:
    """Way left to the cups that land in each interval, at its ends, (K - 1, 2), [m]."""
    way = np.linalg.norm(stops.positions - stops.positions[-1], axis=-1)
    lands = (stops.landing | stops.placed)[1:] & ~stops.placed[:-1]
    ends = [np.max(w, axis=1, where=lands, initial=0.0) for w in (way[:-1], way[1:])]
    return np.stack(ends, axis=-1)


def _middles(start: Floats, end: Floats, left: Floats) -> Floats:
    """Times at which the way left is the geometric mean of those at both ends."""
    k = np.floor(start).astype(int)
    touch = Tolerance().touch  # nothing lands in ratios below what touches
    first, last = left[k].T + touch
    fall = last - first
    a, b = first + (start - k) * fall, first + (end - k) * fall
    falls = np.abs(b - a) > 1e-6 * touch
    share = np.where(falls, (np.sqrt(a * b) - a) / np.where(falls, b - a, 1.0), 0.5)
    return np.asarray(start + np.clip(share, LEAST, 1 - LEAST) * (end - start))
