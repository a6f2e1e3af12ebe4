"""Drapes that charts look at: examples, and tools of any size over a surface."""

from collections.abc import Iterator
from collections.abc import Sequence as Row
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from types import ModuleType

import numpy as np
import yaml

from drapeplan.cell import Cell, build_cell, read_sources
from drapeplan.motion import Motion, follow
from drapeplan.path import CupState, Path
from drapeplan.planner import Request, make_request
from drapeplan.scene import scene_from
from drapeplan.sequence import Sequence, make_sequence
from urdf.generate import write_tool
from urdf.spec import ToolSpec

EXAMPLES = FilePath(__file__).parents[2] / "examples"
DOME = {"kind": "paraboloid", "radius_x_m": 0.8, "radius_y_m": 1.5}


@dataclass(frozen=True)
class Drape:
    """A scene up to the kinematic solution of its path."""

    cell: Cell
    sequence: Sequence
    request: Request
    motion: Motion

    @property
    def path(self) -> Path:
        """The requested path."""
        return self.request.path

    @property
    def hovering(self) -> np.ndarray:
        """Cups that hang free, shape (K, n)."""
        return np.asarray(self.path.states != CupState.PLACED)

    def wave(self) -> np.ndarray:
        """Waypoints of the wave at which cups hang free."""
        wave = np.array(self.path.phase) == "wave"
        return np.flatnonzero(wave & self.hovering.any(axis=1))


def example(name: str, **sections) -> dict:
    """Data of an example's scene, some of its sections changed."""
    text = (EXAMPLES / f"{name}.yaml").read_text(encoding="utf-8")
    return merged(yaml.safe_load(text), sections)


def merged(data: dict, changes: dict) -> dict:
    """Data with the keys of some sections changed."""
    return data | {
        key: {**data.get(key, {}), **value} if isinstance(value, dict) else value
        for key, value in changes.items()
    }


def over(surface: dict, **sections) -> dict:
    """Data of a scene on an analytic surface."""
    return {"format": "drapeplan-scene/1", "mold": {"surface": surface}, **sections}


@contextmanager
def sized(data: dict, size: Row[int] | None) -> Iterator[dict]:
    """Data of a scene with a tool of so many rows and columns; paths are absolute."""
    if size is None:
        yield data
        return
    with TemporaryDirectory() as folder:
        urdf, _ = write_tool(ToolSpec("tool", *size), FilePath(folder))
        yield data | {"tool": {"urdf": str(urdf)}}


def cell_of(data: dict, size: Row[int] | None = None) -> Cell:
    """Cell of a scene's data; size gives rows and columns of another tool."""
    with sized(data, size) as whole:
        scene = scene_from(whole, "chart")
        return build_cell(scene, read_sources(scene, EXAMPLES))


def order_of(cell: Cell) -> Sequence:
    """Sequence of a cell."""
    grid = cell.grid
    return make_sequence(cell.scene.sequence, grid.rows, grid.columns, "chart")


def drape(cell: Cell) -> Drape:
    """Plan a cell up to the strokes."""
    sequence = order_of(cell)
    request = make_request(cell, sequence)
    return Drape(cell, sequence, request, follow(cell, request.path))


@contextmanager
def swapped(module: ModuleType, **values) -> Iterator[None]:
    """Constants of a module changed for a while."""
    before = {name: getattr(module, name) for name in values}
    try:
        for name, value in values.items():
            setattr(module, name, value)
        yield
    finally:
        for name, value in before.items():
            setattr(module, name, value)
