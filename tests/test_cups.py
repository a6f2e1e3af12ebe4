import copy
import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from drapeplan.cups import read_cups, shape_report, shape_table, write_csv
from drapeplan.errors import InputError
from drapeplan.shape_models import hold
from ply.shape import evaluate, ply_fibers

PRINTED = 5.1e-7  # [mm] half a unit of the last printed decimal
ROUNDING = 1e-12  # [mm] float64 noise on a ply below 1 m

FLAT = {
    "format": "drapeplan-cups/1",
    "grid": {"rows": 2, "columns": 3, "pitch_mm": 110.0, "half_width_mm": 20.0},
    "cups": [
        {
            "row": row,
            "column": column,
            "position_mm": [110 * column, 110 * row, 0],
            "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        }
        for row in range(2)
        for column in range(3)
    ],
}


@pytest.fixture
def write(tmp_path):
    """Write a cups file, altered by functions of the document."""

    def written(*changes):
        document = copy.deepcopy(FLAT)
        for change in changes:
            change(document)
        path = tmp_path / "cups.json"
        path.write_text(json.dumps(document))
        return path

    return written


def put(*keys):
    """A change that sets document[keys[0]]...[keys[-2]] to keys[-1]."""

    def change(document):
        for key in keys[:-2]:
            document = document[key]
        document[keys[-2]] = keys[-1]

    return change


def remove(*keys):
    def change(document):
        for key in keys[:-1]:
            document = document[key]
        del document[keys[-1]]

    return change


def turned(angle):
    """Rotation about s, as a list."""
    c, s = np.cos(angle), np.sin(angle)
    return [[1, 0, 0], [0, c, -s], [0, s, c]]


def test_cups_are_read_in_order_and_in_si(write):
    path = write(
        lambda document: document["cups"].reverse(),
        put("cups", 5, "position_mm", [1, 2, 3]),
        put("cups", 5, "rotation", turned(0.1)),
        put("grid", "s_length_mm", 70.5),
        put("take_up_mm", 0.8),
        put("pose_sigma_mm", 0.3),
        put("pose_sigma_deg", 0.5),
    )
    cups = read_cups(path)
    assert (cups.grid.rows, cups.grid.columns) == (2, 3)
    assert cups.grid.s_length == pytest.approx(0.0705)
    assert cups.grid.t_length == pytest.approx(0.07)
    assert_allclose(cups.positions[0], [1e-3, 2e-3, 3e-3])
    assert_allclose(cups.positions[4], [0.11, 0.11, 0])
    assert_allclose(cups.rotations[0], turned(0.1))
    assert (cups.take_up, cups.pose_sigma) == pytest.approx((0.8e-3, 0.3e-3))
    assert cups.pose_sigma_angle == pytest.approx(np.deg2rad(0.5))


def test_allowances_may_stand_inside_the_grid(write):
    assert read_cups(write(put("grid", "take_up_mm", 0.8))).take_up == 0.8e-3
    assert read_cups(write()).take_up == 0


@pytest.mark.parametrize(
    ("change", "key", "words"),
    [
        (put("format", "drapeplan-cups/2"), "format", "drapeplan-cups/1"),
        (remove("grid", "rows"), "grid.rows", "add it"),
        (put("grid", "pich_mm", 1.0), "grid.pich_mm", "spelling"),
        (put("grid", "rows", 0), "grid.rows", "greater than or equal to 1"),
        (put("grid", "rows", 2.5), "grid.rows", "integer"),
        (put("grid", "rows", "2"), "grid.rows", "integer"),
        (put("grid", "half_width_mm", 55.0), "grid.half_width_mm", "half the pitch"),
        (put("grid", "pitch_mm", -110.0), "grid.pitch_mm", "greater than 0"),
        (put("grid", "s_length_mm", 0.0), "grid.s_length_mm", "greater than 0"),
        (put("grid", "rows", 10**9), "cups", "6 of 3000000000 cups"),
        (put("take_up_mm", -0.1), "take_up_mm", "greater than or equal to 0"),
        (remove("cups", 4), "cups", "the first missing is cup (row 1, column 1)"),
        (put("cups", []), "cups", "0 of 6 cups"),
        (put("cups", 4, "row", 0), "cups[4]", "stands in cups[1] already"),
        (put("cups", 4, "row", 7), "cups[4]", "(row 7, column 1) is outside 2 rows"),
        (put("cups", 4, "row", -1), "cups[4].row", "greater than or equal to 0"),
        (put("cups", 2, "position_mm", [0, 0]), "cups[2].position_mm[2]", "add it"),
        (put("cups", 2, "position_mm", 0, float("nan")), "position_mm[0]", "finite"),
        (put("cups", 2, "rotation", 1, 1, float("inf")), "rotation[1][1]", "finite"),
        (
            put("cups", 3, "rotation", 0, 0, 1.01),
            "cups[3].rotation",
            "cup (row 1, column 0): columns are off unit length or right angles by 0",
        ),
        (put("cups", 3, "rotation", 2, 2, -1), "cups[3].rotation", "left-handed"),
    ],
)
def test_mistakes_are_named_with_file_key_and_remedy(write, change, key, words):
    path = write(change)
    with pytest.raises(InputError) as caught:
        read_cups(path)
    assert caught.value.exit_code == 2
    assert caught.value.source == str(path)
    assert caught.value.key.endswith(key)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_allowance_given_twice_is_refused(write):
    path = write(put("take_up_mm", 0.1), put("grid", "take_up_mm", 0.2))
    with pytest.raises(InputError, match="give it once"):
        read_cups(path)


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe\x00", b"[]", b"null"])
def test_files_that_are_no_cups_file_are_refused(tmp_path, content):
    path = tmp_path / "cups.json"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"cups\.json") as caught:
        read_cups(path)
    assert "\n" not in str(caught.value)


