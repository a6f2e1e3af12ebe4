"""The page in a browser: two drapes on one time line, steps, marks, small windows."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tests.browser import OpenPage, find_browser, synthetic_view
from viewer import colors, page
from viewer.moments import moments
from viewer.plan_view import Event, LongFiber

pytestmark = [pytest.mark.browser, pytest.mark.xdist_group("browser")]

SAMPLES = (29, 22)
LEVEL = 0.25 * 30e-3 / 254  # [m] of gap, a quarter of a packed level: rounding of marks
CARD, PHONE = (1280, 720), (390, 844)  # [px]
NO_3D = ["--no-sandbox", "--disable-gpu", "--disable-3d-apis"]
MARK = 14  # pose of the marked faults


def faulty(view):
    """The view with a premature contact, an air pocket and a long fiber at one pose."""
    index = np.arange(np.prod(SAMPLES)).reshape(SAMPLES)
    place = float(view.s[4]), float(view.t[3])
    told = 40e-4, 1e-6, 5e-3, "somewhere"
    found = (
        Event("premature_contact", MARK, index[2:5, 3:6].ravel(), place, *told),
        Event("air_pocket", MARK, index[12:15, 9:12].ravel(), place, *told),
        Event("air_pocket", MARK + 1, index[12:15, 9:12].ravel(), place, *told, True),
    )
    fiber = LongFiber("s", np.array([MARK]), index[20, 3:9], (0, 1), 0.0, 2e-3, 9e-3)
    return replace(view, good=False, events=found, long_fibers=(fiber,))


@pytest.fixture(scope="module")
def views():
    """Two drapes: the second is larger, elsewhere, and has fewer poses."""
    told = {"title": "Second <b>", "touch": 4e-3, "penetration": 2e-3}
    small = synthetic_view(12, SAMPLES, (4.0, 1.0, 0.3), 2.0, **told)
    return faulty(synthetic_view(24, SAMPLES)), small


@pytest.fixture(scope="module")
def pair(browser, views, tmp_path_factory):
    path = tmp_path_factory.mktemp("pair") / "pair.html"
    page.export(views, path)
    opened = OpenPage(browser, path, "#step=2&cam=Top", size=CARD)
    opened.rest()
    yield opened
    opened.context.close()


def shown(opened):
    """Pose of each drape and the moment of the page."""
    poses = opened.run("app.drapes.map(({ pose }) => pose)")
    return opened.run("app.pose"), tuple(poses)


def test_address_opens_the_end_of_a_step(pair, views):
    line = moments(views)
    ends = [k for k, moment in enumerate(line) if moment.step == 2]
    assert shown(pair) == (ends[-1], line[ends[-1]].poses) == (7, (7, 7))
    assert pair.run("app.view") == "Top"


def test_drapes_share_one_time_line(pair, views):
    line = moments(views)
    assert pair.run("Number(document.getElementById('slider').max)") == len(line) - 1
    for k in (0, 3, 9, 14, len(line) - 1):
        pair.page.fill("#slider", str(k))
        assert shown(pair) == (k, line[k].poses)
        for i, (view, pose) in enumerate(zip(views, line[k].poses, strict=True)):
            points = pair.run(f"Array.from(app.drapes[{i}].ply.points.array)")
            wanted = view.ply_points[pose].ravel()
            assert_allclose(points, wanted, rtol=0, atol=20e-6)
            now = pair.page.locator(".head .now").nth(i)
            assert now.inner_text() == view.labels[pose]
            pane = pair.page.locator(".pane").nth(i)
            assert view.labels[pose] in pane.get_attribute("aria-label")
            cells = pair.page.locator(f"#figures td.count:nth-child({i + 2})")
            counts = np.bincount(view.cup_states[pose], minlength=4)
            assert_array_equal(np.array(cells.all_inner_texts(), int), counts)


def test_titles_and_verdicts_are_each_ones_own(pair, views):
    titles = pair.page.locator(".head .title").all_text_contents()
    assert titles == [
        f"{letter} · {v.title}" for letter, v in zip("AB", views, strict=True)
    ]
    signs = [
        pair.run(f"document.querySelectorAll('.answer')[{i}].className") for i in (0, 1)
    ]
    assert ["bad" in signs[0], "good" in signs[1]] == [True, True]
    assert pair.page.locator("#legend").count() == 1


def test_cameras_move_together_until_told_not_to(pair):
    place = "app.drapes.map(({ viewer, home }) => viewer.camera.position.clone()"
    place += ".sub(viewer.controls.target).divideScalar(home.distance).toArray())"
    pair.run("app.look('Iso')")

    def drag():
        box = pair.page.locator(".pane").first.bounding_box()
        pair.page.mouse.move(box["x"] + 200, box["y"] + 300)
        pair.page.mouse.down()
        pair.page.mouse.move(box["x"] + 280, box["y"] + 340)
        pair.page.mouse.up()

    start = np.array(pair.run(place))
    drag()
    turned = np.array(pair.run(place))
    assert np.abs(turned[0] - start[0]).max() > 0.1
    assert_allclose(turned[1], turned[0], atol=1e-6)
    pair.page.click("#together")
    drag()
    alone = np.array(pair.run(place))
    assert np.abs(alone[0] - turned[0]).max() > 0.1
    assert_allclose(alone[1], turned[1], atol=1e-9)
    pair.page.click("#together")
    pair.run("app.look('Iso')")


def test_buttons_and_keys_go_from_step_to_step(pair):
    pair.run("app.timeline.jump(0)")
    ends = []
    for _ in range(3):
        pair.page.click("#next-step")
        ends.append(pair.run("app.pose"))
    assert ends == [2, 3, 7]  # approach, steps 1 and 2
    pair.page.click("#prev-step")
    assert pair.run("app.pose") == 3
    pair.page.focus("#play")
    for key, pose in (
        *(("PageDown", 7), ("Shift+ArrowRight", 11), ("ArrowLeft", 10)),
        *(("PageUp", 7), ("Shift+ArrowLeft", 3)),
    ):
        pair.page.keyboard.press(key)
        assert pair.run("app.pose") == pose, key
    for key, name in (("2", "Top"), ("1", "Iso")):
        pair.page.keyboard.press(key)
        assert pair.run("app.view") == name
    pair.page.keyboard.press("?")
    keys = pair.page.locator("#help dd").all_inner_texts()
    assert any("next step" in text for text in keys)
    pair.page.keyboard.press("PageDown")
    assert pair.run("app.pose") == 3  # keys rest while the help is open
    pair.page.keyboard.press("Escape")


def test_address_names_the_step_only_at_its_end(pair):
    for address, pose, written in (
        ("#step=3&cam=Side", 11, "#step=3&cam=Side"),
        ("#pose=11&cam=Side", 10, "#pose=11&cam=Side"),
        ("#pose=12&cam=Top", 11, "#step=3&cam=Top"),
        ("#step=99", 11, "#step=3&cam=Top"),
    ):
        pair.run("(address) => { location.hash = address }", address)
        pair.wait(f"app.pose === {pose} && location.hash === '{written}'")


def test_faults_are_marked_where_and_when_they_happen(pair, views):
    marks = "app.drapes[0].marks"
    pair.page.fill("#slider", str(MARK))
    for event in views[0].events:
        region = f"{marks}.regions.{event.kind}"
        corners = pair.run(f"Array.from({region}.geometry.index.array)")
        assert set(event.samples) <= set(corners)
        rows, columns = np.divmod(np.array(corners), SAMPLES[1])
        own = np.divmod(event.samples, SAMPLES[1])
        assert rows.min() >= own[0].min() - 1
        assert columns.max() <= own[1].max() + 1
        assert pair.run(f"{region}.visible")
    ply = views[0].ply_points[MARK].reshape(-1, 3)[views[0].long_fibers[0].samples]
    raw = pair.run(
        f"Array.from({marks}.fibers.instanceMatrix.array).slice(0, 16 * {marks}.fibers.count)"  # noqa: E501
    )
    middles = np.reshape(raw, (-1, 4, 4))[:, 3, :3]
    assert_allclose(middles, (ply[1:] + ply[:-1]) / 2, atol=20e-6)
    told = pair.run(f"{marks}.labels().map(({{ text }}) => text)")
    assert sorted(told) == [
        *("∿ fiber too long, 2.00 mm", "▲ premature contact, 40 cm²"),
        "◉ air pocket, 5.0 mm",
    ]
    faults = pair.page.locator("#figures td.fault").all_inner_texts()
    assert faults == ["1", "0", "1", "0", "1", "0"]
    pair.page.fill("#slider", str(MARK + 1))
    told = pair.run(f"{marks}.labels().map(({{ text }}) => text)")
    assert told == ["◉ air pocket, on the way here"]
    pair.page.fill("#slider", str(MARK - 1))
    assert pair.run(f"{marks}.now.length") == 0
    assert not pair.run(f"{marks}.regions.air_pocket.visible")


@pytest.mark.parametrize("drape", [0, 1])
def test_front_runs_where_the_ply_leaves_the_mold(pair, views, drape):
    """Every point of the line lies on the ply at the height of its drape's touch."""
    pair.page.fill("#slider", "9")
    front, pose = f"app.drapes[{drape}].front.mesh", shown(pair)[1][drape]
    raw = pair.run(
        f"Array.from({front}.instanceMatrix.array).slice(0, 16 * {front}.count)"
    )
    matrices = np.reshape(raw, (-1, 4, 4))
    ends = matrices[:, 3, :3] + matrices[:, 1, :3] / 2
    view = views[drape]
    y = view.ply_points[pose, :, 0, 1]  # the gap of this drape depends on y alone
    above = view.gap[pose, :, 0] - view.gap[-1, :, 0]
    assert len(ends) >= 2 * (SAMPLES[1] - 1)
    assert_allclose(np.interp(ends[:, 1], y, above), view.touch, atol=2 * LEVEL + 5e-5)


