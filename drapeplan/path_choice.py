"""Path choice: what a scene leaves open of its path is taken from the mold.

Border cups meet a hollow side toe first, for nothing further out lifts their outer
edge. Where the border lands on a mold that is hollow along one direction alone, the ply
therefore bends wide and low, from inside the rim, and cups lean back more. Fibers pay
for that, as they can on saddles and ridges but not in a bowl; see docs/derivations.md,
D25.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
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
WORDS = {  # keys that may be left open
    "lift_per_m": "lift {} per m",
    "bend_mm": "bend {} mm",
    "rim_offset_mm": "rim offset {} mm",
    "toe_up_deg": "toe-up {} deg",
}
# Lift along the more hollow direction, lift along the other, bend, rim offset, toe-up:
STEEP = np.array([0.6, 0.6, 120.0, 0.0, 2.0])
WIDE = np.array([0.205, 0.475, 325.0, -11.0, 4.44])
FLAT, HOLLOW = 0.05, 0.2  # [1/m] below which nothing is wide; from which all of it is
BOWL = 2.0  # [-] what hollowness along the other direction counts against it
DIGITS = 4  # [-] decimals of what is taken and told


@dataclass(frozen=True)
class PathChoice:
    """What was taken from the mold, and by which of its features.

    Attributes:
        keys: Keys of the path that the scene leaves open.
        hollow_s_per_m: Curvature along s where the border lands, positive if hollow:
            of both ends the more hollow one, [1/m].
        hollow_t_per_m: The same along t.
        wide: Share of the wide path in the one taken, 0 to 1.
    """

    keys: tuple[str, ...]
    hollow_s_per_m: float
    hollow_t_per_m: float
    wide: float

    def block(self) -> dict[str, Any]:
        """The same as plain data, as in `plan_file.PathChoiceBlock`."""
        return {**asdict(self), "keys": list(self.keys)}

    def values(self) -> dict[str, Any]:
        """The open keys' values, as a scene has them."""
        mixed = np.round(STEEP + self.wide * (WIDE - STEEP), DIGITS).tolist()
        along_s = self.hollow_s_per_m >= self.hollow_t_per_m
        lift = tuple(mixed[:2] if along_s else mixed[1::-1])
        every = dict(zip(WORDS, [lift, *mixed[2:]], strict=True))
        return {key: every[key] for key in self.keys}


def opened(scene: Scene, keys: list[str]) -> Scene:
    """A scene with keys of its path left open again.

    Args:
        scene: The scene.
        keys: Those that were left open.
    """
    path = scene.path.model_copy(update=dict.fromkeys(keys))
    return scene.model_copy(update={"path": path})


def chosen_path(
    scene: Scene, mold: HeightGrid, grid: Grid
) -> tuple[Scene, PathChoice | None]:
    """A scene whose path is known in all its keys, and what was chosen for it.

    Args:
        scene: The scene; what it states of its path is kept.
        mold: Its mold.
        grid: The tool's grid.

    Returns:
        The scene itself and None where it leaves nothing open.
    """
    path = scene.path
    if not isinstance(path, RectangleBlendPath):
        return scene, None
    keys = tuple(key for key in WORDS if getattr(path, key) is None)
    if not keys:
        return scene, None
    s, t = hollowness(scene, mold, grid)
    choice = PathChoice(keys, s, t, wideness(s, t))
    filled = path.model_copy(update=choice.values())
    return scene.model_copy(update={"path": filled}), choice


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


def choice_line(told: dict[str, Any], path: dict[str, Any]) -> str:
    """What was taken from the mold and why, in one sentence.

    Args:
        told: The choice as a plan has it.
        path: Path section of the plan's scene.
    """
    values = [
        words.format(" / ".join(f"{x:.3g}" for x in np.atleast_1d(path[key])))
        for key, words in WORDS.items()
        if key in told["keys"]
    ]
    hollow = {along: told[f"hollow_{along}_per_m"] for along in ("s", "t")}
    ways = [
        f"along {along} (radius {1 / depth:.2g} m)"
        for along, depth in hollow.items()
        if depth > FLAT
    ]
    where = "is hollow " + " and ".join(ways) if ways else "is not hollow"
    return f"Path by the mold, whose border {where}: {', '.join(values)}."


def _hollow(points: Array, normals: Array, pitch: float) -> float:
    """Curvature of the outer three cups of each row, (m, n, 3): the more hollow end."""
    if points.shape[1] < 3:
        return 0.0
    bend = np.diff(points, 2, axis=1) / pitch**2
    curvature = np.sum(bend * normals[:, 1:-1], axis=-1)
    return round(float(curvature[:, [0, -1]].mean(axis=0).max()), DIGITS)
