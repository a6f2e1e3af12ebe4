import json

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal

from drapeplan.cell import build_cell, read_sources
from drapeplan.errors import DrapeplanError, InfeasibleError, InputError
from drapeplan.mesh import read_mesh
from drapeplan.mold import HeightGrid
from drapeplan.overhang import (
    OverhungGrid,
    find_overhang,
    mold_from_data,
    mold_of,
    outward_mesh,
    pads_over_edges,
)
from drapeplan.planner import cup_targets
from drapeplan.scene import scene_from
from tests.mold_meshes import box, cap, channel, swept, torus
from tests.plans import EXAMPLES

STEP = 0.005  # [m]
REACH = 0.07  # [m] free length between cups
SAME = 2e-5  # [m] distance against height to first order, where they touch
TOLD = 1e-3  # [m] overhangs are looked at in the middles of walls, 5 parts at least
TURNED = 2e-6  # [m] grids of the same mesh, wound otherwise


def everywhere(x, y):
    """The ply may come to any place."""
    return np.isfinite(x + y)


def found(mesh, near=everywhere, reach=REACH):
    """Overhang of a mesh."""
    shown = HeightGrid.from_mesh(*mesh, STEP)
    return find_overhang(*outward_mesh(*mesh), shown, near, reach)


@pytest.mark.parametrize("under", [0.002, 0.008, 0.03])
def test_the_overhang_of_a_channel_is_told(under):
    overhang = found(channel(under))
    assert overhang.size == pytest.approx(under, abs=max(TOLD, 0.15 * under))
    assert abs(overhang.x) == pytest.approx(0.02, abs=TOLD)


@pytest.mark.parametrize(
    "mesh",
    [
        cap(),
        box((0.2, 0.16, 0.05)),
        channel(-0.005),
        channel(0.0),
        swept([-0.1, 0.1], [0, 0.3], [0, 1]),
    ],
    ids=["cap", "closed box", "drafted channel", "upright channel", "steep plane"],
)
def test_what_is_seen_as_a_whole_does_not_overhang(mesh):
    assert found(mesh) is None


def test_an_overhang_beyond_reach_is_none():
    assert found(channel(), near=lambda x, y: x < -0.03) is None
    deep = channel(under=0.01, depth=0.1)
    assert found(deep, reach=0.02).size == pytest.approx(0.002, abs=TOLD)
    assert found(torus(), reach=0.002) is None
    ring = found(torus())  # 20.6 mm where it is 70 mm thick, 5 mm facets
    assert 0.018 < ring.size < 0.0206


def test_a_floor_under_a_plate_counts_though_the_plate_has_no_underside():
    """An open sheet that folds back: land, then a lip over the floor."""
    sheet = swept([-0.1, 0.03, 0.0, 0.1], [0, 0, -0.02, -0.02], np.linspace(0, 0.1, 3))
    assert found(sheet).size == pytest.approx(0.03, abs=0.006)


def test_a_mold_is_modeled_no_further_than_needed():
    plain, why = mold_of(*cap(), STEP, everywhere, REACH)
    assert type(plain) is HeightGrid
    assert why == "height field: nothing overhangs within the ply's reach"
    overhung, why = mold_of(*channel(), STEP, everywhere, REACH)
    assert isinstance(overhung, OverhungGrid)
    assert why.startswith("distance grid, because of an overhang of 7.")
    assert why.endswith(" mm")


def test_both_molds_come_back_from_a_file():
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (200, 3))
    for mesh in (cap(half=0.1, step=0.01), channel()):
        mold, _ = mold_of(*mesh, STEP, everywhere, REACH)
        again = mold_from_data(json.loads(json.dumps(mold.to_data())))
        assert type(again) is type(mold)
        assert again.to_data() == mold.to_data()
        assert_array_equal(again.gap(points, beside=1.0), mold.gap(points, beside=1.0))


def test_where_nothing_overhangs_both_molds_say_the_same():
    mesh = read_mesh(EXAMPLES / "molds" / "panel.stl", "mm")
    plain, full = HeightGrid.from_mesh(*mesh), OverhungGrid.from_mesh(*mesh)
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-1, 1, (2, 5000)) * [[0.39], [0.49]]
    on = plain.point(x, y)
    for height in (-0.002, 0.0, 0.002):
        points = on + height * plain.normal(x, y)
        assert_allclose(full.gap(points), plain.gap(points), atol=SAME)


def test_openings_are_where_the_mold_goes_on_below():
    mold = OverhungGrid.from_mesh(*channel())
    x = np.linspace(-0.05, 0.05, 201)
    for z in (-0.001, 0.0, 0.0003):
        points = np.stack([x, 0 * x, z + 0 * x], axis=-1)
        opening = mold.opening(points)
        assert opening[abs(x) < 0.018].all()
        assert not opening[abs(x) > 0.0203].any()
    assert not HeightGrid.from_mesh(*cap()).opening(points).any()


def test_beside_the_mold_the_gap_is_given():
    vertices, faces = channel()
    mold = OverhungGrid.from_mesh(vertices, faces)
    rng = np.random.default_rng(2)
    points = rng.uniform(-0.2, 0.2, (2000, 3))
    inside = mold.inside(points[:, 0], points[:, 1])
    gap = mold.gap(points, beside=7.0)
    assert 0.2 < inside.mean() < 0.8
    assert (gap[~inside] == 7).all()
    assert_array_equal(gap[inside], mold.gap(points)[inside])
    last = np.argwhere(mold.covered).max(axis=0)  # the rim is one line of nodes
    x, y = np.array(mold.origin) + last * mold.step
    rim = np.array([[x, 0.0, 0.01], [x, y, 0.01], [0.1, y, 0.01]])
    assert_allclose(mold.gap(rim, beside=7.0), 0.01, atol=SAME)


