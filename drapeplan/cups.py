"""The ply between measured cups: its shape as a table, its fibers as a report."""

import csv
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drapeplan.cups_file import MM, Cups, read_cups
from drapeplan.errors import InputError
from drapeplan.files import write_text
from drapeplan.shape_models import Held, effect_facts, hold
from ply.errors import PlyError
from ply.fiber import FiberStatus, LengthStatus, bubble_height
from ply.grid import EDGE
from ply.shape import PlyFibers, PlySampling

__all__ = ["Cups", "read_cups", "shape_report", "shape_table", "write_csv"]

Array = NDArray[np.float64]

POINTS_HEADER = ("s_mm", "t_mm")
HEADER = (*POINTS_HEADER, "x_mm", "y_mm", "z_mm")
STEP = 0.01  # [m] between the lines of the regular grid
SOUND = (FiberStatus.MET, FiberStatus.NOT_ASKED)
FAULTS = {
    FiberStatus.COINCIDENT: "the edges of its cups meet",
    FiberStatus.INVERTED: "a cup faces away, or its neighbor lies behind it",
    FiberStatus.SKEWED: "a cup's rotation is off by more than 0.001",
}


def shape_table(
    cups: Cups,
    model: str = "quartic",
    points_path: str | Path | None = None,
    step: float = STEP,
) -> Array:
    """Where material points of the ply are.

    Args:
        cups: The cups that hold the ply. With a take-up, fibers have their natural
            length inside its band.
        model: One of `drapeplan.shape_models.MODELS`.
        points_path: CSV file of material points with the columns s_mm and t_mm, or None
            for a regular grid over cups, spans and overhang, t in the outer loop.
        step: Distance between the lines of the regular grid, in [m].

    Returns:
        Rows s, t, x, y, z in the order of the points, shape (n, 5), in [mm].

    Raises:
        InputError: The model does not exist, the points file is unreadable or asks for
            points off the ply, or the step does not divide cups and spans.
    """
    return table_of(hold(cups, model)[0], points_path, step)


def table_of(held: Held, points_path: str | Path | None, step: float = STEP) -> Array:
    """Where material points of a held ply are, as for `shape_table`."""
    grid = held.cups.grid
    if points_path is not None:
        rows = _read_points(held.cups, str(points_path))
        return np.column_stack([rows, held.points(*(MM * rows).T) / MM])
    try:
        sampling = PlySampling.regular(grid, step, held.cups.overhang or 0.0)
    except PlyError as error:
        raise InputError("--step-mm", "", error.problem, error.remedy) from None
    st = sampling.points_st.reshape(-1, 2)
    return np.column_stack([st, held.points(*st.T)]) / MM


def shape_report(cups: Cups, model: str = "quartic") -> dict[str, Any]:
    """What became of the length of each fiber.

    Args:
        cups: The cups that hold the ply.
        model: One of `drapeplan.shape_models.MODELS`.

    Returns:
        The model, the number of fibers, counts by FiberStatus and (with a take-up) by
        LengthStatus, and the list of failing fibers: name, status, excess_mm (length
        that is missing, negative where it is slack) and a sentence; the effects that a
        model may leave out, with estimate, tolerance and what became of them; for a
        ladder, the rungs in words.

    Raises:
        InputError: The model does not exist.
    """
    return report_of(hold(cups, model)[0], model)


def report_of(held: Held, model: str) -> dict[str, Any]:
    """What became of the fibers of a held ply, as for `shape_report`."""
    cups, fibers = held.cups, held.fibers
    status = np.concatenate([fibers.s_status.ravel(), fibers.t_status.ravel()])
    band = np.concatenate([fibers.s_band.ravel(), fibers.t_band.ravel()])
    report: dict[str, Any] = {
        "model": model,
        "fibers": int(status.size),
        "status": {
            kind.name.lower(): int((status == kind).sum()) for kind in FiberStatus
        },
    }
    if cups.take_up > 0:
        report["take_up_mm"] = cups.take_up / MM
        report["length"] = {
            kind.name.lower(): int((band == kind).sum()) for kind in LengthStatus
        }
    if held.rungs:
        report["rungs"] = held.rungs
    report["effects"] = [effect_facts(one) for one in held.effects]
    return report | {"failing": list(_failing(cups, fibers))}


def write_csv(path: str | Path, rows: Array) -> None:
    """Write a shape table; the file appears whole or not at all.

    Args:
        path: The file; an existing one is replaced.
        rows: Rows s, t, x, y, z, shape (n, 5), in [mm].

    Raises:
        InputError: The file cannot be written.
    """
    content = io.StringIO()
    content.write(",".join(HEADER) + "\n")
    np.savetxt(content, rows, fmt="%.6f", delimiter=",")
    write_text(Path(path), content.getvalue())


