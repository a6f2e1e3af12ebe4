"""What `drapeplan preview` does."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from drapeplan.errors import InputError
from drapeplan.files import check_outputs, write_bytes
from drapeplan.plan import Plan, document_hash

if TYPE_CHECKING:
    from viewer.plan_view import PlanView

SIDE_BY_SIDE = 2  # plans
LEAST, MOST = 200, 8000  # [px] of a picture's sides
SIZE = "1280x720"
ALTERED = "drapeplan check says what was altered"


@dataclass(frozen=True)
class Wanted:
    """What the command line asks for.

    Attributes:
        output: HTML file to write; a picture, where `png` is given, and with more than
            one moment each is put into its name; the plan, with `live`.
        show: Whether to open it in a browser; None leaves it to the kind.
        png: Moments of pictures: wave steps, or poses as pose=K, with commas between.
        view: Camera preset of pictures.
        size: Size of pictures, such as 1280x720, in pixels.
        live: Whether to plan a scene and show it as it happens.
        port: Of the live view, 0 for a free one, the default.
        as_json: One JSON document instead of lines.
    """

    output: Path | None
    show: bool | None = None
    png: str | None = None
    view: str | None = None
    size: str | None = None
    live: bool = False
    port: int | None = None
    as_json: bool = False


def preview_command(files: Sequence[Path], wanted: Wanted) -> int:
    """Write the preview of a plan or of two side by side, or pictures, or go live.

    Args:
        files: One plan or two; one scene, to be shown live.
        wanted: What of it.

    Raises:
        InputError: A file or an option is not right, or there is no browser.
    """
    _check(files, wanted)
    if wanted.live:
        from drapeplan.commands_live import live_command

        show = wanted.show is not False
        return live_command(files[0], wanted.output, wanted.port or 0, show)
    if wanted.output is None:
        raise InputError("--output", "", "is missing", "add -o FILE")
    if wanted.png is not None:
        return _pictures(files, wanted.output, wanted.png, wanted)
    return _page(files, wanted.output, wanted)


def _check(files: Sequence[Path], wanted: Wanted) -> None:
    """Refuse what does not go together."""
    pictured = (wanted.view, wanted.size) != (None, None)
    if wanted.png is None and pictured:
        problem = "--view and --size say nothing without it"
        raise InputError("--png", "", problem, "add --png STEP")
    if wanted.live and (wanted.png is not None or wanted.as_json or len(files) > 1):
        problem = "goes with one scene, without --png and --json"
        raise InputError("--live", "", problem, "leave them out")
    if not wanted.live and wanted.port is not None:
        raise InputError("--port", "", "says nothing without --live", "add --live")
    if len(files) > SIDE_BY_SIDE:
        problem = f"{len(files)} plans are too many to compare"
        raise InputError(str(files[SIDE_BY_SIDE]), "", problem, "name two")


def _page(files: Sequence[Path], output: Path, wanted: Wanted) -> int:
    """Write the page."""
    from viewer.page import export

    check_outputs([output], list(files))
    facts = export(_views(files), output)
    _say([output], facts, wanted.as_json)
    if wanted.show:
        import webbrowser

        webbrowser.open(output.resolve().as_uri())
    return 0


def _pictures(files: Sequence[Path], output: Path, png: str, wanted: Wanted) -> int:
    """Write pictures of the page, through an installed Chromium."""
    from viewer.chromium import find_browser
    from viewer.picture import check_camera, moment_of, pictures

    find_browser()
    check_camera(wanted.view)
    size, names = _size(wanted.size or SIZE), [one.strip() for one in png.split(",")]
    several = len(names) > 1
    outputs = [_named(output, name) if several else output for name in names]
    check_outputs(outputs, list(files))
    views = _views(files)
    places = [moment_of(views, name) for name in names]
    taken = pictures(views, places, wanted.view, size)
    for file, picture in zip(outputs, taken, strict=True):
        write_bytes(file, picture)
    _say(outputs, {"width": size[0], "height": size[1]}, wanted.as_json)
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

    views = []
    for file in plan_files:
        plan = Plan.read(file)
        try:
            if document_hash(plan.document) != plan.document["hash"]:
                raise InputError(str(file), "hash", "does not fit the content", ALTERED)
            views.append(view_of(plan))
        except (LookupError, TypeError, ValueError, ArithmeticError) as error:
            problem = f"its parts do not fit together ({error})"
            raise InputError(str(file), "", problem, ALTERED) from error
    return views


def _say(files: list[Path], facts: Mapping[str, object], as_json: bool) -> None:
    """Name the files written."""
    written = [str(file) for file in files]
    if as_json:
        print(json.dumps({"good": True, "written": written, **facts}))
    else:
        print(*(f"wrote {name}" for name in written), sep="\n")
