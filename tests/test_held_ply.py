"""The held ply: cubics within the take-up, bulges that keep their side, gravity."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from drapeplan.held_ply import (
    CUBIC,
    PlyModel,
    held_fibers,
    held_points,
    outside_take_up,
    overhang_samples,
    weight_on_mold,
)
from ply.shape import ply_fibers
from tests.plans import scene, stages

ALIKE = 1e-9  # [m] fibers of the same length, by two ways of solving for it
MODAL = PlyModel("modal")


@pytest.fixture(scope="module")
def made():
    return stages(scene())


def with_ply(cell, **ply):
    """The cell with another ply; its sampling stays."""
    section = cell.scene.ply.model_copy(update=ply)
    return replace(cell, scene=cell.scene.model_copy(update={"ply": section}))


def flat(cell, gap=0.0, tilt=(0.0,)):
    """Flat cups drawn together by a gap; each pose tilts the columns in turn."""
    grid = cell.sampling.grid
    centers = grid.centers * (1 - gap / grid.pitch)
    positions = np.tile(np.pad(centers, ((0, 0), (0, 1))), (len(tilt), 1, 1))
    sign = np.where(np.arange(grid.n_cups) % grid.columns % 2, -1, 1)
    angle = np.multiply.outer(tilt, sign)
    zero, one = np.zeros_like(angle), np.ones_like(angle)
    cos, sin = np.cos(angle), np.sin(angle)
    columns = [(cos, zero, -sin), (zero, one, zero), (sin, zero, cos)]
    return positions, np.stack([np.stack(c, -1) for c in columns], axis=-1)


def test_within_the_take_up_modal_fibers_are_cubics(made):
    cell, wave = made[0], made[3]
    poses = wave.positions, wave.rotations
    cubic, modal = (held_fibers(cell, *poses, model) for model in (CUBIC, MODAL))
    assert not outside_take_up(cubic).any()
    assert_allclose(
        cell.sampling.points(cubic, *poses),
        cell.sampling.points(modal, *poses),
        atol=ALIKE,
    )


def test_a_bulge_keeps_its_side_while_the_cups_lean_over(made):
    """Neighbors lean together, then apart: every other strip is asked to change."""
    cell = made[0]
    poses = flat(cell, 0.003, (0.02, 0.005, -0.005))
    found = held_fibers(cell, *poses, MODAL)
    sides = found.sides.s
    assert (abs(sides) == 1).all()
    assert (sides == sides[:1]).all()
    take_up = cell.scene.ply.take_up_mm * 1e-3
    grid = cell.sampling.grid
    fresh = ply_fibers(grid, *poses, model="modal", take_up=take_up).sides.s
    assert (fresh[2] == -sides[2]).all()
    again = held_fibers(cell, poses[0][2:], poses[1][2:], MODAL)
    assert (again.sides.s[0] == fresh[2]).all()


def test_a_strip_that_was_taut_is_free_to_choose(made):
    cell = made[0]
    slack, taut = flat(cell, 0.003, (0.02, 0.02, -0.02)), flat(cell)
    positions, rotations = slack[0].copy(), slack[1].copy()
    positions[1], rotations[1] = taut[0][0], taut[1][0]
    positions[1, 0, 0] += 0.003  # one strip stays slack
    sides = held_fibers(cell, positions, rotations, MODAL).sides.s
    assert (sides[1, 1:] == 0).all()
    assert (sides[2, 1:] == -sides[0, 1:]).all()
    assert sides[2, 0, 0] == sides[1, 0, 0] == sides[0, 0, 0]


def test_gravity_sags_the_strips_by_the_mass_of_the_scene(made):
    cell = with_ply(made[0], areal_mass_kg_m2=0.5, bending_stiffness_Nm=1e-3)
    poses = flat(cell)
    heavy = PlyModel("modal", gravity=True)
    light, under = (held_points_of(cell, poses, m) for m in (CUBIC, heavy))
    sag = 0.5 * 9.81 * cell.sampling.grid.span**4 / (384 * 1e-3)
    assert (under - light)[..., 2].min() == pytest.approx(-sag, rel=0.05)
    assert_allclose((under - light)[..., :2], 0, atol=1e-12)


def test_slack_fibers_sag_with_their_length_kept(made):
    cell = with_ply(made[0], areal_mass_kg_m2=2.0, bending_stiffness_Nm=1e-3)
    poses = flat(cell, 0.003, (0.0,))
    grid, take_up = cell.sampling.grid, cell.scene.ply.take_up_mm * 1e-3
    found = held_fibers(cell, *poses, PlyModel("modal", gravity=True))
    alone = ply_fibers(
        grid,
        *poses,
        model="modal",
        take_up=take_up,
        gravity=weight_on_mold(cell),
        stiffness=1e-3,
    )
    assert_allclose(found.s, alone.s, atol=ALIKE)
    assert (found.sides.s == -1).all()


def held_points_of(cell, poses, model):
    return held_points(cell, held_fibers(cell, *poses, model), *poses, model)


def test_droop_bends_the_overhang_alone(made):
    cell = with_ply(made[0], areal_mass_kg_m2=0.5, bending_stiffness_Nm=1e-3)
    poses = flat(cell)
    change = held_points_of(cell, poses, PlyModel(droop=True))
    change = (change - held_points_of(cell, poses, CUBIC))[0, ..., 2]
    beyond = overhang_samples(cell.sampling)
    assert (change[~beyond] == 0).all()
    edge = 0.5 * 9.81 * 0.02**4 / (8 * 1e-3)
    assert change[beyond].max() < 0
    assert change[0, 0] == pytest.approx(-3 * edge)
    middle = np.argmin(abs(cell.sampling.s - cell.sampling.grid.pitch))
    assert change[0, middle] == pytest.approx(-edge)


def test_a_turned_mold_turns_the_weight():
    cell = stages(scene(mold={"rotation_deg": [90, 0, 0]}))[0]
    weight = weight_on_mold(cell)
    mold_z = cell.world_mold[:3, :3] @ weight
    assert_allclose(mold_z, [0, 0, -0.31 * 9.81], atol=1e-12)
    assert abs(weight[1]) == pytest.approx(0.31 * 9.81)
