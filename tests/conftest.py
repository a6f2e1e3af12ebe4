"""Fixtures of the tests that look at the program from outside."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

from drapeplan import cli
from tests.plans import EXAMPLES, PARABOLOID


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    code: int
    out: str
    err: str

    @property
    def line(self):
        """The one line that an error is."""
        return self.err.splitlines()[0]

    @property
    def document(self):
        """The one JSON document on stdout."""
        return json.loads(self.out)


@dataclass(frozen=True)
class Measured(Ended):
    """How a process of its own ended, what it wrote and what it took."""

    file: Path
    seconds: float
    peak_bytes: int


@pytest.fixture
def drapeplan(monkeypatch, capsys):
    """Run the command line in this process."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["drapeplan", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as stop:
            cli.main()
        return Ended(stop.value.code, *capsys.readouterr())

    return run


@pytest.fixture
def write_scene(tmp_path):
    """Write a scene on the paraboloid, with sections replaced or added."""

    def write(folder=tmp_path, **sections):
        data = {"format": "drapeplan-scene/1", "mold": {"surface": PARABOLOID}}
        path = folder / "scene.yaml"
        text = yaml.safe_dump({**data, **sections}, allow_unicode=True)
        path.write_text(text, encoding="utf-8")
        return path

    return write


def measured_plan(folder, seed):
    """Plan examples/panel.yaml in a process of its own, hashes seeded."""
    file, log = folder / f"plan{seed}.json", folder / f"log{seed}"
    command = [sys.executable, "-m", "drapeplan", "plan"]
    command += [str(EXAMPLES / "panel.yaml"), "-o", str(file)]
    with log.open("w") as out, (folder / f"err{seed}").open("w+") as err:
        environment = {**os.environ, "PYTHONHASHSEED": str(seed)}
        child = subprocess.Popen(command, stdout=out, stderr=err, env=environment)
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        err.seek(0)
        said = err.read()
    seconds = usage.ru_utime + usage.ru_stime  # of the processor: others may be at work
    unit = 1 if sys.platform == "darwin" else 1024
    return Measured(
        child.returncode, log.read_text(), said, file, seconds, usage.ru_maxrss * unit
    )


@pytest.fixture(scope="session")
def panel_run(tmp_path_factory):
    """The panel's plan, made once by a process of its own."""
    return measured_plan(tmp_path_factory.mktemp("panel"), 1)
