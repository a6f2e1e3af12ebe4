"""Check: a plan proves itself, or says where it does not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drapeplan.errors import DrapeplanError
from drapeplan.families import RectangleBlendPath
from drapeplan.frames import rotation_vectors
from drapeplan.hanging import shifted
from drapeplan.motion import ALIGNED, LANDED, WAITED, schedule
from drapeplan.path import CupState
from drapeplan.path_choice import choice_of
from drapeplan.plan import Plan, document_hash, source_hashes
from drapeplan.planner import lag_facts, make_request, net_facts, refill
from drapeplan.ranking import row_of
from drapeplan.robustness import Robustness, robustness
from drapeplan.robustness_words import document as plain
from drapeplan.settling import GIVEN
from drapeplan.words import failures

Array = NDArray[np.float64]
UNUSABLE = (DrapeplanError, ValueError, LookupError, TypeError, ArithmeticError)
TAU = 1e-6  # [-] a path made anew on another machine may differ this much
REMADE = 1e-6  # [m], [mm], [deg] the same for what is made anew with a solver
SHIFTED = 2e-6  # [m] the same for the shift of the tool: two of its decimals
SAME = 1e-9  # [-] relative difference of recomputed numbers that counts as none


@dataclass(frozen=True)
class Check:
    """What a check found; each list holds one line for each finding.

    Attributes:
        broken: The hash does not fit the content.
        differing: Recomputed values that differ from the file's.
        violated: Physical limits that the plan does not keep, and a bad verdict.
        verdict: The recomputed verdict; empty if nothing could be recomputed.
        robust: The samples that the plan tells of, drawn anew; None where it has none.
    """

    broken: tuple[str, ...]
    differing: tuple[str, ...]
    violated: tuple[str, ...]
    verdict: dict[str, Any]
    robust: Robustness | None = None

    @property
    def holds_together(self) -> bool:
        """Whether the file is what it was, and all follows from it."""
        return bool(self.verdict and not (self.broken or self.differing))

    @property
    def passed(self) -> bool:
        """Whether nothing was found."""
        return not (self.broken or self.differing or self.violated)


def check_plan(plan: Plan) -> Check:
    """Recompute everything from the file alone.

    Args:
        plan: The plan as read.
    """
    broken, told = list(_hashes(plan.document)), plan.document.get("robustness")
    try:
        differing = list(_differences(plan))
        verdict, contact = plan.judged
    except UNUSABLE as error:
        return Check(tuple(broken), (f"nothing can be recomputed: {error}",), (), {})
    differing += _compare("verdict", plan.document["verdict"], verdict)
    robust = None
    if told and not differing:
        robust = robustness(plan, told["samples"], depth=told["depth"])
        differing += _compare("robustness", told, plain(robust))
    block = plan.document.get("candidates")
    if block and not differing:
        first = block["rows"][0]
        made = row_of(plan, first["why"], first["samples"], block["seed"])
        differing += _compare("candidates.rows.0", first, made.model_dump(mode="json"))
    violated = failures(verdict, contact.front, plan.track)
    return Check(tuple(broken), tuple(differing), tuple(violated), verdict, robust)


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
    time = schedule(plan.cell, track.phase, track.step, track.tau, track.q)
    yield from _compare("waypoints.time_s", track.time, time)
    yield from _compare("scene", document["scene"], plan.scene.model_dump(mode="json"))
    made = plan.cell.scene.path.model_dump(mode="json")
    yield from _compare("scene.path", document["scene"]["path"], made)
    told = document.get("path_choice")
    if told and isinstance(plan.scene.path, RectangleBlendPath):
        choice = choice_of(plan.scene, plan.cell.mold, plan.cell.grid)
        yield from _compare("path_choice", told, asdict(choice))
        path = plan.scene.path.model_copy(update=choice.values())
        made = path.model_dump(mode="json")
        yield from _compare("scene.path", document["scene"]["path"], made)
    elif told:
        yield f"path_choice: the family {plan.scene.path.family} has none"
    surface = refill(plan.cell)
    if surface is not None:
        yield from _compare("mold", document["mold"], surface)
    yield from _compare_request(plan)


def _compare_request(plan: Plan) -> Iterator[str]:
    """The waypoints must be those that the scene asks for, none missing."""
    asked, track = make_request(plan.cell, plan.sequence), plan.track
    shift = np.array(plan.document["tool_shift_m"])
    if not np.abs(shift - asked.shift).max() <= SHIFTED:
        yield f"tool_shift_m: is {shift.tolist()}, not {asked.shift.tolist()}"
    path = shifted(asked.path, shift - asked.shift)
    same = path.phase == track.phase and np.array_equal(path.step, track.step)
    if not same or np.abs(path.tau - track.tau).max() > TAU:
        yield "waypoints: phases, steps or tau are not those that the scene asks for"
        return
    if not np.array_equal(path.states, track.states):
        yield "waypoints.cups: are not what phases and steps ask for"
    facts = net_facts(plan.cell, plan.targets[0], asked.targets)
    for key, value in facts.items():
        if not abs(plan.document["net"].get(key, np.nan) - value) <= REMADE:
            yield f"net.{key}: is not what the scene gives, {value:.9g}"
    for key, value in lag_facts(plan.cell, path, track).items():
        if not abs(plan.document["kinematic_lag"].get(key, np.nan) - value) <= REMADE:
            yield f"kinematic_lag.{key}: is not what the scene gives, {value:.9g}"
    landed = path.states >= CupState.LANDING
    judged = np.ones(landed.shape, dtype=bool)
    if plan.scene.fidelity == "equilibrium":  # free cups are where they settle
        landed = path.states >= CupState.PLACED
        judged = landed | np.isin(path.phase, GIVEN)[:, None]
    miss = np.linalg.norm(track.poses[0] - path.positions, axis=-1)
    excess = np.where(judged, miss - np.where(landed, LANDED, WAITED), 0.0)
    turn = np.linalg.norm(rotation_vectors(track.poses[1], path.rotations), axis=-1)
    if not (excess <= 0).all():
        k, cup = np.unravel_index(excess.argmax(), excess.shape)
        size = f"{1e3 * miss[k, cup]:.3g} mm"
        yield f"waypoints.{k}.position_m.{cup}: {size} from what the scene asks for"
    if not (turn[landed] <= ALIGNED).all():
        yield "waypoints.rotation: a landed cup is not turned as the scene asks for"
    if not np.abs(track.tool - path.tool).max() <= REMADE:
        yield "waypoints.arm_rad: the tool does not stand where the scene asks for"
    for stored, made in zip(plan.targets, asked.landing, strict=True):
        if stored.shape != made.shape or not np.abs(stored - made).max() <= REMADE:
            yield "targets: are not those of the scene"


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
        if not abs(stored - made) <= SAME * max(1.0, abs(made)):
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
