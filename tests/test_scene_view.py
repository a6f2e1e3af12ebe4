"""What the preview is told of a plan, against its verdict."""

import copy
import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from drapeplan.contact import front_grid
from drapeplan.errors import InputError
from drapeplan.frames import inverse, moved
from drapeplan.plan import Plan
from drapeplan.remarks import remarks
from drapeplan.sentences import sentences
from drapeplan.verdict import EventKind
from drapeplan.words import failures, labels, summary
from tests.browser import synthetic_view
from tests.spoiled import BORDER, FAR_CUP, good_plan, spoiled_plan
from viewer import findings, packing
from viewer.details import GAP_LOWEST, GAP_STEP, details
from viewer.plan_view import MARGIN_SHOWN, Statement
from viewer.scene import view_of
from viewer.statements import _moment

pytestmark = pytest.mark.xdist_group("spoiled")  # one worker makes the plans
CLIPPED = 1e-5  # [m] by which ply put on the mold may miss it, from 2 mm below
BAND = 1e-9  # [m] by which a length may miss the take-up: rounding


@pytest.fixture(scope="module")
def good():
    return view_of(good_plan())


@pytest.fixture(scope="module")
def bad():
    return view_of(spoiled_plan())


def front():
    return spoiled_plan().judged[1].front


def event_of(view, kind, pose):
    return next(e for e in view.events if (e.kind, e.pose) == (kind, pose))


def told_of(view):
    """The verdict's own events as the view has them."""
    names = {event.sentence: event for event in view.events}
    lines = sentences(front(), labels(spoiled_plan().track))[1:]
    return [names[line] for line, _ in zip(lines, front().events, strict=False)]


def test_a_good_plan_has_no_events(good):
    assert good.events == ()
    assert good.long_fibers == ()
    assert not any(told.wrong for told in good.statements)
    assert (good.margins > 0).all()


def test_events_of_the_verdict_are_told(bad):
    kinds = {"premature_contact", "air_pocket", "pad_penetration"}
    assert {e.kind for e in front().events} >= kinds
    assert len(told_of(bad)) == len(front().events)
    for event, told in zip(front().events, told_of(bad), strict=True):
        assert (told.kind, told.pose, told.place) == (
            event.kind,
            event.pose,
            event.place_st,
        )
        sizes = event.area, event.volume, event.depth
        assert (told.area, told.volume, told.depth) == sizes


def test_events_stand_at_the_poses_whose_margins_are_gone(bad):
    """Where a waypoint shows nothing, its fault came and went on the way to it."""
    for kind, column in (("premature_contact", 0), ("air_pocket", 1)):
        told = {e.pose for e in bad.events if e.kind == kind}
        gone = set(np.flatnonzero(bad.margins[:, column] <= 0).tolist())
        assert told == gone
        assert {e.pose for e in front().events if e.kind == kind} <= told


def test_a_pose_whose_way_alone_is_bad_shows_the_event_of_its_step(bad):
    """Not the nearer one of another step."""
    seen = [e for e in bad.events if e.kind == EventKind.PREMATURE][:1]
    first = seen[0].pose
    found = [seen[0]._replace(pose=first + 3), *seen]
    steps = np.zeros(bad.poses, int)
    steps[first + 3] = 1
    margin = np.full_like(front().premature_margin, np.inf)
    margin[[first, first + 2, first + 3]] = -1e-4
    verdict = replace(
        front(),
        premature_margin=margin,
        air_margin=np.full_like(margin, np.inf),
        span_penetration=np.zeros_like(margin),
        pad_penetration=np.zeros_like(margin),
    )
    laid = np.zeros((bad.poses, *front().pocket_region.shape), bool)
    grid = front_grid(spoiled_plan().cell, 4, spoiled_plan().judged[1].beside)
    args = verdict, found, steps, list(bad.labels), (grid, laid)
    (made,) = findings._on_the_way(*args)
    assert (made.pose, made.on_way) == (first + 2, True)
    assert made.sentence.endswith(f"as at waypoint {first + 1}.")
    assert made.samples is seen[0].samples
    steps[first + 2] = 2
    laid[first + 1].ravel()[seen[0].samples] = True  # so it is another contact
    (made,) = findings._on_the_way(*args)
    assert not np.isin(made.samples, seen[0].samples).any()
    assert front().premature_region.ravel()[made.samples].all()
    place = (
        abs(spoiled_plan().cell.sampling.points_st.reshape(-1, 2) - made.place)
        .sum(axis=1)
        .argmin()
    )
    assert place in made.samples


