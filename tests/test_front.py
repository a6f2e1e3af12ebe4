"""The front check on plies whose verdict is known by hand.

No deadlines: the first call compiles, and loads what was compiled.
"""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter

from drapeplan.errors import InputError
from drapeplan.flood import air_margins, premature_margins
from drapeplan.front import (
    EventKind,
    Tolerance,
    air_pockets,
    check_front,
    first_touch,
    heights,
    premature_regions,
)
from tests.front_samples import (
    HALF,
    MM,
    PITCH,
    box,
    distance,
    growing_disk,
    make_grid,
    no_cups,
)

EPS, DELTA = Tolerance().touch, Tolerance().barrier
ROUNDING = 1e-12  # [m], [m^2], [m^3] float64 noise at ply scale
HIGH = 30 * MM  # [m] a ply far above the mold
FLAT = 0.0 * make_grid().areas  # final gap of a perfect laid state


def check(h, grid=None, final_gap=None, **options):
    """Verdict on poses of free plies, from their heights, shape (K, nt, ns) in [m]."""
    grid = grid or make_grid()
    final_gap = FLAT if final_gap is None else final_gap
    cups = {name: no_cups(grid, len(h)) for name in ("placed", "landing")}
    return check_front(h + final_gap, final_gap, grid, **{**cups, **options})


def kinds(verdict):
    """Kinds of the events, in order."""
    return [event.kind for event in verdict.events]


def random_height(number, shape):
    """Smooth random heights with contact, humps and hollows of 0 to 5 mm, in [m]."""
    rng = np.random.default_rng(number)
    field = gaussian_filter(rng.normal(size=shape), rng.uniform(0.6, 3))
    return (field / field.std() + rng.uniform(-0.5, 1.5)) * MM


# ---------------------------------------------------------------- order


def test_growing_disk_is_in_order():
    grid = make_grid()
    gap, placed, landing = growing_disk(grid)
    verdict = check_front(gap, FLAT, grid, placed, landing)
    assert verdict.passed
    assert verdict.starts_free
    assert verdict.events == ()
    assert verdict.worst_air is None
    assert verdict.contact_area[0] == 0.0
    assert verdict.contact_area[-1] == 1.0
    assert (np.diff(verdict.contact_area) >= 0).all()
    # Placed cups lay their pads at once; off the pads, touch follows the distance.
    r = distance(grid, grid.cup_centers[grid.start_cup])
    off = grid.cup_index < 0
    order = np.argsort(r[off])
    steps = np.diff(verdict.first_touch[off][order])
    assert steps.min() > -1.5 * HALF / (0.57 / 40)  # [poses] a patch laid a bit early


def test_ring_first_traps_a_pocket_of_known_size():
    """A square ring touches: the 5 x 3 free samples inside it stand 4 mm high."""
    grid = make_grid(start_cup=0)
    h = np.full((1, *FLAT.shape), HIGH)
    h[0, grid.start_pad] = 0.0
    ring = box(grid, (-0.02, 0.08), (-0.02, 0.06))
    inside = box(grid, (0.03, 0.07), (0.03, 0.05))
    h[0, ring] = 0.0
    h[0, inside] = 4 * MM
    h[0, box(grid, (0.05, 0.05), (0.04, 0.04))] = 4.5 * MM
    verdict = check(h, grid)
    (event,) = verdict.events
    assert not verdict.in_order
    assert not verdict.penetrates
    assert event.kind is EventKind.AIR_POCKET
    assert event.area == pytest.approx(15e-4, abs=ROUNDING)
    assert event.volume == pytest.approx(15e-4 * 4 * MM + 1e-4 * 0.5 * MM, abs=ROUNDING)
    assert event.depth == pytest.approx(4.5 * MM, abs=ROUNDING)
    assert_allclose(event.place_st, (0.05, 0.04), atol=ROUNDING)
    assert event.cup == (0, 0)
    assert verdict.air_margin == pytest.approx(-EPS, abs=ROUNDING)
    assert_array_equal(verdict.pocket_region, inside)


