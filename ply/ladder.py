"""The ladder: each patch stands on the cheapest model that its tolerance allows.

All fibers climb the cheap rungs together, cubic, quartic, modal, and each patch stays
where no cheap rung above differs by the tolerance. Whether the coupled patch would is
estimated (`ply.ladder_estimate`, D18) and only where it may, it is solved. A strip
between patches on different rungs takes the shape of the higher one, and the patch on
the lower rung begins there: the surface has no step.
"""

from dataclasses import dataclass, fields, replace
from enum import IntEnum
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ply.coupled import CoupledModel, CoupledPatches, CoupledStatus
from ply.coupled_array import blended_points
from ply.errors import PlyError
from ply.fiber import Array
from ply.grid import CupGrid
from ply.ladder_coupled import solve_cells, with_coupled
from ply.ladder_estimate import Causes, causes
from ply.ladder_rungs import (
    Rung,
    cells,
    cheap_rungs,
    faulty_cells,
    joined,
    strips_apart,
)
from ply.measures import measures
from ply.shape import evaluate
from ply.sides import alternatives
from ply.weave import PlyFibers, Sides, ply_fibers

TOLERANCE = 1e-4  # [m] rms normal distance over a patch that may be lost
SURE = 0.75  # [-] of it that losses and estimates may use, since those err


class Reason(IntEnum):
    """Why a patch stands where it stands; the first six are those of `Causes`."""

    FLAT = 0
    COUPLING = 1
    SHEAR = 2
    TWIST = 3
    OPEN = 4
    STRETCH = 5
    ALIKE = 6  # no rung above differs by the tolerance
    TAKE_UP = 7  # the coupled patch has no weave that gives
    FAULT = 8  # a cup's pose is one that no ply has
    NOT_STABLE = 9  # the coupled patch found no stable shape
    ASKED = 10  # the caller wants no lower rung


WORDS = {
    Reason.FLAT: "the ply bends beside flat cups",
    Reason.COUPLING: "fibers inside have another length than the strips give them",
    Reason.SHEAR: "in-plane shear bears on the curved patch",
    Reason.TWIST: "the fibers of a strip ask for different lengths",
    Reason.OPEN: "slack lets a strip bulge to its other side",
    Reason.STRETCH: "cups are farther apart than a fiber reaches",
    Reason.ALIKE: "the rungs above differ by less",
    Reason.TAKE_UP: "the take-up rules; the coupled patch has none",
    Reason.FAULT: "a cup's pose is one that no ply has",
    Reason.NOT_STABLE: "the coupled patch found no stable shape",
    Reason.ASKED: "as asked",
}


@dataclass(frozen=True, eq=False)
class Climb:
    """A ply whose cells stand on rungs; a cell is a patch, or a strip of a lone row.

    Attributes:
        grid: The cup array.
        positions: Centers of the suction faces, shape (..., n_cups, 3), in [m].
        rotations: Cup frames, shape (..., n_cups, 3, 3).
        tolerance: What was asked for, in [m].
        rung: Rung of each cell, shape (..., cells along t, cells along s).
        reason: Reason of each cell, of the same shape.
        size: What the reason measures, in [m]: the estimate of the largest cause, or
            for ALIKE the difference of a cheap rung above plus the estimate.
        estimate: Estimated distance of the coupled patch from modal fibers, in [m].
        fibers: Fibers of all strips, each on the highest rung around it.
        patches: Coupled cells, batch shape as `rung`; those of lower cells are void.
        model: Energy of the coupled cells.
    """

    grid: CupGrid
    positions: Array
    rotations: Array
    tolerance: float
    rung: NDArray[np.int64]
    reason: NDArray[np.int64]
    size: Array
    estimate: Array
    fibers: PlyFibers
    patches: CoupledPatches | None
    model: CoupledModel

    def points(self, s: ArrayLike, t: ArrayLike) -> Array:
        """Positions of material points.

        Args:
            s: Material coordinates along s, in [m].
            t: Material coordinates along t; s and t broadcast to a shape (*shape).

        Returns:
            Points, shape (..., *shape, 3), in [m].
        """
        s, t = np.broadcast_arrays(np.asarray(s, float), np.asarray(t, float))
        points_st = np.stack([s.ravel(), t.ravel()], axis=-1)
        own = self._owned(points_st)
        if self.patches is not None and own.any():
            out = blended_points(self.grid, self.model, self.patches, *points_st.T)
        if not own.all():
            poses = self.positions, self.rotations
            low = evaluate(self.grid, self.fibers, *poses, points_st)
            out = np.where(own[..., None], out, low) if own.any() else low
        return out.reshape(*self.positions.shape[:-2], *s.shape, 3)

    def pose(self, *index: Any) -> "Climb":
        """One pose of a batch, or several, by place on the batch axes."""
        own = {
            name: getattr(self, name)[index]
            for name in ("positions", "rotations", "rung", "reason", "size", "estimate")
        }
        patches = None if self.patches is None else self.patches[index]
        return replace(self, **own, fibers=self.fibers.pose(*index), patches=patches)

    def lines(self) -> list[str]:
        """The rungs of one pose in words, alike cells together."""
        if not self.rung.size:
            return ["one cup: no rung needed"]
        many: dict[tuple[int, int], list[tuple[int, int]]] = {}
        for place in np.ndindex(self.rung.shape):
            key = int(self.rung[place]), int(self.reason[place])
            many.setdefault(key, []).append((place[-2], place[-1]))
        lines = []
        for (rung, reason), group in sorted(many.items()):
            sizes = [self.size[cell] for cell in group]
            names = ", ".join(f"({i}, {j})" for i, j in group[:6])
            names += f" and {len(group) - 6} more" if len(group) > 6 else ""
            lines.append(
                f"{Rung(rung).name.lower()}: patch {names}: {WORDS[Reason(reason)]}, "
                f"up to {1e3 * max(sizes):.2f} mm"
            )
        return lines

    def _owned(self, points_st: Array) -> NDArray[np.bool_]:
        """Points whose cells are all coupled, shape (..., n)."""
        grid, high = self.grid, self.rung == Rung.COUPLED
        if self.patches is None:
            return np.zeros((*high.shape[:-2], len(points_st)), dtype=bool)
        whole = np.ones((*high.shape[:-2], len(points_st)), dtype=bool)
        places = grid.place_t(points_st[:, 1]), grid.place_s(points_st[:, 0])
        cells = [np.stack([p.cup - 1, p.cup]) for p in places]
        for k, place in enumerate(places):
            cells[k][0] = np.where(place.in_span, place.cup, cells[k][0])
            cells[k] = np.clip(cells[k], 0, high.shape[k - 2] - 1)
        for i in cells[0]:
            for j in cells[1]:
                whole &= high[..., i, j]
        return whole


