"""Planner: from a scene to a plan, each stage handing plain data to the next."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path as FilePath
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from drapeplan.cell import (
    Cell,
    build_cell,
    fill_surface,
    read_sources,
)
from drapeplan.contact import Contact, judge_contact
from drapeplan.errors import InfeasibleError, InputError
from drapeplan.explain import words
from drapeplan.families import HoverPath, RectangleBlendPath, known
from drapeplan.hanging import hang_shift, kinematic_lag, shifted
from drapeplan.judge import judge
from drapeplan.motion import Motion, StrokesError, follow
from drapeplan.net import Net
from drapeplan.overhang import pads_over_edges
from drapeplan.path import Path, plan_path
from drapeplan.path_choice import chosen_path, landing_net
from drapeplan.plan import DIGITS, Plan, make_document
from drapeplan.scene import Scene
from drapeplan.sentences import sentences
from drapeplan.sequence import Sequence, make_sequence
from drapeplan.settling import UnsettledError, settle_path
from drapeplan.shear import cell_shear
from drapeplan.track import Track
from drapeplan.wave import Wave, plan_wave

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]


class Watch(Protocol):
    """Somebody who looks on while a drape is planned."""

    def path(self, cell: Cell, path: Path) -> None:
        """What is asked for, before any joint is known."""

    def waypoint(self, k: int, q: Array) -> None:
        """Joint positions of a waypoint; a later stage may better them."""


class NotDrapableError(InfeasibleError):
    """No joint positions lay the ply as asked; the requested poses are judged anyway.

    Attributes:
        report: What was found, as plain data with units in the keys.
        sentences: The same in words.
    """

    def __init__(
        self, cause: InfeasibleError, report: dict[str, Any], words: list[str]
    ) -> None:
        """Keep the cause's line and add the report."""
        super().__init__(cause.what, cause.excess, cause.remedy)
        self.report, self.sentences = report, words


@dataclass(frozen=True)
class Outcome:
    """A plan with what the command line and the preview show of it."""

    plan: Plan
    contact: Contact
    motion: Motion


def make_plan(
    scene: Scene,
    folder: FilePath,
    source: str,
    progress: Progress | None = None,
    watch: Watch | None = None,
) -> Outcome:
    """Plan a drape.

    Args:
        scene: The scene.
        folder: Folder that the scene's paths are relative to.
        source: Names the scene in error messages.
        progress: Called with the stage and its share done, 0 to 1.
        watch: Shown what is known so far; it changes nothing.

    Raises:
        InputError: If the scene names what does not exist or does not fit.
        InfeasibleError: If the answer is no before all waypoints exist.
    """
    tell = progress or (lambda stage, share: None)
    tell("mold and robot", 0.0)
    cell = build_cell(scene, read_sources(scene, folder))
    sequence = make_sequence(scene.sequence, cell.grid.rows, cell.grid.columns, source)
    made = plan_drape(cell, sequence, progress, watch)
    _, choice = chosen_path(scene, cell.mold, cell.grid)
    return replace(made, plan=made.plan.rolled(asdict(choice))) if choice else made


def plan_drape(
    cell: Cell,
    sequence: Sequence,
    progress: Progress | None = None,
    watch: Watch | None = None,
) -> Outcome:
    """Plan a drape in a cell that stands already.

    Args:
        cell: Robot, mold and ply; its scene says how the ply comes down.
        sequence: Start cup and steps.
        progress: Called with the stage and its share done, 0 to 1.
        watch: Shown what is known so far; it changes nothing.

    Raises:
        InfeasibleError: If the answer is no before all waypoints exist.
    """
    tell = progress or (lambda stage, share: None)
    scene = cell.scene
    tell("net and wave", 0.0)
    asked = make_request(cell, sequence)
    path, wave = asked.path, asked.wave
    if watch:
        watch.path(cell, path)

    def solved(stage: str, done: int, q: Array) -> None:
        tell(stage, done / len(path.tau))
        if watch:
            watch.waypoint(done - 1, q)

    try:
        motion = follow(cell, path, partial(solved, "strokes"))
        if scene.fidelity == "equilibrium":
            told = partial(solved, "rest")
            motion = settle_path(cell, path, motion, progress=told).motion
    except (StrokesError, UnsettledError) as error:
        raise _not_drapable(cell, sequence, wave, error) from error
    track = make_track(cell, path, motion)
    tell("front", 0.0)
    landing = asked.landing
    verdict, contact = judge(cell, sequence, landing, track)
    facts = net_facts(cell, landing[0], asked.targets)
    lag = lag_facts(cell, path, track)
    made = {"net": facts, "kinematic_lag": lag, "tool_shift_m": asked.shift.tolist()}
    document = make_document(cell, sequence, landing, made, track, verdict)
    tell("front", 1.0)
    return Outcome(Plan(document), contact, motion)


