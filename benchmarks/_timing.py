"""The ways to time tasks: alone, and against each other."""

import time
from collections.abc import Callable, Mapping

import numpy as np


def median_time(task: Callable[[], object], repeats: int) -> float:
    """Median time of a task, in [s], after one unmeasured run that may compile."""
    task()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        task()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def interleaved(
    tasks: Mapping[str, Callable[[], object]], repeats: int
) -> dict[str, float]:
    """Median processor times of tasks that take turns, in [s].

    Turns spread what else the machine does over all tasks alike, and processor time
    leaves out the waiting: ratios of these times are what repeats. All threads count.
    Each task runs once before, unmeasured.
    """
    for task in tasks.values():
        task()
    times: dict[str, list[float]] = {name: [] for name in tasks}
    for _ in range(repeats):
        for name, task in tasks.items():
            start = time.process_time()
            task()
            times[name].append(time.process_time() - start)
    return {name: float(np.median(each)) for name, each in times.items()}
