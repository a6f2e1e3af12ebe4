"""The cheapest ply model for a path: what it leaves out is below the tolerance."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drapeplan.held_ply import PlyModel, held_fibers, held_points, overhang_samples
from drapeplan.ply_choice import VERIFIED, choose_ply
from drapeplan.ply_coupling import coupled_cells, coupling_estimate
from drapeplan.sentences import ply_sentences
from tests.plans import SADDLE, scene, stages
from tests.test_held_ply import flat, with_ply

FULL = PlyModel("modal", gravity=True, droop=True)
SMALL = 3e-5  # [m] distances below which an estimate need not bound them


@pytest.fixture(scope="module")
def saddle():
    return stages(scene(SADDLE))


@pytest.fixture(scope="module")
def path(saddle):
    """Every ninth pose of the saddle's wave: cups in the air, landing and landed."""
    wave = saddle[3]
    return wave.positions[::9], wave.rotations[::9]


def with_tolerance(cell, shape_mm):
    section = cell.scene.tolerance.model_copy(update={"shape_mm": shape_mm})
    return replace(cell, scene=cell.scene.model_copy(update={"tolerance": section}))


def shape(cell, poses, model):
    return held_points(cell, held_fibers(cell, *poses, model), *poses, model)


@settings(max_examples=15, deadline=None)
@given(
    bending=st.floats(2e-4, 2e-2),
    mass=st.floats(0.0, 1.0),
    tolerance=st.floats(0.05, 1.0),
    gap=st.sampled_from([0.0, 0.5e-3, 0.81e-3, 1.5e-3]),
)
def test_what_is_left_out_is_below_the_tolerance(saddle, bending, mass, tolerance, gap):
    """Between the cups and beyond them, against everything modeled."""
    cell = with_ply(saddle[0], bending_stiffness_Nm=bending, areal_mass_kg_m2=mass)
    cell = with_tolerance(cell, tolerance)
    poses = flat(cell, gap, (0.0, 0.01))
    choice, _ = choose_ply(cell, *poses)
    apart = shape(cell, poses, choice.model) - shape(cell, poses, FULL)
    apart = np.linalg.norm(apart, axis=-1)
    beyond = overhang_samples(cell.sampling)
    assert apart[:, ~beyond].max() <= 1e-3 * tolerance
    corners = apart[:, [0, 0, -1, -1], [0, -1, 0, -1]]
    assert corners.max() <= 1e-3 * tolerance


def test_a_stiff_ply_within_its_take_up_is_cubic(saddle, path):
    choice, fibers = choose_ply(saddle[0], *path)
    assert choice.model == PlyModel()
    assert fibers.s.shape[-3:] == (2, 5, 3)
    left = {effect.cause: effect.left_out for effect in choice.effects}
    assert left["take_up"] == 0
    assert 0 < left["gravity"] < choice.tolerance
    assert 0 < left["droop"] < choice.tolerance


def test_a_limp_ply_sags(saddle, path):
    cell = with_ply(saddle[0], bending_stiffness_Nm=2e-3)
    choice, _ = choose_ply(cell, *path)
    assert choice.model == PlyModel("modal", gravity=True)


def test_a_wide_overhang_droops(path):
    cell = stages(scene(SADDLE, ply={"overhang_mm": 60}))[0]
    choice, _ = choose_ply(cell, *path)
    assert choice.model == PlyModel(droop=True)
    droop = choice.effects[2]
    assert droop.size == pytest.approx(3 * 0.31 * 9.81 * 0.06**4 / (8 * 0.02), rel=0.05)
    assert 0 < droop.left_out < droop.size


def test_slack_beyond_the_take_up_bulges(saddle):
    poses = flat(saddle[0], 1.5e-3)
    choice, fibers = choose_ply(saddle[0], *poses)
    assert choice.model == PlyModel("modal")
    assert (fibers.sides.s != 0).all()
    assert choice.effects[0].size > 1e-3


@pytest.mark.parametrize(
    ("asked", "model"),
    [("cubic", PlyModel()), ("modal", PlyModel("modal", gravity=True))],
)
def test_a_scene_may_force_the_model(saddle, path, asked, model):
    cell = with_ply(saddle[0], model=asked)
    choice, _ = choose_ply(cell, *path)
    assert choice.model == model
    assert choice.to_dict()["asked"] == asked
    assert f"asks for {asked}" in " ".join(ply_sentences(choice.to_dict()))


def test_the_same_poses_give_the_same_choice(saddle, path):
    first, second = (choose_ply(saddle[0], *path)[0].to_dict() for _ in range(2))
    assert first == second


def test_the_estimate_bounds_what_coupled_patches_change(saddle, path):
    """Patches of poses all along the wave, not the worst alone."""
    cell = saddle[0]
    grid, none = cell.sampling.grid, np.zeros(())
    fibers = held_fibers(cell, *path)
    estimate = coupling_estimate(grid, fibers, path[1], none)
    count = estimate[0].size
    for k in (0, 3, 7):
        one = slice(k, k + 1)
        poses = path[0][one], path[1][one]
        own = held_fibers(cell, *poses)
        for found in coupled_cells(cell, *poses, own, estimate[one], count)[::3]:
            assert found.rms is not None
            assert found.rms <= max(found.estimate, SMALL)


def test_where_coupling_may_matter_the_worst_patches_are_solved(saddle, path):
    cell = with_tolerance(saddle[0], 0.07)
    choice, _ = choose_ply(cell, *path)
    effect = choice.effects[3]
    assert effect.size > choice.tolerance
    assert len(choice.coupled) == VERIFIED
    assert len({one.patch for one in choice.coupled}) == VERIFIED
    assert choice.coupled[0].patch == effect.patch
    assert choice.coupled[0].waypoint == effect.waypoint
    text = " ".join(ply_sentences(choice.to_dict()))
    assert "read the margins against it" in text
    assert f" at waypoint {effect.waypoint + 1}; solved" in text


def test_nothing_is_solved_where_coupling_does_not_matter(saddle, path):
    choice, _ = choose_ply(with_tolerance(saddle[0], 0.5), *path)
    assert choice.coupled == ()
    text = " ".join(ply_sentences(choice.to_dict()))
    assert "within 0.5 mm" in text
    assert "read the margins" not in text


def test_patches_sag_more_than_their_strips(saddle, path):
    """What the strips do not have of a patch's sag counts as left out."""
    cells = [
        with_ply(saddle[0], bending_stiffness_Nm=2e-3, areal_mass_kg_m2=mass)
        for mass in (1e-9, 0.31)
    ]
    light, heavy = (choose_ply(cell, *path)[0] for cell in cells)
    missing = heavy.effects[3].size - light.effects[3].size
    assert heavy.model.gravity
    assert missing > 0.5 * (1.8 / 2.8) * heavy.effects[1].size  # sag turns edges, too


def test_coupled_patches_bulge_as_their_strips_do(saddle):
    poses = flat(saddle[0], 1.5e-3, (0.01,))
    choice, _ = choose_ply(saddle[0], *poses)
    bow = choice.effects[0].size
    assert bow > 3e-3
    for one in choice.coupled:
        assert one.largest is None or one.largest < bow
