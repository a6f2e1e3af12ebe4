"""Dask clusters on loopback, as a shop would start them."""

import os
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

from distributed import Client

ROOT = Path(__file__).parent.parent
WAIT = 120  # [s] in which two workers come, however busy the machine is
QUIET = ("--no-dashboard",)


@contextmanager
def dask_cluster():
    """Address of a scheduler with two workers, ended afterwards."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    started = []

    def start(*arguments):
        command = [sys.executable, "-m", "dask", *arguments, *QUIET]
        child = subprocess.Popen(
            command,
            env=environment,
            cwd=ROOT,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        started.append(child)
        return child

    try:
        scheduler = start("scheduler", "--host", "127.0.0.1", "--port", "0")
        said = (line for line in scheduler.stderr if "Scheduler at:" in line)
        address = next(said).split()[-1]
        for _ in range(2):
            start("worker", address, "--nthreads", "1")
        with Client(address, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=WAIT)
        yield address
    finally:
        for child in started:
            os.killpg(child.pid, signal.SIGKILL)  # a worker and who watches it
            child.communicate()
