"""The preview: what goes into the file, and what a browser makes of it."""

import base64
import hashlib
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal

from drapeplan.errors import DrapeplanError, InputError
from drapeplan.frames import inverse, moved
from drapeplan.mold import HeightGrid
from drapeplan.surfaces import Paraboloid
from tests.browser import (
    COLUMNS,
    ROWS,
    OpenPage,
    height,
    mold_mesh,
    synthetic_view,
)
from tests.spoiled import good_plan
from viewer import colors, geometry, objects, packing, page, scene
from viewer.plan_view import BESIDE, GAP_SHOWN, PENETRATION

POSITION = 10e-6  # [m] what a packed position may lose: a hundredth of a fiber's width
CLIPPED = 1e-6  # [m] by which ply put on the mold may miss it: one step along a normal
COLOR = 12  # of 255: the published red starts with a kink between two anchors
SAG = 1e-4  # [m] of a chord of a 20 mm cell on the least radius, both ways
MOST_BYTES = 4e6  # of the file, for 100 poses of 64 x 86 samples
SCENE = ("arm", "cups", "floor", "front", "interlinks", "marks", "mold", "ply", "tool")
HOSTILE = 'Ply "P03" </script><b>x</b> <!-- & \''
on_plan = pytest.mark.xdist_group("spoiled")  # one worker makes the plan


def in_browser(test):
    """One worker drives the browser; the marker lets a run leave it out."""
    return pytest.mark.browser(pytest.mark.xdist_group("browser")(test))


def unfolded(folded):
    """Inverse of packing.fold, by sums instead of the page's loops."""
    values = (folded >> 1) ^ (0 - (folded & 1))
    for axis in (1, 2, 3):
        values = np.cumsum(values, axis=axis, dtype=folded.dtype)
    return values


@given(
    arrays(np.uint16, (3, 4, 3, 5), elements=st.integers(0, 65535))
    | arrays(np.uint8, (1, 3, 4, 2), elements=st.integers(0, 255))
)
def test_folding_loses_nothing(values):
    assert_array_equal(unfolded(packing.fold(values)), values)


def test_folding_makes_a_smooth_motion_small():
    k, i, j = np.ogrid[:20, :30, :40]
    smooth = (20000 + 90 * k + 70 * i + 50 * j + i * j)[None].astype(np.uint16)
    assert np.median(packing.fold(smooth)) == 0


@given(st.floats(-5e-3, 60e-3))
def test_packed_gap_is_within_half_a_level(gap):
    level = int(packing.pack_gap(np.array([gap]), GAP_SHOWN, PENETRATION)[0])
    if gap < -PENETRATION:
        assert level == 0
    else:
        shown = GAP_SHOWN * (level - 1) / 254
        assert abs(shown - np.clip(gap, 0, GAP_SHOWN)) <= GAP_SHOWN / 508 + 1e-12


@pytest.mark.parametrize("name", colors.MAPS)
def test_colors_of_the_gap_are_the_published_maps(name):
    from matplotlib import colormaps

    published = colormaps[name.lower()](np.linspace(0, 1, 255))[:, :3] * 255
    assert_allclose(colors.gap_colors(name)[1:], published, atol=COLOR)


MACHADO = {
    "full": np.eye(3),
    "protan": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "deutan": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "tritan": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
}  # what is seen of linear red, green and blue [Machado2009]
APART = 30  # [CIELAB] between two colors that nobody takes for the same


def lightness(color, sight):
    """CIELAB of colors from 0 to 255 as a sight has them, shape (..., 3)."""
    linear = (np.asarray(color) / 255.0) ** 2.2 @ np.array(MACHADO[sight]).T
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722]]
    to_xyz += [[0.0193, 0.1192, 0.9505]]
    x, y, z = np.moveaxis(
        np.cbrt(np.clip(linear, 1e-3, 1) @ np.transpose(to_xyz) / [0.95, 1, 1.09]),
        -1,
        0,
    )
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


@pytest.mark.parametrize("sight", MACHADO)
@pytest.mark.parametrize("name", colors.MAPS)
def test_penetration_looks_like_no_gap(name, sight):
    penetration, *scale = lightness(colors.gap_colors(name).astype(float), sight)
    assert np.linalg.norm(scale - penetration, axis=-1).min() > APART
    assert np.all(np.diff(np.array(scale)[:, 0]) > -0.5)  # lighter with the gap


