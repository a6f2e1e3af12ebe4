"""The ladder: each patch stands on the cheapest model that its tolerance allows.

All fibers climb the cheap rungs together, cubic, quartic, modal, and each patch stays
where no cheap rung above differs by the tolerance. Whether the coupled patch would is
estimated (`ply.ladder_estimate`, D17) and only where it may, it is solved. A strip
between patches on different rungs takes the shape of the higher one, and the patch on
the lower rung begins there: the surface has no step.
"""

from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ply.coupled import CoupledModel, CoupledPatches, CoupledStatus
from ply.coupled_array import blended_points, patch_cups
from ply.errors import PlyError
from ply.fiber import Array, FiberStatus, dot, powers
from ply.grid import CupGrid, Region
from ply.ladder_estimate import Causes, causes, largest_around
from ply.measures import measures
from ply.sampling import PlySampling
from ply.shape import evaluate
from ply.sides import alternatives
from ply.weave import PlyFibers, Sides, ply_fibers

TOLERANCE = 1e-4  # [m] rms normal distance over a patch that may be lost
IN_SPAN = np.linspace(0.1, 0.9, 5)  # [-] places along a span where rungs are compared
ON_CUP = np.array([-1.0, 0.0, 1.0])  # [-] the same on a cup, in half widths
FAULTY = (FiberStatus.COINCIDENT, FiberStatus.INVERTED, FiberStatus.SKEWED)


class Rung(IntEnum):
    """Models by rising cost."""

    CUBIC = 0
    QUARTIC = 1
    MODAL = 2
    COUPLED = 3


