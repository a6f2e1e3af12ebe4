"""A ply model against a scan of a held ply: Section 6 of [Nielsen2018] as a command.

The paper scores offsets in z and gives no frame for it. Here z is the normal of the
plane of least squares of the cups, so that a score does not change when the whole scene
is turned; world z stands beside it where that plane is not steep.
"""

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from drapeplan.compare import FAR, Array, Comparison, Place, Surface, compare, rms
from drapeplan.cups import report_of
from drapeplan.cups_file import MM, Cups
from drapeplan.errors import InputError
from drapeplan.scan import Scan
from drapeplan.shape_models import Held, check_model, hold
from drapeplan.surface_fit import (
    Field,
    Frame,
    LengthEstimate,
    cup_frame,
    fiber_lengths,
    fit_field,
    material_knots,
    plan_knots,
)
from ply.grid import CupGrid

MESH = 0.005  # [m] widest mesh of the model's surface: a chord error below 10 um
MARGIN = 0.01  # [m] around the cups; what lies outside is another part of the ply
LEAST = 50  # points over the free ply; less than that is no score
LEVEL = 0.5  # [-] cosine above which world z still crosses the ply


@dataclass(frozen=True)
class Score:
    """Root mean square and largest size of some errors, in [m]."""

    rms: float
    max: float


@dataclass(frozen=True)
class Worst:
    """Where the smoothed error along the normal is largest, all in [m].

    Positive: the scan lies on the cups' side of the model.
    """

    s: float
    t: float
    error: float


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a figure of the validation draws.

    Attributes:
        cups: The cups, with the fiber lengths that the model was given.
        frame: Frame of the plane of the cups.
        points: Points of the scan near the cups, in that frame, shape (n, 3), in [m].
        comparison: Those points against the model.
        surface: The model.
        error: Smoothed error along the normal over material coordinates (s, t).
    """

    cups: Cups
    frame: Frame
    points: Array
    comparison: Comparison
    surface: Surface
    error: Field


@dataclass(frozen=True, eq=False)
class Validation:
    """Errors of a model against a scan.

    Attributes:
        model: The model.
        points: Points of the scan by Place.
        z: Errors along the normal of the cups' plane.
        world_z: Errors along world z, or None where the cups' plane is steep.
        normal: Errors along the normal of the model.
        noise: Standard deviation of the scan about a smooth error, in [m].
        rms_without_noise: What the noise leaves of the rms along the normal, in [m].
        worst: Where the smoothed error is largest.
        lengths: Estimates of L_s and L_t; None where the cups file gives the length,
            or where there is no span.
        grid: The cup array, with the lengths that the model was given.
        report: What became of the fibers, as `drapeplan shape` says it.
        seconds: Time that the model took.
        evidence: What a figure draws.
    """

    model: str
    points: dict[Place, int]
    z: Score
    world_z: Score | None
    normal: Score
    noise: float
    rms_without_noise: float
    worst: Worst
    lengths: tuple[LengthEstimate | None, LengthEstimate | None]
    grid: CupGrid
    report: dict[str, Any]
    seconds: float
    evidence: Evidence

    def within(self, rms_limit: float, max_limit: float) -> bool:
        """Whether the errors in z keep two limits, in [m]."""
        return self.z.rms <= rms_limit and self.z.max <= max_limit


def validate(cups: Cups, scan: Scan, model: str = "quartic") -> Validation:
    """Score a model against a scan.

    Args:
        cups: The cups that held the ply. Fiber lengths that their file does not give
            are estimated from the scan.
        scan: The scan, in the frame of the cups.
        model: One of `drapeplan.shape_models.MODELS`.

    Returns:
        The validation.

    Raises:
        InputError: The model does not exist, scan and cups lie apart, or the scan shows
            too little of the free ply.
    """
    check_model(model)
    frame = cup_frame(cups.grid, cups.positions, cups.rotations)
    near, far = _select(cups, frame, scan)
    world = scan.points[near]
    local = frame.local(world)
    cups, lengths = _with_lengths(cups, frame, local, scan.source)
    start = time.perf_counter()
    held = hold(cups, model)[0]
    surface = _surface(held)
    seconds = time.perf_counter() - start
    found = compare(surface, cups.grid, world)
    free = found.free
    if free.sum() < LEAST:
        problem = f"{free.sum()} points lie over the free ply within {FAR / MM:g} mm"
        remedy = f"give {LEAST} or more, in the frame of the cups"
        raise InputError(scan.source, "", problem, remedy)
    ply = free | (found.place == Place.ON_CUP)
    error = fit_field(found.st[ply], found.normal[ply], material_knots(cups.grid))
    z = surface.along(world[free], frame.axes[:, 2], found.st[free])
    level = frame.axes[2, 2] > LEVEL
    up = surface.along(world[free], (0.0, 0.0, 1.0), found.st[free]) if level else None
    counts = {kind: int((found.place == kind).sum()) for kind in Place}
    counts[Place.FAR] += far
    counts[Place.BEYOND] += len(scan.points) - len(world) - far
    normal = _score(found.normal[free])
    return Validation(
        model=model,
        points=counts,
        z=_score(z.distance[z.inside]),
        world_z=_score(up.distance[up.inside]) if up is not None else None,
        normal=normal,
        noise=error.noise,
        rms_without_noise=max(normal.rms**2 - error.noise**2, 0.0) ** 0.5,
        worst=_worst(error, found.st[free]),
        lengths=lengths,
        grid=cups.grid,
        report=report_of(held, model) | {"words": held.words},
        seconds=seconds,
        evidence=Evidence(cups, frame, local, found, surface, error),
    )


def model_surface(cups: Cups, model: str) -> Surface:
    """The model's ply from the outer edges of the outer cups to each other, in [m]."""
    return _surface(hold(cups, model)[0])