@given(st.floats(1e-3, 1e3))
def test_grid_spacing_is_round_and_sparse(extent):
    spacing = geometry.round_spacing(extent)
    assert 4 <= extent / spacing <= 16 + 1e-6
    digits = spacing / 10 ** np.floor(np.log10(spacing * (1 + 1e-9)))
    assert min(abs(digits - d) for d in (1, 2, 5)) < 1e-6


def test_mold_grid_lies_on_the_mold():
    view = synthetic_view(poses=2, samples=(4, 3))
    segments, spacing = geometry.mold_grid(view)
    local = segments - view.mold_placement[:3, 3]
    lines = np.rint(local / spacing) * spacing
    on_line = np.all(np.abs(local - lines)[..., :2] < 1e-9, axis=1)
    assert np.all(on_line[:, 0] | on_line[:, 1])
    sag = height(local[..., 0], local[..., 1]) - local[..., 2]
    assert_allclose(sag, 0, atol=SAG)
    length = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=-1).sum()
    assert length == pytest.approx(9 * 1.0 + 11 * 0.8, rel=0.05)


def test_grid_follows_a_turned_mold():
    turn = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1.0]])
    vertices, faces = mold_mesh(nx=38, ny=48)  # no grid line through a vertex
    placement = np.eye(4)
    placement[:3, :3] = turn
    view = synthetic_view(poses=2, samples=(4, 3))
    straight = replace(
        view, mold_vertices=vertices, mold_faces=faces, mold_placement=np.eye(4)
    )
    turned = replace(
        straight, mold_vertices=vertices @ turn.T, mold_placement=placement
    )
    lines, spacing = geometry.mold_grid(turned)
    assert_allclose(lines @ turn, geometry.mold_grid(straight)[0], atol=1e-9)
    assert spacing == 0.1


def test_skirt_hangs_from_the_whole_rim_and_from_nothing_else():
    vertices, faces = mold_mesh(nx=5, ny=4)
    walls, quads = geometry.skirt(vertices, faces, -0.3)
    assert len(quads) == 2 * 2 * (4 + 3)
    assert set(walls[:, 2]) <= set(vertices[:, 2]) | {-0.3}
    closed = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    assert len(geometry.boundary_edges(closed)) == 0


def test_boxes_hold_what_they_frame():
    view = synthetic_view(poses=5, samples=(6, 5))
    cell, tool = geometry.cell_box(view), geometry.tool_box(view)
    for name in ("mold_vertices", "ply_points", "universals"):
        points = getattr(view, name)
        assert np.all(points >= cell[0] - 1e-12)
        assert np.all(points <= cell[1] + 1e-12)
    assert np.all(cell[0] <= tool[0])
    assert np.all(cell[1] >= tool[1])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("gap", np.zeros((3, 2, 2))),
        ("cup_states", np.full((5, ROWS * COLUMNS), 4)),
        ("labels", ["one"]),
        ("balls", np.full((5, ROWS * COLUMNS, 3), np.nan)),
    ],
)
def test_wrong_arrays_are_named(name, value):
    view = synthetic_view(poses=5, samples=(6, 5))
    with pytest.raises(InputError, match="preview"):
        replace(view, **{name: value})


def test_gap_beside_the_mold_is_no_largest_gap():
    view = synthetic_view(poses=3, samples=(6, 5))
    gap = view.gap.copy()
    gap[1, 0], gap[2] = BESIDE, BESIDE
    beside = replace(view, gap=gap)
    assert beside.largest_gap()[1] == view.gap[1, 1:].max()
    assert beside.largest_gap()[2] == BESIDE


def test_drawn_mold_lies_on_its_grid():
    surface = Paraboloid(1.2, 2.5)
    x, y = -0.4 + 0.005 * np.arange(161), -0.5 + 0.005 * np.arange(201)
    heights = surface.height(*np.meshgrid(x, y, indexing="ij"))
    covered = np.ones(heights.shape, bool)
    covered[:40, :60] = False  # a corner of the grid that is no mold
    grid = HeightGrid((-0.4, -0.5), (0.005, 0.005), heights, covered)
    placement = np.array([[0, -1, 0, 2], [1, 0, 0, 3], [0, 0, 1, 4], [0, 0, 0, 1.0]])
    vertices, faces = scene.mold_mesh(grid, placement)
    local = (vertices - placement[:3, 3]) @ placement[:3, :3]
    assert_allclose(local[:, 2], surface.height(local[:, 0], local[:, 1]), atol=1e-9)
    corners = local[faces]
    edges = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.all(edges[:, 2] > 0)
    assert edges[:, 2].sum() / 2 == pytest.approx(0.8 - 0.2 * 0.3, abs=0.02)
    assert len(vertices) <= scene.NODES**2
    hole = (local[:, 0] < -0.22) & (local[:, 1] < -0.22)
    assert not np.any(hole)
    assert np.any(local[:, 0] < -0.39)