def test_pocket_area_counts_the_wider_cells_of_the_overhang():
    grid = make_grid(start_cup=0)
    h = np.zeros((1, *FLAT.shape))
    second = grid.s[1], grid.t[1]  # in the overhang, between 15 and 5 mm
    h[0, box(grid, (second[0],) * 2, (second[1],) * 2)] = 2 * MM
    (event,) = check(h, grid).events
    assert event.area == pytest.approx((10 * MM) ** 2, abs=ROUNDING)
    h[0, 1, 1], h[0, 2, 2] = 0.0, 2 * MM  # the next: between 5 and 10 mm
    (event,) = check(h, grid).events
    assert event.area == pytest.approx((7.5 * MM) ** 2, abs=ROUNDING)


def test_island_is_premature_where_it_touches():
    grid = make_grid()
    place = grid.cup_centers[11]  # cup (2, 3)
    h = np.full((1, *FLAT.shape), HIGH)
    h[0, grid.start_pad] = 0.0
    island = box(grid, place[0] + np.array([-0.01, 0.01]), place[1] + np.zeros(2))
    h[0, island] = 0.3 * MM
    verdict = check(h, grid)
    (event,) = verdict.events
    assert event.kind is EventKind.PREMATURE
    assert event.cup == (2, 3)
    assert event.area == pytest.approx(3e-4, abs=ROUNDING)
    assert (event.volume, event.depth) == (0.0, 0.0)
    assert verdict.premature_margin == pytest.approx(0.3 * MM - EPS, abs=ROUNDING)
    assert_array_equal(verdict.premature_region, island)
    assert verdict.worst_premature.cup == (2, 3)


def test_margins_count_the_fall_that_is_left():
    """A dip 2 mm above the mold under a high ply, and a hollow with a 3 mm vent."""
    grid = make_grid()
    h = np.full((2, *FLAT.shape), HIGH)
    h[:, grid.start_pad] = 0.0
    h[0, box(grid, (0.3, 0.3), (0.2, 0.2))] = 2 * MM
    h[1, box(grid, (0.0, 0.33), (0.0, 0.22))] = 0.0
    h[1, box(grid, (0.14, 0.18), (0.14, 0.18))] = 8 * MM
    vent = box(grid, (0.16, 0.16), (0.19, 0.22))
    h[1, vent] = 3 * MM
    verdict = check(h, grid)
    assert verdict.in_order
    assert_allclose(verdict.premature_margin, [2 * MM - EPS, np.inf], atol=ROUNDING)
    assert_allclose(verdict.air_margin, [np.inf, 3 * MM - EPS], atol=ROUNDING)
    assert (verdict.worst_premature.pose, verdict.worst_air.pose) == (0, 1)
    assert verdict.worst_air.cup == (1, 1)
    h[1, vent] = 0.0
    assert kinds(check(h, grid)) == [EventKind.AIR_POCKET]


def test_before_the_start_cup_touches_nothing_else_may():
    grid = make_grid()
    h = np.full((1, *FLAT.shape), HIGH)
    h[0, box(grid, (0.3, 0.3), (0.2, 0.2))] = 0.0
    assert kinds(check(h, grid)) == [EventKind.PREMATURE]
    h = np.full((1, *FLAT.shape), HIGH)
    h[0, grid.start_pad & box(grid, (0.13, 1), (0.13, 1))] = 0.0  # its own corner
    assert check(h, grid).passed


def test_contact_hangs_together_over_corners_but_air_does_not():
    grid = make_grid(start_cup=0)
    h = np.full((1, *FLAT.shape), HIGH)
    h[0, grid.start_pad] = 0.0
    step = np.arange(3)
    i, j = np.nonzero(grid.start_pad)
    h[0, i.max() + 1 + step, j.max() + 1 + step] = 0.0
    assert check(h, grid).in_order
    h = np.zeros((1, *FLAT.shape))
    h[0, :4, :4] = 5 * MM * np.eye(4)  # reaches the ply's corner, over corners alone
    assert kinds(check(h, grid)) == [EventKind.AIR_POCKET]


