"""Resettle: where the tool's equilibrium goes when the ply or the mold is another.

The strokes stay those of the plan. Another bending stiffness changes where the free
cups come to rest. A mold that stands elsewhere carries the placed cups: each keeps its
place over the mold, rests on it, and its bellows take up the height; the free cups
settle between those and their strokes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from drapeplan.cell import Cell
from drapeplan.equilibrium import Equilibrium, SettledStatus
from drapeplan.frames import inverse, moved, rotation_vectors
from drapeplan.hanging import rides_level, tool_physics
from drapeplan.legs import cup_poses, leg_coordinates
from drapeplan.rest import settled_along

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Poses = tuple[Array, Array]

REACH = 1e-3  # [m] step of differences: far below a mold's radius
FAR_OFF = 2.0  # [-] spreads off at which the table's stiffnesses are settled
NODES = np.array([-FAR_OFF, FAR_OFF])


@dataclass(frozen=True)
class Rests:
    """Waypoints of a plan at which the tool is let go.

    Attributes:
        cell: Robot, mold and ply.
        q: Joint positions, shape (K, nq), in [rad] and [m].
        tool: Placements of tool0 in the world, shape (K, 4, 4).
        fixed: Placed cups, shape (K, n).
        poses: Cup poses in the mold frame, (K, n, 3) in [m] and (K, n, 3, 3).
    """

    cell: Cell
    q: Array
    tool: Array
    fixed: Bools
    poses: Poses

    def settle(
        self, factor: float, real: Callable[[Array], Array] | None = None
    ) -> Poses | None:
        """Cup poses with the plan's strokes on another ply or mold.

        Args:
            factor: Of the bending stiffness.
            real: Takes points of the planned mold's frame, shape (..., 3), to the frame
                of the mold as it stands; None where it stands as planned.

        Returns:
            Poses in the mold frame as planned, or None where the tool has no rest, or
            none that is stable just before cups are placed.
        """
        robot, columns = self.cell.robot, self.cell.robot.leg_columns
        physics = tool_physics(self.cell)
        physics = replace(physics, bending=factor * physics.bending)
        equilibrium = Equilibrium(robot, physics)
        q, fixed = self._standing(real) if real else self.q, self.fixed
        rides = rides_level(self.tool, self.q[:, columns], fixed)
        chosen = np.flatnonzero(~(rides | fixed.all(axis=1)))
        landing = np.append((fixed[1:] != fixed[:-1]).any(axis=1), False)
        legs = q[:, columns]
        for k, rest in settled_along(equilibrium, q, fixed, chosen, landing):
            if rest.status != SettledStatus.SETTLED:
                return None
            legs[k] = rest.q[columns]
        count = np.arange(len(q))
        legs = legs[np.maximum.accumulate(np.where(rides, 0, count))]
        return self._in_mold(cup_poses(robot.geometry, self.tool, legs))

    def _in_mold(self, poses: Poses) -> Poses:
        return moved(inverse(self.cell.world_mold), *poses)

    def _standing(self, real: Callable[[Array], Array]) -> Array:
        """Joint positions with the placed cups on the mold as it stands."""
        cell, columns = self.cell, self.cell.robot.leg_columns
        positions, rotations = self.poses
        here = _normals(cell.mold.gap, positions)
        there = _normals(lambda points: cell.mold.gap(real(points)), positions)
        off = cell.mold.gap(positions) - cell.mold.gap(real(positions))
        turn = Rotation.from_rotvec(np.cross(here, there).reshape(-1, 3)).as_matrix()
        carried = positions + off[..., None] * here
        tilted = turn.reshape(rotations.shape) @ rotations
        world = moved(cell.world_mold, carried, tilted)
        legs = leg_coordinates(cell.robot.geometry, self.tool, *world)
        q = self.q.copy()
        q[:, columns] = np.where(self.fixed[..., None], legs, q[:, columns])
        return q


@dataclass(frozen=True)
class StiffnessTable:
    """Cup poses by bending stiffness: settled at NODES, a parabola through them.

    Attributes:
        moves: How far cups move at each node, shape (2, K, n, 3), in [m].
        turns: How far they turn, seen from the mold, shape (2, K, n, 3), in [rad].
        stable: Whether the tool has a stable rest at each node, shape (2,).
    """

    moves: Array
    turns: Array
    stable: Bools

    @classmethod
    def of(cls, planned: Poses, settled: list[Poses | None]) -> StiffnessTable:
        """From the poses at the nodes; None where there is no stable rest."""
        stable = np.array([poses is not None for poses in settled])
        known = [poses or planned for poses in settled]
        moves = np.stack([p - planned[0] for p, _ in known])
        turns = np.stack([rotation_vectors(planned[1], R) for _, R in known])
        return cls(moves, turns, stable)

    def poses(self, planned: Poses, spreads: float) -> Poses | None:
        """Cup poses at a stiffness.

        Args:
            planned: Those of the plan's own stiffness.
            spreads: How many spreads the logarithm of the stiffness is off.

        Returns:
            The poses, or None where the tool has no stable rest at the node on that
            side.
        """
        if not self.stable[int(spreads > 0)]:
            return None
        x = spreads / FAR_OFF
        weights = np.array([x * (x - 1), x * (x + 1)]) / 2
        move = np.tensordot(weights, self.moves, 1)
        turn = np.tensordot(weights, self.turns, 1)
        R = Rotation.from_rotvec(turn.reshape(-1, 3)).as_matrix()
        return planned[0] + move, R.reshape(planned[1].shape) @ planned[1]


def _normals(gap: Callable[[Array], Array], points: Array) -> Array:
    """Unit directions in which a gap grows, shape (..., 3)."""
    steps = REACH * np.eye(3)
    slopes = [gap(points + step) - gap(points - step) for step in steps]
    slope = np.stack(slopes, axis=-1)
    return np.asarray(slope / np.linalg.norm(slope, axis=-1, keepdims=True))