@pytest.fixture(scope="module")
def plan():
    return good_plan()


@pytest.fixture(scope="module")
def planned(plan):
    return scene.view_of(plan)


@on_plan
def test_view_has_a_pose_for_each_waypoint(plan, planned):
    assert planned.poses == len(plan.track.phase)
    assert list(plan.track.phase) == planned.phases
    assert planned.good == plan.verdict["good"]
    assert "paraboloid" in planned.title
    assert planned.cup_names[3 * 3 + 2] == "3,2"


@on_plan
def test_ply_of_the_view_hangs_on_its_cups(plan, planned):
    """Samples lie in the suction faces while these are off the mold, then stay."""
    cell = plan.cell
    near = np.hypot(
        cell.sampling.s[None] - 2 * cell.grid.pitch,
        cell.sampling.t[:, None] - 3 * cell.grid.pitch,
    )
    i, j = np.unravel_index(near.argmin(), near.shape)
    last = plan.track.held.stop
    cup, free = 3 * cell.grid.columns + 2, planned.gap[:last, i, j] >= 0
    away = (planned.ply_points[:, i, j] - planned.cup_positions[:, cup])[:last][free]
    normal = planned.cup_rotations[:last, cup, :, 2][free]
    assert 0.3 < free.mean()
    assert_allclose(np.sum(away * normal, axis=-1), 0, atol=1e-6)
    assert_allclose(np.linalg.norm(away, axis=-1), near[i, j], atol=1e-6)
    assert_array_equal(planned.ply_points[last:], planned.ply_points[last - 1 :][:-1])


@on_plan
def test_gap_of_the_view_is_the_molds(plan, planned):
    cell = plan.cell
    to_mold = inverse(cell.world_mold)
    local, _ = moved(to_mold, planned.ply_points, np.eye(3))
    over = planned.gap < BESIDE
    assert over[np.array(plan.track.phase) == "wave"].mean() > 0.9
    drawn, free = cell.mold.gap(local), over & (planned.gap >= 0)
    assert_allclose(drawn[free], planned.gap[free], atol=1e-9)
    assert_allclose(drawn[over & ~free], 0, atol=CLIPPED)


@on_plan
def test_legs_of_the_view_have_their_strokes(plan, planned):
    length = np.linalg.norm(planned.universals - planned.balls, axis=-1)
    least = plan.cell.robot.geometry.leg_min
    assert_allclose(length, least + plan.track.legs[..., 2], atol=1e-9)
    ends = planned.cup_positions[:, planned.interlinks]
    links = np.linalg.norm(ends[:, :, 0] - ends[:, :, 1], axis=-1)
    assert_allclose(links, plan.cell.grid.pitch, atol=1e-5)


