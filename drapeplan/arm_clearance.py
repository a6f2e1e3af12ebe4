"""Arm clearance: which bodies of a cell are kept apart, and where they are when.

Cups and ply are to touch mold and table, so they are left out, as is the end of each
leg as long as a cup is wide. Bodies that one joint connects are left out too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from drapeplan.body_pairs import GroundPairs, LegGroundPairs, LegPairs, SolidPairs
from drapeplan.cell import Cell
from drapeplan.chain import Chain
from drapeplan.clearance import (
    AbstractPairs,
    AbstractPath,
    Least,
    Moments,
    between,
    least_clearance,
    travel,
)
from drapeplan.frames import inverse, pose, yaw
from drapeplan.legs import cup_poses
from drapeplan.solids import (
    Legs,
    Solid,
    arm_solids,
    herd,
    mold_prisms,
    solid,
    table_prism,
    tool_solids,
)
from drapeplan.track import Track

Array = NDArray[np.float64]
Bound = Callable[[Array], Array]
SAFE = 10e-3  # [m] least clearance: calibration and flexing of arm and platform
SELF = 5e-3  # [m] between links of the arm, which stand 15 to 20 mm apart by design
RIM = 0.02  # [m] of the pick table beyond the ply
STEEPER = 1.2  # [-] slopes between nodes of the mold against those at the nodes


def clearances(cell: Cell, track: Track) -> Iterator[tuple[str, Least]]:
    """Least clearance of each kind of bodies over a drape, such as "arm to mold".

    Args:
        cell: Robot, mold and ply.
        track: The drape.

    Raises:
        NoGeometryError: What arm or tool look like is unknown.
    """
    chain, links = arm_solids(cell.sources.arm_urdf)
    names = tuple(cell.robot.leg_names)
    longest = cell.robot.geometry.leg_max
    points, legs = tool_solids(cell.sources.tool_urdf, names, longest)
    flange = points @ chain.tip[:3, :3].T + chain.tip[:3, 3]
    bodies = links, solid("platform", len(chain.names), flange), legs
    whole = _Drape(cell, chain, legs, track, 0.0)
    bare = _Drape(cell, chain, legs, track, 2 * cell.grid.half_width)
    for kind, pairs in _kinds(cell, track, chain, bodies):
        over = isinstance(pairs, LegGroundPairs)
        yield kind, least_clearance(pairs, bare if over else whole)


def ply_size(cell: Cell) -> Array:
    """Size of the flat ply along s and t, shape (2,), in [m]."""
    grid, overhang = cell.grid, cell.scene.ply.overhang_mm * 1e-3
    spans = np.array([grid.columns - 1, grid.rows - 1])
    return np.asarray(spans * grid.pitch + 2 * (grid.half_width + overhang))


class _Drape(AbstractPath):
    """Arm and legs along a drape."""

    def __init__(
        self, cell: Cell, chain: Chain, legs: Legs, track: Track, bare: float
    ) -> None:
        self.geometry, self.chain = cell.robot.geometry, chain
        self.legs, self.track, self.bare = legs, track, bare
        self.count = len(track.arm)

    def __call__(self, k: NDArray[np.int_], share: Array) -> Moments:
        """Moments at the given places."""
        frames = self.chain.frames(between(self.track.arm, k, share))
        tool = frames[:, -1] @ self.chain.tip

        def ends() -> Array:
            legs = between(self.track.legs, k, share)
            faces, rotations = cup_poses(self.geometry, tool, legs)
            local = self.geometry.universals[..., None]
            universals = (tool[:, None, :3, :3] @ local)[..., 0]
            balls = faces + self.geometry.ball_height * rotations[..., 2]
            upper = universals + tool[:, None, :3, 3]
            return self.legs.ends(upper, balls, self.bare)

        return Moments(frames, ends)


def _kinds(
    cell: Cell,
    track: Track,
    chain: Chain,
    bodies: tuple[tuple[Solid, ...], Solid, Legs],
) -> Iterator[tuple[str, AbstractPairs]]:
    """The pairs of bodies that are looked at, by kind."""
    links, platform, legs = bodies
    q, last = track.arm, platform.joint
    far = [(a, b) for a in links for b in links if b.joint > a.joint + 1]
    yield "arm to arm", SolidPairs(chain, q, far)
    ahead = [(link, platform) for link in links if link.joint < last - 1]
    yield "arm to platform", SolidPairs(chain, q, ahead)
    names = [f"leg {divmod(i, cell.grid.columns)}" for i in range(cell.robot.n_cups)]
    own = _leg_motion(track, legs)
    corner = float(np.linalg.norm(cell.robot.geometry.universals, axis=1).max())
    away = float(np.linalg.norm(chain.tip[:3, 3])) + corner + legs.longest
    for_links = [travel(chain, q, s.joint, last, away)[:, None] + own for s in links]
    yield "arm to legs", LegPairs(names, legs, list(links), np.stack(for_links, axis=1))
    moves = travel(chain, q, 0, last, away)[:, None] + own
    for ground, prisms, bound in _grounds(cell):
        tree = herd(prisms)
        yield f"arm to {ground}", GroundPairs(chain, q, list(links), ground, tree)
        yield f"platform to {ground}", GroundPairs(chain, q, [platform], ground, tree)
        pairs = [(name, ground) for name in names]
        legs_over = LegGroundPairs(pairs, legs, bound, tree, moves, SAFE)
        yield f"legs to {ground}", legs_over


def _leg_motion(track: Track, legs: Legs) -> Array:
    """How far points of each leg move for the tool, shape (K - 1, n), in [m]."""
    step = np.abs(np.diff(track.legs, axis=0))
    return np.asarray(step[..., 2] + legs.longest * (step[..., 0] + step[..., 1]))


def _grounds(cell: Cell) -> Iterator[tuple[str, Array, Bound]]:
    """Name, prisms and bound of what stands in the cell."""
    world_mold, mold = cell.world_mold, cell.mold
    slopes = np.gradient(mold.heights, *mold.step)
    steep = STEEPER * float(np.hypot(*slopes).max())
    to_mold = inverse(world_mold)

    def over_mold(points: Array) -> Array:
        x, y, z = np.moveaxis(points @ to_mold[:3, :3].T + to_mold[:3, 3], -1, 0)
        return np.asarray((z - mold.height(x, y)) / np.hypot(1.0, steep))

    yield "mold", mold_prisms(mold, world_mold), over_mold
    pick, half = cell.scene.pick, ply_size(cell) / 2 + RIM
    world_table = pose(yaw(np.radians(pick.yaw_deg)), pick.position_m)
    to_table = inverse(world_table)

    def over_table(points: Array) -> Array:
        local = points @ to_table[:3, :3].T + to_table[:3, 3]
        beyond = np.concatenate([np.abs(local[..., :2]) - half, local[..., 2:]], -1)
        outside = np.linalg.norm(np.maximum(beyond, 0), axis=-1)
        return np.asarray(outside + np.minimum(beyond.max(axis=-1), 0))

    yield "pick table", table_prism(2 * half, world_table), over_table
