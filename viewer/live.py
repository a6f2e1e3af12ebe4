"""Live view: planning shown as it happens, by a process of its own.

The planner tells that process what it has solved, and nothing comes back: the plan is
the same with and without a view, and hardly later.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from drapeplan.errors import DrapeplanError, InputError
from viewer.live_server import LiveServer

if TYPE_CHECKING:
    from numpy import ndarray as Array

    from drapeplan.cell import Cell
    from drapeplan.path import Path
    from drapeplan.plan import Plan


class Live:
    """The view of one drape, as a context manager; a `planner.Watch`."""

    def __init__(self, port: int = 0) -> None:
        """Take a port of 127.0.0.1, 0 for a free one.

        Raises:
            InputError: The port is taken or not allowed.
        """
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(theirs, port), daemon=True)
        resource_tracker.ensure_running()  # started later, it would unblock SIGINT
        with _deaf():
            self._process.start()
        theirs.close()
        try:
            answer = self._pipe.recv()
        except EOFError as error:
            raise DrapeplanError("the live view could not be started") from error
        if isinstance(answer, str):
            self.close()
            remedy = "name another, or 0 for a free one"
            raise InputError("--port", "", f"cannot use {port} ({answer})", remedy)
        self.port: int = answer
        self.address = f"http://127.0.0.1:{self.port}/"

    def __enter__(self) -> Self:
        """Return the view, which answers already."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop the server and free its port."""
        self.close()

    def stage(self, name: str, share: float) -> None:
        """Tell the stage of planning and its share done, 0 to 1."""
        self._tell("stage", name, share)

    def path(self, cell: Cell, path: Path) -> None:
        """Show what is asked for."""
        self._tell("path", cell.scene, cell.sources, path)

    def waypoint(self, k: int, q: Array) -> None:
        """Show joint positions of a waypoint."""
        self._tell("waypoint", k, q)

    def plan(self, plan: Plan) -> None:
        """Show the preview of the plan."""
        self._tell("plan", plan.document)

    def failed(self, text: str) -> None:
        """Say why there is no plan."""
        self._tell("failed", text)

    def _tell(self, *message: Any) -> None:
        with contextlib.suppress(OSError):  # a view that is gone stops no planner
            self._pipe.send(message)

    def wait(self) -> None:
        """Wait until the view ends, which it does not by itself."""
        self._process.join()

    def close(self) -> None:
        """Stop the server at once, whatever it is asked for, and wait for its end."""
        self._pipe.close()
        self._process.terminate()
        self._process.join()


@contextlib.contextmanager
def _deaf() -> Iterator[None]:
    """Ctrl-C waits; a process that is started here never hears it."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def serve(pipe: Connection, port: int) -> None:
    """Serve the live page until the planner's end of the pipe closes.

    Args:
        pipe: Gets the port, or why it cannot be used; then messages for News come.
        port: Port of 127.0.0.1, 0 for a free one.
    """
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        server = LiveServer(port)
    except OSError as error:
        pipe.send(error.strerror)
        return
    pipe.send(server.server_port)
    from viewer.live_news import News  # takes seconds: who asks now waits for them

    news = server.news = News()

    def tell(name: str, *values: Any) -> None:
        try:
            getattr(news, name)(*values)
        except Exception as error:
            news.failed(f"This cannot be shown: {error}")

    answering = threading.Thread(target=server.serve_forever)
    answering.start()
    with ThreadPoolExecutor(1) as teller, contextlib.suppress(EOFError, OSError):
        while True:  # the pipe is emptied at once: the planner never waits
            teller.submit(tell, *pipe.recv())
    server.shutdown()
    answering.join()
    server.server_close()
