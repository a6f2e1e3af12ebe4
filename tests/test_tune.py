"""Tuning: the same answer whoever works, whoever dies, wherever it was stopped."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml

from drapeplan.engine import Engine
from drapeplan.errors import InputError
from drapeplan.judged import Judged, trouble
from drapeplan.ranking import rank_scene
from drapeplan.rollout_file import RolloutFile, read_rollouts
from drapeplan.scene import read_scene
from drapeplan.tune import Effort, Finalist, Tuner, choose, space_of
from drapeplan.tuned import path_hash
from tests.plans import scene
from tests.settled import DOME, tool_section
from tests.toys import BEST, COUNT, PATH, UPRIGHT, Counted, Interrupted, Leaning, Toy

EFFORT = Effort(budget=40, samples=4, confirmed=6)
TRIALS = 1 + 3 + 32  # the scene's own, known ones that are others, generations of 8
ROWS = TRIALS * 5 + 3 * 65 + 2 * 7  # finalists and the last two, plans among them


def toy(kind=Toy, **fields):
    return kind(scene(DOME, fidelity="kinematic", path=PATH), **fields)


def tuner(trials, engine, path, resume=False, progress=None, effort=EFFORT):
    """A tuner of a toy with its file."""
    knobs = space_of(trials.scene, "kinematic").knobs
    file = RolloutFile(path, {"seed": trials.seed}, [knob.name for knob in knobs])
    if resume:
        file.resume()
    facts = {"scene": "toy", "version": "0"}
    return Tuner(trials, engine, file, facts, effort, progress)


def tuned(path, trials=None, workers=1, cluster=None, **more):
    """What a toy is tuned to."""
    with Engine(workers, cluster) as engine:
        return tuner(trials or toy(), engine, path, **more).run()


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """A tuning in one process, and its file."""
    path = tmp_path_factory.mktemp("alone") / "rollouts.parquet"
    return tuned(path), path


def same(found, path, alone):
    """Whether result and file are those of one process that nobody disturbed."""
    assert found == alone[0]
    assert path.read_bytes() == alone[1].read_bytes()


def test_the_search_comes_nearer(alone):
    found, _ = alone
    space = space_of(toy().scene, "kinematic")
    before, after = (space.point(p) for p in (toy().scene.path, found.after.path))
    assert np.linalg.norm(after - BEST) < 0.6 * np.linalg.norm(before - BEST)
    assert found.changed
    assert found.after.wrong < found.before.wrong
    assert found.trials == TRIALS


def test_the_file_has_every_simulation(alone):
    _, table = read_rollouts(alone[1])
    assert table.num_rows == ROWS
    frame = table.to_pandas()
    assert set(frame["stage"]) == {"search", "ranking", "confirmation"}
    assert (frame[frame["sample"].isna()]["stage"] == "search").sum() == TRIALS
    samples = frame.dropna(subset="sample").groupby("stage")["sample"]
    assert not set(samples.min()) & {0}  # those of a check are left to the check
    spans = [(part.min(), part.max()) for _, part in samples]
    assert all(
        a[1] < b[0] for a, b in zip(sorted(spans), sorted(spans)[1:], strict=False)
    )


def test_two_processes_find_the_same(alone, tmp_path):
    path = tmp_path / "rollouts.parquet"
    same(tuned(path, workers=2), path, alone)


def test_a_cluster_finds_the_same(alone, tmp_path, cluster):
    path = tmp_path / "rollouts.parquet"
    same(tuned(path, cluster=cluster), path, alone)


def test_a_killed_worker_changes_nothing(alone, tmp_path):
    path, victim = tmp_path / "rollouts.parquet", tmp_path / "killed"
    found = tuned(path, toy(victim=victim), workers=2)
    assert victim.exists()
    same(found, path, alone)


def test_resumed_is_as_never_stopped(alone, tmp_path):
    path = tmp_path / "rollouts.parquet"
    with pytest.raises(KeyboardInterrupt):
        tuned(path, toy(Interrupted))
    assert read_rollouts(path)[1].num_rows == TRIALS * 5
    COUNT.clear()
    same(tuned(path, toy(Counted), resume=True), path, alone)
    assert {question.stage for question in COUNT} == {"ranking", "confirmation"}


def test_resuming_what_is_done_simulates_nothing(alone):
    before = alone[1].read_bytes()
    COUNT.clear()
    assert tuned(alone[1], toy(Counted), resume=True) == alone[0]
    assert COUNT == []
    assert alone[1].read_bytes() == before


def test_another_seed_finds_another(alone, tmp_path):
    found = tuned(tmp_path / "rollouts.parquet", toy(seed=1))
    assert found.after.path != alone[0].after.path


def test_a_file_of_another_seed_is_refused(alone):
    with pytest.raises(InputError, match="of another seed"):
        tuned(alone[1], toy(seed=1), resume=True)


def test_progress_has_rate_and_margin(tmp_path):
    said = []
    tuned(
        tmp_path / "r.parquet", progress=lambda text, share: said.append((text, share))
    )
    assert "rollouts/s" in said[-1][0]
    assert "mm" in said[-1][0]
    shares = [share for _, share in said]
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)


def test_known_paths_come_first(alone):
    _, table = read_rollouts(alone[1])
    space = space_of(toy().scene, "kinematic")
    first = table.to_pandas().drop_duplicates("trial")[:4]
    values = [
        [row[f"path.{k.name}"] for k in space.knobs] for _, row in first.iterrows()
    ]
    assert values == [list(space.values(path).values()) for path in space.known()]


def test_the_search_starts_from_the_best_known_path(tmp_path):
    """Where one of them is right already, it stays in sight."""
    space = space_of(toy().scene, "kinematic")
    best = space.known()[3]
    found = tuned(tmp_path / "r.parquet", toy(best=tuple(space.point(best))))
    assert found.after.wrong <= found.before.wrong
    assert np.linalg.norm(space.point(found.after.path) - space.point(best)) < 0.15


def test_the_step_that_goes_wrong_gets_a_lean_of_its_own(tmp_path):
    effort = replace(EFFORT, per_step=24)
    path = tmp_path / "r.parquet"
    found = tuned(path, toy(Leaning), effort=effort)
    assert found.chosen.name == "steps"
    ((step, angle),) = found.after.path.toe_up_steps
    assert step == 3
    assert angle == pytest.approx(UPRIGHT, abs=1.0)
    assert found.after.path.toe_up_deg == PATH["toe_up_deg"]
    table = read_rollouts(path)[1].to_pandas()
    assert set(table[table["stage"] == "steps"]["toe_up_steps"].notna()) == {True}
    again = tuned(path, toy(Counted), effort=effort, resume=True)
    assert again == found


def test_steps_are_sorted_by_their_trouble():
    margins = (1, -0.5), (4, 0.0), (4, 0.0), (4, 0.0), (0, -3.0), (None, None)
    rows = [{"tightest_step": k, "margin_mm": m} for k, m in margins]
    assert trouble(tuple(rows)) == [4, 1]


def judged(margins, refused=None, missed=()):
    """A path by the margins of its samples, in [mm], and what its plan misses."""
    plan = {"refused": refused, "refused_at": 3.0}
    plan |= {"not_good": list(missed), "shortfall": sum(missed)}
    press = {"span_press_mm": 0.0, "pad_press_mm": 0.0, "stable": True}
    rows = [{"margin_mm": m, "wrong": m <= 0, **press} for m in margins]
    return Judged(toy().scene.path, plan, tuple(rows))


def finalists(**margins):
    """Finalists by name."""
    return [Finalist(name, judged(m)) for name, m in margins.items()]


GOOD, BETTER = [0.5, 1.0, 0.2, 0.8], [0.6, 1.1, 0.3, 0.9]


def test_luck_has_to_win_clearly():
    lucky = [0.9, 1.0, -0.1, 1.5]
    bad = [-0.5, 0.0, 0.1, 0.2]
    assert choose(finalists(scene=bad, mean=GOOD, luckiest=lucky)).name == "mean"
    assert choose(finalists(scene=bad, mean=GOOD, luckiest=BETTER)).name == "luckiest"


def test_what_gains_nothing_changes_nothing():
    assert choose(finalists(scene=BETTER, mean=GOOD, luckiest=GOOD)).name == "scene"


def test_no_plan_is_worse_than_any():
    none, far = judged([], refused="no"), judged([-3.0], missed=[10.0] * 9)
    further = replace(none, plan={**none.plan, "refused_at": 80.0})
    assert none.loss > further.loss > far.loss > judged([-3.0]).loss


def test_risk_counts_before_a_limit_missed_by_a_little():
    risky, safe = [1.0, 1.0, -0.8, -0.8], [1.0, 1.0, 1.0, 1.0]
    missed = judged(safe, missed=[1.3])
    assert judged(safe).loss < missed.loss < judged(risky).loss
    assert missed.loss < judged(safe, missed=[1.6]).loss
    assert judged(safe).loss < judged(safe, missed=[1.0]).loss  # missed by a hair
    named = {"scene": judged([-0.5] * 4), "mean": missed, "luckiest": judged(safe)}
    ranked = [Finalist(name, one) for name, one in named.items()]
    assert choose(ranked).name == "luckiest"  # at like risk a good plan wins


@pytest.fixture(scope="module")
def small_scene(tmp_path_factory):
    """A scene of a small tool, with comments."""
    folder = tmp_path_factory.mktemp("small")
    tool = tool_section(folder, rows=3, columns=2)
    text = f"""# two by three cups
