"""Tune: the path's parameters, bettered by many simulations on common random errors.

The scene's own path comes first, with a few that have proved themselves on other molds;
CMA-ES starts from the best of them, asks for paths and is told their loss on the same
samples. What it converges to is the mean of its distribution; that mean, the scene's
own path and the luckiest trial are ranked on samples that the search has not seen, and
what is gained is told on yet others. The search's spread leaves the ply's stiffness out
(a table of rests for each trial costs more than its samples); ranking and confirmation
have all of it.

Where that is asked for, the cups of the steps that go wrong most then get a lean of
their own, by the same search around the better one of mean and luckiest trial.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import cma
import numpy as np
from numpy.typing import NDArray

from drapeplan.engine import Engine
from drapeplan.judged import Judged, trouble
from drapeplan.plan_file import MOST_SAMPLES
from drapeplan.rollout_file import FIELDS, RolloutFile, Values
from drapeplan.scene import Scene
from drapeplan.trial import Question, Row, Trials
from drapeplan.tuning_space import Path, Space, StepSpace

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]

SPREAD = 0.2  # [-] of the box: how far the search looks around at first
CLEARLY = 2.0  # [-] standard errors by which luck has to win where luck is not counted
RANKED = 64  # [-] samples of each finalist
PART = 100  # [-] samples asked at once: each worker plans a path anew for its own
STEPS, AROUND = 2, 18  # [-] steps that get a lean of their own; paths for that
FIRST = {  # [-] samples that checks of a plan, by default from 0 on, do not see
    "search": MOST_SAMPLES,
    "steps": MOST_SAMPLES,
    "ranking": 2 * MOST_SAMPLES,
    "confirmation": 3 * MOST_SAMPLES,
}


@dataclass(frozen=True)
class Effort:
    """How much is simulated.

    Attributes:
        budget: Paths that the search tries, beside the scene's own.
        samples: Samples of each.
        confirmed: Samples on which the gain is told.
        per_step: Paths that refine the lean of single steps; 0 for none.
    """

    budget: int = 64
    samples: int = 32
    confirmed: int = 200
    per_step: int = 0


@dataclass(frozen=True)
class Finalist:
    """A path that is ranked on samples that the search has not seen."""

    name: Literal["scene", "mean", "luckiest", "steps", "surrogate"]
    judged: Judged


@dataclass(frozen=True)
class Tuning:
    """What tuning found.

    Attributes:
        finalists: Ranked.
        chosen: The one taken.
        before: The scene's own path, on samples of its own.
        after: The chosen one, on the same.
        trials: Paths tried in the search, the scene's own among them.
    """

    finalists: tuple[Finalist, ...]
    chosen: Finalist
    before: Judged
    after: Judged
    trials: int

    @property
    def changed(self) -> bool:
        """Whether another path than the scene's own is taken."""
        return self.chosen.name != "scene"


