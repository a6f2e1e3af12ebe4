import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from drapeplan.net import neighbor_pairs
from drapeplan.wave import progress, shaping
from tests.plans import BOWL, PARABOLOID, SADDLE, scene, stages
from tests.tolerances import EXACT, LINK

RADIAL = {"family": "radial", "poses_per_step": 5}
HOVER = {"family": "hover", "height_mm": 5}


@pytest.fixture(
    scope="module", params=["convex", "saddle", "bowl", "hover", "warp", "radial"]
)
def made(request):
    surface = {"saddle": SADDLE, "bowl": BOWL}.get(request.param, PARABOLOID)
    path = {"hover": HOVER, "radial": RADIAL}.get(request.param)
    sections = {"path": path} if path else {}
    if request.param == "warp":
        sections["placement"] = {"warp_deg": 25}
    return stages(scene(surface, **sections))


def test_links_are_exact_at_every_pose(made):
    cell, _, _, wave = made
    pairs = np.concatenate(neighbor_pairs(cell.grid.rows, cell.grid.columns))
    ends = wave.positions[:, pairs]
    lengths = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=-1)
    assert_allclose(lengths, cell.grid.pitch, atol=LINK)


def test_placed_cups_never_move(made):
    wave = made[3]
    for k in range(1, len(wave.tau)):
        stood = wave.placed[k - 1]
        assert np.array_equal(wave.positions[k][stood], wave.positions[k - 1][stood])
        assert np.array_equal(wave.rotations[k][stood], wave.rotations[k - 1][stood])


def test_placed_cups_stand_on_the_mold_and_flying_ones_above(made):
    cell, _, _, wave = made
    height = wave.positions[..., 2] - cell.mold.height(
        wave.positions[..., 0], wave.positions[..., 1]
    )
    assert_allclose(height[wave.placed], 0, atol=EXACT)
    assert (height[~wave.placed] > 0).all()


def test_landing_cups_come_down_steadily(made):
    cell, _, _, wave = made
    gap = wave.positions[..., 2] - cell.mold.height(
        wave.positions[..., 0], wave.positions[..., 1]
    )
    for k in range(1, len(wave.tau)):
        if wave.step[k] == wave.step[k - 1]:
            cups = wave.landing[k]
            assert (gap[k][cups] < gap[k - 1][cups]).all()


def test_every_step_ends_landed(made):
    _, sequence, _, wave = made
    ends = wave.tau == 1
    assert wave.step[ends][-1] == len(sequence.steps) - 1
    assert wave.placed[-1].all()
    assert not wave.landing[ends].any()


@given(gap=st.floats(1e-6, 0.2), last=st.floats(1e-5, 1e-3), poses=st.integers(3, 60))
def test_progress_ends_with_a_small_last_gap(gap, last, poses):
    tau = progress(gap, last, poses)
    assert len(tau) == poses
    assert tau[-1] == 1
    assert (np.diff(tau) > 0).all()
    assert tau[0] > 0
    assert (1 - tau[-2]) * gap <= max(last, gap / 2) * (1 + 1e-9)


def test_shaping_starts_square_and_ends_in_the_shape():
    cell, _, _, wave = stages(scene())
    grid, first = cell.grid, wave.positions[0]
    i, j = np.divmod(np.arange(48), 6)
    flat = np.stack([j, i], axis=1) * grid.pitch - [0.275, 0.385]
    shape = wave.surface, first[:, :2], wave.height
    positions, rotations = shaping(grid, (flat, 0.07), shape, np.array([0.0, 0.5, 1.0]))
    assert_allclose(positions[0], np.column_stack([flat, np.full(48, 0.07)]), atol=LINK)
    assert_allclose(rotations[0], np.broadcast_to(np.eye(3), (48, 3, 3)), atol=LINK)
    assert_allclose(positions[-1], first, atol=LINK)
    assert_allclose(rotations[-1], wave.rotations[0], atol=LINK)


def test_the_lift_begins_at_the_rim_and_its_offset():
    """Cup (3, 4) of a flat ply, two pitches from the start cup's center."""

    def height(offset):
        path = {"family": "rectangle_blend", "rim_offset_mm": offset}
        wave = stages(scene({"kind": "plane"}, path=path))[3]
        x, _, z = wave.positions[0, 3 * 6 + 4] - wave.positions[0, 3 * 6 + 2]
        return z, 0.6 * 0.12 * (2 * (x - 0.02 - 1e-3 * offset) - 0.12)

    for found, expected in map(height, (-10, 0, 10)):
        assert found == pytest.approx(expected, abs=1e-9)