def test_missing_files_and_folders_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_cups(tmp_path / "none.json")
    with pytest.raises(InputError, match="cannot be read"):
        read_cups(tmp_path)
    with pytest.raises(InputError, match="cannot be read"):
        shape_table(read_cups_flat(tmp_path), "quartic", tmp_path / "none.csv")


def read_cups_flat(folder):
    (folder / "flat.json").write_text(json.dumps(FLAT))
    return read_cups(folder / "flat.json")


def test_regular_table_of_a_flat_ply(write):
    rows = shape_table(read_cups(write()), step=0.01)
    assert rows.shape == (27 * 16, 5)
    assert_allclose(rows[:, 2:4], rows[:, :2], rtol=0, atol=ROUNDING)
    assert_allclose(rows[:, 4], 0, rtol=0, atol=ROUNDING)
    assert_allclose(rows[[0, 1, 27], :2], [[-20, -20], [-10, -20], [-20, -10]])


def test_points_keep_their_order_and_their_coordinates(write, tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("t_mm, s_mm,note\n0.1,55,a\n\n-20,-30,overhang\n55,55,b\n")
    tilt = put("cups", 1, "rotation", turned(0.05))
    cups = read_cups(write(tilt, put("cups", 1, "position_mm", [110, 0.5, 0])))
    rows = shape_table(cups, "quartic", path)
    assert_array_equal(rows[:, :2], [[55, 0.1], [-30, -20], [55, 55]])
    fibers = ply_fibers(cups.grid, cups.positions, cups.rotations)
    points_st = rows[:, :2] / 1e3
    expected = evaluate(cups.grid, fibers, cups.positions, cups.rotations, points_st)
    assert_allclose(rows[:, 2:], 1e3 * expected, rtol=0, atol=ROUNDING)
    again = shape_table(cups, "cubic", path)
    assert abs(again - rows).max() > 1e-3  # [mm] the models differ


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no column s_mm"),
        ("s_mm\n1\n", "no column t_mm"),
        ("s_mm,t_mm\n", "no points"),
        ("s_mm,t_mm\n1,2\n1,two\n", "line 3"),
        ("s_mm,t_mm\n1\n", "line 2"),
        ("s_mm,t_mm\n1,2\nnan,2\n", "point 2 at (nan, 2) mm is off the ply"),
        ("s_mm,t_mm\n1,221\n", "point 1 at (1, 221) mm is off the ply"),
    ],
)
def test_bad_points_files_are_refused(write, tmp_path, text, words):
    path = tmp_path / "points.csv"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        shape_table(read_cups(write()), "quartic", path)
    assert words in str(caught.value)
    assert caught.value.source == str(path)


@pytest.mark.parametrize("model", ["automatic", "Quartic"])
def test_an_unknown_model_names_the_known_ones(write, model):
    with pytest.raises(InputError, match="choose from auto, cubic"):
        shape_table(read_cups(write()), model)
    with pytest.raises(InputError, match="choose from auto, cubic"):
        shape_report(read_cups(write()), model)


