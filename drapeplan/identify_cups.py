"""What a scan says about the cups: where the ply they hold really lies (D24).

A cup holds a flat square, so a scan of it shows the cup's height along its normal and
both its tilts, not where it stands in its own plane nor its yaw. What it shows of the
recorded poses is their error; with it the poses are mended.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from drapeplan.compare import Comparison, Place, compare
from drapeplan.cups_file import Cups
from drapeplan.errors import InputError
from drapeplan.scan import Scan
from drapeplan.validate import model_surface

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

EDGE = 2e-3  # [m] of a cup's square left out: recorded poses are off by less
FEWEST = 12  # points of a cup, four for each number
ROUNDS = 3  # of weights that let go of strays
FINEST = 20e-6  # [m] noise of a scan: below it, what no model has looks stray
CUTOFF = 4.0  # [-] standard deviations beyond which a point is one


@dataclass(frozen=True, eq=False)
class SeenCups:
    """Cups as a scan shows them.

    Attributes:
        cups: With heights and tilts of the scan in place of the recorded ones.
        seen: Cups that the scan covers, shape (n,); others are as recorded.
        heights: How far each lies from its record along its normal, shape (n,), in [m].
        tilts: Rotations from the record, about s and about t, shape (n, 2), in [rad].
        height_sigma: Standard deviations of the heights by the scan, shape (n,).
        tilt_sigma: Standard deviations of the tilts, shape (n, 2).
        noise: Standard deviation of the scan's points along the normal, in [m].
        points: Points of the scan that lie near the ply, shape (k, 3), in [m].
        st: Their material coordinates, nearly, shape (k, 2), in [m].
    """

    cups: Cups
    seen: Bools
    heights: Array
    tilts: Array
    height_sigma: Array
    tilt_sigma: Array
    noise: float
    points: Array
    st: Array


def see_cups(recorded: Cups, scan: Scan) -> SeenCups:
    """Mend recorded poses by a scan of the ply that the cups hold.

    Args:
        recorded: The cups.
        scan: The scan, in the frame of the cups.

    Raises:
        InputError: The scan covers fewer than two cups.
    """
    grid = recorded.grid
    found = compare(model_surface(recorded, "cubic"), grid, scan.points)
    cup, local = _on_cups(recorded, found, scan.points)
    planes, sigma, count, noise = _planes(cup, local, grid.n_cups)
    seen = count >= FEWEST
    if seen.sum() < 2:
        problem = f"shows {seen.sum()} of the {grid.n_cups} cups' squares"
        remedy = f"scan the ply over the cups, in their frame, {FEWEST} points a cup"
        raise InputError(scan.source, "", problem, remedy)
    heights = np.where(seen, planes[:, 0], 0.0)
    slopes = np.where(seen[:, None], planes[:, 1:], 0.0)
    tilts = np.arctan(slopes[:, ::-1] * [1.0, -1.0])  # n x (rise along s, along t)
    frames = recorded.rotations
    axes = (frames[:, :, :2] @ tilts[..., None])[..., 0]
    near = found.place < Place.BEYOND
    return SeenCups(
        replace(
            recorded,
            positions=recorded.positions + heights[:, None] * frames[:, :, 2],
            rotations=Rotation.from_rotvec(axes).as_matrix() @ frames,
        ),
        seen,
        heights,
        tilts,
        sigma[:, 0],
        sigma[:, :0:-1],
        noise,
        scan.points[near],
        found.st[near],
    )


def farthest(left: Array) -> float:
    """How far points may be off before they are strays, in [m], from all that are."""
    typical = 1.4826 * np.median(abs(left)) if left.size else 0.0
    return CUTOFF * max(float(typical), FINEST)


def _on_cups(
    cups: Cups, found: Comparison, points: Array
) -> tuple[NDArray[np.int64], Array]:
    """Cup of each point on a cup, and the point in its frame, shape (k, 3)."""
    grid = cups.grid
    on = found.place == Place.ON_CUP
    s, t = grid.place_s(found.st[on, 0]), grid.place_t(found.st[on, 1])
    cup = t.cup * grid.columns + s.cup
    away = points[on] - cups.positions[cup]
    local = np.einsum("kcd,kc->kd", cups.rotations[cup], away)
    inside = abs(local[:, :2]).max(axis=1, initial=0.0) <= grid.half_width - EDGE
    return cup[inside], local[inside]


def _planes(
    cup: NDArray[np.int64], local: Array, n_cups: int
) -> tuple[Array, Array, NDArray[np.int64], float]:
    """Height and slopes along s and t of each cup's points, by least squares.

    Returns:
        Planes, shape (n, 3), their standard deviations, counts of points, and the
        standard deviation of a point.
    """
    rows = np.column_stack([np.ones(len(local)), local[:, :2]])
    kept = np.ones(len(local), dtype=bool)
    for _ in range(ROUNDS):
        count = np.bincount(cup[kept], minlength=n_cups)
        N, right = np.zeros((n_cups, 3, 3)), np.zeros((n_cups, 3))
        np.add.at(N, cup[kept], rows[kept, :, None] * rows[kept, None, :])
        np.add.at(right, cup[kept], rows[kept] * local[kept, 2:])
        N[count < FEWEST] = np.eye(3)
        inverse = np.linalg.inv(N)
        planes = (inverse @ right[..., None])[..., 0]
        left = local[:, 2] - np.vecdot(rows, planes[cup])
        used = kept & (count[cup] >= FEWEST)
        freedom = used.sum() - 3 * (count >= FEWEST).sum()
        noise = np.sqrt((left[used] ** 2).sum() / max(freedom, 1))
        kept = abs(left) <= farthest(left)
    sigma = noise * np.sqrt(np.diagonal(inverse, axis1=1, axis2=2))
    return planes, sigma, count, float(noise)
