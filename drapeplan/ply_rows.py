"""Ply rows: how the ply's height over the mold changes with the cups, where it is low.

Heights are those of the front check: above the laid state, in which all cups stand on
their targets. The ply is that of cubics of natural length.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drapeplan.cell import Cell
from drapeplan.contact import FAR, ply_over_mold
from drapeplan.frames import inverse, moved
from ply.jacobian import point_jacobian
from ply.shape import ply_fibers

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LOW = 0.1e-3  # [m] samples lower than this are watched
MOST = 100  # of them, the lowest first


class PlyRows:
    """Heights of the ply above its laid state, and their derivatives."""

    def __init__(self, cell: Cell, laid: tuple[Array, Array]) -> None:
        """Take the laid state.

        Args:
            cell: Robot, mold and ply.
            laid: Cup poses with all cups on the mold, world, (n, 3) and (n, 3, 3).
        """
        self.cell, self._to_mold = cell, inverse(cell.world_mold)
        points, gap = self._gaps(*laid)
        self._laid = gap
        self._nowhere = (gap >= FAR) | cell.mold.opening(points)
        self._around = cell.sampling.cups_around

    def low(
        self, poses: tuple[Array, Array], placed: Mask
    ) -> tuple[NDArray[np.int64], Array]:
        """Samples off the placed cups and low, the lowest first.

        Args:
            poses: Cup poses in the world.
            placed: Cups on the mold, shape (n,).

        Returns:
            Indices into the samples, shape (r,), and heights, shape (r,), in [m].
        """
        height = self._gaps(*poses)[1] - self._laid
        free = ~placed[self._around].all(axis=-1) & ~self._nowhere
        height = np.where(free, height, np.inf).ravel()
        order = np.argsort(height, kind="stable")[:MOST]
        order = order[height[order] < LOW]
        return order, height[order]

    def slopes(
        self,
        poses: tuple[Array, Array],
        samples: NDArray[np.int64],
        response: tuple[Array, Array],
    ) -> Array:
        """Derivatives of the heights of samples.

        Args:
            poses: Cup poses in the world.
            samples: Indices into the samples, shape (r,).
            response: Derivatives of cup positions and of their rotation vectors by
                something, world, each of shape (n, 3, k).

        Returns:
            Derivatives by the same, shape (r, k).
        """
        cell, grid = self.cell, self.cell.sampling.grid
        positions, rotations = moved(self._to_mold, *poses)
        take_up = cell.scene.ply.take_up_mm * 1e-3
        fibers = ply_fibers(grid, positions, rotations, model="cubic", take_up=take_up)
        points_st = cell.sampling.points_st.reshape(-1, 2)[samples]
        found = point_jacobian(
            grid,
            fibers,
            positions,
            rotations,
            points_st,
            model="cubic",
            take_up=take_up,
        )
        points = self._gaps(*poses)[0].reshape(-1, 3)[samples]
        _, zx, zy = cell.mold.evaluate(points[:, 0], points[:, 1])
        normals = np.stack([-zx, -zy, np.ones_like(zx)], axis=-1)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        rows = found.gap_rows(normals)  # (r, 4, 6)
        turn = self._to_mold[:3, :3]
        twists = np.concatenate([turn @ response[0], turn @ response[1]], axis=1)
        return np.einsum("rcd,rcdk->rk", rows, twists[found.cups])

    def _gaps(self, positions: Array, rotations: Array) -> tuple[Array, Array]:
        """Points (nt, ns, 3) and gaps (nt, ns) in the mold frame."""
        p, R = moved(self._to_mold, positions, rotations)
        points, gap = ply_over_mold(self.cell, p[None], R[None])
        return points[0], gap[0]