class Tuner:
    """One tuning: who works, what is known, and what is asked next."""

    def __init__(
        self,
        trials: Trials,
        engine: Engine,
        file: RolloutFile,
        features: dict[str, Any],
        effort: Effort,
        progress: Progress | None = None,
    ) -> None:
        """Get ready.

        Args:
            trials: Tries paths in the scene.
            engine: Who works.
            file: Rows that are known, and where new ones are kept.
            features: What each row says beside what was simulated.
            effort: How much is simulated.
            progress: Called with what goes on and the share done, 0 to 1.
        """
        self.trials, self.engine, self.file = trials, engine, file
        self.features, self.effort, self.progress = features, effort, progress
        self.space = space_of(trials.scene, trials.searched)
        self.asked: dict[Path, int] = {}
        self.planned = effort.budget + 1 + effort.per_step
        self.begun, self.ran = time.monotonic(), 0
        self.best: Judged | None = None

    def run(self, propose: Callable[[list[Row]], Path | None] | None = None) -> Tuning:
        """Search, rank, choose and confirm.

        Args:
            propose: Names one more finalist from the rows of the search, or none.
        """
        scene = self.trials.scene.path
        try:
            mean, luckiest, tried = self._search(scene)
            paths: dict[Any, Path] = {"scene": scene, "mean": mean}
            paths["luckiest"] = luckiest
            if self.effort.per_step:
                paths["steps"] = self._by_step([mean, luckiest])
            proposed = propose(self.file.rows()) if propose else None
            if proposed:
                paths["surrogate"] = proposed
            ranked = self._judge(list(paths.values()), "ranking", RANKED)
            finalists = [Finalist(*pair) for pair in zip(paths, ranked, strict=True)]
            chosen = choose(finalists)
            pair = [scene, chosen.judged.path]
            before, after = self._judge(pair, "confirmation", self.effort.confirmed)
        finally:
            self.file.write()
        finalists.sort(key=lambda one: one.judged.loss)
        return Tuning(tuple(finalists), chosen, before, after, tried)

    def _search(self, scene: Path) -> tuple[Path, Path, int]:
        """Mean of the distribution at the end, the luckiest trial, and their count."""
        space, budget = self.space, self.effort.budget
        others = [p for p in space.known() if self._values(p) != self._values(scene)]
        found = self._judge([scene, *others[:budget]], "search", self.effort.samples)
        best = min(found, key=lambda one: one.loss)
        left = budget + 1 - len(found)
        mean, best, tried = self._evolved(space, best, "search", left)
        return mean, best.path, len(found) + tried

    def _by_step(self, paths: list[Path]) -> Path:
        """The best of some paths; the steps that go wrong most lean by themselves."""
        found = self._judge(paths, "search", self.effort.samples)
        best = min(found, key=lambda one: one.loss)
        steps = trouble(best.rows)[:STEPS]
        if not steps:
            return best.path
        space = StepSpace(best.path, steps)
        return self._evolved(space, best, "steps", self.effort.per_step)[0]

    def _evolved(
        self, space: Space | StepSpace, best: Judged, stage: str, budget: int
    ) -> tuple[Path, Judged, int]:
        """Mean of the distribution at the end, the luckiest trial, and their count."""
        numbers = np.random.default_rng(self.trials.seed)
        options = {
            "bounds": [0, 1],
            "verbose": -9,
            "randn": lambda *shape: numbers.standard_normal(shape),
            "seed": np.nan,  # leaves the one generator of numpy alone
        }
        start = np.full(max(space.size, 2), 0.5)  # the search knows no single dimension
        start[: space.size] = np.clip(space.point(best.path), 0, 1)
        search = cma.CMAEvolutionStrategy(start, SPREAD, options)
        self.best, tried = best, 0
        whole = budget // search.popsize * search.popsize
        self.planned -= budget - whole
        while tried < whole and not search.stop():
            points = search.ask()
            paths = [space.path(point[: space.size]) for point in points]
            found = self._judge(paths, stage, self.effort.samples)
            search.tell(points, [one.loss for one in found])
            self.best = min([self.best, *found], key=lambda one: one.loss)
            tried += len(paths)
        mean = space.path(search.result.xfavorite[: space.size])
        return mean, self.best, tried

    def _judge(self, paths: list[Path], stage: str, samples: int) -> list[Judged]:
        """Paths on samples of a stage; what is in the file is not simulated again."""
        first = FIRST[stage]
        chosen = tuple(range(first, first + samples))
        for path in paths:
            self.asked.setdefault(path, len(self.asked))
        todo = [
            Question(path, some, stage)
            for path in dict.fromkeys(paths)
            for some in self._missing(path, stage, chosen)
        ]

        def told(places: list[int], answers: list[list[Row]]) -> None:
            for k, rows in zip(places, answers, strict=True):
                self.file.add(self._complete(todo[k].path, rows))
                self.ran += len(todo[k].samples)
            self._tell(stage)

        self.engine.map(self.trials, todo, told)
        return [self._known(path, stage, chosen) for path in paths]

    def _missing(
        self, path: Path, stage: str, samples: tuple[int, ...]
    ) -> list[tuple[int, ...]]:
        """Samples of a path that are not known yet, in parts."""
        values = self._values(path)
        plan = self.file.row(stage, values, None)
        if plan and plan["refused"]:
            return []
        left = [k for k in samples if not self.file.row(stage, values, k)]
        return [tuple(left[k : k + PART]) for k in range(0, len(left), PART)]

    def _known(self, path: Path, stage: str, samples: tuple[int, ...]) -> Judged:
        values = self._values(path)
        plan = self.file.row(stage, values, None)
        rows = [self.file.row(stage, values, k) for k in samples]
        if plan is None:
            raise LookupError(f"{path} was asked for and has no row")
        return Judged(path, plan, tuple(row for row in rows if row))

    def _values(self, path: Path) -> Values:
        return (*self.space.values(path).values(), _plain(path))

    def _complete(self, path: Path, rows: list[Row]) -> list[Row]:
        """Rows with all columns of the file."""
        values = {f"path.{k}": v for k, v in self.space.values(path).items()}
        head: Row = {"trial": self.asked[path], "family": path.family}
        head["toe_up_steps"] = _plain(path)
        return [
            dict.fromkeys(FIELDS) | row | head | values | self.features for row in rows
        ]

    def _tell(self, stage: str) -> None:
        """Stage, rate and best margin, for whom it may concern."""
        if not self.progress:
            return
        seconds = max(time.monotonic() - self.begun, 1e-3)
        text = f"{stage}: {self.ran / seconds:.1f} rollouts/s"
        if self.best and self.best.rows:
            text += f", least margin of the best path {self.best.least:.2f} mm"
        effort = self.effort
        whole = self.planned * effort.samples
        whole += 3 * RANKED + 2 * effort.confirmed
        self.progress(text, min(self.ran / whole, 1.0))


def _plain(path: Path) -> str | None:
    """Steps that lean by themselves, as the file has them."""
    return json.dumps(path.toe_up_steps) if path.toe_up_steps else None


def space_of(scene: Scene, searched: str) -> Space:
    """Parameters that show in a search at some fidelity."""
    return Space(scene, searched == "equilibrium")


def choose(finalists: list[Finalist]) -> Finalist:
    """The mean, unless the scene's own is as good, or luck clearly better.

    The luckiest trial, or what a surrogate proposes, has to win by CLEARLY standard
    errors of the difference on common samples.

    Args:
        finalists: Among them "scene" and "mean".
    """
    by_name = {one.name: one for one in finalists}
    best = by_name["mean"]
    for one in finalists:
        if one.name in ("luckiest", "steps", "surrogate") and _clearly(one, best):
            best = one
    own = by_name["scene"]
    return own if own.judged.loss <= best.judged.loss else best


def _clearly(one: Finalist, other: Finalist) -> bool:
    """Whether a finalist is better by more than luck."""
    a, b = one.judged.losses, other.judged.losses
    if len(a) != len(b):
        return one.judged.loss < other.judged.loss  # one has no plan at all
    gain = b - a
    error = float(gain.std(ddof=1)) / np.sqrt(len(gain)) if len(gain) > 1 else 0.0
    return float(gain.mean()) > CLEARLY * error
