"""Strokes that lead the tilt lag: how fast, how true, and what the pads gain by it."""

import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path as FilePath

import numpy as np

from drapeplan.cell import Cell, build_cell, read_sources
from drapeplan.closures import Closures
from drapeplan.errors import InfeasibleError
from drapeplan.frames import rotation_vectors
from drapeplan.hanging import kinematic_lag
from drapeplan.judge import judge
from drapeplan.legs import cup_poses
from drapeplan.motion import Motion, follow
from drapeplan.path import CupState, Path
from drapeplan.planner import Request, make_request, make_track
from drapeplan.scene import scene_from
from drapeplan.sequence import Sequence, make_sequence
from drapeplan.settling import Settling, settle_path
from urdf import tool_names

EXAMPLES = FilePath(__file__).parent.parent / "examples"
RESULTS = FilePath(__file__).parent / "results" / "lead.json"
BENDING = (0.02, 0.005)  # [N m]
SURFACES = {
    "paraboloid (1, 2)": ("paraboloid", 1.0, 2.0),
    "convex (1.2, 2.5)": ("paraboloid", 1.2, 2.5),
    "saddle (-1.5, 1.8)": ("paraboloid", -1.5, 1.8),
    "saddle (-1, 2)": ("paraboloid", -1.0, 2.0),
    "sphere 1": ("sphere", 1.0),
    "sphere -1": ("sphere", -1.0),
    "cylinder 0.5": ("cylinder", 0.5),
    "kindrape 0.3 x 1.0": ("kindrape", 0.3, 1.0),
    "kindrape 0.3 x 1.2": ("kindrape", 0.3, 1.2),
}
KEYS = {
    "paraboloid": ("radius_x_m", "radius_y_m"),
    "sphere": ("radius_m",),
    "cylinder": ("radius_m",),
    "kindrape": ("relief", "size_m"),
}
SPEED_HEAD = (
    f"{'speed':<20}{'ring s':>8}{'cpu':>6}{'wave s':>8}{'cpu':>6}{'poses':>6}"
    f"{'ms':>6}{'Newton':>7}{'closure mm':>11}{'placed mm':>10}{'deg':>9}"
    f"{'belief mm':>10}"
)
LANDING_HEAD = (
    f"{'landing':<20}{'tool':<10}{'D':>6} {'lead':<5}{'inner':>6}{'border':>7}"
    f"{'premature':>10}{'air':>7}{'depth':>7}  {'order':<6}{'good':<6}"
    f"{'lag mm':>7}{'deg':>6}"
)


@dataclass(frozen=True)
class Asked:
    """A scene up to the kinematic solution of its path."""

    cell: Cell
    sequence: Sequence
    request: Request
    motion: Motion


def run(quick: bool) -> dict:
    """Speed with the default tool; landing with both tools, two plies, both ways."""
    names = ["paraboloid (1, 2)", "saddle (-1.5, 1.8)"] if quick else list(SURFACES)
    speeds, landings = {}, []
    for name in names:
        print(f"  {name}", file=sys.stderr)
        asked = _asked(name, tool_names()[0], BENDING[0])
        if isinstance(asked, str):
            speeds[name] = {"refused": asked}
        else:
            speeds[name] = _speeds(asked, 1 if quick else 3)
        for tool in tool_names()[:1] if quick else tool_names():
            landings += list(_landings(name, tool, BENDING[:1] if quick else BENDING))
    result = {"speed": speeds, "landing": landings}
    if not quick:
        RESULTS.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    return {"table": _lines(speeds, landings), "figures": result}


def _asked(name: str, tool: str, bending: float) -> Asked | str:
    """Net, wave, path and kinematic strokes; why there are none."""
    kind, *sizes = SURFACES[name]
    surface = {"kind": kind, **dict(zip(KEYS[kind], sizes, strict=True))}
    data = {"format": "drapeplan-scene/1", "mold": {"surface": surface}}
    data |= {"tool": {"name": tool}, "ply": {"bending_stiffness_Nm": bending}}
    scene = scene_from(data, name)
    cell = build_cell(scene, read_sources(scene, EXAMPLES))
    rows, columns = cell.grid.rows, cell.grid.columns
    sequence = make_sequence(scene.sequence, rows, columns, name)
    try:
        request = make_request(cell, sequence)
        return Asked(cell, sequence, request, follow(cell, request.path))
    except InfeasibleError as error:
        return str(error)


def _speeds(asked: Asked, repeats: int) -> dict:
    """Ring ends alone, and the whole wave: seconds, and how true the result is."""
    path, cell = asked.request.path, asked.cell
    count = (path.states == CupState.PLACED).sum(axis=1)
    before = np.flatnonzero((count[1:] > count[:-1]) & (count[1:] <= count.max()))
    rings = np.unique(np.concatenate([before, before + 1]))
    wave = np.flatnonzero(np.array(path.phase) == "wave")
    result = {}
    for name, chosen in (("ring", rings), ("wave", wave)):
        part, motion = _part(path, chosen), _part(asked.motion, chosen)
        try:
            figures = _timed(lambda p=part, m=motion: settle_path(cell, p, m), repeats)
        except InfeasibleError as error:
            return {"refused": str(error)}
        found, wall, cpu = figures
        result |= {
            f"{name}_s": wall,
            f"{name}_cpu_s": cpu,
            f"{name}_poses": len(chosen),
        }
    iterations = int(found.iterations.sum())
    return {
        **result,
        "follow_programs": int(asked.motion.programs.sum()),
        "ms_a_pose": 1e3 * result["wave_s"] / len(wave),
        "newton_a_pose": iterations / len(wave),
        "believed_mm": 1e3 * float(found.believed.max()),
        "least_stiffness_Nm": float(found.least_eigenvalue.min()),
        **_truth(cell, _part(path, wave), found),
    }


