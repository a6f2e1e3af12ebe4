"""Time of the front check: poses, whole plans, rollouts on windows; where it goes."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks._timing import median_time
from drapeplan.cell import Cell, build_cell, read_sources
from drapeplan.contact import FAR, HIGH, front_grid, judge_contact
from drapeplan.equilibrium import Equilibrium
from drapeplan.flood import air_margins, escape_level, pass_level, premature_margins
from drapeplan.frames import inverse, moved
from drapeplan.front import (
    FrontGrid,
    Tolerance,
    air_pockets,
    check_front,
    heights,
    pose_measures,
    premature_regions,
)
from drapeplan.hanging import tool_physics
from drapeplan.held_ply import held_fibers, held_points
from drapeplan.legs import STROKE, cup_poses, leg_coordinates
from drapeplan.noise import Spread, draw
from drapeplan.path import CupState
from drapeplan.planner import make_plan, make_request
from drapeplan.ply_choice import choose_ply
from drapeplan.refine import Stops, judge_between
from drapeplan.robustness import make_course
from drapeplan.rolling import roll
from drapeplan.rollout import StepWindow
from drapeplan.scene import scene_from
from drapeplan.sequence import Sequence, make_sequence
from ply.grid import CupGrid
from ply.sampling import PlySampling

CUPS = CupGrid(rows=8, columns=6, pitch=0.11, half_width=0.02)
STEP, OVERHANG = 0.01, 0.02  # [m] as in the default scene
START = 21  # cup (3, 3)
TOLERANCE = Tolerance()
POSES = 60
SURFACE = {"kind": "paraboloid", "radius_x_m": 1.2, "radius_y_m": 2.5}
SCENE = {"format": "drapeplan-scene/1", "mold": {"surface": SURFACE}}
WINDOW = range(2, 6), range(1, 5)  # 4 x 4 cups in the middle
TRIES, STEP_POSES = 128, 8
NOISE = 0.3e-3  # [m] of the cups in a try


class Case(NamedTuple):
    """What `judge_contact` asks: poses from the pick to the last landing."""

    cell: Cell
    sequence: Sequence
    poses: tuple[np.ndarray, np.ndarray]  # in the mold frame
    placed: np.ndarray
    landing: np.ndarray


def run(quick: bool) -> dict:
    """Whole plans, rollouts of a step, and the stages of one pose in mid wave."""
    repeats = 20 if quick else 200
    case = planned()
    first_calls = time.perf_counter()
    judge_contact(*case)
    result: dict[str, Any] = {"first_call_s": time.perf_counter() - first_calls}
    result |= whole_plan(case, max(3, repeats // 20))
    result |= rollouts(case, max(3, repeats // 10))
    result |= settled_rollouts(case, max(2, repeats // 20))
    result |= doubts(max(5, repeats // 10))
    return result | one_pose(repeats)


def thread_time(task: Callable[[], object], repeats: int) -> float:
    """Median processor time of a task, in [s]: what one thread needs, others aside."""
    task()
    times = []
    for _ in range(repeats):
        start = time.thread_time()
        task()
        times.append(time.thread_time() - start)
    return float(np.median(times))


def planned() -> Case:
    """The requested path of the default tool on a paraboloid."""
    scene = scene_from(SCENE, "benchmark")
    cell = build_cell(scene, read_sources(scene, Path(".")))
    sequence = make_sequence(scene.sequence, CUPS.rows, CUPS.columns, "benchmark")
    path = make_request(cell, sequence).path
    held = slice(0, len(path.phase) - path.phase[::-1].index("wave"))
    poses = moved(inverse(cell.world_mold), path.positions[held], path.rotations[held])
    states = path.states[held]
    placed, landing = states == CupState.PLACED, states == CupState.LANDING
    return Case(cell, sequence, poses, placed, landing)


def whole_plan(case: Case, repeats: int) -> dict[str, float]:
    """Thread seconds of a whole plan's contact, margins and all, and its stages."""
    cell, sequence, poses, placed, landing = case
    total = thread_time(lambda: judge_contact(*case), repeats)
    contact = judge_contact(*case)
    points, model = contact.points, contact.choice.model
    start = sequence.index(sequence.start_cup)
    grid = front_grid(cell, start, contact.beside)
    final = np.where(contact.beside, 0.0, contact.gap[-1])
    gap = np.where(contact.beside, HIGH, np.minimum(contact.gap, HIGH))
    rest = final, grid, placed, landing, contact.front.tolerance

    def shapes(stops: Stops, new: np.ndarray) -> np.ndarray:
        some = stops.some(new)
        fibers = held_fibers(cell, *some.poses, model)
        points = held_points(cell, fibers, *some.poses, model)
        return np.minimum(cell.mold.gap(points, beside=FAR), HIGH)

    stops = Stops.at_waypoints(poses, placed, landing)
    tolerance = contact.front.tolerance
    stages: dict[str, Callable[[], object]] = {
        "choice_of_ply": lambda: choose_ply(cell, *poses),
        "ply": lambda: held_points(cell, contact.fibers, *poses, model),
        "gap": lambda: cell.mold.gap(points, beside=FAR),
        "margins": lambda: pose_measures(gap, *rest),
        "between": lambda: judge_between(stops, gap, final, grid, tolerance, shapes),
    }
    times = {name: thread_time(task, repeats) for name, task in stages.items()}
    times["between"] -= times["margins"]
    result = {
        "plan_poses": float(len(placed)),
        "plan_poses_between": float(contact.front.poses_between),
        "plan_s": total,
        "plan_gap_ns_per_point": 1e9 * times["gap"] / points[..., 0].size,
    }
    return result | {f"plan_share_{name}": t / total for name, t in times.items()}