@pytest.mark.parametrize("seed", [None, 3])
def test_normals_of_the_file_do_not_matter(seed):
    vertices, faces = channel()
    turned = np.random.default_rng(seed).random(len(faces)) < 0.5
    turned |= seed is None
    other = np.where(turned[:, None], faces[:, ::-1], faces)
    molds = [OverhungGrid.from_mesh(vertices, f) for f in (faces, other)]
    points = np.random.default_rng(4).uniform(-0.09, 0.09, (2000, 3)) * [1, 1, 0.4]
    assert_allclose(molds[1].gap(points), molds[0].gap(points), atol=TURNED)


def test_pads_on_edges_are_found():
    mold = OverhungGrid.from_mesh(*channel(opening=0.05))
    xy = np.array([[-0.1, 0.0], [-0.04, 0.05], [0.0, 0.0], [0.06, -0.05], [0.1, 0.0]])
    found = pads_over_edges(mold, xy, 0.02, 0.003)
    assert [cup for cup, _ in found] == [1]
    assert found[0][1] > 0.02
    assert [cup for cup, _ in pads_over_edges(mold, xy, 0.03, 0.003)] == [1, 2]
    plain = HeightGrid(mold.origin, mold.step, mold.heights, mold.covered)
    assert pads_over_edges(plain, xy, 0.02, 0.003) == []


def panel_where(keep):
    """The example's panel, faces kept by their middles."""
    vertices, faces = read_mesh(EXAMPLES / "molds" / "panel.stl", "mm")
    x, y, _ = vertices[faces].mean(axis=1).T
    return trimesh.Trimesh(vertices, faces[keep(x, y)])


def targets_on(mesh, folder, **sections):
    """Cup targets of a scene on a mesh."""
    mesh.export(folder / "mold.stl")
    mold = {"mesh": {"path": "mold.stl", "unit": "m"}}
    data = {"format": "drapeplan-scene/1", "mold": mold, **sections}
    scene = scene_from(data, "test")
    return cup_targets(build_cell(scene, read_sources(scene, folder)))


@pytest.mark.parametrize(
    ("keep", "cup", "place"),
    [
        (lambda x, y: np.hypot(x, y) < 0.35, (0, 0), (-274, -384)),
        (lambda x, y: np.hypot(x - 0.165, y - 0.055) > 0.03, (4, 4), (165, 55)),
        (lambda x, y: (x < 0.02) | (y < 0.02), (4, 3), (55, 55)),
    ],
    ids=["disc", "hole under a cup", "L"],
)
def test_a_cup_beside_the_mold_is_an_answer(keep, cup, place, tmp_path):
    with pytest.raises(InfeasibleError) as answer:
        targets_on(panel_where(keep), tmp_path)
    assert answer.value.exit_code == 1
    assert f"cup {cup} would land off the mold, at x = {place[0]} mm, " in str(
        answer.value
    )
    assert f"y = {place[1]} mm" in str(answer.value)


def test_a_hole_between_the_cups_is_no_matter(tmp_path):
    net = targets_on(panel_where(lambda x, y: np.hypot(x - 0.11, y) > 0.03), tmp_path)
    assert len(net.xy) == 48


def test_a_tilted_mold_has_its_net(tmp_path):
    """The net turns with the mold: nothing of it knows the vertical."""
    level = panel_where(lambda x, y: x == x)
    turn = trimesh.transformations.rotation_matrix(np.radians(8), [0, 1, 0])
    flat = targets_on(level, tmp_path)
    tilted = targets_on(level.copy().apply_transform(turn), tmp_path)
    lengths = [
        np.linalg.norm(net.positions[:, None] - net.positions, axis=-1)
        for net in (flat, tilted)
    ]
    assert_allclose(lengths[1], lengths[0], atol=5e-4)


def test_a_mold_that_stands_on_its_side_is_an_answer(tmp_path):
    mesh = panel_where(lambda x, y: x == x)
    turn = trimesh.transformations.rotation_matrix(np.radians(100), [0, 1, 0])
    with pytest.raises(DrapeplanError) as answer:
        targets_on(mesh.apply_transform(turn), tmp_path)
    assert answer.value.exit_code in (1, 2)


def test_a_cup_on_an_edge_is_an_answer(tmp_path):
    mesh = trimesh.load_mesh(EXAMPLES / "molds" / "channel.stl")
    mesh.apply_scale(1e-3)
    with pytest.raises(InfeasibleError, match=r"pad of cup \(\d, 2\) would land on an"):
        targets_on(mesh, tmp_path, placement={"mold_point_m": [0.055, 0.0]})


def test_several_bodies_are_refused(tmp_path):
    block = trimesh.creation.box((0.1, 0.1, 0.1)).apply_translation([0, 0, 0.2])
    both = trimesh.util.concatenate([panel_where(lambda x, y: x == x), block])
    with pytest.raises(InputError, match="2 separate bodies"):
        targets_on(both, tmp_path)


def test_a_hole_under_a_cup_ends_the_command_in_a_line(drapeplan, tmp_path):
    mesh = panel_where(lambda x, y: np.hypot(x - 0.165, y - 0.055) > 0.03)
    mesh.export(tmp_path / "holed.stl")
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        "format: drapeplan-scene/1\nmold: {mesh: {path: holed.stl, unit: m}}\n"
    )
    ended = drapeplan("plan", scene, "-o", tmp_path / "plan.json")
    assert ended.code == 1
    assert ended.line.startswith("not drapable: cup (4, 4) would land off the mold")
    assert not (tmp_path / "plan.json").exists()
