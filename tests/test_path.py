import numpy as np
import pytest
from numpy.testing import assert_allclose

from drapeplan.frames import inverse, moved
from drapeplan.legs import leg_coordinates
from drapeplan.path import CupState, plan_path
from tests.plans import BOWL, PARABOLOID, SADDLE, scene, stages
from tests.tolerances import EXACT, LINK

ORDER = ["pick", "lift", "preshape", "approach", "wave", "release", "retreat"]
FLAT = ["pick", "lift", "approach", "preshape", "wave", "release", "retreat"]


def planned(surface, **sections):
    cell, sequence, targets, wave = stages(scene(surface, **sections))
    start = sequence.index(sequence.start_cup)
    return cell, wave, plan_path(cell, targets, wave, start)


@pytest.fixture(scope="module")
def blend():
    return planned(SADDLE)


@pytest.fixture(scope="module")
def hover():
    return planned(PARABOLOID, path={"family": "hover", "height_mm": 5})


def phases(path):
    return list(dict.fromkeys(path.phase))


def test_phases_come_in_order(blend, hover):
    assert phases(blend[2]) == ORDER
    assert phases(hover[2]) == FLAT


def test_the_ply_is_picked_flat_square_and_where_the_scene_says(blend):
    cell, _, path = blend
    positions = path.positions[0].reshape(8, 6, 3)
    x, y, z = cell.scene.pick.position_m
    assert_allclose(positions.mean(axis=(0, 1)), [x, y, z], atol=EXACT)
    assert_allclose(positions[..., 2], z, atol=EXACT)
    assert cell.scene.pick.yaw_deg == 90
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # s along y, t against x
    assert_allclose(np.diff(positions[..., 1], axis=1), cell.grid.pitch, atol=EXACT)
    assert_allclose(np.diff(positions[..., 0], axis=0), -cell.grid.pitch, atol=EXACT)
    assert_allclose(path.rotations[0], np.broadcast_to(turn, (48, 3, 3)), atol=EXACT)


def test_wave_poses_reach_the_world_unchanged(blend):
    cell, wave, path = blend
    mine = np.array(path.phase) == "wave"
    back = moved(inverse(cell.world_mold), path.positions[mine], path.rotations[mine])
    assert_allclose(back[0], wave.positions[1:], atol=EXACT)
    assert_allclose(back[1], wave.rotations[1:], atol=EXACT)


@pytest.mark.parametrize("which", ["blend", "hover"])
def test_ply_rides_rigidly_on_the_tool_outside_shaping_and_wave(which, request):
    _, _, path = request.getfixturevalue(which)
    for k in range(1, len(path.tau)):
        if path.phase[k] in ("lift", "approach", "retreat"):
            now, before = (
                moved(inverse(path.tool[i]), path.positions[i], path.rotations[i])
                for i in (k, k - 1)
            )
            assert_allclose(now[0], before[0], atol=1e-9)


def test_no_jump_between_waypoints(blend, hover):
    for _, _, path in (blend, hover):
        local = moved(inverse(path.tool), path.positions, path.rotations)[0]
        step = np.linalg.norm(np.diff(local, axis=0), axis=-1).max()
        assert step < 0.05


@pytest.mark.parametrize("surface", [SADDLE, BOWL])
def test_cups_pass_the_whole_mold_with_clearance(surface):
    cell, _, path = planned(surface)
    to_mold = inverse(cell.world_mold)
    positions = moved(to_mold, path.positions, path.rotations)[0]
    top = cell.mold.heights[cell.mold.covered].max()
    clearance = cell.scene.motion.clearance_mm * 1e-3
    approach = np.array(path.phase) == "approach"
    transfer = np.flatnonzero(approach)[:12]
    assert (positions[transfer][..., 2] >= top + clearance - LINK).all()


def test_strokes_are_centered(blend):
    cell, _, path = blend
    first = path.phase.index("wave") - 1  # the end of the approach
    mine = slice(first, path.phase.index("release"))
    poses = path.positions[mine], path.rotations[mine]
    legs = leg_coordinates(cell.robot.geometry, path.tool[mine], *poses)
    stroke = legs[..., 2]
    assert_allclose(stroke.min() + stroke.max(), 0.3, atol=1e-5)


def test_start_cup_lands_with_the_arm(blend):
    _, _, path = blend
    k = len(path.phase) - 1 - path.phase[::-1].index("approach")
    assert path.states[k, 20] == CupState.PLACED
    assert path.states[k - 1, 20] == CupState.LANDING
    assert (np.delete(path.states[k], 20) == CupState.HOLDING).all()


def test_all_cups_release_at_the_end(blend):
    path = blend[2]
    assert (path.states[-1] == CupState.RELEASED).all()
    assert path.phase[-1] == "retreat"
    assert path.tool[-1, 2, 3] > path.tool[path.phase.index("release"), 2, 3]