@pytest.mark.parametrize("excess", [-0.01, 0.01])
def test_barrier_and_touch_decide_at_their_values(excess):
    """Humps and hollows count above touch + barrier, contact up to touch."""
    grid = make_grid(start_cup=0)
    level = EPS + DELTA + excess * MM
    hump = np.where(grid.s < 0.1, 0.0, np.where(grid.s < 0.2, level, 0.0))
    hollow = np.zeros_like(FLAT)
    hollow[8, 8] = level
    assert check((hump + FLAT)[None], grid).in_order == (excess < 0)
    assert check(hollow[None], grid).in_order == (excess < 0)
    low = np.where(grid.s < 0.1, 0.0, np.where(grid.s < 0.2, HIGH, EPS - excess * MM))
    assert check((low + FLAT)[None], grid).in_order == (excess < 0)


@settings(max_examples=150, deadline=None)
@given(number=st.integers(0, 10**9), start=st.integers(0, 11))
def test_margins_and_labels_agree(number, start):
    """Floods and labeled regions are two ways to one verdict."""
    grid = make_grid(start_cup=start)
    h = random_height(number, FLAT.shape)
    early = premature_margins(h, grid.start_pad, EPS, DELTA).min()
    trapped = air_margins(h, EPS, DELTA).min()
    assert (early <= 0) == premature_regions(h, grid.start_pad, Tolerance()).any()
    assert (trapped <= 0) == air_pockets(h, Tolerance()).any()


@settings(max_examples=50, deadline=None)
@given(number=st.integers(0, 10**9), fall=st.floats(0, 3e-3))
def test_more_barrier_never_finds_more(number, fall):
    """A coarser barrier leaves fewer regions, each inside one of the finer one's."""
    grid = make_grid()
    h = random_height(number, FLAT.shape)
    fine, coarse = Tolerance(barrier=0.1 * MM), Tolerance(barrier=0.1 * MM + fall)
    for find in (
        lambda tolerance: premature_regions(h, grid.start_pad, tolerance),
        lambda tolerance: air_pockets(h, tolerance),
    ):
        assert not ((find(coarse) > 0) & ~(find(fine) > 0)).any()


@settings(max_examples=25, deadline=None)
@given(number=st.integers(0, 10**9), flip=st.sampled_from(["s", "t", "transpose"]))
@example(number=138851862, flip="s")  # two contacts as large, one deeper
def test_flips_and_transposes_change_nothing(number, flip):
    """The verdict's sizes do not depend on how the ply's coordinates run."""
    grid = make_grid(rows=3, columns=3, start_cup=4)
    h = random_height(number, grid.areas.shape)
    turn = {
        "s": lambda field: field[:, ::-1],
        "t": lambda field: field[::-1],
        "transpose": lambda field: field.T,
    }[flip]
    mine, turned = check(h[None], grid, 0 * h), check(turn(h)[None], grid, 0 * h)
    for name in ("premature_margin", "air_margin", "span_penetration", "contact_area"):
        assert_allclose(getattr(turned, name), getattr(mine, name), atol=ROUNDING)
    assert_array_equal(turned.pocket_region, turn(mine.pocket_region))
    assert_array_equal(turned.premature_region, turn(mine.premature_region))
    events = [sorted(v.events, key=lambda e: e.kind.value) for v in (mine, turned)]
    assert [e.kind for e in events[0]] == [e.kind for e in events[1]]
    for one, other in zip(*events, strict=True):
        for name in ("area", "volume", "depth"):
            assert_allclose(getattr(one, name), getattr(other, name), atol=ROUNDING)


# ---------------------------------------------------------------- depth


