"""The ladder: each patch stands on the cheapest model that its tolerance allows.

All fibers climb the cheap rungs together, cubic, quartic, modal, and each patch stays
where no cheap rung above differs by the tolerance. Whether the coupled patch would is
estimated (`ply.ladder_estimate`, D18) and only where it may, it is solved. A strip
between patches on different rungs takes the shape of the higher one, and the patch on
the lower rung begins there: the surface has no step.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ply.coupled import CoupledModel, CoupledStatus
from ply.errors import PlyError
from ply.fiber import Array
from ply.grid import CupGrid
from ply.ladder_climb import Climb, Reason
from ply.ladder_coupled import solve_cells, with_coupled
from ply.ladder_estimate import RIVAL, Causes, causes
from ply.ladder_load import Load, loaded, measured
from ply.ladder_rungs import (
    Rung,
    cells,
    cheap_rungs,
    faulty_cells,
    joined,
    probes,
    strips_apart,
)
from ply.sides import choices
from ply.weave import PlyFibers, Sides, ply_fibers

__all__ = ["Climb", "Reason", "Rung", "climb", "ladder_alternatives"]

TOLERANCE = 1e-4  # [m] rms normal distance over a patch that may be lost
SURE = 0.75  # [-] of it that losses and estimates may use, since those err
MODELS = 16  # [-] models of coupled patches that are kept, with their matrices

Poses = tuple[Array, Array]


def climb(
    grid: CupGrid,
    positions: ArrayLike,
    rotations: ArrayLike,
    *,
    tolerance: float = TOLERANCE,
    sides: Sides | None = None,
    model: CoupledModel | None = None,
    overhang: float = 0.0,
    lowest: Rung = Rung.CUBIC,
    highest: Rung = Rung.COUPLED,
) -> Climb:
    """Stand each patch on the cheapest model within a tolerance of those above.

    Gravity is modeled in the cells that it may move by more than the tolerance, and the
    droop of the overhang in poses where that of a tip exceeds it.

    Args:
        grid: The cup array.
        positions: Centers of the suction faces, shape (..., n_cups, 3), in [m].
        rotations: Cup frames, shape (..., n_cups, 3, 3).
        tolerance: Rms normal distance over a patch that may be lost, in [m].
        sides: Sides of the strips, as for `ply_fibers`; by default those that the cups
            lean to, with the weight.
        model: Energy of coupled patches; its weight, bending stiffness and take-up are
            those of all rungs. By default `CoupledModel` without weight and take-up.
        overhang: Ply beyond the edges of the outer cups, in [m].
        lowest: Rung below which no patch stands.
        highest: Rung above which none stands, MODAL or COUPLED.

    Returns:
        The ply, with the rung of each patch and why.

    Raises:
        PlyError: The tolerance is not positive, or the poses do not fit the grid.
    """
    poses = np.asarray(positions, float), np.asarray(rotations, float)
    options = _options(grid, tolerance, model, overhang, lowest, highest)
    top, turned, load = loaded(grid, poses, options.model, tolerance, sides)
    return _climb(grid, poses, top, turned, load, options)


def ladder_alternatives(
    grid: CupGrid,
    positions: ArrayLike,
    rotations: ArrayLike,
    count: int = 4,
    *,
    tolerance: float = TOLERANCE,
    model: CoupledModel | None = None,
    overhang: float = 0.0,
    lowest: Rung = Rung.CUBIC,
    highest: Rung = Rung.COUPLED,
    rival: float = RIVAL,
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
        model: As for `climb`.
        overhang: As for `climb`.
        lowest: As for `climb`.
        highest: As for `climb`.
        rival: The other side of a strip is proposed if it takes less bending energy
            than this times its own; infinite to propose it wherever it exists.

    Returns:
        The shapes along a first batch axis, one or more.
    """
    poses = np.asarray(positions, float), np.asarray(rotations, float)
    options = _options(grid, tolerance, model, overhang, lowest, highest)
    own, other, load = loaded(grid, poses, options.model, tolerance)
    offered = choices(
        grid, own, other, poses, count, rival=rival, pull=load.pull, apart=tolerance
    )
    found = _climb(grid, poses, offered.fibers, offered.turned, load, options)
    energy = offered.energy
    if found.patches is not None and (found.rung == Rung.COUPLED).all():
        energy = found.patches.energy.sum(axis=(-1, -2))
    order = np.argsort(energy, kind="stable")
    kept: list[int] = []
    for n in order.tolist():
        apart = (strips_apart(found.fibers.pose(n), found.fibers.pose(m)) for m in kept)
        if min(apart, default=np.inf) >= tolerance:
            kept.append(n)
    return found.pose(np.array(kept))


class _Options(NamedTuple):
    """Arguments of `climb`."""

    tolerance: float
    model: CoupledModel
    overhang: float
    lowest: Rung
    highest: Rung

    @property
    def room(self) -> float:
        """What losses and estimates may use, in [m]."""
        return SURE * self.tolerance

    @property
    def estimates(self) -> bool:
        """Whether anything is to be estimated: the caller may leave no choice."""
        return self.lowest < Rung.COUPLED == self.highest