def test_legend_names_the_depth_of_each_drape(pair, views):
    depths = " | ".join(f"{1e3 * view.penetration:.1f} mm" for view in views)
    assert pair.page.inner_text("#depth-text") == f"Penetrates > {depths}"
    assert views[0].penetration != views[1].penetration


def test_colors_can_be_changed(pair, views):
    view = views[0]
    packed = pair.run("Array.from(app.drapes[0].ply.levels(app.drapes[0].pose))")
    for name in reversed(colors.MAPS):
        pair.page.select_option("#palette", name)
        painted = pair.run("Array.from(app.drapes[0].ply.colors.array)")
        wanted = colors.gap_colors(name)[packed] / 255
        assert_allclose(np.reshape(painted, (-1, 3)), wanted, atol=1e-6)
    assert len(packed) == view.gap[0].size


def test_switches_hide_parts_in_all_drapes(pair):
    pair.run("app.look('Iso')")
    pair.page.click("#menu summary")
    for name in page.PARTS:
        pair.page.locator("#parts label", has_text=name).click()
        seen = f"app.drapes.map((drape) => drape.part('{name}').visible)"
        assert pair.run(seen) == [False, False], name
        pair.page.locator("#parts label", has_text=name).click()
        assert pair.run(seen) == [True, True], name
    pair.page.click("#menu summary")


