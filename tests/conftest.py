"""Fixtures of the tests that look at the program from outside."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml
from hypothesis import settings

from drapeplan import cli
from tests.plans import EXAMPLES, PARABOLOID

SHARED = {  # modules that look at the same plans or cluster
    **dict.fromkeys(("test_arm_check", "test_plan", "test_resettle"), "panel"),
    **dict.fromkeys(("test_check", "test_live"), "small panel"),
    **dict.fromkeys(("test_rest", "test_settling", "test_ply_rows"), "settled"),
    **dict.fromkeys(("test_engine", "test_tune", "test_ranking"), "cluster"),
}
APART = {"test_cli", "test_examples", "test_judge", "test_ladder_truth"}  # long ones
settings.register_profile("suite", deadline=None)  # others may be at work
settings.load_profile("suite")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Tests of a module go to one worker, which makes what they share once."""
    for item in items:
        name = item.path.stem
        if name not in APART and not item.get_closest_marker("xdist_group"):
            group = SHARED.get(name, name)
            item.add_marker(pytest.mark.xdist_group(group))


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


@pytest.fixture(scope="session")
def cluster():
    """Address of a Dask scheduler with two workers."""
    from tests.clusters import dask_cluster

    with dask_cluster() as address:
        yield address


@pytest.fixture(scope="module")
def browser():
    """A browser for the tests of a module."""
    from tests.browser import launch

    with launch() as opened:
        yield opened


@pytest.fixture(scope="session")
def panel_run(tmp_path_factory):
    """The plan of examples/panel.yaml, made once by a process of its own."""
    folder = tmp_path_factory.mktemp("panel")
    file, log = folder / "plan.json", folder / "log"
    command = [sys.executable, "-m", "drapeplan", "plan"]
    command += [str(EXAMPLES / "panel.yaml"), "-o", str(file)]
    with log.open("w") as out, (folder / "err").open("w+") as err:
        environment = {**os.environ, "PYTHONHASHSEED": "1"}  # another than here
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