@on_plan
def test_arm_of_the_view_holds_the_tool(planned):
    end = planned.arm_meshes[-1].vertices
    for k in (0, planned.poses // 2, planned.poses - 1):
        T_world_body, T_world_tool = (
            planned.arm_placements[k, -1],
            planned.tool_placement[k],
        )
        world = end @ T_world_body[:3, :3].T + T_world_body[:3, 3]
        below = (world - T_world_tool[:3, 3]) @ T_world_tool[:3, :3]
        assert abs(below[:, 2].max()) < 2e-3  # the meshes' own detail


@on_plan
def test_preview_of_a_plan_is_repeatable(plan, planned, tmp_path):
    page.export(planned, tmp_path / "a.html")
    page.export(scene.view_of(plan), tmp_path / "b.html")
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


@pytest.fixture(scope="module")
def view():
    return synthetic_view(title=HOSTILE, subtitle=HOSTILE)


@pytest.fixture(scope="module")
def file(view, tmp_path_factory):
    path = tmp_path_factory.mktemp("preview") / "preview.html"
    page.export(view, path)
    return path


def test_full_size_stays_small(tmp_path):
    path = tmp_path / "preview.html"
    figures = page.export(synthetic_view(poses=100, samples=(86, 64)), path)
    assert figures["size_bytes"] == path.stat().st_size < MOST_BYTES
    assert (figures["poses"], figures["samples"]) == (100, 64 * 86)


def test_same_plan_gives_the_same_bytes(file, tmp_path):
    again = tmp_path / "again.html"
    page.export(synthetic_view(title=HOSTILE, subtitle=HOSTILE), again)
    assert again.read_bytes() == file.read_bytes()


def test_a_failed_export_leaves_the_old_file(view, tmp_path, monkeypatch):
    path = tmp_path / "preview.html"
    path.write_text("old")

    def refuse(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", refuse)
    with pytest.raises(InputError, match=r"preview\.html"):
        page.export(view, path)
    assert [p.name for p in tmp_path.iterdir()] == ["preview.html"]
    assert path.read_text() == "old"


def test_policy_names_exactly_the_scripts_of_the_page(file):
    text = file.read_text()
    policy = re.search(r'Security-Policy" content="([^"]*)"', text)[1]
    scripts = re.findall(r"<script>(.*?)</script>", text, re.S)
    assert len(scripts) == 2
    for script in scripts:
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in policy
    assert policy.startswith("default-src 'none';")
    assert "unsafe-eval" not in policy
    assert "http" not in policy
    assert not re.search(r'(src|href)="(?!data:)', text)


def test_a_script_that_ends_its_element_is_refused(view, monkeypatch):
    ending = {"main.min.js": "</Script >"}
    monkeypatch.setattr(page, "_meshcat", lambda name: ending.get(name, "[]"))
    with pytest.raises(DrapeplanError, match="end its own element"):
        page.render(view)


def test_notices_are_inside(file):
    text = re.search(r'id="notices"[^>]*>(.*?)</script>', file.read_text(), re.S)[1]
    for name in ("meshcat", "three 0.", "dat.gui", "msgpack-lite", "UR10"):
        assert name in text
    assert text.count("Permission is hereby granted") >= 5
    assert "Robin Deits" in text


@pytest.fixture(scope="module")
def preview(browser, file):
    opened = OpenPage(browser, file)
    opened.rest()  # pixels() draws what it reads
    yield opened
    opened.context.close()


@in_browser
def test_page_shows_the_plan(preview, view):
    assert preview.run("document.body.dataset.ready") == "yes", preview.errors
    assert preview.run("viewer.renderer.getContext() instanceof WebGL2RenderingContext")
    assert preview.run("drape.cups.bodies.count") == ROWS * COLUMNS
    assert preview.run("drape.cups.legs.count") == ROWS * COLUMNS
    tree = preview.run("Object.keys(viewer.scene_tree.children.meshcat.children)")
    assert set(SCENE) <= set(tree)
    answer = [preview.page.text_content(".answer")]
    others = preview.page.locator(".verdict li").all_text_contents()
    assert answer + others == view.verdict
    assert preview.page.title() == HOSTILE


@in_browser
def test_rigid_parts_are_those_of_the_plan(preview, view):
    for path, vertices in (
        ("mold.children.surface", view.mold_vertices),
        ("arm.children[0]", view.arm_meshes[0].vertices),
    ):
        node = (
            f"viewer.scene_tree.children.meshcat.children.{path}.children['<object>']"
        )
        shape = preview.run(
            f"Array.from({node}.object.geometry.attributes.position.array)"
        )
        assert_allclose(np.reshape(shape, (-1, 3)), vertices, atol=1e-6)
    color = preview.run(f"Array.from({node}.object.geometry.attributes.color.array)")
    assert_allclose(np.reshape(color, (-1, 3)), view.arm_meshes[0].colors, atol=1e-6)
    plate = "viewer.scene_tree.children.meshcat.children.tool.children.platform"
    box = f"{plate}.children.plate.children['<object>'].object.geometry.parameters"
    lengths = preview.run(f"[{box}.width, {box}.height]")
    assert_allclose(lengths, view.platform_size)
    place = f"{plate}.children.plate.children['<object>'].object.position.toArray()"
    upper = view.tool_placement[0, 2, 3] - view.universals[0, 0, 2]
    assert_allclose(
        preview.run(place), [0, 0, upper - objects.THICKNESS / 2], atol=1e-9
    )


@in_browser
def test_texts_of_the_plan_are_never_markup(preview):
    assert preview.page.text_content(".title") == HOSTILE
    assert preview.page.text_content(".subtitle") == HOSTILE
    assert preview.page.locator("header b").count() == 0


@in_browser
@pytest.mark.parametrize("pose", [0, 11, 23])
def test_shapes_are_those_of_the_plan(preview, view, pose):
    preview.run("pose => app.timeline.jump(pose)", pose)
    shown = {
        key: np.reshape(preview.run(f"Array.from({source})"), (-1, 3))
        for key, source in {
            "ply": "drape.ply.points.array",
            "faces": "drape.cups.at.faces",
            "balls": "drape.cups.at.balls",
            "universals": "drape.cups.at.universals",
        }.items()
    }
    ply = view.ply_points[pose].reshape(-1, 3)
    assert_allclose(shown["ply"], ply, rtol=0, atol=POSITION)
    assert_allclose(shown["faces"], view.cup_positions[pose], rtol=0, atol=POSITION)
    assert_allclose(shown["balls"], view.balls[pose], rtol=0, atol=POSITION)
    assert_allclose(shown["universals"], view.universals[pose], rtol=0, atol=POSITION)
    counts = preview.page.locator("#figures .count").all_inner_texts()
    wanted = np.bincount(view.cup_states[pose], minlength=4)
    assert_array_equal(np.array(counts, int), wanted)
    assert view.labels[pose] in preview.page.inner_text("#label")
    for node, at in (
        ("tool.children.platform", view.tool_placement[pose]),
        ("arm.children[0]", view.arm_placements[pose, 0]),
    ):
        place = f"viewer.scene_tree.children.meshcat.children.{node}.object"
        preview.run(f"() => {place}.updateMatrix()")
        matrix = preview.run(f"{place}.matrix.elements")
        assert_allclose(np.reshape(matrix, (4, 4)).T, at, atol=1e-6)


@in_browser
def test_cups_and_legs_stand_where_the_plan_says(preview, view):
    """The cylinders themselves, by their matrices: center and length."""
    preview.run("app.timeline.jump(11)")
    for mesh, ends in (
        ("bodies", (view.cup_positions[11], None)),
        ("legs", (view.balls[11], view.universals[11])),
    ):
        raw = preview.run(f"Array.from(drape.cups.{mesh}.instanceMatrix.array)")
        matrices = np.reshape(raw, (-1, 4, 4)).swapaxes(1, 2)
        half = matrices[:, :3, 1] / 2
        assert_allclose(matrices[:, :3, 3] - half, ends[0], atol=2 * POSITION)
        if ends[1] is not None:
            assert_allclose(matrices[:, :3, 3] + half, ends[1], atol=2 * POSITION)
        else:
            normal = view.cup_rotations[11, :, :, 2]
            assert_allclose(half, 0.0075 * normal, atol=2 * POSITION)


@in_browser
def test_colors_follow_the_wave(preview):
    """Contact is dark blue, the lifted ply yellow, placed cups green."""
    preview.run("app.look('Top')")
    shares = []
    for pose in (0, 11, 23):
        preview.run("pose => app.timeline.jump(pose)", pose)
        red, green, blue = np.moveaxis(preview.pixels(), -1, 0)
        dark = (red < 50) & (green < 70) & (blue > 50) & (blue < 140)
        yellow = (red > 190) & (green > 170) & (blue < 130)
        placed = (green > 100) & (red < 60) & (blue < 150) & (blue > 70)
        shares.append([np.mean(mask) for mask in (dark, yellow, placed)])
    dark, yellow, placed = np.transpose(shares)
    assert dark[0] < dark[1] < dark[2]
    assert yellow[0] > yellow[1] > yellow[2]
    assert placed[0] < placed[1] < placed[2]
    assert dark[2] > 0.06
    assert yellow[0] > 0.05


@in_browser
def test_slider_keys_and_buttons_move_through_the_poses(preview, view):
    page_, last = preview.page, view.poses - 1
    preview.run("app.timeline.jump(5)")
    for focus in ("#slider", "#play"):
        page_.focus(focus)
        for key, pose in (("End", last), ("ArrowLeft", last - 1), ("Home", 0)):
            page_.keyboard.press(key)
            assert preview.run("app.pose") == pose
        page_.keyboard.press("ArrowRight")
        assert preview.run("app.pose") == 1
    page_.fill("#slider", "7")
    assert preview.run("app.pose") == 7
    page_.click("#next")
    page_.click("#next")
    page_.click("#prev")
    assert preview.run("app.pose") == 8
    page_.keyboard.press("Home")
    page_.focus("#slider")
    page_.keyboard.press(" ")
    preview.wait("app.pose >= 2")
    page_.keyboard.press(" ")
    assert preview.run("app.timeline.timer") is None


@in_browser
def test_address_holds_pose_and_view(preview):
    preview.run("app.timeline.jump(9)")
    preview.page.locator("#views button", has_text="Side").click()
    preview.wait("location.hash === '#pose=10&cam=Side'")
    pressed = preview.page.locator("#views button[aria-pressed=true]")
    assert pressed.all_inner_texts() == ["Side"]
    preview.run("() => { location.hash = '#pose=3&cam=Top' }")
    preview.wait("app.pose === 2 && app.view === 'Top'")
    preview.run("() => { location.hash = '#pose=x&cam=nowhere' }")
    preview.wait("location.hash === '#pose=3&cam=Top'")


FRAMED = """(name) => {
  const { viewer, plan } = drape;
  app.look(name);
  viewer.camera.updateMatrixWorld();
  const preset = app.book.views.find((v) => v.name === name);
  const seen = corners(plan.boxes[preset.box]).map((p) => p.project(viewer.camera));
  viewer.scene.updateMatrixWorld();
  const mold = viewer.scene_tree.find(["meshcat", "mold", "surface", "<object>"]).object;
  const point = new MeshCat.THREE.Vector3(), points = mold.geometry.attributes.position;
  for (let i = 0; i < points.count; i++) {
    point.fromBufferAttribute(points, i);
    seen.push(mold.localToWorld(point).project(viewer.camera).clone());
  }
  const foot = document.getElementById("foot").getBoundingClientRect().top;
  const right = document.getElementById("side").getBoundingClientRect().left;
  const x = seen.map((p) => (p.x + 1) / 2 * innerWidth);
  const y = seen.map((p) => (1 - p.y) / 2 * innerHeight);
  const z = seen.map((p) => p.z);
  const box = [Math.min(...x), right - Math.max(...x), Math.min(...y), foot - Math.max(...y)];
  return { box, near: Math.min(...z), far: Math.max(...z) };
}"""  # noqa: E501


def assert_framed(opened):
    for name in ("Iso", "Top", "Front", "Side", "Cell"):
        seen = opened.run(FRAMED, name)
        assert min(seen["box"]) >= 0, (name, seen)
        assert -1 < seen["near"] < seen["far"] < 1
        left, right, top, bottom = seen["box"]
        assert left + right < 500 or top + bottom < 200, (name, seen)  # fills the room


@in_browser
def test_presets_frame_the_scene(preview):
    assert_framed(preview)


@in_browser
@pytest.mark.parametrize(
    ("scale", "origin"), [(0.05, (0.2, -0.3, 0.0)), (20.0, (30.0, -50.0, 4.0))]
)
def test_presets_frame_any_size_anywhere(browser, tmp_path, scale, origin):
    path = tmp_path / "preview.html"
    page.export(synthetic_view(4, (12, 9), origin, scale), path)
    opened = OpenPage(browser, path, size=(1280, 720))
    opened.rest()
    assert_framed(opened)
    assert opened.errors == []
    opened.context.close()


@in_browser
def test_panels_do_not_overlap(preview):
    boxes = [
        preview.page.locator(name).bounding_box()
        for name in (".head", "#side", "#foot")
    ]
    for k, a in enumerate(boxes):
        for b in boxes[:k]:
            apart_x = a["x"] >= b["x"] + b["width"] or b["x"] >= a["x"] + a["width"]
            apart_y = a["y"] >= b["y"] + b["height"] or b["y"] >= a["y"] + a["height"]
            assert apart_x or apart_y


@in_browser
def test_a_cut_file_says_so(browser, file, tmp_path):
    text = file.read_text()
    start = text.index("payload") + 500
    path = tmp_path / "cut.html"
    path.write_text(text[:start] + "@@" + text[start + 2 :])
    opened = OpenPage(browser, path)
    assert opened.run("document.body.dataset.ready") == "failed"
    assert "incomplete" in opened.page.inner_text("[role=alert]")
    opened.context.close()


@in_browser
def test_nothing_is_fetched_and_nothing_complains(preview):
    """Last of the shared page: everything above went without a word."""
    assert preview.errors == []
    assert preview.external() == []
