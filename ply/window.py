"""Part of the ply: windows of cups, and points renewed where cups have moved.

A point depends on the cups around it alone, so a step that moves few cups leaves most
of the ply as it was. A window is a smaller array of cups with a ply of its own; what
lies between its cups is the same as in the whole.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ply.errors import PlyError
from ply.fiber import Array
from ply.grid import AxisPlace, CupGrid
from ply.sampling import PlySampling
from ply.weave import Sides, ply_fibers


def window(
    grid: CupGrid, rows: range, columns: range
) -> tuple[CupGrid, NDArray[np.int64]]:
    """A rectangle of cups as an array of its own.

    Args:
        grid: The whole array.
        rows: Its rows that the window has, without gaps.
        columns: Its columns that the window has, without gaps.

    Returns:
        The window's grid, whose material coordinates begin at its own first cup, and
        the index of each of its cups in the whole array, shape (window's n_cups,).

    Raises:
        PlyError: A range is empty, has gaps, or leaves the array.
    """
    for name, part, count in (
        ("rows", rows, grid.rows),
        ("columns", columns, grid.columns),
    ):
        if not (part.step == 1 and 0 <= part.start < part.stop <= count):
            problem = f"{part} is no part of {count} without gaps"
            raise PlyError(name, problem, "give a range from a first to a last one")
    lengths = grid.s_length, grid.t_length
    small = CupGrid(len(rows), len(columns), grid.pitch, grid.half_width, *lengths)
    cups = np.arange(rows.start, rows.stop)[:, None] * grid.columns
    return small, (cups + np.arange(columns.start, columns.stop)).ravel()


@dataclass(frozen=True, eq=False)
class PlyWindow:
    """Renews sampled points of a ply where its cups have moved.

    Attributes:
        sampling: The points of the whole ply.
        settings: Arguments of `ply_fibers` for them, sides aside.
    """

    sampling: PlySampling
    settings: dict[str, Any] = field(default_factory=dict)
    _boxes: dict["_Box", "_Part"] = field(default_factory=dict, init=False, repr=False)

    def update(
        self,
        points: Array,
        moved_cups: ArrayLike,
        positions: Array,
        rotations: Array,
        sides: Sides | tuple[ArrayLike, ArrayLike] | None = None,
    ) -> Array:
        """Points of the new poses, from those of the poses before.

        Args:
            points: Points before, shape (..., n_t, n_s, 3), in [m].
            moved_cups: Indices of the cups that have moved in any pose of the batch.
            positions: New centers of the faces of all cups, shape (..., n_cups, 3).
            rotations: New frames of all cups, shape (..., n_cups, 3, 3).
            sides: Sides of all strips, for "modal". None leaves them to the cups, as
                `ply_fibers` does: then the points before must have been left so, too.

        Returns:
            A copy of the points, renewed where a cup around them has moved, and in the
            corners between such cups.

        Raises:
            PlyError: A cup is not in the array, or as `ply_fibers`.
        """
        grid, out = self.sampling.grid, np.array(points, dtype=float)
        cups = np.atleast_1d(np.asarray(moved_cups, dtype=np.int64))
        if cups.size and not (0 <= cups.min() and cups.max() < grid.n_cups):
            problem = f"cups {cups.min()} to {cups.max()}"
            raise PlyError("moved_cups", problem, f"the grid has {grid.n_cups} cups")
        for box in _boxes_around(grid, np.unique(cups)):
            part = self._part(box)
            kept = positions[..., part.cups, :], rotations[..., part.cups, :, :]
            fibers = ply_fibers(
                part.sampling.grid,
                *kept,
                **self.settings | _sides(sides, box.around(grid)),
            )
            out[part.place] = part.sampling.points(fibers, *kept)
        return out

    def _part(self, box: "_Box") -> "_Part":
        """The sampling that a box of moved cups asks for, made once."""
        if box not in self._boxes:
            whole, grid = self.sampling, self.sampling.grid
            wide = box.around(grid)
            rows = range(wide.first_row, wide.last_row + 1)
            columns = range(wide.first_column, wide.last_column + 1)
            small, cups = window(grid, rows, columns)
            s_lines = _lines(grid.place_s(whole.s), box.first_column, box.last_column)
            t_lines = _lines(grid.place_t(whole.t), box.first_row, box.last_row)
            near_s = whole.s[s_lines] - columns.start * grid.pitch
            near_t = whole.t[t_lines] - rows.start * grid.pitch
            sampling = PlySampling(small, near_s, near_t)
            place: tuple[Any, ...] = (..., t_lines[:, None], s_lines, slice(None))
            if all((np.diff(lines) == 1).all() for lines in (s_lines, t_lines)):
                t_part, s_part = (
                    slice(lines[0], lines[-1] + 1) if lines.size else slice(0)
                    for lines in (t_lines, s_lines)
                )
                place = (..., t_part, s_part, slice(None))
            self._boxes[box] = _Part(sampling, cups, place)
        return self._boxes[box]


class _Box(NamedTuple):
    """A rectangle of moved cups, its last ones included."""

    first_row: int
    last_row: int
    first_column: int
    last_column: int

    def size(self, grid: CupGrid) -> int:
        """Number of its cups and their neighbors."""
        wide = self.around(grid)
        rows = wide.last_row - wide.first_row + 1
        return rows * (wide.last_column - wide.first_column + 1)

    def around(self, grid: CupGrid) -> "_Box":
        """The box with its neighbors."""
        return _Box(
            max(self.first_row - 1, 0),
            min(self.last_row + 1, grid.rows - 1),
            max(self.first_column - 1, 0),
            min(self.last_column + 1, grid.columns - 1),
        )

    def joined(self, other: "_Box") -> "_Box":
        return _Box(
            min(self.first_row, other.first_row),
            max(self.last_row, other.last_row),
            min(self.first_column, other.first_column),
            max(self.last_column, other.last_column),
        )


class _Part(NamedTuple):
    """What a box of moved cups needs of the whole sampling."""

    sampling: PlySampling
    cups: NDArray[np.int64]
    place: tuple[Any, ...]  # of its points among all


def _boxes_around(grid: CupGrid, cups: Iterable[np.int64]) -> list[_Box]:
    """Boxes that hold the cups, joined where that costs less."""
    boxes: list[_Box] = []
    for cup in cups:
        row, column = divmod(int(cup), grid.columns)
        box = _Box(row, row, column, column)
        while True:
            near = [
                b
                for b in boxes
                if b.joined(box).size(grid) <= b.size(grid) + box.size(grid)
            ]
            if not near:
                break
            boxes.remove(near[0])
            box = box.joined(near[0])
        boxes.append(box)
    return boxes


def _lines(place: AxisPlace, first: int, last: int) -> NDArray[np.int64]:
    """Lines that depend on cups from a first to a last one."""
    depends = (place.cup + place.in_span >= first) & (place.cup <= last)
    return np.flatnonzero(depends)


def _sides(
    sides: Sides | tuple[ArrayLike, ArrayLike] | None, box: _Box
) -> dict[str, Any]:
    """The sides of a box's strips, as an argument of `ply_fibers`."""
    if sides is None:
        return {}
    (i, j), (k, m) = (box.first_row, box.last_row), (box.first_column, box.last_column)
    s, t = (np.asarray(side) for side in sides)
    return {"sides": (s[..., i : j + 1, k:m], t[..., i:j, k : m + 1])}
