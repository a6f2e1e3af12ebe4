"""Surrogate: the loss of a path predicted from rollouts, with its held-out error.

A Gaussian process over the logarithms or values of the parameters and, where rows of
several molds come together, what the molds are like. It may propose; simulations
decide.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drapeplan.errors import InputError
from drapeplan.tuning_space import KNOBS, Path, Space

Array = NDArray[np.float64]
Row = dict[str, Any]

FOLDS = 5  # [-] parts, each predicted from the others
FEWEST = 10  # [-] trials from which a prediction is worth the name
RESTARTS = 2  # [-] of the fit of length scales, which has more than one optimum
RATIOS = {f"path.{knob.name}" for knobs in KNOBS.values() for knob in knobs if knob.log}
PROPOSED = 2048  # [-] random paths, of which the best is proposed
CAP = 1.0  # [mm] margins beyond, either way, are the same: certain, errors or not


@dataclass(frozen=True)
class Surrogate:
    """Predicts the mean margin of a path's samples, capped, in [mm].

    Attributes:
        names: Columns that it reads.
        error: Root mean square error on trials held out, in [mm].
        naive: The same of predicting the mean of the others.
        predict: Mean and standard deviation for rows of columns, shape (n, columns).
    """

    names: tuple[str, ...]
    error: float
    naive: float
    predict: Callable[[Array], tuple[Array, Array]]


def trial_margins(rows: list[Row], stage: str = "search") -> tuple[list[Row], Array]:
    """One row for each trial, and its mean capped margin, shape (n,), in [mm].

    Args:
        rows: Rows of a rollout file.
        stage: Of which stage.
    """
    samples: dict[tuple[str, int], list[Row]] = {}
    for row in rows:
        if row["stage"] == stage and row["sample"] is not None:
            samples.setdefault((row["scene"], row["trial"]), []).append(row)
    margins = [
        np.mean(
            [
                CAP if (m := r["margin_mm"]) is None else min(max(m, -CAP), CAP)
                for r in s
            ]
        )
        for s in samples.values()
    ]
    return [some[0] for some in samples.values()], np.array(margins)


def fit_surrogate(rows: list[Row]) -> Surrogate:
    """Learn from the rows of one or more rollout files.

    Args:
        rows: Rows as they stand in the files.

    Raises:
        InputError: scikit-learn is missing, or there are too few trials.
    """
    try:
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
        from sklearn.model_selection import KFold, cross_val_predict
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler
    except ImportError:
        remedy = "pip install 'drapeplan[learn]'"
        raise InputError("surrogate", "", "needs scikit-learn", remedy) from None
    trials, margins = trial_margins(rows)
    if len(trials) < FEWEST:
        problem = f"has {len(trials)} trials with samples, too few to learn from"
        raise InputError("surrogate", "", problem, f"{FEWEST} are the least")
    names = columns_of(trials)
    x = table_of(trials, names)
    spans = np.ones(len(names))
    kernel = ConstantKernel(1.0, (0.01, 1e3)) * RBF(spans, (0.1, 1e3))
    kernel = kernel + WhiteKernel(0.1, (1e-4, 10.0))
    process = GaussianProcessRegressor(
        kernel, normalize_y=True, n_restarts_optimizer=RESTARTS, random_state=0
    )
    model = make_pipeline(StandardScaler(), process)
    folds = KFold(min(FOLDS, len(trials)), shuffle=True, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # scales beyond all data
        held_out = cross_val_predict(model, x, margins, cv=folds)
        model.fit(x, margins)
    others = (margins.sum() - margins) / (len(margins) - 1)

    def predict(points: Array) -> tuple[Array, Array]:
        mean, deviation = model.predict(points, return_std=True)
        return np.asarray(mean), np.asarray(deviation)

    return Surrogate(names, _rms(held_out - margins), _rms(others - margins), predict)


def proposal(surrogate: Surrogate, rows: list[Row], space: Space, seed: int) -> Path:
    """The path of the largest predicted margin among many random ones.

    Args:
        surrogate: What predicts.
        rows: Rows that it has learned from.
        space: Where to look.
        seed: Of the random paths.
    """
    points = np.random.default_rng(seed).random((PROPOSED, len(space.knobs)))
    paths = [space.path(point) for point in points]
    features = next(row for row in rows if row["stage"] == "search")
    table = [
        features | {f"path.{k}": v for k, v in space.values(path).items()}
        for path in paths
    ]
    mean, _ = surrogate.predict(table_of(table, surrogate.names))
    return paths[int(mean.argmax())]


def columns_of(trials: list[Row]) -> tuple[str, ...]:
    """Parameters and mold features that differ among trials."""
    names = [n for n in trials[0] if n.startswith(("path.", "mold."))]
    return tuple(n for n in names if len({row.get(n) for row in trials}) > 1)


def table_of(rows: list[Row], names: tuple[str, ...]) -> Array:
    """Columns of rows, shape (rows, names); logarithms where ratios count."""
    table = np.array([[float(row[name]) for name in names] for row in rows])
    ratios = np.array([name in RATIOS for name in names])
    table[:, ratios] = np.log(table[:, ratios])
    return table


def _rms(error: Array) -> float:
    return float(np.sqrt(np.mean(np.square(error))))
