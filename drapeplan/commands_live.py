"""What `drapeplan preview --live` does: plan a scene and show it as it happens."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from drapeplan.commands_plan import inputs_of, naming
from drapeplan.console import say_error, show_progress, show_verdict
from drapeplan.errors import DrapeplanError
from drapeplan.files import check_outputs
from drapeplan.planner import Progress, make_plan
from drapeplan.ranking import searched
from drapeplan.scene import read_scene
from drapeplan.words import summary


def live_command(scene: Path, output: Path | None, port: int, show: bool) -> int:
    """Plan a scene, shown at an address of this machine until it is stopped.

    Args:
        scene: Scene file.
        output: Plan file to write, or None.
        port: Port of 127.0.0.1; 0 for a free one.
        show: Whether to open the address in a browser.

    Returns:
        Exit code of the plan; 0 where planning was stopped.

    Raises:
        InputError: A file or an option is not right.
    """
    from viewer.live import Live

    read = read_scene(scene)
    if output:
        check_outputs([output], inputs_of(read, scene))
    code = 0
    with _stopped(), Live(port) as live:
        print(f"live at {live.address} (Ctrl-C stops)", flush=True)
        if show:
            import webbrowser

            webbrowser.open(live.address)
        try:
            with naming(scene), show_progress(False) as progress:
                told = _both(progress, live)
                place = scene.parent, str(scene)
                read, _ = searched(read, *place, told)
                outcome = make_plan(read, *place, told, live)
        except DrapeplanError as error:
            code = error.exit_code
            live.failed(str(error))
            say_error(error, as_json=False)
        else:
            plan = outcome.plan
            live.plan(plan)
            if output:
                plan.write(output)
            front, lag = outcome.contact.front, plan.document["kinematic_lag"]
            lines = summary(plan.verdict, front, plan.track, lag)
            show_verdict(plan.verdict, lines, False, written=[output] if output else [])
            code = 0 if plan.verdict["good"] else 1
        live.wait()
    return code


def _both(progress: Progress | None, live: Any) -> Progress:
    """Progress for the terminal and for the page."""

    def told(stage: str, share: float) -> None:
        live.stage(stage, share)
        if progress:
            progress(stage, share)

    return told


@contextmanager
def _stopped() -> Iterator[None]:
    """Ctrl-C and the signal to terminate end what is inside, and are no failure."""

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    except KeyboardInterrupt:
        pass
    finally:
        signal.signal(signal.SIGTERM, before)
