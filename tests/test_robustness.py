"""Robustness: shares, margins and effects of samples, the same however they are run."""

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml

from drapeplan.errors import InputError
from drapeplan.intervals import share_interval
from drapeplan.noise import Spread
from drapeplan.plan import Plan
from drapeplan.plan_file import RobustnessBlock
from drapeplan.report_robustness import tornado_figure
from drapeplan.robustness import Effect, Robustness, robustness
from drapeplan.robustness_words import document, sentences, table
from drapeplan.rolling import CAP, Rollout
from drapeplan.scene import UncertaintySection
from tests.courses import wave_plan
from tests.settled import DOME, tool_section

CUPS_ALONE = UncertaintySection(
    tilt_deg=0,
    take_up_share=0,
    stiffness_log=0,
    mold_xy_mm=0,
    mold_z_mm=0,
    mold_yaw_deg=0,
)
INF = np.inf
together = pytest.mark.xdist_group("panel")  # tests that share one plan


def rollout(premature=(INF, INF), air=(INF, INF), press=2e-4, stable=True):
    """A sample by hand, lengths in [m]."""
    return Rollout(np.array(premature), np.array(air), press, press / 2, 0.0, stable)


def by_hand(*rollouts, effects=()):
    """Samples of a drape in two steps."""
    steps = (((0, 0),), ((0, 1), (1, 0)))
    stated = UncertaintySection()
    return Robustness(stated, 0, "poses", steps, rollout(), rollouts, effects)


@pytest.fixture(scope="module")
def found():
    return robustness(wave_plan(), 4, seed=1, workers=1)


def plain(found):
    return json.dumps(document(found))


def test_more_samples_do_not_change_the_first(found):
    fewer = robustness(wave_plan(), 2, seed=1, workers=1, tornado=False)
    for a, b in zip(fewer.rollouts, found.rollouts[:2], strict=True):
        assert (a.span_press, a.margin) == (b.span_press, b.margin)


def test_parameters_share_their_samples(found):
    """One parameter alone is the same whether or not others are switched on."""
    alone = {e.parameter: e for e in found.effects}
    cups = robustness(wave_plan(), 4, seed=1, workers=1, stated=CUPS_ALONE)
    assert {e.parameter for e in cups.effects} == {"position", "angle"}
    for effect in cups.effects:
        both = effect.press, alone[effect.parameter].press
        np.testing.assert_array_equal(*both)


def test_workers_change_no_byte(found):
    assert plain(robustness(wave_plan(), 4, seed=1, workers=2)) == plain(found)


def test_seeds_differ(found):
    other = robustness(wave_plan(), 4, seed=2, workers=1, tornado=False)
    assert other.rollouts[0].span_press != found.rollouts[0].span_press


def test_the_scene_gives_seed_and_uncertainty():
    given = robustness(wave_plan(), 1, workers=1, tornado=False)
    scene = wave_plan().scene
    assert (given.seed, given.stated) == (scene.seed, scene.uncertainty)


def test_the_plan_itself_is_among_the_answers(found):
    nothing = UncertaintySection(
        position_mm=0, angle_deg=0, **{name: 0 for name in CUPS_ALONE.model_fields_set}
    )
    known = robustness(wave_plan(), 3, workers=1, stated=nothing)
    assert Spread.of(nothing) == Spread()
    assert known.wrong == 0
    assert known.effects == ()
    for one in known.rollouts:
        assert one.span_press == found.planned.span_press
        assert one.margin == found.planned.margin


@pytest.mark.parametrize("samples", [0, -3, 10**9])
def test_numbers_of_samples(samples):
    with pytest.raises(InputError, match="must be 1 to"):
        robustness(wave_plan(), samples)


def test_what_counts_as_wrong():
    assert rollout(premature=(1e-3, -1e-5)).wrong
    assert rollout(air=(0.0, INF)).wrong
    assert rollout(stable=False).wrong
    assert not rollout(premature=(1e-5, INF), press=1.0).wrong


def test_share_and_worst_step():
    bad, good = rollout(air=(1e-4, -1e-4)), rollout(premature=(2e-4, 1e-3))
    some = by_hand(bad, good, good, good)
    assert some.wrong == 1
    assert some.interval == share_interval(1, 4)
    assert some.worst_step == 1
    assert by_hand(good, good).worst_step == 0
    assert by_hand(rollout()).worst_step is None


def test_what_hurts_more_ranks_higher():
    wrong = Effect("tilt", (rollout(premature=(-1e-3, INF)), rollout()))
    tight = Effect("angle", (rollout(premature=(1e-4, INF)), rollout()))
    deep = Effect("position", (rollout(press=1e-3), rollout()))
    calm = Effect("take_up", (rollout(), rollout()))
    ranked = sorted([calm, deep, wrong, tight], key=lambda e: e.rank, reverse=True)
    assert ranked == [wrong, tight, deep, calm]
    assert deep.margins.tolist() == [CAP, CAP]


