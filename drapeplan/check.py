"""Check: a plan proves itself, or says where it does not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drapeplan.errors import DrapeplanError
from drapeplan.motion import schedule
from drapeplan.path import CupState
from drapeplan.plan import Plan, document_hash, source_hashes
from drapeplan.planner import net_facts, refill
from drapeplan.sequence import Sequence
from drapeplan.track import Track
from drapeplan.words import failures

Array = NDArray[np.float64]
UNUSABLE = (DrapeplanError, ValueError, LookupError, TypeError, ArithmeticError)
SAME = 1e-9  # [-] relative difference of recomputed numbers that counts as none


@dataclass(frozen=True)
class Check:
    """What a check found; each list holds one line for each finding.

    Attributes:
        broken: The hash does not fit the content.
        differing: Recomputed values that differ from the file's.
        violated: Physical limits that the plan does not keep, and a bad verdict.
        verdict: The recomputed verdict; empty if nothing could be recomputed.
    """

    broken: tuple[str, ...]
    differing: tuple[str, ...]
    violated: tuple[str, ...]
    verdict: dict[str, Any]

    @property
    def passed(self) -> bool:
        """Whether nothing was found."""
        return not (self.broken or self.differing or self.violated)


def check_plan(plan: Plan) -> Check:
    """Recompute everything from the file alone.

    Args:
        plan: The plan as read.
    """
    broken = list(_hashes(plan.document))
    try:
        differing = list(_differences(plan))
        verdict, contact = plan.judged
    except UNUSABLE as error:
        return Check(tuple(broken), (f"nothing can be recomputed: {error}",), (), {})
    differing += _compare("verdict", plan.document["verdict"], verdict)
    violated = failures(verdict, contact.front, plan.track)
    return Check(tuple(broken), tuple(differing), tuple(violated), verdict)


def _hashes(document: dict[str, Any]) -> Iterator[str]:
    if document_hash(document) != document["hash"]:
        yield "hash: does not fit the content; the file was altered"
    for key, value in source_hashes(document).items():
        if document["sources_sha256"].get(key) != value:
            yield f"sources_sha256.{key}: does not fit the embedded source"


def _differences(plan: Plan) -> Iterator[str]:
    """Values of the file that do not follow from its joints, scene and sources."""
    document, track, sequence = plan.document, plan.track, plan.sequence
    positions, rotations = track.poses
    waypoints = document["waypoints"]
    stored = {
        "strokes_m": track.legs[..., 2],
        "position_m": positions,
        "rotation": rotations,
    }
    for key, value in stored.items():
        yield from _compare(f"waypoints.{key}", [w[key] for w in waypoints], value)
    made = {
        "start_cup": list(sequence.start_cup),
        "pattern": sequence.pattern,
        "steps": [[list(cup) for cup in cups] for cups in sequence.steps],
    }
    yield from _compare("sequence", document["sequence"], made)
    robot = plan.cell.robot
    yield from _compare(
        "arm.joint_names", document["arm"]["joint_names"], list(robot.arm_names)
    )
    names = [list(names) for names in robot.leg_names]
    yield from _compare(
        "tool.leg_joint_names", document["tool"]["leg_joint_names"], names
    )
    yield from _states(track, sequence)
    time = schedule(plan.cell, track.phase, track.step, track.tau, track.q)
    yield from _compare("waypoints.time_s", track.time, time)
    yield from _compare("scene", document["scene"], plan.scene.model_dump(mode="json"))
    surface = refill(plan.cell)
    if surface is not None:
        yield from _compare("mold", document["mold"], surface)
    facts = net_facts(plan.cell, plan.targets[0])
    yield from _compare("net", document["net"], facts)


def _states(track: Track, sequence: Sequence) -> Iterator[str]:
    """Cup states must follow from phases and steps."""
    for k, phase in enumerate(track.phase):
        state, step = track.states[k], int(track.step[k])
        if phase == "wave":
            done = step + 1 if track.tau[k] == 1 else step
            placed = sequence.placed_after(done)
            landing = sequence.placed_after(step + 1) & ~placed
            wanted = np.where(landing, CupState.LANDING, CupState.HOLDING)
            wanted = np.where(placed, CupState.PLACED, wanted)
        elif phase in ("release", "retreat"):
            wanted = np.full(len(state), CupState.RELEASED)
        elif phase == "approach":
            wanted = np.zeros(len(state), np.uint8)
            start = sequence.index(sequence.start_cup)
            wanted[start] = state[start] if state[start] < CupState.RELEASED else 0
        else:
            wanted = np.full(len(state), CupState.HOLDING)
        if not np.array_equal(state, wanted):
            yield f"waypoints.{k}.cups: is not what phase {phase}, step {step} asks for"
            return


def _compare(key: str, stored: Any, made: Any) -> Iterator[str]:
    """One line for the first value that differs."""
    if isinstance(made, np.ndarray):
        yield from _compare_arrays(key, stored, made)
    elif isinstance(made, dict) and isinstance(stored, dict):
        for name in sorted(made.keys() | stored.keys()):
            inner = list(_compare(f"{key}.{name}", stored.get(name), made.get(name)))
            if inner:
                yield inner[0]
                return
    elif isinstance(made, list) and isinstance(stored, list):
        if len(made) != len(stored):
            yield f"{key}: has {len(stored)} entries, recomputed {len(made)}"
            return
        for k, (a, b) in enumerate(zip(stored, made, strict=True)):
            inner = list(_compare(f"{key}.{k}", a, b))
            if inner:
                yield inner[0]
                return
    elif isinstance(made, float) and isinstance(stored, int | float):
        if abs(stored - made) > SAME * max(1.0, abs(made)):
            yield f"{key}: is {stored!r}, recomputed {made!r}"
    elif stored != made:
        yield f"{key}: is {stored!r}, recomputed {made!r}"


def _compare_arrays(key: str, stored: ArrayLike, made: Array) -> Iterator[str]:
    values = np.array(stored, float)
    if values.shape != made.shape:
        yield f"{key}: has shape {values.shape}, recomputed {made.shape}"
        return
    excess = np.abs(values - made) - SAME * np.maximum(1.0, np.abs(made))
    if (excess > 0).any():
        place = np.unravel_index(excess.argmax(), excess.shape)
        where = ".".join(map(str, map(int, place)))
        yield f"{key}.{where}: is {values[place]:.12g}, recomputed {made[place]:.12g}"
