"""Candidates: the few start cups and patterns that make sense on a mold.

A start is the middle, an edge, a corner, or the top or bottom of a hump or hollow. The
straighter a row of cups lies, the more a front that rolls away from it is like that on
a cylinder, so spines and edges go by curvature. On a mold that is its own mirror image,
one of two mirror images is enough. Rings are left to scenes that ask for them: all
sides at once are faster at no more risk, as docs/choosing.md shows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drapeplan.net import Net
from drapeplan.orders import SequenceSection
from drapeplan.scene import Scene
from drapeplan.sequence import Cup, Sequence, make_sequence

Array = NDArray[np.float64]
Along = Literal["s", "t"]

MOST = 10  # [-] candidates that are looked at
SAME = 1e-3  # [m] heights that differ by less are the same to a ply
CURVED = 0.01  # [1/m] curvatures that differ by less are the same; below: straight


@dataclass(frozen=True)
class Candidate:
    """One way to lay the ply.

    Attributes:
        sequence: Start and pattern, in place of the scene's.
        why: What speaks for it, in a few words.
    """

    sequence: SequenceSection
    why: str

    def applied(self, scene: Scene) -> Scene:
        """A scene that is laid in this way; other steps lean as all do."""
        path = scene.path
        if self.sequence != scene.sequence:
            path = path.model_copy(update={"toe_up_steps": ()})
        return scene.model_copy(update={"sequence": self.sequence, "path": path})


@dataclass(frozen=True)
class Relief:
    """What the ply is laid on, as the cups see it.

    Attributes:
        heights: Of the cups in the mold frame, shape (rows, columns), in [m].
        curvatures: Curvature (rms) of each row of cups along s, and of each column
            along t, in [1/m].
    """

    heights: Array
    curvatures: dict[Along, Array]

    @classmethod
    def of(cls, net: Net, pitch: float) -> Relief:
        """Relief under a net.

        Args:
            net: Where the cups land.
            pitch: Between neighbors, in [m].
        """
        points = net.positions.reshape(net.rows, net.columns, 3)
        normals = net.normals.reshape(points.shape)
        curvatures: dict[Along, Array] = {
            "s": _curvatures(points, normals, pitch),
            "t": _curvatures(points.swapaxes(0, 1), normals.swapaxes(0, 1), pitch),
        }
        return cls(points[..., 2], curvatures)

    @property
    def straighter(self) -> Along:
        """Direction of less curvature; the longer one where both are the same."""
        s, t = (self._mean(along) for along in ("s", "t"))
        if abs(s - t) < CURVED:
            return "s" if self.heights.shape[1] > self.heights.shape[0] else "t"
        return "s" if s < t else "t"

    def radius(self, along: Along) -> str:
        """Radius along a direction, in words."""
        mean = self._mean(along)
        return f"radius {1 / mean:.2g} m" if mean >= CURVED else "straight"

    def edge(self, along: Along) -> int:
        """The straighter of the two outer rows (s) or columns (t), by its index."""
        first, last = self.curvatures[along][[0, -1]]
        return 0 if first <= last + CURVED else len(self.curvatures[along]) - 1

    def mirrors(self) -> list[tuple[int, ...]]:
        """Axes along which the mold is its own mirror image, none of them included."""
        every: list[tuple[int, ...]] = [(), (0,), (1,), (0, 1)]
        h = self.heights
        return [axes for axes in every if abs(h - np.flip(h, axes)).max() < SAME]

    def extremes(self) -> Iterator[tuple[Cup, str]]:
        """Top and bottom of the mold, where they do not lie on the tool's border."""
        rows, columns = self.heights.shape
        middle = (rows - 1) / 2, (columns - 1) / 2
        for sign, name in ((1, "highest"), (-1, "lowest")):
            height = sign * self.heights
            near = np.argwhere(height > height.max() - SAME).tolist()
            i, j = min(near, key=lambda cup: math.dist(cup, middle))
            if 0 < i < rows - 1 and 0 < j < columns - 1:
                yield (i, j), f"from the {name} region"

    def _mean(self, along: Along) -> float:
        return float(np.sqrt(np.mean(self.curvatures[along] ** 2)))


