"""The first-touch figure: what stands in it, and that it is always the same."""

import numpy as np
import pytest
from matplotlib import image

from drapeplan.errors import InputError
from drapeplan.front import check_front
from drapeplan.report import first_touch_figure
from tests.front_samples import MM, box, distance, growing_disk, make_grid

RED = np.array([214, 39, 40]) / 255  # of what went wrong
NEAR = 0.02  # [-] a color channel's distance that still is the same color


def draw(path, poses=40, spoil=False, **options):
    """Figure of a growing disk, on request with an early contact; its pixels."""
    grid = make_grid()
    gap, placed, landing = growing_disk(grid, poses)
    if spoil:
        gap[10:16, box(grid, (0.29, 0.33), (0.2, 0.24))] = -2 * MM
    verdict = check_front(gap, 0 * gap[0], grid, placed, landing)
    assert verdict.in_order != spoil
    first_touch_figure(
        path,
        grid.s,
        grid.t,
        options.pop("first_touch", verdict.first_touch),
        np.linspace(0, 4, poses),
        grid.cup_centers,
        grid.start_cup,
        verdict.events,
        "A growing disk",
        premature_region=verdict.premature_region,
        pocket_region=verdict.pocket_region,
        **options,
    )
    return image.imread(path)[..., :3]


def share(pixels, color):
    """Part of the pixels that have a color."""
    return (np.abs(pixels - color).max(axis=-1) < NEAR).mean()


def test_faults_are_red_and_only_faults(tmp_path):
    assert share(draw(tmp_path / "good.png"), RED) == 0
    assert share(draw(tmp_path / "bad.png", spoil=True), RED) > 0.001


def test_early_is_dark_blue_and_late_is_yellow(tmp_path):
    grid = make_grid()
    r = distance(grid, grid.cup_centers[grid.start_cup])
    pixels = draw(tmp_path / "figure.png", first_touch=39 * r / r.max())
    height, width = pixels.shape[:2]
    ply = pixels[height // 8 : 3 * height // 4, width // 8 : 3 * width // 4]
    blue = ply[..., 2] - ply[..., 0]
    i, j = np.nonzero(blue > 0.25)
    # Start cup (1, 1) of 3 x 4: left of the middle, where the front begins.
    assert 0.2 < j.mean() / ply.shape[1] < 0.5
    assert 0.3 < i.mean() / ply.shape[0] < 0.8
    assert (blue < -0.2).mean() > 0.02


def test_same_arguments_give_the_same_bytes(tmp_path):
    draw(tmp_path / "one.png", spoil=True)
    draw(tmp_path / "two.png", spoil=True)
    one, two = ((tmp_path / name).read_bytes() for name in ("one.png", "two.png"))
    assert one == two
    assert b"tIME" not in one
    assert b"matplotlib" not in one.lower()
    assert sorted(file.name for file in tmp_path.iterdir()) == ["one.png", "two.png"]


def test_nothing_is_left_behind_when_writing_fails(tmp_path):
    target = tmp_path / "taken.png"
    target.mkdir()
    with pytest.raises(InputError, match="taken"):
        draw(target)
    assert [file.name for file in tmp_path.iterdir()] == ["taken.png"]


@pytest.mark.parametrize("value", [np.inf, 0.0])
def test_ply_that_never_or_at_once_touches(tmp_path, value):
    first_touch = np.full(make_grid().areas.shape, value)
    pixels = draw(tmp_path / "figure.png", first_touch=first_touch)
    gray = np.array([227, 227, 227]) / 255
    assert (share(pixels, gray) > 0.2) == np.isinf(value)
