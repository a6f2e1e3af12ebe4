import copy
import math
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from drapeplan.errors import InputError
from drapeplan.legs import grid_universals
from urdf import read_tool, tool_names
from urdf.arm import arm_names, bound_joints, read_arm
from urdf.check import check_tool
from urdf.generate import sidecar_text, tool_sidecar, tool_urdf, write_tool
from urdf.sidecar import neighbor_pairs, read_sidecar
from urdf.spec import RESILIENT, RIGID, SpecError, ToolSpec

DIGITS = 1e-11  # [m, rad, kg] the twelve digits that a URDF has
SMALL = ToolSpec("small", rows=4, columns=3)


def joints(urdf):
    return {j.get("name"): j for j in ElementTree.fromstring(urdf).findall("joint")}


def check(urdf, sidecar):
    tool = read_sidecar(sidecar)
    depth = tool.universal_depth
    grid = grid_universals(tool.rows, tool.columns, tool.pitch, depth)
    check_tool(urdf, tool, grid)


@pytest.mark.parametrize("spec", [RIGID, RESILIENT], ids=lambda spec: spec.name)
def test_checked_in_files_equal_a_fresh_run(spec):
    urdf, sidecar = read_tool(spec.name)
    assert urdf == tool_urdf(spec)
    assert sidecar == sidecar_text(spec)


def test_default_tool_has_48_legs_and_82_links():
    urdf, sidecar = read_tool("drape_tool_6x8")
    kinds = [joint.get("type") for joint in joints(urdf).values()]
    assert kinds.count("revolute") == 5 * 48
    assert kinds.count("prismatic") == kinds.count("fixed") == 48
    tool = read_sidecar(sidecar)
    assert (tool.rows, tool.columns, len(tool.interlinks.pairs)) == (8, 6, 82)
    assert tool.interlinks.kind == "rigid"


def test_resilient_tool_bends_and_has_higher_balls():
    tool = read_sidecar(read_tool("drape_tool_6x8_resilient")[1])
    assert (tool.ball_height, tool.interlinks.bending_stiffness) == (0.010, 0.1)
    assert tool.interlinks.kind == "resilient"


@pytest.mark.parametrize(
    ("joint", "lower", "upper", "velocity"),
    [
        ("leg_7_5_ux", -15, 15, 1.0),
        ("leg_7_5_uy", -15, 15, 1.0),
        ("cup_7_5_sx", -40, 40, 1.0),
        ("cup_7_5_sy", -40, 40, 1.0),
        ("cup_7_5_sz", -15, 15, 1.0),
        ("leg_7_5_stroke", 0, math.degrees(0.300), 0.2),
    ],
)
def test_limits_live_in_the_urdf(joint, lower, upper, velocity):
    limit = joints(read_tool("drape_tool_6x8")[0])[joint].find("limit")
    given = [float(limit.get(key)) for key in ("lower", "upper", "velocity")]
    wanted = [math.radians(lower), math.radians(upper), velocity]
    assert_allclose(given, wanted, atol=DIGITS)


def test_masses_are_those_of_the_spec():
    """Platform and 48 legs; the cup's center of mass lies toward the platform."""
    root = ElementTree.fromstring(tool_urdf(RIGID))
    total = sum(float(mass.get("value")) for mass in root.iter("mass"))
    assert total == pytest.approx(12 + 48 * (0.45 + 0.10 + 0.06), abs=DIGITS)
    cup = next(link for link in root.iter("link") if link.get("name") == "cup_3_2")
    assert cup.find("inertial/origin").get("xyz") == "0 0 -0.0015"


def test_inertias_are_possible():
    """Positive, and no principal inertia beyond the sum of the other two."""
    for spec in (RIGID, RESILIENT, SMALL):
        for inertia in ElementTree.fromstring(tool_urdf(spec)).iter("inertia"):
            moments = np.array([float(inertia.get(k)) for k in ("ixx", "iyy", "izz")])
            assert (0 < moments).all()
            assert 2 * moments.max() < moments.sum() * (1 + DIGITS)


def test_platform_is_the_grid_and_a_margin():
    assert_allclose(RIGID.platform_size, [0.630, 0.850], atol=DIGITS)


