"""Cups files: the measured poses of the cups, read and checked.

Format drapeplan-cups/1, JSON. Each cup has its row and column, the center of its
suction face and a rotation whose columns are the directions of s, t and the normal.
The block `ply` has what is known of the ply's mass, stiffness and edge.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from drapeplan.errors import InputError
from drapeplan.files import read_text
from ply.errors import PlyError
from ply.grid import CupGrid

Array = NDArray[np.float64]

MM = 1e-3  # [m] one millimeter
ROTATION_ERROR = 5e-4  # [-] of R'R: what four printed decimals leave
EARTH = 9.81  # [m/s^2]

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Triple = tuple[float, float, float]

REMEDIES = {
    "finite_number": "write a finite number",
    "missing": "add it",
    "extra_forbidden": "remove it or mend its spelling",
    "less_than_equal": "mind the unit in the key",
}


class _Model(BaseModel):
    model_config = ConfigDict(
        strict=True, extra="forbid", frozen=True, allow_inf_nan=False
    )


class _Allowance(_Model):
    """What may give; accepted beside the grid or inside it."""

    take_up_mm: NotNegative | None = None
    pose_sigma_mm: NotNegative | None = None
    pose_sigma_deg: NotNegative | None = None


class GridEntry(_Allowance):
    """The cup array of a cups file."""

    rows: Annotated[int, Field(ge=1)]
    columns: Annotated[int, Field(ge=1)]
    pitch_mm: Positive
    half_width_mm: Positive
    s_length_mm: Positive | None = None
    t_length_mm: Positive | None = None


class CupEntry(_Model):
    """One cup of a cups file."""

    row: Annotated[int, Field(ge=0)]
    column: Annotated[int, Field(ge=0)]
    position_mm: Triple
    rotation: tuple[Triple, Triple, Triple]


class PlyEntry(_Model):
    """What is known of the ply in a cups file; nothing of it need be."""

    areal_mass_kg_m2: Annotated[float, Field(ge=0, le=50)] | None = None
    bending_stiffness_Nm: Annotated[float, Field(gt=0, le=1)] | None = None
    overhang_mm: NotNegative | None = None
    up: Triple = (0.0, 0.0, 1.0)


class CupsFile(_Allowance):
    """A cups file as it is written."""

    format: Literal["drapeplan-cups/1"]
    grid: GridEntry
    ply: PlyEntry = PlyEntry()
    cups: list[CupEntry]


@dataclass(frozen=True, eq=False)
class Cups:
    """Poses of all cups of an array.

    Attributes:
        grid: The cup array.
        positions: Centers of the suction faces, shape (n_cups, 3), in [m].
        rotations: Cup frames, shape (n_cups, 3, 3).
        take_up: Largest change of fiber length either way, in [m]; 0: none.
        pose_sigma: Standard deviation of the positions, in [m]; 0: exact.
        pose_sigma_angle: Standard deviation of the directions, in [rad]; 0: exact.
        source: The file that was read.
        lengths_given: Whether the file gives s_length_mm, and t_length_mm.
        areal_mass: Mass of the ply, in [kg/m^2], or None where the file has none.
        bending: Bending stiffness of the ply, in [N m], or None.
        overhang: Ply beyond the edges of the outer cups, in [m], or None.
        up: Direction against gravity, a unit vector.
    """

    grid: CupGrid
    positions: Array
    rotations: Array
    take_up: float = 0.0
    pose_sigma: float = 0.0
    pose_sigma_angle: float = 0.0
    source: str = ""
    lengths_given: tuple[bool, bool] = (False, False)
    areal_mass: float | None = None
    bending: float | None = None
    overhang: float | None = None
    up: Triple = (0.0, 0.0, 1.0)

    def weight(self) -> Triple:
        """Weight of the ply per area, in [N/m^2]; 0 where mass or stiffness is unknown.

        Gravity bends the ply by the ratio of both.
        """
        mass = 0.0 if self.bending is None else self.areal_mass or 0.0
        x, y, z = (0.0 - EARTH * mass * one for one in self.up)
        return x, y, z


def read_cups(path: str | Path) -> Cups:
    """Read a cups file.

    Args:
        path: The file.

    Returns:
        The cups, in SI units, in the order row * columns + column.

    Raises:
        InputError: The file cannot be read, is no JSON, breaks the format, or holds
            numbers that no cup array has.
    """
    source = str(path)
    entry = _parse(source, read_text(source, "give a JSON file"))
    grid = _grid(source, entry.grid)
    positions, rotations = _poses(source, grid, entry.cups)
    overhang = _overhang(source, grid, entry.ply)
    take_up = MM * _allowance(source, entry, "take_up_mm")
    shortest = min(grid.s_length, grid.t_length)
    if take_up >= shortest:
        problem = f"{take_up / MM:g} mm in spans of {shortest / MM:g} mm"
        raise InputError(source, "take_up_mm", problem, "mind the unit")
    return Cups(
        grid,
        positions,
        rotations,
        take_up,
        MM * _allowance(source, entry, "pose_sigma_mm"),
        float(np.deg2rad(_allowance(source, entry, "pose_sigma_deg"))),
        source,
        (entry.grid.s_length_mm is not None, entry.grid.t_length_mm is not None),
        entry.ply.areal_mass_kg_m2,
        entry.ply.bending_stiffness_Nm,
        overhang,
        _up(source, entry.ply),
    )


def _parse(source: str, text: str) -> CupsFile:
    try:
        return CupsFile.model_validate_json(text)
    except ValidationError as failure:
        error: Any = failure.errors(include_url=False, include_input=False)[0]
        key = "".join(
            f"[{part}]" if isinstance(part, int) else f".{part}"
            for part in error["loc"]
        )
        remedy = REMEDIES.get(error["type"], "")
        raise InputError(source, key.lstrip("."), error["msg"], remedy) from None


def _grid(source: str, entry: GridEntry) -> CupGrid:
    lengths = [
        None if length is None else MM * length
        for length in (entry.s_length_mm, entry.t_length_mm)
    ]
    half = MM * entry.half_width_mm
    try:
        # None asks for the default length, which the grid fills in.
        return CupGrid(entry.rows, entry.columns, MM * entry.pitch_mm, half, *lengths)  # type: ignore[arg-type]
    except PlyError as error:
        key = f"grid.{error.argument}"
        key += "" if error.argument in ("rows", "columns") else "_mm"
        raise InputError(source, key, error.problem, error.remedy) from None


def _overhang(source: str, grid: CupGrid, entry: PlyEntry) -> float | None:
    """Overhang in [m]; models continue cups and strips, which has its limits."""
    if entry.overhang_mm is None:
        return None
    most = grid.pitch - grid.half_width
    if MM * entry.overhang_mm >= most:
        problem = f"{entry.overhang_mm:g} mm reach a pitch beyond the outer cups"
        remedy = f"use less than {most / MM:g} mm"
        raise InputError(source, "ply.overhang_mm", problem, remedy)
    return MM * entry.overhang_mm


def _up(source: str, entry: PlyEntry) -> Triple:
    size = float(np.linalg.norm(entry.up))
    if size == 0:
        raise InputError(source, "ply.up", "has no direction", "write [0, 0, 1]")
    x, y, z = (float(one) / size for one in entry.up)
    return x, y, z


def _poses(source: str, grid: CupGrid, entries: list[CupEntry]) -> tuple[Array, Array]:
    """Positions in [m] and rotations, in order."""
    number: dict[int, int] = {}
    for n, entry in enumerate(entries):
        name, key = _name(entry.row, entry.column), f"cups[{n}]"
        if entry.row >= grid.rows or entry.column >= grid.columns:
            problem = f"{name} is outside {grid.rows} rows, {grid.columns} columns"
            raise InputError(source, key, problem, "count from 0")
        index = entry.row * grid.columns + entry.column
        if index in number:
            problem = f"{name} stands in cups[{number[index]}] already"
            raise InputError(source, key, problem, "give each cup once")
        number[index] = n
        _check_rotation(source, key, name, np.array(entry.rotation))
    if len(number) < grid.n_cups:
        index = min(set(range(len(number) + 1)) - number.keys())
        problem = f"{len(number)} of {grid.n_cups} cups; the first missing is "
        problem += _name(*divmod(index, grid.columns))
        raise InputError(source, "cups", problem, "give every cup once")
    ordered = [entries[number[index]] for index in range(grid.n_cups)]
    positions = MM * np.array([entry.position_mm for entry in ordered], dtype=float)
    rotations = np.array([entry.rotation for entry in ordered], dtype=float)
    return positions, rotations


def _check_rotation(source: str, key: str, name: str, rotation: Array) -> None:
    error = abs(rotation.T @ rotation - np.eye(3)).max()
    if not error <= ROTATION_ERROR:
        problem = f"{name}: columns are off unit length or right angles by {error:.2g}"
        remedy = f"make R'R the identity to {ROTATION_ERROR:g}"
        raise InputError(source, f"{key}.rotation", problem, remedy)
    if np.linalg.det(rotation) < 0:
        problem = f"{name}: the columns are left-handed"
        raise InputError(source, f"{key}.rotation", problem, "the third is s x t")


def _allowance(source: str, entry: CupsFile, name: str) -> float:
    beside, inside = getattr(entry, name), getattr(entry.grid, name)
    if beside is not None and inside is not None:
        problem = "stands here and in grid"
        raise InputError(source, name, problem, "give it once")
    value = inside if beside is None else beside
    return 0.0 if value is None else float(value)


def _name(row: int, column: int) -> str:
    return f"cup (row {row}, column {column})"