def _part(whole: Path | Motion, chosen: np.ndarray) -> Path | Motion:
    """Some waypoints of a path or a motion."""
    values = {f.name: getattr(whole, f.name) for f in fields(whole)}
    return replace(
        whole,
        **{
            name: tuple(x[k] for k in chosen) if isinstance(x, tuple) else x[chosen]
            for name, x in values.items()
        },
    )


def _timed(task: Callable[[], Settling], repeats: int) -> tuple[Settling, float, float]:
    """A result with the median of its wall and processor times, [s]."""
    result, times = task(), []
    for _ in range(repeats):
        wall, cpu = time.perf_counter(), time.process_time()
        task()
        times.append((time.perf_counter() - wall, time.process_time() - cpu))
    return result, *(float(x) for x in np.median(times, axis=0))


def _truth(cell: Cell, path: Path, found: Settling) -> dict:
    """Interlinks, and placed cups against their request."""
    robot, q = cell.robot, found.motion.q
    legs, arm = q[:, robot.leg_columns], q[:, robot.arm_columns]
    tool = np.stack([robot.arm_forward(x) for x in arm])
    positions, rotations = cup_poses(robot.geometry, tool, legs)
    placed = path.states == CupState.PLACED
    miss = np.linalg.norm(positions - path.positions, axis=-1)[placed]
    turn = np.linalg.norm(rotation_vectors(rotations, path.rotations), axis=-1)
    closure = np.abs(Closures(robot).values(positions, rotations)).max()
    return {
        "closure_mm": 1e3 * float(closure),
        "placed_mm": 1e3 * float(miss.max()),
        "placed_deg": float(np.degrees(turn[placed].max())),
    }


def _landings(name: str, tool: str, plies: tuple[float, ...]) -> Iterator[dict]:
    """How pads land and what the verdict is, without and with the lead."""
    for bending in plies:
        label = {"scene": name, "tool": tool, "bending_Nm": bending}
        asked = _asked(name, tool, bending)
        if isinstance(asked, str):
            yield {**label, "refused": asked}
            continue
        arm = asked.motion.q[:, asked.cell.robot.arm_columns]
        distance, angle = kinematic_lag(asked.cell, asked.request.path, arm)
        label |= {"lag_mm": 1e3 * distance, "lag_deg": float(np.degrees(angle))}
        for lead in (False, True):
            yield {**label, "lead": lead, **_landing(asked, lead)}


def _landing(asked: Asked, lead: bool) -> dict:
    """Toe-down, margins and verdict of one drape."""
    cell, path = asked.cell, asked.request.path
    try:
        motion = settle_path(cell, path, asked.motion, lead=lead).motion
    except InfeasibleError as error:
        return {"refused": str(error)}
    track = make_track(cell, path, motion)
    verdict, contact = judge(cell, asked.sequence, asked.request.landing, track)
    touch, front = verdict["touch"], contact.front
    return {
        "inner_toe_down_deg": touch["inner_toe_down_deg"],
        "border_toe_down_deg": touch["border_toe_down_deg"],
        "premature_margin_mm": _margin(front.premature_margin),
        "air_margin_mm": _margin(front.air_margin),
        "span_penetration_mm": 1e3 * float(front.span_penetration.max()),
        "pad_penetration_mm": 1e3 * float(front.pad_penetration.max()),
        "in_order": bool(front.in_order),
        "good": bool(verdict["good"]),
        "failing": [
            part
            for part, found in verdict.items()
            if isinstance(found, dict) and found.get("good") is False
        ]
        + ([] if front.passed else ["front"]),
    }


def _margin(margins: np.ndarray) -> float | None:
    """Least margin, [mm]; None where nothing threatens."""
    least = margins.min(initial=np.inf)
    return 1e3 * float(least) if np.isfinite(least) else None


def _lines(speeds: dict, landings: list[dict]) -> list[str]:
    """The compact table."""
    lines = [SPEED_HEAD]
    for name, x in speeds.items():
        lines.append(f"{name:<20}" + (x.get("refused") or _speed_line(x)))
    lines += ["", LANDING_HEAD]
    for x in landings:
        kind = "resilient" if "resilient" in x["tool"] else "default"
        head = f"{x['scene']:<20}{kind:<10}{x['bending_Nm']:>6} "
        lines.append(head + (x.get("refused") or _landing_line(x)))
    return lines


def _speed_line(x: dict) -> str:
    return (
        f"{x['ring_s']:8.2f}{x['ring_cpu_s']:6.2f}{x['wave_s']:8.2f}"
        f"{x['wave_cpu_s']:6.2f}{x['wave_poses']:6d}{x['ms_a_pose']:6.1f}"
        f"{x['newton_a_pose']:7.1f}{x['closure_mm']:11.1e}{x['placed_mm']:10.1e}"
        f"{x['placed_deg']:9.1e}{x['believed_mm']:10.3f}"
    )


def _landing_line(x: dict) -> str:
    premature, air = (
        "-" if x[key] is None else f"{x[key]:.1f}"
        for key in ("premature_margin_mm", "air_margin_mm")
    )
    return (
        f"{'yes' if x['lead'] else 'no':<5}{x['inner_toe_down_deg']:6.2f}"
        f"{x['border_toe_down_deg']:7.2f}{premature:>10}{air:>7}"
        f"{x['span_penetration_mm']:7.2f}  {'yes' if x['in_order'] else 'NO':<6}"
        f"{'yes' if x['good'] else 'NO':<6}{x['lag_mm']:7.2f}{x['lag_deg']:6.2f}"
        f" {' '.join(x['failing'])}"
    )