def rollouts(case: Case, repeats: int) -> dict[str, float]:
    """Rollouts of one wave step a second and thread, from cup poses to labels."""
    cell, sequence, poses, placed, landing = case
    laid = poses[0][-1], poses[1][-1]
    start = sequence.index(sequence.start_cup)
    step = StepWindow.of(cell, start, laid, *WINDOW)
    chosen = np.flatnonzero(placed.any(axis=1))[STEP_POSES : 2 * STEP_POSES]
    cups = placed[chosen], landing[chosen]
    p, R = (np.repeat(x[None, chosen][:, :, step.cups], TRIES, axis=0) for x in poses)
    p = p + NOISE * np.random.default_rng(0).normal(size=p.shape)
    total = thread_time(lambda: step.faults(p, R, *cups), repeats)
    in_window = step.grid.laid(cups[0])[(slice(None), *step.lines)]
    part = slice(0, 8)
    shapes = thread_time(lambda: step.heights(p[part], R[part], in_window), repeats)
    return {
        "rollout_samples": float(in_window[0].size),
        "rollouts_per_s": TRIES / total,
        "rollout_share_ply_and_gap": shapes * TRIES / 8 / total,
    }


def settled_rollouts(case: Case, repeats: int) -> dict[str, float]:
    """The same from strokes that are off: the tool settles at each pose first."""
    cell, sequence, poses, placed, landing = case
    robot, path = cell.robot, make_request(cell, sequence).path
    chosen = np.flatnonzero(placed.any(axis=1))[STEP_POSES : 2 * STEP_POSES]
    frame = path.tool[chosen[0]]
    arm = robot.arm_inverse(frame, np.array(cell.scene.robot.home_rad))
    world = path.positions[chosen], path.rotations[chosen]
    legs = leg_coordinates(robot.geometry, frame, *world)
    free = ~placed[chosen]
    noise = np.random.default_rng(0).normal(size=free.shape)
    legs[..., STROKE] += NOISE * free * noise
    tool = Equilibrium(robot, tool_physics(cell))
    window = StepWindow.of(
        cell,
        sequence.index(sequence.start_cup),
        (poses[0][-1], poses[1][-1]),
        *WINDOW,
    )

    def settle() -> np.ndarray:
        warm, rests = None, []
        for pose, fixed in zip(legs, placed[chosen], strict=True):
            q = robot.configuration(arm, pose)
            warm = tool.settle(q, fixed, warm, stability=False)
            rests.append(warm.q[robot.leg_columns])
        return np.stack(rests)

    def labels(rests: np.ndarray) -> np.ndarray:
        cups = cup_poses(robot.geometry, frame, rests)
        p, R = moved(inverse(cell.world_mold), *cups)
        near = p[None][:, :, window.cups], R[None][:, :, window.cups]
        return window.faults(*near, placed[chosen], landing[chosen])

    rests = settle()
    total = thread_time(lambda: labels(settle()), repeats)
    return {
        "settled_rollouts_per_s": 1 / total,
        "settled_rollout_share_labels": thread_time(lambda: labels(rests), 10) / total,
    }


