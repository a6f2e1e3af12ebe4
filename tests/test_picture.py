"""Pictures of a plan, taken by an installed Chromium."""

import io
import tempfile

import numpy as np
import pytest

from drapeplan import commands_preview
from drapeplan.errors import DrapeplanError, InputError
from tests.browser import find_browser, launch, synthetic_view
from viewer import chromium
from viewer.chromium import Chromium
from viewer.picture import check_camera, moment_of, pictures

SIZE = 900, 600  # [px]
POSES = 12
ACCENT = np.array([0x0B, 0x5F, 0xA5])  # of pressed buttons and the slider


def view_of_steps():
    """A drape whose poses 0-2 are no wave, then two steps of equal length."""
    step = np.r_[[-1] * 2, 0, [1] * 5, [2] * 4]
    return synthetic_view(POSES, (12, 9), wave_step=step)


@pytest.fixture(scope="module")
def taken(tmp_path_factory):
    """Pictures from above of the approach and of the last step."""
    from PIL import Image

    if find_browser() is None:
        with launch():  # skips, loudly, or fails where there must be one
            pass
    view, folder = view_of_steps(), tmp_path_factory.mktemp("profiles")
    places = [moment_of([view], text) for text in ("pose=1", "2")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tempfile, "tempdir", str(folder))
        files = list(pictures([view], places, "Top", SIZE))
    assert list(folder.iterdir()) == []
    images = [Image.open(io.BytesIO(file)) for file in files]
    return [np.asarray(image.convert("RGB")).astype(int) for image in images]


@pytest.mark.browser
@pytest.mark.xdist_group("browser")
def test_picture_has_the_size_and_the_colors_of_its_moment(taken):
    shares = []
    for pixels in taken:
        assert pixels.shape == (SIZE[1], SIZE[0], 3)
        red, green, blue = np.moveaxis(pixels, -1, 0)
        dark = (red < 50) & (green < 70) & (blue > 50) & (blue < 140)
        yellow = (red > 190) & (green > 170) & (blue < 130)
        shares.append([dark.mean(), yellow.mean()])
    (dark, yellow), (later_dark, later_yellow) = shares
    assert later_dark > 5 * dark
    assert yellow > later_yellow + 0.05


@pytest.mark.browser
@pytest.mark.xdist_group("browser")
def test_picture_has_a_legend_and_no_controls(taken):
    for pixels in taken:
        pressed = np.all(abs(pixels - ACCENT) < 6, axis=-1)
        assert pressed.sum() < 20  # a view's button alone has hundreds
        bar = pixels[20:120, -240:-20]
        assert np.any(np.all(abs(bar - [254, 232, 56]) < 12, axis=-1))
        named = pixels[-44:-14, -220:-20].min(axis=-1)  # what moment it is, in ink
        assert 0.01 < np.mean(named < 110) < 0.4
        assert np.all(pixels[10:20, 10:20] == 255)  # on white paper


@pytest.mark.parametrize(
    ("text", "moment"), [("0", 2), ("1", 7), ("2", 11), ("pose=1", 0), ("pose=12", 11)]
)
def test_moments_are_the_ends_of_steps_or_poses(text, moment):
    assert moment_of([view_of_steps()], text) == moment


@pytest.mark.parametrize(
    "text", ["3", "-1", "pose=0", "pose=13", "x", "", "step=", "pose=1.5", "view=1"]
)
def test_moments_that_are_not_there(text):
    with pytest.raises(InputError, match="--png"):
        moment_of([view_of_steps()], text)


def test_camera_by_name():
    check_camera("Iso")
    check_camera(None)
    with pytest.raises(InputError, match=r"Nowhere.*Iso"):
        check_camera("Nowhere")


def shell(folder, line):
    """A program that does what a line of shell says."""
    path = folder / "browser"
    path.write_text(f"#!/bin/sh\n{line}\n")
    path.chmod(0o755)
    return str(path)


@pytest.mark.parametrize(
    "line", ["exit 1", "exec sleep 60", "printf 'x\\0' >&4; sleep 60"]
)
def test_a_broken_browser_is_one_line(tmp_path, monkeypatch, line):
    """It ends at once, never answers, or says what is no message."""
    monkeypatch.setenv("DRAPEPLAN_BROWSER", shell(tmp_path, line))
    monkeypatch.setattr(chromium, "PATIENCE", 0.3)
    monkeypatch.setattr(chromium, "FAREWELL", 0.1)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(DrapeplanError, match="browser") as error, Chromium(SIZE):
        pass
    assert "\n" not in str(error.value)
    assert [path.name for path in tmp_path.iterdir()] == ["browser"]


def test_no_browser_is_bad_input(drapeplan, monkeypatch, tmp_path):
    monkeypatch.delenv("DRAPEPLAN_BROWSER", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    output = tmp_path / "x.png"
    ended = drapeplan("preview", tmp_path / "no.json", "-o", output, "--png", "1")
    assert (ended.code, ended.err.count("\n")) == (2, 1)
    assert "no Chromium found" in ended.line
    assert "DRAPEPLAN_BROWSER" in ended.line


@pytest.fixture
def command(drapeplan, monkeypatch, tmp_path):
    """Preview command that takes no pictures: what it would ask for, as bytes."""

    def paint(views, places, camera, size):
        for place in places:
            yield f"{len(views)} {place} {camera} {size}".encode()

    monkeypatch.setattr(commands_preview, "_views", lambda files: [view_of_steps()])
    monkeypatch.setattr("viewer.picture.pictures", paint)
    monkeypatch.setattr("viewer.chromium.find_browser", lambda: "chromium")

    def run(*arguments):
        return drapeplan("preview", "plan.json", "-o", tmp_path / "a.png", *arguments)

    return run


def test_one_moment_is_one_file(command, tmp_path):
    ended = command("--png", "1", "--view", "Top", "--size", "640x480", "--json")
    assert ended.document["written"] == [str(tmp_path / "a.png")]
    assert (tmp_path / "a.png").read_text() == "1 7 Top (640, 480)"


def test_several_moments_are_several_files(command, tmp_path):
    assert command("--png", "1, 2,pose=3").code == 0
    files = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert files == {
        "a-1.png": "1 7 None (1280, 720)",
        "a-2.png": "1 11 None (1280, 720)",
        "a-pose-3.png": "1 2 None (1280, 720)",
    }


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--png", "9"], "no 9"),
        (["--png", "1,1"], "same command"),
        (["--png", "1", "--size", "10x10"], "--size"),
        (["--png", "1", "--size", "0"], "--size"),
        (["--png", "1", "--view", "Up"], "Up"),
        (["--view", "Top"], "--png"),
    ],
)
def test_mistakes_are_one_line(command, tmp_path, arguments, word):
    ended = command(*arguments)
    assert (ended.code, ended.err.count("\n")) == (2, 1), ended.err
    assert word in ended.line
    assert list(tmp_path.iterdir()) == []


def test_three_plans_are_too_many(drapeplan, tmp_path):
    ended = drapeplan(
        "preview", "a.json", "b.json", "c.json", "-o", tmp_path / "x.html"
    )
    assert (ended.code, ended.err.count("\n")) == (2, 1)
    assert "c.json" in ended.line


def test_browser_is_the_one_asked_for(monkeypatch, tmp_path):
    monkeypatch.setenv("DRAPEPLAN_BROWSER", shell(tmp_path, "exit"))
    assert chromium.find_browser() == find_browser()
    monkeypatch.setenv("DRAPEPLAN_BROWSER", "/no/browser")
    with pytest.raises(InputError, match="/no/browser"):
        chromium.find_browser()
