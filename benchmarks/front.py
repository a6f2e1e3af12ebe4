"""Time of the front check: a whole 6 x 8 ply, pose by pose, and where it goes."""

from collections.abc import Callable

import numpy as np

from benchmarks._timing import median_time
from drapeplan.flood import air_margins, escape_level, pass_level, premature_margins
from drapeplan.front import (
    FrontGrid,
    Tolerance,
    air_pockets,
    check_front,
    heights,
    premature_regions,
)
from ply.grid import CupGrid
from ply.sampling import PlySampling

CUPS = CupGrid(rows=8, columns=6, pitch=0.11, half_width=0.02)
STEP, OVERHANG = 0.01, 0.02  # [m] as in the default scene
START = 21  # cup (3, 3)
TOLERANCE = Tolerance()
POSES = 60


def run(quick: bool) -> dict:
    """Milliseconds a pose: whole checks, and the stages of one pose in mid wave."""
    repeats = 20 if quick else 200
    grid, final_gap = front_grid()
    good, spoiled = path(grid), path(grid, spoil=True)
    placed, landing = good[1:]
    result: dict[str, float] = {"samples": final_gap.size, "poses": POSES}
    for name, (gap, *cups) in {"in_order": good, "out_of_order": spoiled}.items():
        seconds = median_time(
            lambda gap=gap, cups=cups: check_front(gap, final_gap, grid, *cups),
            max(3, repeats // POSES),
        )
        result[f"check_{name}_ms_per_pose"] = 1e3 * seconds / POSES
    k = POSES // 2
    h = heights(spoiled[0][k], final_gap, grid.laid(placed[k]))
    touch, barrier, start = TOLERANCE.touch, TOLERANCE.barrier, grid.start_pad
    stages: dict[str, Callable[[], object]] = {
        "laid_and_heights": lambda: heights(h, final_gap, grid.laid(placed[k])),
        "pads": lambda: grid.on_pads(landing[k]),
        "flood_from_start": lambda: pass_level(h, start, True),
        "flood_to_edge": lambda: escape_level(h),
        "premature_margins": lambda: premature_margins(h, start, touch, barrier),
        "air_margins": lambda: air_margins(h, touch, barrier),
        "premature_labels": lambda: premature_regions(h, start, TOLERANCE),
        "pocket_labels": lambda: air_pockets(h, TOLERANCE),
    }
    for name, task in stages.items():
        result[f"{name}_ms"] = 1e3 * median_time(task, repeats)
    noise = np.random.default_rng(0).normal(size=h.shape) * touch
    rough = median_time(lambda: pass_level(h + noise, start, True), repeats)
    return result | {"flood_from_start_rough_ms": 1e3 * rough}


def front_grid() -> tuple[FrontGrid, np.ndarray]:
    """The ply's samples, and the gap of a laid state that is not quite flat, in [m]."""
    ply = PlySampling.regular(CUPS, STEP, OVERHANG)
    grid = FrontGrid(ply.s, ply.t, ply.cup_index, ply.cups_around, CUPS.columns, START)
    return grid, 3e-4 * np.sin(20 * grid.s) * np.cos(15 * grid.t)[:, None]


def path(grid: FrontGrid, spoil: bool = False) -> tuple[np.ndarray, ...]:
    """Gaps of a front that grows from the start, with placed and landing cups.

    Spoiled, the ply sags to the mold ahead of the front in every pose.
    """
    centers = grid.cup_centers - grid.cup_centers[grid.start_cup]
    s, t = grid.s - grid.cup_centers[START, 0], grid.t - grid.cup_centers[START, 1]
    radius = np.maximum(np.abs(s), np.abs(t)[:, None])
    front = np.linspace(-0.05, 0.55, POSES)[:, None, None]
    h = 0.4 * np.maximum(0, radius - front) ** 2 + 0.3 * np.maximum(0, -front)
    if spoil:
        sag = np.exp(-((s - 0.2) ** 2 + (t[:, None] - 0.3) ** 2) / 0.04**2)
        h = np.where(h > 2e-3, h * (1 - sag), h)
    reach = np.abs(centers).max(axis=1)
    placed = reach + 0.04 <= front[:, :, 0]
    landing = ~placed & (reach - 0.09 <= front[:, :, 0])
    return h + front_grid()[1], placed, landing
