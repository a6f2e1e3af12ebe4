"""The ways to time tasks: alone, and against each other."""

import gc
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import numpy as np

ENOUGH = 0.2  # [s] that a task is timed for at least, if more than once
MOST = 20  # [-] times that it is timed at most


def median_time(task: Callable[[], object], repeats: int) -> float:
    """Median time of a task, in [s], after one unmeasured run that may compile."""
    task()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        task()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


@contextmanager
def uncollected() -> Iterator[None]:
    """No garbage is collected for a while: whose it is, nobody knows."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def interleaved(
    tasks: Mapping[str, Callable[[], object]], repeats: int
) -> dict[str, float]:
    """Least processor times of tasks that take turns, in [s].

    Turns, forth and back, spread what else the machine does over all tasks alike, and
    processor time leaves out the waiting. What is left of others, in caches and in
    shared units of the processor, only adds: the least of several times repeats best.
    All threads count. Each task runs once before, unmeasured; short ones run more often
    than asked, unless that is once.
    """
    times: dict[str, list[float]] = {name: [] for name in tasks}
    for task in tasks.values():
        task()
    with uncollected():
        for n in range(max(repeats, MOST if repeats > 1 else 1)):
            for name in list(tasks)[:: -1 if n % 2 else 1]:
                if n < repeats or sum(times[name]) < ENOUGH:
                    times[name].append(seconds(tasks[name]))
    return {name: min(each) for name, each in times.items()}


def seconds(task: Callable[[], object]) -> float:
    """Processor time of a task, in [s]."""
    start = time.process_time()
    task()
    return time.process_time() - start
