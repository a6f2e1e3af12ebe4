import numpy as np
import pytest
from scipy.linalg.lapack import dpbtrf

from drapeplan.kkt import Layouts
from drapeplan.settle import reduced
from drapeplan.stability import (
    HOLD,
    dense_curvature,
    lanczos,
    least_curvature,
)
from drapeplan.tool_energy import ToolEnergy
from tests.tool_samples import PLY, random_legs, small_tool

SAME = 1e-6  # [-] of the curvature: the springs take 1e-8, random poses ten times more


@pytest.fixture(scope="module")
def robot():
    return small_tool()


def system(robot, shift):
    """Layout and terms at a random pose, second derivatives shifted."""
    rng, energy = np.random.default_rng(0), ToolEnergy(robot, PLY)
    T = robot.arm_forward(robot.home()[robot.arm_columns])
    forces = np.zeros(len(energy.row_pairs))
    terms = energy.evaluate(T, random_legs(robot, rng), forces)
    terms.own[:, range(6), range(6)] += shift
    free, active = np.arange(12) != 4, np.arange(len(forces)) < energy.n_links
    active[[20, 21, 33]] = True
    return Layouts(4, 3, energy)(free, active), terms


@pytest.mark.parametrize("shift", [0.0, 2.0, -2.0])
def test_it_is_the_least_eigenvalue_in_the_null_space(robot, shift):
    layout, terms = system(robot, shift)
    values = reduced(*layout.dense(terms))[0]
    found = least_curvature(layout, terms)
    assert found == pytest.approx(values[0], rel=SAME, abs=SAME)
    assert (found > 0) == (values[0] > 0)


def test_lanczos_and_dense_agree(robot):
    layout, terms = system(robot, 5.0)
    factor, info = dpbtrf(layout.held(terms, HOLD), lower=1)
    assert info == 0
    dense = dense_curvature(*layout.dense(terms))
    assert lanczos(factor) == pytest.approx(dense, rel=SAME)


def test_rows_that_leave_no_motion(robot):
    energy = ToolEnergy(robot, PLY)
    free = np.arange(12) == 0
    active = free[energy.row_pairs].any(axis=1)  # two links and four chords of a corner
    layout = Layouts(4, 3, energy)(free, active)
    assert least_curvature(layout, system(robot, 0.0)[1]) is None


def test_lanczos_goes_on_where_curvatures_lie_close_together():
    """As those of large tools; 28 steps do not tell these apart."""
    values = 1 + 1e-3 * np.arange(1000.0)
    assert lanczos(np.sqrt(values)[None]) == pytest.approx(1.0, rel=SAME)