def _options(
    grid: CupGrid,
    tolerance: float,
    model: CoupledModel | None,
    overhang: float,
    lowest: Rung,
    highest: Rung,
) -> _Options:
    if not (np.isfinite(tolerance) and tolerance > 0):
        raise PlyError("tolerance", f"{tolerance:g} m", "use more than 0")
    if highest < max(lowest, Rung.MODAL):
        problem = f"{Rung(highest).name.lower()} for {Rung(lowest).name.lower()}"
        raise PlyError("highest", problem, "use MODAL or COUPLED")
    own = _kept(model or CoupledModel(grid))
    return _Options(tolerance, own, overhang, lowest, highest)


def _climb(
    grid: CupGrid,
    poses: Poses,
    top: PlyFibers,
    turned: PlyFibers,
    load: Load,
    options: _Options,
) -> Climb:
    """Climb from modal fibers and what they are like bulged to the other side.

    The fibers may have batch axes beyond those of the poses, which are equal there.
    """
    shape = (*top.s.shape[:-5], *cells(grid))
    p, frames = poses
    many = (
        np.broadcast_to(p, (*shape[:-2], *p.shape[-2:])),
        np.broadcast_to(frames, (*shape[:-2], *frames.shape[-3:])),
    )
    judged = _judged(grid, (poses, many), top, turned, load, options)
    rung, reason, size, parts, cheap = judged
    faulty = faulty_cells(grid, top)
    rung = np.where(faulty, Rung.MODAL, np.clip(rung, options.lowest, options.highest))
    reason = np.where(faulty, Reason.FAULT, reason)
    heavy = np.broadcast_to(load.heavy, shape)
    high, patches = rung == Rung.COUPLED, None
    if high.any():
        patches = solve_cells(grid, options.model, many, top.sides, high, heavy)
        fallen = high & (patches.status != CoupledStatus.CONVERGED)
        rung = np.where(fallen, Rung.MODAL, rung)
        reason = np.where(fallen, Reason.NOT_STABLE, reason)
    fibers = joined(grid, [*cheap, top], rung)
    if patches is not None:
        high = rung == Rung.COUPLED
        fibers = with_coupled(grid, fibers, options.model, patches, high)
    sag = np.broadcast_to(load.sag, shape)
    return Climb(
        *(grid, *many, options.tolerance, rung, reason, size, parts, sag, heavy),
        *(fibers, patches, options.model, options.overhang),
    )


class _Verdict(NamedTuple):
    """Rungs and reasons, shape (..., cells t, cells s), and the cheap fibers used."""

    rung: NDArray[np.int64]
    reason: NDArray[np.int64]
    size: Array
    causes: Array
    cheap: list[PlyFibers]


def _judged(
    grid: CupGrid,
    poses: tuple[Poses, Poses],
    top: PlyFibers,
    turned: PlyFibers,
    load: Load,
    options: _Options,
) -> _Verdict:
    """Where each cell stands: poses as they are, and with the batch of the fibers."""
    shape = (*top.s.shape[:-5], *cells(grid))
    parts = np.zeros((*shape, len(Causes._fields)))
    cause = np.full(shape, Reason.ASKED)
    if options.estimates and cause.size:
        model = options.model
        found = measured(grid, poses[0], model)
        heavy = np.where(load.heavy, load.more, 0.0)
        ratio = model.shear / model.bending
        each = causes(grid, top, turned, found, heavy, ratio)
        parts = np.stack(np.broadcast_arrays(*each), axis=-1)
        cause = parts.argmax(axis=-1)
    estimate, most = parts.sum(axis=-1), parts.max(axis=-1)
    low = (estimate < options.room) & (options.lowest < Rung.COUPLED)
    cheap, level, lost = [], np.full(shape, Rung.MODAL), np.zeros(shape)
    if low.any() and options.lowest < Rung.MODAL:
        cheap = [
            ply_fibers(grid, *poses[0], model=name, take_up=load.take_up)
            for name in ("cubic", "quartic")
        ]
        surfaces = [probes(grid).points(one, *poses[0]) for one in cheap]
        surfaces += [probes(grid).points(top, *poses[1])]
        level, lost = cheap_rungs(grid, surfaces, options.room - estimate)
    level = np.where(load.heavy, Rung.MODAL, level)  # those below know no gravity
    rung = np.where(low, level, Rung.COUPLED)
    asked = (rung == options.highest) & (options.highest < Rung.COUPLED)
    asked |= rung < options.lowest
    reason = np.select([asked, low], [Reason.ASKED, Reason.ALIKE], cause)
    size = np.where(low, estimate + lost, most)
    return _Verdict(rung, reason, size, parts, cheap)


@lru_cache(maxsize=MODELS)
def _kept(model: CoupledModel) -> CoupledModel:
    """The first model that is equal to this one, with its matrices."""
    return model
