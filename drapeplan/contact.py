"""Contact: the ply over the mold, pose by pose, and the order in which they meet."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from drapeplan.cell import Cell
from drapeplan.front import check_front
from drapeplan.front_grid import FrontGrid
from drapeplan.held_ply import CUBIC, PlyModel, held_fibers, held_points
from drapeplan.mold import HeightGrid
from drapeplan.ply_choice import PlyChoice, choose_ply
from drapeplan.refine import Stops, judge_between
from drapeplan.sequence import Sequence
from drapeplan.verdict import FrontVerdict, Tolerance
from ply.shape import PlyFibers

Array = NDArray[np.float64]

Lid = tuple[NDArray[np.int32], NDArray[np.int32]] | None

FAR = 1.0  # [m] gap of ply that hangs beside the mold: it meets nothing there
HIGH = 0.2  # [m] gaps beyond are all the same to the front check


@dataclass(frozen=True)
class Contact:
    """The ply over the mold, pose by pose.

    Attributes:
        points: Ply in the mold frame, shape (K, nt, ns, 3), in [m].
        gap: Signed distance to the mold, shape (K, nt, ns), in [m]; FAR beside it.
        beside: Samples that hang beside the mold in the laid state, shape (nt, ns).
        lid: What the front sees in place of each sample; see `lid_of`.
        front: The verdict on the order of contact.
        choice: The ply model, and why.
        fibers: Fibers of the ply on it.
    """

    points: Array
    gap: Array
    beside: NDArray[np.bool_]
    lid: Lid
    front: FrontVerdict
    choice: PlyChoice
    fibers: PlyFibers
    mold: HeightGrid = field(repr=False)

    @cached_property
    def drawn(self) -> tuple[Array, Array]:
        """The ply as it lies, none of it in the mold: points and gap, as above.

        The free shape knows no mold: its depth below one says how hard it is pushed in,
        so the verdict rests on it. Clipped, it is nearer to the shape of ply that
        touches in part: 0.1 to 0.3 mm from an obstacle beam, of 0.1 to 0.65 mm.
        """
        return clipped(self.mold, self.points, self.gap)


def ply_over_mold(
    cell: Cell,
    positions: Array,
    rotations: Array,
    model: PlyModel = CUBIC,
    fibers: PlyFibers | None = None,
) -> tuple[Array, Array]:
    """Free shape of the ply and its gap to the mold.

    Args:
        cell: Robot, mold and ply.
        positions: Cup positions in the mold frame, shape (K, n, 3), in [m].
        rotations: Cup rotations in the mold frame, shape (K, n, 3, 3).
        model: What of the ply is modeled.
        fibers: Fibers of the poses on that model, where a caller has them.

    Returns:
        Points (K, nt, ns, 3) in the mold frame and gaps (K, nt, ns), both in [m];
        beside the mold the gap is FAR.
    """
    if fibers is None:
        fibers = held_fibers(cell, positions, rotations, model)
    points = held_points(cell, fibers, positions, rotations, model)
    return points, cell.mold.gap(points, beside=FAR)


def clipped(mold: HeightGrid, points: Array, gap: Array) -> tuple[Array, Array]:
    """Points with those below the mold put on it, along its normals.

    Args:
        mold: The mold.
        points: Points in the mold frame, shape (..., 3), in [m].
        gap: Their gaps, shape (...), in [m].

    Returns:
        Points and gaps, of the same shapes.
    """
    below = gap < 0
    raised, low = points.copy(), points[below]
    raised[below] -= gap[below][:, None] * mold.normal(low[:, 0], low[:, 1])
    return raised, np.maximum(gap, 0.0)


def front_grid(cell: Cell, start_cup: int, beside: NDArray[np.bool_]) -> FrontGrid:
    """The cell's samples as the front check asks for them.

    Args:
        cell: Robot, mold and ply.
        start_cup: Index of the cup placed first.
        beside: Samples that hang beside the mold in the laid state, shape (nt, ns).
    """
    sampling = cell.sampling
    return FrontGrid(
        sampling.s,
        sampling.t,
        sampling.cup_index,
        sampling.cups_around,
        cell.grid.columns,
        start_cup,
        beside,
    )


def lid_of(cell: Cell, laid: Array, grid: FrontGrid) -> Lid:
    """Sample that stands for each in the order of contact: itself, but over openings.

    Over an opening of the mold (a channel under its edges) the gap jumps from the edge
    to the floor, and the ply touches neither. There it counts as high as the nearest
    sample beside the opening, as if a lid closed it.

    Args:
        cell: Gives the mold.
        laid: Ply in the laid state, mold frame, shape (nt, ns, 3), in [m].
        grid: The samples; pads are never over an opening.

    Returns:
        Indices along t and s, each of shape (nt, ns); None where nothing is open.
    """
    opening = cell.mold.opening(laid) & ~grid.beside & (grid.cup_index < 0)
    if not opening.any():
        return None
    nearest = distance_transform_edt(
        opening | grid.beside,
        sampling=(np.diff(grid.t).mean(), np.diff(grid.s).mean()),
        return_distances=False,
        return_indices=True,
    )
    i, j = np.where(opening, nearest, np.indices(opening.shape))
    return i, j


def under_lid(values: Array, lid: Lid) -> Array:
    """Values of samples, each taken from the one that stands for it.

    Args:
        values: Shape (..., nt, ns).
        lid: Who stands for whom, of `lid_of`.
    """
    return values if lid is None else values[..., *lid]


def front_tolerance(cell: Cell) -> Tolerance:
    """Tolerances of the scene."""
    limits = cell.scene.tolerance
    return Tolerance(
        limits.touch_mm * 1e-3,
        limits.barrier_mm * 1e-3,
        limits.penetration_mm * 1e-3,
        limits.pad_penetration_mm * 1e-3,
    )


def judge_contact(
    cell: Cell,
    sequence: Sequence,
    poses: tuple[Array, Array],
    placed: NDArray[np.bool_],
    landing: NDArray[np.bool_],
    refined: bool = True,
) -> Contact:
    """Whether the material meets the mold outward from the start.

    Between two poses cups go straight; there the ply is judged where a fault could
    hide, and what it shows counts for the pose that follows.

    Args:
        cell: Robot, mold and ply.
        sequence: Gives the start cup.
        poses: Cup poses in the mold frame; in the last one all cups are placed.
        placed: Placed cups of each pose, shape (K, n).
        landing: Landing cups of each pose, shape (K, n).
        refined: Whether the ply is judged between poses, too.
    """
    choice, fibers = choose_ply(cell, *poses)
    points, gap = ply_over_mold(cell, *poses, choice.model, fibers)
    beside = gap[-1] >= FAR
    samples = front_grid(cell, sequence.index(sequence.start_cup), beside)
    final = np.where(beside, 0.0, gap[-1])
    lid = lid_of(cell, points[-1], samples)
    tolerance = front_tolerance(cell)

    def seen(gap: Array) -> Array:
        return under_lid(np.where(beside, HIGH, np.minimum(gap, HIGH)), lid)

    def between(stops: Stops, new: NDArray[np.bool_]) -> Array:
        if choice.model.name == "cubic":
            return seen(ply_over_mold(cell, *stops.some(new).poses, choice.model)[1])
        held = held_fibers(cell, *stops.poses, choice.model)  # sides go along the path
        own = PlyFibers(*(getattr(held, f.name)[new] for f in fields(held)))
        points = held_points(cell, own, *stops.some(new).poses, choice.model)
        return seen(cell.mold.gap(points, beside=FAR))

    if refined:
        stops = Stops.at_waypoints(poses, placed, landing)
        front = judge_between(
            stops, seen(gap), under_lid(final, lid), samples, tolerance, between
        )
    else:
        front = check_front(
            seen(gap), under_lid(final, lid), samples, placed, landing, tolerance
        )
    bridge = samples.spot(final, np.ones(final.shape, bool))
    front = replace(front, highest=bridge)
    return Contact(points, gap, beside, lid, front, choice, fibers, cell.mold)
