"""Sag of fibers within the take-up: a clamped beam, added to whatever they are."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ply.errors import PlyError
from ply.fiber import BULGE
from ply.grid import CupGrid
from ply.sag import with_sag
from ply.weave import ply_fibers

GRID = CupGrid(3, 4, 0.11, 0.02)
D = 5e-4  # [N m] a limp ply
Q = 0.31 * 9.81  # [N/m^2]
DOWN = np.array([0.0, 0.0, -Q])
TAKE_UP = 0.8e-3  # [m]
SHARE = 0.03  # [-] of the sag, by which it changes on fibers that bend
SOFT = 1e6  # [m/N] fibers that stretch at will: no axial force


def rolled(curvature):
    """Cups on a cylinder, each fiber as long as its cups ask for within 0.2 mm."""
    angle = curvature * GRID.centers[:, 0]
    sin, cos = np.sin(angle), np.cos(angle)
    zero, one = np.zeros_like(sin), np.ones_like(sin)
    positions = np.stack(
        [sin / curvature, GRID.centers[:, 1], (cos - 1) / curvature], axis=-1
    )
    columns = [(cos, zero, -sin), (zero, one, zero), (sin, zero, cos)]
    return positions, np.stack([np.stack(c, -1) for c in columns], axis=-1)


def fibers(poses):
    return ply_fibers(GRID, *poses, model="cubic", take_up=TAKE_UP)


def test_a_flat_strip_sags_as_a_clamped_beam():
    poses = np.pad(GRID.centers, ((0, 0), (0, 1))), np.tile(np.eye(3), (12, 1, 1))
    found = with_sag(GRID, fibers(poses), poses[1], DOWN, D)
    for curves, length in ((found.s, GRID.s_length), (found.t, GRID.t_length)):
        middle = 0.5 ** np.arange(5) @ curves
        assert_allclose(middle[..., 2], -Q * length**4 / (384 * D), rtol=1e-12)
        fourth = 24 * curves[..., 4, 2] / length**4
        assert_allclose(D * fourth, -Q, rtol=1e-12)


def test_curved_strips_sag_as_fibers_that_stretch_at_will():
    """The oracle solves for three modes; their sag is the beam's to 1 %."""
    poses = rolled(0.8)
    before = fibers(poses)
    assert not before.s_band.any()
    found = with_sag(GRID, before, poses[1], DOWN, D)
    soft = ply_fibers(
        GRID,
        *poses,
        model="modal",
        take_up=TAKE_UP,
        across=2,
        gravity=DOWN,
        stiffness=D,
        softness=SOFT,
    )
    sag = Q * GRID.span**4 / (384 * D)
    for mine, own in ((found.s, soft.s), (found.t, soft.t)):
        apart = 0.5 ** np.arange(7) @ own - 0.5 ** np.arange(5) @ mine
        assert np.abs(apart).max() < SHARE * sag


def test_the_sag_is_along_the_normal_and_by_its_share_of_the_weight():
    poses = rolled(2.0)
    before = fibers(poses)
    change = with_sag(GRID, before, poses[1], DOWN, D).s - before.s
    normal = poses[1][..., 2].reshape(3, 4, 3)
    normal = normal[:, :-1] + normal[:, 1:]
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    size = GRID.span**4 * (normal @ DOWN) / (24 * D)
    expected = BULGE[:, None] * (size[..., None] * normal)[:, :, None, None]
    assert_allclose(change, np.broadcast_to(expected, change.shape), atol=1e-15)


def test_fibers_outside_the_take_up_stay_as_they_are():
    positions, rotations = rolled(0.8)
    positions[0, 0] -= 0.002
    before = fibers((positions, rotations))
    outside = before.s_band != 0
    assert outside.any()
    after = with_sag(GRID, before, rotations, DOWN, D)
    assert_allclose(after.s[outside], before.s[outside], rtol=0, atol=0)
    assert np.abs((after.s - before.s)[~outside]).max() > 1e-4


@pytest.mark.parametrize(
    ("weight", "stiffness", "key"),
    [((0, 0), D, "weight"), ((0, 0, np.nan), D, "weight"), (DOWN, 0.0, "stiffness")],
)
def test_what_makes_no_sense_is_refused(weight, stiffness, key):
    poses = rolled(0.8)
    with pytest.raises(PlyError, match=key):
        with_sag(GRID, fibers(poses), poses[1], weight, stiffness)
