"""Scans and cups made from finite-element truth, with errors that are known."""

import json
from pathlib import Path

import numpy as np

from drapeplan.compare import Surface
from drapeplan.cups_file import Cups
from drapeplan.scan import Scan
from ply.grid import CupGrid

TRUTH = Path(__file__).parent / "data" / "truth"
MM = 1e-3  # [m]


def truth_cups(case):
    """Cups of a case, and the surface of its ply in [m]."""
    truth = np.load(TRUTH / f"{case}.npz")
    half, length = MM * float(truth["d"]), MM * float(truth["L"])
    grid = CupGrid(int(truth["ny"]), int(truth["nx"]), 2 * half + length, half)
    poses = truth["poses"]
    xyz = MM * np.swapaxes(truth["xyz"], 0, 1)
    surface = Surface(MM * truth["S"], MM * truth["T"], xyz)
    return Cups(grid, MM * poses[:, :3, 3], poses[:, :3, :3].copy()), surface


def make_scan(surface, count=8000, noise=0.0, seed=0, bump=None, hole=None):
    """Scan of a surface: evenly scattered points, each off by Gaussian noise.

    Args:
        surface: The surface.
        count: Number of points before holes.
        noise: Standard deviation along each axis, in [m].
        seed: Seed of places and noise.
        bump: (s, t, height, radius) of a Gaussian bump in z, in [m], or None.
        hole: (s, t, radius) of a disk without points, in [m], or None.
    """
    random = np.random.default_rng(seed)
    low = np.array([surface.s[0], surface.t[0]])
    high = np.array([surface.s[-1], surface.t[-1]])
    st = random.uniform(low, high, (count, 2))
    points = surface.points(st) + random.normal(0, 1, (count, 3)) * noise
    if bump:
        away = np.linalg.norm(st - bump[:2], axis=1)
        points[:, 2] += bump[2] * np.exp(-((away / bump[3]) ** 2) / 2)
    if hole:
        points = points[np.linalg.norm(st - hole[:2], axis=1) > hole[2]]
    return Scan(points, "scan.csv")


def write_cups(path, cups, **grid_keys):
    """Write a cups file; extra keys go into its grid."""
    grid = cups.grid
    entry = {"rows": grid.rows, "columns": grid.columns}
    entry |= {"pitch_mm": round(grid.pitch / MM, 9)}
    entry |= {"half_width_mm": round(grid.half_width / MM, 9), **grid_keys}
    poses = [
        {
            "row": n // grid.columns,
            "column": n % grid.columns,
            "position_mm": np.round(cups.positions[n] / MM, 4).tolist(),
            "rotation": np.round(cups.rotations[n], 8).tolist(),
        }
        for n in range(grid.n_cups)
    ]
    document = {"format": "drapeplan-cups/1", "grid": entry, "cups": poses}
    path.write_text(json.dumps(document, indent=1) + "\n")
    return path


def write_scan(path, scan):
    """Write a scan as CSV."""
    header = "x_mm,y_mm,z_mm"
    np.savetxt(path, scan.points / MM, "%.3f", ",", header=header, comments="")
    return path
