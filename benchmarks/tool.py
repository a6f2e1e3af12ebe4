"""Time and stability of the tool's equilibrium, against its kinematic inverse."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
from scipy.linalg.lapack import dgetrf
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from benchmarks._stability import stability_maps, write_maps
from benchmarks._timing import median_time
from drapeplan.cell import build_cell, read_sources
from drapeplan.equilibrium import Equilibrium, SettledStatus, ToolPhysics
from drapeplan.legs import STROKE, leg_coordinates
from drapeplan.path import CupState
from drapeplan.planner import make_request
from drapeplan.robot import Robot, arm_description
from drapeplan.scene import read_scene
from drapeplan.sequence import make_sequence
from urdf import read_tool, tool_names

EXAMPLES = Path(__file__).parent.parent / "examples"
PLY = ToolPhysics(bending=0.02, areal_mass=0.31, longest_fiber=0.0708)
RADIUS_S, RADIUS_T = 1.0, 2.0  # [m]
HOLDING = 20  # the one cup that stands


def run(quick: bool) -> dict:
    """Milliseconds of one pose and of a wave; where stroke jumps lead."""
    result: dict = {"ply": str(asdict(PLY))}
    for name in tool_names():
        robot = Robot(arm_description("ur10"), *read_tool(name))
        result |= {
            f"{name}_{k}": v for k, v in _pose(robot, 5 if quick else 100).items()
        }
    result |= _wave()
    names = tool_names()[:1] if quick else tool_names()
    for name in names:
        robot = Robot(arm_description("ur10"), *read_tool(name))
        sizes = {"jumps": (0.02, 0.06), "radii": (np.inf, 1.0)} if quick else {}
        maps = stability_maps(robot, PLY, 1 if quick else 5, **sizes)
        result |= {f"{name}_{k}": v for k, v in _summary(maps).items()}
        if not quick:
            result[f"{name}_files"] = write_maps(maps, name)
    return result


def _pose(robot: Robot, repeats: int) -> dict:
    """Cold and warm settling, sensitivities, the linear system in three ways."""
    tool = Equilibrium(robot, PLY)
    fixed = np.arange(robot.n_cups) == HOLDING
    q = _mold_strokes(robot)
    settled = tool.settle(q, fixed)
    moved = settled.q.copy()
    step = np.random.default_rng(0).uniform(-2e-3, 2e-3, robot.n_cups)
    moved[robot.leg_columns[:, STROKE]] += np.where(fixed, 0.0, step)
    warm = tool.settle(moved, fixed, settled)
    state = robot.kinematics(settled.q)
    poses = state.positions, state.rotations
    tasks = {
        "cold": lambda: tool.settle(q, fixed),
        "warm": lambda: tool.settle(moved, fixed, settled),
        "warm_no_stability": lambda: tool.settle(
            moved, fixed, settled, stability=False
        ),
        "sensitivities": lambda: tool.sensitivities(settled, fixed),
        "leg_inverse": lambda: leg_coordinates(
            robot.geometry, state.T_world_tool, *poses
        ),
    }
    tasks |= _linear(tool, settled, fixed)
    result = {f"{name}_ms": 1e3 * median_time(f, repeats) for name, f in tasks.items()}
    return result | {
        "cold_iterations": settled.iterations,
        "warm_iterations": warm.iterations,
        "warm_residual_Nm": warm.residual,
        "warm_closure_mm": 1e3 * warm.closure,
        "least_eigenvalue_Nm": settled.least_eigenvalue,
    }


def _linear(tool: Equilibrium, settled, fixed) -> dict:
    """One linear system of Newton's method: evaluated, and factored in three ways."""
    robot = tool.robot
    T = robot.arm_forward(settled.q[robot.arm_columns])
    forces = np.concatenate([settled.multipliers, settled.chord_forces])
    legs = settled.q[robot.leg_columns]
    terms = tool.energy.evaluate(T, legs, forces)
    layout = tool.layout(~fixed, forces)
    dense = np.zeros((layout.size, layout.size))
    dense[layout.r, layout.c] = layout.entries(terms)
    sparse = csc_matrix(dense)
    return {
        "evaluate": lambda: tool.energy.evaluate(T, legs, forces),
        "banded_lu": lambda: layout.factor(terms),
        "dense_lu": lambda: dgetrf(dense),
        "sparse_lu": lambda: splu(sparse),
    }


def _mold_strokes(robot: Robot) -> np.ndarray:
    q, (i, j) = robot.home(), np.divmod(np.arange(robot.n_cups), robot.columns)
    x = (j - (robot.columns - 1) / 2) * robot.pitch
    y = (i - (robot.rows - 1) / 2) * robot.pitch
    z = -(x * x) / (2 * RADIUS_S) - y * y / (2 * RADIUS_T)
    q[robot.leg_columns[:, STROKE]] -= z - z[HOLDING]
    return q


def _wave() -> dict:
    """Every pose of the panel's wave at rest, from strokes of the kinematic inverse."""
    path = EXAMPLES / "panel.yaml"
    scene = read_scene(path)
    cell = build_cell(scene, read_sources(scene, EXAMPLES))
    sequence = make_sequence(
        scene.sequence, cell.grid.rows, cell.grid.columns, str(path)
    )
    request, robot = make_request(cell, sequence).path, cell.robot
    waves = [k for k, phase in enumerate(request.phase) if phase == "wave"]
    arm = robot.arm_inverse(request.tool[waves[0]], np.array(scene.robot.home_rad))
    T = robot.arm_forward(arm)
    tool, settled, poses = Equilibrium(robot, PLY), None, []

    def once() -> None:
        nonlocal settled
        settled = None
        poses.clear()
        for k in waves:
            legs = leg_coordinates(
                robot.geometry, T, request.positions[k], request.rotations[k]
            )
            fixed = request.states[k - 1] == CupState.PLACED
            settled = tool.settle(robot.configuration(arm, legs), fixed, settled)
            poses.append(settled)

    seconds = median_time(once, 3)
    return {
        "wave_poses": len(waves),
        "wave_s": seconds,
        "wave_ms_per_pose": 1e3 * seconds / len(waves),
        "wave_iterations": sum(pose.iterations for pose in poses),
        "wave_settled": sum(p.status == SettledStatus.SETTLED for p in poses),
        "wave_worst_closure_mm": 1e3 * max(pose.closure for pose in poses),
        "wave_least_eigenvalue_Nm": min(p.least_eigenvalue or np.inf for p in poses),
    }


def _summary(maps: dict) -> dict:
    result = {}
    for kind, found in maps.items():
        cells = found["cells"]
        result[f"{kind}_starts"] = str(found["starts"])
        for way in ("at_once", "in_parts"):
            counts = [cell[way] for cell in cells]
            text = ", ".join(f"{sum(c[s] for c in counts)} {s}" for s in counts[0])
            result[f"{kind}_{way}"] = text
        inside, failed = (sum(c[k] for c in cells) for k in ("inside", "inside_failed"))
        result[f"{kind}_inside_envelope"] = f"{inside} jumps, {failed} not settled"
    return result
