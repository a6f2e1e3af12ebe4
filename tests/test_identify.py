"""Identification from simulated measurements, files and command included."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from benchmarks.identify import (
    PITCH,
    Truth,
    cylinder,
    flat,
    recorded,
    scan_of,
    simulate,
)
from drapeplan.errors import InputError
from drapeplan.identify import identify
from drapeplan.identify_cups import see_cups
from drapeplan.identify_file import Links, Measurements
from drapeplan.identify_strips import see_strips
from drapeplan.identify_words import blocks, notes
from drapeplan.scan import Scan
from drapeplan.scene import read_scene
from ply.grid import CupGrid
from tests.plans import EXAMPLES
from tests.settled import tool_section

MM = 1e-3  # [m]
GRID = CupGrid(3, 5, PITCH, 0.02)
TRUTH = Truth(density=25e3)
EXACT = replace(TRUTH, position=0.0, angle=0.0, scan=1e-9)
CURVE = 2e-6  # [m] of a length: arcs against the model's mean squared speed
MEASURED = EXAMPLES / "identify" / "measurements.yaml"
TRIALS = 12


def exact(cups):
    """Strips of a scan without errors."""
    return see_strips(see_cups(cups, scan_of(cups, EXACT, np.random.default_rng(0))))


def only(cups, truth=TRUTH, seed=0, links=None):
    """What one scan says."""
    random = np.random.default_rng(seed)
    scan = scan_of(cups, truth, random)
    return identify(Measurements(None, ((recorded(cups, truth, random), scan),), links))


@pytest.mark.parametrize(
    ("cups", "sign"), [(cylinder(GRID, 0.28), 1), (flat(GRID, 1 * MM), -1)]
)
def test_strips_out_of_the_band_show_the_take_up(cups, sign):
    """Fibers too short and too long, to micrometers."""
    strips = exact(cups)
    out = strips.out != 0
    assert out.sum() == (12 if sign > 0 else 22)
    assert (strips.out[out] == sign).all()
    take_up = sign * (strips.length - strips.rest)[out]
    assert_allclose(take_up, EXACT.take_up, atol=CURVE)


def test_strips_in_the_band_have_what_their_cups_ask_for():
    strips = exact(flat(GRID, 0.3 * MM))
    assert not strips.out.any()
    assert_allclose(strips.length, strips.asked, atol=CURVE)
    assert (strips.rise < -5e-6).all()  # they sag


def test_strips_pulled_straight_do_not_count():
    strips = exact(cylinder(GRID, 0.33))
    assert strips.pulled.sum() == 12
    assert not strips.out.any()


def test_cups_are_seen_where_they_are():
    cups = cylinder(GRID, 0.2)
    random = np.random.default_rng(5)
    off = recorded(cups, TRUTH, random)
    seen = see_cups(off, scan_of(cups, EXACT, random))
    away = np.vecdot(cups.positions - seen.cups.positions, cups.rotations[..., 2])
    assert abs(away).max() < 5e-6  # the tilt's over 0.3 mm
    cosines = np.vecdot(cups.rotations[..., 2], seen.cups.rotations[..., 2])
    assert np.degrees(np.arccos(cosines.min())) < 0.01
    assert abs(seen.heights).max() > 0.2 * MM


def test_strays_and_registration_change_little():
    """A twentieth of the points anywhere, and a scanner that stands elsewhere."""
    random = np.random.default_rng(8)
    cups = flat(GRID, 1 * MM)
    off, scan = recorded(cups, TRUTH, random), scan_of(cups, TRUTH, random)
    plain = identify(Measurements(None, ((off, scan),)))
    points = scan.points.copy()
    points[::20] += random.uniform(-5e-3, 5e-3, points[::20].shape)
    turn = Rotation.from_euler("xyz", [0.8, 0.6, 0.0], degrees=True)
    moved = identify(
        Measurements(None, ((off, Scan(turn.apply(points) + np.array([0, 0, 1e-3]))),))
    )
    for name in ("position", "angle", "take_up"):
        before, after = getattr(plain, name), getattr(moved, name)
        assert after.value == pytest.approx(before.value, rel=0.1), name


def test_known_links_pin_the_take_up():
    cups = cylinder(GRID, 0.28)
    alone, linked = only(cups), only(cups, links=Links(PITCH, 0.0, 0.05 * MM))
    widths = [one.take_up.high - one.take_up.low for one in (alone, linked)]
    assert widths[1] < widths[0] / 2


def test_likeliest_poses_leave_one_take_up():
    """Raw lengths scatter by the poses; mended ones lie where the band ends."""
    found = only(cylinder(GRID, 0.28), links=Links(PITCH, 0.0, 0.05 * MM))
    strips = found.looks[0].strips
    out = strips.out != 0
    raw = (strips.length - strips.rest)[out]
    mended = raw - found.likely[0][out]
    assert raw.std() > 0.2 * MM
    assert_allclose(mended, found.take_up.value, atol=0.05 * MM)


@pytest.mark.parametrize(("rows", "columns"), [(1, 2), (1, 4), (2, 2)])
def test_few_cups_end_in_words(rows, columns):
    """Lone rows and pairs: what all cups have in common leaves little or nothing."""
    found = only(flat(CupGrid(rows, columns, PITCH, 0.02)))
    assert found.take_up is None
    assert (found.position is None) == (rows * columns == 2)
    assert any(line.startswith("take-up: not seen") for line in notes(found))


def test_recovery_and_coverage():
    """Aims: 0.05 mm and 15 %; nine intervals of ten hold the truth."""
    found = [identify(simulate(seed, TRUTH, 3, 5)) for seed in range(TRIALS)]
    truths = {
        "take_up": ([one.take_up for one in found], TRUTH.take_up),
        "stiffness": ([one.stiffness["both"] for one in found], TRUTH.stiffness),
        "position": ([one.position for one in found], TRUTH.position),
        "angle": ([one.angle for one in found], TRUTH.angle),
    }
    for name, (estimates, truth) in truths.items():
        held = sum(e.low <= truth <= e.high for e in estimates)
        assert held >= 0.9 * TRIALS, name
        narrow = [(e.high - e.low) / 2 < 0.4 * truth for e in estimates]
        assert all(narrow), name
    errors = {
        n: [abs(e.value - truth) for e in es] for n, (es, truth) in truths.items()
    }
    assert max(errors["take_up"]) < 0.05 * MM
    assert max(errors["stiffness"]) < 0.15 * TRUTH.stiffness


def test_a_take_up_that_no_fiber_reaches_is_not_made_up():
    found = only(flat(GRID), seed=3)
    assert found.take_up is None
    assert "take_up_mm" not in blocks(found)["ply"]
    said = [line for line in notes(found) if line.startswith("take-up: not seen: the")]
    assert len(said) == 1
    assert "scan a shape that asks its fibers for more" in said[0]
    assert any(line.startswith("bending stiffness: not seen") for line in notes(found))


def test_few_strips_among_much_noise_say_nothing():
    noisy = replace(TRUTH, position=3 * MM)
    found = only(flat(CupGrid(2, 2, PITCH, 0.02), 1 * MM), noisy)
    assert found.take_up is None
    assert any("4 strips left the band" in line for line in notes(found))


def test_example_is_written_into_a_scene(drapeplan, tmp_path, monkeypatch):
    """And the scene plans: the small tool, links free of the equilibrium."""
    (tmp_path / "base").mkdir()
    base, new = tmp_path / "base" / "scene.yaml", tmp_path / "new" / "scene.yaml"
    data = yaml.safe_load((EXAMPLES / "panel.yaml").read_text())
    data |= {"tool": tool_section(tmp_path), "fidelity": "kinematic"}
    mesh = tmp_path / "base" / "panel.stl"
    mesh.write_bytes((EXAMPLES / "molds" / "panel.stl").read_bytes())
    data["mold"]["mesh"]["path"], data["tool"]["urdf"] = "panel.stl", "../small.urdf"
    base.write_text(yaml.safe_dump(data))
    figure = tmp_path / "fit.png"
    ended = drapeplan(
        *(
            "identify",
            MEASURED,
            "--scene",
            base,
            "-o",
            new,
            "--figure",
            figure,
            "--json",
        )
    )
    assert ended.code == 0, ended.err
    said = ended.document
    assert said["written"] == [str(new), str(figure)]
    assert figure.read_bytes()[:4] == b"\x89PNG"
    assert {row["quantity"]: row for row in said["estimates"]}["take-up"]["low"] < 0.5
    scene = read_scene(new)
    assert scene.ply.take_up_mm == said["ply"]["take_up_mm"]
    assert scene.ply.take_up_mm == pytest.approx(0.5, abs=0.05)
    assert scene.ply.bending_stiffness_Nm == pytest.approx(0.0199, rel=0.15)
    assert scene.uncertainty.position_mm == pytest.approx(0.3, rel=0.3)
    assert scene.uncertainty.angle_deg == pytest.approx(0.5, rel=0.3)
    assert scene.mold.mesh.path == "../base/panel.stl"
    old = read_scene(base)
    assert scene.ply.overhang_mm == old.ply.overhang_mm
    assert scene.sequence == old.sequence
    planned = drapeplan("plan", new, "-o", tmp_path / "plan.json", "--json")
    assert planned.code in (0, 1), planned.err
    assert planned.document["verdict"]["fibers"]["take_up_mm"] == scene.ply.take_up_mm


def test_table_without_files(drapeplan, tmp_path):
    ended = drapeplan("identify", MEASURED)
    assert ended.code == 0
    lines = ended.out.splitlines()
    assert lines[1].startswith("take-up  ")
    assert lines[1].endswith("mm    12 strips out of the band")
    assert len(lines) == 8


def test_block_without_a_scene(drapeplan, tmp_path):
    output = tmp_path / "block.yaml"
    strips = tmp_path / "strips.yaml"
    data = yaml.safe_load(MEASURED.read_text())
    strips.write_text(yaml.safe_dump({k: data[k] for k in ("format", "cantilever")}))
    ended = drapeplan("identify", strips, "-o", output)
    assert ended.code == 0
    block = yaml.safe_load(output.read_text())
    assert set(block["ply"]) == {"areal_mass_kg_m2", "bending_stiffness_Nm"}
    assert set(block["uncertainty"]) == {"stiffness_log"}
    assert "take-up and pose noise: not seen: add scans" in ended.out


STRIP = {"overhang_mm": 200, "drop_mm": 30}
MISTAKES = {
    "spelling": ({"cantilver": {}}, "cantilver: unknown key; did you mean cantilever?"),
    "nothing": ({}, "give cantilever, scans or both"),
    "two strips": ({"warp": [STRIP] * 2}, "cantilever.warp: "),
    "both readings": (
        {"warp": [STRIP, STRIP, {**STRIP, "incline_deg": 41.5}]},
        "cantilever.warp.2: give either drop_mm or incline_deg",
    ),
    "hangs down": (
        {"weft": [STRIP, {**STRIP, "drop_mm": 199}, STRIP]},
        "cantilever.weft.1.drop_mm: 199 mm of 200 mm hang down; let less",
    ),
    "stiff": (
        {"weft": [STRIP, {**STRIP, "drop_mm": 1}, STRIP]},
        "cantilever.weft.1.drop_mm: 1 mm of 200 mm tell nothing; let more",
    ),
    "upright": (
        {"warp": [{"overhang_mm": 200, "incline_deg": 85}] * 3},
        "cantilever.warp.0.incline_deg: 85 deg is all but upright; let less",
    ),
    "no scan": ({"scans": [{"cups": "no.json", "scan": "no.csv"}]}, "no.json: no such"),
}


@pytest.mark.parametrize(("change", "words"), MISTAKES.values(), ids=list(MISTAKES))
def test_mistakes_are_one_line(drapeplan, tmp_path, change, words):
    if "warp" in change or "weft" in change:
        change = {"cantilever": {"areal_mass_kg_m2": 0.31, **change}}
    path = tmp_path / "measured.yaml"
    path.write_text(yaml.safe_dump({"format": "drapeplan-measurements/1", **change}))
    ended = drapeplan("identify", path)
    assert ended.code == 2
    assert words in ended.line
    assert str(tmp_path) in ended.line
    assert ended.err.count("\n") == 1


def test_inputs_are_never_overwritten(drapeplan, tmp_path):
    scene = tmp_path / "scene.yaml"
    scene.write_text((EXAMPLES / "paraboloid.yaml").read_text())
    before = scene.read_bytes()
    ended = drapeplan("identify", MEASURED, "--scene", scene, "-o", scene)
    assert ended.code == 2
    assert "would replace a file of the same command" in ended.line
    assert scene.read_bytes() == before
    assert drapeplan("identify", MEASURED, "--scene", scene).code == 2


def test_a_scan_elsewhere_is_refused():
    cups = flat(GRID)
    scan = scan_of(cups, TRUTH, np.random.default_rng(0))
    away = Scan(scan.points + np.array([2.0, 0, 0]), "away.csv")
    with pytest.raises(InputError, match=r"away\.csv: shows 0 of the 15 cups"):
        identify(Measurements(None, ((cups, away),)))
