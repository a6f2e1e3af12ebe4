r"""The coupled patch: a ply between cups as one small energy problem (D10-D12).

A patch with its four strips bends, stretches along its fibers and shears as one smooth
surface, clamped to four cups: what lifted cups and slack ask for, where strips cannot
be shaped one by one. Slack leaves several stable shapes; the start decides which.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ply.coupled_basis import (
    SPAN,
    STRIP_INTERVALS,
    AxisBasis,
    Material,
    PatchBasis,
    stack,
)
from ply.coupled_body import Body
from ply.coupled_input import flat_poses, sound_poses
from ply.coupled_solve import CoupledStatus, newton
from ply.coupled_start import (
    STRIP_CUPS,
    cup_rows,
    mean_turn,
    patch_start,
    start_strains,
    strip_start,
)
from ply.errors import PlyError
from ply.fiber import Array, Statuses
from ply.grid import CupGrid, Region

__all__ = ["CoupledModel", "CoupledPatches", "CoupledStatus"]

CUP_POINTS = 3  # [-] Gauss points across a cup; order + 1 along a span (D10)
CHUNK = 8  # [-] patches solved together: their matrices stay in the cache
ARRAYS = ("coefficients", "cups", "energy", "strain", "status", "iterations")
STRIPS = {Region.S_STRIP: 0, Region.T_STRIP: 2}  # strip of the patch that stands alone


@dataclass(frozen=True, eq=False)
class CoupledPatches:
    """Shapes of patches, or of single strips; batch axes first.

    Attributes:
        region: Region.PATCH, or Region.S_STRIP or T_STRIP for single strips.
        coefficients: Unknowns, shape (..., size, 3), in [m].
        cups: Position, s and t direction of four cups, shape (..., 12, 3); zero for the
            two cups that a strip does not have.
        energy: Elastic energy less the work of the weight from the shape that the cups
            alone make, shape (...), in [J].
        strain: Largest stretch of a fiber beyond its take-up, shape (...): large where
            the cups are farther apart than the fibers reach.
        status: CoupledStatus, shape (...).
        iterations: Newton steps taken, shape (...).
    """

    region: Region
    coefficients: Array
    cups: Array
    energy: Array
    strain: Array
    status: Statuses
    iterations: NDArray[np.int64]

    def __getitem__(self, index: Any) -> "CoupledPatches":
        """Shapes picked along the batch axes."""
        batch = self.energy.shape
        flat = np.arange(self.energy.size).reshape(batch)[index]
        arrays = (getattr(self, name) for name in ARRAYS)
        return CoupledPatches(
            self.region,
            *(
                a.reshape((self.energy.size, *a.shape[len(batch) :]))[flat]
                for a in arrays
            ),
        )


@dataclass(frozen=True)
class CoupledModel:
    """Energy of one patch with its strips, the same for all patches of a ply.

    Attributes:
        grid: The cup array; its cups, span and fiber lengths are used.
        order: Bubbles over a span in each direction.
        bending: Bending stiffness along the fibers, in [N m].
        shear: In-plane shear stiffness, in [N/m].
        stretch: Stiffness along the fibers, in [N/m].
        torsion: Stiffness against twist, in [N m]: shear * thickness^2 / 12.
        weight: Weight of the ply per area, a vector in the world, in [N/m^2].
        take_up: Length that the weave gives either way over a span before a fiber
            stretches, in [m].
    """

    grid: CupGrid
    order: int = 5
    bending: float = 5e-3
    shear: float = 300.0
    stretch: float = 666e3
    torsion: float = 2.25e-6
    weight: tuple[float, float, float] = (0.0, 0.0, 0.0)
    take_up: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        if self.order < 2:
            raise PlyError("order", f"{self.order} bubbles", "use 4 or 5")
        for name in ("bending", "shear", "stretch", "torsion"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise PlyError(name, f"{value:g}", "use a positive stiffness")
        if np.shape(self.weight) != (3,) or not np.isfinite(self.weight).all():
            raise PlyError("weight", f"{self.weight}", "give three finite numbers")
        shortest = min(self.grid.s_length, self.grid.t_length)
        if not 0 <= self.take_up < shortest:
            problem = f"{self.take_up:g} m in spans of {shortest:g} m"
            raise PlyError("take_up", problem, "use 0 or more, below a span")

    @cached_property
    def basis(self) -> PatchBasis:
        """Functions of a patch."""
        grid = self.grid
        lengths = grid.s_length, grid.t_length
        s, t = (AxisBasis(grid.half_width, length, self.order) for length in lengths)
        return PatchBasis(s, t)

    def solve(
        self,
        positions: ArrayLike,
        rotations: ArrayLike,
        sides: ArrayLike | None = None,
        start: CoupledPatches | None = None,
    ) -> CoupledPatches:
        """Stable shapes of patches between four cups each.

        Args:
            positions: Cup centers in the order (row, column) = (0, 0), (0, 1), (1, 0),
                (1, 1), shape (..., 4, 3), in [m].
            rotations: Cup frames, shape (..., 4, 3, 3); columns s, t and normal.
            sides: Where each strip starts, shape (..., 4): strips along s of the first
                and second row, then along t of the first and second column; 1 bulged
                along the normals, -1 against them, 0 (default) whichever is flatter,
                along the normals if neither is.
            start: Shapes to start from instead, for instance of the poses before.

        Returns:
            The shapes; each says what became of it.

        Raises:
            PlyError: The shape of an array does not fit.
        """
        return self._solve(Region.PATCH, positions, rotations, sides, start)

    def solve_strips(
        self,
        positions: ArrayLike,
        rotations: ArrayLike,
        sides: ArrayLike | None = None,
        start: CoupledPatches | None = None,
        along: Region = Region.S_STRIP,
    ) -> CoupledPatches:
        """Stable shapes of strips between two cups each, free at both edges.

        Args:
            positions: Cup centers, shape (..., 2, 3), in [m].
            rotations: Cup frames, shape (..., 2, 3, 3); columns s, t and normal.
            sides: Side to which each strip starts, shape (...): as for `solve`.
            start: Shapes to start from instead.
            along: Region.S_STRIP for neighbors along s, T_STRIP for those along t.

        Returns:
            The shapes; each says what became of it.

        Raises:
            PlyError: The shape of an array does not fit.
        """
        sides = None if sides is None else np.asarray(sides)[..., None]
        return self._solve(along, positions, rotations, sides, start)

    def points(self, patches: CoupledPatches, s: ArrayLike, t: ArrayLike) -> Array:
        """Positions of material points of patches.

        Args:
            patches: Shapes from `solve`.
            s: Material coordinates along s from the first cup's center, in [m]; of the
                grid, whose span stands for the length of the fiber.
            t: Material coordinates along t; s and t broadcast to a shape (*shape).

        Returns:
            Points, shape (..., *shape, 3), in [m]; continued linearly beyond the cups.
        """
        free, cups = self.rows(patches.region, s, t)
        shape = np.broadcast_shapes(np.shape(s), np.shape(t))
        out = free @ patches.coefficients + cups @ patches.cups
        return out.reshape(*patches.energy.shape, *shape, 3)

    def rows(self, region: Region, s: ArrayLike, t: ArrayLike) -> tuple[Array, Array]:
        """Constant matrices from coefficients and cups to points.

        Args:
            region: Region of the shapes.
            s: Material coordinates along s, in [m].
            t: Material coordinates along t; s and t broadcast to n points.

        Returns:
            Matrices over the coefficients, shape (n, size), and cups, shape (n, 12).
        """
        flat = [x.ravel() for x in np.broadcast_arrays(s, t)]
        d, span = self.grid.half_width, self.grid.span
        s, t = (
            x + (axis.length / span - 1) * np.clip(x - d, 0, span)
            for x, axis in zip(flat, (self.basis.s, self.basis.t), strict=True)
        )
        return self.basis.rows(self._functions(region), s, t)

    def body(self, region: Region) -> Body:
        """Matrices of a patch or of a strip."""
        return self._bodies[region]

    @cached_property
    def _bodies(self) -> dict[Region, Body]:
        basis = self.basis
        material = Material(
            *(self.stretch, self.shear, self.bending, self.torsion),
            *(self.weight, self.take_up),
        )
        inner = basis.strips[:, 2 * self.order :].reshape(-1, 2)
        functions = np.concatenate([inner, basis.inside])
        points = self.order + 1, CUP_POINTS
        core = basis.piece(functions, (SPAN, SPAN), material, points)
        strips = [
            basis.piece(own, where, material, points)
            for own, where in zip(basis.strips, STRIP_INTERVALS, strict=True)
        ]
        none = stack(strips[:1], 0)
        bodies = {region: Body(strips[k], none) for region, k in STRIPS.items()}
        return bodies | {Region.PATCH: Body(core, stack(strips))}

    @cached_property
    def _rest(self) -> tuple[Array, Array]:
        """Cups at rest, shapes (4, 3) and (4, 3, 3)."""
        s, t = self.basis.s, self.basis.t
        far_s, far_t = s.edges[2] + s.half_width, t.edges[2] + t.half_width
        centers = [[0, 0, 0], [far_s, 0, 0], [0, far_t, 0], [far_s, far_t, 0]]
        return np.array(centers, dtype=float), np.broadcast_to(np.eye(3), (4, 3, 3))

    def _functions(self, region: Region) -> NDArray[np.int64]:
        if region == Region.PATCH:
            return self.basis.functions
        return self.basis.strips[STRIPS[region]]

    def _solve(
        self,
        region: Region,
        positions: ArrayLike,
        rotations: ArrayLike,
        sides: ArrayLike | None,
        start: CoupledPatches | None = None,
    ) -> CoupledPatches:
        cups = np.arange(4) if region == Region.PATCH else STRIP_CUPS[STRIPS[region]]
        n_strips = 4 if region == Region.PATCH else 1
        p, frames, chosen, batch = flat_poses(positions, rotations, sides, n_strips)
        good = sound_poses(p, frames, self.grid.pitch)
        p = np.where(good[:, None, None], p, self._rest[0][cups])
        frames = np.where(good[:, None, None, None], frames, self._rest[1][cups])
        rows = np.zeros((len(p), 12, 3))
        rows.reshape(-1, 4, 9)[:, cups] = cup_rows(p, frames).reshape(-1, len(cups), 9)
        body = self.body(region)
        if start is not None:
            q, foreseen = self._follow(start, body, rows)
        elif region == Region.PATCH:
            q, asked = patch_start(self.basis, p, frames, chosen, self.take_up)
            foreseen = start_strains(body, (0, 0, 1, 1), asked)
        else:
            k = STRIPS[region]
            q, asked = strip_start(self.basis, k, p, frames, chosen[:, 0], self.take_up)
            foreseen = start_strains(body, (k // 2,), asked[:, None])
        found = self.relax(region, q, rows, foreseen)
        found.status[~good] = CoupledStatus.BAD_INPUT
        arrays = (getattr(found, name) for name in ARRAYS)
        return CoupledPatches(
            region, *(a.reshape((*batch, *a.shape[1:])) for a in arrays)
        )

    def relax(
        self,
        region: Region,
        q: Array,
        cups: Array,
        foreseen: list[Array] | None = None,
    ) -> CoupledPatches:
        """Stable shapes from unknowns to start with, for one batch axis.

        Args:
            region: Region of the shapes.
            q: Unknowns, shape (b, size, 3), in [m].
            cups: Position, s and t direction of four cups, shape (b, 12, 3).
            foreseen: Strains expected in core and strips; by default none.

        Returns:
            The shapes, batch shape (b,).
        """
        body = self.body(region)
        parts = [
            newton(body, q[k], cups[k], foreseen and [e[k] for e in foreseen])
            for k in np.split(np.arange(len(q)), range(CHUNK, len(q), CHUNK))
        ]
        q, status, iterations = map(np.concatenate, zip(*parts, strict=True))
        energy, strain = body.energy_and_strain(q, cups)
        return CoupledPatches(region, q, cups, energy, strain, status, iterations)

    def _follow(
        self, start: CoupledPatches, body: Body, cups: Array
    ) -> tuple[Array, list[Array]]:
        """Unknowns of a start, turned with cups that have moved since; its strains."""
        before = start.cups.reshape(cups.shape)
        q = start.coefficients.reshape(len(cups), body.size, 3)
        return q @ mean_turn(before, cups).mT, body.strains(q, before)
