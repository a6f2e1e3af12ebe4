"""Wave: the cup poses that lay the ply, step by step, in the mold frame."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drapeplan.families import HoverPath, RadialPath, RectangleBlendPath, known
from drapeplan.lift import Fronts, RadialLift, RectangleLift, WeightedSum
from drapeplan.mold import HeightGrid
from drapeplan.net import Net, nearest_net
from drapeplan.sequence import Sequence
from drapeplan.surfaces import AbstractSurface, Plane

Array = NDArray[np.float64]
DIGITS = 12  # decimals of tau: the same bytes whatever the last bit of a power is
EXACT = 1e-9  # [m] link error of a net that counts as solved


@dataclass(frozen=True)
class Wave:
    """Requested cup poses along the wave, K poses of n cups, in the mold frame.

    Attributes:
        step: Wave step of each pose, shape (K,); -1 lands the start cup.
        tau: Progress within the step, 0 to 1, shape (K,).
        positions: Centers of the suction faces, shape (K, n, 3), in [m].
        rotations: Columns s, t, n of each cup, shape (K, n, 3, 3).
        placed: Cups on the mold at each pose, shape (K, n).
        landing: Cups on their way down, shape (K, n).
        residual: Largest error of an interlink's length, shape (K,), in [m].
        surface: What the first pose lies on: the mold with its lift.
        height: Height of the first pose above that surface, [m].
        path: The family that made it, with its parameters.
    """

    step: NDArray[np.int_]
    tau: Array
    positions: Array
    rotations: Array
    placed: NDArray[np.bool_]
    landing: NDArray[np.bool_]
    residual: Array
    surface: AbstractSurface
    height: float
    path: RectangleBlendPath | RadialPath | HoverPath


@dataclass(frozen=True)
class Grid:
    """What the nets need to know of the tool: rows, columns, pitch, half width."""

    rows: int
    columns: int
    pitch: float
    half_width: float


def plan_wave(
    mold: HeightGrid,
    targets: Net,
    grid: Grid,
    sequence: Sequence,
    path: RectangleBlendPath | RadialPath | HoverPath,
    warp: float,
) -> Wave:
    """Cup poses of a path family, from the start cup on the mold to the last cup.

    A placed cup is pinned where its own step lands it; the others take the
    Chebyshev net on the moving surface that is nearest to the previous pose.

    Args:
        mold: The mold.
        targets: Least-shear net on the mold.
        grid: The tool's grid.
        sequence: Start cup and steps.
        path: The family with its parameters.
        warp: Direction of s in the mold's xy-plane, [rad].
    """
    if isinstance(path, HoverPath):
        return _hover(mold, targets, grid, sequence, path)
    return _rolled(mold, targets, grid, sequence, path, warp)


def progress(gap: float, last_gap: float, poses: int) -> Array:
    """Values of tau in (0, 1] that end a step, geometric in the remaining gap.

    Args:
        gap: Height that falls to zero in this step, [m].
        last_gap: Height of the last pose before contact, [m].
        poses: Poses of the step, the landed one included.

    Returns:
        Increasing tau, shape (poses,), the last one 1.
    """
    ratio = min(last_gap / max(gap, last_gap), 0.5)
    remaining = ratio ** (np.arange(1, poses) / (poses - 1))
    return np.append(np.round(1 - remaining, DIGITS), 1.0)


def _rolled(
    mold: HeightGrid,
    targets: Net,
    grid: Grid,
    sequence: Sequence,
    path: RectangleBlendPath | RadialPath,
    warp: float,
) -> Wave:
    """The mold with a lift that rolls down, one lift after the other."""
    if isinstance(path, RadialPath):
        lifts = _radial_lifts(targets.xy, sequence, path)
    else:
        rim = max(0.0, grid.half_width + known(path.rim_offset_mm) * 1e-3)
        lifts = _rectangle_lifts(targets.xy, rim, sequence, path, warp)
    log = _Log(grid, targets, sequence)
    lifted = WeightedSum(((1.0, mold), (1.0, lifts[0])))
    log.add(lifted, 0, 0.0)
    for k, (now, after) in enumerate(pairwise(lifts)):
        landing = log.landing(k)
        gap = float(now.evaluate(*log.xy[landing].T)[0].max())
        for tau in progress(gap, path.last_gap_mm * 1e-3, path.poses_per_step):
            surface = WeightedSum(((1.0, mold), (1 - tau, now), (tau, after)))
            log.add(surface, k, float(tau))
    return log.wave(lifted, 0.0, path)


def _rectangle_lifts(
    xy: Array, rim: float, sequence: Sequence, path: RectangleBlendPath, warp: float
) -> list[AbstractSurface]:
    """Lift beyond a rim around each placed rectangle of the target net."""
    center = xy[sequence.index(sequence.start_cup)]
    cos, sin = np.cos(warp), np.sin(warp)
    c, bend = known(path.lift_per_m), known(path.bend_mm) * 1e-3
    curvature = c if isinstance(c, tuple) else (c, c)
    lifts: list[AbstractSurface] = []
    for rectangle in sequence.rectangles:
        placed = xy[[sequence.index(cup) for cup in rectangle.cups()]] - center
        s, t = placed @ [cos, sin], placed @ [-sin, cos]
        reach = np.array([-s.min(), s.max(), -t.min(), t.max()])
        fronts = Fronts(center, warp, reach + rim)
        lifts.append(RectangleLift(fronts, curvature, bend))
    return lifts


def _radial_lifts(
    xy: Array, sequence: Sequence, path: RadialPath
) -> list[AbstractSurface]:
    """Lift beyond the circle that the cups placed by each step reach."""
    center = xy[sequence.index(sequence.start_cup)]
    distance = np.hypot(*(xy - center).T)
    lifts: list[AbstractSurface] = []
    for k in range(len(sequence.steps) + 1):
        reach = float(distance[sequence.placed_after(k)].max())
        front, bend = reach + path.front_offset_mm * 1e-3, path.bend_mm * 1e-3
        lifts.append(RadialLift(center, front, path.lift_per_m, bend))
    return lifts


def _hover(
    mold: HeightGrid,
    targets: Net,
    grid: Grid,
    sequence: Sequence,
    path: HoverPath,
) -> Wave:
    height = path.height_mm * 1e-3
    log = _Log(grid, targets, sequence)
    log.add(mold, -1, 0.0, np.full(len(targets.xy), height))
    for k in range(-1, len(sequence.steps)):
        placed, landing = sequence.placed_after(k), log.landing(k)
        for tau in progress(height, path.last_gap_mm * 1e-3, path.poses_per_step):
            offsets = height * np.where(landing, 1 - tau, ~placed)
            log.add(mold, k, float(tau), offsets)
    return log.wave(mold, height, path)


class _Log:
    """Poses so far, and the net that the next pose starts from."""

    def __init__(self, grid: Grid, targets: Net, sequence: Sequence) -> None:
        self.grid, self.targets, self.sequence = grid, targets, sequence
        self.xy = targets.xy
        self.rows: list[tuple[int, float, Net, Array, Array]] = []

    def landing(self, step: int) -> NDArray[np.bool_]:
        """Cups that a step lands, shape (n,)."""
        after = self.sequence.placed_after(step + 1)
        return after & ~self.sequence.placed_after(step)

    def add(
        self,
        surface: AbstractSurface,
        step: int,
        tau: float,
        offsets: Array | None = None,
    ) -> None:
        """Append the net on a moving surface that is nearest to the previous one."""
        grid = self.grid
        pinned = self.sequence.placed_after(step)
        net = nearest_net(
            surface, self.xy, grid.rows, grid.columns, grid.pitch, pinned, offsets
        )
        if net.converged and net.residual < EXACT:
            self.xy = net.xy
            positions, rotations = net.positions, net.rotations.copy()
            if self.rows:  # the links of a placed cup still turn, the cup does not
                rotations[pinned] = self.rows[-1][4][pinned]
        else:  # no such net: ask for the mold's points, whatever the links say
            positions = surface.point(*self.targets.xy.T)
            if offsets is not None:
                positions = positions + offsets[:, None] * [0.0, 0.0, 1.0]
            rotations = self.targets.rotations
        self.rows.append((step, tau, net, positions, rotations))

    def wave(
        self,
        surface: AbstractSurface,
        height: float,
        path: RectangleBlendPath | RadialPath | HoverPath,
    ) -> Wave:
        """All poses as arrays, with what the first one lies on."""
        step = np.array([row[0] for row in self.rows])
        tau = np.array([row[1] for row in self.rows])
        done = [
            k + 1 if fraction == 1 else k for k, fraction in zip(step, tau, strict=True)
        ]
        return Wave(
            step,
            tau,
            np.stack([row[3] for row in self.rows]),
            np.stack([row[4] for row in self.rows]),
            np.stack([self.sequence.placed_after(k) for k in done]),
            np.stack(
                [
                    self.landing(k) & ~self.sequence.placed_after(d)
                    for k, d in zip(step, done, strict=True)
                ]
            ),
            np.array([row[2].residual for row in self.rows]),
            surface,
            height,
            path,
        )


def shaping(
    grid: Grid,
    flat: tuple[Array, float],
    shape: tuple[AbstractSurface, Array, float],
    fractions: Array,
) -> tuple[Array, Array]:
    """Cup poses from the flat square grid to a shape, nets all the way.

    Args:
        grid: The tool's grid.
        flat: xy of the flat cups, shape (n, 2), and the height of their plane, [m].
        shape: Surface that the ply is shaped to, the xy of its net, shape (n, 2), and
            its height above that surface, [m].
        fractions: Progress from flat, 0, to the shape, 1, shape (m,).

    Returns:
        Positions, shape (m, n, 3), in [m], and rotations, shape (m, n, 3, 3).
    """
    (flat_xy, height), (surface, shape_xy, above) = flat, shape
    free = np.zeros(len(flat_xy), bool)
    nets = []
    for f in fractions:
        blend = WeightedSum(((1 - f, Plane()), (f, surface)))
        near = (1 - f) * flat_xy + f * shape_xy
        lift = np.full(len(near), (1 - f) * height + f * above)
        size = (grid.rows, grid.columns, grid.pitch)
        nets.append(nearest_net(blend, near, *size, free, lift))
    return (
        np.stack([net.positions for net in nets]),
        np.stack([net.rotations for net in nets]),
    )
