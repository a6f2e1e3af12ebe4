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
FALLS = 4.0  # [-] touch heights that a cup may still have to fall where it is looked at
ASIDE = 2.5e-3  # [m] a cup that slides further as it lands drags the ply: assumed
DIGITS = 9  # decimals of the numbers in a verdict


def judge_touch(track: Track, touch: float) -> dict[str, Any]:
    """How cups hang at the last waypoint before they stand.

    They may hang toe-down by HEELS touch heights over a span. A border cup lands
    towards the edge of the tool: nothing further out can lift it. That waypoint says
    something only if little is left to fall, and a cup must not slide far.

    Args:
        track: The drape.
        touch: Height up to which the ply counts as touching, in [m].

    Returns:
        Plain data: whether all is well; toe-down with its limit, the largest of inner
        and of border cups, and the worst cup with its waypoint; largest fall and slide
        of a landing cup with its limit and the cup.
    """
    robot, placed = track.robot, track.placed
    positions, rotations = track.poses
    span = robot.pitch - 2 * robot.half_width
    limit = float(np.degrees(HEELS * touch / span))
    toes: list[tuple[float, bool, list[int], int]] = []
    falls: list[tuple[float, list[int]]] = []
    slides: list[tuple[float, list[int]]] = []
    for k in np.flatnonzero((placed[1:] & ~placed[:-1]).any(axis=1)):
        landing = np.flatnonzero(placed[k + 1] & ~placed[k])
        away = outward(robot.rows, robot.columns, placed[k])
        toe = np.degrees(toe_down(rotations[k], rotations[k + 1], away))
        way = positions[k] - positions[k + 1]
        fall = np.sum(way * rotations[k + 1][..., 2], axis=-1)
        slide = np.linalg.norm(way - fall[:, None] * rotations[k + 1][..., 2], axis=-1)
        border = _at_border(robot.rows, robot.columns, away)
        for n in landing:
            cup = [int(n) // robot.columns, int(n) % robot.columns]
            toes.append((float(toe[n]), bool(border[n]), cup, int(k)))
            falls.append((float(fall[n]), cup))
            slides.append((float(slide[n]), cup))
    worst = max(toes, default=(0.0, False, [0, 0], 0))
    fall, fallen = max(falls, default=(0.0, [0, 0]))
    slide, slid = max(slides, default=(0.0, [0, 0]))
    inner, outer = (
        max([toe for toe, border, *_ in toes if border == kind] + [0.0])
        for kind in (False, True)
    )
    facts: dict[str, Any] = {
        "good": max(inner, outer) <= limit and fall <= FALLS * touch and slide <= ASIDE,
        "limit_deg": _number(limit),
        "inner_toe_down_deg": _number(inner),
        "border_toe_down_deg": _number(outer),
        "largest_fall_mm": _number(1e3 * fall),
        "fall_limit_mm": _number(1e3 * FALLS * touch),
        "fall_cup": fallen,
        "largest_slide_mm": _number(1e3 * slide),
        "slide_limit_mm": _number(1e3 * ASIDE),
        "slide_cup": slid,
    }
    if worst[0] > 0:
        facts |= {"border": worst[1], "cup": worst[2], "waypoint": worst[3]}
    return facts


def _at_border(rows: int, columns: int, away: Array) -> NDArray[np.bool_]:
    """Cups with no neighbor further out, shape (n,)."""
    i, j = np.divmod(np.arange(rows * columns), columns)
    s, t = np.sign(np.round(away.T, 6)).astype(int)
    return (j + s < 0) | (j + s >= columns) | (i + t < 0) | (i + t >= rows)


def _number(value: float) -> float:
    """Plain rounded number, no negative zero."""
    return round(value, DIGITS) + 0.0
