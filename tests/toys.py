"""Trials whose outcome is known, in place of simulations; light to import."""

import os
import signal
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drapeplan.scene import Scene
from drapeplan.tuning_space import Space

PATH = {"family": "rectangle_blend", "lift_per_m": 0.6, "bend_mm": 120.0}
PATH |= {"rim_offset_mm": 0.0, "toe_up_deg": 2.0}  # all that can be tuned
UPRIGHT = 6.0  # [deg] of the step that goes wrong
BEST = 0.7  # of every parameter, in the unit box: where the margin is largest


@dataclass(frozen=True)
class Toy:
    """Trials whose margin is known: a bowl in the box, with noise by sample."""

    scene: Scene
    seed: int = 0
    searched: str = "kinematic"
    victim: Path | None = None
    best: tuple[float, ...] | float = BEST

    def __call__(self, question):
        values = Space(self.scene, rest=False).point(question.path)
        if self.victim and values[0] < 0.4 and not self.victim.exists():
            self.victim.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        off = float(np.sum((values - self.best) ** 2))
        facts = {"stage": question.stage, "fidelity": "kinematic", "seed": self.seed}
        facts |= {"good": True, "not_good": [], "shortfall": 0.0}

        def row(k):
            noise = np.random.default_rng(k).normal() if k else 0.0
            margin = 1.0 - 4 * off + 0.3 * noise
            press = {"span_press_mm": 0.5, "pad_press_mm": 0.1}
            sizes = {"margin_mm": margin, "stable": True, "wrong": margin <= 0}
            return facts | {"sample": k, **sizes, **press}

        return [row(k) for k in (None, *question.samples)]


@dataclass(frozen=True)
class Leaning(Toy):
    """The same with a step in which cups should lean by UPRIGHT."""

    def __call__(self, question):
        angles = dict(question.path.toe_up_steps)
        off = angles.get(3, question.path.toe_up_deg) - UPRIGHT
        rows = super().__call__(question)
        for row in rows:
            margin = row["margin_mm"] - 0.05 * off**2
            row |= {"margin_mm": margin, "wrong": margin <= 0, "tightest_step": 3}
        return rows


@dataclass(frozen=True)
class Interrupted(Toy):
    """The same for somebody who loses patience at some question."""

    def __call__(self, question):
        if question.stage == "ranking":
            raise KeyboardInterrupt
        return super().__call__(question)


@dataclass(frozen=True)
class Counted(Toy):
    """The same, counting questions."""

    def __call__(self, question):
        COUNT.append(question)
        return super().__call__(question)


COUNT = []
