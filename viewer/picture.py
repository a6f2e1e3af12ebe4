"""Pictures of a drape, taken of its preview by an installed Chromium."""

from __future__ import annotations

import base64
import json
import tempfile
from collections.abc import Iterator, Sequence
from importlib import resources
from pathlib import Path

from drapeplan.errors import DrapeplanError, InputError
from viewer.chromium import Chromium
from viewer.moments import moments
from viewer.page import VIEWS, render
from viewer.plan_view import PlanView


def moment_of(views: Sequence[PlanView], text: str) -> int:
    """Index of a moment on the time line of a preview.

    Args:
        views: The drape, or two side by side.
        text: Number of a wave step, at whose end the moment is, 0 for the start cup's;
            or pose=K, counted from 1.

    Raises:
        InputError: If there is no such moment.
    """
    key, _, number = text.rpartition("=")
    if key not in ("", "pose") or not number.isdecimal():
        remedy = "name wave steps or poses, such as 3 or pose=40"
        raise InputError("--png", "", f"{text!r} is no moment", remedy)
    steps = [each.step for each in moments(views)]
    known = {step: k for k, step in enumerate(steps) if step >= 0}
    if key == "pose":
        known = {k + 1: k for k in range(len(steps))}
    if int(number) not in known:
        remedy = f"there are {min(known)} to {max(known)}" if known else "there is none"
        raise InputError("--png", "", f"there is no {text}", remedy)
    return known[int(number)]


def check_camera(name: str | None) -> None:
    """Refuse the name of a camera preset that does not exist.

    Raises:
        InputError: There is none of that name.
    """
    names = [preset for preset, *_ in VIEWS]
    if name is not None and name not in names:
        raise InputError("--view", "", f"no view is called {name!r}", ", ".join(names))


def pictures(
    views: Sequence[PlanView],
    places: Sequence[int],
    camera: str | None,
    size: tuple[int, int],
) -> Iterator[bytes]:
    """Pictures of a preview, without its controls.

    The page says when it is ready, and each picture waits until it is drawn. Drawing is
    by software with shadows, so the same plan gives the same picture on any machine
    with the same browser and fonts.

    Args:
        views: The drape, or two side by side.
        places: Moments on the time line, of `moment_of`.
        camera: Name of a camera preset; None for the one the page opens with.
        size: Width and height, in pixels.

    Yields:
        PNG files, in the order of the places.

    Raises:
        InputError: If no browser is installed.
        DrapeplanError: If the browser fails.
    """
    css, script = (
        resources.files("viewer").joinpath(name).read_text(encoding="utf-8")
        for name in ("picture.css", "picture.js")
    )
    with (
        tempfile.TemporaryDirectory(prefix="drapeplan-") as folder,
        Chromium(size) as browser,
    ):
        page = Path(folder) / "preview.html"
        page.write_text(render(views), encoding="utf-8")
        browser.ask("Page.navigate", url=page.as_uri())
        browser.run(script)
        if browser.run("whenReady()") != "yes":
            said = browser.run("document.querySelector('[role=alert]').textContent")
            raise DrapeplanError(f"no picture: {said}")
        browser.run(f"prepare({json.dumps(css)})")
        for place in places:
            browser.run(f"visit({place}, {json.dumps(camera)})")
            taken = browser.ask("Page.captureScreenshot", format="png")
            yield base64.b64decode(taken["data"])
