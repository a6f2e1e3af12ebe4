"""From a scene to a checked plan: seconds of each stage, and of the whole command."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from drapeplan.cell import build_cell, read_sources
from drapeplan.check import check_plan
from drapeplan.judge import judge
from drapeplan.motion import follow
from drapeplan.path import plan_path
from drapeplan.plan import Plan
from drapeplan.planner import cup_targets, make_plan, make_track, request_wave
from drapeplan.scene import read_scene
from drapeplan.sequence import make_sequence
from drapeplan.settling import settle_path

EXAMPLES = Path(__file__).parent.parent / "examples"
SCENES = ("panel", "kindrape", "saddle")
MEASURED = """
import sys
from drapeplan.cli import app
app(sys.argv[1:], standalone_mode=False)
sys.stderr.write(open("/proc/self/status").read())
"""


def run(quick: bool) -> dict:
    """Stages in one process, compiled before; then the command, cold and warm."""
    scenes = SCENES[:1] if quick else SCENES
    return {name: {**_stages(name), **_command(name)} for name in scenes}


def _stages(name: str) -> dict:
    path = EXAMPLES / f"{name}.yaml"
    scene = read_scene(path)
    outcome = make_plan(scene, EXAMPLES, str(path))  # compiles what numba compiles
    seconds = {}

    def timed(stage, function, *arguments):
        start = time.perf_counter()
        result = function(*arguments)
        seconds[f"{stage}_s"] = round(time.perf_counter() - start, 3)
        return result

    cell = timed("mold_and_robot", _cell, scene)
    grid = cell.grid
    sequence = make_sequence(scene.sequence, grid.rows, grid.columns, str(path))
    targets = timed("net", cup_targets, cell)
    wave = timed("wave", request_wave, cell, targets, sequence)
    start_cup = sequence.index(sequence.start_cup)
    full = timed("path", plan_path, cell, targets, wave, start_cup)
    motion = timed("strokes", follow, cell, full)
    settled = timed("equilibrium", settle_path, cell, full, motion)
    track = make_track(cell, full, settled.motion)
    timed("verdict", judge, cell, sequence, outcome.plan.targets, track)
    timed("check", check_plan, Plan(outcome.plan.document))
    programs = int(motion.programs.sum())
    return {
        **seconds,
        "waypoints": len(full.tau),
        "programs": programs,
        "ms_per_program": round(1e3 * seconds["strokes_s"] / programs, 2),
    }


def _cell(scene):
    return build_cell(scene, read_sources(scene, EXAMPLES))


def _command(name: str) -> dict:
    """Wall time and peak memory of the command, first with no compiled kernels."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "NUMBA_CACHE_DIR": f"{folder}/numba"}
        command = [sys.executable, "-c", MEASURED, "plan"]
        command += [str(EXAMPLES / f"{name}.yaml"), "-o", f"{folder}/plan.json"]
        times = []
        for _ in range(2):
            start = time.perf_counter()
            done = subprocess.run(
                command, env=environment, check=True, capture_output=True, text=True
            )
            times.append(round(time.perf_counter() - start, 2))
    peak = int(done.stderr.split("VmHWM:")[1].split()[0]) / 1024
    return {
        "command_cold_s": times[0],
        "command_s": times[1],
        "peak_memory_MB": round(peak),
    }
