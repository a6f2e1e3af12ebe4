"""Trial: one path of a scene, planned and judged under common random errors.

What comes out are rows of plain values, one for the plan itself and one for each
sample, as they stand in the rollout file.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from drapeplan.cell import Cell, Sources, build_cell
from drapeplan.errors import InfeasibleError
from drapeplan.noise import Spread, draw
from drapeplan.plan import Plan
from drapeplan.planner import NotDrapableError, plan_drape
from drapeplan.robustness import make_course
from drapeplan.rolling import Course, Rollout, roll
from drapeplan.scene import Scene
from drapeplan.sequence import Sequence, make_sequence
from drapeplan.shortfall import shortfall
from drapeplan.tuning_space import Path

Row = dict[str, Any]
KEPT = 3  # [-] plans that a worker remembers: finalists come in several parts


@dataclass(frozen=True)
class Question:
    """What to try.

    Attributes:
        path: The path.
        samples: Indices of the random samples.
        stage: Of the tuning: "search", "steps", "ranking" or "confirmation".
    """

    path: Path
    samples: tuple[int, ...]
    stage: str


@dataclass(frozen=True)
class Trials:
    """Tries paths in a scene; its cell is built once, where it works.

    Attributes:
        scene: The scene; its path is replaced.
        sources: What its cell is built from.
        seed: Of the samples.
        searched: Fidelity of the search; the other stages have the scene's.
    """

    scene: Scene
    sources: Sources
    seed: int
    searched: str

    def __call__(self, question: Question) -> list[Row]:
        """Rows of a question; the plan's own row has no sample.

        Args:
            question: What to try.
        """
        plan, spread, course, facts = self._planned(question.path, question.stage)
        if plan is None or course is None:
            return [facts]
        poses, cups = course.rests.fixed.shape

        def row(k: int | None) -> Row:
            noise = Spread() if k is None else spread
            numbers = draw(self.seed, k or 0, cups, poses, noise.redrawn)
            found = roll(course, numbers, noise)
            return facts | {"sample": k} | measured(found, plan.sequence)

        return [row(k) for k in (None, *question.samples)]

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel without what was built on the way."""
        return Trials, (self.scene, self.sources, self.seed, self.searched)

    @cached_property
    def cell(self) -> Cell:
        """Robot, mold and ply."""
        return build_cell(self.scene, self.sources)

    @cached_property
    def sequence(self) -> Sequence:
        """Start cup and steps."""
        grid = self.cell.grid
        return make_sequence(self.scene.sequence, grid.rows, grid.columns, "scene")

    @cached_property
    def _planned(self) -> Any:
        return lru_cache(maxsize=KEPT)(self._plan)

    def _plan(
        self, path: Path, stage: str
    ) -> tuple[Plan | None, Spread, Course | None, Row]:
        """A plan with what its samples share, or None, and what is known of it."""
        search = stage in ("search", "steps")
        fidelity = self.searched if search else self.scene.fidelity
        scene = self.scene.model_copy(update={"path": path, "fidelity": fidelity})
        spread = Spread.of(scene.uncertainty)
        if search:  # the table of stiffnesses costs more than the samples
            spread = replace(spread, stiffness=0.0)
        facts = {"stage": stage, "fidelity": fidelity, "seed": self.seed}
        cell = replace(self.cell, scene=scene)
        try:
            made = plan_drape(cell, self.sequence)
        except InfeasibleError as error:
            way = 0.0
            if isinstance(error, NotDrapableError):
                way = float(error.report["strokes"]["waypoint"])
            refused = {"good": False, "refused": str(error), "refused_at": way}
            return None, spread, None, facts | refused | {"not_good": ["refused"]}
        plan = made.plan
        vars(plan).update(cell=cell, judged=(plan.verdict, made.contact))
        short = shortfall(plan.verdict)
        facts |= {
            "good": plan.verdict["good"],
            "not_good": sorted(short),
            "shortfall": sum(short.values()),
            "plan_hash": plan.document["hash"],
        }
        return plan, spread, make_course(plan, spread), facts


def measured(found: Rollout, sequence: Sequence) -> Row:
    """A rollout as plain values: margins in [mm], None where nothing threatens.

    Args:
        found: The rollout.
        sequence: Gives the cups of the step at which it is tightest.
    """

    def plain(margin: float) -> float | None:
        return 1e3 * float(margin) if np.isfinite(margin) else None

    early, air = float(found.premature.min()), float(found.air.min())
    cause = "premature" if early <= air else "air_pocket"
    step = cups = None
    if np.isfinite(found.margin):
        step = int(np.minimum(found.premature, found.air).argmin())
        landing = [sequence.start_cup] if step == 0 else sequence.steps[step - 1]
        cups = [list(map(int, cup)) for cup in landing]
    s, t = found.place or (None, None)
    return {
        "premature_mm": plain(early),
        "air_mm": plain(air),
        "margin_mm": plain(found.margin),
        "span_press_mm": 1e3 * found.span_press,
        "pad_press_mm": 1e3 * found.pad_press,
        "stable": found.stable,
        "wrong": found.wrong,
        "cause": ("no_rest" if not found.stable else cause) if found.wrong else None,
        "tightest_step": step,
        "tightest_cups": cups,
        "tightest_s_mm": None if s is None else 1e3 * s,
        "tightest_t_mm": None if t is None else 1e3 * t,
    }