CHEAP = (Rung.CUBIC, Rung.QUARTIC, Rung.MODAL)


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
            for ALIKE the largest difference or sum of estimates of a rung above.
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
        poses = self.positions, self.rotations
        out = evaluate(self.grid, self.fibers, *poses, points_st)
        if self.patches is not None:
            own = self._owned(points_st)
            coupled = blended_points(self.grid, self.model, self.patches, *points_st.T)
            out = np.where(own[..., None], coupled, out)
        return out.reshape(*self.positions.shape[:-2], *s.shape, 3)

    def pose(self, *index: int) -> "Climb":
        """One pose of a batch, by its place on the batch axes."""
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
        for (rung, reason), cells in sorted(many.items()):
            sizes = [self.size[cell] for cell in cells]
            names = ", ".join(f"({i}, {j})" for i, j in cells[:6])
            names += f" and {len(cells) - 6} more" if len(cells) > 6 else ""
            lines.append(
                f"{Rung(rung).name.lower()}: patch {names}: {WORDS[Reason(reason)]}, "
                f"up to {1e3 * max(sizes):.2f} mm"
            )
        return lines

    def _owned(self, points_st: Array) -> NDArray[np.bool_]:
        """Points whose cells are all coupled, shape (..., n)."""
        grid, high = self.grid, self.rung == Rung.COUPLED
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

    Returns:
        The ply, with the rung of each patch and why.

    Raises:
        PlyError: The tolerance is not positive, or the poses do not fit the grid.
    """
    if not (np.isfinite(tolerance) and tolerance > 0):
        raise PlyError("tolerance", f"{tolerance:g} m", "use more than 0")
    poses = np.asarray(positions, float), np.asarray(rotations, float)
    cheap = [
        ply_fibers(grid, *poses, model=name, sides=sides, take_up=take_up)
        for name in ("cubic", "quartic", "modal")
    ]
    rung, size = _cheap_rungs(grid, cheap, poses, tolerance)
    model = model or _model(grid)
    faulty = _faulty(grid, cheap[-1])
    reason = np.full(rung.shape, Reason.ALIKE)
    estimate = np.zeros(rung.shape)
    if rung.size and take_up is None:
        estimate, cause, most = _coupled_estimate(grid, cheap[-1], poses, sides, model)
        high = estimate >= tolerance
        reason = np.where(high, cause, reason)
        size = np.where(high, most, np.maximum(size, estimate))
        rung = np.where(high, Rung.COUPLED, rung)
    elif rung.size:
        reason[rung == Rung.MODAL] = Reason.TAKE_UP
    rung = np.where(faulty, Rung.MODAL, rung)
    reason = np.where(faulty, Reason.FAULT, reason)
    patches = None
    if (rung == Rung.COUPLED).any():
        patches = _solve(grid, model, poses, cheap[-1].sides, rung == Rung.COUPLED)
        fallen = (rung == Rung.COUPLED) & (patches.status != CoupledStatus.CONVERGED)
        rung = np.where(fallen, Rung.MODAL, rung)
        reason = np.where(fallen, Reason.NOT_STABLE, reason)
    fibers = _joined(grid, cheap, rung)
    if patches is not None:
        fibers = _with_coupled(grid, fibers, model, patches, rung == Rung.COUPLED)
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
) -> list[Climb]:
    """Shapes of one pose by the sides of its strips, least energy first.

    Modal fibers propose the sides, each shape climbs on its own, and those that came
    out alike are one.

    Args:
        grid: The cup array.
        positions: Centers of the suction faces, shape (n_cups, 3), in [m].
        rotations: Cup frames, shape (n_cups, 3, 3).
        count: Largest number of shapes.
        tolerance: As for `climb`; shapes closer than that are one.
        take_up: As for `climb`.
        model: As for `climb`.

    Returns:
        The shapes, one or more.
    """
    poses = np.asarray(positions, float), np.asarray(rotations, float)
    if grid.n_cups == 1:
        return [climb(grid, *poses, tolerance=tolerance, take_up=take_up)]
    offered = alternatives(grid, *poses, count=count, take_up=take_up)
    sides = [fibers.sides for fibers, _ in offered]
    both = Sides(*(np.stack(family) for family in zip(*sides, strict=True)))
    many = [np.broadcast_to(pose, (len(sides), *pose.shape)) for pose in poses]
    options = {"tolerance": tolerance, "take_up": take_up, "model": model}
    found = climb(grid, *many, sides=both, **options)  # type: ignore[arg-type]
    energy = np.array([value for _, value in offered])
    if found.patches is not None and (found.rung == Rung.COUPLED).all():
        energy = found.patches.energy.sum(axis=(-1, -2))
    probes = _probes(grid)
    points = found.points(*np.meshgrid(probes.s, probes.t))
    kept: list[int] = []
    for n in np.argsort(energy, kind="stable"):
        apart = [cell_rms(grid, points[n], points[m]).max() for m in kept]
        if min(apart, default=np.inf) >= tolerance:
            kept.append(int(n))
    return [found.pose(n) for n in kept]


@cache
def _model(grid: CupGrid) -> CoupledModel:
    return CoupledModel(grid)


@cache
def _probes(grid: CupGrid) -> PlySampling:
    """Lines on which rungs are compared."""
    lines = []
    for cups in (grid.columns, grid.rows):
        centers = grid.pitch * np.arange(cups)[:, None]
        spans = centers[:-1] + grid.half_width + grid.span * IN_SPAN
        own = centers + grid.half_width * ON_CUP
        lines.append(np.sort(np.concatenate([own.ravel(), spans.ravel()])))
    return PlySampling(grid, *lines)


def cell_rms(grid: CupGrid, first: Array, second: Array) -> Array:
    """Rms normal distance of two surfaces on `_probes`, for each cell.

    Args:
        grid: The cup array.
        first: Points, shape (..., n_t, n_s, 3), in [m].
        second: Points of the same material, of the same shape.

    Returns:
        Distances, shape (..., cells along t, cells along s), in [m].
    """
    x, y = np.gradient(second, axis=-2), np.gradient(second, axis=-3)
    normal = np.cross(x, y)
    square = dot(first - second, normal) ** 2 / dot(normal, normal)
    for axis, cups in ((-1, grid.columns), (-2, grid.rows)):
        square = np.moveaxis(square, axis, -1)
        stride = len(ON_CUP) + len(IN_SPAN)
        width = len(ON_CUP) + (stride if cups > 1 else 0)
        starts = stride * np.arange(max(cups - 1, 1))
        square = square[..., starts[:, None] + np.arange(width)].mean(axis=-1)
        square = np.moveaxis(square, -1, axis)
    return np.sqrt(square)


def _cheap_rungs(
    grid: CupGrid, cheap: list[PlyFibers], poses: tuple[Array, Array], tolerance: float
) -> tuple[NDArray[np.int64], Array]:
    """Lowest cheap rung from which none above differs, and by how much one does."""
    batch = poses[0].shape[:-2]
    if grid.n_cups == 1:
        return np.zeros((*batch, 0, 0), dtype=np.int64), np.zeros((*batch, 0, 0))
    surfaces = [_probes(grid).points(one, *poses) for one in cheap]
    to_quartic, to_modal, last = (
        cell_rms(grid, surfaces[a], surfaces[b]) for a, b in ((0, 1), (0, 2), (1, 2))
    )
    first = np.maximum(to_quartic, to_modal)
    rung = np.select(
        [first < tolerance, last < tolerance],
        [int(Rung.CUBIC), int(Rung.QUARTIC)],
        int(Rung.MODAL),
    )
    size = np.select([rung == Rung.CUBIC, rung == Rung.QUARTIC], [first, last], 0.0)
    return rung, size


def _faulty(grid: CupGrid, fibers: PlyFibers) -> NDArray[np.bool_]:
    """Cells beside cups whose poses make no sense."""
    if grid.n_cups == 1:
        return np.zeros((*fibers.s.shape[:-5], 0, 0), dtype=bool)
    faults = [
        np.isin(status, FAULTY).any(axis=-1).astype(float)
        for status in (fibers.s_status, fibers.t_status)
    ]
    return np.asarray(largest_around(grid, *faults) > 0)


def _coupled_estimate(
    grid: CupGrid,
    fibers: PlyFibers,
    poses: tuple[Array, Array],
    sides: Sides | None,
    model: CoupledModel,
) -> tuple[Array, NDArray[np.int64], Array]:
    """Estimate of what coupling changes, its largest cause, and that cause's size."""
    mine = fibers.sides
    other = Sides(*(np.where(one == 0, 1, -one) for one in mine))
    turned = ply_fibers(grid, *poses, model="modal", sides=other)
    found = measures(grid, *poses, model.bending, 0.0, shear_stiffness=model.shear)
    parts: Causes = causes(grid, fibers, turned, found)
    every = np.stack(parts)
    return every.sum(axis=0), every.argmax(axis=0), every.max(axis=0)


