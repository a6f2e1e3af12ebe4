"""Speed and accuracy of the mold's height grid and of the nets on it."""

from time import perf_counter
from typing import Any

import numpy as np

from drapeplan.mold import HeightGrid
from drapeplan.net import least_shear_net, nearest_net
from drapeplan.surfaces import AbstractSurface, Array, KinDrape, Paraboloid, Sphere

ROWS, COLUMNS, PITCH = 8, 6, 0.11
HALF = 0.40, 0.50  # [m] half sizes of the molds
SURFACES: dict[str, AbstractSurface] = {
    "convex 1.2, 2.5 m": Paraboloid(1.2, 2.5),
    "saddle -1.5, 1.8 m": Paraboloid(-1.5, 1.8),
    "sphere 1 m": Sphere(1.0),
    "KinDrape 0.3 x 1 m": KinDrape(0.3, 1.0),
}


def run(quick: bool = False) -> dict[str, Any]:
    """Measure the grid and the nets.

    Args:
        quick: Whether to take few repetitions.

    Returns:
        Nanoseconds a gap query and the grid's errors by its step, milliseconds a net
        by mold, and the seconds that compiling or loading the kernels took.
    """
    repeats = 5 if quick else 50
    grid = HeightGrid.from_surface(Sphere(1.0), *HALF)
    start = perf_counter()
    grid.gap(np.zeros((1, 3)))
    grid.height(0.0, 0.0)
    first_call = perf_counter() - start
    return {
        "first_call_s": first_call,
        "gap": [_gap(step, repeats) for step in (0.01, 0.005, 0.002)],
        "net": {name: _nets(surface, repeats) for name, surface in SURFACES.items()},
    }


def _best(function: Any, repeats: int) -> float:
    """Shortest run time, in [s]."""
    times = []
    for _ in range(repeats):
        start = perf_counter()
        function()
        times.append(perf_counter() - start)
    return min(times)


def _points(surface: AbstractSurface, count: int = 4920) -> Array:
    """Points of a ply near contact, shape (count, 3), in [m]."""
    s, t = np.meshgrid(np.linspace(-0.3, 0.3, 60), np.linspace(-0.4, 0.4, count // 60))
    return surface.point(s.ravel(), t.ravel()) + np.array([0, 0, 1e-3])


def _gap(step: float, repeats: int) -> dict[str, float]:
    """Cost and error of gap queries on a unit sphere, mold's edge asked for too."""
    surface = Sphere(1.0)
    fill = _best(lambda: HeightGrid.from_surface(surface, *HALF, step), 3)
    grid = HeightGrid.from_surface(surface, *HALF, step)
    table = _best(lambda: HeightGrid.table.func(grid), 3)
    points = _points(surface)
    error = np.max(abs(grid.gap(points) - surface.gap(points)))
    return {
        "step_mm": step * 1e3,
        "fill_ms": fill * 1e3,
        "table_ms": table * 1e3,
        "ns_per_point": _best(lambda: grid.gap(points, 1.0), repeats)
        / len(points)
        * 1e9,
        "error_um": float(error) * 1e6,
    }


def _nets(surface: AbstractSurface, repeats: int) -> dict[str, float]:
    """Cost and residual of both planning nets, the nearest one after a small lift."""
    grid = HeightGrid.from_surface(surface, *HALF)
    size = ROWS, COLUMNS, PITCH
    net = least_shear_net(grid, *size)
    i, j = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
    placed = (abs(i - 3.5) < 2) & (abs(j - 2.5) < 2)
    offsets = np.where(placed, 0, 0.1 * (net.xy[:, 0] ** 2 + net.xy[:, 1] ** 2))
    nearest = nearest_net(grid, net.xy, *size, placed, offsets)
    return {
        "least_shear_ms": 1e3 * _best(lambda: least_shear_net(grid, *size), repeats),
        "nearest_ms": 1e3
        * _best(lambda: nearest_net(grid, net.xy, *size, placed, offsets), repeats),
        "residual_m": max(net.residual, nearest.residual),
        "nearest_converged": nearest.converged,
        "shear_deg": float(np.degrees(net.shear)),
    }
