"""Path: tool placements and cup poses from the pick to the retreat, as requested."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from drapeplan.cell import Cell
from drapeplan.families import HoverPath
from drapeplan.frames import (
    FLIP,
    around_base,
    inverse,
    moved,
    pose,
    translation,
    yaw,
)
from drapeplan.legs import leg_coordinates
from drapeplan.net import Net
from drapeplan.wave import Wave, shaping

Array = NDArray[np.float64]

LIFT_POSES = 4
SHAPING_POSES = 10
TRANSFER_POSES = 12
DESCENT_POSES = 12
RETREAT_POSES = 4
LAST_HEIGHT = 0.2e-3  # [m] last pose of the descent before the start cup touches


class CupState(IntEnum):
    """What a cup does."""

    HOLDING = 0
    LANDING = 1
    PLACED = 2
    RELEASED = 3


@dataclass(frozen=True)
class Path:
    """Waypoints, K of them, with n cups each; cup poses in the world.

    Attributes:
        phase: Name of the phase of each waypoint.
        step: Wave step, -1 outside the wave and while the start cup lands, shape (K,).
        tau: Progress within the step, shape (K,).
        tool: Placement of tool0, shape (K, 4, 4).
        positions: Cup positions, shape (K, n, 3), in [m].
        rotations: Cup rotations, shape (K, n, 3, 3).
        states: CupState of each cup, shape (K, n).
    """

    phase: tuple[str, ...]
    step: NDArray[np.int_]
    tau: Array
    tool: Array
    positions: Array
    rotations: Array
    states: NDArray[np.uint8]


@dataclass(frozen=True)
class _Stretch:
    """A stretch of the path: one phase."""

    phase: str
    tool: Array
    positions: Array
    rotations: Array
    states: NDArray[np.uint8]
    step: NDArray[np.int_]
    tau: Array


def plan_path(cell: Cell, targets: Net, wave: Wave, start_cup: int) -> Path:
    """All waypoints of a drape.

    The tool keeps still during the wave; its height centers the legs' range. The ply
    is picked flat at mid stroke. Families with a lift shape the ply over the table and
    lower it onto the mold; the hover family may bring it flat and shape it there.

    Args:
        cell: Robot, mold and ply.
        targets: Net of the cups on the mold.
        wave: Cup poses of the wave in the mold frame.
        start_cup: Index of the first cup placed.
    """
    builder = _Builder(cell, targets, wave, start_cup)
    stretches = builder.stretches()
    columns = {
        f.name: np.concatenate([getattr(part, f.name) for part in stretches])
        for f in fields(_Stretch)
        if f.name != "phase"
    }
    phase = tuple(part.phase for part in stretches for _ in part.tau)
    return Path(phase, **columns)


class _Builder:
    """Frames and shapes that the phases share; everything in the mold frame."""

    def __init__(self, cell: Cell, targets: Net, wave: Wave, start_cup: int) -> None:
        self.cell, self.targets, self.wave = cell, targets, wave
        self.start_cup = start_cup
        scene, grid = cell.scene, cell.grid
        warp = np.radians(scene.placement.warp_deg)
        self.flat_cups = self._flat_cups()
        center = targets.xy.mean(axis=0)
        turn = yaw(warp)
        self.tool = pose(turn @ FLIP, (*center, self._tool_height(turn, center)))
        s, t = np.meshgrid(
            (np.arange(grid.columns) - (grid.columns - 1) / 2) * grid.pitch,
            (np.arange(grid.rows) - (grid.rows - 1) / 2) * grid.pitch,
        )
        flat = np.stack([s.ravel(), t.ravel()], axis=1)
        self.flat_xy = flat @ turn[:2, :2].T + center
        self.flat_height = self.tool[2, 3] - self.flat_cups

    def _flat_cups(self) -> float:
        """Distance of a flat ply below tool0 with all legs at mid stroke, [m]."""
        leg = self.cell.robot.geometry
        depth = leg.universals[0, 2]
        middle = (leg.leg_min + leg.leg_max) / 2
        return float(depth + middle + leg.ball_height)

    def _tool_height(self, turn: Array, center: Array) -> float:
        """Height of tool0 above the mold's origin that centers the strokes, [m]."""
        geometry = self.cell.robot.geometry
        middle = (geometry.leg_max - geometry.leg_min) / 2
        height = self.wave.positions[..., 2].mean() + self.flat_cups
        for _ in range(4):
            T = pose(turn @ FLIP, (*center, height))
            poses = self.wave.positions, self.wave.rotations
            stroke = leg_coordinates(geometry, T, *poses)[..., 2]
            height += middle - (stroke.min() + stroke.max()) / 2
        return float(height)

    def stretches(self) -> list[_Stretch]:
        """The phases in order."""
        path, flat = self.wave.path, self._flat()
        flat_arrival = isinstance(path, HoverPath) and path.arrival == "flat"
        carried, above = (self.wave.positions[:1], self.wave.rotations[:1]), 0.0
        if isinstance(path, HoverPath) and flat_arrival:
            start = self.targets.positions[self.start_cup, 2]
            carried, above = flat, start + path.height_mm * 1e-3 - self.flat_height
        descent = self._clear_height(carried[0]) - above
        over = self._above_mold(np.array([above + descent]))[0]
        pick_tool, lifting = self._lift(over)
        stretches = [
            self._together("pick", pick_tool[None], flat),
            self._together("lift", lifting, flat),
        ]
        shape = self._shaped(np.linspace(0, 1, SHAPING_POSES + 1)[1:])
        if not flat_arrival:
            still = np.tile(lifting[-1], (SHAPING_POSES, 1, 1))
            stretches.append(self._together("preshape", still, shape))
        heights = self._descent(descent)
        transfer = around_base(
            lifting[-1], over, np.linspace(0, 1, TRANSFER_POSES + 1)[1:]
        )
        tools = np.concatenate([transfer, self._above_mold(above + heights)])
        approach = self._together("approach", tools, carried)
        if self._lands_with_the_arm:
            approach.states[TRANSFER_POSES:, self.start_cup] = CupState.LANDING
            approach.states[-1, self.start_cup] = CupState.PLACED
        stretches.append(approach)
        if flat_arrival:
            rise = above * (1 - np.linspace(0, 1, SHAPING_POSES + 1)[1:])
            stretches.append(self._together("preshape", self._above_mold(rise), shape))
        return [*stretches, self._wave_stretch(), *self._leave()]

    @property
    def _lands_with_the_arm(self) -> bool:
        """Whether the arm's descent lands the start cup, not its own stroke."""
        return not isinstance(self.wave.path, HoverPath)

    def _lift(self, over: Array) -> tuple[Array, Array]:
        """Pick placement, and straight up at least as high as the transfer goes."""
        pick = self._pick_tool()
        lift = self.cell.scene.motion.lift_mm * 1e-3
        height = max(lift, float(over[2, 3] - pick[2, 3]))
        rise = np.linspace(0, height, LIFT_POSES + 1)[1:]
        return pick, np.stack([translation(z=z) @ pick for z in rise])

    def _descent(self, height: float) -> Array:
        """Heights above the end of the descent; finer and finer before contact, [m]."""
        if not self._lands_with_the_arm:
            return height * np.linspace(1, 0, DESCENT_POSES + 1)[1:]
        shares = np.arange(1, DESCENT_POSES) / (DESCENT_POSES - 1)
        return height * np.append((LAST_HEIGHT / height) ** shares, 0.0)

    def _flat(self) -> tuple[Array, Array]:
        """Flat ply below the tool, mold frame: (1, n, 3) and (1, n, 3, 3)."""
        n = len(self.flat_xy)
        height = np.full((n, 1), self.flat_height)
        turn = self.tool[:3, :3] @ FLIP
        return np.hstack([self.flat_xy, height])[None], np.tile(turn, (1, n, 1, 1))

    def _shaped(self, fractions: Array) -> tuple[Array, Array]:
        """From flat to the first pose of the wave, in the mold frame."""
        wave = self.wave
        positions, rotations = shaping(
            self.cell.grid,
            (self.flat_xy, self.flat_height),
            (wave.surface, wave.positions[0, :, :2], wave.height),
            fractions[:-1],
        )
        return (
            np.concatenate([positions, self.wave.positions[:1]]),
            np.concatenate([rotations, self.wave.rotations[:1]]),
        )

    def _pick_tool(self) -> Array:
        """Placement of tool0 over the pick table, in the world."""
        pick = self.cell.scene.pick
        above = np.add(pick.position_m, (0, 0, self.flat_cups))
        return pose(yaw(np.radians(pick.yaw_deg)) @ FLIP, above)

    def _together(
        self,
        phase: str,
        tools: Array,
        shape: tuple[Array, Array],
        state: CupState = CupState.HOLDING,
    ) -> _Stretch:
        """A phase in which all cups do the same, in a shape that rides on the tool.

        The shape is given in the mold frame as it is when the tool stands where the
        wave has it: one pose for the whole phase, or one for each waypoint.
        """
        count = len(tools)
        states = np.full((count, len(self.flat_xy)), state, np.uint8)
        tau = np.arange(1, count + 1) / count
        poses = moved(tools @ inverse(self.tool), *shape)
        return _Stretch(phase, tools, *poses, states, np.full(count, -1), tau)

    def _clear_height(self, positions: Array) -> float:
        """Height above the wave's at which cups pass the whole mold, in [m]."""
        clearance = self.cell.scene.motion.clearance_mm * 1e-3
        mold = self.cell.mold
        drop = mold.heights[mold.covered].max() - positions[..., 2].min()
        return clearance + max(0.0, float(drop))

    def _above_mold(self, heights: Array) -> Array:
        """Placements of tool0 above where the wave has it, shape (m, 4, 4)."""
        rises = [self.cell.world_mold @ translation(z=z) @ self.tool for z in heights]
        return np.stack(rises)

    def _wave_stretch(self) -> _Stretch:
        """The wave after its first pose, which the phase before has reached."""
        wave = self.wave
        flying = np.where(wave.landing, CupState.LANDING, CupState.HOLDING)
        states = np.where(wave.placed, CupState.PLACED, flying).astype(np.uint8)[1:]
        poses = moved(self.cell.world_mold, wave.positions[1:], wave.rotations[1:])
        tools = np.repeat(self._above_mold(np.zeros(1)), len(states), axis=0)
        return _Stretch("wave", tools, *poses, states, wave.step[1:], wave.tau[1:])

    def _leave(self) -> tuple[_Stretch, _Stretch]:
        """Release the ply and rise."""
        last = self.wave.positions[-1:], self.wave.rotations[-1:]
        height = self._clear_height(last[0])
        rise = self._above_mold(np.linspace(0, height, RETREAT_POSES + 1))
        return (
            self._together("release", rise[:1], last, CupState.RELEASED),
            self._together("retreat", rise[1:], last, CupState.RELEASED),
        )
