"""Engine: the same answers whoever works, and whoever dies at it."""

import os
import pickle
import signal
import time
from importlib.metadata import version

import pytest

from drapeplan.engine import SHARE, Engine
from drapeplan.errors import InputError


class Squares:
    """A task that knows when it was built, and dies once over each of some items."""

    def __init__(self, folder=None, *fatal):  # noqa: D107
        self.folder, self.fatal, self.built = folder, fatal, None

    def __call__(self, item):
        if self.built is None:
            self.built = time.monotonic_ns()
        if item in self.fatal:
            try:
                (self.folder / f"killed by {item}").touch(exist_ok=False)
            except FileExistsError:
                return item * item
            os.kill(os.getpid(), signal.SIGKILL)
        return item * item


class Origins(Squares):
    """Answers with the process and what was built in it."""

    def __call__(self, item):
        super().__call__(item)
        return os.getpid(), self.built


SQUARES = [k * k for k in range(40)]


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("pace", [1e-6, 10.0])
def test_answers_keep_the_order_of_the_items(workers, pace):
    with Engine(workers, pace=pace) as engine:
        assert engine.map(Squares(), list(range(40))) == SQUARES


def test_each_answer_is_told_once():
    places = []
    with Engine(2) as engine:
        engine.map(Squares(), list(range(40)), lambda k, found: places.extend(k))
    assert sorted(places) == list(range(40))


def test_a_worker_builds_a_task_once():
    with Engine(2, pace=1e-6) as engine:
        origins = engine.map(Origins(), list(range(40)))
    pids = {pid for pid, _ in origins}
    assert os.getpid() not in pids
    assert len(set(origins)) == len(pids)


def test_batches_grow_to_the_pace():
    sizes = []
    with Engine(2, pace=10.0) as engine:
        engine.map(Squares(), list(range(400)), lambda k, _: sizes.append(len(k)))
    assert sizes[0] == 1
    assert 10 < max(sizes) <= 400 / (2 * SHARE)  # all are to end together


def test_a_killed_worker_changes_nothing(tmp_path):
    with Engine(2, pace=1e-6) as engine:
        found = engine.map(Squares(tmp_path, 17), list(range(40)))
    assert (tmp_path / "killed by 17").exists()
    assert found == SQUARES


def test_deaths_with_answers_between_do_not_add_up(tmp_path, monkeypatch):
    monkeypatch.setattr("drapeplan.engine.PATIENCE", 1)
    with Engine(2, pace=1e-6) as engine:
        assert engine.map(Squares(tmp_path, 5, 20, 35), list(range(40))) == SQUARES
    assert len(list(tmp_path.iterdir())) == 3


def test_workers_leave_a_stop_to_who_asked():
    with Engine(2) as engine:
        assert (
            engine.map(lambda _: signal.getsignal(signal.SIGINT), [1, 2])
            == [signal.SIG_IGN] * 2
        )


def test_a_stop_ends_the_workers_at_once():
    pids = []

    def stopped():
        with Engine(2) as engine:
            pids.extend(engine.map(lambda _: os.getpid(), [1, 2]))
            engine._executor().submit(time.sleep, 60)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
    until = time.monotonic() + 10
    while (alive := any(map(_runs, pids))) and time.monotonic() < until:
        time.sleep(0.05)
    assert not alive


def _runs(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_nothing_is_left_in_the_temporary_folder(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with Engine(2) as engine:
        engine.map(Squares(), [1])
        assert any(path.name.startswith("drapeplan") for path in tmp_path.iterdir())
    assert not any(path.name.startswith("drapeplan") for path in tmp_path.iterdir())


def test_work_that_kills_whoever_does_it_is_given_up():
    with Engine(2) as engine, pytest.raises(Exception, match="terminated"):
        engine.map(lambda item: os.kill(os.getpid(), signal.SIGKILL), [1, 2])


@pytest.mark.parametrize("workers", [1, 2])
def test_what_a_task_raises_is_raised(workers):
    def refuse(item):
        raise InputError("here", "", f"no {item}")

    with Engine(workers) as engine, pytest.raises(InputError, match="no 3"):
        engine.map(refuse, [3])


def test_no_cluster_is_bad_input(monkeypatch):
    monkeypatch.setattr("drapeplan.engine.ANSWER", 0.5)
    message = "no Dask scheduler answers"
    with pytest.raises(InputError, match=message), Engine(cluster="tcp://127.0.0.1:9"):
        pass


@pytest.mark.parametrize("address", ["foo", "tcp://127.0.0.1:abc"])
def test_what_is_no_address_is_bad_input(address):
    with pytest.raises(InputError, match="no address"), Engine(cluster=address):
        pass


def test_errors_travel_as_they_are():
    error = pickle.loads(pickle.dumps(InputError("file", "key", "problem", "remedy")))
    assert str(error) == "file: key: problem; remedy"
    assert (error.source, error.remedy) == ("file", "remedy")


def test_a_cluster_of_another_version_is_bad_input(cluster, monkeypatch):
    here = os.getpid()

    def told(name):
        return "0.0" if os.getpid() == here else version(name)

    monkeypatch.setattr("drapeplan.engine.version", told)
    with pytest.raises(InputError, match=r"no drapeplan 0\.0"), Engine(cluster=cluster):
        pass


def test_a_cluster_gives_the_same(cluster):
    with Engine(cluster=cluster) as engine:
        assert engine.map(Squares(), list(range(40))) == SQUARES


def test_a_cluster_that_loses_a_worker_gives_the_same(tmp_path, cluster):
    with Engine(cluster=cluster) as engine:
        found = engine.map(Squares(tmp_path, 17), list(range(40)))
    assert (tmp_path / "killed by 17").exists()
    assert found == SQUARES
