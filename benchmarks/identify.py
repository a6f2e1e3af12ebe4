"""Identification: how near it comes to a known ply and tool, and how often it says so.

Simulated measurements: strips over an edge, and scans of a ply held flat and around a
cylinder by cups with rigid interlinks, with the errors of poses, scanner and ruler.
"""

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from drapeplan.cantilever import hanging_strips, load_of_drop
from drapeplan.cups_file import EARTH, Cups
from drapeplan.identify import Identified, identify
from drapeplan.identify_file import Cantilever, Links, Measurements, Overhangs
from drapeplan.noise import YAW
from drapeplan.scan import Scan
from ply.grid import CupGrid
from ply.sag import with_sag
from ply.shape import evaluate, ply_fibers

Array = NDArray[np.float64]

PITCH, HALF_WIDTH = 0.110, 0.020  # [m]
MARGIN = 0.015  # [m] of ply that a scan shows beyond the outer cups' edges
REPEATS, OVERHANG = 5, 0.150  # strips of a direction; [m]
READING = 1e-3  # [m] standard deviation of an overhang and of a drop


@dataclass(frozen=True)
class Truth:
    """What the measurements are made of, in SI units and radians.

    Attributes:
        take_up: Of the weave.
        warp: Bending stiffness along the warp.
        weft: Along the weft.
        areal_mass: Of the ply.
        position: Standard deviation of a cup's coordinates.
        angle: Of its tilts; its yaw has less.
        scan: Of a point of a scan, along each axis.
        density: Points of a scan, in [1/m^2].
    """

    take_up: float = 0.5e-3
    warp: float = 0.022
    weft: float = 0.018
    areal_mass: float = 0.31
    position: float = 0.3e-3
    angle: float = float(np.radians(0.5))
    scan: float = 0.1e-3
    density: float = 40e3

    @property
    def stiffness(self) -> float:
        """Of the scene: the mean of both directions."""
        return float(np.sqrt(self.warp * self.weft))


def flat(grid: CupGrid, gap: float = 0.0) -> Cups:
    """Cups in a plane, their centers nearer to each other than the pitch by a gap."""
    st = grid.centers * (1 - gap / grid.pitch)
    positions = np.column_stack([st, np.zeros(grid.n_cups)])
    return Cups(grid, positions, np.tile(np.eye(3), (grid.n_cups, 1, 1)))


def cylinder(grid: CupGrid, turn: float) -> Cups:
    """Cups around a cylinder, each turned by an angle from the last, a pitch apart."""
    column = np.arange(grid.n_cups) % grid.columns
    angle = turn * (column - (grid.columns - 1) / 2)
    radius = grid.pitch / 2 / np.sin(turn / 2)
    x, z = radius * np.sin(angle), radius * (np.cos(angle) - 1)
    rotations = Rotation.from_euler("y", angle[:, None]).as_matrix()
    return Cups(grid, np.column_stack([x, grid.centers[:, 1], z]), rotations)


def scan_of(cups: Cups, truth: Truth, random: np.random.Generator) -> Scan:
    """A scan of the ply that cups hold, patches, cups and edges included."""
    grid, poses = cups.grid, (cups.positions, cups.rotations)
    fibers = ply_fibers(grid, *poses, model="modal", take_up=truth.take_up)
    down = (0.0, 0.0, -EARTH * truth.areal_mass)
    fibers = with_sag(grid, fibers, cups.rotations, down, truth.stiffness)
    low = grid.centers[0] - grid.half_width - MARGIN
    high = grid.centers[-1] + grid.half_width + MARGIN
    count = int(truth.density * np.prod(high - low))
    st = random.uniform(low, high, (count, 2))
    points = evaluate(grid, fibers, *poses, st)
    return Scan(points + random.normal(0, truth.scan, points.shape), "simulated")


def recorded(cups: Cups, truth: Truth, random: np.random.Generator) -> Cups:
    """Cups as a tool records them, each off by itself."""
    shape = cups.positions.shape
    turns = random.normal(0, truth.angle, shape) * (1.0, 1.0, YAW)
    return replace(
        cups,
        positions=cups.positions + random.normal(0, truth.position, shape),
        rotations=cups.rotations @ Rotation.from_rotvec(turns).as_matrix(),
    )