@pytest.mark.parametrize("step", [0.015, 0.0, -0.01, float("nan")])
def test_a_step_that_fits_no_cup_is_refused(write, step):
    with pytest.raises(InputError, match="cups are 40 mm wide, spans 70 mm"):
        shape_table(read_cups(write()), step=step)


def failing(report):
    return [entry["text"] for entry in report["failing"]]


def test_report_counts_and_names_failing_fibers(write):
    path = write(
        put("cups", 1, "position_mm", [109.5, 0, 0]),
        put("cups", 2, "position_mm", [220, 0, 0]),
    )
    report = shape_report(read_cups(path))
    assert report["fibers"] == 14
    assert sum(report["status"].values()) == 14
    assert report["status"]["overstretched"] == 4  # two of them drawn aside along t
    assert failing(report)[:3] == [
        "s fiber (row 0, columns 0-1), lateral -20 mm: 0.5 mm of slack: bows up to "
        "3.8 mm, to a side that parallel cups leave open",
        "s fiber (row 0, columns 0-1), lateral +20 mm: 0.5 mm of slack: bows up to "
        "3.8 mm, to a side that parallel cups leave open",
        "s fiber (row 0, columns 1-2), lateral -20 mm: overstretched: its ends are "
        "0.5 mm further apart than its length",
    ]
    assert failing(report)[-1].startswith(
        "t fiber (column 1, rows 0-1), lateral +20 mm"
    )
    assert report["failing"][0]["excess_mm"] == pytest.approx(-0.5)
    assert report["failing"][2]["status"] == "overstretched"


