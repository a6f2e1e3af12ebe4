"""The verdict on a window agrees with that on the whole ply.

No deadlines: the first call compiles, and loads what was compiled.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.ndimage import gaussian_filter, label
from scipy.spatial.transform import Rotation

from drapeplan.contact import HIGH, ply_over_mold
from drapeplan.faults import Fault, Samples, window_faults
from drapeplan.front import CORNERS, air_pockets, heights, premature_regions
from drapeplan.rollout import StepWindow, window_of
from tests.plans import scene, stages

ROUNDING = 1e-12  # [m] the order of sums over fewer cups
NOISE = 2e-3, 0.03  # [m], [rad] of a try at most: many are out of order
WINDOWS = {"middle": (range(2, 6), range(1, 5)), "corner": (range(4, 8), range(2, 6))}
POSES = 8


@pytest.fixture(scope="module")
def made():
    """Cell, sequence and wave of the default scene."""
    cell, sequence, _, wave = stages(scene())
    return cell, sequence, wave


@pytest.fixture(scope="module", params=WINDOWS)
def step(made, request):
    """A window of 4 x 4 cups in the middle, and one in the last corner."""
    cell, sequence, wave = made
    start = sequence.index(sequence.start_cup)
    laid = wave.positions[-1], wave.rotations[-1]
    return StepWindow.of(cell, start, laid, *WINDOWS[request.param])


def whole_heights(step, positions, rotations, placed):
    """Heights of the whole ply, as the contact check has them, (K, nt, ns), in [m]."""
    gap = ply_over_mold(step.cell, positions, rotations)[1]
    seen = np.where(step.grid.beside, HIGH, np.minimum(gap, HIGH))
    return heights(seen, step.final_gap, step.grid.laid(placed))


def whole_masks(step, h, laid, pads):
    """Where one pose of the whole is premature, trapped, and too deep twice."""
    tolerance = step.tolerance
    return (
        premature_regions(h, step.grid.start_pad, tolerance) > 0,
        air_pockets(h, tolerance, step.grid.vents) > 0,
        ~laid & ~pads & (-h > tolerance.penetration),
        ~laid & pads & (-h > tolerance.pad_penetration),
    )


def closed_in(step, h, masks):
    """The same masks, less contacts and pockets that reach the window's rim."""
    inner = np.zeros_like(masks[0])
    (i, j), (k, m) = ((part.start, part.stop) for part in step.lines)
    nt, ns = inner.shape
    inner[i + (i > 0) : j - (j < nt), k + (k > 0) : m - (m < ns)] = True
    touch, top = step.tolerance.touch, step.tolerance.touch + step.tolerance.barrier
    kept = []
    for mask, of, corners in (
        (masks[0], h <= top, CORNERS),
        (masks[1], h > touch, None),
    ):
        parts = label(of, corners)[0]
        kept.append(mask & ~np.isin(parts, parts[of & ~inner]))
    return (*kept, *masks[2:])


def told(step, masks):
    """Flags of the faults that have a sample in the window."""
    return sum(
        int(fault)
        for fault, mask in zip(Fault, masks, strict=True)
        if mask[step.lines].any()
    )


def moved_cups(wave, step, poses, number):
    """Poses of the whole with inner cups of the window moved, some onto the mold."""
    rng = np.random.default_rng(number)
    rows, columns = step.rows[1:-1], step.columns[1:-1]
    if step.rows.stop == 8:  # a corner: its outer cups have no neighbors beyond
        rows, columns = step.rows[1:], step.columns[1:]
    cups = (6 * np.array(rows)[:, None] + columns).ravel()
    p, R = wave.positions[poses], wave.rotations[poses]
    size = rng.uniform(0, 1)
    p[:, cups] += NOISE[0] * size * rng.normal(size=(1, len(cups), 3))
    turns = Rotation.from_rotvec(size * NOISE[1] * rng.normal(size=(len(cups), 3)))
    R[:, cups] = turns.as_matrix() @ R[:, cups]
    dips = cups[rng.random(len(cups)) < rng.uniform(0, 0.9)]
    p[:, dips] = wave.positions[-1, dips] + [0, 0, 1e-4]
    return p, R


