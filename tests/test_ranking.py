import json

import pytest
import yaml

from drapeplan import ranking
from drapeplan.candidates import Candidate
from drapeplan.cell import read_sources
from drapeplan.engine import Engine
from drapeplan.errors import InputError
from drapeplan.orders import SequenceSection
from drapeplan.plan import Plan, document_hash
from drapeplan.plan_file import CandidatesBlock
from drapeplan.ranking import Judge, rank
from drapeplan.ranking_words import cells, lines, taken
from drapeplan.report_ranking import pareto, pareto_figure
from drapeplan.sequence import make_sequence
from tests.plans import scene
from tests.settled import tool_section
from tests.toy_rows import ToyJudge, row, ways

QUICK = {"family": "rectangle_blend", "poses_per_step": 3}


def starts(judge, workers=1, **options):
    """Columns of the starts, the best first, and rows by column."""
    with Engine(workers) as engine:
        found = rank(judge, ways(len(judge.glance)), "equilibrium", engine, **options)
    return [one.row.start[1] for one in found], {o.row.start[1]: o.row for o in found}


def first(*rows):
    """Place of the best of some rows, all of which are looked at closely."""
    close = tuple(one.model_dump(exclude={"start", "fidelity"}) for one in rows)
    order, _ = starts(ToyJudge((0.0,) * len(rows), close), samples=64, few=9)
    return order[0]


@pytest.mark.parametrize(
    "better",
    [
        {"good": True},
        {"wrong": 0},
        {"low_margin_mm": 2.0},
        {"margin_mm": 2.0},
        {"penetration_mm": 0.1},
        {"stroke_mm": 60.0},
        {"largest_shear_deg": 0.2},
        {"take_up_left_mm": 0.6},
        {"steps": 3},
        {"time_s": 10.0},
    ],
)
def test_each_criterion_decides_where_those_before_are_equal(better):
    worse = {"wrong": 10, "low_margin_mm": 1.0, "margin_mm": 1.0, "stroke_mm": 200.0}
    worse |= {"penetration_mm": 0.5, "largest_shear_deg": 3.0, "take_up_left_mm": 0.1}
    worse |= {"steps": 9, "time_s": 40.0, "good": False}
    names = list(worse := {"good": False, **worse})
    key = next(iter(better))
    if key == "good":
        assert first(row(**worse), row(**{**worse, **better})) == 1
        return
    order = ["good", "wrong", *(name for name, _ in ranking.CRITERIA[1:])]
    assert sorted(order) == sorted(names)
    after = {name: worse[name] for name in order[order.index(key) + 1 :]}
    plain = {"margin_mm": 1.0, "low_margin_mm": 1.0}  # equal up to here
    low = {**plain, key: worse[key]}
    assert first(row(**low), row(**{**plain, **after, **better})) == 1


def test_small_differences_leave_it_to_the_next_criterion():
    assert first(row(wrong=1, time_s=20), row(wrong=0, time_s=40)) == 0
    assert first(row(margin_mm=70.0, time_s=40), row(margin_mm=9.0, time_s=20)) == 1
    assert first(row(), row()) == 0


def test_the_hopeless_are_not_looked_at_closely():
    order, rows = starts(ToyJudge((0.2, None, 0.1, 0.3)), samples=8, few=2)
    assert rows[1].refused == "no strokes"
    assert [rows[k].samples for k in range(4)] == [8, 0, 8, 0]
    assert order == [0, 2, 3, 1]


def test_the_next_few_get_a_look_until_one_is_good():
    bad, good = {"good": False, "shortfall": 2.0}, {}
    judge = ToyJudge((0.0, 0.1, 0.2, 0.3, 0.4), (bad, bad, bad, good, good))
    order, rows = starts(judge, samples=8, few=2)
    assert [rows[k].samples > 0 for k in range(5)] == [True, True, True, True, False]
    assert order[:2] == [3, 4]
    nearest = ToyJudge((0.0, 0.1), (bad, {"good": False, "shortfall": 1.0}))
    assert starts(nearest, samples=8, few=1)[0] == [1, 0]


def test_workers_change_nothing():
    judge = ToyJudge((0.2, None, 0.1, 0.3), ({"wrong": 9}, {}, {"wrong": 5}, {}))
    assert starts(judge, 2, few=2) == starts(judge, 1, few=2)


@pytest.fixture
def tiny(tmp_path):
    """A scene of 2 x 2 cups that leaves its sequence to a search."""
    data = {"format": "drapeplan-scene/1", "sequence": "auto", "path": QUICK}
    data |= {"mold": {"surface": {"kind": "cylinder", "radius_m": 2.0}}}
    data |= {"tool": tool_section(tmp_path, rows=2, columns=2)}
    data |= {"fidelity": "kinematic"}
    file = tmp_path / "scene.yaml"
    file.write_text(yaml.safe_dump(data), encoding="utf-8")
    return file


