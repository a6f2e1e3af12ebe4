"""Time of the ply's Jacobian, and of a window of cups against the whole ply."""

import numpy as np

from benchmarks._timing import median_time
from benchmarks.ply import GRID, OVERHANG, STEP, poses
from ply.jacobian import point_jacobian
from ply.shape import PlySampling, ply_fibers
from ply.window import PlyWindow, window

POINTS = 200
BATCHES = (1, 8, 64)
WINDOW = range(2, 6), range(1, 5)  # rows and columns, in the middle
MOVED = (20, 21)
SETTINGS: dict[str, dict] = {
    "cubic": {"model": "cubic"},
    "quartic": {"model": "quartic"},
    "modal": {"model": "modal"},
    "modal_band": {"model": "modal", "take_up": 0.8e-3},
}


def run(quick: bool) -> dict:
    """Milliseconds of the Jacobian of points, and of windows of cups."""
    return jacobian_times(3 if quick else 30) | window_times(5 if quick else 100)


def jacobian_times(repeats: int) -> dict[str, float]:
    """Milliseconds for 200 points of one pose, and for the whole ply at 10 mm."""
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


def window_times(repeats: int) -> dict[str, float]:
    """Milliseconds a pose of the whole ply, of 4 x 4 cups, and of an update.

    The update is for two cups that moved, with the 3 x 4 cups around them.
    """
    small, cups = window(GRID, *WINDOW)
    arrays = {"whole": (GRID, slice(None)), "4x4": (small, cups)}
    sampling = {
        "whole": PlySampling.regular(GRID, STEP, OVERHANG),
        "4x4": PlySampling.regular(small, STEP),
    }
    result: dict[str, float] = {"share_of_cups_4x4": small.n_cups / GRID.n_cups}
    for name, settings in SETTINGS.items():
        for batch in BATCHES:
            p, frames = (np.ascontiguousarray(array) for array in poses(batch))
            seconds = {}
            for size, (grid, part) in arrays.items():
                held = p[:, part], frames[:, part]
                seconds[size] = median_time(
                    lambda grid=grid, held=held, size=size, settings=settings: sampling[
                        size
                    ].points(ply_fibers(grid, *held, **settings), *held),
                    1 + repeats // batch,
                )
            ply = PlyWindow(sampling["whole"], settings)
            fibers = ply_fibers(GRID, p, frames, **settings)
            points = sampling["whole"].points(fibers, p, frames)
            seconds["update"] = median_time(
                lambda ply=ply, points=points, p=p, frames=frames: ply.update(
                    points, MOVED, p, frames
                ),
                1 + repeats // batch,
            )
            key = f"window_{name}_batch_{batch}"
            for size, time in seconds.items():
                result[f"{key}_{size}_ms_per_pose"] = 1e3 * time / batch
            result[f"{key}_4x4_share"] = seconds["4x4"] / seconds["whole"]
            result[f"{key}_update_share"] = seconds["update"] / seconds["whole"]
    return result
