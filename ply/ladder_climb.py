"""What the ladder gives back: a ply whose patches stand on rungs, and why."""

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ply.coupled import CoupledModel, CoupledPatches
from ply.coupled_array import blended_points
from ply.fiber import Array
from ply.free_edge import free_edge_droop, largest_droop
from ply.grid import CupGrid
from ply.ladder_rungs import Rung
from ply.shape import evaluate
from ply.weave import PlyFibers


class Reason(IntEnum):
    """Why a patch stands where it stands; the first seven are those of `Causes`."""

    FLAT = 0
    COUPLING = 1
    SHEAR = 2
    TWIST = 3
    OPEN = 4
    STRETCH = 5
    GRAVITY = 6
    ALIKE = 7  # no rung above differs by the tolerance
    FAULT = 8  # a cup's pose is one that no ply has
    NOT_STABLE = 9  # the coupled patch found no stable shape
    ASKED = 10  # the caller wants no other rung


WORDS = {
    Reason.FLAT: "the ply bends beside flat cups",
    Reason.COUPLING: "fibers inside have another length than the strips give them",
    Reason.SHEAR: "in-plane shear bears on the curved patch",
    Reason.TWIST: "the fibers of a strip ask for different lengths",
    Reason.OPEN: "slack lets a strip bulge to its other side",
    Reason.STRETCH: "cups are farther apart than a fiber reaches",
    Reason.GRAVITY: "the patch sags more than its strips",
    Reason.ALIKE: "the rungs above differ by less",
    Reason.FAULT: "a cup's pose is one that no ply has",
    Reason.NOT_STABLE: "the coupled patch found no stable shape",
    Reason.ASKED: "as asked",
}


NOTHING = 1e-6  # [m] below which an estimate is not worth a line
COUPLED = (  # effects that coupled patches model, by their causes
    ("coupling, rms over a patch", (Reason.FLAT, Reason.COUPLING, Reason.TWIST)),
    ("in-plane shear, rms over a patch", (Reason.SHEAR,)),
    ("other side of slack strips, rms over a patch", (Reason.OPEN,)),
)


class Effect(NamedTuple):
    """What may bend one ply, and whether its shape has it.

    Attributes:
        name: What it is.
        estimate: How far it may move the ply, in [m]: the largest over all cells.
        tolerance: What may be lost, in [m].
        modeled: Cells, or whole plies, whose shape has it.
        cells: All of them.
    """

    name: str
    estimate: float
    tolerance: float
    modeled: int
    cells: int

    @property
    def line(self) -> str:
        """The effect in words."""
        verdict = "modeled" if self.modeled else "left out"
        if 0 < self.modeled < self.cells:
            verdict += f" in {self.modeled} of {self.cells} cells"
        sizes = f"{1e3 * self.estimate:.2g} mm, tolerance {1e3 * self.tolerance:.2g} mm"
        return f"{self.name}: estimated up to {sizes}: {verdict}"


