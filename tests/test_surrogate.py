"""Surrogate: it knows a smooth margin better than the mean does, and says how well."""

import numpy as np
import pytest

from drapeplan.errors import InputError
from drapeplan.surrogate import CAP, fit_surrogate, proposal, table_of, trial_margins
from drapeplan.tuning_space import Space
from tests.plans import scene
from tests.toys import BEST, PATH, Toy


def rows_of(count, noise=True):
    """Rows of a toy on random paths."""
    toy = Toy(scene(fidelity="kinematic", path=PATH))
    space = Space(toy.scene, rest=False)
    rows = []
    for trial, point in enumerate(np.random.default_rng(0).random((count, 4))):
        path = space.path(point)
        values = {f"path.{k}": v for k, v in space.values(path).items()}
        head = {"scene": "toy", "trial": trial, "mold.height_mm": 10.0, **values}
        found = toy(Question(path, range(1, 5) if noise else (0,)))
        rows += [row | head for row in found]
    return space, rows


class Question:
    """What a toy asks of a question."""

    def __init__(self, path, samples):  # noqa: D107
        self.path, self.samples, self.stage = path, tuple(samples), "search"


@pytest.fixture(scope="module")
def learned():
    space, rows = rows_of(40)
    return space, rows, fit_surrogate(rows)


def test_held_out_error_beats_the_mean(learned):
    _, _, surrogate = learned
    assert 0 < surrogate.error < 0.5 * surrogate.naive


def test_error_is_that_of_new_paths(learned):
    _, _, surrogate = learned
    _, rows = rows_of(70)
    trials, margins = trial_margins(rows)
    mean, deviation = surrogate.predict(table_of(trials, surrogate.names)[40:])
    rms = np.sqrt(np.mean((mean - margins[40:]) ** 2))
    assert rms < 2 * surrogate.error
    assert (deviation > 0).all()


def test_columns_that_never_change_are_left_out(learned):
    assert "mold.height_mm" not in learned[2].names
    assert len(learned[2].names) == 4


def test_proposal_is_near_the_best(learned):
    space, rows, surrogate = learned
    point = space.point(proposal(surrogate, rows, space, seed=0))
    assert np.abs(point - BEST).max() < 0.25
    again = proposal(surrogate, rows, space, seed=0)
    assert space.point(again).tolist() == point.tolist()


def test_margins_are_capped_and_samples_alone_count():
    _, rows = rows_of(2)
    rows[1]["margin_mm"] = None
    rows[0]["margin_mm"] = -100.0
    rows[2]["margin_mm"] = -100.0
    rest = [min(max(row["margin_mm"], -CAP), CAP) for row in rows[3:5]]
    _, margins = trial_margins(rows)
    assert margins[0] == pytest.approx(sum(rest) / 4)


def test_too_few_trials_are_bad_input():
    with pytest.raises(InputError, match="too few"):
        fit_surrogate(rows_of(3)[1])