def test_flat_ply_pushed_through_a_bowl_is_in_order_and_penetrates():
    """Contact grows outward all the way; only its depth tells."""
    grid = make_grid()
    r = distance(grid, grid.cup_centers[grid.start_cup])
    bowl = -0.5 * (0.3**2 - r**2) * (r < 0.3)  # a convex mold, 45 mm high
    height = np.linspace(50 * MM, -149 * MM, 30)[:, None, None]
    verdict = check(height + bowl, grid)
    assert verdict.in_order
    assert verdict.penetrates
    assert not verdict.passed
    assert kinds(verdict) == [EventKind.PENETRATION] * 2
    assert verdict.events[1].pose == 29
    assert verdict.events[1].depth == pytest.approx(0.149 + 0.045, abs=ROUNDING)
    assert verdict.span_penetration[-1] == verdict.events[1].depth


@pytest.mark.parametrize(("depth", "passes"), [(0.9 * MM, True), (1.1 * MM, False)])
def test_landing_pads_may_sink_deeper_than_spans(depth, passes):
    grid = make_grid()
    h = np.where(grid.start_pad, -depth, HIGH)[None]
    landing = no_cups(grid, 1)
    assert kinds(check(h, grid, landing=landing)) == [EventKind.PENETRATION]
    landing[0, grid.start_cup] = True
    verdict = check(h, grid, landing=landing)
    assert verdict.passed == passes
    assert verdict.pad_penetration == pytest.approx(depth)
    assert verdict.span_penetration == 0.0
    assert kinds(verdict) == ([] if passes else [EventKind.PAD_PENETRATION])


def test_penetration_area_and_volume():
    grid = make_grid()
    h = np.where(grid.start_pad, 0.0, HIGH)[None]
    sunk = box(grid, (0.14, 0.15), (0.1, 0.12))
    h[0, sunk] = -2 * MM
    (event,) = check(h, grid).events
    assert event.kind is EventKind.PENETRATION
    assert event.area == pytest.approx(6e-4, abs=ROUNDING)
    assert event.volume == pytest.approx(6e-4 * 2 * MM, abs=ROUNDING)
    assert event.cup == (1, 1)


# ---------------------------------------------------------------- the laid state


def test_heights_are_above_the_laid_state_and_zero_where_laid():
    """A flat pad's bias of 1 mm is neither a pocket nor penetration."""
    grid = make_grid()
    final_gap = np.where(grid.cup_index >= 0, -1.1 * MM, 1.1 * MM)
    gap = np.stack([final_gap + HIGH, final_gap])
    free = np.zeros(gap.shape, dtype=bool)
    assert_allclose(heights(gap, final_gap, free)[1], 0.0, atol=ROUNDING)
    laid = free.copy()
    laid[0, 3] = True
    assert_array_equal(heights(gap, final_gap, laid)[0, 3], 0.0)
    verdict = check(gap - final_gap, grid, final_gap)
    assert verdict.passed
    assert verdict.highest.value == pytest.approx(1.1 * MM)
    assert verdict.lowest.value == pytest.approx(-1.1 * MM)
    assert verdict.highest.pose is None


def test_laid_samples_count_as_contact_and_their_deviation_is_reported():
    grid = make_grid()
    h = np.full((1, *FLAT.shape), HIGH)
    placed = no_cups(grid, 1)
    placed[0, [0, 1, 4, 5]] = True
    verdict = check(h, grid, placed=placed)
    laid = grid.laid(placed)[0]
    share = grid.areas[laid].sum() / grid.areas.sum()
    assert verdict.passed
    assert verdict.contact_area == pytest.approx(share)
    assert verdict.laid_deviation == pytest.approx(HIGH)
    assert_array_equal(verdict.first_touch == 0, laid)


