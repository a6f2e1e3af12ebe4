"""Rolling: one sample of a plan under noise, from its random numbers to its margins.

A sample takes the plan's waypoints near the mold, gives the cups their errors, hangs
the ply between them, and judges the order of contact as the plan itself is judged: at
the waypoints, and on the way from the last one to where cups stand. What stays as
planned: placed cups and the ply between them, the ply's model, and the laid state above
which heights count.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from drapeplan.cell import Cell
from drapeplan.contact import FAR
from drapeplan.flood import placed_margins
from drapeplan.front_grid import FrontGrid
from drapeplan.held_ply import (
    PlyModel,
    heavy_where_slack,
    held_points,
    outside_take_up,
    weight_on_mold,
)
from drapeplan.noise import (
    Draw,
    LinkKeeper,
    Spread,
    as_registered,
    registered,
    turned,
)
from drapeplan.refine import straight_between
from drapeplan.resettle import Poses, Rests, StiffnessTable
from drapeplan.verdict import Tolerance
from ply.sag import with_sag
from ply.shape import PlyFibers, ply_fibers
from ply.weave import Sides

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

CAP = 3e-3  # [m] margins beyond are infinite: nothing threatens
AT_ONCE = 16  # [-] poses at a time: their samples stay in the cache


@dataclass(frozen=True)
class Course:
    """What all samples of a plan share; M poses, at and between K waypoints.

    Attributes:
        rests: The waypoints near the mold, with the cell.
        landings: Waypoint and share of the way to the next one of the poses between,
            which come after the waypoints, shape (M - K,).
        step: Wave step of each pose, 0 while the start cup lands, shape (M,).
        steps: Number of steps, the start cup's included.
        keeper: Keeps the links' lengths; None where errors are independent.
        grid: Samples of the ply.
        live: Samples that errors may bring near the mold, shape (M, nt, ns).
        pads: Those on pads of cups on their way down, shape (M, nt, ns).
        still: Heights of the others, zero where they are laid, shape (M, nt, ns), [m].
        final_gap: Gap of the laid state, zero beside the mold, shape (nt, ns), in [m].
        lid: Index of the sample that stands for each, shape (nt ns,): over openings of
            the mold another one. None where each is itself.
        tolerance: What counts as touching, and as a barrier.
        model: Ply model on which the plan's verdict rests.
        bulges: Whether fibers outside the take-up bulge.
        sides: Sides to which the plan's strips bulge.
        far: Margins of the waypoints left out, premature and air, in [m].
        table: Poses by stiffness; None where the plan knows no equilibrium, or where
            each sample is settled anew.
        settles: Whether each sample is settled anew.
    """

    rests: Rests
    landings: Array
    step: NDArray[np.int_]
    steps: int
    keeper: LinkKeeper | None
    grid: FrontGrid
    live: Bools
    pads: Bools
    still: Array
    final_gap: Array
    lid: NDArray[np.int_] | None
    tolerance: Tolerance
    model: PlyModel
    bulges: bool
    sides: Sides
    far: tuple[float, float]
    table: StiffnessTable | None = None
    settles: bool = False

    @property
    def cell(self) -> Cell:
        """Robot, mold and ply."""
        return self.rests.cell

    @property
    def top(self) -> float:
        """Height from which on all are the same to margins up to CAP, in [m]."""
        return top_height(self.tolerance)


@dataclass(frozen=True)
class Rollout:
    """What became of one sample.

    Attributes:
        premature: Least premature margin of each step, shape (steps,), in [m];
            infinite beyond CAP.
        air: The same of air margins.
        span_press: How deep spans are pressed below the laid state, in [m].
        pad_press: The same for pads, landing and placed, in [m].
        link_error: Largest error of a link, in [m].
        stable: Whether the tool has a stable rest; if not, the rest is the plan's.
        place: Where on the ply the least margin is, material (s, t), in [m]; None where
            it is infinite, or that of a waypoint left out.
    """

    premature: Array
    air: Array
    span_press: float
    pad_press: float
    link_error: float
    stable: bool = True
    place: tuple[float, float] | None = None

    @property
    def wrong(self) -> bool:
        """Whether the ply touches in the wrong order, or has no rest at all."""
        return not self.stable or self.margin <= 0

    @property
    def margin(self) -> float:
        """Least margin, in [m]; infinite where nothing threatens."""
        return float(min(self.premature.min(), self.air.min()))


def top_height(tolerance: Tolerance) -> float:
    """Height from which on all are the same to margins up to CAP, in [m]."""
    return tolerance.touch + tolerance.barrier + CAP


def roll(course: Course, sample: Draw, spread: Spread) -> Rollout:
    """One sample of a plan.

    Args:
        course: The plan.
        sample: Its random numbers.
        spread: Size of the errors.
    """
    settled = _settled(course, sample, spread)
    if settled is None:
        lost = roll(course, sample, replace(Spread(), redrawn=spread.redrawn))
        return replace(lost, stable=False)
    poses, link_error = disturbed(course, settled, sample, spread)
    seen = as_registered(poses, sample, spread)  # the ply goes along with its cups
    pairs = zip(seen, straight_between(seen, course.landings), strict=True)
    positions, rotations = (np.concatenate(pair) for pair in pairs)
    found = _measured(course, (positions, rotations), sample, spread)
    margins, places, depths = found
    by_step = np.full((2, course.steps), np.inf)
    for one, row, far in zip(margins, by_step, course.far, strict=True):
        np.minimum.at(row, course.step, one)
        row[0] = min(row[0], far)
    spans, pads = depths.max(axis=1)
    press = float(spans), max(float(pads), _pushed(course, sample, spread))
    place = _place(course, margins, places)
    return Rollout(by_step[0], by_step[1], *press, link_error, place=place)


def disturbed(
    course: Course, planned: Poses, sample: Draw, spread: Spread
) -> tuple[Poses, float]:
    """Cup poses with errors, the links as long as they are.

    Args:
        course: The plan.
        planned: Cup poses without errors.
        sample: The random numbers.
        spread: Size of the errors.

    Returns:
        The poses, and the largest error of a link that is left, in [m].
    """
    free = ~course.rests.fixed
    rotations = turned(planned[1], free, sample, spread)
    positions = planned[0] + spread.position * sample.position * free[..., None]
    if course.keeper is None:
        return (positions, rotations), 0.0
    positions, error = course.keeper.keep(positions, rotations)
    return (positions, rotations), error


def _settled(course: Course, sample: Draw, spread: Spread) -> Poses | None:
    """Where the cups rest on the sample's ply and mold."""
    planned, off = course.rests.poses, spread.stiffness * sample.stiffness
    moves = spread.has("registration")
    if course.settles and (off or moves):

        def real(points: Array) -> Array:
            return registered(points, sample, spread)

        return course.rests.settle(float(np.exp(off)), real if moves else None)
    if course.table is None or off == 0:
        return planned
    return course.table.poses(planned, sample.stiffness)


