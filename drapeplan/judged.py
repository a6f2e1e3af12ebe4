"""Judged: a path on samples, and what it costs.

The loss of a path is its expected wrongness, softened, from 0 to 1. A plan that is not
good adds, for each criterion, NOT_GOOD, and EXCESS times what it is beyond its limit,
relative: at like risk a good plan wins, but no criterion that is missed by a little
outweighs a risk that is halved. A path that no strokes follow is beyond all of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from drapeplan.intervals import share_interval
from drapeplan.rolling import CAP
from drapeplan.trial import Row
from drapeplan.tuning_space import Path

Array = NDArray[np.float64]

SOFT = 0.25  # [mm] of margin over which a sample goes from wrong to right
MARGIN, PRESS = 0.1, 0.1  # [-] price of a margin of 0 against CAP; of 1 mm of press
NOT_GOOD, EXCESS = 0.1, 0.2  # [-] price of a criterion not met; of twice its limit
REFUSED = 100.0  # [-] price of a path that no strokes follow: beyond any other


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


def _loss(row: Row) -> float:
    """Loss of a sample: a softened count, with margin and press that go on counting."""
    most = 1e3 * CAP
    margin = most if row["margin_mm"] is None else min(row["margin_mm"], most)
    press = max(row["span_press_mm"], row["pad_press_mm"])
    soft = expit(-margin / SOFT) if row["stable"] else 1.0
    return float(soft + MARGIN * (1 - max(margin, -most) / most) + PRESS * press)


def trouble(rows: tuple[Row, ...]) -> list[int]:
    """Wave steps, from 1, in which samples are tightest, the worst first.

    Args:
        rows: Rows of samples.
    """
    sums: dict[int, float] = {}
    for row in rows:
        step = row["tightest_step"]
        if step:
            share = float(expit(-row["margin_mm"] / SOFT))
            sums[step] = sums.get(step, 0.0) + share
    return sorted(sums, key=lambda step: (-sums[step], step))
