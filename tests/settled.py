"""Small drapes, each made once in a process."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import yaml

from drapeplan.cell import Cell, build_cell, read_sources
from drapeplan.motion import Motion, follow
from drapeplan.planner import Outcome, Request, make_plan, make_request, make_track
from drapeplan.scene import scene_from
from drapeplan.sequence import Sequence, make_sequence
from drapeplan.settling import Settling, settle_path
from drapeplan.track import Track
from tests.plans import EXAMPLES, scene
from urdf.generate import write_tool
from urdf.spec import ToolSpec

DOME = {"kind": "paraboloid", "radius_x_m": 0.8, "radius_y_m": 1.5}
SADDLE = {"kind": "paraboloid", "radius_x_m": -0.8, "radius_y_m": 1.0}


@dataclass(frozen=True)
class Drape:
    """A scene up to the kinematic solution of its path."""

    cell: Cell
    sequence: Sequence
    request: Request
    motion: Motion

    def track(self, motion):
        """The drape with other joints."""
        return make_track(self.cell, self.request.path, motion)


def tool_section(folder, **fields):
    """Write a tool of 3 columns by 4 rows, and name it as a scene does."""
    spec = ToolSpec("small", **{"rows": 4, "columns": 3, **fields})
    write_tool(spec, Path(folder))
    return {"urdf": str(Path(folder) / "small.urdf")}


def drape(surface, tool=None, **sections):
    """A drape of the small tool."""
    with TemporaryDirectory() as folder:
        section = tool_section(folder, **(tool or {}))
        read = scene(surface, tool=section, **sections)
        cell = build_cell(read, read_sources(read, Path(folder)))
    sequence = make_sequence(read.sequence, cell.grid.rows, cell.grid.columns, "test")
    request = make_request(cell, sequence)
    return Drape(cell, sequence, request, follow(cell, request.path))


@lru_cache
def small_panel() -> Outcome:
    """The kinematic plan of the small tool over the mesh of examples/panel.yaml."""
    data = yaml.safe_load((EXAMPLES / "panel.yaml").read_text(encoding="utf-8"))
    with TemporaryDirectory() as folder:
        data |= {"tool": tool_section(folder), "fidelity": "kinematic"}
        return make_plan(scene_from(data, "test"), EXAMPLES, "test")


@lru_cache
def small(name) -> Drape:
    """The dome or the saddle, by name."""
    return drape({"dome": DOME, "saddle": SADDLE}[name])


@lru_cache
def settled(name, lead=True) -> Settling:
    """Its path at equilibrium."""
    made = small(name)
    return settle_path(made.cell, made.request.path, made.motion, lead=lead)


@lru_cache
def settled_track(name, lead=True) -> Track:
    """The drape at equilibrium."""
    return small(name).track(settled(name, lead).motion)
