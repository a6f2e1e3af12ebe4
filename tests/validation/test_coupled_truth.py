"""The coupled patch against finite elements: nearest of four shapes of least energy.

Slack leaves several stable shapes, and the poses do not say which of them a ply has. So
at most four are offered by energy, and the nearest to the truth, or to one of the other
equilibria listed with it, counts.
"""

import csv
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose

from drapeplan.compare import Surface, rms
from ply.coupled import CoupledModel, CoupledStatus
from ply.coupled_array import coupled_points
from ply.coupled_choice import coupled_alternatives
from ply.grid import CupGrid

DATA = Path(__file__).parents[1] / "data" / "truth"
MEAN, WORST = 0.08, 0.25  # [mm] rms of normal distances, asked for
MEAN_NOW, WORST_NOW = 0.036, 0.195  # [mm] found (0.034, 0.189), and 3 % for other BLAS
ARRAYS_NOW = 0.085  # [mm] found 0.012, 0.017 and 0.080
FIRST_NOW = 0.95  # [-] found: 38 of 40, counting shapes of equal energy as first
EQUAL = 1e-4  # [-] energies of mirror images, apart by the solver's last step
BETTER = 0.06  # [-] of the paper's mean, which is 0.80 mm; found 0.042
TAUT = 5e-4  # [-] strain of fibers whose cups are too far apart; found 7e-4 and more
FAILURES = ("A.over", "B.over", "B.rnd_over", "B.rnd_big", "B.sheared")
SET_APART = "B_lift40_tilt"
FINER = {"B_lift20_flatcup"}  # its finer mesh is the truth

with open(DATA / "paper.csv", newline="") as file:
    ROWS = {row["case"]: row for row in csv.DictReader(file)}
CASES = [
    name
    for name, row in ROWS.items()
    if row["class"] not in FAILURES and name != SET_APART
]
ARRAYS = [name for name in CASES if name.startswith("C_")]
FAILING = [name for name in ROWS if name not in CASES]
CELLS = [name for name in CASES if name not in ARRAYS]


class Score(NamedTuple):
    """Rms normal distance of the nearest shape, its rank, and all energies."""

    error: float
    rank: int
    energy: np.ndarray


def poses(name):
    """Grid, positions and rotations of a case, in SI units."""
    truth = np.load(DATA / f"{name}.npz")
    half, span = float(truth["d"]) / 1e3, float(truth["L"]) / 1e3
    grid = CupGrid(int(truth["ny"]), int(truth["nx"]), 2 * half + span, half)
    return grid, truth["poses"][:, :3, 3] / 1e3, truth["poses"][:, :3, :3]


def truths(name):
    """The case and its alternatives: free material points (n, 2) and surface, in mm."""
    paths = sorted((DATA / "alt").glob(f"{name}__*.npz"))
    if name not in FINER:
        paths.insert(0, DATA / f"{name}.npz")
    for path in paths:
        truth = np.load(path)
        a, b = np.nonzero(truth["cupid"] < 0)
        st = np.stack([truth["S"][a], truth["T"][b]], axis=-1)
        surface = Surface(truth["S"], truth["T"], np.swapaxes(truth["xyz"], 0, 1))
        yield st, surface


def error(st, surface, points):
    """Rms normal distance of points (n, 3) in [m], in [mm]."""
    return rms(surface.closest(1e3 * points, st).distance)


@cache
def score(name):
    grid, positions, rotations = poses(name)
    if grid.n_cups > 4:
        st, surface = next(truths(name))
        points, _ = coupled_points(grid, positions, rotations, *st.T / 1e3)
        return Score(error(st, surface, points), 0, np.zeros(1))
    model = CoupledModel(grid)
    found = coupled_alternatives(model, positions, rotations, count=4)
    found = found[found.status != CoupledStatus.ABSENT]
    assert (found.status == CoupledStatus.CONVERGED).all()
    errors = np.min(
        [
            [error(st, surface, p) for p in model.points(found, *st.T / 1e3)]
            for st, surface in truths(name)
        ],
        axis=0,
    )
    rank = int(errors.argmin())
    return Score(float(errors[rank]), rank, found.energy)


@pytest.mark.parametrize("name", CASES)
def test_no_case_is_far_off(name):
    assert score(name).error <= WORST_NOW <= WORST


def test_mean_over_the_accuracy_references():
    assert len(CASES) == 43
    errors = [score(name).error for name in CASES]
    paper = [float(ROWS[name]["paper_rms_mm"]) for name in CASES]
    assert np.mean(errors) <= MEAN_NOW <= MEAN
    assert np.mean(errors) < BETTER * np.mean(paper)


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_patch_by_patch(name):
    assert score(name).error <= ARRAYS_NOW


def test_first_offered_shape_is_the_truth():
    first = [
        score(name).energy[score(name).rank] <= (1 + EQUAL) * score(name).energy[0]
        for name in CELLS
    ]
    assert np.mean(first) >= FIRST_NOW


@pytest.mark.parametrize("name", FAILING)
def test_failure_cases_have_a_shape_all_the_same(name):
    """Not compared with anything: the poses ask for what no ply does."""
    _, positions, rotations = poses(name)
    model = CoupledModel(poses(name)[0])
    found = coupled_alternatives(model, positions, rotations, count=1)
    assert found.status[0] == CoupledStatus.CONVERGED
    if ROWS[name]["class"].endswith("over"):
        assert found.strain[0] > TAUT


@pytest.mark.parametrize("name", ["B_cyl1000", "B_saddle1000", "B_sph1000_slack0.2"])
def test_strips_alone_find_the_least_energy(name):
    grid, positions, rotations = poses(name)
    quick, thorough = (
        coupled_alternatives(CoupledModel(grid), positions, rotations, 1, all_starts)
        for all_starts in (False, True)
    )
    assert_allclose(quick.energy, thorough.energy, rtol=EQUAL)


def test_steps_of_newtons_method():
    """Cold on all cells, and warm from the shape before when the cups move 0.2 mm."""
    cells = [name for name in CELLS if name.startswith("B_")]
    grid = poses(cells[0])[0]
    positions = np.stack([poses(name)[1] for name in cells])
    rotations = np.stack([poses(name)[2] for name in cells])
    model = CoupledModel(grid)
    cold = model.solve(positions, rotations)
    assert np.mean(cold.iterations) <= 5
    shift = 2e-4 * np.random.default_rng(0).normal(size=(len(cells), 4, 1))
    moved = positions + shift * rotations[..., 2]
    warm = model.solve(moved, rotations, start=cold)
    assert (warm.status == CoupledStatus.CONVERGED).all()
    assert np.mean(warm.iterations) <= 3
