"""How far points lie from a surface that is sampled on material lines.

The one metric of the project: scans against models, models against truth. Between the
samples the surface is the bicubic spline through them, so that distances do not see the
sampling. Closest points are found by Gauss-Newton from the nearest sample.
"""

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from ply.grid import CupGrid, Region

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STEPS = 30  # Gauss-Newton steps; smooth surfaces take 4 to 8
SETTLED = 1e-7  # [-] of the size of the surface: 0.05 um on 500 mm
TOUCHES = 1e-6  # [-] of the size: a line this near to the surface meets it
CHUNK = 20000  # points at a time, which keeps a gather below 8 MB
FAR = 0.03  # [m] what lies further off is no ply: table, arm, stray pixels


class Place(IntEnum):
    """What a point is compared with."""

    FREE = 0  # the free ply between the cups: this is scored
    ON_CUP = 1  # a square that a cup holds
    BEYOND = 2  # outside the outer edges of the outer cups
    FAR = 3  # too far from the ply to belong to it


@dataclass(frozen=True)
class Feet:
    """Points of a surface that belong to given points, all of one length n.

    Attributes:
        st: Material coordinates, shape (n, 2), in the unit of the lines.
        distance: Signed distances, positive on the side of s x t, shape (n,).
        inside: False where the foot is held at the surface's edge or none was found.
    """

    st: Array
    distance: Array
    inside: Mask


@dataclass(frozen=True, eq=False)
class Surface:
    """The bicubic spline through samples on a tensor grid of material lines.

    Lines and points share one unit of length, whichever it is.

    Attributes:
        s: Rising lines, shape (n_s,).
        t: Rising lines, shape (n_t,).
        samples: Points, shape (n_t, n_s, 3).
    """

    s: Array
    t: Array
    samples: Array
    _pieces: Array = field(init=False, repr=False)  # (n_t - 1, n_s - 1, 4, 4, 3)

    def __post_init__(self) -> None:
        """Turn the samples into one polynomial for each mesh of the lines."""
        along_t = CubicSpline(self.t, self.samples, axis=0).c[::-1]
        both = CubicSpline(self.s, along_t, axis=2).c[::-1]  # (4, ns - 1, 4, nt - 1, 3)
        pieces = np.ascontiguousarray(np.transpose(both, (3, 1, 2, 0, 4)))
        object.__setattr__(self, "_pieces", pieces)

    @property
    def size(self) -> float:
        """Longer side of the material rectangle."""
        return float(max(np.ptp(self.s), np.ptp(self.t)))

    def points(self, st: ArrayLike) -> Array:
        """Points at material coordinates, shape (n, 2) to (n, 3)."""
        return self._evaluate(np.asarray(st, dtype=float))[0]

    def closest(self, points: ArrayLike, start: Array | None = None) -> Feet:
        """Closest points of the surface and normal distances.

        Args:
            points: Points, shape (n, 3).
            start: Material coordinates to begin with, shape (n, 2), or None for those
                of the nearest sample.

        Returns:
            The feet; at the edge of the surface the distance is no normal one.
        """
        points = np.asarray(points, dtype=float).reshape(-1, 3)
        begin = self._nearest(points) if start is None else np.array(start, dtype=float)
        parts = [slice(n, n + CHUNK) for n in range(0, len(points), CHUNK)]
        feet = [self._closest(points[part], begin[part]) for part in parts]
        return _joined(feet)

    def along(self, points: ArrayLike, direction: ArrayLike, start: Array) -> Feet:
        """Where lines through points meet the surface, and distances along them.

        Args:
            points: Points, shape (n, 3).
            direction: Unit direction of the lines, shape (3,); distances follow it.
            start: Material coordinates to begin with, shape (n, 2).

        Returns:
            The feet; `inside` is False where a line misses the surface.
        """
        points = np.asarray(points, dtype=float).reshape(-1, 3)
        parts = [slice(n, n + CHUNK) for n in range(0, len(points), CHUNK)]
        axis = np.asarray(direction, dtype=float)
        across = np.linalg.svd(axis[None])[2][1:]  # two directions across the lines
        return _joined([self._along(points[p], axis, across, start[p]) for p in parts])

    def _nearest(self, points: Array) -> Array:
        t, s = np.meshgrid(self.t, self.s, indexing="ij")
        _, index = cKDTree(self.samples.reshape(-1, 3)).query(points)
        return np.column_stack([s.ravel()[index], t.ravel()[index]])

    def _evaluate(self, st: Array) -> tuple[Array, Array, Array]:
        """Points and derivatives along s and t, each of shape (n, 3)."""
        j, s = _cell(self.s, st[:, 0])
        i, t = _cell(self.t, st[:, 1])
        pieces = self._pieces[i, j].reshape(-1, 4, 12)
        rows = np.stack([_powers(t), _slopes(t)], axis=-2)
        at_t = (rows @ pieces).reshape(-1, 2, 4, 3)
        value = np.einsum("nk,nlkc->lnc", _powers(s), at_t)
        return value[0], np.einsum("nk,nkc->nc", _slopes(s), at_t[:, 0]), value[1]

    def _step(self, st: Array, step: Array) -> Array:
        """Coordinates after a step that is no longer than a few lines, kept inside."""
        for k, lines in enumerate((self.s, self.t)):
            most = 2 * np.diff(lines).max()
            moved = st[:, k] + np.clip(step[:, k], -most, most)
            st[:, k] = np.clip(moved, lines[0], lines[-1])
        return st

    def _at_edge(self, st: Array) -> Mask:
        """Which coordinate is held at the edge, shape (n, 2)."""
        low, high = (np.array([self.s[k], self.t[k]]) for k in (0, -1))
        return np.asarray((st <= low) | (st >= high))

    def _closest(self, points: Array, st: Array) -> Feet:
        active = np.arange(len(points))
        for _ in range(STEPS):
            here = st[active]
            foot, x, y = self._evaluate(here)
            away = points[active] - foot
            step = _tangential(away, x, y, self._at_edge(here))
            new = self._step(here.copy(), step)
            st[active] = new
            active = active[
                abs(new - here).max(axis=1, initial=0) > SETTLED * self.size
            ]
            if not len(active):
                break
        foot, x, y = self._evaluate(st)
        away = points - foot
        side = np.einsum("nc,nc->n", away, np.cross(x, y))
        distance = np.copysign(np.linalg.norm(away, axis=1), side)
        return Feet(st, distance, np.all(~self._at_edge(st), axis=1))

    def _along(self, points: Array, axis: Array, across: Array, start: Array) -> Feet:
        st = np.array(start, dtype=float)
        for _ in range(STEPS):
            foot, x, y = self._evaluate(st)
            off = (points - foot) @ across.T
            matrix = np.stack([x @ across.T, y @ across.T], axis=-1)
            before = st.copy()
            st = self._step(st, _solve(matrix, off))
            if abs(st - before).max(initial=0) <= SETTLED * self.size:
                break
        away = points - self._evaluate(st)[0]
        met = np.linalg.norm(away @ across.T, axis=1) <= TOUCHES * self.size
        return Feet(st, away @ axis, met)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Points against a surface, all of one length n.

    Attributes:
        st: Material coordinates of the closest points, shape (n, 2), in [m].
        normal: Signed normal distances, in [m].
        place: Values of Place, shape (n,).
    """

    st: Array
    normal: Array
    place: NDArray[np.int64]

    @property
    def free(self) -> Mask:
        """Points over the free ply, shape (n,)."""
        return self.place == Place.FREE


def compare(
    surface: Surface, grid: CupGrid, points: ArrayLike, far: float = FAR
) -> Comparison:
    """Normal distances of scattered points, and which of them count.

    Args:
        surface: The ply from the outer edges of the outer cups to each other, in [m].
        grid: The cup array.
        points: Points, shape (n, 3), in [m].
        far: Distance beyond which a point belongs to something else, in [m].

    Returns:
        The comparison.
    """
    feet = surface.closest(points)
    on_cup = grid.regions(feet.st) == Region.CUP
    place = np.where(on_cup, Place.ON_CUP, Place.FREE)
    place = np.where(feet.inside, place, Place.BEYOND)
    place = np.where(abs(feet.distance) > far, Place.FAR, place)
    return Comparison(feet.st, feet.distance, place)


def rms(values: ArrayLike) -> float:
    """Root of the mean square; 0 of no values."""
    values = np.asarray(values, dtype=float)
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def _joined(feet: list[Feet]) -> Feet:
    if not feet:
        return Feet(np.empty((0, 2)), np.empty(0), np.empty(0, dtype=bool))
    st, distance, inside = zip(
        *((f.st, f.distance, f.inside) for f in feet), strict=True
    )
    return Feet(np.concatenate(st), np.concatenate(distance), np.concatenate(inside))


def _cell(lines: Array, x: Array) -> tuple[NDArray[np.int64], Array]:
    """Mesh of each coordinate, and how far it lies behind the mesh's first line."""
    index = np.clip(np.searchsorted(lines, x, side="right") - 1, 0, len(lines) - 2)
    return index, x - lines[index]


