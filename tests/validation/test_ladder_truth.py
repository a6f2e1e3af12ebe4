"""The ladder against finite elements, and its word against the coupled patch."""

from functools import cache

import numpy as np
import pytest

from benchmarks._truth import RUNGS, cases, scores
from ply.coupled import CoupledModel, CoupledStatus
from ply.grid import CupGrid
from ply.ladder import Rung, climb
from ply.ladder_rungs import cell_rms, probes
from ply.reconcile import reconcile
from tests.test_shape import rotations

MEAN, WORST = 0.10, 0.25  # [mm] rms asked of the mean, and of any coupled case
MEAN_NOW, WORST_NOW = 0.05, 0.195  # [mm] found 0.047 and 0.189
TOLERANCE = 1e-4  # [m]
CELL = CupGrid(2, 2, 0.11, 0.02)
STRIP = CupGrid(1, 2, 0.11, 0.02)
DRAWS = 300


@cache
def auto():
    return {name: row["auto"] for name, row in scores(cases(), 1, ("auto",)).items()}


def test_mean_and_worst_over_the_accuracy_references():
    errors = [score.rms for score in auto().values()]
    assert len(errors) == 43
    assert np.mean(errors) <= MEAN_NOW <= MEAN
    assert max(errors) <= WORST_NOW <= WORST


def test_every_rung_is_scored():
    found = scores(cases()[:1], 1)
    assert all(set(row) == set(RUNGS) for row in found.values())


@cache
def drawn(grid, relief, seed):
    """Poses on random quadrics, some lifted, turned or slack; fibers as they are."""
    rng = np.random.default_rng(seed)
    x, y = (grid.centers - grid.centers.mean(axis=0)).T
    size = relief * rng.choice([0, 0.3, 0.6, 1.0], (DRAWS, 1))
    a, b, c = size * rng.uniform(-1, 1, (3, DRAWS, 1)) * [[[1]], [[1]], [[0.5]]]
    lift = rng.choice([0, 0, 1e-4, 5e-4, 2e-3, 1e-2], (DRAWS, 1))
    height = -(a * x**2 + b * y**2) / 2 - c * x * y
    height += relief * lift * rng.normal(size=height.shape)
    p = np.stack(np.broadcast_arrays(x, y, height), axis=-1)
    tilt = np.stack([-b * y - c * x, a * x + c * y, 0 * height], axis=-1)
    tilt += rng.choice([0, 0, 0.003, 0.01], (DRAWS, 1, 1)) * rng.normal(size=p.shape)
    frames = rotations(tilt)
    for _ in range(3):
        mended = reconcile(grid, p, frames, 3e-3, np.deg2rad(1.5))
        p, frames = mended.positions, mended.rotations
    slack = rng.choice([0, 0, 0, 2e-6, 2e-5, 2e-4], (DRAWS, 1, 1)) / grid.pitch
    middle = p.mean(axis=1, keepdims=True)
    return middle + (1 - slack) * (p - middle), frames


@pytest.mark.parametrize("grid", [CELL, STRIP], ids=["cells", "strips"])
@pytest.mark.parametrize("relief", [0.3, 1.0, 1.7])
def test_where_it_stays_low_the_rung_above_is_near(grid, relief):
    """The promise of the ladder, for each state that it leaves below the top."""
    poses = drawn(grid, relief, seed=11)
    found = climb(grid, *poses, tolerance=TOLERANCE)
    low = found.rung.ravel() < Rung.COUPLED
    assert low.sum() >= DRAWS / 50
    some = (each[low] for each in poses)
    top = climb(grid, *some, tolerance=TOLERANCE, lowest=Rung.COUPLED)
    lines = probes(grid)
    places = np.meshgrid(lines.s, lines.t)
    kept = found.points(*places)[low]
    apart = cell_rms(grid, kept, top.points(*places)).ravel()
    stable = top.patches.status.ravel() == CoupledStatus.CONVERGED
    assert stable.mean() > 0.99
    assert apart[stable].max() < TOLERANCE


def test_where_it_stays_low_on_the_truth_cases_too():
    stays = 0
    for case in cases():
        poses = case.positions, case.rotations
        found = climb(case.grid, *poses, tolerance=TOLERANCE)
        low = found.rung < Rung.COUPLED
        stays += int(low.sum())
        model = CoupledModel(case.grid)
        top = climb(case.grid, *poses, lowest=Rung.COUPLED, model=model)
        lines = probes(case.grid)
        places = np.meshgrid(lines.s, lines.t)
        apart = cell_rms(case.grid, found.points(*places), top.points(*places))
        assert apart[low].max(initial=0) < TOLERANCE, case.name
    assert stays >= 10