def _read_points(cups: Cups, source: str) -> Array:
    """Material coordinates (s, t), shape (n, 2), in [mm]."""
    try:
        with open(source, encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file, skipinitialspace=True)
            missing = [
                key for key in POINTS_HEADER if key not in (reader.fieldnames or ())
            ]
            if missing:
                problem = f"no column {missing[0]} in the header"
                raise InputError(source, "", problem, "begin with s_mm,t_mm")
            rows = [_point(source, reader.line_num, row) for row in reader]
    except OSError as error:
        problem = f"cannot be read ({error.strerror})"
        raise InputError(source, "", problem, "check the path") from None
    except (UnicodeDecodeError, csv.Error):
        raise InputError(source, "", "is no CSV file", "begin with s_mm,t_mm") from None
    if not rows:
        raise InputError(source, "", "no points", "add a row under the header")
    _check_on_ply(cups, source, np.array(rows))
    return np.array(rows)


def _point(source: str, line: int, row: dict[str, str | None]) -> tuple[float, float]:
    try:
        s, t = (float(row[key] or "") for key in POINTS_HEADER)
    except ValueError:
        raise InputError(
            source, f"line {line}", "is not two numbers", "write s_mm,t_mm"
        ) from None
    return s, t


def _check_on_ply(cups: Cups, source: str, rows: Array) -> None:
    """Ply ends with its overhang; unknown, it means nothing beyond one pitch out."""
    grid = cups.grid
    far, remedy = grid.pitch - EDGE, "stay within one pitch of the outer cups' centers"
    if cups.overhang is not None:
        far = grid.half_width + cups.overhang + EDGE
        remedy = f"stay within {far / MM:g} mm of the outer cups' centers"
    last = (np.array([grid.columns, grid.rows]) - 1) * grid.pitch
    off = ~((rows >= -far / MM) & (rows <= (last + far) / MM)).all(axis=1)
    if off.any():
        n = int(np.flatnonzero(off)[0])
        problem = f"point {n + 1} at ({rows[n, 0]:g}, {rows[n, 1]:g}) mm is off the ply"
        raise InputError(source, "", problem, remedy)


def _failing(cups: Cups, fibers: PlyFibers) -> Iterator[dict[str, Any]]:
    half = cups.grid.half_width / MM
    families = [
        ("s", fibers.s, fibers.s_status, fibers.s_band, fibers.s_natural),
        ("t", fibers.t, fibers.t_status, fibers.t_band, fibers.t_natural),
    ]
    for family, curves, statuses, bands, naturals in families:
        length = cups.grid.s_length if family == "s" else cups.grid.t_length
        failing = ~np.isin(statuses, SOUND)
        if cups.take_up > 0:
            failing |= bands != LengthStatus.IN_BAND
        for place in zip(*(axis.tolist() for axis in np.nonzero(failing)), strict=True):
            i, j, side = place
            cells = f"row {i}, columns {j}-{j + 1}"
            if family == "t":
                cells = f"column {j}, rows {i}-{i + 1}"
            lateral = (2 * side / (statuses.shape[-1] - 1) - 1) * half
            name = f"{family} fiber ({cells}), lateral {lateral:+g} mm"
            chord = float(np.linalg.norm(curves[place][1:].sum(axis=0)))
            status = FiberStatus(statuses[place])
            label, excess, words = _verdict(
                status, length, chord, float(naturals[place]), cups.take_up
            )
            if status in FAULTS:
                label, words = status.name.lower(), FAULTS[status]
            yield {
                "fiber": name,
                "status": label,
                "excess_mm": excess / MM,
                "text": f"{name}: {words}",
            }


def _verdict(
    status: FiberStatus, length: float, chord: float, natural: float, take_up: float
) -> tuple[str, float, str]:
    """Label, excess in [m] and words for one failing fiber."""
    excess = natural - length
    if status == FiberStatus.OVERSTRETCHED:
        words = (
            f"overstretched: its ends are {(chord - length) / MM:.2g} mm further apart"
        )
        return "overstretched", chord - length, words + " than its length"
    surplus = -excess - take_up  # what the weave cannot take up bows out
    bow = f"bows up to {float(bubble_height(surplus, length)) / MM:.2g} mm"
    if take_up > 0:
        words = f"needs {excess / MM:.2g} mm, more than its take-up"
        if excess < 0:
            words = f"{-excess / MM:.2g} mm of slack, more than its take-up: {bow}"
        return ("too_short" if excess > 0 else "slack"), excess, words
    if status in (FiberStatus.TOO_LONG, FiberStatus.TAUT):
        return status.name.lower(), excess, f"too long by {excess / MM:.2g} mm"
    words = f"{-excess / MM:.2g} mm of slack: {bow}, to a side that "
    if status == FiberStatus.NO_DIRECTION:
        return "no_direction", excess, words + "parallel cups leave open"
    return "weak_direction", excess, words + "nearly parallel cups decide"