def _solve(
    grid: CupGrid,
    model: CoupledModel,
    poses: tuple[Array, Array],
    sides: Sides,
    high: NDArray[np.bool_],
) -> CoupledPatches:
    """Coupled cells where asked for, void ones elsewhere, batch shape of `high`."""
    cups = patch_cups(grid)
    p, frames = poses[0][..., cups, :], poses[1][..., cups, :, :]
    if min(grid.rows, grid.columns) > 1:
        region = Region.PATCH
        around = [sides.s[..., :-1, :], sides.s[..., 1:, :]]
        around += [sides.t[..., :-1], sides.t[..., 1:]]
        start = np.stack(around, axis=-1)[high]
        found = model.solve(p[high.reshape(p.shape[:-2])], frames[high], start)
    else:
        region = Region.S_STRIP if grid.rows == 1 else Region.T_STRIP
        lone = sides.s if grid.rows == 1 else sides.t
        flat = high.reshape(p.shape[:-2])
        found = model.solve_strips(p[flat], frames[flat], lone[high], along=region)
    arrays = {}
    for name in ("coefficients", "cups", "energy", "strain", "status", "iterations"):
        own = getattr(found, name)
        arrays[name] = np.zeros((*high.shape, *own.shape[1:]), dtype=own.dtype)
        arrays[name][high] = own
    return CoupledPatches(region, **arrays)


def _joined(
    grid: CupGrid, cheap: list[PlyFibers], rung: NDArray[np.int64]
) -> PlyFibers:
    """Fibers of each strip on the highest cheap rung of the cells around it."""
    top, curves = cheap[-1], {}
    for axis, name in enumerate("st"):
        level = _strip_rung(grid, rung, axis)[..., None, None, None]
        own = [_as_modal(getattr(one, name)) for one in cheap]
        curves[name] = np.where(
            level == Rung.CUBIC, own[0], np.where(level == Rung.QUARTIC, own[1], own[2])
        )
    return replace(top, **curves)


