"""Distance grid: signed distances to any mesh, also under what overhangs.

A fine grid knows the distances near the surface, exact at its nodes; a coarse one, four
times as wide, the rest. Between nodes both are trilinear: exact beside planes, and
off by at most step^2 / 8 times the sum of the curvatures beside what is round.
"""

import base64
import binascii
import zlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drapeplan.distance_kernels import (
    MISSING,
    band_distances,
    distances,
    gaps,
    gradients,
    seen_heights,
    sweep,
)
from drapeplan.errors import InputError
from drapeplan.mesh import Faces
from drapeplan.orient import outward_normals
from drapeplan.surfaces import Array

BAND = 5  # [-] fine steps on each side of the surface
COARSER = 4  # [-] fine steps in a coarse one
FINER = 4  # [-] lines of sight in a fine step: edges are that sharp
ABOVE = 0.2  # [m] the coarse grid goes on above the mold: no gap counts beyond
FULL = 32767  # [-] quanta in the largest distance of a grid
MOST_NODES = 20_000_000  # a finer grid costs more than any plan gains
DIGITS = 9  # decimals of all lengths in [m]

Quanta = NDArray[np.int16]


@dataclass(frozen=True, eq=False)
class Level:
    """Distances at the nodes of a regular grid.

    Attributes:
        origin: First node, in [m].
        step: Distance between nodes, in [m].
        quantum: What one count stands for, in [m].
        counts: Distances at the nodes, MISSING where unknown, shape (nx, ny, nz).
    """

    origin: tuple[float, float, float]
    step: float
    quantum: float
    counts: Quanta

    def __post_init__(self) -> None:
        """Nobody writes into the counts."""
        self.counts.flags.writeable = False

    @property
    def lattice(self) -> tuple[float, float, float, float, float]:
        """Origin, step and quantum, as kernels take them."""
        return (*self.origin, self.step, self.quantum)

    def to_data(self) -> dict[str, Any]:
        """The level as plain data; counts as differences along z, deflated."""
        shifts = np.diff(self.counts, axis=2, prepend=np.int16(0)).astype("<i2")
        text = base64.b64encode(zlib.compress(shifts.tobytes(), 9)).decode()
        return {
            "origin_m": list(self.origin),
            "step_m": self.step,
            "quantum_m": self.quantum,
            "shape": list(self.counts.shape),
            "deflated_int16": text,
        }

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Self:
        """The level that `to_data` wrote, the same to the last bit.

        Raises:
            InputError: The counts cannot be read.
        """
        nx, ny, nz = (int(n) for n in data["shape"])
        size = 2 * nx * ny * nz
        if min(nx, ny, nz) < 2 or size > 2 * MOST_NODES:
            raise _unreadable(f"has the shape {[nx, ny, nz]}")
        try:
            text = base64.b64decode(data["deflated_int16"], validate=True)
            raw = zlib.decompressobj().decompress(text, size + 1)
        except (binascii.Error, zlib.error) as error:
            raise _unreadable("is damaged") from error
        if len(raw) != size:
            raise _unreadable(f"holds {len(raw)} bytes, not {size}")
        shifts = np.frombuffer(raw, "<i2").reshape(nx, ny, nz)
        counts = np.cumsum(shifts, axis=2, dtype=np.int16)
        x, y, z = (float(v) for v in data["origin_m"])
        return cls((x, y, z), float(data["step_m"]), float(data["quantum_m"]), counts)