def _measured(
    course: Course, poses: Poses, sample: Draw, spread: Spread
) -> tuple[Array, Ints, Array]:
    """What `_judged` finds in all poses, shapes (2, M)."""
    cell = _with_ply(course.cell, sample, spread)
    margins, depths = np.empty((2, 2, len(course.live)))
    places = np.empty(margins.shape, np.int64)
    for chosen, fibers in _fibers(course, cell, poses):
        for first in range(0, len(chosen), AT_ONCE):
            some = chosen[first : first + AT_ONCE]
            part = poses[0][some], poses[1][some]
            held = _some(fibers, slice(first, first + AT_ONCE))
            points = held_points(cell, held, *part, course.model)
            found = _judged(course, some, points)
            margins[:, some], places[:, some], depths[:, some] = found
    return margins, places, depths


def _place(course: Course, margins: Array, places: Ints) -> tuple[float, float] | None:
    """Where the least margin of all poses is, material (s, t), in [m]."""
    k = margins.argmin()
    if not margins.flat[k] <= min(CAP, *course.far):
        return None
    i, j = divmod(int(places.flat[k]), len(course.grid.s))
    return float(course.grid.s[j]), float(course.grid.t[i])


def _fibers(
    course: Course, cell: Cell, poses: Poses
) -> Iterator[tuple[NDArray[np.int_], PlyFibers]]:
    """Poses in which no fiber bulges, then the others, with their fibers."""
    grid, ply, model = cell.sampling.grid, cell.scene.ply, course.model
    take_up = ply.take_up_mm * 1e-3
    fibers = ply_fibers(grid, *poses, model="cubic", take_up=take_up)
    outside = outside_take_up(fibers) & course.bulges
    for bulging in (False, True):
        chosen = np.flatnonzero(outside == bulging)
        if not chosen.size:
            continue
        part = poses[0][chosen], poses[1][chosen]
        if bulging:
            sides = Sides(course.sides.s[chosen], course.sides.t[chosen])
            shaped = _bulging(cell, part, sides, model.gravity)
        else:
            shaped = _some(fibers, chosen)
        if model.gravity:
            load = weight_on_mold(cell), ply.bending_stiffness_Nm
            shaped = with_sag(grid, shaped, part[1], *load)
        yield chosen, shaped


