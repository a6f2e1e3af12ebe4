"""What `drapeplan shape` does."""

import json
from pathlib import Path

from drapeplan.cups import read_cups, report_of, table_of, write_csv
from drapeplan.errors import InputError
from drapeplan.files import check_outputs
from drapeplan.shape_models import estimate_lines, hold

MOST = 16  # alternatives that may be asked for


def shape_command(
    cups_file: Path,
    output: Path,
    model: str,
    points: Path | None,
    step: float,
    alternatives: int,
    tolerance: float,
    as_json: bool,
) -> int:
    """Write the shape of a held ply and say what became of its fibers.

    Args:
        cups_file: Cups file.
        output: CSV file to write; alternatives stand beside it.
        model: Name of the model.
        points: CSV file of material points, or None.
        step: Step of the regular grid, in [m].
        alternatives: Most further shapes to write.
        tolerance: What "auto" may lose, in [m].
        as_json: One JSON document instead of lines.

    Returns:
        The exit code: 1 where a fiber misses its length.

    Raises:
        InputError: A file or an option is not right.
    """
    if not 0 <= alternatives <= MOST:
        problem = f"{alternatives} further shapes"
        raise InputError("--alternatives", "", problem, f"use 0 to {MOST}")
    files = [output]
    files += [
        output.with_name(f"{output.stem}.alt{n}{output.suffix}")
        for n in range(1, alternatives + 1)
    ]
    check_outputs(files, [cups_file, points] if points else [cups_file])
    cups = read_cups(cups_file)
    shapes = hold(cups, model, 1 + alternatives, tolerance)
    written = files[: len(shapes)]
    for held, path in zip(shapes, written, strict=True):
        rows = table_of(held, points, step)
        write_csv(path, rows)
    report, estimates = report_of(shapes[0], model), estimate_lines(cups)
    good = not report["failing"]
    if as_json:
        facts = {"good": good, "written": [str(path) for path in written], **report}
        print(json.dumps(facts | {"estimates": estimates}))
        return 0 if good else 1
    print(f"wrote {output}: {len(rows)} points, model {model}")
    for path in written[1:]:
        print(f"wrote {path}: another shape")
    for line in [*shapes[0].words, *estimates, *(f["text"] for f in report["failing"])]:
        print(f"  {line}")
    return 0 if good else 1
