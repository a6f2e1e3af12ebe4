"""Where gravity is modeled on the ladder, and modal fibers under it.

A weight is modeled in the cells that it may move by more than the tolerance, and left
out of the others; a strip hangs as the heavier of the cells beside it asks.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ply.coupled import CoupledModel
from ply.fiber import Array
from ply.gravity import gravity_sags
from ply.grid import CupGrid
from ply.ladder_estimate import causes, tipping
from ply.ladder_rungs import cells, largest_beside
from ply.measures import Measures, measures
from ply.sides import mixed, other_sides
from ply.weave import PlyFibers, Sides, ply_fibers


@dataclass(frozen=True, eq=False)
class Load:
    """The weight of a ply, and the cells in which it counts.

    Attributes:
        grid: The cup array.
        model: Energy of coupled patches; gives weight, stiffness and take-up.
        sag: How far gravity may move each cell, shape (..., cells t, cells s), in [m].
        heavy: Cells whose gravity is modeled, of the same shape.
        more: How far patches sag more than their strips, of the same shape, in [m].
    """

    grid: CupGrid
    model: CoupledModel
    sag: Array
    heavy: NDArray[np.bool_]
    more: Array

    @property
    def take_up(self) -> float | None:
        """Take-up as `ply_fibers` asks for it."""
        return self.model.take_up or None

    @property
    def pull(self) -> Array | None:
        """Weight per area over bending stiffness, in [1/m^3]."""
        weight = np.array(self.model.weight)
        return weight / self.model.bending if weight.any() else None

    @property
    def heavy_strips(self) -> NDArray[np.bool_]:
        """Strips of heavy cells, those along s first, shape (..., strips)."""
        level = self.heavy.astype(np.int64)
        batch = level.shape[:-2]
        families = (largest_beside(self.grid, level, axis) for axis in (0, 1))
        flat = [one.reshape(*batch, -1) for one in families]
        return np.concatenate(flat, axis=-1) > 0


def loaded(
    grid: CupGrid,
    poses: tuple[Array, Array],
    model: CoupledModel,
    tolerance: float,
    sides: Sides | None = None,
) -> tuple[PlyFibers, PlyFibers, Load]:
    """Modal fibers under gravity where it is modeled, and on their other sides.

    Gravity is modeled where the estimated sag, with the way that a small load may tip
    what slack leaves open, exceeds the tolerance. The weight has its say in the sides
    of strips in any case.

    Args:
        grid: The cup array.
        poses: Positions and rotations of the cups.
        model: Gives weight, stiffness and take-up.
        tolerance: What may be lost, in [m].
        sides: Sides of the strips; None leaves them to the cups and to the weight.

    Returns:
        The fibers, the same asked to bulge to the other side, and the load.
    """
    shape = (*poses[0].shape[:-2], *cells(grid))
    zero = np.zeros(shape)
    none = Load(grid, model, zero, zero > 0, zero)
    if none.pull is None:
        own = _modal(grid, poses, none, sides, False)
        return own, _modal(grid, poses, none, other_sides(own), False), none
    own = _modal(grid, poses, none, sides, True)
    other = _modal(grid, poses, none, other_sides(own), True)
    if not none.sag.size:
        return own, other, none
    sags = gravity_sags(grid, poses[1], model.weight, model.bending)
    sag, more = sags.patch, sags.patch
    if min(grid.rows, grid.columns) == 1:
        sag, more = sags.s if grid.rows == 1 else sags.t, zero
    found = measured(grid, poses, model)
    ratio = model.shear / model.bending
    moved = sag + tipping(grid, causes(grid, own, other, found, stiffness=ratio))
    load = Load(grid, model, moved, moved > tolerance, more)
    strips = load.heavy_strips
    if strips.all():
        return own, other, load
    light = _modal(grid, poses, none, own.sides, False)
    turned = _modal(grid, poses, none, other_sides(light), False)
    return mixed(grid, light, own, strips), mixed(grid, turned, other, strips), load


def measured(
    grid: CupGrid, poses: tuple[Array, Array], model: CoupledModel
) -> Measures:
    """Measures with the stiffness of a model."""
    return measures(
        *(grid, *poses, model.bending, 0.0),
        shear_stiffness=model.shear,
        take_up=model.take_up,
    )


def _modal(
    grid: CupGrid,
    poses: tuple[Array, Array],
    load: Load,
    sides: Sides | None,
    heavy: bool,
) -> PlyFibers:
    """Modal fibers, with gravity or without."""
    model = load.model
    return ply_fibers(
        *(grid, *poses),
        model="modal",
        take_up=load.take_up,
        sides=sides,
        gravity=model.weight if heavy else None,
        stiffness=model.bending if heavy else None,
    )