def _with_ply(cell: Cell, sample: Draw, spread: Spread) -> Cell:
    """The cell with the sample's take-up and bending stiffness."""
    ply = cell.scene.ply
    share = max(0.0, 1 + spread.take_up * sample.take_up)
    factor = float(np.exp(spread.stiffness * sample.stiffness))
    if share == 1 and factor == 1:
        return cell
    changed = {
        "take_up_mm": share * ply.take_up_mm,
        "bending_stiffness_Nm": factor * ply.bending_stiffness_Nm,
    }
    ply = ply.model_copy(update=changed)
    return replace(cell, scene=cell.scene.model_copy(update={"ply": ply}))


def _bulging(cell: Cell, poses: Poses, sides: Sides, gravity: bool) -> PlyFibers:
    """Modal fibers; under gravity those alone that are outside the take-up."""
    grid, ply = cell.sampling.grid, cell.scene.ply
    take_up = ply.take_up_mm * 1e-3
    free = ply_fibers(grid, *poses, model="modal", take_up=take_up, sides=sides)
    if not gravity:
        return free
    heavy = ply_fibers(
        grid,
        *poses,
        model="modal",
        take_up=take_up,
        sides=sides,
        gravity=weight_on_mold(cell),
        stiffness=ply.bending_stiffness_Nm,
    )
    return heavy_where_slack(free, heavy)


def _some(fibers: PlyFibers, poses: slice | NDArray[np.int_]) -> PlyFibers:
    """Fibers of some poses of a batch."""
    return PlyFibers(*(getattr(fibers, one.name)[poses] for one in fields(fibers)))


def _judged(
    course: Course, some: NDArray[np.int_], points: Array
) -> tuple[Array, Ints, Array]:
    """What the points of some poses say.

    Returns:
        Margins, premature and air, in [m]; the samples that have them; depths of spans
        and pads, in [m]; shapes (2, k).
    """
    grid, touch, barrier = course.grid, course.tolerance.touch, course.tolerance.barrier
    live, pads = course.live[some], course.pads[some]
    at, final = np.flatnonzero(live), np.broadcast_to(course.final_gap, live.shape)
    read = at
    if course.lid is not None:
        sample = at % course.lid.size
        read = at - sample + course.lid[sample]
    gap = course.cell.mold.gap(points.reshape(-1, 3).take(read, axis=0), beside=FAR)
    h = course.still[some]
    h.reshape(-1)[at] = np.minimum(gap - final[live], course.top)
    depths = [
        -h.min(axis=(1, 2), where=where, initial=0.0) for where in (live & ~pads, pads)
    ]
    found = placed_margins(h, grid.start_pad, grid.vents, touch, barrier)
    return *found, np.stack(depths)


def _pushed(course: Course, sample: Draw, spread: Spread) -> float:
    """How far the mold, higher than planned, pushes into placed pads, in [m]."""
    if not spread.has("registration"):
        return 0.0
    positions = course.rests.poses[0][-1]
    there = registered(positions, sample, spread)
    mold = course.cell.mold
    return float(max(0.0, (mold.gap(positions) - mold.gap(there)).max()))