def gravity_effects(
    grid: CupGrid,
    rotations: Array,
    model: CoupledModel,
    overhang: float,
    tolerance: float,
    sag: Array,
    heavy: NDArray[np.bool_],
) -> list[Effect]:
    """What gravity does to one pose.

    Args:
        grid: The cup array.
        rotations: Cup frames, shape (n_cups, 3, 3).
        model: Gives weight and stiffness; without a weight there are no effects.
        overhang: Ply beyond the edges of the outer cups, in [m].
        tolerance: What may be lost, in [m].
        sag: Estimated sag of each cell, in [m].
        heavy: Cells that have it in their shape.

    Returns:
        The effects.
    """
    if not any(model.weight):
        return []
    out = []
    if sag.size:
        numbers = float(sag.max()), tolerance, int(heavy.sum()), heavy.size
        out.append(Effect("gravity between the cups", *numbers))
    if overhang > 0:
        poses = rotations, model.weight, model.bending, overhang
        tip = float(largest_droop(grid, *poses))
        modeled = int(tip > tolerance)
        out.append(Effect("gravity on the overhang", tip, tolerance, modeled, 1))
    return out


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
        causes: Estimated distances of the coupled patch from modal fibers, by cause as
            in `Causes`, shape (..., cells along t, cells along s, 7), in [m]; zero
            where the caller leaves no choice.
        sag: How far gravity may move each cell, in [m]; 0 without a weight.
        heavy: Cells whose gravity is modeled.
        fibers: Fibers of all strips, each on the highest rung around it.
        patches: Coupled cells, batch shape as `rung`; those of lower cells are void.
        model: Energy of the coupled cells, with the weight and the take-up of the ply.
        overhang: Ply beyond the edges of the outer cups that droops, in [m].
    """

    grid: CupGrid
    positions: Array
    rotations: Array
    tolerance: float
    rung: NDArray[np.int64]
    reason: NDArray[np.int64]
    size: Array
    causes: Array
    sag: Array
    heavy: NDArray[np.bool_]
    fibers: PlyFibers
    patches: CoupledPatches | None
    model: CoupledModel
    overhang: float = 0.0

    def points(self, s: ArrayLike, t: ArrayLike) -> Array:
        """Positions of material points.

        Where the ply has an overhang, points beyond the outer cups droop, in poses in
        which a tip droops by more than the tolerance.

        Args:
            s: Material coordinates along s, in [m].
            t: Material coordinates along t; s and t broadcast to a shape (*shape).

        Returns:
            Points, shape (..., *shape, 3), in [m].

        Raises:
            PlyError: The ply has an overhang and a point lies beyond it.
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
        if self.overhang > 0:
            out = out + self._droop(points_st)
        return out.reshape(*self.positions.shape[:-2], *s.shape, 3)

    def pose(self, *index: Any) -> "Climb":
        """One pose of a batch, or several, by place on the batch axes."""
        names = ("positions", "rotations", "rung", "reason", "size", "causes")
        own = {name: getattr(self, name)[index] for name in (*names, "sag", "heavy")}
        patches = None if self.patches is None else self.patches[index]
        return replace(self, **own, fibers=self.fibers.pose(*index), patches=patches)

    def effects(self) -> list[Effect]:
        """What may bend one pose beyond single fibers, and whether its shape has it."""
        own = self.grid, self.rotations, self.model, self.overhang, self.tolerance
        out = gravity_effects(*own, self.sag, self.heavy)
        high = int((self.rung == Rung.COUPLED).sum())
        for name, causes in COUPLED if self.causes.any() else ():
            most = float(self.causes[..., list(causes)].sum(axis=-1).max(initial=0.0))
            if most > NOTHING:
                out.append(Effect(name, most, self.tolerance, high, self.rung.size))
        return out

    def lines(self) -> list[str]:
        """The rungs of one pose in words, alike cells together."""
        if not self.rung.size:
            return ["one cup: no rung needed"]
        kind = "strip" if min(self.grid.rows, self.grid.columns) == 1 else "patch"
        many: dict[tuple[int, int], list[tuple[int, int]]] = {}
        for place in np.ndindex(self.rung.shape):
            key = int(self.rung[place]), int(self.reason[place])
            many.setdefault(key, []).append((place[-2], place[-1]))
        lines = []
        for (rung, reason), group in sorted(many.items()):
            most = max(self.size[cell] for cell in group)
            names = ", ".join(f"({i}, {j})" for i, j in group[:6])
            names += f" and {len(group) - 6} more" if len(group) > 6 else ""
            line = f"{Rung(rung).name.lower()}: {kind} {names}: {WORDS[Reason(reason)]}"
            sized = reason not in (Reason.ASKED, Reason.FAULT)
            lines.append(line + (f", up to {1e3 * most:.2f} mm" if sized else ""))
        return lines

    def _droop(self, points_st: Array) -> Array:
        """Droop of points beyond the outer cups, shape (..., n, 3)."""
        model = self.model
        return free_edge_droop(
            *(self.grid, self.rotations, points_st, model.weight, model.bending),
            *(self.overhang, self.tolerance),
        )

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
