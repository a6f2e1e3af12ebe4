"""Scans: point clouds of a held ply, from CSV, XYZ or PLY files."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from drapeplan.errors import InputError
from drapeplan.files import read_text

Array = NDArray[np.float64]

UNITS = {"mm": 1e-3, "m": 1.0}  # [m]
HEADER = ("x_mm", "y_mm", "z_mm")
LEAST = 50  # points: less is no surface between two cups
SEPARATORS = str.maketrans(",;", "  ")


@dataclass(frozen=True, eq=False)
class Scan:
    """A point cloud.

    Attributes:
        points: Points, shape (n, 3), in [m].
        source: The file that was read.
    """

    points: Array
    source: str = ""


def read_scan(path: str | Path, unit: str | None = None) -> Scan:
    """Read a point cloud.

    CSV files begin with a header that holds x_mm, y_mm and z_mm; XYZ files hold three
    or more numbers a line, of which the first three count, and comments after #; of PLY
    files the vertices count.

    Args:
        path: The file; its ending tells the format.
        unit: Unit of the coordinates of XYZ and PLY files, "mm" or "m"; None: mm.

    Returns:
        The scan.

    Raises:
        InputError: The file is missing, of no known format, empty, not finite, or holds
            too few points.
    """
    source, ending = str(path), Path(path).suffix.lower()
    if unit is not None and unit not in UNITS:
        problem = f"there is no unit {unit!r}"
        raise InputError("--unit", "", problem, f"choose from {', '.join(UNITS)}")
    readers = {
        ".csv": _read_csv,
        ".xyz": _read_xyz,
        ".txt": _read_xyz,
        ".ply": _read_ply,
    }
    if ending not in readers:
        problem = f"unknown point cloud format {ending or Path(path).name!r}"
        raise InputError(source, "", problem, "use CSV, XYZ or PLY")
    if unit == "m" and ending == ".csv":
        problem = "the header of a CSV file says mm"
        raise InputError("--unit", "", problem, "leave the option out")
    points = readers[ending](source)
    _check(source, points)
    return Scan(points * UNITS[unit or "mm"], source)


def _check(source: str, points: Array) -> None:
    if not len(points):
        raise InputError(source, "", "holds no points", "export the scan again")
    bad = ~np.isfinite(points).all(axis=1)
    if bad.any():
        problem = (
            f"{bad.sum()} of {len(points)} points are not finite (NaN or infinite)"
        )
        problem += f", the first is point {int(np.argmax(bad)) + 1}"
        remedy = "leave out what the sensor did not see"
        raise InputError(source, "", problem, remedy)
    if len(points) < LEAST:
        problem = f"{len(points)} points are too few for a surface"
        raise InputError(source, "", problem, f"give {LEAST} or more")


def _read_csv(source: str) -> Array:
    lines = read_text(source, "export it as text").splitlines()
    names = [name.strip() for name in lines[0].split(",")] if lines else []
    missing = [name for name in HEADER if name not in names]
    if missing:
        problem = f"no column {missing[0]} in the header"
        raise InputError(source, "line 1", problem, f"begin with {','.join(HEADER)}")
    columns = [names.index(name) for name in HEADER]
    rows = [(n, line.split(",")) for n, line in enumerate(lines[1:], 2) if line.strip()]
    return _numbers(source, [(n, [row[k : k + 1] for k in columns]) for n, row in rows])


def _read_xyz(source: str) -> Array:
    rows = []
    for n, line in enumerate(read_text(source, "export it as text").splitlines(), 1):
        words = line.split("#")[0].translate(SEPARATORS).split()
        if words:
            rows.append((n, [words[k : k + 1] for k in range(3)]))
    return _numbers(source, rows)


def _numbers(source: str, rows: list[tuple[int, list[list[str]]]]) -> Array:
    """Rows of three words, each in a list that is empty where one is missing."""
    points = np.empty((len(rows), 3))
    for k, (line, words) in enumerate(rows):
        try:
            points[k] = [float(word) for (word,) in words]
        except ValueError:
            problem, remedy = "is not three numbers", "write x, y and z"
            raise InputError(source, f"line {line}", problem, remedy) from None
    return points


def _read_ply(source: str) -> Array:
    if not Path(source).is_file():
        raise InputError(source, "", "no such file", "check the path")
    try:
        found = trimesh.load(source, file_type="ply", process=False)
        return np.asarray(found.vertices, dtype=float).reshape(-1, 3)
    except Exception as error:  # trimesh's readers raise whatever they stumble on
        problem = "the content cannot be read as PLY"
        raise InputError(source, "", problem, "export it again") from error