def test_border_ring_placed_first_traps_the_middle():
    """Start cup inside, then the ring of border cups: premature and a pocket."""
    grid = make_grid(rows=5, columns=5, start_cup=12)
    i, j = np.divmod(np.arange(25), 5)
    placed = no_cups(grid, 2)
    placed[:, 12] = True
    placed[1] |= (np.minimum(i, j) == 0) | (np.maximum(i, j) == 4)
    final_gap = np.zeros_like(grid.areas)
    h = np.full((2, *final_gap.shape), HIGH)
    verdict = check(h, grid, final_gap, placed=placed)
    assert kinds(verdict) == [EventKind.PREMATURE, EventKind.AIR_POCKET]
    pocket = verdict.events[1]
    inner = (2 * PITCH + 2 * (PITCH - HALF)) ** 2  # between the border ring's pads
    cells = 2 * (PITCH + PITCH - HALF) / 0.01 - 1  # samples strictly between them
    assert pocket.area == pytest.approx((cells**2 - 25) * 1e-4, rel=1e-9)
    assert pocket.area == pytest.approx(inner - (2 * HALF) ** 2, rel=0.1)
    assert pocket.volume == pytest.approx(pocket.area * HIGH)


# ---------------------------------------------------------------- time


def test_first_touch_of_a_steady_fall_is_exact():
    """A ramp that falls 1 mm a pose touches at its height above touch, in poses."""
    ramp = np.linspace(0.2, 9.3, 12) * MM + np.zeros((3, 1))
    h = ramp - np.arange(9)[:, None, None] * MM
    time = first_touch(h, EPS)
    expected = np.maximum(0, (ramp - EPS) / MM)
    assert_allclose(time, np.where(expected > 8, np.inf, expected), atol=1e-9)


@settings(deadline=None)
@given(number=st.integers(0, 10**9))
def test_first_touch_says_by_which_pose(number):
    h = np.random.default_rng(number).integers(-2, 5, size=(6, 4, 5)) * MM
    time = first_touch(h, EPS)
    for k in range(6):
        assert_array_equal(time <= k, (h[: k + 1] <= EPS).any(axis=0))


def test_first_and_worst_of_many_events_are_kept():
    grid = make_grid()
    h = np.full((5, *FLAT.shape), HIGH)
    h[:, grid.start_pad] = 0.0
    for k, size in enumerate([0, 1, 3, 2, 2]):
        h[k, box(grid, (0.3, 0.3 + 0.01 * size - 0.001), (0.2, 0.2))] = 0.0
    verdict = check(h, grid)
    assert [event.pose for event in verdict.events] == [1, 2]
    assert [event.area for event in verdict.events] == pytest.approx([1e-4, 3e-4])
    assert verdict.starts_free is False


def test_worst_air_pocket_holds_the_most_air():
    """Not the deepest: 4 mm deep under one sample, then 3 mm under four."""
    grid = make_grid(start_cup=0)
    h = np.zeros((3, *FLAT.shape))
    h[0] = HIGH
    h[1, 10, 10] = 4 * MM
    h[2, 10:12, 10:12] = 3 * MM
    assert [event.pose for event in check(h, grid).events] == [1, 2]


# ---------------------------------------------------------------- input


@pytest.mark.parametrize("bad", ["gap", "final_gap", "placed", "nan", "no poses"])
def test_refuses_arrays_that_do_not_belong_together(bad):
    grid = make_grid()
    gap, cups = np.ones((2, *FLAT.shape)), no_cups(grid, 2)
    arguments = {"gap": gap, "final_gap": FLAT, "placed": cups, "landing": cups}
    if bad == "nan":
        gap[1, 3, 3] = np.nan
    elif bad == "no poses":
        arguments |= {"gap": gap[:0], "placed": cups[:0], "landing": cups[:0]}
    else:
        arguments[bad] = arguments[bad][..., :-1]
    with pytest.raises(InputError):
        check_front(grid=grid, **arguments)


def test_verdict_depends_on_the_tolerance_it_names():
    grid = make_grid(start_cup=0)
    h = np.zeros((1, *FLAT.shape))
    h[0, 8, 8] = 2 * MM
    coarse = Tolerance(barrier=2 * MM)
    assert not check(h, grid).in_order
    verdict = check(h, grid, tolerance=coarse)
    assert verdict.in_order
    assert verdict.tolerance == coarse
