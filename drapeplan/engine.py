"""Engine: deterministic tasks on processes here or on a cluster, whoever does them.

A task is a function of one item, with all that it needs inside: it travels once, as a
file here, as a result that others ask for on a cluster, and a worker unpacks it once,
however many batches it gets; what the task builds on the way stays with it. A batch
holds about PACE seconds of work, by what the batches before took. Answers stand in the
order of their items, so neither the number of workers nor the sizes of batches show in
them; a batch whose worker dies is done again by another.
"""

from __future__ import annotations

import pickle
import re
import signal
import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import (
    ALL_COMPLETED,
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    wait,
)
from contextlib import suppress
from functools import lru_cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import get_ident
from types import TracebackType
from typing import TYPE_CHECKING, Any, TypeVar

import cloudpickle
import loky

from drapeplan.errors import InputError

if TYPE_CHECKING:
    from distributed import Client

Item = TypeVar("Item")
Answer = TypeVar("Answer")
Told = Callable[[list[int], list[Any]], None]
Flying = dict[Future[tuple[list[Any], float]], list[int]]

PACE = 1.0  # [s] of work in a batch: handing it over takes milliseconds
SHARE = 4  # [-] batches that each worker has of what is left, to end together
AHEAD = 2  # [-] batches at or before each worker, so that none waits for the next
PATIENCE = 3  # [-] times in a row that workers may die before anything is answered
ANSWER = 10  # [s] within which a cluster answers
KEPT = 4  # [-] tasks that a worker remembers
ONE_THREAD = {
    name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
}