@dataclass(frozen=True, eq=False)
class DistanceGrid:
    """Signed distances to a mesh.

    Attributes:
        fine: Distances near the surface.
        coarse: Distances further away.
    """

    fine: Level
    coarse: Level

    @classmethod
    def from_mesh(
        cls, vertices: Array, faces: Faces, step: float, floor: float
    ) -> Self:
        """Measure a mesh once.

        Args:
            vertices: Vertices in the mold frame, shape (v, 3), in [m].
            faces: Triangles that look out of the mold, shape (f, 3), as `oriented`
                leaves them.
            step: Distance between fine nodes, in [m].
            floor: Lowest height at which anybody asks, in [m].

        Returns:
            The grid, its nodes rounded to 1e-5 of the largest distance at most.

        Raises:
            InputError: The grid would be too large.
        """
        corners = np.ascontiguousarray(vertices[faces])
        normals = outward_normals(vertices, faces)
        band = BAND * step
        low = corners.min(axis=(0, 1)) - band
        low[2] = max(low[2], floor - band)
        high = corners.max(axis=(0, 1)) + band
        origin = np.round(low, DIGITS)
        shape = _shape(high - low, step)
        near, _ = band_distances(corners, normals, origin, step, shape, band)
        fine = _level(origin, step, near)
        wide = COARSER * step
        shape = _shape(high - low + np.array([0, 0, ABOVE]), wide)
        far, owner = band_distances(corners, normals, origin, wide, shape, 2 * wide)
        sweep(corners, normals, origin, wide, far, owner)
        return cls(fine, _level(origin, wide, far))

    def distance(self, points: ArrayLike) -> tuple[Array, Array]:
        """Signed distances and their gradients.

        Args:
            points: Points in the mold frame, shape (..., 3), in [m].

        Returns:
            Distances, shape (...), positive outside, in [m], and gradients, shape
            (..., 3).
        """
        points = np.asarray(points, float)
        flat = np.ascontiguousarray(points.reshape(-1, 3))
        slope = gradients(flat, *self._arrays)
        return self.nearest(points), slope.reshape(points.shape)

    def gap(self, points: ArrayLike) -> Array:
        """How far the mold is for a ply that comes from above.

        In open air this is the height over what is seen below, to first order the
        distance, where it is more than the distance: over a channel the ply comes down
        by its height, while the edges beside it stay as near as they are. Below an
        edge, and inside the mold, it is the distance.

        Args:
            points: Points in the mold frame, shape (..., 3), in [m].

        Returns:
            Shape (...), positive outside, in [m].
        """
        points = np.asarray(points, float)
        flat = np.ascontiguousarray(points.reshape(-1, 3))
        out = gaps(flat, self._tops, FINER, *self._arrays)
        return np.asarray(out.reshape(points.shape[:-1]))

    def nearest(self, points: ArrayLike) -> Array:
        """Signed distances alone, shape (...), in [m].

        Args:
            points: Points in the mold frame, shape (..., 3), in [m].
        """
        points = np.asarray(points, float)
        flat = np.ascontiguousarray(points.reshape(-1, 3))
        out = distances(flat, *self._arrays)
        return np.asarray(out.reshape(points.shape[:-1]))

    @cached_property
    def _tops(self) -> NDArray[np.float32]:
        """Heights that are seen from above, FINER times as close as the nodes."""
        seen = seen_heights(self.fine.counts, self.fine.lattice, FINER)
        return np.asarray(seen, np.float32)

    @cached_property
    def _arrays(self) -> tuple[Any, ...]:
        """Arguments of the kernels, points aside."""
        fine, coarse = self.fine, self.coarse
        known = fine.counts != MISSING
        for axis in range(3):  # cells with all eight nodes
            ends = np.moveaxis(known, axis, 0)
            known = np.moveaxis(ends[1:] & ends[:-1], 0, axis)
        cells = np.ascontiguousarray(known)
        return fine.counts, cells, fine.lattice, coarse.counts, coarse.lattice

    def to_data(self) -> dict[str, Any]:
        """The grid as plain data."""
        return {"fine": self.fine.to_data(), "coarse": self.coarse.to_data()}

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Self:
        """The grid that `to_data` wrote, the same to the last bit."""
        return cls(Level.from_data(data["fine"]), Level.from_data(data["coarse"]))


def face_samples(corners: Array, spacing: float) -> tuple[Array, Faces]:
    """Points spread over triangles: middles of equal parts no longer than a spacing.

    Args:
        corners: Triangles, shape (f, 3, 3), in [m].
        spacing: Longest edge of the parts, in [m].

    Returns:
        Points, shape (n, 3), in [m], and the triangle of each, shape (n,).
    """
    edges = np.linalg.norm(np.roll(corners, 1, axis=1) - corners, axis=2)
    parts = np.maximum(np.ceil(edges.max(axis=1) / spacing), 1).astype(int)
    points, owners = [], []
    for count in np.unique(parts):  # few sizes, whatever the number of triangles
        mine = np.flatnonzero(parts == count)
        weights = _part_middles(int(count))
        points.append((weights @ corners[mine]).reshape(-1, 3))
        owners.append(np.repeat(mine, len(weights)))
    return np.concatenate(points), np.concatenate(owners)


def _part_middles(count: int) -> Array:
    """Barycentric middles of the count^2 equal parts of a triangle, (count^2, 3)."""
    i, j = (v.ravel() for v in np.indices((count, count)))
    upright, turned = i + j < count, i + j < count - 1
    first = np.concatenate([i[upright] + 1 / 3, i[turned] + 2 / 3]) / count
    second = np.concatenate([j[upright] + 1 / 3, j[turned] + 2 / 3]) / count
    return np.stack([1 - first - second, first, second], axis=1)


def _shape(size: Array, step: float) -> tuple[int, int, int]:
    """Nodes that cover a box, along x, y and z.

    Raises:
        InputError: If they are too many.
    """
    nx, ny, nz = (int(n) for n in np.ceil(size / step) + 1)
    if nx * ny * nz > MOST_NODES:
        box = " x ".join(f"{v:.2f}" for v in size)
        problem = f"distances every {1e3 * step:g} mm over {box} m are too many"
        raise InputError("mold", "grid_step_mm", problem, "use a coarser step")
    return max(nx, 2), max(ny, 2), max(nz, 2)


def _level(origin: Array, step: float, values: Array) -> Level:
    """Distances as counts; infinite ones are missing."""
    known = np.isfinite(values)
    largest = float(np.abs(values[known]).max(initial=step))
    quantum = float(f"{largest / FULL * (1 + 1e-6):.9g}")
    counts = np.full(values.shape, MISSING, np.int16)
    counts[known] = np.rint(values[known] / quantum).astype(np.int16)
    x, y, z = (float(v) for v in origin)
    return Level((x, y, z), float(step), quantum, counts)


def _unreadable(problem: str) -> InputError:
    return InputError("mold", "distance", f"the grid {problem}", "plan again")
