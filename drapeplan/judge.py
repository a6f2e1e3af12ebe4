"""Judge: what a drape achieves, recomputed from its cup poses and joints alone."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drapeplan.arm_check import judge_arm
from drapeplan.cell import Cell
from drapeplan.closures import Closures
from drapeplan.contact import Contact, judge_contact
from drapeplan.frames import inverse, moved, rotation_vectors
from drapeplan.length_gate import judge_lengths
from drapeplan.motion import ALIGNED, CLOSED, LANDED, LIMIT
from drapeplan.overhang import OverhungGrid
from drapeplan.rest import judge_rest
from drapeplan.sequence import Sequence
from drapeplan.touch import judge_touch
from drapeplan.track import Track
from drapeplan.verdict import FrontVerdict

Array = NDArray[np.float64]

INSTANT = 1e-6  # [s] times are rounded to microseconds
RATE = 1e-6  # [-] share by which a rate may pass its limit: rounded times
DIGITS = 9  # decimals of the numbers in a verdict


def judge(
    cell: Cell, sequence: Sequence, targets: tuple[Array, Array], track: Track
) -> tuple[dict[str, Any], Contact]:
    """Verdict on a drape, and the ply that it rests on.

    Args:
        cell: Robot, mold and ply.
        sequence: Start cup and steps.
        targets: Cup poses at which each cup is to land, mold frame.
        track: The drape.
    """
    span = track.held
    to_mold = inverse(cell.world_mold)
    positions, rotations = moved(to_mold, *(pose[span] for pose in track.poses))
    placed, landing = track.placed[span], track.landing[span]
    contact = judge_contact(cell, sequence, (positions, rotations), placed, landing)
    parts = {
        "interlinks": _interlinks(track),
        "landing": _landing(positions, rotations, placed, targets),
        "laid": _laid(cell, contact),
        "limits": _limits(track),
        "fibers": judge_lengths(cell, track, contact.fibers),
        "arm": judge_arm(cell, track),
        "touch": judge_touch(track, cell.scene.tolerance.touch_mm * 1e-3),
    }
    if cell.scene.fidelity == "equilibrium":
        parts["rest"] = judge_rest(cell, track)
    front = contact.front.to_dict()
    verdict = {
        "good": contact.front.passed
        and contact.front.starts_free
        and all(part["good"] is not False for part in parts.values()),
        "fidelity": cell.scene.fidelity,
        "mold": _mold(cell),
        "ply_model": contact.choice.to_dict(),
        **parts,
        "steps": _steps(track, contact.front, sequence, span),
        "front": front,
    }
    return verdict, contact


def _mold(cell: Cell) -> str:
    """What the gaps to the mold are measured by; the reason stands in the plan."""
    if isinstance(cell.mold, OverhungGrid):
        return str(cell.sources.mold.get("chosen"))
    return "height field"


def _number(value: float) -> float:
    """Plain rounded number, no negative zero."""
    return round(float(value), DIGITS) + 0.0


def _cup(cell_columns: int, index: int) -> list[int]:
    return [int(index) // cell_columns, int(index) % cell_columns]


def _interlinks(track: Track) -> dict[str, Any]:
    """Errors of the interlinks' lengths over all waypoints."""
    closures = Closures(track.robot)
    error = np.abs(closures.values(*track.poses))
    facts: dict[str, Any] = {
        "good": bool(error.max() <= CLOSED),
        "worst_error_mm": _number(1e3 * error.max()),
    }
    if facts["worst_error_mm"] > 0:  # below that, rounding would choose the place
        k, row = np.unravel_index(error.argmax(), error.shape)
        pair = [_cup(track.robot.columns, i) for i in closures.pairs[row]]
        facts |= {"between": pair, "waypoint": int(k)}
    return facts


