r"""Points of the whole ply on a tensor grid of lines, in a few matrix products.

Both families of Section 5.3 are separable: gamma_s is the curves along s, weighted
along t. So the surface is

.. math:: P = W \circ (A_t C_s) + (1 - W) \circ (C_t^T A_s^T),

where :math:`C_s` holds the fibers of each row of cups at the lines of s (straight where
they cross cups), :math:`A_t` the weights of those curves at the lines of t (Eq. 24 on
the cups, Eq. 35-39 between them), :math:`C_t` and :math:`A_s` the same for the columns,
and :math:`W` the blend: 1 along rows of cups, 0 on the strips along t,
Eq. 46-50 inside the patches.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ply import patch, strip
from ply.errors import PlyError
from ply.fiber import Array, powers
from ply.grid import EDGE, AxisPlace, CupGrid
from ply.weave import PlyFibers

IN_CACHE = 8  # [-] poses at a time: their arrays stay in the cache


@dataclass(frozen=True, eq=False)
class PlySampling:
    """A tensor grid of material points with its constant matrices.

    Lines beyond the outer cups are overhang: cup squares and strips extended linearly.

    Attributes:
        grid: The cup array.
        s: Material lines across the columns, shape (n_s,), in [m].
        t: Material lines across the rows, shape (n_t,), in [m].
        cup_index: Cup whose square holds each point, -1 elsewhere, shape (n_t, n_s).
        cups_around: The cups that each point depends on, shape (n_t, n_s, 4): on a cup
            one, four times; on a strip two, twice each; in a patch four.
    """

    grid: CupGrid
    s: Array
    t: Array
    cup_index: NDArray[np.int64] = field(init=False)
    cups_around: NDArray[np.int64] = field(init=False)
    _blend: Array = field(init=False)  # (n_t, n_s)
    _matrices: dict[tuple[int, int], "_Matrices"] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check the lines and fill the matrices."""
        grid = self.grid
        s, t = grid.place_s(_lines("s", self.s)), grid.place_t(_lines("t", self.t))
        both = t.in_span[:, None] & s.in_span
        shares = patch.blend(s.u, t.u[:, None])
        on_cup = ~(t.in_span | t.overhang)[:, None] & ~(s.in_span | s.overhang)
        nearest = t.cup[:, None] * grid.columns + s.cup
        corners = [(0, 0), (0, 1), (1, 0), (1, 1)]
        around = [
            nearest + i * grid.columns * t.in_span[:, None] + j * s.in_span
            for i, j in corners
        ]
        arrays = {
            "s": np.array(self.s, dtype=float),
            "t": np.array(self.t, dtype=float),
            "cup_index": np.where(on_cup, nearest, -1),
            "cups_around": np.stack(around, axis=-1),
            "_blend": np.where(both, shares, ~t.in_span[:, None]),
        }
        for name, array in arrays.items():
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        object.__setattr__(self, "_matrices", {})

    @classmethod
    def regular(
        cls, grid: CupGrid, step: float, overhang: float = 0.0
    ) -> "PlySampling":
        """Lines at a step that divides cups and spans alike.

        Args:
            grid: The cup array.
            step: Distance between lines, in [m].
            overhang: Ply beyond the edges of the outer cups, in [m]; sampled at
                multiples of the step and at its exact edge.

        Returns:
            The sampling.

        Raises:
            PlyError: The step does not divide cup width and span, or the overhang is
                negative.
        """
        if not (np.isfinite(overhang) and overhang >= 0):
            raise PlyError("overhang", f"{overhang:g} m", "use a length of 0 or more")
        for length in (2 * grid.half_width, grid.span):
            count = round(length / step) if np.isfinite(step) and step > EDGE else 0
            if count < 1 or abs(count * step - length) > EDGE:
                remedy = f"cups are {1e3 * 2 * grid.half_width:g} mm wide, "
                remedy += f"spans {1e3 * grid.span:g} mm"
                raise PlyError(
                    "step", f"{1e3 * step:g} mm does not divide both", remedy
                )
        s = _regular_lines(grid, grid.columns, step, overhang)
        return cls(grid, s, _regular_lines(grid, grid.rows, step, overhang))

    @property
    def points_st(self) -> Array:
        """Material coordinates (s, t) of all points, shape (n_t, n_s, 2), in [m]."""
        return np.stack(np.meshgrid(self.s, self.t), axis=-1)

    def points(self, fibers: PlyFibers, positions: Array, rotations: Array) -> Array:
        """Positions of all points.

        Args:
            fibers: Fibers of the same poses.
            positions: Centers of the suction faces, shape (..., n_cups, 3), in [m].
            rotations: Cup frames, shape (..., n_cups, 3, 3).

        Returns:
            Points, shape (..., n_t, n_s, 3), in [m].
        """
        batch = np.shape(positions)[:-2]
        poses = math.prod(batch)
        arrays = [
            np.reshape(array, (poses, *np.shape(array)[len(batch) :]))
            for array in (fibers.s, fibers.t, positions, rotations)
        ]
        out = np.empty((poses, len(self.t), len(self.s), 3))
        for start in range(0, poses, IN_CACHE):
            part = slice(start, start + IN_CACHE)
            self._fill(out[part], *(array[part] for array in arrays))
        return out.reshape(*batch, *out.shape[1:])

    def _fill(
        self, out: Array, s: Array, t: Array, positions: Array, rotations: Array
    ) -> None:
        """Points of a few poses, from the coefficients of their fibers."""
        rows, columns = self.grid.rows, self.grid.columns
        poses, (count, terms) = len(out), s.shape[-3:-1]
        matrices = self._matrices_of(count, terms)
        edges = self._cup_edges(positions, rotations, count)
        along_s = np.moveaxis(s, (-1, -4), (-5, -2))  # (3, rows, count, spans, terms)
        s_shape = (poses, 3 * rows * count, terms * (columns - 1))
        s_terms = np.concatenate([along_s.reshape(s_shape), edges], axis=-1)
        along_t = np.moveaxis(t, (-1, -5), (-5, -2))  # (3, columns, count, ...)
        t_terms = along_t.reshape(poses, 3 * columns * count, terms * (rows - 1))
        s_tail = (3, count * rows, len(self.s))
        t_tail = (3, count * columns, len(self.t))
        s_curves = _product(s_terms, matrices.s_curves.T, s_tail)
        t_curves = _product(t_terms, matrices.t_curves.T, t_tail)
        gamma_s = matrices.t_weights @ s_curves  # (poses, 3, n_t, n_s)
        gamma_t = np.swapaxes(t_curves, -1, -2) @ matrices.s_weights.T
        gamma_s -= gamma_t
        gamma_s *= self._blend
        np.add(gamma_s, gamma_t, out=np.moveaxis(out, -1, -3))

    def _matrices_of(self, count: int, terms: int) -> "_Matrices":
        """The matrices for strips of so many fibers with so many terms, made once."""
        if (count, terms) not in self._matrices:
            grid, half = self.grid, self.grid.half_width
            s, t = grid.place_s(self.s), grid.place_t(self.t)
            curves = [_fiber_rows(s, grid.columns, terms), _cup_rows(s, grid.columns)]
            self._matrices[count, terms] = _Matrices(
                np.concatenate(curves, axis=-1),
                _fiber_rows(t, grid.rows, terms),
                _curve_weights(s, grid.columns, grid.s_length, half, count),
                _curve_weights(t, grid.rows, grid.t_length, half, count),
            )
        return self._matrices[count, terms]

    def _cup_edges(self, positions: Array, rotations: Array, count: int) -> Array:
        """Origins and directions of the lines that fibers along s draw on the cups.

        Shape (..., 3 * rows * count, columns * 2), ordered (coordinate, row, fiber) and
        (column, origin or direction).
        """
        rows, columns = self.grid.rows, self.grid.columns
        batch = np.shape(positions)[:-2]
        edges = np.empty((*batch, 3, rows, count, columns, 2))
        tail = (3, rows, columns)
        p = np.swapaxes(positions, -1, -2).reshape(*batch, *tail)
        frames = np.moveaxis(rotations, (-1, -2), (-3, -2)).reshape(*batch, 3, *tail)
        x, y = frames[..., 0, :, :, :], frames[..., 1, :, :, :]
        offsets = np.linspace(-self.grid.half_width, self.grid.half_width, count)
        edges[..., 0] = p[..., None, :] + offsets[:, None] * y[..., None, :]
        edges[..., 1] = x[..., None, :]
        return edges.reshape(*batch, 3 * rows * count, 2 * columns)