def climb(
    grid: CupGrid,
    positions: ArrayLike,
    rotations: ArrayLike,
    *,
    tolerance: float = TOLERANCE,
    take_up: float | None = None,
    sides: Sides | None = None,
    model: CoupledModel | None = None,
    lowest: Rung = Rung.CUBIC,
) -> Climb:
    """Stand each patch on the cheapest model within a tolerance of those above.

    Args:
        grid: The cup array.
        positions: Centers of the suction faces, shape (..., n_cups, 3), in [m].
        rotations: Cup frames, shape (..., n_cups, 3, 3).
        tolerance: Rms normal distance over a patch that may be lost, in [m].
        take_up: Largest change of fiber length either way, in [m]; with one, modal
            fibers are the highest rung.
        sides: Sides of the strips, as for `ply_fibers`.
        model: Energy of coupled patches; by default that of `CoupledModel`.
        lowest: Rung below which no patch stands; COUPLED rules over a take-up.

    Returns:
        The ply, with the rung of each patch and why.

    Raises:
        PlyError: The tolerance is not positive, or the poses do not fit the grid.
    """
    poses = np.asarray(positions, float), np.asarray(rotations, float)
    top = ply_fibers(grid, *poses, model="modal", sides=sides, take_up=take_up)
    mine = Sides(*(np.where(one == 0, 1, -one) for one in top.sides))
    turned = ply_fibers(grid, *poses, model="modal", sides=mine, take_up=take_up)
    options = _Options(tolerance, take_up, model or _model(grid), lowest)
    return _climb(grid, poses, top, turned, options)


class _Options(NamedTuple):
    """Arguments of `climb`."""

    tolerance: float
    take_up: float | None
    model: CoupledModel
    lowest: Rung