def test_neighbors_come_along_s_first():
    wanted = [[0, 1], [1, 2], [3, 4], [4, 5], [0, 3], [1, 4], [2, 5]]
    assert_array_equal(neighbor_pairs(2, 3), wanted)


def test_more_than_ten_rows_have_names_of_their_own():
    spec = ToolSpec("long", rows=12, columns=2)
    urdf = tool_urdf(spec)
    assert len(joints(urdf)) == urdf.count("<joint ") == 7 * 24
    check(urdf, tool_sidecar(spec))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("name", "../evil"),
        ("name", ""),
        ("rows", 1),
        ("rows", 2.0),
        ("columns", 65),
        ("columns", True),
        ("pitch", math.inf),
        ("pitch", math.nan),
        ("pitch", "0.1"),
        ("half_width", 0.055),
        ("leg_min", 0.0),
        ("leg_max", 0.15),
        ("ball_limit", math.pi / 2),
        ("cup_mass", -0.06),
        ("yaw_stiffness", -1.0),
        ("interlink_kind", "soft"),
        ("interlink_bending_stiffness", 0.1),
    ],
)
def test_bad_fields_are_named(field, value):
    with pytest.raises(SpecError) as caught:
        ToolSpec(**{field: value})
    assert isinstance(caught.value, ValueError)
    assert caught.value.key == field


def test_resilient_links_need_a_stiffness():
    with pytest.raises(SpecError, match="more than zero"):
        ToolSpec(interlink_kind="resilient")


def test_links_hold_one_length_or_a_range():
    assert "length_range_m" not in tool_sidecar(RIGID)["interlinks"]
    rigid = read_sidecar(tool_sidecar(RIGID)).interlinks
    assert rigid.shortest == rigid.longest == rigid.length == 0.110
    spec = ToolSpec("loose", rows=2, columns=2, interlink_length_range=5e-4)
    loose = read_sidecar(sidecar_text(spec)).interlinks
    assert (loose.shortest, loose.longest) == pytest.approx((0.1095, 0.1105))
    sidecar = tool_sidecar(spec)
    for wrong in (-1e-3, 0.110, "1 mm"):
        sidecar["interlinks"]["length_range_m"] = wrong
        with pytest.raises(InputError, match="length_range_m"):
            read_sidecar(sidecar)
    with pytest.raises(SpecError, match="interlink_length_range"):
        ToolSpec("loose", interlink_length_range=0.2)


def test_written_tools_are_read_back(tmp_path):
    paths = write_tool(SMALL, tmp_path)
    assert sorted(tmp_path.iterdir()) == sorted(paths)
    urdf, sidecar = read_tool(tmp_path / "small.urdf")
    assert urdf == tool_urdf(SMALL)
    check(urdf, sidecar)


def test_names_are_read_from_anywhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert tool_names() == ["drape_tool_6x8", "drape_tool_6x8_resilient"]
    assert all(read_tool("drape_tool_6x8"))


def test_unknown_tool_lists_the_known_ones():
    with pytest.raises(InputError, match=r"drape_tool_6x8, drape_tool_6x8_resilient"):
        read_tool("drape_tool_5x5")


def test_missing_files_are_named(tmp_path):
    with pytest.raises(InputError, match=r"tool\.urdf: cannot be read"):
        read_tool(tmp_path / "tool.urdf")
    (tmp_path / "tool.urdf").write_text("<robot/>")
    with pytest.raises(InputError, match=r"tool\.yaml: cannot be read"):
        read_tool(tmp_path / "tool.urdf")
    (tmp_path / "tool.yaml").write_bytes(b"\xff\xfe\xfa")
    with pytest.raises(InputError, match="not UTF-8"):
        read_tool(tmp_path / "tool.urdf")


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("format", "drape-tool/2"),
        ("grid", None),
        ("grid.rows", 8.0),
        ("grid.pitch_m", "wide"),
        ("grid.pitch_m", math.nan),
        ("grid.half_width_m", 0.055),
        ("leg.max_m", 0.1),
        ("leg.ball_height_m", -0.005),
        ("names.face", "cup_{row}"),
        ("joint_stiffness.yaw_Nm_per_rad", -0.1),
        ("interlinks.kind", "soft"),
        ("interlinks.mass_kg", True),
        ("interlinks.length_m", 0),
        ("interlinks.pairs", []),
        ("interlinks.pairs", [[[0, 0], [0, 1]], [[0, 0]]]),
        ("interlinks.pairs", [[[0, 0], [1, 1]]]),
        ("interlinks.pairs", [[[0, 2], [0, 3]]]),
        ("interlinks.pairs", [[[0, 0], [0, -1]]]),
        ("interlinks.pairs", [[[0, 0], [0, 1]], [[0, 1], [0, 0]]]),
    ],
)
def test_bad_sidecars_name_the_key(key, value):
    data = copy.deepcopy(tool_sidecar(SMALL))
    *parents, last = key.split(".")
    section = data
    for parent in parents:
        section = section[parent]
    section[last] = value
    with pytest.raises(InputError) as caught:
        read_sidecar(data, "tool.yaml")
    assert caught.value.source == "tool.yaml"
    assert caught.value.key.startswith(key)