def test_a_forged_verdict_is_not_shown(bad):
    """Nor is any other than the one that follows from the joints."""
    plan = spoiled_plan()
    forged = {**plan.document, "verdict": good_plan().verdict}
    view = view_of(Plan(forged).known(plan.cell, plan.judged))
    assert not view.good
    assert view.verdict == bad.verdict


def test_contact_is_judged_by_the_tolerance_of_the_scene(good):
    plan = good_plan()
    document = copy.deepcopy(plan.document)
    document["scene"]["tolerance"] |= {"touch_mm": 2.0, "pad_penetration_mm": 3.0}
    made = Plan(document)
    vars(made)["judged"] = plan.judged  # spares the time to judge it anew
    view = view_of(made)
    assert (view.touch, view.penetration) == (2e-3, 3e-3)
    assert_array_equal(view.contact_share(), (good.gap <= 2e-3).mean(axis=(1, 2)))
    assert (view.contact_share() > good.contact_share()).any()


def test_what_turns_or_hides_text_is_replaced():
    hidden = "gpj.\u202eexe\u2066 a\x00"
    view = synthetic_view(3, (6, 5), title=hidden, facts=(("Mold", hidden),))
    assert view.title == "gpj.\ufffdexe\ufffd a\ufffd"
    assert view.facts == (("Mold", view.title),)


def test_premature_contact_is_on_the_far_cup(bad):
    pose = min(event.pose for event in bad.events)
    first = event_of(bad, EventKind.PREMATURE, pose)
    assert all(len(event.samples) for event in bad.events)
    around = bad.cups_around.reshape(-1, 4)[first.samples]
    assert (around == FAR_CUP).any(axis=1).all()
    assert (bad.gap[pose].ravel()[first.samples] < 5e-3).all()
    pressed = event_of(bad, EventKind.PAD_PENETRATION, pose)
    assert (bad.pads.ravel()[pressed.samples] == FAR_CUP).all()
    depth = (bad.gap[-1] - bad.gap[pose]).ravel()[pressed.samples]
    assert (depth > front().tolerance.pad_penetration).all()


def test_pocket_lies_within_the_rim(bad):
    """Its samples are free, reach no edge, and cover the event's area and depth."""
    plan = spoiled_plan()
    final = plan.judged[1].gap[-1]
    pockets = [e for e in bad.events if e.kind == EventKind.AIR_POCKET]
    for event in pockets:
        i, j = np.divmod(event.samples, bad.gap.shape[2])
        assert i.min() > 0
        assert j.min() > 0
        assert i.max() < bad.gap.shape[1] - 1
        assert j.max() < bad.gap.shape[2] - 1
    seen = [event for event in pockets if not event.on_way][-1]
    height = (bad.gap[seen.pose] - final).ravel()[seen.samples]
    assert height.max() == pytest.approx(seen.depth, abs=1e-9)
    assert (height > plan.judged[1].front.tolerance.touch).all()
    assert len(seen.samples) * 1e-4 == pytest.approx(seen.area)  # 10 mm squares


def test_events_between_waypoints_cover_their_area(bad):
    """The verdict's own events that no waypoint shows take in the samples nearest."""
    plan = spoiled_plan()
    grid = front_grid(plan.cell, 4, plan.judged[1].beside)
    event = replace(front().events[0], kind=EventKind.PENETRATION, area=9e-4)
    samples = findings._near(event, front(), grid)
    i, j = np.divmod(samples, len(grid.s))
    assert len(samples) == 9
    assert (
        np.hypot(grid.s[j] - event.place_st[0], grid.t[i] - event.place_st[1]).max()
        < 0.015
    )


def test_long_fibers_are_those_of_the_verdict(bad):
    """Names, needs and first poses; each leaves the take-up at its poses alone."""
    plan = spoiled_plan()
    guilty = {x["fiber"]: x for x in plan.verdict["fibers"]["infeasible"]}
    assert {fiber.name for fiber in bad.long_fibers} >= set(guilty)
    fibers, L = plan.judged[1].fibers, plan.cell.sampling.grid.span
    take_up = plan.scene.ply.take_up_mm * 1e-3
    outer = [f[..., findings.SIDES] for f in (fibers.s_natural, fibers.t_natural)]
    off = [abs(f - L) > take_up + BAND for f in outer]
    outside = sum(f.reshape(len(f), -1).sum(axis=1) for f in off)
    told = sum(np.isin(np.arange(len(outside)), f.poses) for f in bad.long_fibers)
    assert_array_equal(told, outside)
    for name, facts in guilty.items():
        (fiber,) = [f for f in bad.long_fibers if f.name == name]
        assert fiber.poses[0] == facts["waypoint"]
        assert 1e3 * fiber.need == pytest.approx(max(0.0, facts["need_mm"]), abs=1e-6)


