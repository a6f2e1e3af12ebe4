"""The live view: what it shows while a drape is planned, and to whom."""

import base64
import ctypes
import gzip
import http.client
import json
import os
import pathlib
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

from drapeplan import commands_live
from drapeplan.path import Path
from tests.browser import LOCAL, PATIENCE, OpenPage
from tests.settled import small_panel, tool_section
from viewer import live_news
from viewer.live import Live
from viewer.live_news import News
from viewer.live_server import HERE, LiveServer

POSITION = 10e-6  # [m] what a packed position may lose
HOSTILE = 'no </script><b id="bad">rest</b> & "more"'
LONG = f"?since={'1' * 5000}"  # longer than Python turns into an integer
SECONDS = 120  # for a process on a busy machine


@pytest.fixture(scope="module")
def plan():
    return small_panel().plan


def told(plan, news, rows=None):
    """Tell news of a drape: its path and some of its waypoints."""
    cell, track = plan.cell, plan.track
    if rows is None or 0 in rows:
        when = track.phase, track.step, track.tau
        path = Path(*when, track.tool, *track.poses, track.states)
        news.path(cell.scene, cell.sources, path)
    for k in range(len(track.q)) if rows is None else rows:
        news.waypoint(k, track.q[k])
    return news


@pytest.fixture(scope="module")
def whole(plan):
    """News of a drape whose waypoints are all solved, and not judged."""
    return told(plan, News())