class _Matrices(NamedTuple):
    """Constant matrices of a sampling, for count fibers a strip with K terms each."""

    s_curves: Array  # (n_s, K (columns - 1) + 2 columns)
    t_curves: Array  # (n_t, K (rows - 1))
    s_weights: Array  # (n_s, count columns)
    t_weights: Array  # (n_t, count rows)


def _lines(name: str, lines: ArrayLike) -> Array:
    array = np.asarray(lines, dtype=float)
    if array.ndim != 1 or not len(array) or not np.isfinite(array).all():
        raise PlyError(name, f"shape {array.shape}", "give one row of finite numbers")
    return array


def _regular_lines(grid: CupGrid, count: int, step: float, overhang: float) -> Array:
    first, last = -grid.half_width, (count - 1) * grid.pitch + grid.half_width
    inside = first + step * np.arange(round((last - first) / step) + 1)
    beyond = step * np.arange(1, np.ceil((overhang - EDGE) / step))
    if overhang > EDGE:
        beyond = np.append(beyond, overhang)
    return np.concatenate([first - beyond[::-1], inside, last + beyond])


def _fiber_rows(place: AxisPlace, cups: int, terms: int) -> Array:
    """Powers of u in the columns of each line's own span, (n, terms (cups - 1))."""
    rows = np.zeros((len(place.y), cups, terms))
    span = np.flatnonzero(place.in_span)
    rows[span, place.cup[span]] = powers(place.u[span], terms)
    return rows[:, :-1].reshape(len(place.y), -1)


def _cup_rows(place: AxisPlace, count: int) -> Array:
    """Rows (1, y) in the columns of each line's own cup, shape (n, 2 count)."""
    rows = np.zeros((len(place.y), count, 2))
    cup = np.flatnonzero(~place.in_span)
    rows[cup, place.cup[cup], 0] = 1
    rows[cup, place.cup[cup], 1] = place.y[cup]
    return rows.reshape(len(place.y), -1)


def _curve_weights(
    place: AxisPlace, cups: int, length: float, half_width: float, count: int
) -> Array:
    """Weights of the curves of each cup's fibers, shape (n, count cups)."""
    rows = np.zeros((len(place.y), cups, count))
    cup, span = np.flatnonzero(~place.in_span), np.flatnonzero(place.in_span)
    rows[cup, place.cup[cup]] = strip.across(place.y[cup], half_width, count)
    both = patch.across(place.u[span], length, half_width, count)
    rows[span, place.cup[span]] = both[:, :count]
    rows[span, place.cup[span] + 1] = both[:, count:]
    return rows.reshape(len(place.y), -1)


def _product(terms: Array, curves: Array, tail: tuple[int, int, int]) -> Array:
    """Terms (..., m, k) times curves (k, n), as one product of shape (..., *tail)."""
    *batch, m, k = terms.shape
    flat = terms.reshape(math.prod(batch) * m, k) @ curves
    return flat.reshape(*batch, *tail)