def _landing(
    positions: Array,
    rotations: Array,
    placed: NDArray[np.bool_],
    targets: tuple[Array, Array],
) -> dict[str, Any]:
    """Placed cups against their targets, and against where they landed."""
    distance = np.linalg.norm(positions - targets[0], axis=-1)
    angle = np.linalg.norm(rotation_vectors(rotations, targets[1]), axis=-1)
    first = placed.argmax(axis=0)
    landed = positions[first, np.arange(placed.shape[1])]
    slide = np.linalg.norm(positions - landed, axis=-1)
    worst = [np.max(x, where=placed, initial=0.0) for x in (distance, angle, slide)]
    return {
        "good": bool(
            worst[0] <= LANDED
            and worst[1] <= ALIGNED
            and worst[2] <= LANDED
            and placed[-1].all()
        ),
        "worst_distance_mm": _number(1e3 * worst[0]),
        "worst_angle_deg": _number(np.degrees(worst[1])),
        "worst_slide_mm": _number(1e3 * worst[2]),
    }


def _laid(cell: Cell, contact: Contact) -> dict[str, Any]:
    """How the laid ply lies: above the mold, inside it, or beside it."""
    limits, front = cell.scene.tolerance, contact.front
    bridge, sink = 1e3 * front.highest.value, -1e3 * front.lowest.value
    pads = np.unique(cell.sampling.cup_index[contact.beside])
    hanging = [_cup(cell.grid.columns, cup) for cup in pads if cup >= 0]
    fits = bridge <= limits.laid_bridge_mm and sink <= limits.laid_sink_mm
    return {
        "good": bool(fits and not hanging),
        "bridges_mm": _number(max(bridge, 0.0)),
        "sinks_mm": _number(max(sink, 0.0)),
        "beside_mold_share": _number(contact.beside.mean()),
        "pads_beside_mold": hanging,
    }


def _limits(track: Track) -> dict[str, Any]:
    """Room left to the limits of joints, strokes and rates."""
    robot, q = track.robot, track.q
    room = np.minimum(q - robot.lower, robot.upper - q)
    stroke = robot.leg_columns[:, 2]
    turning = np.setdiff1d(np.arange(q.shape[1]), stroke)
    duration = np.diff(track.time)[:, None]
    reach = robot.velocity * np.maximum(duration, INSTANT)
    share = (np.abs(np.diff(q, axis=0)) / reach).max(initial=0)
    strokes = q[:, stroke]
    share_left = room / (robot.upper - robot.lower)
    k, worst = np.unravel_index(share_left.argmin(), room.shape)
    good = room.min() >= -LIMIT and share <= 1 + RATE and (duration > 0).all()
    return {
        "good": bool(good),
        "least_stroke_room_mm": _number(1e3 * room[:, stroke].min()),
        "least_joint_room_deg": _number(np.degrees(room[:, turning].min())),
        "tightest_joint": robot.model.names[int(worst) + 1],
        "waypoint": int(k),
        "stroke_range_mm": [_number(1e3 * strokes.min()), _number(1e3 * strokes.max())],
        "largest_rate_share": _number(share),
    }


def _steps(
    track: Track, front: FrontVerdict, sequence: Sequence, span: slice
) -> list[dict[str, Any]]:
    """Margins of each wave step; step 0 is the start cup with its approach."""
    step = np.where(np.array(track.phase[span]) == "wave", track.step[span], -1)
    rows = []
    for k in range(-1, len(sequence.steps)):
        mine = step == k
        cups = [sequence.start_cup] if k < 0 else sequence.steps[k]
        rows.append(
            {
                "step": k + 1,
                "cups": [list(cup) for cup in cups],
                "premature_margin_mm": _margin(front.premature_margin[mine]),
                "air_margin_mm": _margin(front.air_margin[mine]),
                "span_penetration_mm": _number(
                    1e3 * front.span_penetration[mine].max()
                ),
                "pad_penetration_mm": _number(1e3 * front.pad_penetration[mine].max()),
            }
        )
    return rows


def _margin(margins: Array) -> float | None:
    """Least margin in [mm]; None where nothing threatens."""
    least = margins.min(initial=np.inf)
    return _number(1e3 * least) if np.isfinite(least) else None