format: drapeplan-scene/1
mold: {{surface: {yaml.safe_dump(DOME, default_flow_style=True).strip()}}}
tool: {{urdf: {Path(tool["urdf"]).name}}}  # beside this file
fidelity: kinematic
path:
  family: rectangle_blend
  poses_per_step: 4
  lift_per_m: 0.5  # a guess
  bend_mm: 120
  rim_offset_mm: 0
  toe_up_deg: 2
uncertainty: {{position_mm: 1.0, angle_deg: 1.5}}  # a bad day
"""
    path = folder / "scene.yaml"
    path.write_text(text)
    return path


def test_command(drapeplan, small_scene, tmp_path, monkeypatch):
    monkeypatch.setattr("drapeplan.tune.RANKED", 4)
    output, file = tmp_path / "tuned.yaml", tmp_path / "rollouts.parquet"
    options = ("--budget", 8, "--samples", 2, "--held-out", 4, "--seed", 3)
    command = ("tune", small_scene, "-o", output, "--rollouts", file, *options)
    ended = drapeplan(*command, "--workers", 1, "--json")
    assert ended.code in (0, 1), ended.err
    found = ended.document
    assert found["trials"] == 5  # no generation of CMA-ES is left in the budget
    assert found["gain"]["samples"] == 4
    written, text = read_scene(output), output.read_text()
    chosen = next(one for one in found["finalists"] if one["chosen"])
    assert written.path.lift_per_m[0] == chosen["path"]["lift_s_per_m"]
    assert written.path.poses_per_step == 4
    assert (tmp_path / written.tool.urdf).exists()
    assert "# a bad day" in text
    assert "# two by three cups" in text
    if written.tuned:
        assert written.tuned.path == path_hash(written.path)
    again = drapeplan(*command, "--workers", 2)
    assert again.code == 2
    assert "--resume" in again.err
    before = file.read_bytes()
    resumed = drapeplan(*command, "--workers", 2, "--resume", "--json")
    assert resumed.document == found
    assert file.read_bytes() == before


def test_a_sequence_left_to_a_search_is_ranked_first(drapeplan, tmp_path, monkeypatch):
    monkeypatch.setattr("drapeplan.tune.RANKED", 2)
    quick = partial(rank_scene, samples=2, few=1)
    monkeypatch.setattr("drapeplan.commands_tune.rank_scene", quick)
    data = {"format": "drapeplan-scene/1", "sequence": "auto"}
    data |= {"mold": {"surface": {"kind": "cylinder", "radius_m": 2.0}}}
    data |= {"tool": tool_section(tmp_path, rows=2, columns=2)}
    data |= {"fidelity": "kinematic", "path": {**PATH, "poses_per_step": 3}}
    scene, output = tmp_path / "scene.yaml", tmp_path / "tuned.yaml"
    scene.write_text(yaml.safe_dump(data), encoding="utf-8")
    options = ("--budget", 1, "--samples", 2, "--held-out", 2, "--workers", 1)
    command = ("tune", scene, "-o", output, "--rollouts", tmp_path / "r.parquet")
    ended = drapeplan(*command, *options)
    assert ended.code in (0, 1), ended.err
    order = read_scene(output).sequence
    assert f": start {list(order.start)}, {order.pattern} (" in ended.out
