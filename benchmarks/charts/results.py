"""What a chart measured: rows of figures, and what they were measured with."""

import csv
import io
import json
import os
import platform
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from drapeplan.files import write_text

DIGITS = 6  # [-] of a figure in the files
ALWAYS = ("numpy", "scipy", "numba")  # packages that all figures depend on
Value = str | float | int | bool | None


@dataclass(frozen=True)
class Results:
    """Rows of one chart, one for each point that was measured.

    Attributes:
        chart: Name of the chart.
        rows: Columns by name; units are part of the names.
        missing: What could not be measured, by name, and why.
        made: Processor, versions, date, seed and whether the run was a quick one.
    """

    chart: str
    rows: list[dict[str, Value]]
    made: dict[str, Value]
    missing: dict[str, str] = field(default_factory=dict)

    def write(self, stem: Path) -> list[Path]:
        """Write rows as CSV and everything as JSON; returns the files."""
        rows = [{k: _rounded(v) for k, v in row.items()} for row in self.rows]
        columns = list(dict.fromkeys(key for row in rows for key in row))
        text = io.StringIO()
        writer = csv.DictWriter(text, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        document = asdict(self) | {"rows": rows}
        files = [stem.with_suffix(".csv"), stem.with_suffix(".json")]
        write_text(files[0], text.getvalue())
        write_text(files[1], json.dumps(document, indent=1, allow_nan=False) + "\n")
        return files

    def where(self, **columns: Value) -> list[dict[str, Value]]:
        """Rows with these values in these columns."""
        return [
            row
            for row in self.rows
            if all(row.get(name) == value for name, value in columns.items())
        ]


def read(stem: Path) -> Results:
    """What was written last."""
    return Results(**json.loads(stem.with_suffix(".json").read_text(encoding="utf-8")))


def made_with(*packages: str, seed: int = 0, quick: bool) -> dict[str, Value]:
    """Where and when figures are made, with versions of packages beyond numpy."""
    versions = {name: found for name in (*ALWAYS, *packages) if (found := _of(name))}
    return {
        "processor": processor(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 1),
        "python": platform.python_version(),
        "versions": ", ".join(f"{name} {found}" for name, found in versions.items()),
        "date": datetime.now(UTC).date().isoformat(),
        "seed": seed,
        "quick": quick,
    }


def processor() -> str:
    """Model of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    found = [line.split(":", 1)[1].strip() for line in lines if "model name" in line]
    return (found or [platform.processor() or platform.machine()])[0]


def _of(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _rounded(value: Value) -> Value:
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value