def _strip_rung(grid: CupGrid, rung: NDArray[np.int64], axis: int) -> NDArray[np.int64]:
    """Highest rung around each strip along s (axis 0) or t (axis 1)."""
    shape = (
        (grid.rows, grid.columns - 1) if axis == 0 else (grid.rows - 1, grid.columns)
    )
    out = np.zeros((*rung.shape[:-2], *shape), dtype=np.int64)
    if min(grid.rows, grid.columns) == 1:
        return rung.reshape(out.shape) if out.size else out
    if axis == 0:
        out[..., :-1, :] = rung
        out[..., 1:, :] = np.maximum(out[..., 1:, :], rung)
    else:
        out[..., :-1] = rung
        out[..., 1:] = np.maximum(out[..., 1:], rung)
    return out


def _as_modal(curves: Array) -> Array:
    """Curves with three fibers a strip and the terms of three modes."""
    *batch, count, terms, _ = curves.shape
    out = np.zeros((*batch, 3, 7, 3))
    out[..., :terms, :] = curves if count == 3 else curves[..., [0, 0, 1], :, :]
    if count == 2:  # the middle of a ruled strip
        out[..., 1, :terms, :] = curves.mean(axis=-3)
    return out


def _with_coupled(
    grid: CupGrid,
    fibers: PlyFibers,
    model: CoupledModel,
    patches: CoupledPatches,
    high: NDArray[np.bool_],
) -> PlyFibers:
    """Fibers of coupled strips in place of their own: each edge from its own patch."""
    curves = {}
    for axis, name in enumerate("st"):
        old = getattr(fibers, name)
        terms = model.order + 4  # a Hermite cubic and `order` bubbles
        new = np.zeros((*old.shape[:-2], terms, 3))
        new[..., : old.shape[-2], :] = old
        if patches.region == Region.PATCH:
            pair = [_strip_curves(model, patches, axis, which) for which in (0, 1)]
            new = _edges_of_their_own(new, pair, high, axis)
        elif new.size:
            own = _strip_curves(model, patches, axis, 0)
            new = np.where(high[..., None, None, None], own, new)
        curves[name] = new
    return replace(fibers, **curves)


def _strip_curves(
    model: CoupledModel, patches: CoupledPatches, axis: int, which: int
) -> Array:
    """Curves along a strip of coupled cells: coefficients, shape (..., 3, terms, 3).

    They are polynomials, so that as many points as terms give them exactly.
    """
    grid, terms = model.grid, model.order + 4
    u = (1 - np.cos(np.pi * np.arange(terms) / (terms - 1))) / 2
    lateral = which * grid.pitch + grid.half_width * ON_CUP
    along = grid.half_width + grid.span * u
    places = np.broadcast_arrays(along, lateral[:, None])
    points = model.points(patches, *(places if axis == 0 else places[::-1]))
    return np.asarray(np.linalg.inv(powers(u, terms)) @ points)


def _edges_of_their_own(
    old: Array, pair: list[Array], high: NDArray[np.bool_], axis: int
) -> Array:
    """Strips between patches: each patch gives its edge, both give the middle."""
    across = high.ndim - 2 + axis
    spread, has = [], []
    for which, curves in enumerate(pair):  # a cell's first strip, then its second
        width = [(0, 0)] * curves.ndim
        width[across] = (which, 1 - which)
        spread.append(np.pad(curves, width))
        has.append(np.pad(high, width[: high.ndim])[..., None, None, None])
    one = np.where(has[0], spread[0], np.where(has[1], spread[1], old))
    ends = [spread[1][..., 0, :, :], spread[0][..., 2, :, :]]
    middle = (spread[0][..., 1, :, :] + spread[1][..., 1, :, :]) / 2
    both = np.stack([ends[0], middle, ends[1]], axis=-3)
    return np.where(has[0] & has[1], both, one)