class Engine:
    """Workers, as a context: processes of this machine, or those of a Dask cluster."""

    def __init__(
        self, workers: int = 1, cluster: str | None = None, pace: float = PACE
    ) -> None:
        """Say who works; nothing starts yet.

        Args:
            workers: Processes; 1 works here, in this one.
            cluster: Address of a Dask scheduler, such as tcp://host:8786; its workers
                are taken instead.
            pace: Work that a batch should hold, in [s].
        """
        self.workers, self.cluster, self.pace = workers, cluster, pace
        self._client: Client | None = None
        self._folder: TemporaryDirectory[str] | None = None

    def __enter__(self) -> Engine:
        """Find the cluster, if one is asked for.

        Raises:
            InputError: It does not answer, or its workers have another drapeplan.
        """
        if self.cluster:
            self._client = _client(self.cluster)
            self.workers = max(1, sum(self._client.ncores().values()))
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the workers; an interruption ends those of this machine."""
        if self._folder:
            self._folder.cleanup()
        if self._client:
            self._client.close()
        elif self.workers > 1 and kind is not None:
            self._executor().shutdown(wait=False, kill_workers=True)

    def map(
        self,
        task: Callable[[Item], Answer],
        items: Sequence[Item],
        told: Told | None = None,
    ) -> list[Answer]:
        """Answers of a task, in the order of its items.

        Args:
            task: Deterministic function of one item; what it raises is raised here.
            items: What to work on.
            told: Called with the places and the answers of each batch as it ends.

        Raises:
            BrokenExecutor: Workers die again and again, and nothing gets answered.
        """
        answers: list[Any] = [None] * len(items)

        def take(places: list[int], found: list[Any]) -> None:
            for k, answer in zip(places, found, strict=True):
                answers[k] = answer
            if told:
                told(places, found)

        if self.workers == 1 and not self._client:
            for k, item in enumerate(items):
                take([k], [task(item)])
        elif items:
            packed = self._handed_out(cloudpickle.dumps(task))
            _Dispatch(self, packed, items, take).run()
        return answers

    def _handed_out(self, packed: bytes) -> Any:
        """What stands for a task in its batches: a file, if workers can read it."""
        if self._client:
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", "Sending large graph")  # once
                return self._client.submit(bytes, packed, pure=False)
        self._folder = self._folder or TemporaryDirectory(prefix="drapeplan-")
        file = Path(self._folder.name) / sha256(packed).hexdigest()
        if not file.exists():
            file.write_bytes(packed)
        return file

    def _executor(self) -> Any:
        """Where batches are handed in; a new one where workers died."""
        if self._client:
            return self._client.get_executor(pure=False)
        return loky.get_reusable_executor(
            self.workers, timeout=60, initializer=_undisturbed, env=ONE_THREAD
        )


class _Dispatch:
    """One map at work."""

    def __init__(
        self, engine: Engine, packed: Any, items: Sequence[Any], take: Told
    ) -> None:
        self.engine, self.packed, self.items, self.take = engine, packed, items, take
        self.left = list(range(len(items)))
        self.flying: Flying = {}
        self.done, self.seconds, self.deaths = 0, 0.0, 0

    def run(self) -> None:
        """Until all items are answered."""
        executor = self.engine._executor()
        try:
            while self.left or self.flying:
                try:
                    self._hand_in(executor)
                    self._collect(FIRST_COMPLETED)
                except BrokenExecutor:
                    with suppress(BrokenExecutor):
                        self._collect(ALL_COMPLETED)  # what the others have done
                    self.deaths += 1
                    if self.deaths > PATIENCE:
                        raise
                    executor = self.engine._executor()
        finally:
            for future in self.flying:
                future.cancel()

    def _hand_in(self, executor: Executor) -> None:
        while self.left and len(self.flying) < AHEAD * self.engine.workers:
            places = self.left[: self._size()]
            batch = [self.items[k] for k in places]
            future = executor.submit(_work, self.packed, batch)
            self.flying[future] = places
            del self.left[: len(places)]

    def _size(self) -> int:
        """Items of the next batch."""
        if not self.done:
            return 1
        wanted = self.engine.pace * self.done / max(self.seconds, 1e-9)
        fair = len(self.left) / (SHARE * self.engine.workers)
        return max(1, int(min(wanted, fair)))

    def _collect(self, when: str) -> None:
        """Take what has ended; a batch that died with its worker is left again."""
        ended, _ = wait(self.flying, return_when=when)
        broken = None
        for future in sorted(ended, key=lambda one: self.flying[one]):
            places, error = self.flying.pop(future), future.exception()
            if isinstance(error, BrokenExecutor):
                self.left, broken = sorted([*places, *self.left]), error
                continue
            found, seconds = future.result()
            self.done, self.seconds = self.done + len(found), self.seconds + seconds
            self.deaths = 0
            self.take(places, found)
        if broken:
            raise broken


def _work(packed: bytes | Path, items: list[Any]) -> tuple[list[Any], float]:
    """Answers of a batch, and the time that they took, in [s]."""
    start = time.perf_counter()
    task = _unpacked(packed, get_ident())
    answers = [task(item) for item in items]
    return answers, time.perf_counter() - start


@lru_cache(maxsize=KEPT)
def _unpacked(packed: bytes | Path, thread: int) -> Callable[[Any], Any]:
    """A task as this worker knows it; each thread has its own, for what it builds."""
    data = packed.read_bytes() if isinstance(packed, Path) else packed
    task: Callable[[Any], Any] = pickle.loads(data)
    return task


def _undisturbed() -> None:
    """An interruption is for the one who handed the work in."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _client(address: str) -> Client:
    """A connection to a Dask cluster whose workers have this drapeplan.

    Raises:
        InputError: There is none.
    """
    try:
        from distributed import Client
    except ImportError:
        remedy = "pip install 'drapeplan[cluster]'"
        raise InputError("--cluster", "", "needs Dask", remedy) from None
    if not re.fullmatch(r"\w+://\S+:\d+", address):
        problem = f"{address!r} is no address"
        raise InputError("--cluster", "", problem, "such as tcp://host:8786")
    try:
        client = Client(address, timeout=ANSWER, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        problem = f"no Dask scheduler answers at {address}"
        raise InputError("--cluster", "", problem, "start `dask scheduler`") from error
    with suppress(TimeoutError):
        client.wait_for_workers(1, timeout=ANSWER)
    here = version("drapeplan")
    there = client.run(version, "drapeplan", on_error="return")
    other = sorted(name for name, found in there.items() if found != here)
    if other or not there:
        client.close()
        problem = f"{other[0]} has no drapeplan {here}" if other else "has no workers"
        raise InputError("--cluster", "", problem, "start `dask worker` beside it")
    return client
