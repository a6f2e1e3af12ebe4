"""What `drapeplan preview` does."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from drapeplan.errors import InputError
from drapeplan.files import check_outputs, write_bytes
from drapeplan.plan import Plan

if TYPE_CHECKING:
    from viewer.plan_view import PlanView

SIDE_BY_SIDE = 2  # plans
LEAST, MOST = 200, 8000  # [px] of a picture's sides


def preview_command(
    plan_files: Sequence[Path], output: Path, show: bool, as_json: bool
) -> int:
    """Write the preview of a plan, or of two side by side.

    Args:
        plan_files: One plan or two.
        output: HTML file to write.
        show: Whether to open it in a browser.
        as_json: One JSON document instead of lines.

    Raises:
        InputError: A file or an option is not right.
    """
    from viewer.page import export

    check_outputs([output], list(plan_files))
    facts = export(_views(plan_files), output)
    _say([output], facts, as_json)
    if show:
        import webbrowser

        webbrowser.open(output.resolve().as_uri())
    return 0


def picture_command(
    plan_files: Sequence[Path],
    output: Path,
    moments: str,
    camera: str | None,
    size: str,
    as_json: bool,
) -> int:
    """Write pictures of a plan through an installed Chromium.

    Args:
        plan_files: One plan or two.
        output: PNG to write; with more than one moment each is put into the name.
        moments: Wave steps, or poses as pose=K, with commas between them.
        camera: Name of a camera preset, or None.
        size: Such as 1280x720, in pixels.
        as_json: One JSON document instead of lines.

    Raises:
        InputError: A file or an option is not right, or there is no browser.
    """
    from viewer.chromium import find_browser
    from viewer.picture import check_camera, moment_of, pictures

    find_browser()
    check_camera(camera)
    pixels, names = _size(size), [moment.strip() for moment in moments.split(",")]
    files = [output] if len(names) == 1 else [_named(output, name) for name in names]
    check_outputs(files, list(plan_files))
    views = _views(plan_files)
    places = [moment_of(views, name) for name in names]
    taken = pictures(views, places, camera, pixels)
    for file, picture in zip(files, taken, strict=True):
        write_bytes(file, picture)
    _say(files, {"width": pixels[0], "height": pixels[1]}, as_json)
    return 0


def _size(text: str) -> tuple[int, int]:
    """Width and height of a picture, in pixels."""
    found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    if not found or not all(LEAST <= int(side) <= MOST for side in found.groups()):
        remedy = f"such as 1280x720, each side {LEAST} to {MOST}"
        raise InputError("--size", "", f"{text!r} is no size", remedy)
    return int(found[1]), int(found[2])


def _named(output: Path, moment: str) -> Path:
    """Name of one of several pictures."""
    return output.with_name(f"{output.stem}-{moment.replace('=', '-')}{output.suffix}")


def _views(plan_files: Sequence[Path]) -> list[PlanView]:
    """What is shown of each plan."""
    from viewer.scene import view_of

    if len(plan_files) > SIDE_BY_SIDE:
        problem = f"{len(plan_files)} plans are too many to compare"
        raise InputError(str(plan_files[SIDE_BY_SIDE]), "", problem, "name two")
    views = []
    for file in plan_files:
        plan = Plan.read(file)
        try:
            views.append(view_of(plan))
        except (LookupError, TypeError, ValueError, ArithmeticError) as error:
            problem = f"its parts do not fit together ({error})"
            remedy = "drapeplan check says what was altered"
            raise InputError(str(file), "", problem, remedy) from error
    return views


def _say(files: list[Path], facts: Mapping[str, object], as_json: bool) -> None:
    """Name the files written."""
    written = [str(file) for file in files]
    if as_json:
        print(json.dumps({"good": True, "written": written, **facts}))
    else:
        print(*(f"wrote {name}" for name in written), sep="\n")
