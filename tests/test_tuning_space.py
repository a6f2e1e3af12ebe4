"""Tuning space: points and paths stand for each other."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from drapeplan.tuning_space import KNOBS, Space, StepSpace
from tests.plans import scene
from tests.toys import PATH

ROUNDED = 1e-3  # [-] of the box: values have four digits
PATHS = {
    "rectangle_blend": {**PATH, "poses_per_step": 5},
    "radial": {"family": "radial"},
    "hover": {"family": "hover", "arrival": "shaped"},
}


@pytest.mark.parametrize("family", PATHS)
@given(data=st.data())
def test_points_come_back(family, data):
    space = Space(scene(path=PATHS[family]), rest=True)
    count = len(KNOBS[family])
    point = np.array(
        data.draw(st.lists(st.floats(0, 1), min_size=count, max_size=count))
    )
    path = space.path(point)
    assert_allclose(space.point(path), point, atol=ROUNDED)
    assert space.path(space.point(path)) == path


@pytest.mark.parametrize("family", PATHS)
@pytest.mark.parametrize("rest", [True, False])
def test_known_paths_are_of_the_family_and_in_the_box(family, rest):
    space = Space(scene(path=PATHS[family]), rest)
    points = np.array([space.point(path) for path in space.known()])
    assert points.shape[1] == len(space.knobs)
    assert len(np.unique(points, axis=0)) == len(points)
    assert ((points >= 0) & (points <= 1)).all()


def test_steps_lean_by_themselves():
    base = Space(scene(path=PATH | {"toe_up_steps": [[5, 1.0]]}), True).base
    space = StepSpace(base, [7, 3])
    assert_allclose(space.point(base), [0.25, 0.25])  # of 8 deg
    path = space.path(np.array([1.0, 0.5]))
    assert path.toe_up_steps == ((3, 4.0), (5, 1.0), (7, 8.0))
    assert path.toe_up_deg == base.toe_up_deg
    assert_allclose(space.point(path), [1.0, 0.5])


def test_what_is_not_tuned_stays():
    space = Space(scene(path=PATHS["rectangle_blend"]), rest=True)
    assert space.path(np.full(5, 0.5)).poses_per_step == 5


def test_lean_shows_at_rest_alone():
    read = scene(path=PATHS["hover"])
    names = [[knob.name for knob in Space(read, rest).knobs] for rest in (True, False)]
    assert names == [["height_mm", "toe_up_deg"], ["height_mm"]]


def test_one_lift_is_both():
    space = Space(scene(path={**PATH, "lift_per_m": 0.5}), True)
    values = space.values(space.base)
    assert values["lift_s_per_m"] == values["lift_t_per_m"] == 0.5


def test_ratios_count_where_they_should():
    space = Space(scene(path=PATHS["hover"]), rest=False)
    assert space.path(np.array([0.5])).height_mm == pytest.approx(
        np.sqrt(2 * 40), rel=1e-3
    )


def test_the_box_takes_in_the_scene():
    space = Space(scene(path={"family": "hover", "height_mm": 80.0}), rest=False)
    assert_allclose(space.point(space.base), [1.0])
    assert space.path(np.array([1.0])).height_mm == 80.0


def test_points_outside_are_brought_to_the_border():
    space = Space(scene(path=PATHS["hover"]), rest=False)
    assert space.path(np.array([-3.0])).height_mm == 2.0
