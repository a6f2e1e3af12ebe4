"""The cup array and the material coordinates of the ply it holds.

The ply is measured before it is bent: s runs along the columns, t along the rows, and
the center of cup (row i, column j) is material point (j, i) * pitch. The edges of the
cups cut the ply into cup squares, strips between two neighboring cups, and patches
between four, Fig. 4 of [Nielsen2018].
"""

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ply.errors import PlyError

Array = NDArray[np.float64]

EDGE = 1e-9  # [m] a point this near to a cup's edge belongs to the cup: rounding


class Region(IntEnum):
    """Part of the ply that a material point lies in."""

    CUP = 0
    S_STRIP = 1  # between two neighbors of one row: fibers run along s
    T_STRIP = 2  # between two neighbors of one column: fibers run along t
    PATCH = 3  # between four cups
    OVERHANG = 4  # beyond the outer edges of the outer cups


@dataclass(frozen=True)
class AxisPlace:
    """Where coordinates lie on one axis of the cup array; all of one shape.

    Attributes:
        cup: Cup that holds the coordinate, or the last one before its span.
        y: Distance from that cup's center, in [m].
        u: Position in the span behind that cup, from 0 to 1; 0 on a cup.
        in_span: True between two cups.
        overhang: True beyond the outer edge of an outer cup.
    """

    cup: NDArray[np.int64]
    y: Array
    u: Array
    in_span: NDArray[np.bool_]
    overhang: NDArray[np.bool_]


@dataclass(frozen=True)
class CupGrid:
    """A rectangular array of cups, each holding a square of the ply.

    Attributes:
        rows: Number of cups along t.
        columns: Number of cups along s.
        pitch: Material distance between neighboring centers, in [m].
        half_width: Half side of the square that a cup holds, in [m].
        s_length: Length of a free fiber along s, in [m]; by default the span.
        t_length: Length of a free fiber along t, in [m]; by default the span.
    """

    rows: int
    columns: int
    pitch: float
    half_width: float
    s_length: float = None  # type: ignore[assignment]  # filled in below
    t_length: float = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        """Check the numbers and fill in the default lengths."""
        for name in ("rows", "columns"):
            if getattr(self, name) < 1:
                raise PlyError(name, f"{getattr(self, name)} is less than 1")
        for name in ("pitch", "half_width"):
            _check_positive(name, getattr(self, name))
        if self.span <= 2 * EDGE:
            problem = f"{self.half_width:g} m leaves no free span at this pitch"
            raise PlyError("half_width", problem, "keep it below half the pitch")
        for name in ("s_length", "t_length"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, self.span)
            _check_positive(name, getattr(self, name))

    @property
    def span(self) -> float:
        """Material distance between the edges of two neighboring cups, in [m]."""
        return self.pitch - 2 * self.half_width

    @property
    def n_cups(self) -> int:
        """Number of cups."""
        return self.rows * self.columns

    @cached_property
    def neighbors(self) -> NDArray[np.int64]:
        """Pairs of neighboring cups, shape (pairs, 2).

        All pairs along s in row-major order, then all pairs along t.
        """
        index = np.arange(self.n_cups).reshape(self.rows, self.columns)
        along_s = np.stack([index[:, :-1], index[:, 1:]], axis=-1).reshape(-1, 2)
        along_t = np.stack([index[:-1], index[1:]], axis=-1).reshape(-1, 2)
        return _frozen(np.concatenate([along_s, along_t]))

    @property
    def n_s_pairs(self) -> int:
        """Number of neighbor pairs along s, which come first in `neighbors`."""
        return self.rows * (self.columns - 1)

    @cached_property
    def centers(self) -> Array:
        """Material coordinates (s, t) of the cup centers, shape (n_cups, 2), in [m]."""
        row, column = np.divmod(np.arange(self.n_cups), self.columns)
        return _frozen(self.pitch * np.stack([column, row], axis=-1))

    def place_s(self, s: ArrayLike) -> AxisPlace:
        """Where material coordinates s, in [m], lie among the columns."""
        return self._place(np.asarray(s, dtype=float), self.columns)

    def place_t(self, t: ArrayLike) -> AxisPlace:
        """Where material coordinates t, in [m], lie among the rows."""
        return self._place(np.asarray(t, dtype=float), self.rows)

    def regions(self, points_st: ArrayLike) -> NDArray[np.int64]:
        """Region of each material point.

        Args:
            points_st: Material coordinates (s, t), shape (..., 2), in [m].

        Returns:
            Values of Region, shape (...).
        """
        points_st = np.asarray(points_st, dtype=float)
        s, t = self.place_s(points_st[..., 0]), self.place_t(points_st[..., 1])
        region = Region.S_STRIP * s.in_span + Region.T_STRIP * t.in_span
        return np.where(s.overhang | t.overhang, Region.OVERHANG, region)

    def _place(self, x: Array, count: int) -> AxisPlace:
        start = np.floor((x + self.half_width + EDGE) / self.pitch)
        cup = np.clip(start, 0, count - 1).astype(np.int64)
        y = x - cup * self.pitch
        in_span = (y > self.half_width + EDGE) & (cup < count - 1)
        u = np.where(in_span, np.clip((y - self.half_width) / self.span, 0, 1), 0.0)
        overhang = ~in_span & (abs(y) > self.half_width + EDGE)
        return AxisPlace(cup, y, u, in_span, overhang)


def _check_positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0):
        raise PlyError(name, f"{value:g} m is not a positive length")


def _frozen(array: NDArray) -> NDArray:
    array.setflags(write=False)
    return array