def unpacked(payload):
    """Header and body of a payload, as unpack.js takes it apart."""
    data = gzip.decompress(base64.b64decode(payload))
    (length,) = struct.unpack("<I", data[:4])
    return json.loads(data[4 : 4 + length]), data[8 * -(-(4 + length) // 8) :]


def test_poses_come_in_the_order_in_which_they_are_solved(plan, whole):
    news, since, places = whole, 0, []
    while (answer := news.after(since))["payload"]:
        head, body = unpacked(answer["payload"])
        assert len(head["places"]) == len(head["drape"]["labels"]) <= live_news.MOST
        offset, size = head["blobs"][head["drape"]["tool"]]
        tool = np.frombuffer(body[offset : offset + size], "<f4").reshape(-1, 4, 4)
        expected = plan.track.tool[head["places"]].swapaxes(1, 2)
        assert_allclose(tool, expected, atol=1e-6)
        places += head["places"]
        since = answer["since"]
    assert places == list(range(len(plan.track.q)))
    assert since == len(places)


def test_live_ply_is_the_plans(plan, whole):
    """The small panel's plan stands on the cubic model, as the live view does."""
    from viewer.scene import view_of

    assert plan.verdict["ply_model"]["model"] == "cubic"
    final = view_of(plan)
    places = [0, 40, final.poses - 1]
    view = whole._making.view(places, whole._joints)
    assert_allclose(view.ply_points, final.ply_points[places], atol=1e-9)
    assert_allclose(view.gap, final.gap[places], atol=1e-9)
    assert view.labels == [final.labels[k] for k in places]
    assert view.wave_step.tolist() == final.wave_step[places].tolist()


def test_a_pose_that_is_bettered_comes_again(plan, whole):
    """Last of those on the shared news, before it is said to have failed."""
    count = len(plan.track.q)
    whole.waypoint(2, plan.track.q[3])
    answer = whole.after(count)
    head, body = unpacked(answer["payload"])
    assert (head["places"], answer["since"]) == ([2], count + 1)
    offset, size = head["blobs"][head["drape"]["arm"]]
    arm = np.frombuffer(body[offset : offset + size], "<f4").reshape(-1, 4, 4)
    bodies = whole._making.visuals.placements(plan.track.arm[3:4])[0]
    assert_allclose(arm, bodies.swapaxes(1, 2), atol=1e-6)


def test_page_waits_until_there_is_a_pose():
    news = News()
    news.stage("net and <b>wave</b>", 0.25)
    page = news.page()
    assert "Net and &lt;b&gt;wave&lt;/b&gt;, 25 %" in page
    assert 'http-equiv="refresh"' in page
    news.failed(HOSTILE)
    page = news.page()
    assert "<b" not in page.split("<body>")[1].replace("<body", "")
    assert 'http-equiv="refresh"' not in page


def test_policy_of_the_growing_page(whole):
    text = whole.page()
    policy = re.search(r'Security-Policy" content="([^"]*)"', text)[1]
    assert policy.startswith("default-src 'none';")
    assert policy.endswith("connect-src 'self'")
    assert "unsafe-eval" not in policy
    for name in ("meshcat", "three 0.", "UR10"):
        assert name in text  # notices


def test_what_has_ended_is_said_after_the_last_pose(whole):
    whole.failed(HOSTILE)
    assert whole.after(0)["ended"] == ""
    last = whole.after(len(whole._log))
    assert (last["ended"], last["text"], last["payload"]) == ("failed", HOSTILE, None)


@contextmanager
def serving(news):
    """A server in threads of this process."""
    server = LiveServer(0)
    server.news = news
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@pytest.fixture
def server():
    """A server whose news are a stub."""

    class Stub:
        asked = ()

        def page(self):
            return "<!DOCTYPE html>the page"

        def after(self, since):
            self.asked = (*self.asked, since)
            return {"since": since}

    with serving(Stub()) as opened:
        yield opened


def ask(server, path, method="GET", **headers):
    """Status, headers and text of an answer."""
    link = http.client.HTTPConnection(HERE, server.server_port, timeout=10)
    link.request(method, path, headers=headers)
    answer = link.getresponse()
    text = answer.read().decode()
    link.close()
    return answer.status, dict(answer.getheaders()), text


def test_two_addresses_are_answered(server):
    status, headers, text = ask(server, "/")
    assert (status, text) == (200, "<!DOCTYPE html>the page")
    assert headers["Content-Type"] == "text/html; charset=utf-8"
    assert headers["Cache-Control"] == "no-store"
    assert headers["X-Frame-Options"] == "DENY"
    assert not any(name.startswith("Access-Control") for name in headers)
    status, headers, text = ask(server, "/news?since=7")
    assert (status, json.loads(text), server.news.asked) == (200, {"since": 7}, (7,))


@pytest.mark.parametrize(
    "path",
    [
        "/../../etc/passwd",
        "/%2e%2e/etc/passwd",
        "//etc/passwd",
        "/index.html",
        "/news/",
    ],
)
def test_nothing_else_is_there(server, path):
    status, _, text = ask(server, path)
    assert (status, text) == (404, "Not Found")


@pytest.mark.parametrize(
    "query", ["", "?since=", "?since=-1", "?since=x", "?since=1e3", LONG]
)
def test_questions_must_be_numbers(server, query):
    assert ask(server, "/news" + query)[0] == 400
    assert server.news.asked == ()


@pytest.mark.parametrize("path", ["/", "/news?since=0"])
@pytest.mark.parametrize("host", ["evil.example", "evil.example:{}", "127.0.0.1", ""])
def test_foreign_hosts_are_refused(server, host, path):
    """A name of another site that points here: its pages may not read ours."""
    status, _, text = ask(server, path, Host=host.format(server.server_port))
    assert (status, text) == (403, "Forbidden")
    assert server.news.asked == ()
    assert ask(server, path, Host=f"localhost:{server.server_port}")[0] == 200


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "HEAD"])
def test_reading_is_all_one_can_do(server, method):
    status, headers, _ = ask(server, "/", method)
    assert status == 501
    assert not any(name.startswith("Access-Control") for name in headers)


def test_this_machine_alone(server):
    """Other addresses of this machine, which others could reach, do not answer."""
    assert server.server_address[0] == "127.0.0.1"
    others = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None)}
    others |= {"127.0.0.2"}  # loopback too, and not ours
    for address in others - {"127.0.0.1"}:
        with pytest.raises(OSError, match=r"."):
            socket.create_connection((address, server.server_port), 1).close()


def assert_free(port):
    """Nobody listens there, connections that have ended aside."""
    with socket.socket() as free:
        free.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        free.bind((HERE, port))