def test_report_names_curves_that_cannot_be_shortened(write):
    tilted = [
        put("cups", n, "rotation", turned(np.deg2rad(-10 if n < 3 else 10)))
        for n in range(6)
    ]
    chord = 69.95  # [mm] between the rims; a curve at 10 deg needs 70 at 69.64
    reach = 20 * np.cos(np.deg2rad(10))
    moved = [
        put(
            "cups", n, "position_mm", [110 * (n % 3), (n // 3) * (chord + 2 * reach), 0]
        )
        for n in range(6)
    ]
    report = shape_report(read_cups(write(*tilted, *moved)))
    assert report["status"]["too_long"] == 6
    text = failing(report)[0]
    assert text.startswith(
        "t fiber (column 0, rows 0-1), lateral -20 mm: too long by 0."
    )
    assert 0.2 < report["failing"][0]["excess_mm"] < 0.4


def test_report_with_take_up_judges_the_band(write):
    path = write(put("take_up_mm", 0.3), put("cups", 1, "position_mm", [109.5, 0, 0]))
    report = shape_report(read_cups(path))
    assert report["length"] == {"in_band": 10, "too_short": 2, "slack": 2}
    assert (
        "0.5 mm of slack, more than its take-up: bows up to 2.4 mm"
        in failing(report)[0]
    )
    wide = write(put("take_up_mm", 0.6), put("cups", 1, "position_mm", [109.5, 0, 0]))
    assert shape_report(read_cups(wide))["failing"] == []


def test_sound_cups_have_an_empty_report(write):
    for model in ("quartic", "cubic"):
        report = shape_report(read_cups(write()), model)
        assert report["status"]["met"] == 14
        assert report["failing"] == []


def test_table_is_written_whole(write, tmp_path):
    rows = shape_table(read_cups(write(put("cups", 1, "rotation", turned(0.02)))))
    path = tmp_path / "out.csv"
    path.write_text("old")
    write_csv(path, rows)
    assert path.read_text().startswith("s_mm,t_mm,x_mm,y_mm,z_mm\n-20.000000,")
    again = np.loadtxt(path, delimiter=",", skiprows=1)
    assert_allclose(again, rows, rtol=0, atol=PRINTED)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["cups.json", "out.csv"]


def test_a_table_that_cannot_be_written_leaves_nothing(tmp_path):
    (tmp_path / "taken").mkdir()
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "file" / "out.csv", tmp_path / "taken"):
        with pytest.raises(InputError, match="cannot write it"):
            write_csv(path, np.zeros((1, 5)))
    assert sorted(file.name for file in tmp_path.iterdir()) == ["file", "taken"]


def test_modal_shape_of_uncertain_poses_follows_reconciled_ones(write):
    """0.2 mm of spacing error bows 2.4 mm without a stated uncertainty, 0 with one."""
    shift = put("cups", 1, "position_mm", [109.8, 0, 0])
    tables = [
        shape_table(read_cups(write(shift, *more)), "modal")
        for more in ((), (put("pose_sigma_mm", 0.25), put("pose_sigma_deg", 0.25)))
    ]
    bows = [abs(table[:, 4]).max() for table in tables]
    assert bows[0] > 2
    assert bows[1] < 0.3


def test_modal_report_names_the_middle_fiber_of_a_strip(write):
    stretch = put("cups", 1, "position_mm", [113, 0, 0])
    report = shape_report(read_cups(write(stretch)), "modal")
    assert report["fibers"] == 21
    laterals = [one["fiber"].rsplit("lateral ")[1] for one in report["failing"]]
    assert laterals[:3] == ["-20 mm", "+0 mm", "+20 mm"]
    assert {one["status"] for one in report["failing"][:3]} == {"overstretched"}


def test_the_block_of_the_ply(write):
    """Gravity needs mass and stiffness; up may have any length."""
    block = {"areal_mass_kg_m2": 0.5, "bending_stiffness_Nm": 1e-3, "overhang_mm": 30}
    cups = read_cups(write(put("ply", block | {"up": [0, 2.0, 0]})))
    assert_allclose(cups.weight(), [0, -0.5 * 9.81, 0], rtol=1e-12)
    assert cups.overhang == pytest.approx(0.03)
    for missing in ("areal_mass_kg_m2", "bending_stiffness_Nm"):
        part = {key: value for key, value in block.items() if key != missing}
        assert read_cups(write(put("ply", part))).weight() == (0, 0, 0)
    assert read_cups(write()).weight() == (0, 0, 0)


@pytest.mark.parametrize(
    ("block", "key"),
    [
        ({"areal_mass_kg_m2": 310}, "ply.areal_mass_kg_m2"),
        ({"areal_mass_kg_m2": -1}, "ply.areal_mass_kg_m2"),
        ({"bending_stiffness_Nm": 0}, "ply.bending_stiffness_Nm"),
        ({"overhang_mm": 95}, "ply.overhang_mm"),
        ({"up": [0, 0, 0]}, "ply.up"),
        ({"mass": 1}, "ply.mass"),
    ],
)
def test_a_wrong_block_of_the_ply_is_named(write, block, key):
    with pytest.raises(InputError) as caught:
        read_cups(write(put("ply", block)))
    assert caught.value.key == key


def test_a_heavy_ply_sags_in_every_ladder_model(write):
    """What is said of gravity is what the shape has; the paper's models have none."""
    block = {"areal_mass_kg_m2": 0.5, "bending_stiffness_Nm": 1e-3, "overhang_mm": 30}
    heavy, plain = read_cups(write(put("ply", block))), read_cups(write())
    for model in ("auto", "modal", "coupled", "quartic"):
        table = shape_table(heavy, model)
        inside = (table[:, :2].min(axis=1) >= -20) & (table[:, 0] <= 240)
        inside &= table[:, 1] <= 130
        fall = shape_table(plain, model)[:, 4] - table[inside, 4]
        tip = table[~inside, 4].min()
        said = {e["effect"]: e for e in shape_report(heavy, model)["effects"]}
        modeled = said["gravity between the cups"]["modeled_cells"] > 0
        assert modeled == (model != "quartic")
        assert (tip < -1.0) == modeled
        if model != "modal":  # taut fibers do not stretch, so they hardly sag
            assert (fall.max() > 0.2) == modeled


def test_points_beyond_the_overhang_are_off_the_ply(write, tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("s_mm,t_mm\n-45,0\n")
    assert len(shape_table(read_cups(write()), "modal", path)) == 1
    with pytest.raises(InputError, match="off the ply"):
        shape_table(read_cups(write(put("ply", {"overhang_mm": 20}))), "modal", path)


def test_verdicts_speak_of_the_shape_that_is_shown(write):
    """Least energy comes first, and the report has its sides."""
    cups = read_cups(write(put("cups", 1, "position_mm", [109.5, 0, 0])))
    held = hold(cups, "coupled")[0]
    middle = held.points(0.055, 0.0) - held.points([0.0], 0.0)[0]
    assert np.sign(middle[2]) == held.fibers.sides.s[0, 0] != 0
