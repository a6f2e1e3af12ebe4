"""Touch: how each cup's pad meets the mold, heel or toe first.

The ply has to meet the mold outward from the start, so that a pad whose outer edge
hangs low, its toe, touches there first and closes a gap behind it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drapeplan.rings import outward, toe_down
from drapeplan.track import Track

Array = NDArray[np.float64]
HEELS = 3.0  # [-] toe-down of three touch heights over a free span spoils the order
DIGITS = 9  # decimals of the numbers in a verdict


def judge_touch(track: Track, touch: float) -> dict[str, Any]:
    """How far cups hang toe-down at the last waypoint before they stand.

    A border cup lands towards the edge of the tool: nothing further out can lift it.

    Args:
        track: The drape.
        touch: Height up to which the ply counts as touching, in [m].

    Returns:
        Plain data: whether all is well, the limit, the largest toe-down of inner and of
        border cups in degrees, and the worst cup with its waypoint.
    """
    robot, placed = track.robot, track.placed
    rotations = track.poses[1]
    rows, columns = robot.rows, robot.columns
    span = robot.pitch - 2 * robot.half_width
    limit = float(np.degrees(HEELS * touch / span))
    i, j = np.divmod(np.arange(robot.n_cups), columns)
    worst = {False: 0.0, True: 0.0}
    facts: dict[str, Any] = {}
    for k in np.flatnonzero((placed[1:] & ~placed[:-1]).any(axis=1)):
        landing = np.flatnonzero(placed[k + 1] & ~placed[k])
        away = outward(rows, columns, placed[k])
        angle = np.degrees(toe_down(rotations[k], rotations[k + 1], away))
        s, t = np.sign(np.round(away.T, 6)).astype(int)
        outside = (j + s < 0) | (j + s >= columns) | (i + t < 0) | (i + t >= rows)
        for cup in landing:
            border = bool(outside[cup])
            if angle[cup] > max(worst.values()):
                where = [int(i[cup]), int(j[cup])]
                facts = {"cup": where, "border": border, "waypoint": int(k)}
            worst[border] = max(worst[border], float(angle[cup]))
    return {
        "good": max(worst.values()) <= limit,
        "limit_deg": round(limit, DIGITS),
        "inner_toe_down_deg": round(worst[False], DIGITS),
        "border_toe_down_deg": round(worst[True], DIGITS),
        **facts,
    }
