"""Ranking: candidates planned and judged, the cheap way first, the best one on top.

Kinematic plans sort out what no strokes reach and say who goes first; the best FEW of
them are planned as the scene asks for and judged on samples of its uncertainty, then
the next FEW, until one is good. All have the same samples, and `--robustness` draws
others: no winner is taken for luck that is told of it later.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from drapeplan.candidates import Candidate, candidates
from drapeplan.cell import Cell, Sources, build_cell, read_sources
from drapeplan.engine import Engine
from drapeplan.errors import InfeasibleError
from drapeplan.noise import Spread, draw
from drapeplan.path_choice import chosen_path
from drapeplan.plan import Plan
from drapeplan.plan_file import MOST_SAMPLES, CandidateRow, CandidatesBlock
from drapeplan.planner import cup_targets, plan_drape
from drapeplan.robustness import make_course
from drapeplan.rolling import CAP, roll
from drapeplan.scene import Scene
from drapeplan.sequence import make_sequence
from drapeplan.shortfall import shortfall

Progress = Callable[[str, float], None]
Fidelity = Literal["equilibrium", "kinematic"]

SAMPLES = 64  # [-] of each candidate that is looked at closely
FEW = 4  # [-] candidates that are looked at closely at once
FIRST = 4 * MOST_SAMPLES  # [-] index of the first sample
LOW = 0.05  # [-] quantile of the samples' margins
DIGITS = 9  # decimals of the numbers in a row
CRITERIA = (  # what decides, and the difference below which the next one does
    ("wrong_share", 0.05),  # 3 of 64 samples
    ("low_margin_mm", -0.25),  # more is better
    ("margin_mm", -0.25),
    ("penetration_mm", 0.1),
    ("stroke_mm", 20.0),
    ("largest_shear_deg", 0.5),
    ("take_up_left_mm", -0.1),
    ("steps", 1),
    ("time_s", 0.1),
)


@dataclass(frozen=True)
class Ranked:
    """A candidate and what became of it."""

    candidate: Candidate
    row: CandidateRow


@dataclass(frozen=True)
class Ranking:
    """Candidates of a scene, the best first.

    Attributes:
        ranked: At least one.
        samples: Of each that was looked at closely.
        seed: Of the samples.
    """

    ranked: tuple[Ranked, ...]
    samples: int
    seed: int

    @property
    def best(self) -> Candidate:
        """The one to take."""
        return self.ranked[0].candidate

    @property
    def good(self) -> bool:
        """Whether the best one is good, as far as it was looked at."""
        return self.ranked[0].row.good

    def block(self) -> CandidatesBlock:
        """What a plan tells of it."""
        rows = [one.row for one in self.ranked]
        return CandidatesBlock(samples=self.samples, seed=self.seed, rows=rows)


@dataclass(frozen=True)
class Judge:
    """Plans and judges candidates of a scene; its cell is built once, where it works.

    Attributes:
        scene: The scene.
        sources: What its cell is built from.
    """

    scene: Scene
    sources: Sources

    def __call__(self, question: tuple[Candidate, Fidelity, int]) -> CandidateRow:
        """Row of a candidate.

        Args:
            question: The candidate, the fidelity, and a number of samples or 0.
        """
        candidate, fidelity, samples = question
        scene = candidate.applied(self.scene)
        scene = scene.model_copy(update={"fidelity": fidelity})
        scene, _ = chosen_path(scene, self.cell.mold, self.cell.grid)
        cell = replace(self.cell, scene=scene)
        rows, columns = cell.grid.rows, cell.grid.columns
        sequence = make_sequence(scene.sequence, rows, columns, "scene")
        try:
            made = plan_drape(cell, sequence)
        except InfeasibleError as error:
            return CandidateRow(
                start=sequence.start_cup,
                pattern=sequence.pattern,
                why=candidate.why,
                fidelity=fidelity,
                good=False,
                refused=str(error),
                steps=len(sequence.steps),
            )
        plan = made.plan.known(cell, (made.plan.verdict, made.contact))
        return row_of(plan, candidate.why, samples, scene.seed)

    @cached_property
    def cell(self) -> Cell:
        """Robot, mold and ply."""
        return build_cell(self.scene, self.sources)


def row_of(plan: Plan, why: str, samples: int, seed: int) -> CandidateRow:
    """What a plan is worth, as a row of the table of candidates.

    Args:
        plan: The plan.
        why: What speaks for it.
        samples: Under the scene's uncertainty; 0 for none.
        seed: Of the samples.
    """
    verdict, sequence = plan.judged[0], plan.sequence
    steps, fibers = verdict["steps"], verdict["fibers"]
    keys = ("premature_margin_mm", "air_margin_mm")
    margins = [step[key] for step in steps for key in keys if step[key] is not None]
    depths = [step[f"{kind}_penetration_mm"] for step in steps for kind in _KINDS]
    low, high = verdict["limits"]["stroke_range_mm"]
    used = max(fibers["largest_surplus_mm"], fibers["longest_need_mm"], 0.0)
    short = shortfall(verdict)
    return CandidateRow(
        start=sequence.start_cup,
        pattern=sequence.pattern,
        why=why,
        fidelity=plan.scene.fidelity,
        good=verdict["good"],
        not_good=sorted(short),
        shortfall=_number(sum(short.values())),
        margin_mm=min(margins, default=None),
        penetration_mm=max(depths),
        stroke_mm=_number(high - low),
        largest_shear_deg=plan.document["net"]["largest_cell_shear_deg"],
        take_up_left_mm=_number(fibers["take_up_mm"] - used),
        steps=len(sequence.steps),
        time_s=float(plan.track.time[-1]),
        **(_sampled(plan, samples, seed) if samples else {}),
    )


_KINDS = ("span", "pad")


def _sampled(plan: Plan, samples: int, seed: int) -> dict[str, Any]:
    """Samples in the wrong order, and a low quantile of their margins up to CAP."""
    spread = Spread.of(plan.scene.uncertainty)
    course = make_course(plan, spread)
    poses, cups = course.rests.fixed.shape
    found = [
        roll(course, draw(seed, k, cups, poses, spread.redrawn), spread)
        for k in range(FIRST, FIRST + samples)
    ]
    margins = 1e3 * np.minimum([one.margin for one in found], CAP)
    low = float(np.quantile(margins, LOW, method="inverted_cdf"))
    wrong = sum(one.wrong for one in found)
    return {"samples": samples, "wrong": wrong, "low_margin_mm": _number(low)}


def rank_scene(
    scene: Scene,
    folder: Path,
    source: str,
    engine: Engine | None = None,
    samples: int = SAMPLES,
    few: int = FEW,
    progress: Progress | None = None,
) -> Ranking:
    """Candidates of a scene, ranked; the same whoever works.

    Args:
        scene: The scene; its own sequence is one of the candidates.
        folder: Folder that its paths are relative to.
        source: Names the scene in error messages.
        engine: Who works, not entered yet; a process a core if None.
        samples: Of each candidate that is looked at closely.
        few: How many are looked at closely at once.
        progress: Called with the stage and its share done, 0 to 1.

    Raises:
        InputError: The scene names what does not exist or does not fit, or the
            engine's cluster does not answer.
        InfeasibleError: The mold has no room for the ply, whatever its order.
    """
    sources = read_sources(scene, folder)
    cell = build_cell(scene, sources)
    ways = candidates(scene, cup_targets(cell), cell.grid.pitch)
    judge = Judge(scene, sources)
    with engine or Engine(os.cpu_count() or 1) as engine:
        ranked = rank(judge, ways, scene.fidelity, engine, samples, few, progress)
    return Ranking(tuple(ranked), samples, scene.seed)


def searched(
    scene: Scene, folder: Path, source: str, progress: Progress | None = None
) -> tuple[Scene, Ranking | None]:
    """A scene whose sequence is known, and the ranking where it had to be searched.

    Args:
        scene: The scene.
        folder: Folder that its paths are relative to.
        source: Names the scene in error messages.
        progress: Called with the stage and its share done, 0 to 1.

    Raises:
        InputError: The scene names what does not exist or does not fit.
        InfeasibleError: The mold has no room for the ply, whatever its order.
    """
    if scene.sequence != "auto":
        return scene, None
    found = rank_scene(scene, folder, source, progress=progress)
    return found.best.applied(scene), found


def rank(
    judge: Callable[[tuple[Candidate, Fidelity, int]], CandidateRow],
    ways: list[Candidate],
    fidelity: Fidelity,
    engine: Engine,
    samples: int = SAMPLES,
    few: int = FEW,
    progress: Progress | None = None,
) -> list[Ranked]:
    """Candidates, the best first.

    Args:
        judge: Plans and judges one, as `Judge` does.
        ways: The candidates; among equals the earlier one is ahead.
        fidelity: Of the closer look.
        engine: Who works.
        samples: Of each that is looked at closely.
        few: How many are looked at closely at once.
        progress: Called with the stage and its share done, 0 to 1.
    """

    def judged(some: list[int], how: Fidelity, samples: int, stage: str) -> None:
        done = 0

        def told(places: list[int], _: list[Any]) -> None:
            nonlocal done
            done += len(places)
            if progress:
                progress(stage, done / len(some))

        questions = [(ways[k], how, samples) for k in some]
        for k, row in zip(some, engine.map(judge, questions, told), strict=True):
            rows[k] = row

    rows: dict[int, CandidateRow] = {}
    judged(list(range(len(ways))), "kinematic", 0, "candidates")
    left = [k for k in sorted(rows, key=lambda k: _order(rows[k])) if _stands(rows[k])]
    closely: list[int] = []
    while left and not any(rows[k].good for k in closely):
        some, left = left[:few], left[few:]
        judged(some, fidelity, samples, "best candidates")
        closely += some
    ranked = sorted(rows, key=lambda k: (_order(rows[k]), k))
    return [Ranked(ways[k], rows[k]) for k in ranked]


def _stands(row: CandidateRow) -> bool:
    return row.refused is None


def _order(row: CandidateRow) -> tuple[float, ...]:
    """What ranks rows, smallest first, each criterion as coarse as it means something.

    Good ones come first, of them those that were looked at closely; what no strokes
    reach comes last.
    """
    margin = 1e3 * CAP if row.margin_mm is None else min(row.margin_mm, 1e3 * CAP)
    values = row.model_dump() | {"wrong_share": row.wrong_share, "margin_mm": margin}
    sizes = [round((values[key] or 0.0) / unit) for key, unit in CRITERIA]
    head = (not _stands(row), not row.good, row.samples == 0, round(row.shortfall, 2))
    return (*map(float, head), *map(float, sizes))


def _number(value: float) -> float:
    """Plain rounded number, no negative zero."""
    return round(float(value), DIGITS) + 0.0
