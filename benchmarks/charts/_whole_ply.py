"""The whole ply: what sampling lines and single precision cost and gain."""

from collections.abc import Callable

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from benchmarks._timing import interleaved
from benchmarks.ply import GRID, poses
from ply.fiber import Array
from ply.sampling import IN_CACHE, PlySampling
from ply.weave import PlyFibers, ply_fibers

STEPS = (10.0, 5.0, 2.5, 1.25)  # [mm] between lines; those of a plan are 10 mm apart
FINE = 0.625  # [mm] where the error of facets is looked at
QUICK = 5.0  # [mm] instead, in a quick run
BATCH = 64  # [-] poses at a time
SHOWN = 2  # [-] poses whose facets are compared: they are alike but for noise
MM = 1e-3


def whole_ply(quick: bool) -> list[dict]:
    """Time a pose, fibers and points, and error of the facets between the points.

    The reference is the model's own surface, so that the sampling alone is seen. In
    single precision the matrix products of the points are, and what goes into them.
    """
    batch = SHOWN if quick else BATCH
    held = poses(batch)
    few = held[0][:SHOWN], held[1][:SHOWN]
    fine = PlySampling.regular(GRID, (QUICK if quick else FINE) * MM)
    tasks, errors = {}, {}
    for model in ("cubic", "quartic", "modal"):
        exact = fine.points(ply_fibers(GRID, *few, model=model), *few)
        for step in STEPS[:1] if quick else STEPS:
            for single in (False, True) if model == "modal" else (False,):
                task = _task(model, step, single)
                key = f"{model}, float32" if single else model, step
                tasks[key] = lambda task=task: task(*held)
                lines = PlySampling.regular(GRID, step * MM)
                errors[key] = _facets(lines, task(*few), fine, exact)
    times = interleaved(tasks, 1 if quick else 9)
    return [
        {
            "set": "whole",
            "method": method,
            "setting": f"{step:g} mm",
            "cases": batch,
            "ms": 1e3 * times[method, step] / batch,
            "rms_mm": errors[method, step],
        }
        for method, step in tasks
    ]


def _task(model: str, step: float, single: bool) -> Callable[[Array, Array], Array]:
    sampling = PlySampling.regular(GRID, step * MM)
    points = _Single(sampling) if single else sampling.points
    return lambda p, frames: points(ply_fibers(GRID, p, frames, model=model), p, frames)


class _Single:
    """Points of a sampling in single precision: a choice that is not offered."""

    def __init__(self, sampling: PlySampling) -> None:
        self._edges = sampling._cup_edges
        self._sampling = sampling
        object.__setattr__(sampling, "_cup_edges", self._single_edges)
        object.__setattr__(sampling, "_blend", sampling._blend.astype(np.float32))

    def _single_edges(self, *arguments) -> Array:
        return self._edges(*arguments).astype(np.float32)

    def __call__(self, fibers: PlyFibers, positions: Array, frames: Array) -> Array:
        s, t = (each.astype(np.float32) for each in (fibers.s, fibers.t))
        kind = s.shape[-3:-1]
        matrices = self._sampling._matrices_of(*kind)
        if matrices[0].dtype != np.float32:
            single = type(matrices)(*(each.astype(np.float32) for each in matrices))
            self._sampling._matrices[kind] = single
        lines = len(self._sampling.t), len(self._sampling.s)
        out = np.empty((len(positions), *lines, 3), np.float32)
        for start in range(0, len(out), IN_CACHE):
            part = slice(start, start + IN_CACHE)
            arrays = (each[part] for each in (s, t, positions, frames))
            self._sampling._fill(out[part], *arrays)
        return out


def _facets(
    lines: PlySampling, points: Array, fine: PlySampling, exact: Array
) -> float:
    """Largest distance of bilinear facets from the surface they approach, in [mm]."""
    surface = RegularGridInterpolator((lines.t, lines.s), np.moveaxis(points, 0, 2))
    t, s = np.meshgrid(fine.t, fine.s, indexing="ij")
    inside = np.clip(t, *lines.t[[0, -1]]), np.clip(s, *lines.s[[0, -1]])
    away = surface(np.stack(inside, axis=-1)) - np.moveaxis(exact, 0, 2)
    return float(np.linalg.norm(away, axis=-1).max()) / MM
