"""Paths as the verdict takes them: cups off by an error, ply looked at more finely."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.charts._drapes import order_of
from drapeplan.cell import Cell
from drapeplan.frames import inverse, moved
from drapeplan.legs import Array
from drapeplan.path import CupState
from drapeplan.planner import make_request
from drapeplan.sequence import Sequence
from ply.grid import CupGrid
from ply.sampling import PlySampling

LINES = {35: (1, 2), 20: (2, 4), 10: (4, 7), 5: (8, 14), 2.5: (16, 28)}
"""Intervals over a cup and over a span, by the spacing of lines in [mm]."""
OFF, TURNED = 0.5e-3, np.radians(1.0)  # [m], [rad] standard deviations of them
Poses = tuple[Array, Array]


class Case(NamedTuple):
    """Poses of a path in the mold frame, and what the cups do in them."""

    cell: Cell
    sequence: Sequence
    poses: Poses
    placed: Array
    landing: Array


def case_of(cell: Cell) -> Case:
    """The requested path of a cell, up to its last landing."""
    sequence = order_of(cell)
    path = make_request(cell, sequence).path
    held = slice(0, len(path.phase) - path.phase[::-1].index("wave"))
    poses = moved(inverse(cell.world_mold), path.positions[held], path.rotations[held])
    states = path.states[held]
    cups = states == CupState.PLACED, states == CupState.LANDING
    return Case(cell, sequence, poses, *cups)


def off_by(poses: Poses, free: Array, height: Array, tilt: Array) -> Poses:
    """Free cups moved along their normals and tilted, in standard deviations."""
    positions, rotations = poses
    about = TURNED * np.concatenate([tilt, 0 * tilt[..., :1]], axis=-1)
    turn = Rotation.from_rotvec(about.reshape(-1, 3)).as_matrix()
    turn = turn.reshape(*about.shape, 3)
    rise = OFF * height[..., None] * rotations[..., 2]
    return (
        positions + np.where(free[..., None], rise, 0.0),
        np.where(free[..., None, None], turn @ rotations, rotations),
    )


def sampled(cell: Cell, spacing: float) -> Cell:
    """The cell with its ply looked at on other lines."""
    grid = cell.sampling.grid
    on_cup, on_span = LINES[spacing]
    s, t = (
        lines_over(grid, count, on_cup, on_span) for count in (grid.columns, grid.rows)
    )
    return replace(cell, sampling=PlySampling(grid, s, t))


def lines_over(grid: CupGrid, cups: int, on_cup: int, on_span: int) -> Array:
    """Lines over cups, spans and an overhang half as wide as a cup."""
    half, pitch = grid.half_width, grid.pitch
    over_cup = np.linspace(-half, half, on_cup + 1)
    lines = [pitch * k + over_cup for k in range(cups)]
    lines += [
        pitch * k + np.linspace(half, pitch - half, on_span + 1)
        for k in range(cups - 1)
    ]
    beyond = np.linspace(half, 2 * half, max(1, on_cup // 2) + 1)
    lines += [-beyond, pitch * (cups - 1) + beyond]
    return np.unique(np.round(np.concatenate(lines), 9))