def test_document_has_units_and_no_infinity():
    some = by_hand(rollout(air=(1e-3, -1e-4), press=1e-3), rollout())
    data = document(some)
    json.dumps(data, allow_nan=False)
    assert data["wrong_order"]["share"] == 0.5
    assert data["wrong_order"]["air_pocket"] == 1
    assert data["margin_mm"]["air"] == {"5": -0.1, "50": -0.1, "95": -0.1}
    assert data["margin_mm"]["premature"]["5"] is None
    assert data["press"]["force_N"]["50"] == pytest.approx(2.0 * 0.2)
    assert data["worst_step"]["cups"] == [[0, 1], [1, 0]]


def test_words(found):
    effects = (Effect("tilt", (rollout(premature=(-1e-4, INF)), rollout())),)
    some = by_hand(rollout(air=(1e-3, -1e-4)), rollout(), effects=effects)
    text = "\n".join([*sentences(some), *table(some)])
    assert "1 of 2 samples touch in the wrong order: P = 0.500" in text
    assert "Worst is step 1 (cups (0, 1), (1, 0)): 1 samples go wrong there" in text
    assert "tilt of all cups   0.50      -0.10 to" in text
    calm = "\n".join(table(replace(found, effects=())))
    assert "parameter" not in calm


def test_the_same_figure_twice(found, tmp_path):
    files = [tmp_path / name for name in ("a.png", "b.png")]
    for file in files:
        tornado_figure(file, found, "flat")
    first, second = (file.read_bytes() for file in files)
    assert first == second
    assert first.startswith(b"\x89PNG")


def test_margins_are_drawn_where_some_are_near(tmp_path, monkeypatch):
    """Else the press depth stands alone."""
    panels = []
    monkeypatch.setattr(
        "drapeplan.report_robustness._bars",
        lambda axes, samples: panels.append(np.ravel(samples).max()),
    )
    for margin in (INF, 2e-3):
        effects = (Effect("tilt", (rollout(premature=(margin, INF)), rollout())),)
        some = by_hand(rollout(), effects=effects)
        tornado_figure(tmp_path / "some.png", some, "some")
    assert panels == [2e-4, CAP, 2e-4]


@together
def test_check_says_how_robust(drapeplan, panel_run, tmp_path):
    before, figure = panel_run.file.read_bytes(), tmp_path / "tornado.png"
    command = ("check", panel_run.file, "--robustness", 2, "--workers", 1, "--seed", 3)
    ended = drapeplan(*command, "--figure", figure, "--json")
    assert ended.code == 0, ended.err
    told = ended.document["robustness"]
    assert (told["samples"], told["seed"]) == (2, 3)
    assert told["wrong_order"]["high_95"] == pytest.approx(0.841886, abs=1e-6)
    assert len(told["parameters"]) == 6
    assert told["largest_link_error_mm"] <= 1e-6
    assert panel_run.file.read_bytes() == before
    assert figure.stat().st_size > 10_000


@pytest.fixture(scope="module")
def small_scene(tmp_path_factory):
    """A small tool over a dome, in a file."""
    folder = tmp_path_factory.mktemp("small")
    sections = {"tool": tool_section(folder), "fidelity": "kinematic"}
    data = {"format": "drapeplan-scene/1", "mold": {"surface": DOME}, **sections}
    path = folder / "scene.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("share", -3.5), ("low_95", -1e-3), ("high_95", 7.0)),
        *(("samples", 5), ("premature", -1), ("no_rest", 10**9)),
    ],
)
def test_a_file_with_impossible_counts_is_refused(found, key, value):
    """Four samples, shares from 0 to 1."""
    told = document(found)
    RobustnessBlock.model_validate(told)
    told["wrong_order"][key] = value
    with pytest.raises(ValueError, match=key if key != "samples" else "5 of 4"):
        RobustnessBlock.model_validate(told)


def test_a_plan_keeps_what_becomes_of_it(drapeplan, small_scene, tmp_path):
    """In its file, under its hash; a check draws the same samples anew."""
    file = tmp_path / "plan.json"
    samples = ("--robustness", 2)
    made = drapeplan("plan", small_scene, "-o", file, *samples, "--seed", 3, "--json")
    plan = Plan.read(file)
    told = plan.document["robustness"]
    assert (told["samples"], told["seed"]) == (2, 3)
    assert made.document["robustness"] == told
    assert any("0 of 2 samples touch" in line for line in made.document["sentences"])
    checked = drapeplan("check", file, "--json").document
    assert (checked["broken"], checked["differing"]) == ([], [])
    assert checked["robustness"] == told
    plan.doubted({**told, "planned_margin_mm": 7.0}).write(file)
    altered = drapeplan("check", file, "--json")
    assert altered.code == 1
    (line,) = altered.document["differing"]
    assert line.startswith("robustness.planned_margin_mm: is 7.0, recomputed ")
    told["wrong_order"]["samples"] = 1
    Plan({**plan.document, "robustness": told}).write(file)
    assert "hash" in drapeplan("check", file).out.splitlines()[0]


@together
@pytest.mark.parametrize(
    "wrong", [("--robustness", 0), ("--robustness", 2, "--depth", "deep")]
)
def test_wrong_options_are_one_line(drapeplan, panel_run, wrong):
    ended = drapeplan("check", panel_run.file, *wrong)
    assert ended.code == 2
    assert len(ended.err.splitlines()) == 1
