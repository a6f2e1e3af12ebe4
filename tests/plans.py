"""Plans that several tests look at, each made once in a process."""

from functools import lru_cache
from pathlib import Path

from drapeplan.cell import build_cell, read_sources
from drapeplan.planner import Outcome, cup_targets, make_plan, request_wave
from drapeplan.scene import read_scene, scene_from
from drapeplan.sequence import make_sequence

EXAMPLES = Path(__file__).parent.parent / "examples"
PARABOLOID = {"kind": "paraboloid", "radius_x_m": 1.2, "radius_y_m": 2.5}
SADDLE = {"kind": "paraboloid", "radius_x_m": 1.8, "radius_y_m": -1.5}
BOWL = {"kind": "paraboloid", "radius_x_m": -1.0, "radius_y_m": -1.0}


def scene(surface=None, **sections):
    """A scene on an analytic surface, other sections as given."""
    mold = {"surface": surface or PARABOLOID, **sections.pop("mold", {})}
    data = {"format": "drapeplan-scene/1", "mold": mold, **sections}
    return scene_from(data, "test")


@lru_cache
def panel() -> Outcome:
    """The plan of examples/panel.yaml."""
    path = EXAMPLES / "panel.yaml"
    return make_plan(read_scene(path), EXAMPLES, str(path))


def stages(read):
    """Cell, sequence, targets and wave of a scene."""
    cell = build_cell(read, read_sources(read, EXAMPLES))
    grid = cell.grid
    sequence = make_sequence(read.sequence, grid.rows, grid.columns, "test")
    targets = cup_targets(cell)
    return cell, sequence, targets, request_wave(cell, targets, sequence)