@dataclass(frozen=True)
class Request:
    """What a scene asks of arm and tool, before any joint is known.

    Attributes:
        targets: Least-shear net on the mold.
        wave: Cup poses of the wave, mold frame.
        path: All waypoints, world, the tool shifted.
        shift: Shift of the tool from the approach on, world, shape (3,), in [m].
    """

    targets: Net
    wave: Wave
    path: Path
    shift: Array

    @property
    def landing(self) -> tuple[Array, Array]:
        """Where each cup is to land: (n, 3) in [m] and (n, 3, 3), mold frame."""
        last = self.wave.positions[-1], self.wave.rotations[-1]
        positions, rotations = (np.round(x, DIGITS) + 0.0 for x in last)
        return positions, rotations


def make_request(cell: Cell, sequence: Sequence) -> Request:
    """Net, wave and path of a scene.

    Raises:
        InfeasibleError: If there is no net of cup targets on the mold.
        InputError: If a step leans by itself that the wave does not have.
    """
    last = len(sequence.steps)
    for number, _ in cell.scene.path.toe_up_steps:
        if number > last:
            problem = f"there is no step {number}"
            raise InputError("scene", "path.toe_up_steps", problem, f"{last} is last")
    targets = cup_targets(cell)
    wave = request_wave(cell, targets, sequence)
    start = sequence.index(sequence.start_cup)
    path = plan_path(cell, targets, wave, start)
    settles = cell.scene.fidelity == "equilibrium"
    shift = hang_shift(cell, path) if settles else np.zeros(3)
    return Request(targets, wave, shifted(path, shift), shift)


def cup_targets(cell: Cell) -> Net:
    """Least-shear net of cup targets on the mold.

    Raises:
        InfeasibleError: If there is no such net, or a cup lies beside the mold.
    """
    grid = cell.grid
    net = landing_net(cell.scene, cell.mold, grid)
    most = cell.scene.tolerance.laid_bridge_mm * 1e-3
    edges = pads_over_edges(cell.mold, net.xy, grid.half_width, most)
    if edges:
        cup, off = max(edges, key=lambda edge: edge[1])
        i, j = divmod(cup, grid.columns)
        x, y = 1e3 * net.xy[cup]
        what = f"the pad of cup ({i}, {j}) would land on an edge of the mold, at "
        what += f"({x:.0f}, {y:.0f}) mm, and miss it"
        remedy = "place the ply so that edges lie between the cups"
        if len(edges) > 1:
            remedy = f"so would {len(edges) - 1} others; {remedy}"
        raise InfeasibleError(what, f"{1e3 * off:.1f} mm", remedy)
    return net


def request_wave(cell: Cell, targets: Net, sequence: Sequence) -> Wave:
    """Requested cup poses; freely given steps are pressed down from a hover."""
    path = cell.scene.path
    if not sequence.rectangles and isinstance(path, RectangleBlendPath):
        path = HoverPath(family="hover", toe_up_deg=known(path.toe_up_deg))
    warp = float(np.radians(cell.scene.placement.warp_deg))
    return plan_wave(cell.mold, targets, cell.grid, sequence, path, warp)


