"""Rollout file: every simulation that tuning ran, one row each, as Parquet.

A row is one sample of one trial, or, where `sample` is null, the plan itself without
errors (the only row of a path that no strokes follow: `refused` says why). Margins are
null where nothing threatens. `path.*` are the parameters tried, `mold.*` say what the
mold is like. Rows stand in the order of stage, trial and sample, whoever ran them and
when, and the file is written whole each time: what was there is there, or more.
"""

from __future__ import annotations

import io
import json
import time
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from drapeplan.errors import InputError
from drapeplan.files import write_bytes

FORMAT = "drapeplan-rollouts/1"
STAGES = ("search", "steps", "ranking", "confirmation")
PATIENCE = 20.0  # [-] times that a write takes, to pass before the next
CUPS = pa.list_(pa.list_(pa.int32()))
FIELDS = {
    "stage": pa.string(),
    "trial": pa.int32(),
    "sample": pa.int64(),  # null: the plan itself
    "scene": pa.string(),  # hash of the scene without its path
    "seed": pa.int64(),
    "fidelity": pa.string(),
    "family": pa.string(),
    "toe_up_steps": pa.string(),  # [[step, deg], ...] as JSON; null: none by itself
    "good": pa.bool_(),  # verdict of the plan
    "not_good": pa.list_(pa.string()),  # its criteria that do not hold
    "shortfall": pa.float64(),  # [-] by how much, 0 for a good plan
    "refused": pa.string(),  # why there is no plan
    "refused_at": pa.float64(),  # waypoint at which it ends
    "premature_mm": pa.float64(),
    "air_mm": pa.float64(),
    "margin_mm": pa.float64(),
    "span_press_mm": pa.float64(),
    "pad_press_mm": pa.float64(),
    "stable": pa.bool_(),
    "wrong": pa.bool_(),
    "cause": pa.string(),  # premature, air_pocket, no_rest
    "tightest_step": pa.int32(),
    "tightest_cups": CUPS,  # that land in that step
    "tightest_s_mm": pa.float64(),  # the place on the ply, in material coordinates
    "tightest_t_mm": pa.float64(),
    "plan_hash": pa.string(),
    "version": pa.string(),
}
Row = dict[str, Any]
Values = tuple[float | str | None, ...]
Key = tuple[str, Values, int | None]


class RolloutFile:
    """Rows known so far, and the file that keeps them."""

    def __init__(self, path: Path, made_from: dict[str, Any], names: list[str]) -> None:
        """Begin with no rows.

        Args:
            path: The file.
            made_from: What all rows have in common: scene, seed, versions.
            names: Parameters that are tuned; rows have them under `path.NAME`.
        """
        self.path, self.made_from = path, made_from
        self.names = [*(f"path.{name}" for name in names), "toe_up_steps"]
        self._rows: dict[Key, Row] = {}
        self._written, self._took = -1e9, 0.0

    def resume(self) -> None:
        """Take over the rows of the file.

        Raises:
            InputError: There is no such file, or it was made from something else.
        """
        made_from, table = read_rollouts(self.path)
        for key, value in self.made_from.items():
            if made_from.get(key) != value:
                problem = f"is of another {key}, so its rollouts are others too"
                raise InputError(str(self.path), "", problem, "name another file")
        self._take(table.to_pylist())

    def row(self, stage: str, values: Values, sample: int | None) -> Row | None:
        """A row by what was tried, parameters and `toe_up_steps`, or None."""
        return self._rows.get((stage, values, sample))

    def add(self, rows: list[Row]) -> None:
        """Keep rows, in the file too, unless it was written a moment ago."""
        self._take(rows)
        if time.monotonic() - self._written > PATIENCE * self._took:
            self.write()

    def rows(self) -> list[Row]:
        """All rows in the order of the file."""
        return sorted(self._rows.values(), key=_place)

    def write(self) -> None:
        """Write the file, whole or not at all; without rows there is none.

        Raises:
            InputError: It cannot be written.
        """
        start = time.monotonic()
        rows = self.rows()
        if not rows:
            return
        more = sorted({name for row in rows[:1] for name in row} - set(FIELDS))
        fields = [*FIELDS.items(), *((name, pa.float64()) for name in more)]
        metadata = {"drapeplan": json.dumps({"format": FORMAT, **self.made_from})}
        table = pa.Table.from_pylist(rows, pa.schema(fields, metadata))
        stream = io.BytesIO()
        pq.write_table(table, stream)
        write_bytes(self.path, stream.getvalue())
        self._written = time.monotonic()
        self._took = self._written - start

    def _take(self, rows: list[Row]) -> None:
        for row in rows:
            values = tuple(row[name] for name in self.names)
            self._rows[row["stage"], values, row["sample"]] = row


def read_rollouts(path: Path) -> tuple[dict[str, Any], pa.Table]:
    """What a rollout file was made from, and its rows.

    Raises:
        InputError: It cannot be read, or is no rollout file.
    """
    try:
        table = pq.read_table(path)
        known = json.loads(table.schema.metadata[b"drapeplan"])
    except FileNotFoundError:
        raise InputError(str(path), "", "no such file", "leave --resume out") from None
    except OSError as error:
        raise InputError(str(path), "", f"cannot read it ({error})") from error
    except (pa.ArrowInvalid, KeyError, TypeError, ValueError) as error:
        problem, remedy = "is no rollout file", "name one that tune wrote"
        raise InputError(str(path), "", problem, remedy) from error
    if known.get("format") != FORMAT:
        raise InputError(str(path), "", f"is no {FORMAT} file", "make it anew")
    return known, table


def _place(row: Row) -> tuple[int, int, int]:
    sample = row["sample"]
    return STAGES.index(row["stage"]), row["trial"], -1 if sample is None else sample
