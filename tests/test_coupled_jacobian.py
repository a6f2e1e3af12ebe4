"""Derivatives of coupled points by the poses of their cups (D9)."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from ply.coupled import CoupledModel, CoupledStatus
from ply.coupled_jacobian import coupled_jacobian
from ply.errors import PlyError
from ply.grid import Region
from tests.test_coupled import (
    CENTERS,
    GRID,
    MODEL,
    UPRIGHT,
    disturbed,
    refined,
    rotation,
)

STEP = 3e-7  # [m, rad] of fourth-order differences: near buckling shapes turn fast
EXACT = 1e-6  # [-, m/rad] of the largest derivative
RIGID = 1e-7  # [-, m/rad] of the largest derivative: shapes end 1e-6 m before rest
ROUNDING = 1e-9  # [-, m/rad] of the largest derivative, amplified by E_h / D
WEIGHTS = np.array([1.0, -8.0, 8.0, -1.0]) / 12  # of differences at -2, -1, 1, 2 steps
LOADED = CoupledModel(GRID, weight=(1.0, -2.0, -30.0), take_up=4e-4)
POINTS = np.random.default_rng(0).uniform(-0.03, 0.14, (30, 2))
ON_STRIP = {
    Region.S_STRIP: POINTS * [1, 0.2],
    Region.T_STRIP: POINTS * [0.2, 1],
    Region.PATCH: POINTS,
}
PAIRS = {Region.S_STRIP: [0, 1], Region.T_STRIP: [0, 2], Region.PATCH: [0, 1, 2, 3]}


def solve(model, region, positions, rotations, start=None):
    if region == Region.PATCH:
        return model.solve(positions, rotations, start=start)
    return model.solve_strips(positions, rotations, start=start, along=region)


def at_rest(model, patches):
    return replace(patches, coefficients=refined(patches, model))


def moved(positions, rotations, moves):
    return positions + moves[..., :3], rotation(moves[..., 3:]) @ rotations


@pytest.mark.parametrize("region", [Region.PATCH, Region.S_STRIP, Region.T_STRIP])
@pytest.mark.parametrize("model", [MODEL, LOADED], ids=["plain", "loaded"])
def test_derivatives_agree_with_finite_differences(model, region):
    positions, rotations = (a[PAIRS[region]] for a in disturbed(8, 0.2, 0.02))
    st = ON_STRIP[region]
    count = len(positions)
    one = at_rest(model, solve(model, region, positions[None], rotations[None]))
    assert_array_equal(one.status, CoupledStatus.CONVERGED)
    directions = np.random.default_rng(1).normal(size=(3, count, 6))
    jacobian = coupled_jacobian(model, one, st)
    assert jacobian.values.shape == (1, len(st), 4, 3, 6)
    found = np.einsum(
        "nkxa,dnka->dnx", jacobian.values[0], directions[:, jacobian.cups]
    )
    sizes = STEP * np.array([-2, -1, 1, 2])
    there = moved(positions, rotations, sizes[:, None, None, None] * directions)
    many = one[np.zeros((4, 3), dtype=int)]
    shapes = solve(model, region, *there, start=many)
    assert_array_equal(shapes.status, CoupledStatus.CONVERGED)
    flat = shapes[np.unravel_index(np.arange(12), (4, 3))]
    points = model.points(at_rest(model, flat), *st.T).reshape(4, 3, len(st), 3)
    expected = np.einsum("k,kdnx->dnx", WEIGHTS, points) / STEP
    assert_allclose(found, expected, rtol=0, atol=EXACT * abs(expected).max())


def test_common_twist_of_all_cups_moves_the_patch_rigidly():
    patches = at_rest(MODEL, MODEL.solve(*disturbed(3, 0.2, 0.02, shape=(2,))))
    points = MODEL.points(patches, *POINTS.T)
    jacobian = coupled_jacobian(MODEL, patches, POINTS)
    twist = np.array([0.3, -0.2, 0.5, 0.7, 0.4, -0.6])
    each = np.broadcast_to(twist, (2, 4, 6)).copy()
    each[..., :3] += np.cross(twist[3:], patches.cups[:, ::3])
    moves = np.einsum("bnkxa,bka->bnx", jacobian.values, each)
    expected = twist[:3] + np.cross(twist[3:], points)
    size = abs(jacobian.values).max()
    assert_allclose(moves, expected, rtol=0, atol=RIGID * size)


def test_batch_is_each_patch_alone():
    patches = MODEL.solve(*disturbed(3, 0.2, 0.02, shape=(2, 2)))
    whole = coupled_jacobian(MODEL, patches, POINTS)
    alone = coupled_jacobian(MODEL, patches[1, 0], POINTS)
    error = whole.values[1, 0] - alone.values
    assert_allclose(error, 0, rtol=0, atol=ROUNDING * abs(whole.values).max())


def test_shapes_that_are_none_move_with_their_unknowns_held():
    rotations = np.array(UPRIGHT)
    rotations[0] *= 1.1
    bad = MODEL.solve([CENTERS, CENTERS], [rotations, UPRIGHT])
    assert bad.status[0] == CoupledStatus.BAD_INPUT
    jacobian = coupled_jacobian(MODEL, bad, POINTS)
    assert np.isfinite(jacobian.values).all()
    shift = jacobian.values[..., :3].sum(axis=-3)
    assert_allclose(shift, np.broadcast_to(np.eye(3), shift.shape), atol=1e-9)


def test_points_are_pairs():
    with pytest.raises(PlyError) as error:
        coupled_jacobian(MODEL, MODEL.solve(CENTERS, UPRIGHT), [0.0, 0.0])
    assert error.value.argument == "points_st"
