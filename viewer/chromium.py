"""An installed Chromium without a window, asked through a pipe.

It is started with its DevTools protocol on two pipes, so nothing listens on any port: a
message is JSON that ends with a zero byte. The profile is a folder of its own, which is
removed with it.
"""

from __future__ import annotations

import fcntl
import json
import os
import select
import shutil
import signal
import tempfile
import time
from types import TracebackType
from typing import Any, Self

from drapeplan.errors import DrapeplanError, InputError

NAMES = ("chromium", "chromium-browser", "google-chrome")
VARIABLE = "DRAPEPLAN_BROWSER"
FLAGS = (
    "--headless=new",
    "--remote-debugging-pipe",
    "--use-angle=swiftshader",  # software: the same picture with any graphics card
    "--enable-unsafe-swiftshader",
    "--force-device-scale-factor=1",
    "--force-color-profile=srgb",
    "--hide-scrollbars",
    "--no-first-run",
    "--disable-extensions",
    "--disable-sync",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-dev-shm-usage",
)
PATIENCE = 120.0  # [s] for one answer: software rendering on a busy machine
FAREWELL = 5.0  # [s] to close by itself
PIPES = 3, 4  # file descriptors where Chromium reads and writes
CLEAR = 10  # our ends of the pipes stay clear of these


def find_browser() -> str:
    """Path of an installed Chromium.

    Raises:
        InputError: If there is none, or the one asked for cannot be run.
    """
    wanted = os.environ.get(VARIABLE)
    for name in [wanted] if wanted else NAMES:
        found = shutil.which(name)
        if found:
            return found
    if wanted:
        raise InputError(VARIABLE, "", f"{wanted} cannot be run", "name a Chromium")
    problem = f"no Chromium found ({', '.join(NAMES)})"
    raise InputError("--png", "", problem, f"install one or set {VARIABLE}")


class Chromium:
    """A page in a browser without network, as a context manager."""

    def __init__(self, size: tuple[int, int]) -> None:
        """Remember the size of the window, in pixels."""
        self._size, self._path = size, find_browser()
        self._count, self._rest, self._session = 0, b"", ""

    def __enter__(self) -> Self:
        """Start the browser and open an empty page."""
        self._profile = tempfile.TemporaryDirectory(
            prefix="drapeplan-", ignore_cleanup_errors=True
        )
        try:
            self._start()
            width, height = self._size
            page = self.ask("Target.createTarget", url="about:blank")["targetId"]
            attached = self.ask("Target.attachToTarget", targetId=page, flatten=True)
            self._session = attached["sessionId"]
            self.ask("Network.enable")
            offline = {"latency": 0, "downloadThroughput": 0, "uploadThroughput": 0}
            self.ask("Network.emulateNetworkConditions", offline=True, **offline)
            screen = {"width": width, "height": height, "deviceScaleFactor": 1}
            self.ask("Emulation.setDeviceMetricsOverride", mobile=False, **screen)
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the browser and remove its profile."""
        self.close()

    def _start(self) -> None:
        command = [self._path, *FLAGS, f"--user-data-dir={self._profile.name}"]
        if os.geteuid() == 0:  # Chromium refuses to run in its sandbox as root
            command.append("--no-sandbox")
        theirs_in, self._writing = _pipe()
        self._reading, theirs_out = _pipe()
        quiet = [(os.POSIX_SPAWN_OPEN, k, os.devnull, os.O_RDWR, 0) for k in range(3)]
        wires = zip((theirs_in, theirs_out), PIPES, strict=True)
        joined = [(os.POSIX_SPAWN_DUP2, mine, theirs) for mine, theirs in wires]
        self._process = os.posix_spawn(
            self._path,
            command,
            os.environ,
            file_actions=[*quiet, *joined],
            setpgroup=0,  # its helpers end with it
        )
        os.close(theirs_in)
        os.close(theirs_out)

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send one message and return its answer.

        Raises:
            DrapeplanError: If the browser refuses, ends or does not answer in time.
        """
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        try:
            _write(self._writing, json.dumps(message).encode() + b"\0")
            while True:
                answer = json.loads(self._read())
                if answer.get("id") == self._count:
                    break
        except (OSError, ValueError) as error:
            problem = f"the browser {self._path} does not answer ({error})"
            raise DrapeplanError(problem) from error
        if "error" in answer:
            raise DrapeplanError(f"the browser refused: {answer['error']['message']}")
        result: dict[str, Any] = answer["result"]
        return result

    def run(self, script: str) -> Any:
        """Value of a script in the page, awaited where it is a promise.

        Raises:
            DrapeplanError: If the script fails.
        """
        answer = self.ask(
            "Runtime.evaluate",
            expression=script,
            awaitPromise=True,
            returnByValue=True,
        )
        if "exceptionDetails" in answer:
            thrown = answer["exceptionDetails"].get("exception", {})
            text = thrown.get("description", answer["exceptionDetails"]["text"])
            raise DrapeplanError(f"the page failed: {text.splitlines()[0]}")
        return answer["result"].get("value")

    def _read(self) -> bytes:
        """The next message."""
        end = time.monotonic() + PATIENCE
        while b"\0" not in self._rest:
            left = max(0.0, end - time.monotonic())
            if not select.select([self._reading], [], [], left)[0]:
                raise TimeoutError(f"no answer for {PATIENCE:g} s")
            more = os.read(self._reading, 1 << 20)
            if not more:
                raise ConnectionError("it closed its pipe")
            self._rest += more
        message, self._rest = self._rest.split(b"\0", 1)
        return message

    def close(self) -> None:
        """End the browser, kindly first, and remove its profile."""
        if hasattr(self, "_process"):
            os.close(self._writing)  # its sign to leave
            os.close(self._reading)
            end = time.monotonic() + FAREWELL
            while os.waitpid(self._process, os.WNOHANG)[0] == 0:
                if time.monotonic() > end:
                    os.killpg(self._process, signal.SIGKILL)
                    os.waitpid(self._process, 0)
                    break
                time.sleep(0.02)
            del self._process
        self._profile.cleanup()


def _pipe() -> tuple[int, int]:
    """Both ends of a pipe, neither where the browser will have its own."""
    ends = []
    for end in os.pipe():
        ends.append(fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, CLEAR))
        os.close(end)
    return ends[0], ends[1]


def _write(file: int, data: bytes) -> None:
    while data:
        data = data[os.write(file, data) :]