@pytest.mark.parametrize("text", ["", "7", "a: [", "[]", "format: drape-tool/1"])
def test_texts_that_are_no_sidecar(text):
    with pytest.raises(InputError, match=r"^sidecar"):
        read_sidecar(text)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('<child link="cup_1_1_face"/>', '<child link="cup_1_1_lip"/>'),
        ("leg_1_1_ux", "leg_1_1_vx"),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 -1"/>'),
        ('<origin xyz="0 0 0.15"/>', '<origin xyz="0 0 0.151"/>'),
        ('<origin xyz="0 0 0.15"/>', '<origin xyz="0 0 0.15" rpy="0 0 0.1"/>'),
        ('<origin xyz="0 0 0.005"/>', '<origin xyz="0 0 0.006"/>'),
        ('<parent link="leg_1_1_rod"/>', '<parent link="leg_1_1_tube"/>'),
        ('lower="0" upper="0.3"', 'lower="0" upper="0.31"'),
        ('lower="0" upper="0.3"', 'lower="-0.01" upper="0.3"'),
        (
            'name="leg_0_0_stroke" type="prismatic"',
            'name="leg_0_0_stroke" type="fixed"',
        ),
        (
            "</robot>",
            '<link name="a"/><joint name="b" type="revolute">'
            '<parent link="drape_base"/><child link="a"/></joint></robot>',
        ),
    ],
)
def test_contradictions_of_urdf_and_sidecar_are_found(old, new):
    urdf = tool_urdf(SMALL)
    assert old in urdf
    check(urdf, tool_sidecar(SMALL))
    with pytest.raises(InputError, match=r"^tool URDF"):
        check(urdf.replace(old, new), tool_sidecar(SMALL))


def test_another_pitch_in_the_sidecar_is_found():
    sidecar = tool_sidecar(SMALL)
    sidecar["grid"]["pitch_m"] = 0.111
    with pytest.raises(InputError, match="leg_0_0_ux"):
        check(tool_urdf(SMALL), sidecar)


def test_arms_are_found_by_name_and_by_path(tmp_path):
    assert "ur10" in arm_names()
    (tmp_path / "arm.urdf").write_text(read_arm("ur10"), "utf-8")
    assert read_arm(tmp_path / "arm.urdf") == read_arm("ur10")
    with pytest.raises(InputError, match="ur10"):
        read_arm("ur99")
    with pytest.raises(InputError, match=r"b\.urdf: cannot be read"):
        read_arm(tmp_path / "b.urdf")


def test_endless_joints_get_one_turn_either_way():
    text = read_arm("ur10")
    assert bound_joints(text) == text
    limited = bound_joints(text.replace('type="revolute"', 'type="continuous"'))
    limit = joints(limited)["elbow_joint"].find("limit")
    assert float(limit.get("upper")) == pytest.approx(2 * math.pi)
    assert float(limit.get("lower")) == pytest.approx(-2 * math.pi)
    assert float(limit.get("velocity")) == 3.15
    bare = '<robot name="a"><joint name="j" type="continuous"/></robot>'
    with pytest.raises(InputError, match="j: is continuous"):
        bound_joints(bare)
    with pytest.raises(InputError, match="no valid XML"):
        bound_joints("<robot")