def _surface(held: Held) -> Surface:
    grid = held.cups.grid
    s, t = _lines(grid, grid.columns), _lines(grid, grid.rows)
    return Surface(s, t, held.points(*np.meshgrid(s, t)))


def _lines(grid: CupGrid, count: int) -> Array:
    """Lines that divide each cup and each span evenly."""
    half, parts = grid.half_width, []
    for low, high in ((-half, half), (half, grid.pitch - half)):
        parts.append(np.linspace(low, high, int(np.ceil((high - low) / MESH)) + 1)[:-1])
    pattern = np.concatenate(parts)
    lines = (grid.pitch * np.arange(count)[:, None] + pattern).ravel()
    last = (count - 1) * grid.pitch + half
    return np.append(lines[lines < last - MESH / 1e3], last)


def _select(cups: Cups, frame: Frame, scan: Scan) -> tuple[Array, int]:
    """Which points lie near the cups, and how many lie above or below them."""
    half = cups.grid.half_width * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    sides = half @ np.swapaxes(cups.rotations[:, :, :2], 1, 2)
    corners = frame.local(cups.positions[:, None] + sides).reshape(-1, 3)
    local, low, high = frame.local(scan.points), corners.min(0), corners.max(0)
    margin = np.array([MARGIN, MARGIN, cups.grid.span / 2 + FAR])
    inside = (local >= low - margin) & (local <= high + margin)
    near = inside.all(axis=1)
    ratio = np.ptp(cups.positions, 0).max() / max(np.ptp(scan.points, 0).max(), 1e-9)
    in_meters = 200 < ratio < 2000
    if near.sum() < LEAST or in_meters:
        where = _box(scan.points), _box(cups.positions)
        problem = f"does not overlap the cups: the scan lies in {where[0]}, "
        problem += f"the cups of {cups.source or 'the array'} in {where[1]}"
        remedy = "give the scan in the frame of the cups"
        if in_meters:
            remedy = "this looks like meters: try --unit m"
        raise InputError(scan.source, "", problem, remedy)
    return near, int((inside[:, :2].all(axis=1) & ~near).sum())


def _with_lengths(
    cups: Cups, frame: Frame, local: Array, source: str
) -> tuple[Cups, tuple[LengthEstimate | None, LengthEstimate | None]]:
    """Cups with the lengths that their file leaves out, and the estimates used."""
    if all(cups.lengths_given):
        return cups, (None, None)
    grid = cups.grid
    knots = plan_knots(grid, cups.positions, frame)
    surface = fit_field(local[:, :2], local[:, 2], knots)
    found = fiber_lengths(grid, cups.positions, cups.rotations, frame, surface, local)
    used: list[LengthEstimate | None] = []
    change: dict[str, Any] = {}
    counts = (grid.columns, grid.rows)
    for k, name in enumerate(("s_length", "t_length")):
        estimate = None if cups.lengths_given[k] else found[k]
        if estimate is not None:
            change[name] = estimate.length
        elif counts[k] > 1 and not cups.lengths_given[k]:
            problem = f"covers no fiber along {name[0]} from rim to rim"
            remedy = f"scan the spans, or give grid.{name}_mm in the cups file"
            raise InputError(source, "", problem, remedy)
        used.append(estimate)
    return replace(cups, grid=replace(grid, **change)), (used[0], used[1])


def _box(points: Array) -> str:
    low, high = points.min(axis=0) / MM, points.max(axis=0) / MM
    parts = zip("xyz", low, high, strict=True)
    return ", ".join(f"{axis} {a:.1f}..{b:.1f}" for axis, a, b in parts) + " mm"


def _score(errors: Array) -> Score:
    return Score(rms(errors), float(abs(errors).max(initial=0.0)))


def _worst(error: Field, st: Array) -> Worst:
    values = error(st)
    n = int(np.argmax(abs(values)))
    return Worst(float(st[n, 0]), float(st[n, 1]), float(values[n]))
