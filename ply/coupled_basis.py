"""Functions and integrals of the coupled ply: smooth, rigid on the cups (D10).

Along one axis of a patch the functions are Hermite cubics at the four cup edges and
bubbles over the free span; in the plane they are products. The cups give the products
that live on them; a strip owns bubbles along its fibers times Hermite cubics across;
the inside of the patch owns bubbles times bubbles. So strips meet only through it.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

from ply.fiber import Array

# Hermite cubics on [-1, 1], powers from the highest: value and slope at -1, then at 1
HERMITE = np.array([[1, 0, -3, 2], [1, -1, -1, 1], [-1, 0, 3, 2], [1, 1, -1, -1]]) / 4
SPAN = 1  # [-] interval between those of the first and of the second cup


@dataclass(frozen=True)
class AxisBasis:
    """Functions along one axis of a patch, from the first cup's center.

    Column order: `order` bubbles, then value and slope at each of the four cup edges.

    Attributes:
        half_width: Half width of a cup, in [m].
        length: Fiber length between the cups, in [m].
        order: Number of bubbles over the free span.
    """

    half_width: float
    length: float
    order: int

    @cached_property
    def edges(self) -> Array:
        """Coordinates of the four cup edges, shape (4,), in [m]."""
        d = self.half_width
        return np.array([-d, d, d + self.length, 3 * d + self.length])

    @cached_property
    def _bubbles(self) -> list[Array]:
        """Legendre series with value and slope zero at both ends of [-1, 1]."""
        unit = np.eye(self.order + 2)[2:]
        return [legendre.legint(row, 2, lbnd=-1) for row in unit]

    def evaluate(self, x: ArrayLike, derivative: int = 0) -> Array:
        """Values or derivatives of all functions; linear beyond the outer edges.

        Args:
            x: Coordinates, shape (n,), in [m].
            derivative: 0, 1 or 2.

        Returns:
            Values, shape (n, order + 8), in [m] to the power of -derivative.
        """
        x = np.asarray(x, dtype=float)
        inside = np.clip(x, self.edges[0], self.edges[-1])
        interval = np.searchsorted(self.edges[1:3], inside, side="right")
        half = np.diff(self.edges)[interval] / 2
        u = (inside - self.edges[interval]) / half - 1
        scale = half ** -float(derivative)
        out = np.zeros((len(x), self.order + 8))
        on_span = interval == SPAN
        for k, series in enumerate(self._bubbles):
            values = legendre.legval(u, legendre.legder(series, derivative)) * scale
            out[:, k] = np.where(on_span, values, 0)
        for k, cubic in enumerate(HERMITE):
            values = np.polyval(np.polyder(cubic, derivative), u) * scale
            column = self.order + 2 * interval + k
            out[np.arange(len(x)), column] = values * half ** (k % 2)
        if derivative == 0 and (inside != x).any():
            out += (x - inside)[:, None] * self.evaluate(inside, 1)
        elif derivative == 2:
            out[inside != x] = 0
        return out

    def cup_columns(self) -> Array:
        """Columns that make the constant and the distance from its center of each cup.

        Returns:
            Combinations of the functions, shape (order + 8, 4): constant and distance
            of the first cup, then of the second.
        """
        out = np.zeros((self.order + 8, 4))
        d = self.half_width
        for cup in (0, 1):
            first = self.order + 4 * cup
            out[first : first + 4, 2 * cup] = 1, 0, 1, 0
            out[first : first + 4, 2 * cup + 1] = -d, 1, d, 1
        return out

    def rule(self, interval: int, count: int) -> tuple[Array, Array]:
        """Gauss points and weights of one interval, shapes (count,), in [m]."""
        nodes, weights = legendre.leggauss(count)
        start, half = self.edges[interval], np.diff(self.edges)[interval] / 2
        return start + half * (nodes + 1), half * weights


@dataclass(frozen=True)
class Material:
    """What the ply is made of.

    Attributes:
        stretch: Force per width and strain along the fibers, in [N/m].
        shear: Force per width and shear strain in the plane, in [N/m].
        bending: Moment per width and curvature along the fibers, in [N m].
        torsion: The same for twist, in [N m].
        weight: Weight per area, a vector, in [N/m^2].
        take_up: Length that the weave takes up or gives over a span, in [m].
    """

    stretch: float
    shear: float
    bending: float
    torsion: float
    weight: tuple[float, float, float] = (0.0, 0.0, 0.0)
    take_up: float = 0.0


@dataclass(frozen=True, eq=False)
class Piece:
    """Constant matrices of one region, or of several stacked on a leading axis.

    n functions are unknown; m = 12 are the positions, s and t directions of the four
    cups, three for each cup. G is the number of Gauss points.

    Attributes:
        ds: Derivatives along s, shape (..., G, n), in [1/m].
        dt: Derivatives along t.
        ds_cups: Derivatives along s, shape (..., G, m).
        dt_cups: Derivatives along t.
        values: Values, shape (..., G, n).
        roots: Roots of weight times stiffness, shape (..., 3, G): stretch along s, t
            and shear.
        bending: Second derivative of the bending energy, shape (..., n, n).
        bending_cups: The same between unknowns and cups, shape (..., n, m).
        cups_bending: The same between cups, shape (..., m, m).
        load: Forces of the weight on the unknowns, shape (..., n, 3), in [N].
        low: Least strains that the weave gives without a force, shape (..., 3, G).
        high: Strains that it takes up.
    """

    ds: Array
    dt: Array
    ds_cups: Array
    dt_cups: Array
    values: Array
    roots: Array
    bending: Array
    bending_cups: Array
    cups_bending: Array
    load: Array
    low: Array
    high: Array


@dataclass(frozen=True)
class PatchBasis:
    """Functions in the plane: products of those along s and along t.

    Attributes:
        s: Functions along s.
        t: Functions along t.
    """

    s: AxisBasis
    t: AxisBasis

    @cached_property
    def inside(self) -> NDArray[np.int64]:
        """Function pairs of the inside, bubbles times bubbles, shape (order^2, 2)."""
        return _pairs(range(self.s.order), range(self.t.order))

    @cached_property
    def strips(self) -> NDArray[np.int64]:
        """Function pairs of the four strips, shape (4, 4 order, 2).

        Strips along s of the first and second row, then along t of the first and second
        column; in each the functions of its outer edge first, then of its inner edge.
        """
        order = self.s.order
        edge = order + 2 * np.arange(4)  # first of the two functions of each edge
        bubbles = range(order)
        out = []
        for outer, inner in ((0, 1), (3, 2)):
            across = [edge[outer], edge[outer] + 1, edge[inner], edge[inner] + 1]
            out.append(_pairs(across, bubbles)[:, ::-1])
        out += [pairs[:, ::-1] for pairs in out]
        return np.stack(out)

    @cached_property
    def functions(self) -> NDArray[np.int64]:
        """All unknown function pairs: the strips in turn, then the inside."""
        return np.concatenate([self.strips.reshape(-1, 2), self.inside])

    def rows(
        self, functions: NDArray, s: Array, t: Array, ds: int = 0, dt: int = 0
    ) -> tuple[Array, Array]:
        """Values of functions and cups at points, as constant rows.

        Args:
            functions: Function pairs, shape (n, 2).
            s: Coordinates along s, shape (k,), in [m].
            t: Coordinates along t, shape (k,), in [m].
            ds: Derivatives along s.
            dt: Derivatives along t.

        Returns:
            Rows over the functions, shape (k, n), and over position, s and t direction
            of the four cups, shape (k, 12).
        """
        along_s, along_t = self.s.evaluate(s, ds), self.t.evaluate(t, dt)
        free = along_s[:, functions[:, 0]] * along_t[:, functions[:, 1]]
        on_s, on_t = along_s @ self.s.cup_columns(), along_t @ self.t.cup_columns()
        cups = [
            on_s[:, 2 * j + a] * on_t[:, 2 * i + b]
            for i in (0, 1)
            for j in (0, 1)
            for a, b in ((0, 0), (1, 0), (0, 1))
        ]
        return free, np.stack(cups, axis=-1)

    def piece(
        self,
        functions: NDArray,
        intervals: tuple[int, int],
        material: Material,
        points: tuple[int, int],
    ) -> Piece:
        """Matrices of the given functions over one region.

        Args:
            functions: Function pairs, shape (n, 2).
            intervals: Interval along s and along t.
            material: What the ply is made of.
            points: Gauss points along a span and along a cup.

        Returns:
            The matrices. Bending and weight are integrated exactly, stretch and shear
            on the given points: fewer than exact, or the ply would lock.
        """
        s, t, weights = self._grid(intervals, points)
        ds, ds_cups = self.rows(functions, s, t, 1, 0)
        dt, dt_cups = self.rows(functions, s, t, 0, 1)
        moduli = np.array([material.stretch, material.stretch, material.shear])
        roots = np.sqrt(moduli[:, None] * weights)
        s_all, t_all, w_all = self._grid(intervals, (self.s.order + 4, 6))
        size = len(functions) + 12
        matrix = np.zeros((size, size))
        factors = (material.bending, material.bending, 4 * material.torsion)
        for factor, (a, b) in zip(factors, ((2, 0), (0, 2), (1, 1)), strict=True):
            both = np.concatenate(self.rows(functions, s_all, t_all, a, b), axis=-1)
            matrix += factor * (both.T * w_all) @ both
        n = len(functions)
        values = self.rows(functions, s, t)[0]
        areas = w_all @ self.rows(functions, s_all, t_all)[0]
        return Piece(
            *(ds, dt, ds_cups, dt_cups, values, roots),
            *(matrix[:n, :n], matrix[:n, n:], matrix[n:, n:]),
            *(areas[:, None] * np.array(material.weight), *self._band(material, s, t)),
        )

    def _band(self, material: Material, s: Array, t: Array) -> Array:
        """Green strains at which fibers begin to pull at points, shape (2, 3, k)."""
        out = np.zeros((2, 3, len(s)))
        for k, (axis, x) in enumerate(((self.s, s), (self.t, t))):
            u = np.clip((x - axis.half_width) / axis.length, 0, 1)
            out[:, k] = 6 * u * (1 - u) * band(material.take_up / axis.length)[:, None]
        return out

    def _grid(
        self, intervals: tuple[int, int], points: tuple[int, int]
    ) -> tuple[Array, Array, Array]:
        """Gauss points of a region, shapes (k,): s, t and weights."""
        (s, ws), (t, wt) = (
            axis.rule(interval, points[0] if interval == SPAN else points[1])
            for axis, interval in zip((self.s, self.t), intervals, strict=True)
        )
        return np.repeat(s, len(t)), np.tile(t, len(s)), np.outer(ws, wt).ravel()


STRIP_INTERVALS = ((SPAN, 0), (SPAN, 2), (0, SPAN), (2, SPAN))


def band(take_up: float) -> Array:
    """Mean Green strains at which fibers begin to pull, shape (2,).

    Args:
        take_up: Share of the length that the weave gives either way.

    Returns:
        The least and the largest strain without a force.
    """
    return (np.array([1 - take_up, 1 + take_up]) ** 2 - 1) / 2


def stack(pieces: list[Piece], count: int | None = None) -> Piece:
    """Pieces of equal sizes as one, on a leading axis; `count` of them or all."""
    names = Piece.__dataclass_fields__
    return Piece(
        **{k: np.stack([getattr(p, k) for p in pieces])[:count] for k in names}
    )


def _pairs(first: ArrayLike, second: ArrayLike) -> NDArray[np.int64]:
    """All pairs, the second running fastest, shape (n, 2)."""
    grid = np.meshgrid(np.asarray(first), np.asarray(second), indexing="ij")
    return np.stack(grid, axis=-1).reshape(-1, 2)