def candidates(scene: Scene, net: Net, pitch: float) -> list[Candidate]:
    """Ways to lay the ply of a scene that are worth a look, the usual ones first.

    Args:
        scene: Gives the path family; a way that it names itself is among them.
        net: Where the cups land.
        pitch: Between neighbors, in [m].

    Returns:
        At most MOST, no two of which are the same or mirror images of one another on a
        mold that is its own.
    """
    relief = Relief.of(net, pitch)
    found = list(_distinct(_ways(scene, relief), relief))
    if isinstance(scene.sequence, SequenceSection):
        own = Candidate(scene.sequence, "as the scene has it")
        first = 0 if scene.path.toe_up_steps else MOST - 1  # leans go with one order
        found = [*found[:first], own, *found[first:]]
    return list(_distinct(found, relief))[:MOST]


def _ways(scene: Scene, relief: Relief) -> Iterator[Candidate]:
    """All ways, some of them mirror images."""
    rows, columns = relief.heights.shape
    first = relief.straighter
    other: Along = "s" if first == "t" else "t"
    words = {
        "alternate_sides": "sides in turn",
        "all_sides": "all sides at once",
        f"spine_{first}": f"first along {first} ({relief.radius(first)})",
        f"spine_{other}": f"first along {other} ({relief.radius(other)})",
    }

    def way(start: Cup, pattern: str, why: str) -> Candidate:
        if scene.path.family == "radial":
            pattern, how = "radial", "rings"
        else:
            how = words[pattern]
        section = {"start": start, "pattern": pattern}
        return Candidate(SequenceSection.model_validate(section), f"{why}, {how}")

    i, j = (rows - 1) // 2, (columns - 1) // 2
    side = {"s": relief.edge("s"), "t": relief.edge("t")}
    starts: dict[Along, Cup] = {"s": (side["s"], j), "t": (i, side["t"])}
    opposite: dict[Along, Cup] = {
        "s": (rows - 1 - side["s"], j),
        "t": (i, columns - 1 - side["t"]),
    }
    names: dict[Along, str] = {"s": "short", "t": "long"}
    if columns > rows:
        names = {"s": "long", "t": "short"}
    for pattern in words:
        yield way((i, j), pattern, "from the middle")
    for cup, why in relief.extremes():
        yield way(cup, "alternate_sides", why)
    yield way(starts[first], f"spine_{first}", f"from a {names[first]} edge")
    yield way(starts[other], f"spine_{other}", f"from a {names[other]} edge")
    corner = side["s"], side["t"]
    yield way(corner, f"spine_{first}", "from a corner")
    yield way(corner, "all_sides", "from a corner")
    yield way(starts[first], "alternate_sides", f"from a {names[first]} edge")
    yield way(opposite[first], f"spine_{first}", f"from the other {names[first]} edge")


def _distinct(ways: Iterable[Candidate], relief: Relief) -> Iterator[Candidate]:
    """Ways of which no earlier one is a mirror image."""
    seen: set[tuple[frozenset[Cup], ...]] = set()
    for way in ways:
        rows, columns = relief.heights.shape
        sequence = make_sequence(way.sequence, rows, columns, "scene")
        images = {_image(sequence, axes) for axes in relief.mirrors()}
        if not images & seen:
            yield way
        seen |= images


def _image(sequence: Sequence, axes: tuple[int, ...]) -> tuple[frozenset[Cup], ...]:
    """Cups of each step, mirrored."""
    last = sequence.rows - 1, sequence.columns - 1

    def mirrored(cup: Cup) -> Cup:
        i, j = (last[k] - cup[k] if k in axes else cup[k] for k in (0, 1))
        return i, j

    steps = ((sequence.start_cup,), *sequence.steps)
    return tuple(frozenset(map(mirrored, cups)) for cups in steps)


def _curvatures(points: Array, normals: Array, pitch: float) -> Array:
    """Curvature (rms) of each row of points, shape (rows,), in [1/m]."""
    if points.shape[1] < 3:
        return np.zeros(len(points))
    bend = np.diff(points, 2, axis=1) / pitch**2
    curvature = np.sum(bend * normals[:, 1:-1], axis=-1)
    return np.asarray(np.sqrt(np.mean(curvature**2, axis=1)))
