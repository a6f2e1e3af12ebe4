"""Path choice: curvature where the border lands, and what it makes of the path."""

import copy

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drapeplan.cell import build_cell, read_sources
from drapeplan.check import check_plan
from drapeplan.families import known
from drapeplan.path_choice import (
    STEEP,
    WIDE,
    PathChoice,
    choice_line,
    chosen_path,
    hollowness,
    wideness,
)
from drapeplan.plan import Plan, document_hash
from tests.plans import EXAMPLES, scene
from tests.settled import small_panel

BENT = 0.06  # [-] of a curvature: slope of a paraboloid one border cup further out
CLOSE = 2e-3  # [1/m] what rounding and three cups leave
OUT, HIGH = 0.65, 0.45  # [1/m] of a saddle's hollow direction, and of a bowl's other


def paraboloid(x, y):
    return {"kind": "paraboloid", "radius_x_m": x, "radius_y_m": y}


def cell_of(surface, **sections):
    read = scene(surface, **sections)
    return read, build_cell(read, read_sources(read, EXAMPLES))


def hollow(surface, **sections):
    read, cell = cell_of(surface, **sections)
    return hollowness(read, cell.mold, cell.grid)


@pytest.mark.parametrize(("x", "y"), [(-1.5, 1.8), (1.8, -1.5), (-3.0, -2.0)])
def test_hollowness_is_curvature_with_its_sign(x, y):
    assert hollow(paraboloid(x, y)) == pytest.approx((-1 / x, -1 / y), rel=BENT)


def test_a_turned_ply_sees_a_turned_mold():
    s, t = hollow(paraboloid(-3.0, 4.0))
    turned = hollow(paraboloid(-3.0, 4.0), placement={"warp_deg": 90})
    assert turned == pytest.approx((t, s), abs=CLOSE * 10)


def test_of_two_ends_the_more_hollow_one_counts():
    s, t = hollow({"kind": "ridge"})  # its top lies near one end, its foot at the other
    assert s > 0.2
    assert t == pytest.approx(0, abs=CLOSE)


@given(s=st.floats(-2, 2), t=st.floats(-2, 2))
def test_wide_alone_where_one_direction_is_hollow(s, t):
    assert wideness(s, t) == wideness(t, s)
    assert 0 <= wideness(s, t) <= 1
    if max(s, t) <= 0 or min(s, t) >= max(s, t) / 2:
        assert wideness(s, t) == 0
    if max(s, t) >= HIGH and min(s, t) <= 0:
        assert wideness(s, t) == 1


@given(s=st.floats(-2, 2), t=st.floats(-2, 2), step=st.floats(-1e-3, 1e-3))
def test_a_little_more_hollow_is_a_little_wider(s, t, step):
    assert wideness(s + step, t) == pytest.approx(wideness(s, t), abs=2e-2)


def test_saddles_roll_wide_and_domes_steep():
    saddle = cell_of(paraboloid(-1.5, 1.8))[1].scene.path
    turned = cell_of(paraboloid(1.8, -1.5))[1].scene.path
    dome = cell_of(paraboloid(1.0, 2.0))[1].scene.path
    assert saddle.lift_per_m[0] == turned.lift_per_m[1] == WIDE[0]
    assert WIDE[1] < saddle.lift_per_m[1] < STEEP[1]
    assert saddle.lift_per_m[1] == pytest.approx(turned.lift_per_m[0], rel=BENT)
    assert [saddle.bend_mm, saddle.rim_offset_mm, saddle.toe_up_deg] == [*WIDE[2:]]
    assert [*dome.lift_per_m, dome.bend_mm] == [*STEEP[:3]]
    assert [dome.rim_offset_mm, dome.toe_up_deg] == [*STEEP[3:]]


@given(t=st.floats(-2, 0), more=st.floats(0, 0.5))
def test_the_lift_across_gives_the_mold_no_more_than_it_takes(t, more):
    """Mold and lift together bend the ply as on a flat mold, up to the steep lift."""
    lift = PathChoice(0.6, t, 1.0).values()["lift_per_m"]
    assert PathChoice(t, 0.6, 1.0).values()["lift_per_m"] == lift[::-1]
    if WIDE[1] - t / 2 <= STEEP[1]:
        assert t + 2 * lift[1] == pytest.approx(2 * WIDE[1], abs=CLOSE)
    else:
        assert lift[1] == STEEP[1]
    assert PathChoice(0.6, t - more, 1.0).values()["lift_per_m"][1] >= lift[1]


def test_what_a_scene_states_stays_and_takes_the_rest_from_no_mold():
    stated = {"family": "rectangle_blend", "toe_up_deg": 1.5, "lift_per_m": 0.7}
    read, cell = cell_of(paraboloid(-1.5, 1.8), path=stated)
    filled, choice = chosen_path(read, cell.mold, cell.grid)
    assert filled == cell.scene
    assert choice is None
    assert (filled.path.toe_up_deg, filled.path.lift_per_m) == (1.5, 0.7)
    assert (filled.path.bend_mm, filled.path.rim_offset_mm) == tuple(STEEP[2:4])
    assert chosen_path(filled, cell.mold, cell.grid) == (filled, None)


def test_steps_that_are_pressed_down_do_not_lean_more():
    steps = {"steps": [[[3, 2]]]}
    read, cell = cell_of(paraboloid(-1.5, 1.8), sequence=steps)
    assert cell.scene.path.toe_up_deg == STEEP[4]
    assert chosen_path(read, cell.mold, cell.grid)[1] is None


@pytest.mark.parametrize("family", ["radial", "hover"])
def test_other_families_have_defaults_of_their_own(family):
    read, cell = cell_of(paraboloid(-1.5, 1.8), path={"family": family})
    assert chosen_path(read, cell.mold, cell.grid) == (read, None)


def test_a_ply_without_a_place_takes_the_steep_path():
    far = {"mold_point_m": (2.0, 0.0)}
    read, cell = cell_of(paraboloid(-1.5, 1.8))
    lost = read.model_copy(update={"placement": read.placement.model_copy(update=far)})
    assert hollowness(lost, cell.mold, cell.grid) == (0, 0)


def test_an_open_key_is_no_number():
    with pytest.raises(ValueError, match="open"):
        known(scene().path.bend_mm)


@pytest.fixture(scope="module")
def document():
    return small_panel().plan.document


def test_a_plan_tells_what_it_chose(document):
    told, path = document["path_choice"], document["scene"]["path"]
    assert path["toe_up_deg"] == STEEP[4]
    assert told["wide"] == 0
    line = choice_line(PathChoice(**told))
    assert "is not hollow: lift 0.6 / 0.6 per m, bend 120 mm" in line
    line = choice_line(PathChoice(-0.1, 0.5, 1.0))
    assert "is hollow along t (radius 2 m): lift 0.26 / 0.205 per m" in line
    assert "toe-up 4.44 deg" in line


@pytest.mark.parametrize(
    ("place", "value", "word"),
    [
        (["path_choice", "hollow_s_per_m"], 0.1, "path_choice.hollow_s_per_m"),
        (["path_choice", "wide"], 0.5, "path_choice.wide"),
        (["scene", "path", "toe_up_deg"], 2.1, "scene.path.toe_up_deg"),
        (["scene", "path", "toe_up_deg"], None, "scene.path.toe_up_deg"),
    ],
)
def test_check_chooses_again(document, place, value, word):
    made = copy.deepcopy(document)
    part = made
    for key in place[:-1]:
        part = part[key]
    part[place[-1]] = value
    made["hash"] = document_hash(made)
    assert any(word in line for line in check_plan(Plan(made)).differing)
