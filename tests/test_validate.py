"""Errors that were put into a scan come out of its validation; and the command."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from drapeplan.compare import Place
from drapeplan.errors import InputError
from drapeplan.scan import Scan
from drapeplan.validate import model_surface, validate
from drapeplan.validate_words import table
from tests.plans import EXAMPLES
from tests.scans import make_scan, truth_cups, write_cups, write_scan

EXAMPLE = EXAMPLES / "validate"
NOISE = 5e-4  # [m] of the scans along each axis
SEPARATED = 5e-5  # [m] to which model error and noise are told apart
LENGTH = 1e-4  # [m] to which L_s and L_t come back


def made(case, model="quartic", **scan_settings):
    cups, surface = truth_cups(case)
    return validate(cups, make_scan(surface, **scan_settings), model)


@pytest.mark.parametrize("case", ["C_sph2000", "C_wave"])
def test_noise_adds_to_the_model_error_and_is_told_from_it(case):
    clean, noisy = made(case), made(case, noise=NOISE)
    assert noisy.noise == pytest.approx(NOISE, rel=0.03)
    together = np.hypot(clean.normal.rms, NOISE)
    assert noisy.normal.rms == pytest.approx(together, rel=0.03)
    assert noisy.rms_without_noise == pytest.approx(clean.normal.rms, abs=SEPARATED)
    assert clean.rms_without_noise == pytest.approx(clean.normal.rms, abs=SEPARATED)
    for estimate in noisy.lengths:
        assert estimate.length == pytest.approx(0.07, abs=LENGTH)


def test_scan_of_the_model_itself_has_no_error():
    cups, _ = truth_cups("C_wave")
    cups = replace(cups, lengths_given=(True, True))
    surface = model_surface(cups, "quartic")
    found = validate(cups, make_scan(surface))
    assert found.lengths == (None, None)
    assert found.normal.max < 1e-9
    assert found.z.max < 1e-9
    assert sum(found.points.values()) == 8000


@pytest.mark.parametrize("height", [2e-3, -2e-3])
def test_planted_bump_is_found_in_place_and_size(height):
    place = (0.165, 0.055)
    found = made("C_sph2000", noise=NOISE, bump=(*place, height, 0.015))
    plain = made("C_sph2000", noise=NOISE)
    assert np.hypot(found.worst.s - place[0], found.worst.t - place[1]) < 5e-3
    size = found.evidence.error(place) - plain.evidence.error(place)
    assert size == pytest.approx(height, rel=0.1)
    assert found.worst.error == pytest.approx(height, rel=0.25)  # the model errs too


def test_holes_change_nothing_elsewhere():
    whole = made("C_wave", noise=NOISE)
    holed = made("C_wave", noise=NOISE, hole=(0.275, 0.165, 0.03))
    assert holed.points[Place.FREE] < whole.points[Place.FREE] - 100
    assert holed.rms_without_noise == pytest.approx(whole.rms_without_noise, rel=0.2)
    for estimate in holed.lengths:
        assert estimate.length == pytest.approx(0.07, abs=LENGTH)


def test_offset_in_z_is_the_error_in_z():
    cups, _ = truth_cups("C_sph2000")
    cups = replace(cups, lengths_given=(True, True))
    points = make_scan(model_surface(cups, "quartic")).points + np.array([0, 0, 3e-3])
    found = validate(cups, Scan(points, "scan"))
    assert found.world_z.rms == pytest.approx(3e-3, abs=1e-8)
    assert found.world_z.max == pytest.approx(3e-3, abs=1e-8)
    assert found.normal.rms < 3e-3 < found.z.max + 1e-4


def turned(angle, points, rotations):
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return points @ turn.T, turn @ rotations, turn


def test_turning_the_scene_changes_world_z_alone():
    cups, surface = truth_cups("C_wave")
    scan = make_scan(surface, noise=NOISE)
    one = validate(cups, scan)
    positions, rotations, turn = turned(1.3, cups.positions, cups.rotations)
    steep = replace(cups, positions=positions, rotations=rotations)
    other = validate(steep, Scan(scan.points @ turn.T, "scan"))
    assert_allclose(other.z.rms, one.z.rms, atol=1e-8)
    assert_allclose(other.normal.max, one.normal.max, atol=1e-8)
    assert one.world_z is not None
    assert other.world_z is None


def test_table_and_stray_points_are_left_out():
    cups, surface = truth_cups("C_wave")
    scan = make_scan(surface, noise=NOISE)
    random = np.random.default_rng(9)
    floor = random.uniform([-1, -1, -0.6], [1, 1, -0.5], (500, 3))
    both = Scan(np.concatenate([scan.points, floor]), "scan")
    one, other = validate(cups, scan), validate(cups, both)
    assert other.points[Place.FREE] == one.points[Place.FREE]
    assert sum(other.points.values()) == 8500
    assert_allclose(other.z.max, one.z.max, atol=1e-9)


def test_single_strip():
    found = made("A_bend20_slack2", noise=NOISE)
    assert found.lengths[0].length == pytest.approx(0.07, abs=LENGTH)
    assert found.lengths[1] is None
    assert found.rms_without_noise < 4 * LENGTH


def test_scan_elsewhere_says_where_both_lie():
    cups, surface = truth_cups("C_wave")
    scan = make_scan(surface)
    with pytest.raises(
        InputError, match=r"the scan lies in x 9\d\d.*the cups of .* in x"
    ):
        validate(cups, Scan(scan.points + 1.0, "scan.csv"))
    with pytest.raises(InputError, match="try --unit m"):
        validate(cups, Scan(scan.points / 1000, "scan.csv"))


def test_scan_of_cups_alone_or_of_half_the_ply():
    cups, surface = truth_cups("C_wave")
    points = make_scan(surface).points
    near = np.linalg.norm(points[:, None] - cups.positions, axis=2).min(axis=1) < 0.02
    with pytest.raises(InputError, match=r"covers no fiber along s.*grid\.s_length_mm"):
        validate(cups, Scan(points[near], "scan.csv"))
    given = replace(cups, lengths_given=(True, True))
    with pytest.raises(InputError, match="lie over the free ply"):
        validate(given, Scan(points[near], "scan.csv"))
    half = validate(cups, Scan(points[points[:, 0] < 0.2], "scan.csv"))
    assert half.lengths[0].fibers < 36


def test_example(drapeplan):
    ended = drapeplan("validate", EXAMPLE / "cups.json", EXAMPLE / "scan.csv", "--json")
    assert (ended.code, ended.err) == (0, "")
    document = ended.document
    assert document["good"] is True
    assert document["rms_z_mm"] == pytest.approx(0.53, abs=0.02)
    assert document["noise_mm"] == pytest.approx(0.5, abs=0.02)
    assert document["s_length_mm"] == pytest.approx(70, abs=0.1)
    assert document["fibers"]["failing"] == []


def test_text_stands_beside_the_paper(drapeplan):
    ended = drapeplan("validate", EXAMPLE / "cups.json", EXAMPLE / "scan.csv")
    assert ended.code == 0
    for line in ("RMS error, z", "max error, z", "calculation time"):
        assert line in ended.out
    for number in ("1.6 mm", "4.6 mm", "< 1 s", "L_s 70.0"):
        assert number in ended.out


def test_limits_decide(drapeplan):
    files = EXAMPLE / "cups.json", EXAMPLE / "scan.csv"
    ended = drapeplan("validate", *files, "--rms-mm", "0.1")
    assert ended.code == 1
    assert "not good" in ended.out
    ended = drapeplan("validate", *files, "--max-mm", "1", "--json")
    assert ended.code == 1
    assert ended.document["good"] is False


def test_given_lengths_are_used(drapeplan, tmp_path):
    cups, surface = truth_cups("C_wave")
    path = write_cups(tmp_path / "cups.json", cups, s_length_mm=70.0, t_length_mm=70.2)
    scan = write_scan(tmp_path / "scan.csv", make_scan(surface, count=3000))
    document = drapeplan("validate", path, scan, "--json").document
    assert document["t_length_mm"] == pytest.approx(70.2)
    assert "s_length_estimate" not in document
    assert document["rms_z_mm"] > 0.5  # 0.2 mm too long shows


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["no.csv"], ["no.csv", "no such file"]),
        ([EXAMPLE / "scan.csv", "--model", "oracle"], ["--model", "oracle", "quartic"]),
        ([EXAMPLE / "scan.csv", "--unit", "m"], ["--unit"]),
        ([EXAMPLE / "scan.csv", "--figure", EXAMPLE / "scan.csv"], ["scan.csv"]),
    ],
)
def test_one_clear_line(drapeplan, arguments, words):
    ended = drapeplan("validate", EXAMPLE / "cups.json", *arguments)
    assert (ended.code, ended.out) == (2, "")
    for word in words:
        assert word in ended.line


def test_document_is_plain_and_table_short():
    found = made("C_cyl600")
    assert all(len(line) < 100 for line in table(found))
    assert json.loads(json.dumps(found.report)) == found.report