def doubts(repeats: int) -> dict[str, float]:
    """Thread milliseconds of a sample of a plan under uncertainty."""
    read = scene_from({**SCENE, "fidelity": "kinematic"}, "benchmark")
    spread = Spread.of(read.uncertainty)
    course = make_course(make_plan(read, Path(), "benchmark").plan, spread)
    poses, cups = course.rests.fixed.shape
    numbers = iter(range(repeats + 1))

    def one() -> object:
        return roll(course, draw(0, next(numbers), cups, poses), spread)

    return {
        "robustness_poses": float(poses),
        "robustness_sample_ms": 1e3 * thread_time(one, repeats),
    }


def one_pose(repeats: int) -> dict[str, float]:
    """Milliseconds a pose: whole checks, and the stages of one pose in mid wave."""
    grid, final_gap = samples()
    good, spoiled = path(grid), path(grid, spoil=True)
    placed, landing = good[1:]
    result: dict[str, float] = {"samples": final_gap.size, "poses": POSES}
    for name, (gap, *cups) in {"in_order": good, "out_of_order": spoiled}.items():
        seconds = median_time(
            lambda gap=gap, cups=cups: check_front(gap, final_gap, grid, *cups),
            max(3, repeats // POSES),
        )
        result[f"check_{name}_ms_per_pose"] = 1e3 * seconds / POSES
    k = POSES // 2
    h = heights(spoiled[0][k], final_gap, grid.laid(placed[k]))
    touch, barrier, start = TOLERANCE.touch, TOLERANCE.barrier, grid.start_pad
    stages: dict[str, Callable[[], object]] = {
        "laid_and_heights": lambda: heights(h, final_gap, grid.laid(placed[k])),
        "pads": lambda: grid.on_pads(landing[k]),
        "flood_from_start": lambda: pass_level(h, start, True),
        "flood_to_edge": lambda: escape_level(h),
        "premature_margins": lambda: premature_margins(h, start, touch, barrier),
        "air_margins": lambda: air_margins(h, touch, barrier),
        "premature_labels": lambda: premature_regions(h, start, TOLERANCE),
        "pocket_labels": lambda: air_pockets(h, TOLERANCE),
    }
    for name, task in stages.items():
        result[f"{name}_ms"] = 1e3 * median_time(task, repeats)
    noise = np.random.default_rng(0).normal(size=h.shape) * touch
    rough = median_time(lambda: pass_level(h + noise, start, True), repeats)
    return result | {"flood_from_start_rough_ms": 1e3 * rough}


def samples() -> tuple[FrontGrid, np.ndarray]:
    """The ply's samples, and the gap of a laid state that is not quite flat, in [m]."""
    ply = PlySampling.regular(CUPS, STEP, OVERHANG)
    grid = FrontGrid(ply.s, ply.t, ply.cup_index, ply.cups_around, CUPS.columns, START)
    return grid, 3e-4 * np.sin(20 * grid.s) * np.cos(15 * grid.t)[:, None]


def path(grid: FrontGrid, spoil: bool = False) -> tuple[np.ndarray, ...]:
    """Gaps of a front that grows from the start, with placed and landing cups.

    Spoiled, the ply sags to the mold ahead of the front in every pose.
    """
    centers = grid.cup_centers - grid.cup_centers[grid.start_cup]
    s, t = grid.s - grid.cup_centers[START, 0], grid.t - grid.cup_centers[START, 1]
    radius = np.maximum(np.abs(s), np.abs(t)[:, None])
    front = np.linspace(-0.05, 0.55, POSES)[:, None, None]
    h = 0.4 * np.maximum(0, radius - front) ** 2 + 0.3 * np.maximum(0, -front)
    if spoil:
        sag = np.exp(-((s - 0.2) ** 2 + (t[:, None] - 0.3) ** 2) / 0.04**2)
        h = np.where(h > 2e-3, h * (1 - sag), h)
    reach = np.abs(centers).max(axis=1)
    placed = reach + 0.04 <= front[:, :, 0]
    landing = ~placed & (reach - 0.09 <= front[:, :, 0])
    return h + samples()[1], placed, landing
