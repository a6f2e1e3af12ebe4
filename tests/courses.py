"""Plans by hand: the requested wave itself, without arm, strokes or equilibrium."""

from functools import lru_cache
from types import SimpleNamespace

import numpy as np

from drapeplan.contact import judge_contact
from drapeplan.frames import moved
from tests.plans import scene, stages

FLAT = {"kind": "plane"}
STEEP = {"kind": "paraboloid", "radius_x_m": 1.0, "radius_y_m": 1.2}


@lru_cache
def wave_plan(kind="flat", take_up_mm=0.4):
    """What `make_course` reads of a plan, on the poses that a scene asks for."""
    surface = FLAT if kind == "flat" else STEEP
    model = "auto" if kind == "flat" else "modal"
    settings = {
        "ply": {"take_up_mm": take_up_mm, "model": model},
        "path": {"family": "rectangle_blend", "poses_per_step": 3},
        "tolerance": {"shape_mm": 50},  # no coupled patches: they take their time
    }
    read = scene(surface, fidelity="kinematic", **settings)
    cell, sequence, _, wave = stages(read)
    poses, cups = (wave.positions, wave.rotations), (wave.placed, wave.landing)
    K = len(wave.step)
    track = SimpleNamespace(
        held=slice(0, K),
        phase=("wave",) * K,
        step=wave.step,
        placed=wave.placed,
        landing=wave.landing,
        poses=moved(cell.world_mold, *poses),
        q=np.zeros((K, cell.robot.nq)),
        tool=np.tile(np.eye(4), (K, 1, 1)),
    )
    return SimpleNamespace(
        scene=read,
        cell=cell,
        sequence=sequence,
        track=track,
        judged=({}, judge_contact(cell, sequence, poses, *cups)),
    )