def test_heights_of_a_window_are_those_of_the_whole(made, step):
    _, _, wave = made
    part = (slice(None), *step.lines)
    laid = step.grid.laid(wave.placed)[part]
    cups = wave.positions[:, step.cups], wave.rotations[:, step.cups]
    whole = whole_heights(step, wave.positions, wave.rotations, wave.placed)
    assert_allclose(step.heights(*cups, laid), whole[part], atol=ROUNDING)


def test_window_and_whole_agree_on_noisy_tries(made, step):
    """With the ply around it known on all, else on what is closed in the window."""
    _, _, wave = made
    seen = {fault: set() for fault in Fault}
    for number, first in enumerate(range(0, len(wave.placed) - POSES, 2)):
        poses = np.arange(first, first + POSES)
        placed, landing = wave.placed[poses], wave.landing[poses]
        nominal = whole_heights(
            step, wave.positions[poses], wave.rotations[poses], placed
        )
        p, R = moved_cups(wave, step, poses, number)
        cups = p[None][:, :, step.cups], R[None][:, :, step.cups]
        known = step.faults(*cups, placed, landing, step.around(nominal))[0]
        alone = step.faults(*cups, placed, landing)[0]
        laid, pads = step.grid.laid(placed), step.grid.on_pads(landing)
        h = whole_heights(step, p, R, placed)
        for k in range(POSES):
            masks = whole_masks(step, h[k], laid[k], pads[k])
            assert known[k] == told(step, masks)
            assert alone[k] == told(step, closed_in(step, h[k], masks))
            for fault in Fault:
                seen[fault].add(bool(known[k] & fault))
    for fault in (Fault.PREMATURE, Fault.PENETRATION):
        assert seen[fault] == {True, False}, seen


@settings(max_examples=150, deadline=None)
@given(number=st.integers(0, 10**9))
def test_labels_agree_on_rough_heights(step, number):
    """Random heights with contact, humps and hollows, some laid and some on pads."""
    rng = np.random.default_rng(number)
    field = gaussian_filter(rng.normal(size=step.final_gap.shape), rng.uniform(0.6, 5))
    h = (field / field.std() + rng.uniform(-1, 1.5)) * 1e-3
    laid, pads = rng.random((2, *h.shape)) < 0.3
    tolerance = step.tolerance
    window, laid_in, pads_in, start, vents = (
        np.ascontiguousarray(x[step.lines])
        for x in (h, laid, pads, step.grid.start_pad, step.grid.vents)
    )
    limits = (tolerance.touch, tolerance.barrier)
    limits += (tolerance.penetration, tolerance.pad_penetration)
    masks = whole_masks(step, h, laid, pads)
    for around, wanted in (
        (step.around(h[None]), masks),
        (step.unknown(1), closed_in(step, h, masks)),
    ):
        samples = Samples(laid_in[None], pads_in[None])
        rings = around.contact, around.air
        found = window_faults(window[None, None], samples, start, vents, *rings, limits)
        assert found[0, 0] == told(step, wanted)


def test_tries_are_judged_one_by_one(made, step):
    """Chunks of the batch change nothing."""
    _, _, wave = made
    poses = np.arange(18, 18 + POSES)
    tries = [moved_cups(wave, step, poses, number) for number in range(19)]
    p, R = (np.stack([t[n][:, step.cups] for t in tries]) for n in (0, 1))
    rest = wave.placed[poses], wave.landing[poses]
    together = step.faults(p, R, *rest)
    apart = [step.faults(p[n : n + 1], R[n : n + 1], *rest)[0] for n in range(19)]
    np.testing.assert_array_equal(together, apart)
    assert len(np.unique(together)) > 2


def test_a_window_holds_cups_and_their_neighbors():
    assert window_of(8, 6, np.array([20, 27])) == (range(2, 6), range(1, 5))
    assert window_of(8, 6, np.array([0])) == (range(0, 2), range(0, 2))
    assert window_of(8, 6, np.array([47])) == (range(6, 8), range(4, 6))
    assert window_of(8, 6, np.array([0, 47])) == (range(8), range(6))