def test_closing_frees_the_port_and_ends_the_threads():
    before = threading.active_count()
    with serving(News()) as opened:
        assert ask(opened, "/")[0] == 200
    assert threading.active_count() == before
    assert_free(opened.server_port)


class LivePage(OpenPage):
    """A page of the live server, in a browser."""

    def __init__(self, browser, address):
        """Open it and wait until its content stands."""
        self.context = browser.new_context(viewport={"width": 900, "height": 600})
        self.page = self.context.new_page()
        self.errors, self.requests = [], []
        self.page.on("console", self._log)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.set_default_timeout(PATIENCE)
        self.page.goto(address)
        self.wait("document.body.dataset.ready")

    def external(self, address):
        """Requests to anybody but the live server."""
        known = (*LOCAL, address)
        return [url for url in self.requests if not url.startswith(known)]


@pytest.mark.browser
def test_page_grows_with_the_plan_and_ends_as_its_preview(plan, browser):
    news, count = News(), len(plan.track.q)
    half = count // 2
    told(plan, news, range(half))
    with serving(news) as server:
        address = f"http://{HERE}:{server.server_port}/"
        page = LivePage(browser, address)
        assert page.run("[app.book.live, app.timeline.last]") == [half, half - 1]
        told(plan, news, range(half, count))
        news.stage("rest", 0.5)
        page.wait(f"document.body.dataset.since == {count}")
        assert page.run("app.timeline.last") == count - 1
        assert page.run("document.getElementById('slider').max") == str(count - 1)
        page.wait("document.getElementById('news').textContent.includes('50 %')")
        assert page.run("app.pose") == count - 1  # it follows
        assert page.page.locator("#news").is_visible()
        assert not page.page.locator("#chart").is_visible()
        assert_shown(page, plan, half // 2)
        assert_shown(page, plan, count - 10)
        page.run("() => app.show(app.timeline.endOf(1))")
        assert page.run("app.drapes[0].front.mesh.count") > 10
        page.run("() => app.timeline.jump(3)")
        news.waypoint(3, plan.track.q[half])  # bettered
        page.wait(f"document.body.dataset.since == {count + 1}")
        assert page.run("app.pose") == 3  # the reader has taken over
        assert_shown(page, plan, 3, half)
        with page.page.expect_event("load"):
            news.plan(plan.document)
        page.wait("document.body.dataset.ready === 'yes'")
        assert page.page.locator("#news").count() == 0
        assert page.run("app.drapes[0].plan.good") is True
        assert page.errors == []
        assert page.external(address) == []
        page.context.close()


@pytest.mark.browser
def test_why_there_is_no_plan_is_text(whole, browser):
    """Run after the test that lets it fail."""
    whole.failed(HOSTILE)
    with serving(whole) as server:
        page = LivePage(browser, f"http://{HERE}:{server.server_port}/")
        page.wait("document.getElementById('news').textContent.includes('rest')")
        assert HOSTILE in page.page.text_content("#news")
        assert page.page.locator("#bad").count() == 0
        assert page.errors == []
        page.context.close()


def assert_shown(page, plan, pose, like=None):
    """The cups at a pose are those of the plan, there or at another pose."""
    page.run("k => app.show(k)", pose)
    faces = page.run("Array.from(app.drapes[0].cups.at.faces)")
    expected = plan.track.poses[0][pose if like is None else like]
    assert_allclose(np.reshape(faces, (-1, 3)), expected, atol=POSITION)


def command(*arguments):
    """The command line in a process of its own."""
    return [sys.executable, "-m", "drapeplan", *map(str, arguments)]


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("live")
    data = {
        "format": "drapeplan-scene/1",
        "mold": {"surface": {"kind": "plane"}},
        "tool": tool_section(folder),
        "fidelity": "kinematic",
    }
    path = folder / "scene.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


def test_live_plan_is_the_plan_and_ctrl_c_stops_cleanly(drapeplan, scene, tmp_path):
    live, plain = tmp_path / "live.json", tmp_path / "plain.json"
    asked = command("preview", scene, "--live", "--no-open", "-o", live)
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(
        asked,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # also in `&`
    ) as child:
        try:
            port = int(re.search(r"127\.0\.0\.1:(\d+)/", child.stdout.readline())[1])
            told = []
            for line in child.stdout:
                if line.startswith("wrote"):
                    break
                told.append(line)
            child.send_signal(signal.SIGINT)
            _, said = child.communicate(timeout=SECONDS)
        finally:
            child.kill()
    assert (child.returncode, said) == (0, "")
    assert_free(port)
    planned = drapeplan("plan", scene, "-o", plain)
    assert (planned.code, planned.out) == (0, f"{''.join(told)}wrote {plain}\n")
    assert live.read_bytes() == plain.read_bytes()


def test_signal_to_terminate_ends_quietly():
    before = signal.getsignal(signal.SIGTERM)
    with commands_live._stopped():
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(SECONDS)
        pytest.fail("went on")
    assert signal.getsignal(signal.SIGTERM) == before


def test_stopped_while_planning_says_that_there_is_no_plan(
    drapeplan, scene, tmp_path, monkeypatch
):
    def planned(*_):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(SECONDS)

    monkeypatch.setattr(commands_live, "planned", planned)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        old = tmp_path / "old.json"
        old.write_text("{}")
        ended = drapeplan("preview", scene, "--live", "--no-open", "-o", old)
    finally:
        signal.signal(signal.SIGINT, before)
    assert (ended.code, old.read_text()) == (130, "{}")
    assert ended.line == f"nothing written: {old} is of an earlier run"


def test_a_stop_that_is_lost_in_a_callback_ends_the_planning(capsys):
    """As one does that comes while a kernel is compiled."""
    callback = ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGTERM))
    with commands_live._stopped() as asked:
        callback()
        commands_live._both(None, None, asked)("strokes", 0.5)
        pytest.fail("went on")
    assert asked.is_set()
    assert capsys.readouterr().err == ""