def _climb(
    grid: CupGrid,
    poses: tuple[Array, Array],
    top: PlyFibers,
    turned: PlyFibers,
    options: _Options,
) -> Climb:
    """Climb from modal fibers and what they are like bulged to the other side."""
    tolerance, take_up, model, lowest = options
    if not (np.isfinite(tolerance) and tolerance > 0):
        raise PlyError("tolerance", f"{tolerance:g} m", "use more than 0")
    room = SURE * tolerance
    shape = (*poses[0].shape[:-2], *cells(grid))
    estimate, size = np.zeros(shape), np.zeros(shape)
    reason = np.full(shape, Reason.ALIKE)
    if take_up is None and lowest < Rung.COUPLED and estimate.size:
        estimate, cause, most = _coupled_estimate(grid, top, turned, poses, model)
        high = estimate >= room
        reason, size = np.where(high, cause, reason), np.where(high, most, estimate)
    cheap = [top]
    rung, lost = np.full(shape, Rung.COUPLED), np.zeros(shape)
    if (estimate < room).any() and lowest < Rung.MODAL:
        lower = ("cubic", "quartic")
        cheap = [ply_fibers(grid, *poses, model=m, take_up=take_up) for m in lower]
        cheap += [top]
        rung, lost = cheap_rungs(grid, cheap, poses, room - estimate)
    rung = np.where(estimate < room, np.minimum(rung, Rung.MODAL), Rung.COUPLED)
    size = np.where(reason == Reason.ALIKE, estimate + lost, size)
    if take_up is not None:
        reason[rung == Rung.MODAL] = Reason.TAKE_UP
    reason = np.where(rung < lowest, Reason.ASKED, reason)
    faulty = faulty_cells(grid, top)
    rung = np.where(faulty, Rung.MODAL, np.maximum(rung, lowest))
    reason = np.where(faulty, Reason.FAULT, reason)
    patches = None
    if (rung == Rung.COUPLED).any():
        patches = solve_cells(grid, model, poses, top.sides, rung == Rung.COUPLED)
        fallen = (rung == Rung.COUPLED) & (patches.status != CoupledStatus.CONVERGED)
        rung = np.where(fallen, Rung.MODAL, rung)
        reason = np.where(fallen, Reason.NOT_STABLE, reason)
    fibers = joined(grid, cheap, rung)
    if patches is not None:
        fibers = with_coupled(grid, fibers, model, patches, rung == Rung.COUPLED)
    return Climb(
        grid, *poses, tolerance, rung, reason, size, estimate, fibers, patches, model
    )


def ladder_alternatives(
    grid: CupGrid,
    positions: ArrayLike,
    rotations: ArrayLike,
    count: int = 4,
    *,
    tolerance: float = TOLERANCE,
    take_up: float | None = None,
    model: CoupledModel | None = None,
    lowest: Rung = Rung.CUBIC,
) -> Climb:
    """Shapes of one pose by the sides of its strips, least energy first.

    Modal fibers propose the sides, each shape climbs on its own, and those that came
    out alike are one.

    Args:
        grid: The cup array.
        positions: Centers of the suction faces, shape (n_cups, 3), in [m].
        rotations: Cup frames, shape (n_cups, 3, 3).
        count: Largest number of shapes.
        tolerance: As for `climb`; shapes whose strips are closer than that are one.
        take_up: As for `climb`.
        model: As for `climb`.
        lowest: As for `climb`.

    Returns:
        The shapes along a first batch axis, one or more.
    """
    poses = np.asarray(positions, float), np.asarray(rotations, float)
    options = _Options(tolerance, take_up, model or _model(grid), lowest)
    offered = alternatives(grid, *poses, count=count, take_up=take_up)
    top = _stacked([fibers for fibers, _ in offered])
    many = tuple(np.broadcast_to(pose, (len(offered), *pose.shape)) for pose in poses)
    turned = top
    if len(offered) > 1 or count == 1:  # else no strip has another side
        other = Sides(*(np.where(one == 0, 1, -one) for one in top.sides))
        turned = ply_fibers(grid, *many, model="modal", sides=other, take_up=take_up)
    found = _climb(grid, (many[0], many[1]), top, turned, options)
    energy = np.array([value for _, value in offered])
    if found.patches is not None and (found.rung == Rung.COUPLED).all():
        energy = found.patches.energy.sum(axis=(-1, -2))
    order = np.argsort(energy, kind="stable")
    if len(order) == 1:
        return found
    kept: list[int] = []
    for n in order.tolist():
        apart = (strips_apart(found.fibers.pose(n), found.fibers.pose(m)) for m in kept)
        if min(apart, default=np.inf) >= tolerance:
            kept.append(n)
    return found.pose(np.array(kept))


@cache
def _model(grid: CupGrid) -> CoupledModel:
    return CoupledModel(grid)


def _stacked(shapes: list[PlyFibers]) -> PlyFibers:
    """Fibers of several poses along a first batch axis."""
    names = (one.name for one in fields(PlyFibers))
    return PlyFibers(*(np.stack([getattr(x, n) for x in shapes]) for n in names))


def _coupled_estimate(
    grid: CupGrid,
    fibers: PlyFibers,
    turned: PlyFibers,
    poses: tuple[Array, Array],
    model: CoupledModel,
) -> tuple[Array, NDArray[np.int64], Array]:
    """Estimate of what coupling changes, its largest cause, and that cause's size."""
    found = measures(grid, *poses, model.bending, 0.0, shear_stiffness=model.shear)
    parts: Causes = causes(grid, fibers, turned, found)
    every = np.stack(parts)
    return every.sum(axis=0), every.argmax(axis=0), every.max(axis=0)
