"""What `drapeplan preview --live` does: plan a scene and show it as it happens."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from typing import Any

from drapeplan.commands_plan import inputs_of, planned, say_nothing_written
from drapeplan.console import say_error, show_progress, show_verdict
from drapeplan.errors import DrapeplanError
from drapeplan.files import check_outputs
from drapeplan.planner import Progress
from drapeplan.scene import read_scene

ENDS = (signal.SIGINT, signal.SIGTERM)
STOPPED = 130  # exit code of what Ctrl-C ends


def live_command(scene: Path, output: Path | None, port: int, show: bool) -> int:
    """Plan a scene, shown at an address of this machine until it is stopped.

    Args:
        scene: Scene file.
        output: Plan file to write, or None.
        port: Port of 127.0.0.1; 0 for a free one.
        show: Whether to open the address in a browser.

    Returns:
        Exit code of the plan; where planning was stopped 0, or 130 where a plan was to
        be written.

    Raises:
        InputError: A file or an option is not right.
    """
    from viewer.live import Live

    read = read_scene(scene)
    if output:
        check_outputs([output], inputs_of(read, scene))
    code = STOPPED if output else 0
    with _stopped() as asked, Live(port) as live:
        print(f"live at {live.address} (Ctrl-C stops)", flush=True)
        if show:
            import webbrowser

            webbrowser.open(live.address)
        try:
            with show_progress(False) as progress:
                told = _both(progress, live, asked)
                _, plan, lines = planned(read, scene, output, told, live)
        except DrapeplanError as error:
            code = error.exit_code
            live.failed(str(error))
            say_error(error, as_json=False)
        else:
            live.plan(plan)
            if output:
                plan.write(output)
            code = 0 if plan.verdict["good"] else 1
            show_verdict(plan.verdict, lines, False, written=[output] if output else [])
        if not asked.is_set():
            live.wait()
    if code == STOPPED:
        say_nothing_written(output)
    return code


def _both(progress: Progress | None, live: Any, asked: Event) -> Progress:
    """Progress for the terminal and for the page, until somebody asked to stop."""

    def told(stage: str, share: float) -> None:
        if asked.is_set():
            raise KeyboardInterrupt
        live.stage(stage, share)
        if progress:
            progress(stage, share)

    return told


@contextmanager
def _stopped() -> Iterator[Event]:
    """Ctrl-C and the signal to terminate end what is inside, and are no failure.

    The event is set then: compilers that call back lose what is raised in them.
    """
    asked, hook = Event(), sys.unraisablehook

    def stop(*_: object) -> None:
        asked.set()
        raise KeyboardInterrupt

    def lost(what: Any) -> None:
        if what.exc_type is not KeyboardInterrupt:
            hook(what)

    before = {kind: signal.signal(kind, stop) for kind in ENDS}
    sys.unraisablehook = lost
    try:
        yield asked
    except KeyboardInterrupt:
        pass
    finally:
        sys.unraisablehook = hook
        for kind, handler in before.items():
            signal.signal(kind, handler)