def test_long_fibers_run_from_cup_to_cup(bad):
    plan = spoiled_plan()
    st = plan.cell.sampling.points_st.reshape(-1, 2)
    for fiber in bad.long_fibers:
        first, last = st[fiber.samples[[0, -1]]]
        (i, j), (k, m) = (divmod(cup, 3) for cup in fiber.cups)
        family, offset = fiber.name[0], float(fiber.name.split()[-2]) * 1e-3
        across = np.array([0, offset] if family == "s" else [offset, 0])
        assert_allclose(first, np.array([j, i]) * plan.cell.grid.pitch + across)
        assert_allclose(last, np.array([m, k]) * plan.cell.grid.pitch + across)
        assert family == ("s" if i == k else "t")


def test_margins_are_those_of_the_verdict(bad):
    least = np.stack([front().premature_margin, front().air_margin], axis=-1)
    assert_array_equal(bad.margins[: len(least)], np.minimum(least, MARGIN_SHOWN))
    assert_array_equal(bad.margins[len(least) :], MARGIN_SHOWN)
    assert len(least) < bad.poses


def test_steps_are_those_of_the_plan(good):
    plan = good_plan()
    phases, step = np.array(good.phases), good.wave_step
    assert set(step[phases == "wave"]) == set(range(1, len(plan.sequence.steps) + 1))
    assert set(step[np.isin(phases, ["pick", "lift", "release", "retreat"])]) == {-1}
    assert step[phases == "approach"][-1] == 0  # the arm lands the start cup
    assert_array_equal(good.tau, plan.track.tau)


def test_statements_are_the_summary_and_what_is_wrong(bad):
    plan = spoiled_plan()
    wrong = [told.text for told in bad.statements if told.wrong]
    assert wrong == failures(plan.verdict, front(), plan.track)
    assert [told.text for told in bad.statements] == bad.verdict


