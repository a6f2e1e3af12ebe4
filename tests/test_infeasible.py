"""Scenes that no strokes can follow end with exit code 1 and a name."""

import numpy as np
import pytest

from drapeplan.errors import InfeasibleError
from drapeplan.motion import follow
from drapeplan.path import plan_path
from drapeplan.relaxation import RowKind
from tests.plans import scene, stages
from urdf.generate import write_tool
from urdf.spec import ToolSpec

SMALL = {"rows": 4, "columns": 5}  # a tool whose refusals take a second
BOWL = {"kind": "paraboloid", "radius_x_m": -1.0, "radius_y_m": -1.0}


def refusal(read):
    """The error that a scene ends with."""
    cell, sequence, targets, wave = stages(read)
    path = plan_path(cell, targets, wave, sequence.index(sequence.start_cup))
    with pytest.raises(InfeasibleError) as stop:
        follow(cell, path)
    assert stop.value.exit_code == 1
    return stop.value, cell, path


@pytest.fixture
def write(tmp_path):
    """Write a tool, return its section."""

    def tool(**changes):
        write_tool(ToolSpec(name="other", **changes), tmp_path)
        return {"urdf": str(tmp_path / "other.urdf")}

    return tool


def test_high_interlinks_on_a_bowl_leave_fibers_too_short(write):
    """Links 30 mm above the faces draw in on a bowl: the faces part by 30 s / R."""
    bowl = {"kind": "paraboloid", "radius_x_m": -0.8, "radius_y_m": -0.8}
    error, _, _ = refusal(scene(bowl, tool=write(**SMALL, interlink_height=0.03)))
    assert {row.kind for row in error.rows} <= {RowKind.FIBER, RowKind.INTERLINK}
    assert "a fiber between cup (" in error.what
    assert "interlinks nearer the suction face" in error.remedy


def test_a_tight_sphere_wants_more_take_up(write):
    sphere, ply = {"kind": "sphere", "radius_m": 0.5}, {"take_up_mm": 0.3}
    error, _, _ = refusal(scene(sphere, ply=ply, tool=write(**SMALL)))
    assert error.rows[0].kind == RowKind.FIBER
    assert "is too short" in error.what
    assert "take_up_mm" in error.remedy


def test_short_strokes_name_the_cup_that_needs_the_longest(write):
    error, cell, path = refusal(scene(tool=write(leg_min=0.275, leg_max=0.325)))
    k, robot = error.waypoint, cell.robot
    legs = robot.leg_columns[:, 2].tolist()
    assert error.rows[0].kind == RowKind.LIMIT
    asked = path.positions[k] - path.tool[k][:3, 3]
    off = asked @ path.tool[k][:3, 2] - 0.365  # [m] depth, mid leg and ball
    assert legs.index(error.rows[0].index) == np.abs(off).argmax()
    assert "stroke passes its limit" in error.what
    assert "a longer stroke" in error.remedy


def test_a_mold_out_of_reach_is_the_arms_fault(drapeplan, write_scene, tmp_path):
    mold = {"surface": BOWL, "position_m": [2.0, 0.0, 0.2]}
    ended = drapeplan("plan", write_scene(mold=mold), "-o", tmp_path / "plan.json")
    assert ended.code == 1
    assert "the arm stays short of tool0 at (2.000" in ended.line
    assert "move the mold" in ended.line
