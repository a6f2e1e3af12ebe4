"""Measurements files: what a shop measured of its ply and tool, read and checked.

Format drapeplan-measurements/1, YAML; units in the keys, paths relative to the file.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from drapeplan.cantilever import load_of_drop, load_of_incline, steepest
from drapeplan.cups_file import MM, Cups, read_cups
from drapeplan.errors import InputError
from drapeplan.reading import first_mistake, read_yaml
from drapeplan.scan import Scan, read_scan

Array = NDArray[np.float64]

FEWEST = 3  # repeats of a direction: two show no spread worth the name
LEAST_DROP = 0.02  # [-] of the overhang: below it, reading errors decide

Length = Annotated[float, Field(gt=0, le=2000)]  # [mm]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class StripEntry(_Model):
    """One strip over an edge: how long, and how far its tip hangs or how steep."""

    overhang_mm: Length
    drop_mm: Length | None = None
    incline_deg: Annotated[float, Field(gt=0, lt=90)] | None = None

    @model_validator(mode="after")
    def _one_reading(self) -> StripEntry:
        if (self.drop_mm is None) == (self.incline_deg is None):
            raise ValueError("give either drop_mm or incline_deg")
        return self


Strips = Annotated[tuple[StripEntry, ...], Field(min_length=FEWEST)]


class CantileverEntry(_Model):
    """Strips that hang over an edge, cut along either fiber direction."""

    areal_mass_kg_m2: Annotated[float, Field(gt=0, le=50)]
    areal_mass_sigma_kg_m2: Annotated[float, Field(ge=0, le=50)] = 0.0
    warp: Strips | None = None
    weft: Strips | None = None

    @model_validator(mode="after")
    def _some(self) -> CantileverEntry:
        if self.warp is None and self.weft is None:
            raise ValueError("give warp, weft or both")
        return self


class ScanEntry(_Model):
    """A scan of the held ply, with the poses that the tool recorded."""

    cups: Annotated[str, Field(min_length=1)]
    scan: Annotated[str, Field(min_length=1)]
    unit: Literal["mm", "m"] | None = None


class InterlinkEntry(_Model):
    """Rigid interlinks between neighboring cups."""

    length_mm: Length
    height_mm: Annotated[float, Field(ge=-1000, le=1000)] = 0.0
    sigma_mm: Annotated[float, Field(gt=0, le=10)] = 0.05


class MeasurementsFile(_Model):
    """A measurements file as it is written."""

    format: Literal["drapeplan-measurements/1"]
    cantilever: CantileverEntry | None = None
    scans: tuple[ScanEntry, ...] = ()
    interlinks: InterlinkEntry | None = None

    @model_validator(mode="after")
    def _some(self) -> MeasurementsFile:
        if self.cantilever is None and not self.scans:
            raise ValueError("give cantilever, scans or both")
        return self


@dataclass(frozen=True, eq=False)
class Overhangs:
    """Strips of one fiber direction.

    Attributes:
        length: From clamp to tip along the strip, shape (n,), in [m].
        load: q l^3 / D that the strip shows, shape (n,).
    """

    length: Array
    load: Array


@dataclass(frozen=True, eq=False)
class Cantilever:
    """Strips over an edge.

    Attributes:
        areal_mass: Of the ply, in [kg/m^2].
        areal_mass_sigma: Its standard deviation, in [kg/m^2].
        strips: By fiber direction, "warp" or "weft".
    """

    areal_mass: float
    areal_mass_sigma: float
    strips: dict[str, Overhangs]


@dataclass(frozen=True)
class Links:
    """Rigid interlinks: length, height above the faces, spread of lengths, in [m]."""

    length: float
    height: float
    sigma: float


@dataclass(frozen=True, eq=False)
class Measurements:
    """What was measured, in SI units.

    Attributes:
        cantilever: Strips over an edge, or None.
        scans: Cups as recorded, with the scan of the ply between them.
        links: Rigid interlinks, or None where they are unknown.
        files: All files that were read.
    """

    cantilever: Cantilever | None = None
    scans: tuple[tuple[Cups, Scan], ...] = ()
    links: Links | None = None
    files: tuple[Path, ...] = field(default=())


def read_measurements(path: Path) -> Measurements:
    """Measurements from a YAML file and the cups files and scans that it names.

    Args:
        path: The file.

    Raises:
        InputError: A file is missing or breaks its format, or a number is none that a
            strip or a tool has; the message names file, key and remedy.
    """
    source = str(path)
    try:
        entry = MeasurementsFile.model_validate(read_yaml(path))
    except ValidationError as error:
        found = first_mistake(error, source, _KEYS, ())
        remedy = found.remedy.replace("drapeplan schema lists", _SEE)
        raise InputError(source, found.key, found.problem, remedy) from error
    folder, files, scans = path.parent, [path], []
    for one in entry.scans:
        files += [folder / one.cups, folder / one.scan]
        scans.append((read_cups(files[-2]), read_scan(files[-1], one.unit)))
    links = entry.interlinks
    return Measurements(
        _cantilever(source, entry.cantilever) if entry.cantilever else None,
        tuple(scans),
        Links(*(MM * x for x in (links.length_mm, links.height_mm, links.sigma_mm)))
        if links
        else None,
        tuple(files),
    )


def _cantilever(source: str, entry: CantileverEntry) -> Cantilever:
    strips = {}
    for name, rows in (("warp", entry.warp), ("weft", entry.weft)):
        if rows:
            key = f"cantilever.{name}"
            loads = [_load(source, f"{key}.{n}", row) for n, row in enumerate(rows)]
            length = MM * np.array([row.overhang_mm for row in rows])
            strips[name] = Overhangs(length, np.array(loads))
    return Cantilever(entry.areal_mass_kg_m2, entry.areal_mass_sigma_kg_m2, strips)


def _load(source: str, key: str, row: StripEntry) -> float:
    """Load of one strip, from whichever reading it has."""
    most = steepest()
    if row.incline_deg is not None:
        incline = float(np.radians(row.incline_deg))
        if incline > most.incline:
            problem = f"{row.incline_deg:g} deg is all but upright"
            raise InputError(source, f"{key}.incline_deg", problem, _SHORTER)
        return float(load_of_incline(incline))
    share = (row.drop_mm or 0.0) / row.overhang_mm
    problem = f"{row.drop_mm:g} mm of {row.overhang_mm:g} mm"
    if share > most.drop:
        raise InputError(source, f"{key}.drop_mm", f"{problem} hang down", _SHORTER)
    if share < LEAST_DROP:
        remedy = "let more of it hang over the edge"
        raise InputError(source, f"{key}.drop_mm", f"{problem} tell nothing", remedy)
    return float(load_of_drop(share))


def _all_keys() -> set[str]:
    """Names of all keys, to suggest one for a misspelled key."""
    schema: dict[str, Any] = MeasurementsFile.model_json_schema()
    parts = [schema, *schema["$defs"].values()]
    return {key for part in parts for key in part.get("properties", {})}


_KEYS = sorted(_all_keys())
_SEE = "drapeplan schema measurements lists"
_SHORTER = "let less of it hang over the edge"