def overhangs(stiffness: float, truth: Truth, random: np.random.Generator) -> Overhangs:
    """Strips over an edge, ruler and drop misread."""
    table = hanging_strips()
    drop_of = CubicSpline(
        np.append(0, table.load), np.append(0.125, table.drop / table.load)
    )
    length = OVERHANG + random.normal(0, READING, REPEATS)  # as they really hang
    load = EARTH * truth.areal_mass * length**3 / stiffness
    drop = load * drop_of(load) * length + random.normal(0, READING, REPEATS)
    return Overhangs(np.full(REPEATS, OVERHANG), load_of_drop(drop / OVERHANG))


def simulate(
    seed: int,
    truth: Truth | None = None,
    rows: int = 8,
    columns: int = 6,
    turn: float = 0.28,
    links: bool = True,
) -> Measurements:
    """Measurements of a shop, with errors.

    Args:
        seed: Of all errors.
        truth: What they are made of.
        rows: Cups along t.
        columns: Cups along s.
        turn: Angle from cup to cup around the cylinder, in [rad].
        links: Whether the interlinks are known; without, a ply held flat by cups that
            are 1 mm too near takes the place of the cylinder.
    """
    truth, random = truth or Truth(), np.random.default_rng(seed)
    grid = CupGrid(rows, columns, PITCH, HALF_WIDTH)
    shapes = [flat(grid), cylinder(grid, turn) if links else flat(grid, 1e-3)]
    return Measurements(
        Cantilever(
            truth.areal_mass,
            0.0,
            {
                "warp": overhangs(truth.warp, truth, random),
                "weft": overhangs(truth.weft, truth, random),
            },
        ),
        tuple(
            (recorded(cups, truth, random), scan_of(cups, truth, random))
            for cups in shapes
        ),
        Links(PITCH, 0.0, 0.05e-3) if links else None,
    )


def trials(count: int, truth: Truth | None = None, **settings: Any) -> dict[str, Any]:
    """Errors, widths and coverage of intervals of 95 % over simulated measurements.

    Args:
        count: How many.
        truth: What they are made of.
        settings: Of `simulate`.
    """
    truth = truth or Truth()
    start = time.process_time()
    found = [identify(simulate(seed, truth, **settings)) for seed in range(count)]
    seconds = (time.process_time() - start) / count
    return {
        "trials": count,
        "seconds a trial, simulation included": seconds,
        "take-up, mm": _score(found, "take_up", truth.take_up, 1e3),
        "stiffness, N m": _score(found, "stiffness", truth.stiffness, 1.0),
        "position, mm": _score(found, "position", truth.position, 1e3),
        "tilt, deg": _score(found, "angle", truth.angle, np.degrees(1.0)),
    }


def _score(
    found: list[Identified], name: str, truth: float, scale: float
) -> dict[str, float]:
    """How estimates of one quantity did."""
    values = [getattr(one, name) for one in found]
    seen = [v["both"] if isinstance(v, dict) else v for v in values if v is not None]
    errors = np.array([one.value - truth for one in seen])
    return {
        "truth": scale * truth,
        "seen": len(seen),
        "covered": sum(one.low <= truth <= one.high for one in seen),
        "rms error": scale * float(np.sqrt(np.mean(errors**2))),
        "largest error": scale * float(abs(errors).max()),
        "half width": scale * float(np.mean([one.high - one.low for one in seen])) / 2,
    }


def run(quick: bool = False) -> dict[str, Any]:
    """Coverage on a large tool, with and without known interlinks, and a small one."""
    count = 10 if quick else 100
    return {
        "6 x 8 cups, cylinder, interlinks known": trials(count),
        "6 x 8 cups, drawn in flat, no interlinks": trials(count, links=False),
        "5 x 3 cups, cylinder, interlinks known": trials(count, rows=3, columns=5),
    }
