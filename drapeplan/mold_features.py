"""Mold features: what a mold is like where the ply lies, in a few numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drapeplan.net import Net
from drapeplan.shear import cell_shear

Array = NDArray[np.float64]


def mold_features(net: Net, rows: int, columns: int, pitch: float) -> dict[str, float]:
    """Curvature, slope, height and shear of the net that the ply is laid on.

    Args:
        net: Where the cups land.
        rows: Cups along t.
        columns: Cups along s.
        pitch: Between neighbors, in [m].

    Returns:
        Mean, least and largest curvature of the cups' rows (s) and columns (t) in
        [1/m], positive where the mold is hollow; steepest slope and largest shear in
        [deg]; height of the whole in [mm].
    """
    points = net.positions.reshape(rows, columns, 3)
    normals = net.rotations[..., 2].reshape(rows, columns, 3)
    features = {}
    for axis, name in ((1, "s"), (0, "t")):
        bend = np.diff(points, 2, axis=axis) / pitch**2
        inner = np.take(normals, np.arange(1, points.shape[axis] - 1), axis)
        curvature = np.sum(bend * inner, axis=-1)
        for kind in ("mean", "min", "max"):
            value = float(getattr(curvature, kind)()) if curvature.size else 0.0
            features[f"mold.curvature_{name}_{kind}_per_m"] = value
    slope = np.arccos(np.clip(normals[..., 2], -1, 1)).max()
    shear = np.abs(cell_shear(points)).max(initial=0.0)
    return features | {
        "mold.steepest_slope_deg": float(np.degrees(slope)),
        "mold.height_mm": 1e3 * float(np.ptp(points[..., 2])),
        "mold.largest_shear_deg": float(np.degrees(shear)),
    }
