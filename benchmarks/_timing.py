"""The one way to time a task."""

import time
from collections.abc import Callable

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
