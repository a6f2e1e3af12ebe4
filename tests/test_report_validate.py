"""The figure of a validation: the same bytes, the right colors in the right places."""

import io

import numpy as np
import pytest
from PIL import Image

from drapeplan.errors import InputError
from drapeplan.report_validate import validation_figure
from drapeplan.validate import validate
from tests.scans import make_scan, truth_cups


def drawn(path, case, **scan_settings):
    cups, surface = truth_cups(case)
    validation_figure(
        path, validate(cups, make_scan(surface, **scan_settings)), "a ply"
    )
    return np.asarray(Image.open(io.BytesIO(path.read_bytes())).convert("RGB"), float)


def share(pixels, color, within=60):
    return np.mean(np.linalg.norm(pixels - np.array(color), axis=-1) < within)


RED, BLUE = (150, 20, 40), (20, 70, 130)


@pytest.mark.parametrize("height", [4e-3, -4e-3])
def test_a_bump_is_red_and_a_dent_blue(tmp_path, height):
    bump = (0.275, 0.11, height, 0.02)
    pixels = drawn(tmp_path / "a.png", "C_sph2000", bump=bump, count=4000)
    error = pixels[2 * len(pixels) // 3 :, : int(0.8 * pixels.shape[1])]  # no color bar
    above, below = share(error, RED), share(error, BLUE)
    assert (above > 10 * below) if height > 0 else (below > 10 * above)


def test_same_bytes_again_and_three_in_a_row_where_the_ply_is_square(tmp_path):
    for name in ("a.png", "b.png"):
        pixels = drawn(tmp_path / name, "B_lift20_flatcup", noise=5e-4, count=2000)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert pixels.shape[1] > 2 * pixels.shape[0]


def test_folder_that_takes_no_file(tmp_path):
    cups, surface = truth_cups("B_sph2000")
    found = validate(cups, make_scan(surface, count=1000))
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError):
        validation_figure(tmp_path / "file" / "a.png", found, "a ply")