def test_what_serves_never_hears_ctrl_c():
    """Not even while it imports, where it would answer with a traceback."""
    with Live() as live:
        status = pathlib.Path(f"/proc/{live._process.pid}/status").read_text()
        blocked = int(re.search(r"SigBlk:\s*(\w+)", status)[1], 16)
        assert blocked >> (signal.SIGINT - 1) & 1
        start = time.perf_counter()
    assert time.perf_counter() - start < 1
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_a_taken_port_is_one_line(drapeplan, scene):
    with socket.socket() as taken:
        taken.bind((HERE, 0))
        taken.listen()
        port = taken.getsockname()[1]
        ended = drapeplan("preview", scene, "--live", "--no-open", "--port", port)
    assert (ended.code, ended.out, ended.err.count("\n")) == (2, "", 1)
    assert str(port) in ended.line
    assert "--port" in ended.line


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--live", "--png", "1"], "--live"),
        (["--live", "--json"], "--live"),
        (["b.yaml", "--live"], "--live"),
        (["--port", "0", "-o", "x.html"], "--port"),
        ([], "--output"),
    ],
)
def test_options_that_do_not_go_together(drapeplan, scene, arguments, word):
    ended = drapeplan("preview", scene, *arguments)
    assert (ended.code, ended.err.count("\n")) == (2, 1)
    assert word in ended.line


def test_a_view_that_is_gone_stops_no_planner(plan):
    with Live() as live:
        live._process.kill()
        live._process.join()
        for _ in range(3):
            live.waypoint(0, plan.track.q[0])
        start = time.perf_counter()
        live.wait()
        assert time.perf_counter() - start < 1


def test_what_cannot_be_shown_is_said():
    with Live() as live:
        live.stage("strokes", "no share")
        text, until = "", time.monotonic() + SECONDS
        while "cannot be shown" not in text and time.monotonic() < until:
            link = http.client.HTTPConnection(HERE, live.port, timeout=SECONDS)
            link.request("GET", "/")
            text = link.getresponse().read().decode()
            link.close()
            time.sleep(0.05)
        assert "This cannot be shown" in text
