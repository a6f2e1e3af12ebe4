import numpy as np
import pytest
from numpy.testing import assert_allclose

from drapeplan.kkt import SOFT, Layouts, SingularError
from drapeplan.tool_energy import PASSIVE, ToolEnergy
from tests.tool_samples import PLY, random_legs, small_tool

SAME = 1e-9  # [-] relative, of two solutions of a system of condition 1e6


@pytest.fixture(scope="module")
def case():
    """Energy, its terms at a random pose, a few free legs and rows in force."""
    robot, rng = small_tool(), np.random.default_rng(0)
    energy = ToolEnergy(robot, PLY)
    forces = rng.uniform(0, 0.1, len(energy.row_pairs))
    T = robot.arm_forward(robot.home()[robot.arm_columns])
    free = np.ones(robot.n_cups, bool)
    free[[1, 4, 5]] = False
    active = np.arange(len(forces)) < energy.n_links
    active[[20, 33, 40]] = True
    active &= free[energy.row_pairs].any(axis=1)
    return energy, energy.evaluate(T, random_legs(robot, rng), forces), free, active


def whole(terms, energy, free, active):
    """H and J by loops, cups and rows in their own order."""
    n = len(free)
    H, J = np.zeros((n, 6, n, 6)), np.zeros((len(active), n, 6))
    H[range(n), :, range(n)] = terms.own
    for (i, j), block in zip(energy.pairs, terms.mixed, strict=True):
        H[i, :, j], H[j, :, i] = block, block.T
    for k, (i, j) in enumerate(energy.row_pairs):
        J[k, i], J[k, j] = terms.rows[k]
    keep = np.zeros((n, 6), bool)
    keep[:, PASSIVE] = free[:, None]
    keep = keep.ravel()
    return H.reshape(6 * n, -1)[keep][:, keep], J[active].reshape(-1, 6 * n)[:, keep]


@pytest.mark.parametrize("size", [(4, 3), (3, 4)])
def test_banded_solution_is_the_dense_one(case, size):
    """Along either side of the grid: a (3, 4) sweep only orders otherwise."""
    energy, terms, free, active = case
    layout = Layouts(*size, energy)(free, active)
    H, J = whole(terms, energy, free, active)
    dense = layout.dense(terms)
    assert_allclose(dense[0], H, atol=1e-12)
    assert_allclose(dense[1], J, atol=1e-12)
    K = np.block([[H, J.T], [J, -SOFT * np.eye(len(J))]])
    right = np.random.default_rng(1).normal(size=(len(K), 2))
    placed = np.zeros_like(right)
    places = np.concatenate([layout.x[layout.cups].ravel(), layout.f[layout.rows]])
    placed[places] = right
    solution = layout.factor(terms).solve(placed)[places]
    expected = np.linalg.solve(K, right)
    assert_allclose(solution, expected, atol=SAME * np.abs(expected).max())


def test_entries_lie_near_the_diagonal(case):
    energy, _, free, active = case
    every = np.ones_like(free)
    links = np.arange(len(active)) < energy.n_links
    assert Layouts(4, 3, energy)(every, links).band <= 3 * 7 + 6
    assert Layouts(4, 3, energy)(free, active).size == 5 * free.sum() + active.sum()


def test_layouts_are_kept_and_let_go(case):
    energy, _, free, active = case
    layouts = Layouts(4, 3, energy)
    first = layouts(free, active)
    assert layouts(free.copy(), active.copy()) is first
    for k in range(70):
        other = active.copy()
        other[np.flatnonzero(active)[k % 10]] = False
        other[np.flatnonzero(active)[10 + k // 10]] = False
        layouts(free, other)
    assert layouts(free, active) is not first


def test_a_system_without_solution_says_so(case):
    energy, terms, free, active = case
    layout = Layouts(4, 3, energy)(free, np.zeros_like(active))
    zero = type(terms)(
        **{**vars(terms), "own": 0 * terms.own, "mixed": 0 * terms.mixed}
    )
    with pytest.raises(SingularError):
        layout.factor(zero)
