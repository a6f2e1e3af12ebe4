"""Rollouts: many tries of one wave step, judged on a window of cups, by labels.

What the cups of a step move lies between them and their neighbors. A window evaluates
the ply there alone, on cubic fibers, and says of each pose whether something is
premature, trapped or too deep. Around the window the ply is what it was in poses of the
whole, or nobody knows: then a contact or a hollow that reaches the window's rim is
taken for harmless, and a fault that is told is one of the whole ply, too.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from drapeplan.cell import Cell
from drapeplan.contact import (
    FAR,
    HIGH,
    Lid,
    front_grid,
    front_tolerance,
    lid_of,
    ply_over_mold,
    under_lid,
)
from drapeplan.faults import ANCHORED, TOLD, Fault, Ring, Samples, window_faults
from drapeplan.front import CORNERS
from drapeplan.front_grid import FrontGrid
from drapeplan.verdict import Tolerance
from ply.sampling import PlySampling
from ply.shape import ply_fibers
from ply.window import window

__all__ = ["Fault", "StepWindow", "Surroundings", "window_of"]

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

AT_ONCE = 64  # [-] poses at a time: their points stay in the cache


def window_of(rows: int, columns: int, cups: NDArray[np.int64]) -> tuple[range, range]:
    """Rows and columns of some cups and their neighbors.

    Args:
        rows: Rows of the whole array.
        columns: Its columns.
        cups: Indices of the cups that move, at least one.
    """
    i, j = np.divmod(cups, columns)
    return (
        range(max(int(i.min()) - 1, 0), min(int(i.max()) + 2, rows)),
        range(max(int(j.min()) - 1, 0), min(int(j.max()) + 2, columns)),
    )


@dataclass(frozen=True)
class Surroundings:
    """What lies around a window in the poses of a step.

    Attributes:
        contact: Parts up to touch + barrier.
        air: Parts above touch.
    """

    contact: Ring
    air: Ring


@dataclass(frozen=True, eq=False)
class StepWindow:
    """A window of cups on which tries of a step are judged.

    Attributes:
        cell: Robot, mold and ply.
        grid: Samples of the whole ply.
        final_gap: Gaps of the whole in the laid state, zero beside, (nt, ns), in [m].
        lid: What stands for each of its samples; see `contact.lid_of`.
        tolerance: Tolerances of the check.
        rows: Rows of cups that the window has.
        columns: Columns of cups that it has.
        cups: Index of each of its cups in the whole array, shape (w,).
        lines: Its samples among those of the whole: slices of t and s.
    """

    cell: Cell
    grid: FrontGrid
    final_gap: Array
    lid: Lid
    tolerance: Tolerance
    rows: range
    columns: range
    cups: NDArray[np.int64] = field(init=False)
    lines: tuple[slice, slice] = field(init=False)
    _sampling: PlySampling = field(init=False, repr=False)
    _own_lid: Lid = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Cut the window out of the whole."""
        whole = self.cell.sampling
        small, cups = window(whole.grid, self.rows, self.columns)
        lines = []
        for place, part in (
            (whole.grid.place_t(whole.t), self.rows),
            (whole.grid.place_s(whole.s), self.columns),
        ):
            own = (place.cup >= part.start) & (place.cup + place.in_span < part.stop)
            lines.append(slice(int(own.argmax()), int(own.argmax() + own.sum())))
        pitch = whole.grid.pitch
        t = whole.t[lines[0]] - self.rows.start * pitch
        s = whole.s[lines[1]] - self.columns.start * pitch
        object.__setattr__(self, "cups", cups)
        own_lid = self.lid and tuple(
            np.clip(found[tuple(lines)] - line.start, 0, line.stop - line.start - 1)
            for found, line in zip(self.lid, lines, strict=True)
        )
        object.__setattr__(self, "_own_lid", own_lid)
        object.__setattr__(self, "lines", tuple(lines))
        object.__setattr__(self, "_sampling", PlySampling(small, s, t))

    @classmethod
    def of(
        cls,
        cell: Cell,
        start_cup: int,
        laid: tuple[Array, Array],
        rows: range,
        columns: range,
    ) -> StepWindow:
        """A window of a scene.

        Args:
            cell: Robot, mold and ply.
            start_cup: Index of the cup placed first.
            laid: Cup poses with all cups placed, mold frame, (n, 3) and (n, 3, 3).
            rows: Rows of cups that the window has.
            columns: Columns of cups that it has.
        """
        points, gaps = ply_over_mold(cell, laid[0][None], laid[1][None])
        beside = gaps[0] >= FAR
        grid = front_grid(cell, start_cup, beside)
        final = np.where(beside, 0.0, gaps[0])
        lid = lid_of(cell, points[0], grid)
        return cls(cell, grid, final, lid, front_tolerance(cell), rows, columns)

    def heights(self, positions: Array, rotations: Array, laid: Bools) -> Array:
        """Heights of the window's samples above the laid state.

        Args:
            positions: Positions of the window's cups, mold frame, shape
                (..., K, w, 3), in [m].
            rotations: Their rotations, shape (..., K, w, 3, 3).
            laid: Laid samples of the K poses, shape (K, nt, ns).

        Returns:
            Heights, shape (..., K, nt, ns), in [m]; zero where laid.
        """
        take_up = self.cell.scene.ply.take_up_mm * 1e-3
        poses = positions, rotations
        fibers = ply_fibers(self._sampling.grid, *poses, model="cubic", take_up=take_up)
        points = self._sampling.points(fibers, *poses)
        h = self.cell.mold.gap(points, beside=FAR)
        np.minimum(h, HIGH, out=h)
        h[..., self.grid.beside[self.lines]] = HIGH
        h -= self.final_gap[self.lines]
        h = under_lid(h, self._own_lid)
        h[..., laid] = 0.0
        return h

    def faults(
        self,
        positions: Array,
        rotations: Array,
        placed: Bools,
        landing: Bools,
        around: Surroundings | None = None,
    ) -> NDArray[np.uint8]:
        """What goes wrong in each pose of many tries of a step.

        Args:
            positions: Positions of the window's cups, mold frame, shape
                (tries, K, w, 3), in [m].
            rotations: Their rotations, shape (tries, K, w, 3, 3).
            placed: Placed cups of the whole array in the K poses, shape (K, n).
            landing: Landing cups, shape (K, n).
            around: What lies around, with the same K poses; None where nobody knows.

        Returns:
            Fault flags, shape (tries, K).
        """
        part = (slice(None), *self.lines)
        laid = self.grid.laid(placed)[part]
        samples = Samples(laid, self.grid.on_pads(landing)[part])
        around = around or self.unknown(len(placed))
        start, vents = (x[self.lines] for x in (self.grid.start_pad, self.grid.vents))
        tolerance = self.tolerance
        limits = (
            tolerance.touch,
            tolerance.barrier,
            tolerance.penetration,
            tolerance.pad_penetration,
        )
        out = np.empty(positions.shape[:2], dtype=np.uint8)
        chunk = max(1, AT_ONCE // max(1, len(placed)))
        for first in range(0, len(positions), chunk):
            some = slice(first, first + chunk)
            h = self.heights(positions[some], rotations[some], laid)
            out[some] = window_faults(
                h, samples, start, vents, around.contact, around.air, limits
            )
        return out

    def unknown(self, poses: int) -> Surroundings:
        """Surroundings that nobody knows: whatever reaches the rim is harmless."""
        part = np.where(self._padded(np.ones(self.grid.beside.shape, bool)), 0, -1)
        parts = np.broadcast_to(part.astype(np.int32), (poses, *part.shape))
        bits = np.full((poses, 1), ANCHORED, np.uint8)
        ring = Ring(np.ascontiguousarray(parts), bits)
        return Surroundings(ring, ring)

    def around(self, h: Array) -> Surroundings:
        """Surroundings in poses of the whole ply.

        They hold for all tries whose cups on the window's rim stand as in these poses.

        Args:
            h: Heights of the whole above the laid state, shape (K, nt, ns), in [m].
        """
        touch, top = self.tolerance.touch, self.tolerance.touch + self.tolerance.barrier
        outside = np.ones(h.shape[1:], dtype=bool)
        outside[self.lines] = False
        grid = self.grid
        contact = [
            self._parts((one <= top) & outside, grid.start_pad, one < -np.inf, True)
            for one in h
        ]
        air = [
            self._parts((one > touch) & outside, grid.vents, one > top, False)
            for one in h
        ]
        return Surroundings(_stack(contact), _stack(air))

    def _parts(
        self, of: Bools, anchors: Bools, tells: Bools, corners: bool
    ) -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
        """Parts of a mask around the window, shape (nt + 2, ns + 2), and their bits."""
        labels, count = ndimage.label(of, CORNERS if corners else None)
        bits = np.zeros(count + 1, np.uint8)
        bits[labels[anchors]] |= ANCHORED
        bits[labels[tells & of]] |= TOLD
        return self._padded(labels).astype(np.int32) - 1, bits[1:]

    def _padded(self, field: NDArray) -> NDArray:
        """A field of the whole over the window and one sample around it, else zero."""
        rows, columns = self.lines
        wide = np.pad(field, 1)
        return wide[rows.start : rows.stop + 2, columns.start : columns.stop + 2]


def _stack(rings: list[tuple[NDArray[np.int32], NDArray[np.uint8]]]) -> Ring:
    """Rings of the poses as one, with as many parts as the pose that has most."""
    most = max(len(bits) for _, bits in rings)
    bits = np.zeros((len(rings), max(most, 1)), np.uint8)
    for row, (_, own) in zip(bits, rings, strict=True):
        row[: len(own)] = own
    return Ring(np.stack([part for part, _ in rings]), bits)
