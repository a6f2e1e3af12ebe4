"""Smooth surfaces through noisy scans, and the lengths on them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from drapeplan.surface_fit import cup_frame, fiber_lengths, fit_field, plan_knots
from ply.grid import CupGrid
from tests.scans import make_scan, truth_cups

L = 0.07  # [m] fiber length of all truth
FOUND = 1e-4  # [m] that L_s and L_t are to come back within
FLAT = 3e-5  # [m] the penalty sees uneven knots at the ends
KNOTS = np.linspace(0, 0.4, 24), np.linspace(0, 0.3, 18)  # [m]
GRID = CupGrid(3, 4, 0.11, 0.02)


def plane_points(seed, count=6000):
    random = np.random.default_rng(seed)
    return random.uniform([0, 0], [0.4, 0.3], (count, 2)), random


def wave(xy):
    return 0.004 * np.sin(xy[:, 0] / 0.03) * np.cos(xy[:, 1] / 0.05)


def test_field_follows_a_wave_through_noise_holes_and_strays():
    xy, random = plane_points(0)
    xy = xy[np.linalg.norm(xy - [0.2, 0.15], axis=1) > 0.015]
    values = wave(xy) + random.normal(0, 5e-4, len(xy))
    strays = random.choice(len(xy), 100, replace=False)
    values[strays] += random.choice([-0.02, 0.02], 100)
    field = fit_field(xy, values, KNOTS)
    inside = random.uniform([0.02, 0.02], [0.38, 0.28], (500, 2))
    hole = np.linalg.norm(inside - [0.2, 0.15], axis=1) < 0.015
    error = field(inside) - wave(inside)
    assert np.sqrt(np.mean(error[~hole] ** 2)) < 3e-4
    assert abs(error[hole]).max() < 2e-3
    assert field.noise == pytest.approx(5e-4, rel=0.05)


def test_field_of_a_plane_is_that_plane():
    xy, _ = plane_points(1, 500)
    field = fit_field(xy, 0.1 * xy[:, 0] - 0.2 * xy[:, 1] + 0.03, KNOTS)
    assert_allclose(field(xy), 0.1 * xy[:, 0] - 0.2 * xy[:, 1] + 0.03, atol=FLAT)
    assert field.noise < FLAT


def test_frame_stands_on_the_cups():
    angle = 0.4
    turn = np.array(
        [
            [np.cos(angle), 0, np.sin(angle)],
            [0, 1, 0],
            [-np.sin(angle), 0, np.cos(angle)],
        ]
    )
    flat = np.column_stack([GRID.centers, np.zeros(GRID.n_cups)]) @ turn.T + [1, 2, 3]
    frame = cup_frame(GRID, flat, np.tile(turn, (GRID.n_cups, 1, 1)))
    assert_allclose(frame.axes, turn, atol=1e-12)
    assert_allclose(frame.local(flat).mean(axis=0), 0.0, atol=1e-12)
    assert_allclose(frame.local(flat)[:, 2], 0.0, atol=1e-12)


def lengths(case, **scan_settings):
    cups, surface = truth_cups(case)
    frame = cup_frame(cups.grid, cups.positions, cups.rotations)
    local = frame.local(make_scan(surface, **scan_settings).points)
    field = fit_field(
        local[:, :2], local[:, 2], plan_knots(cups.grid, cups.positions, frame)
    )
    poses = cups.positions, cups.rotations
    return fiber_lengths(cups.grid, *poses, frame, field, local)


@pytest.mark.parametrize("noise", [0.0, 5e-4, 1e-3])
@pytest.mark.parametrize("case", ["C_sph2000", "C_wave", "C_cyl600", "B_cyl300"])
def test_lengths_come_back(case, noise):
    for estimate in lengths(case, noise=noise):
        assert estimate.length == pytest.approx(L, abs=FOUND)
        assert estimate.spread < FOUND


def test_covered_fibers_are_counted():
    s, t = lengths("C_wave")
    assert (s.fibers, t.fibers) == (3 * 12, 3 * 10)
    s, t = lengths("C_wave", hole=(0.165, 0.11, 0.03))  # amid a strip along s
    assert (s.fibers, t.fibers) == (35, 30)  # its edges are near enough to points
    assert s.length == pytest.approx(L, abs=FOUND)


@pytest.mark.parametrize("noise", [0.0, 5e-4, 1e-3])
def test_lengths_with_five_millimeters_of_bow(noise):
    for estimate in lengths("B_flat_slack1", noise=noise):
        assert estimate.length == pytest.approx(L, abs=FOUND)


def test_single_strip_has_one_family():
    s, t = lengths("A_bend20_slack2", noise=5e-4)
    assert s.length == pytest.approx(L, abs=FOUND)
    assert t is None