def net_facts(cell: Cell, positions: Array, targets: Net) -> dict[str, float]:
    """Link error and shear of the landed net, and how far the wave let it drift.

    Args:
        cell: Gives the tool's grid.
        positions: Where the cups land, shape (n, 3), in [m].
        targets: The least-shear net.
    """
    grid = cell.grid
    points = positions.reshape(grid.rows, grid.columns, 3)
    links = [np.linalg.norm(np.diff(points, axis=k), axis=-1).ravel() for k in (0, 1)]
    error = np.abs(np.concatenate(links) - grid.pitch).max()
    shear = np.abs(cell_shear(points))
    drift = np.linalg.norm(positions - targets.positions, axis=1).max()
    return {
        "worst_link_error_mm": round(1e3 * float(error), 9),
        "largest_cell_shear_deg": round(float(np.degrees(shear.max())), 9),
        "mean_cell_shear_deg": round(float(np.degrees(shear.mean())), 9),
        "drift_from_least_shear_mm": round(1e3 * float(drift), 6),
    }


def lag_facts(cell: Cell, path: Path, track: Track) -> dict[str, float]:
    """How far the cups of the kinematic fidelity would really be off before contact.

    Args:
        cell: Robot, mold and ply.
        path: The requested path.
        track: The drape; its arm is used.
    """
    distance, angle = kinematic_lag(cell, path, track.arm)
    return {
        "largest_distance_mm": round(1e3 * distance, 6),
        "largest_angle_deg": round(float(np.degrees(angle)), 6),
    }


def refill(cell: Cell) -> dict[str, Any] | None:
    """Height grid of an analytic mold, filled anew; None for a mesh."""
    if cell.scene.mold.surface is None:
        return None
    return fill_surface(cell.scene, cell.robot).to_data()


def make_track(cell: Cell, path: Path, motion: Motion) -> Track:
    """Joint positions along a path, with what each cup does."""
    robot = cell.robot
    return Track(
        robot,
        path.phase,
        path.step,
        path.tau,
        motion.time,
        motion.q[:, robot.arm_columns],
        motion.q[:, robot.leg_columns],
        path.states,
    )


def _not_drapable(
    cell: Cell, sequence: Sequence, wave: Wave, cause: StrokesError | UnsettledError
) -> NotDrapableError:
    """Judge the order on the requested poses, which no strokes reach."""
    clearance = np.array([0.0, 0.0, cell.scene.motion.clearance_mm * 1e-3])
    none = np.zeros_like(wave.placed[:1])
    contact = judge_contact(
        cell,
        sequence,
        (
            np.concatenate([wave.positions[:1] + clearance, wave.positions]),
            np.concatenate([wave.rotations[:1], wave.rotations]),
        ),
        np.concatenate([none, wave.placed]),
        np.concatenate([none, wave.landing]),
        refined=False,
    )
    steps = len(sequence.steps)
    names = ["Approach"]
    for step in wave.step:
        name = f"Wave step {step + 1} of {steps}" if step >= 0 else "Start cup"
        names.append(f"{name}, as requested")
    lines = sentences(contact.front, names)
    report = {
        "good": False,
        "fidelity": cell.scene.fidelity,
        "strokes": {
            "waypoint": cause.waypoint,
            "phase": cause.phase,
            "step": cause.step + 1,
            "problem": cause.what,
            "excess": cause.excess,
            "remedy": cause.remedy,
            "open": _open_rows(cell, cause),
        },
        "front_on_requested_poses": contact.front.to_dict(),
        "sentences": lines,
    }
    return NotDrapableError(cause, report, lines)


def _open_rows(cell: Cell, cause: StrokesError | UnsettledError) -> list[str]:
    """What stays open when all constraints of the step give way, the worst first."""
    if isinstance(cause, UnsettledError):
        return []
    found = [words(cell.robot, row) for row in cause.rows]
    return [f"{what}: {excess}" for what, excess, _ in found]