def inside(opened, selector):
    """Boxes of what is visible, (left, top, right, bottom) in the page, in pixels."""
    return opened.run(
        """(selector) => [...document.querySelectorAll(selector)]
        .map((item) => item.getBoundingClientRect()).filter((box) => box.width)
        .map((b) => [b.left, b.top + scrollY, b.right, b.bottom + scrollY])""",
        selector,
    )


def overlapping(boxes):
    return [
        (a, b)
        for k, a in enumerate(boxes)
        for b in boxes[:k]
        if min(a[2], b[2]) - max(a[0], b[0]) > 1
        and min(a[3], b[3]) - max(a[1], b[1]) > 1
    ]


def test_nothing_overlaps_and_everything_can_be_reached(pair):
    for size, parts in (
        (CARD, ".head, #side, #foot"),
        (PHONE, ".head, .pane, #side, #foot"),
    ):
        pair.page.set_viewport_size(dict(zip(("width", "height"), size, strict=True)))
        pair.wait(
            f"innerWidth === {size[0]} &&"
            " app.drapes.every(({ dom, viewer }) => dom.pane.clientWidth"
            " === viewer.renderer.domElement.clientWidth)"
        )
        assert overlapping(inside(pair, parts)) == [], size
        controls = inside(pair, "#foot button, #foot summary, #slider, #palette")
        assert len(controls) > 10
        assert overlapping(controls) == [], size
        for left, _, right, bottom in controls:
            assert left >= 0, size
            assert right <= size[0], size
            assert bottom <= pair.run("document.documentElement.scrollHeight")
        assert pair.run("document.documentElement.scrollWidth") <= size[0]
    for name in ("#next-step", "#ask", "#palette", "#about"):
        pair.page.locator(name).scroll_into_view_if_needed()
        hit = """(id) => { const button = document.querySelector(id),
            box = button.getBoundingClientRect(); return document.elementFromPoint(
            (box.left + box.right) / 2, (box.top + box.bottom) / 2) === button }"""
        assert pair.run(hit, name), name
    pair.page.set_viewport_size({"width": CARD[0], "height": CARD[1]})


def test_controls_have_names(pair):
    """For readers who hear the page."""
    unnamed = pair.run(
        """() => [...document.querySelectorAll("button, input, select, canvas, aside, footer, dialog")]
        .filter((item) => !item.closest(".pane, template, .dg") && !item.getAttribute("aria-hidden"))
        .filter((item) => !(item.textContent.match(/[a-z]/i) || item.getAttribute("aria-label")
          || item.labels?.length)).map((item) => item.outerHTML)"""  # noqa: E501
    )
    assert unnamed == []


def test_nothing_was_fetched_and_nothing_complained(pair):
    """Last of the shared page: everything above went without a word."""
    assert pair.errors == []
    assert pair.external() == []


def test_a_browser_without_webgl_says_so(browser, pair, views):
    bare = browser.browser_type.launch(executable_path=find_browser(), args=NO_3D)
    opened = OpenPage(bare, pair.path)
    assert opened.run("document.body.dataset.ready") == "failed"
    said = opened.page.inner_text("[role=alert]")
    assert "WebGL" in said
    for view in views:  # what can be read without a picture
        assert all(line in said for line in (view.title, *view.verdict))
    assert not opened.page.is_visible("#foot")
    assert opened.errors == []
    bare.close()
