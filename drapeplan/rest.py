"""Rest: whether each waypoint of a drape is where its strokes leave the tool."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drapeplan.cell import Cell
from drapeplan.equilibrium import Equilibrium, Settled, SettledStatus
from drapeplan.frames import rotation_vectors
from drapeplan.hanging import rides_level, tool_physics
from drapeplan.legs import cup_poses
from drapeplan.settling import GIVEN
from drapeplan.track import Track

Array = NDArray[np.float64]

AT_REST = 1e-6  # [m] largest move of a held square let go: joints are rounded
DIGITS = 6  # decimals of a stiffness: what Newton's tolerance leaves


def judge_rest(cell: Cell, track: Track) -> dict[str, Any]:
    """Let each waypoint settle and see whether it moves.

    Args:
        cell: Robot, mold and ply.
        track: The drape.

    Returns:
        Plain data: whether all waypoints are at stable rest, the least stiffness of
        the tool with its waypoint, and the waypoint that moves most, if any does.
    """
    tool = Equilibrium(cell.robot, tool_physics(cell))
    columns, fixed = cell.robot.leg_columns, track.placed
    moves, least = np.zeros(len(track.phase)), np.full(len(track.phase), np.inf)
    given = np.isin(track.phase, GIVEN)
    rides = rides_level(track.tool, track.legs, fixed) & ~np.append(True, given[:-1])
    settles = ~(given | rides | fixed.all(axis=1))
    chosen = np.flatnonzero(settles[: track.held.stop])
    for k, found in settled_along(tool, track.q, fixed, chosen):
        poses = cup_poses(cell.robot.geometry, track.tool[k], found.q[columns])
        was = track.poses[0][k], track.poses[1][k]
        moves[k] = _apart(poses, was, cell.robot.half_width)
        if found.status != SettledStatus.SETTLED:
            moves[k] = np.inf
        if found.least_eigenvalue is not None:
            least[k] = found.least_eigenvalue
    worst, softest = int(moves.argmax()), int(least.argmin())
    stable = bool(np.isfinite(moves[worst]))
    return {
        "good": stable and bool(moves[worst] <= AT_REST),
        "stable": stable,
        "least_stiffness_Nm_per_rad": round(float(least[softest]), DIGITS),
        "softest_waypoint": softest,
        **({} if moves[worst] <= AT_REST else {"unsettled_waypoint": worst}),
    }


def settled_along(
    tool: Equilibrium,
    q: Array,
    fixed: NDArray[np.bool_],
    chosen: NDArray[np.int_],
    stability: NDArray[np.bool_] | None = None,
) -> Iterator[tuple[int, Settled]]:
    """Let waypoints settle one after the other, each warm from the one before.

    Args:
        tool: The tool.
        q: Joint positions, shape (K, nq), in [rad] and [m].
        fixed: Placed cups, shape (K, n).
        chosen: Waypoints that settle, in their order.
        stability: Where the rest is asked for its stability, shape (K,); None for all.

    Yields:
        Each waypoint with its rest, found or not.
    """
    warm: Settled | None = None
    for k in map(int, chosen):
        asked = stability is None or bool(stability[k])
        warm = tool.settle(q[k], fixed[k], warm, stability=asked)
        yield k, warm


def _apart(
    poses: tuple[Array, Array], was: tuple[Array, Array], half_width: float
) -> float:
    """How far held squares are from where they were, at an edge, [m]."""
    move = np.linalg.norm(poses[0] - was[0], axis=-1)
    turn = np.linalg.norm(rotation_vectors(poses[1], was[1]), axis=-1)
    return float((move + half_width * turn).max())
