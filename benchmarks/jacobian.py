"""Time of the ply's Jacobian, and of a window of cups against the whole ply."""

import numpy as np

from benchmarks.ply import GRID, OVERHANG, STEP, median_time, poses
from ply.jacobian import point_jacobian
from ply.shape import PlySampling, ply_fibers

POINTS = 200
BATCHES = (1, 64)
SETTINGS: dict[str, dict] = {
    "cubic": {"model": "cubic"},
    "quartic": {"model": "quartic"},
    "modal": {"model": "modal"},
    "modal_band": {"model": "modal", "take_up": 0.8e-3},
}


def run(quick: bool) -> dict:
    """Milliseconds of the Jacobian of points."""
    return jacobian_times(3 if quick else 30)


def jacobian_times(repeats: int) -> dict[str, float]:
    """Milliseconds of 200 points, of those alone on a window, and of a whole ply."""
    far = GRID.centers.max(axis=0) + GRID.half_width + OVERHANG
    low = -GRID.half_width - OVERHANG
    points_st = np.random.default_rng(0).uniform(low, far, (POINTS, 2))
    positions, rotations = (array[0] for array in poses(1))
    every = PlySampling.regular(GRID, STEP, OVERHANG).points_st.reshape(-1, 2)
    result = {}
    for name, settings in SETTINGS.items():
        fibers = ply_fibers(GRID, positions, rotations, **settings)
        for count, places in ((POINTS, points_st), (len(every), every)):
            seconds = median_time(
                lambda fibers=fibers, places=places, settings=settings: point_jacobian(
                    GRID, fibers, positions, rotations, places, **settings
                ),
                repeats,
            )
            result[f"jacobian_{name}_{count}_points_ms"] = 1e3 * seconds
    return result