def test_statements_speak_of_their_moment_and_place(bad):
    told = {one.text: one for one in bad.statements}
    for event in told_of(bad):
        assert told[event.sentence][2:4] == (event.pose, event.place)
    (interlink,) = [t for t in bad.statements if t.text.startswith("The interlink")]
    assert interlink.place == pytest.approx((0.11, 0.33))
    (laid,) = [t for t in bad.statements if t.text.startswith("Laid, ")]
    assert laid.pose == spoiled_plan().track.held.stop - 1
    (high,) = [t for t in bad.statements if "above the mold at the last" in t.text]
    cup = next(c for c in BORDER if str(divmod(c, 3)) in high.text)
    assert high.pose == spoiled_plan().track.placed[:, cup].argmax()
    assert high.place == pytest.approx((0.11 * (cup % 3), 0.11 * (cup // 3)))
    assert "lower path.toe_up_deg where it is above 2" in high.text
    (fiber,) = [t for t in bad.statements if t.text.startswith("Length-infeasible")]
    assert fiber.pose is not None
    assert fiber.place is not None
    (fidelity,) = [t for t in bad.statements if t.text.startswith("Fidelity ")]
    assert fidelity == Statement(fidelity.text)  # no moment


def test_statements_hold_all_that_the_terminal_says(good):
    """Warnings right after what is wrong, the rest aside."""
    said = remarks(good_plan().verdict)
    told = {one.text: one for one in good.statements}
    for text, warns, waypoint in said:
        assert told[text] == Statement(text, False, waypoint, None, warns, not warns)
    (load,) = [one for one in said if one.warns]
    assert good.statements[1].text == load.text
    assert [t.text for t in good.statements if not t.aside and not t.warns] == summary(
        good_plan().verdict,
        good_plan().judged[1].front,
        good_plan().track,
        good_plan().document["kinematic_lag"],
    )


def test_the_headline_on_the_order_leads_nowhere(good, bad):
    """It is of the whole drape, whatever cup it names; any other fault leads on."""
    for view in (good, bad):
        assert "cup (" in view.statements[0].text
        assert view.statements[0][2:4] == (None, None)


def test_waypoints_in_sentences_count_from_1():
    """As the page's counter does: `waypoint 51` is the pose of index 50."""
    plan = spoiled_plan()
    assert _moment(plan, (), "The tool moves at waypoint 51.") == (50, None)
    limits = plan.verdict["limits"] | {"good": False, "waypoint": 50}
    verdict = plan.verdict | {"limits": limits}
    (line,) = [x for x in failures(verdict, front(), plan.track) if " rate is " in x]
    assert _moment(plan, (), line)[0] == 50
    assert "at waypoint 51," in line


def test_rungs_are_those_of_the_strips(good, bad):
    assert good.rungs == ("cubic",)
    assert not good.strip_rungs.any()
    plan = spoiled_plan()
    assert plan.judged[1].choice.model.name == "modal"
    assert bad.rungs == ("cubic", "modal")
    for fiber in bad.long_fibers:
        strip = bad.interlinks.tolist().index(list(fiber.cups))
        assert bad.strip_rungs[fiber.poses, strip].all()
    assert not bad.strip_rungs[0].any()


def test_facts_say_what_it_was_made_from(good):
    facts = dict(good.facts)
    assert facts["Mold"].startswith("a paraboloid")
    assert facts["Tool"] == "3 x 4 cups, 110 mm apart"
    assert facts["Fidelity"] == "kinematic"
    assert good_plan().document["hash"].endswith(facts["Plan"]) is False
    assert (
        good_plan().document["hash"].removeprefix("sha256:").startswith(facts["Plan"])
    )


def test_robustness_is_that_of_the_plan(good):
    assert good.robustness is None
    stated = Plan({**good_plan().document, "robustness": {"samples": 3}})
    vars(stated)["judged"] = good_plan().judged  # spares the time to judge it anew
    assert view_of(stated).robustness == {"samples": 3}


def test_ply_lies_on_the_mold_and_its_gap_says_how_deep_it_is_pushed(bad):
    """Points of the view are clipped at the mold, its gaps are not."""
    plan = spoiled_plan()
    to_mold = inverse(plan.cell.world_mold)
    local, _ = moved(to_mold, bad.ply_points, np.eye(3))
    sunk = (bad.gap < 0) & (bad.gap > -2e-3)
    assert bad.gap.min() < -1e-3
    assert_allclose(plan.cell.mold.gap(local[sunk]), 0, atol=CLIPPED)


def test_pads_are_those_of_the_cups(good):
    """Samples within half a cup's width of its middle, and no others."""
    grid = good_plan().cell.grid
    j, s = np.divmod(np.arange(12), 3)[1] * grid.pitch, good.s
    i, t = np.divmod(np.arange(12), 3)[0] * grid.pitch, good.t
    near_s = abs(s[:, None] - j) < grid.half_width + 1e-9
    near_t = abs(t[:, None] - i) < grid.half_width + 1e-9
    on = near_t[:, None] & near_s
    assert_array_equal(good.pads, np.where(on.any(axis=-1), on.argmax(axis=-1), -1))


def test_gaps_of_the_panels_are_exact(bad):
    """Packed gaps are within half a step of the plan's, deep ones included."""
    payload = packing.Payload()
    entry = details(bad, payload)["gaps"]
    k, nt, ns = bad.gap.shape
    data = payload.to_bytes({})
    assert data == payload.to_bytes({})
    start, size = payload._places[entry["blob"]]
    raw = np.frombuffer(b"".join(payload._blobs), np.uint8)[start : start + size]
    low, high = raw.reshape(2, -1).astype(np.uint16)
    folded = (low | high << 8).reshape(1, k, nt, ns)
    values = (folded >> 1) ^ (0 - (folded & 1))
    for axis in (1, 2, 3):
        values = np.cumsum(values, axis=axis, dtype=np.uint16)
    shown = GAP_LOWEST + GAP_STEP * values[0].astype(float)
    near = bad.gap < 0.2
    assert_allclose(shown[near], bad.gap[near], atol=GAP_STEP / 2 + 1e-12)


def test_details_are_plain(bad):
    found = details(bad, packing.Payload())
    assert json.loads(json.dumps(found, allow_nan=False))["events"]


def test_a_view_without_findings_has_defaults():
    view = synthetic_view(poses=3, samples=(6, 5))
    assert (view.margins == MARGIN_SHOWN).all()
    assert view.statements[0] == Statement(view.verdict[0])
    assert_allclose(np.diff(view.s) > 0, True)
    assert view.t[-1] == pytest.approx(0.85, rel=0.01)
    with pytest.raises(InputError, match="margins"):
        replace(view, margins=np.zeros((2, 2)))
