"""The panels of the page: what a reader clicks and reads, against the view's arrays."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from ply.grid import CupGrid
from ply.sampling import PlySampling
from tests.browser import COLUMNS, ROWS, OpenPage, synthetic_view
from viewer import page
from viewer.plan_view import MARGIN_SHOWN, Event, LongFiber, Statement

pytestmark = [pytest.mark.browser, pytest.mark.xdist_group("browser")]
HOSTILE = '</script><img src=x onerror="boom()"> & <b>fold</b>'
STEP = 10e-6  # [m] of packed gaps and points
PIXEL = 0.02  # [px] to which places of a figure are written
POSES, FAULTY = 12, 7  # poses, and the one at which a pocket closes
GRID = CupGrid(ROWS, COLUMNS, 0.110, 0.020)
SAMPLING = PlySampling.regular(GRID, 0.010, 0.020)
PLACE = (0.22, 0.33)  # [m] on cup (3, 2)


def quantiles(*values):
    return dict(zip(("5", "50", "95"), values, strict=True))


ROBUST = {
    "samples": 64,
    "wrong_order": {"samples": 8, "share": 0.125, "low_95": 0.06, "high_95": 0.23},
    "parameters": [
        {
            "parameter": "angle",
            "samples": 32,
            "P": 0.1,
            "margin_mm": quantiles(-0.4, 0.8, 2.0),
            "press_mm": quantiles(0.6, 0.8, 1.0),
        },
        {
            "parameter": HOSTILE,
            "samples": 32,
            "P": 0.0,
            "margin_mm": quantiles(1.0, 3.0, None),
            "press_mm": quantiles(0.1, 0.2, 0.3),
        },
    ],
}


def findings():
    """An air pocket in the patch beside a cup, a fiber, margins, and sentences."""
    around = SAMPLING.cups_around.reshape(-1, 4)
    patch = np.flatnonzero((around == (20, 21, 26, 27)).all(axis=1))
    event = Event("air_pocket", FAULTY, patch, PLACE, 4e-4, 1e-6, 2e-3, "A pocket.")
    fiber = np.arange(10, 18)
    long = LongFiber("s fiber", np.array([2, 3]), fiber, (0, 1), 0.0, 2e-3, 3e-3)
    margins = np.full((POSES, 2), MARGIN_SHOWN)
    margins[FAULTY] = 1e-3, -0.5e-3
    margins[FAULTY - 1] = 2e-3, 0.7e-3
    rungs = np.zeros((POSES, 82), np.uint8)
    rungs[FAULTY, GRID_LINK] = 1
    told = (
        Statement("Out of order.", wrong=True),
        Statement(f"A pocket {HOSTILE}", wrong=True, pose=FAULTY, place=PLACE),
        Statement("Later.", pose=POSES - 1),
        Statement("Nothing to see."),
    )
    return {
        "s": SAMPLING.s,
        "t": SAMPLING.t,
        "cups_around": SAMPLING.cups_around,
        "pads": SAMPLING.cup_index,
        "margins": margins,
        "wave_step": np.where(np.arange(POSES) < 3, -1, (np.arange(POSES) - 3) // 3),
        "events": (event,),
        "long_fibers": (long,),
        "rungs": ("cubic", "modal"),
        "strip_rungs": rungs,
        "statements": told,
        "verdict": [one.text for one in told],
        "good": False,
        "facts": (("Mold", HOSTILE), ("Arm", "ur10")),
        "robustness": ROBUST,
    }


GRID_LINK = 3 * 5 + 2  # interlink along s between cups (3, 2) and (3, 3)


@pytest.fixture(scope="module")
def view():
    samples = (len(SAMPLING.t), len(SAMPLING.s))
    plain = synthetic_view(poses=POSES, samples=samples, arm_meshes=[])
    gap = plain.gap.copy()
    gap[FAULTY, 40, 30] = -2.36e-3  # deeper than the colors tell
    return replace(plain, gap=gap, **findings())


@pytest.fixture(scope="module")
def opened(browser, view, tmp_path_factory):
    path = tmp_path_factory.mktemp("panels") / "page.html"
    page.export(view, path)
    shown = OpenPage(browser, path, size=(1280, 720))
    shown.rest()
    shown.run("() => app.look('Top')")
    yield shown
    shown.context.close()


TOLD = (  # of a plan in order that is not good
    Statement("Cup high.", wrong=True, pose=2, place=(0.11, 0.22)),
    Statement("Heavy.", warns=True),
    Statement("In order."),
    Statement("Room left.", aside=True),
    Statement("Nearest there.", pose=1, aside=True),
)


@pytest.fixture(scope="module")
def compared(browser, view, tmp_path_factory):
    """The same drape beside one of fewer poses, neither with a figure on P."""
    path = tmp_path_factory.mktemp("panels") / "two.html"
    plain = replace(view, robustness=None)
    other = synthetic_view(poses=4, samples=(9, 8), arm_meshes=[], statements=TOLD)
    page.export([plain, other], path)
    shown = OpenPage(browser, path, size=(1280, 720))
    shown.rest()
    yield shown
    shown.context.close()


def panel(opened, name, on=True):
    button = opened.page.locator("#panels button", has_text=name)
    if (button.get_attribute("aria-pressed") == "true") != on:
        button.click()


def polyline(opened, selector):
    """Places of a drawn line, shape (m, 2), in pixels."""
    text = opened.page.locator(selector).get_attribute("points")
    return np.array([pair.split(",") for pair in text.split()], float)


def point_at(view, pose, place):
    i = abs(view.t - place[1]).argmin()
    j = abs(view.s - place[0]).argmin()
    return view.ply_points[pose, i, j]


@pytest.mark.parametrize("how", ["click", "Enter"])
def test_verdict_leads_to_its_moment_and_place(opened, view, how):
    opened.run("() => { app.timeline.jump(0); app.look('Top'); }")
    opened.run("() => { document.querySelector('.head details').open = true; }")
    entry = opened.page.locator(".verdict .jump").first
    if how == "click":
        entry.click()
    else:
        entry.focus()
        opened.page.keyboard.press("Enter")
    assert opened.run("drape.pose") == FAULTY
    x, y, z = opened.run("viewer.controls.target.toArray()")
    wanted = point_at(view, FAULTY, PLACE)
    assert_allclose([x, -z, y], wanted, atol=2 * STEP)
    assert_allclose(opened.run("drape.pin.mesh.position.toArray()"), wanted, atol=1e-4)
    assert opened.run("drape.pin.mesh.visible")
    opened.run("() => app.timeline.jump(0)")
    assert not opened.run("drape.pin.mesh.visible")


def test_a_sentence_without_place_moves_no_camera(opened):
    opened.run("() => { app.timeline.jump(0); app.look('Top'); }")
    before = opened.run("viewer.camera.position.toArray()")
    opened.run("() => document.querySelectorAll('.verdict .jump')[1].click()")
    assert opened.run("drape.pose") == POSES - 1
    assert opened.run("viewer.camera.position.toArray()") == before
    assert opened.page.locator(".verdict .jump").count() == 2
    assert opened.page.locator(".verdict li").count() == 3
    assert opened.page.locator(".verdict li.wrong").count() == 1


def test_a_fault_that_heads_the_verdict_leads_to_its_place(compared):
    column = compared.page.locator(".drape").nth(1)
    column.locator(".answer").click()
    entries = column.locator(".head > details > .verdict > li")
    first = entries.first
    assert first.get_attribute("class") == "wrong"
    compared.run("() => app.timeline.jump(0)")
    first.locator(".jump", has_text="Cup high.").click()
    assert compared.run("app.drapes[1].pose") == 2
    assert compared.run("app.drapes[1].pin.mesh.visible")
    column.locator(".answer").click()


def test_warnings_are_in_sight_and_the_rest_is_folded(compared):
    column = compared.page.locator(".drape").nth(1)
    column.locator(".answer").click()
    assert column.locator("li.warns").inner_text() == "Heavy."
    folded = column.locator(".more li")
    assert [entry.is_visible() for entry in folded.all()] == [False, False]
    column.locator(".more summary", has_text="2 more").click()
    assert folded.all_inner_texts() == ["Room left.", "Nearest there."]
    folded.nth(1).locator(".jump").click()
    assert compared.run("app.drapes[1].pose") == 1
    column.locator(".answer").click()


def test_curves_are_the_arrays(opened, view):
    """Of contact and margin, between their zero lines and their ends."""
    share, least = view.contact_share(), view.margins.min(axis=1)
    for name, values in (("contact", share), ("margin", least)):
        line = polyline(opened, f"#chart polyline.{name}")
        drawn = opened.run(f"[app.curves.{name}(0), app.curves.{name}(1e-3)]")
        low, per_mm = drawn[0], drawn[1] - drawn[0]
        assert per_mm < 0  # up
        assert_allclose(line[:, 1], low + 1e3 * values * per_mm, atol=PIXEL)
        assert_allclose(np.diff(line[:, 0], n=2), 0, atol=2 * PIXEL)
        assert line[:, 1].min() >= 0


def test_faults_and_steps_stand_where_they_are(opened):
    """A strip for each kind over its poses, a numbered tick at each step's end."""
    x = np.array(
        opened.run(f"Array.from({{ length: {POSES} }}, (_, k) => app.curves.x(k))")
    )
    half = (x[1] - x[0]) / 2
    for kind, first, last in (("air_pocket", FAULTY, FAULTY), ("slack_fiber", 2, 3)):
        strip = opened.page.locator(f"#chart [data-kind={kind}]")
        left = float(strip.get_attribute("x"))
        width = float(strip.get_attribute("width"))
        assert_allclose([left, left + width], [x[first] - half, x[last] + half])
    marks = opened.page.locator("#chart .step").all()
    places = [float(mark.get_attribute("x1")) for mark in marks]
    assert_allclose(places, x[[5, 8, 11]])
    numbers = opened.page.locator("#chart .number").all_text_contents()
    assert numbers == ["0", "1", "2"]