def _powers(x: Array) -> Array:
    return np.stack([np.ones_like(x), x, x**2, x**3], axis=-1)


def _slopes(x: Array) -> Array:
    return np.stack([np.zeros_like(x), np.ones_like(x), 2 * x, 3 * x**2], axis=-1)


def _solve(matrix: Array, right: Array) -> Array:
    """Solutions of 2 x 2 systems, shape (n, 2); 0 where a matrix is singular."""
    (a, b), (c, d) = np.moveaxis(matrix, 0, -1)
    det = a * d - b * c
    p, q = right.T
    over = np.divide(1.0, det, out=np.zeros_like(det), where=det != 0)
    return np.stack([(d * p - b * q) * over, (a * q - c * p) * over], axis=-1)


def _tangential(away: Array, x: Array, y: Array, held: Mask) -> Array:
    """Gauss-Newton step toward the foot; a held coordinate leaves its edge alone.

    Where the step would leave the surface, the other coordinate must not lean on it.
    """
    e, f, g, p, q = (
        np.einsum("nc,nc->n", a, b)
        for a, b in ((x, x), (x, y), (y, y), (away, x), (away, y))
    )
    cross = np.where(held.any(axis=1), 0.0, f)
    matrix = np.stack([np.stack([e, cross], -1), np.stack([cross, g], -1)], axis=-2)
    return _solve(matrix, np.stack([p, q], axis=-1))
