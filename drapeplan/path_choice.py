"""Path choice: what a scene leaves open of its path is taken from the mold.

Border cups meet a hollow side toe first, for nothing further out lifts their outer
edge. Where the border lands on a mold that is hollow along one direction alone, the ply
therefore bends wide and low, from inside the rim, and cups lean back more. Fibers pay
for that, as they can on saddles and ridges but not in a bowl; see docs/derivations.md,
D25. One by one these keys gain nothing: a scene that states one of them has STEEP for
the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drapeplan.errors import InfeasibleError
from drapeplan.families import RectangleBlendPath
from drapeplan.mold import HeightGrid
from drapeplan.net import Net, least_shear_net
from drapeplan.scene import Scene
from drapeplan.wave import Grid

Array = NDArray[np.float64]
WORDS = {  # keys that may be left open, in the order of the values below
    "lift_per_m": "lift {} per m",
    "bend_mm": "bend {} mm",
    "rim_offset_mm": "rim offset {} mm",
    "toe_up_deg": "toe-up {} deg",
}
# Lift along the more hollow direction, that along the other, bend, rim offset, toe-up:
STEEP = np.array([0.6, 0.6, 120.0, 0.0, 2.0])
WIDE = np.array([0.205, 0.21, 325.0, -11.0, 4.44])  # where the other is neither
FLAT, HOLLOW = 0.05, 0.2  # [1/m] below which nothing is wide; from which all of it is
BOWL = 2.0  # [-] what hollowness along the other direction counts against it
DIGITS = 4  # [-] decimals of what is taken and told


@dataclass(frozen=True)
class PathChoice:
    """What of the mold decides, and what is taken.

    Attributes:
        hollow_s_per_m: Curvature along s where the border lands, positive if hollow:
            of both ends the more hollow one, [1/m].
        hollow_t_per_m: The same along t.
        wide: Share of the wide path in what is taken, the rest being STEEP, 0 to 1.
    """

    hollow_s_per_m: float
    hollow_t_per_m: float
    wide: float

    def values(self) -> dict[str, Any]:
        """Values of the keys, as a scene has them."""
        along_s = self.hollow_s_per_m >= self.hollow_t_per_m
        other = self.hollow_t_per_m if along_s else self.hollow_s_per_m
        wide = WIDE.copy()  # what the mold takes along the other, the lift may give
        wide[1] = min(WIDE[1] + max(-other, 0.0) / 2, STEEP[1])
        mixed = STEEP + self.wide * (wide - STEEP)
        first, second, *rest = np.round(mixed, DIGITS).tolist()
        lift = (first, second) if along_s else (second, first)
        return dict(zip(WORDS, [lift, *rest], strict=True))


def chosen_path(
    scene: Scene, mold: HeightGrid, grid: Grid
) -> tuple[Scene, PathChoice | None]:
    """A scene whose path is known in all its keys, and what was chosen for it.

    Args:
        scene: The scene; what it states of its path is kept.
        mold: Its mold.
        grid: The tool's grid.

    Returns:
        The scene itself where it leaves nothing open; None where the mold decides
        nothing: keys are stated, or steps that no rectangle blend lays.
    """
    path, order = scene.path, scene.sequence
    if not isinstance(path, RectangleBlendPath):
        return scene, None
    keys = [key for key in WORDS if getattr(path, key) is None]
    if not keys:
        return scene, None
    choice = None
    if len(keys) == len(WORDS) and (order == "auto" or not order.steps):
        choice = choice_of(scene, mold, grid)
    values = (choice or PathChoice(0.0, 0.0, 0.0)).values()
    filled = path.model_copy(update={key: values[key] for key in keys})
    return scene.model_copy(update={"path": filled}), choice


def choice_of(scene: Scene, mold: HeightGrid, grid: Grid) -> PathChoice:
    """What a mold decides, whatever the scene states of its path.

    Args:
        scene: Gives the placement.
        mold: Its mold.
        grid: The tool's grid.
    """
    s, t = hollowness(scene, mold, grid)
    return PathChoice(s, t, wideness(s, t))


def wideness(s: float, t: float) -> float:
    """Share of the wide path: 0 in bowls and where nothing is hollow, else up to 1.

    Args:
        s: Hollowness of the border along s, [1/m].
        t: Along t.
    """
    alone = max(s, t) - BOWL * max(min(s, t), 0.0)
    share = float(np.clip((alone - FLAT) / (HOLLOW - FLAT), 0.0, 1.0))
    return round(share, DIGITS)


def hollowness(scene: Scene, mold: HeightGrid, grid: Grid) -> tuple[float, float]:
    """Curvature of the mold along s and t where the border lands, [1/m].

    Args:
        scene: Gives the placement.
        mold: Its mold.
        grid: The tool's grid.

    Returns:
        Mean over the border of the more hollow of both ends; 0 where the ply finds no
        place, or too few cups tell.
    """
    try:
        net = landing_net(scene, mold, grid)
    except InfeasibleError:  # said where the targets are asked for
        return 0.0, 0.0
    points = net.positions.reshape(net.rows, net.columns, 3)
    normals = net.normals.reshape(points.shape)
    pairs = (points, normals), (points.swapaxes(0, 1), normals.swapaxes(0, 1))
    s, t = (_hollow(*pair, grid.pitch) for pair in pairs)
    return s, t


def landing_net(scene: Scene, mold: HeightGrid, grid: Grid) -> Net:
    """Least-shear net of a scene.

    Args:
        scene: Gives the placement.
        mold: Its mold.
        grid: The tool's grid.

    Raises:
        InfeasibleError: If there is no such net.
    """
    place = scene.placement
    return least_shear_net(
        mold,
        grid.rows,
        grid.columns,
        grid.pitch,
        place.mold_point_m,
        place.cup,
        float(np.radians(place.warp_deg)),
    )


def choice_line(choice: PathChoice) -> str:
    """What was taken from the mold and why, in one sentence.

    Args:
        choice: The choice.
    """
    hollow = {"s": choice.hollow_s_per_m, "t": choice.hollow_t_per_m}
    ways = [
        f"along {along} (radius {1 / depth:.2g} m)"
        for along, depth in hollow.items()
        if depth > FLAT
    ]
    where = "is hollow " + " and ".join(ways) if ways else "is not hollow"
    values = choice.values()
    told = [
        words.format(" / ".join(f"{x:.3g}" for x in np.atleast_1d(values[key])))
        for key, words in WORDS.items()
    ]
    return f"Path by the mold, whose border {where}: {', '.join(told)}."


def _hollow(points: Array, normals: Array, pitch: float) -> float:
    """Curvature of the outer three cups of each row, (m, n, 3): the more hollow end."""
    if points.shape[1] < 3:
        return 0.0
    bend = np.diff(points, 2, axis=1) / pitch**2
    curvature = np.sum(bend * normals[:, 1:-1], axis=-1)
    return round(float(curvature[:, [0, -1]].mean(axis=0).max()), DIGITS)