def test_curves_follow_and_lead(opened, view):
    """The label says what is drawn at the cursor; a press on the chart jumps there."""
    opened.run(f"() => app.timeline.jump({FAULTY})")
    label = opened.page.locator("#chart").get_attribute("aria-label")
    assert "margin -0.50 mm" in label
    assert f"{100 * view.contact_share()[FAULTY]:.1f} %" in label
    cursor = float(opened.page.locator("#chart .cursor").get_attribute("x1"))
    assert cursor == pytest.approx(opened.run(f"app.curves.x({FAULTY})"))
    opened.page.locator("#chart").click(
        position={"x": opened.run("app.curves.x(4)"), "y": 40}
    )
    assert opened.run("app.pose") == 4


@pytest.mark.parametrize(("family", "number"), [("s", 40), ("t", 30)])
def test_section_is_the_plans(opened, view, family, number):
    """Arc length and gap of every sample of a line, drawn where the scales say."""
    panel(opened, "Section")
    opened.run(f"() => app.timeline.jump({FAULTY})")
    opened.run("line => app.section.choose(line)", {"family": family, "number": number})
    take = (number, slice(None)) if family == "s" else (slice(None), number)
    points, gap = view.ply_points[FAULTY][take], view.gap[FAULTY][take]
    length = np.append(0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    values = opened.run("sectionValues(drape, app.section.line)")
    assert_allclose([v["gap"] for v in values], gap, atol=STEP / 2 + 1e-9)
    assert_allclose([v["length"] for v in values], length, atol=STEP * len(gap))
    line = polyline(opened, "#wide polyline.gap")
    slope = np.polyfit(gap, line[:, 1], 1)
    assert slope[0] < 0
    assert_allclose(line[:, 1], np.polyval(slope, gap), atol=0.2)
    assert_allclose(
        line[:, 0], np.interp(length, [0, length[-1]], line[[0, -1], 0]), atol=0.2
    )
    pads = [c for c in dict.fromkeys(view.pads[take].tolist()) if c >= 0]
    bars = opened.page.locator("#wide .cup")
    assert [int(b.get_attribute("data-cup")) for b in bars.all()] == pads
    assert f"smallest gap {1e3 * gap.min():.2f} mm" in opened.page.locator(
        "#wide svg"
    ).get_attribute("aria-label")


def test_section_goes_with_pose_click_and_select(opened, view):
    panel(opened, "Section")
    opened.run("() => { app.timeline.jump(0); app.look('Top'); }")
    opened.run("() => app.section.choose({ family: 's', number: 3 })")
    first = polyline(opened, "#wide polyline.gap")
    opened.run(f"() => app.timeline.jump({POSES - 1})")
    assert abs(polyline(opened, "#wide polyline.gap") - first).max() > 1
    opened.page.select_option("#wide select >> nth=0", "t")
    assert opened.run("app.section.line.family") == "t"
    assert opened.run("app.section.line.number in Array.from(drape.material.s)")
    text = opened.page.locator("#wide select >> nth=1 >> option:checked").inner_text()
    assert "cups (1,3) to (8,3)" in text  # names as the view has them
    opened.page.select_option("#wide select >> nth=1", "7")
    assert opened.run("app.section.line.number") == 7
    opened.run("() => app.click(drape, { row: 11, column: 22, index: 0 })")
    assert opened.run("app.section.line") == {"family": "t", "number": 22}
    trace = opened.run("Array.from(app.section.traces[0].geometry.index.array)")
    assert_array_equal(trace, np.arange(len(view.t)) * len(view.s) + 22)
    panel(opened, "Section", on=False)
    assert not opened.run("app.section.traces[0].visible")


def test_section_marks_what_is_wrong(opened, view):
    panel(opened, "Section")
    inside = view.events[0].samples
    row = int(inside[0]) // len(view.s)
    opened.run(f"() => app.timeline.jump({FAULTY})")
    opened.run("number => app.section.choose({ family: 's', number })", row)
    count = int((inside // len(view.s) == row).sum())
    dots = opened.page.locator("#wide .dots[data-kind=air_pocket]")
    assert dots.get_attribute("d").count("M") == count > 0
    opened.run("() => app.timeline.jump(0)")
    assert opened.page.locator("#wide .dots").count() == 0
    panel(opened, "Section", on=False)


def probe(opened, row, column):
    return opened.run(
        "([row, column]) => app.probe(drape, { row, column,"
        " index: row * drape.plan.ply.columns + column })",
        [row, column],
    )


def test_probe_says_what_is_there(opened, view):
    opened.run(f"() => app.timeline.jump({FAULTY})")
    i, j = abs(view.t - 0.385).argmin(), abs(view.s - 0.27).argmin()  # in the patch
    assert (view.cup_states[FAULTY, [20, 21, 26, 27]] == 2).all()
    assert probe(opened, int(i), int(j)) == [
        f"gap {1e3 * view.gap[FAULTY, i, j]:.2f} mm",
        f"s {1e3 * view.s[j]:.0f}, t {1e3 * view.t[i]:.0f} mm",
        "between cups (4,3) (4,4) (5,3) (5,4)",
        "✓ placed",
        "ply model modal",
        "◉ air pocket",
    ]
    assert probe(opened, 40, 30)[0] == "gap -2.36 mm"
    on_cup = probe(opened, 2 + 2, 2 + 2)
    assert on_cup[2] == "on cup (1,1)"
    assert probe(opened, 0, 0)[2] == "beyond cup (1,1)"
    assert probe(opened, 6 + 2, 4)[-1] == "ply model cubic"


def test_probe_follows_the_pointer(opened):
    """A real pointer over the middle of the ply."""
    opened.run(f"() => {{ app.timeline.jump({POSES - 1}); app.look('Top'); }}")
    point = opened.run("drape.onScreen([...drape.ply.points.array].slice(8316, 8319))")
    opened.page.mouse.move(*point)
    opened.wait("!document.getElementById('tip').hidden")
    lines = opened.page.locator("#tip div").all_inner_texts()
    assert lines[0].startswith("gap 0.0")
    assert lines[1].startswith("s ")


def test_robustness_is_told_with_its_interval(opened):
    panel(opened, "Robustness")
    body = opened.page.locator(".panel-body", has_text="Wrong order")
    text = body.inner_text()
    assert "P = 0.125" in text
    assert "8 of 64 samples; 95 % within 0.060 to 0.230" in text
    assert "cup angle" in text
    assert "-0.40 · 0.80 · 2.00" in text
    assert "1.00 · ≥ 3 · ≥ 3" in text
    first = body.locator("svg").nth(0)
    bar, dot = first.locator(".interval"), first.locator(".share")
    left, width = (float(bar.get_attribute(k)) for k in ("x", "width"))
    low, high = (float(first.locator(".grid").get_attribute(k)) for k in ("x1", "x2"))
    share = (np.array([left, left + width, float(dot.get_attribute("cx"))]) - low) / (
        high - low
    )
    assert_allclose(share, [0.06, 0.23, 0.125], atol=1e-3)
    tornado = body.locator("svg.tornado").nth(0)
    bars = [
        float(tornado.locator("rect").nth(k).get_attribute("width")) for k in (0, 1)
    ]
    assert bars[0] == pytest.approx(2.4 * bars[1], rel=1e-3)  # 2.4 and 1 mm, to the end
    panel(opened, "Robustness", on=False)


def test_facts_are_listed(opened):
    panel(opened, "Plan")
    rows = opened.page.locator(".facts tr")
    assert rows.all_inner_texts() == [f"Mold\t{HOSTILE}", "Arm\tur10"]
    panel(opened, "Plan", on=False)


def test_panels_are_reached_by_keyboard_and_named(opened):
    names = opened.page.locator("#panels button").all_inner_texts()
    assert names == ["Section", "Robustness", "Plan"]
    button = opened.page.locator("#panels button").first
    button.focus()
    opened.page.keyboard.press("Enter")
    assert button.get_attribute("aria-pressed") == "true"
    section = opened.page.locator("#wide section")
    assert section.get_attribute("aria-label") == "Section through a fiber line"
    opened.page.keyboard.press("Enter")
    assert section.is_hidden()


def test_an_opened_panel_is_in_sight(opened):
    """Also where those above it leave no room."""
    opened.page.set_viewport_size({"width": 1280, "height": 500})
    panel(opened, "Plan")
    box = opened.page.locator(".facts").bounding_box()
    foot = opened.page.locator("#foot").bounding_box()
    assert 0 <= box["y"] < box["y"] + box["height"] <= foot["y"]
    panel(opened, "Plan", on=False)
    opened.page.set_viewport_size({"width": 1280, "height": 720})


def test_texts_of_the_plan_are_never_markup(opened):
    for element in ("img", ".panel-body b", ".verdict b"):
        assert opened.page.locator(element).count() == 0
    assert HOSTILE in opened.page.locator(".verdict .jump").first.inner_text()


def test_robustness_is_shown_only_where_a_plan_has_it(compared):
    names = compared.page.locator("#panels button").all_inner_texts()
    assert names == ["Section", "Plan"]


def test_two_drapes_share_the_curves(compared):
    assert compared.page.locator("#chart polyline").count() == 4
    panel(compared, "Section")
    lines = compared.page.locator("#wide polyline.gap").all()
    counts = [len(line.get_attribute("points").split()) for line in lines]
    assert counts == [len(SAMPLING.s), 8]
    compared.run("() => app.click(app.drapes[1], { row: 8, column: 0, index: 0 })")
    near = compared.run("app.section.line.number")
    assert (
        near == abs(SAMPLING.t - compared.run("app.drapes[1].material.t[8]")).argmin()
    )
    heads = compared.page.locator(".facts th[scope=col]").all_text_contents()
    assert heads == ["A", "B"]


def test_nothing_complained(opened, compared):
    """Last of the module: everything above went without a word or a request."""
    assert opened.errors + compared.errors == []
    assert opened.external() + compared.external() == []