def test_auto_takes_the_best_and_the_plan_says_from_what(
    drapeplan, tiny, tmp_path, monkeypatch
):
    monkeypatch.setattr(ranking.os, "cpu_count", lambda: 1)
    file = tmp_path / "plan.json"
    ended = drapeplan("plan", tiny, "-o", file)
    assert ended.code == 0
    assert "Chosen from" in ended.out
    document = json.loads(file.read_text())
    rows = document["candidates"]["rows"]
    assert len(rows) > 1
    best, sequence = rows[0], document["scene"]["sequence"]
    assert (best["start"], best["pattern"]) == (sequence["start"], sequence["pattern"])
    assert document["sequence"]["start_cup"] == best["start"]
    assert best["samples"] == ranking.SAMPLES
    assert drapeplan("check", file).code == 0
    rows[0] = {**best, "wrong": best["wrong"] + 1}
    Plan({**document, "hash": document_hash(document)}).write(file)
    ended = drapeplan("check", file)
    assert ended.code == 1
    assert "differs: candidates.rows.0.wrong" in ended.out


def test_auto_is_a_word_that_is_searched_or_refused():
    with pytest.raises(InputError, match=r"sequence: input should be 'auto'"):
        scene(sequence="center")
    with pytest.raises(InputError, match=r"sequence\.strat: unknown key"):
        scene(sequence={"strat": "auto"})
    assert scene(sequence="auto", path={"family": "radial"}).sequence == "auto"
    with pytest.raises(InputError, match="searched by plan and rank alone"):
        make_sequence(scene(sequence="auto").sequence, 8, 6, "test")
    quick = make_sequence(scene().sequence, 8, 6, "test")
    assert (quick.start_cup, quick.pattern) == ((3, 2), "alternate_sides")


def test_rank_shows_a_table_and_a_cluster_shows_the_same(
    drapeplan, tiny, tmp_path, cluster
):
    picture = tmp_path / "pareto.png"
    options = "--samples", 2, "--figure", picture
    ended = drapeplan("rank", tiny, *options, "--workers", 1)
    assert ended.code == 0
    assert drapeplan("rank", tiny, *options, "--cluster", cluster) == ended
    assert "from the middle, all sides at once" in ended.out
    assert all(word in ended.out for word in ("P wrong", "take-up", "all_sides"))
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_candidate_that_no_strokes_reach_says_so(tmp_path):
    steps = [[[0, 0]], [[2, 2]], [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]]]
    section = SequenceSection.model_validate({"steps": [*steps, [[1, 1]]]})
    tool = tool_section(tmp_path, rows=3, columns=3)
    read = scene(tool=tool, sequence="auto", fidelity="kinematic", path=QUICK)
    judge = Judge(read, read_sources(read, tmp_path))
    found = judge((Candidate(section, "corners first"), "kinematic", 2))
    assert not found.good
    assert found.refused
    assert cells(found)[2] == "refused"


ROWS = [
    row((3, 2), pattern="spine_t", why="a", wrong=0, time_s=40.0),
    row((3, 0), why="b", wrong=2, time_s=30.0),
    row((0, 0), why="c", wrong=9, time_s=35.0),
    row((0, 2), why="d", wrong=5, time_s=20.0),
    row((5, 2), why="e", samples=0, fidelity="kinematic"),
    row((0, 3), why="f", good=False, not_good=["touch"], wrong=0, time_s=10.0),
    row((0, 4), why="g", good=False, refused="wave step 2: no", samples=0, time_s=None),
]
BLOCK = CandidatesBlock(samples=64, seed=0, rows=ROWS)


def test_nothing_beats_what_is_on_the_front():
    assert [one.why for one in pareto(ROWS[:4] + ROWS[5:6])] == ["d", "b", "a"]


def test_words_say_what_is_wrong_and_why():
    assert cells(ROWS[1])[:4] == ("3, 0", "all_sides", "yes", "0.03 (0.00-0.11)")
    assert cells(ROWS[4])[2:4] == ("perhaps", "-")
    text = lines(BLOCK)
    assert text[5].endswith("f: touch")
    assert text[6].endswith("g: wave step 2: no")
    assert "kinematic plan alone" in text[-1]
    said = "Chosen from 7 candidates, 5 of them good: start [3, 2], spine_t (a)."
    assert taken(BLOCK) == said


def test_one_that_is_not_good_but_at_less_risk_is_told():
    best = row(good=True, samples=64, wrong=40)
    other = row(good=False, samples=64, wrong=4, not_good=["touch"])
    block = CandidatesBlock(samples=64, seed=0, rows=[best, other])
    said = lines(block)[-1]
    assert "At less risk, but not good (touch)" in said
    assert "P 0.06 instead of 0.62" in said
    assert said in taken(block)
    near = row(good=False, samples=64, wrong=35, not_good=["touch"])
    block = CandidatesBlock(samples=64, seed=0, rows=[best, near])
    assert not any("risk" in line for line in lines(block))


def test_the_same_figure_twice(tmp_path):
    for name in ("a.png", "b.png"):
        pareto_figure(tmp_path / name, BLOCK, "title")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
