"""Tune: the path's parameters, bettered by many simulations on common random errors.

The scene's own path comes first, with a few that have proved themselves on other molds;
CMA-ES starts from the best of them, asks for paths and is told their loss on the same
samples. What it converges to is the mean of its distribution; that mean, the scene's
own path and the luckiest trial are ranked on samples that the search has not seen, and
what is gained is told on yet others. The search's spread leaves the ply's stiffness out
(a table of rests for each trial costs more than its samples); ranking and confirmation
have all of it.

The loss of a path is its expected wrongness, softened, from 0 to 1. A plan that is not
good adds, for each criterion, NOT_GOOD, and EXCESS times what it is beyond its limit,
relative: at like risk a good plan wins, but no criterion that is missed by a little
outweighs a risk that is halved.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import cma
import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from drapeplan.engine import Engine
from drapeplan.intervals import share_interval
from drapeplan.plan_file import MOST_SAMPLES
from drapeplan.rolling import CAP
from drapeplan.rollout_file import FIELDS, RolloutFile
from drapeplan.scene import Scene
from drapeplan.trial import Question, Row, Trials
from drapeplan.tuning_space import Path, Space

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]

SPREAD = 0.2  # [-] of the box: how far the search looks around at first
SOFT = 0.25  # [mm] of margin over which a sample goes from wrong to right
MARGIN, PRESS = 0.1, 0.1  # [-] price of a margin of 0 against CAP; of 1 mm of press
NOT_GOOD, EXCESS = 0.1, 0.2  # [-] price of a criterion not met; of twice its limit
REFUSED = 100.0  # [-] price of a path that no strokes follow: beyond any other
CLEARLY = 2.0  # [-] standard errors by which luck has to win where luck is not counted
RANKED = 64  # [-] samples of each finalist
PART = 100  # [-] samples asked at once: each worker plans a path anew for its own
FIRST = {  # [-] samples that checks of a plan, by default from 0 on, do not see
    "search": MOST_SAMPLES,
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
    """

    budget: int = 64
    samples: int = 32
    confirmed: int = 200


@dataclass(frozen=True)
class Judged:
    """A path on samples.

    Attributes:
        path: The path.
        plan: Row of the plan itself.
        rows: Rows of its samples; none where there is no plan.
    """

    path: Path
    plan: Row
    rows: tuple[Row, ...]

    @property
    def wrong(self) -> int:
        """Samples in the wrong order; all are, where there is no plan."""
        return sum(row["wrong"] for row in self.rows)

    @property
    def interval(self) -> tuple[float, float]:
        """Interval of P(wrong order), 95 %."""
        return share_interval(self.wrong, len(self.rows))

    @property
    def least(self) -> float:
        """Least margin of all samples, CAP where nothing threatens, in [mm]."""
        margins = [row["margin_mm"] for row in self.rows]
        return min([1e3 * CAP, *(m for m in margins if m is not None)])

    @property
    def losses(self) -> Array:
        """Loss of each sample, shape (n,); of the plan alone where there are none."""
        if self.plan["refused"]:
            return np.array([REFUSED - np.tanh(self.plan["refused_at"] / 100)])
        missed = len(self.plan["not_good"])
        price = NOT_GOOD * missed + EXCESS * (self.plan["shortfall"] - missed)
        return np.array([_loss(row) for row in self.rows]) + price

    @property
    def loss(self) -> float:
        """Mean loss."""
        return float(self.losses.mean())


@dataclass(frozen=True)
class Finalist:
    """A path that is ranked on samples that the search has not seen."""

    name: Literal["scene", "mean", "luckiest", "surrogate"]
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
        self.begun, self.ran, self.planned = time.monotonic(), 0, effort.budget + 1
        self.best: Judged | None = None

    def run(self, propose: Callable[[list[Row]], Path] | None = None) -> Tuning:
        """Search, rank, choose and confirm.

        Args:
            propose: Names one more finalist from the rows of the search.
        """
        scene = self.trials.scene.path
        try:
            mean, luckiest, tried = self._search(scene)
            paths: dict[Any, Path] = {"scene": scene, "mean": mean}
            paths["luckiest"] = luckiest
            if propose:
                paths["surrogate"] = propose(self.file.rows())
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
        space, seed = self.space, self.trials.seed
        numbers = np.random.default_rng(seed)
        options = {
            "bounds": [0, 1],
            "verbose": -9,
            "randn": lambda *shape: numbers.standard_normal(shape),
            "seed": np.nan,  # leaves the one generator of numpy alone
        }
        count = len(space.knobs)
        others = [p for p in space.known() if self._values(p) != self._values(scene)]
        known = others[: self.effort.budget]
        found = self._judge([scene, *known], "search", self.effort.samples)
        self.best, tried = min(found, key=lambda one: one.loss), len(found)
        start = np.full(max(count, 2), 0.5)  # the search knows no single dimension
        start[:count] = np.clip(space.point(self.best.path), 0, 1)
        search = cma.CMAEvolutionStrategy(start, SPREAD, options)
        left = self.effort.budget + 1 - tried
        self.planned = tried + left // search.popsize * search.popsize
        while tried < self.planned and not search.stop():
            points = search.ask()
            paths = [space.path(point[:count]) for point in points]
            found = self._judge(paths, "search", self.effort.samples)
            search.tell(points, [one.loss for one in found])
            self.best = min([self.best, *found], key=lambda one: one.loss)
            tried += len(paths)
        return space.path(search.result.xfavorite[:count]), self.best.path, tried

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

    def _values(self, path: Path) -> tuple[float, ...]:
        return tuple(self.space.values(path).values())

    def _complete(self, path: Path, rows: list[Row]) -> list[Row]:
        """Rows with all columns of the file."""
        values = {f"path.{k}": v for k, v in self.space.values(path).items()}
        head = {"trial": self.asked[path], "family": path.family}
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
        if one.name in ("luckiest", "surrogate") and _clearly(one, best):
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


def _loss(row: Row) -> float:
    """Loss of a sample: a softened count, with margin and press that go on counting."""
    most = 1e3 * CAP
    margin = most if row["margin_mm"] is None else min(row["margin_mm"], most)
    press = max(row["span_press_mm"], row["pad_press_mm"])
    soft = expit(-margin / SOFT) if row["stable"] else 1.0
    return float(soft + MARGIN * (1 - max(margin, -most) / most) + PRESS * press)
