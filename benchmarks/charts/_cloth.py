"""The ply as a mesh that other programs can relax, and how far it came out."""

from dataclasses import dataclass

import numpy as np

from benchmarks._truth import MM, Case
from drapeplan.compare import Surface
from ply.fiber import Array
from ply.shape import evaluate, ply_fibers

BENDING = 5e-3  # [N m] as the finite elements have, like the next two
STRETCH, SHEAR = 666e3, 300.0  # [N/m]
THICKNESS = 0.3e-3  # [m]


@dataclass(frozen=True, eq=False)
class Cloth:
    """A rectangular mesh of n = len(s) * len(t) vertices, row by row along t.

    Attributes:
        s: Material lines, shape (n_s,), in [m].
        t: Material lines, shape (n_t,), in [m].
        flat: Vertices of the ply before it is bent, shape (n, 3), in [m].
        start: Vertices where a relaxation begins: cubic fibers, shape (n, 3), in [m].
        held: Vertices that cups hold, at `start` for good, shape (n,).
    """

    s: Array
    t: Array
    flat: Array
    start: Array
    held: np.ndarray

    @property
    def numbers(self) -> np.ndarray:
        """Number of each vertex, shape (n_t, n_s)."""
        return np.arange(len(self.flat)).reshape(len(self.t), len(self.s))

    @property
    def triangles(self) -> np.ndarray:
        """Corners, shape (m, 3); diagonals alternate, so that none is preferred."""
        n = self.numbers
        a, b, c, d = (
            x.ravel() for x in (n[:-1, :-1], n[:-1, 1:], n[1:, :-1], n[1:, 1:])
        )
        i, j = np.indices((len(self.t) - 1, len(self.s) - 1)).reshape(2, -1)
        one = np.stack([a, b, d, a, d, c], axis=-1)
        two = np.stack([a, b, c, b, d, c], axis=-1)
        return np.where(((i + j) % 2 == 0)[:, None], one, two).reshape(-1, 3)

    @property
    def hinges(self) -> np.ndarray:
        """Edges between meshes: two opposite corners and the edge's ends, (m, 4).

        Windings are (first opposite, start, end) and (second opposite, end, start).
        """
        beside: dict[tuple[int, int], list[tuple[int, int, int]]] = {}
        for a, b, c in self.triangles.tolist():
            for i, j, other in ((a, b, c), (b, c, a), (c, a, b)):
                beside.setdefault((min(i, j), max(i, j)), []).append((other, i, j))
        return np.array(
            [
                (first[0], second[0], *first[1:])
                for (i, j), (first, *rest) in beside.items()
                for second in rest
                if (abs(self.flat[i] - self.flat[j]) > 1e-9).sum() == 1  # no diagonals
            ]
        )

    def springs(self) -> tuple[np.ndarray, Array]:
        """Springs along fibers and both diagonals: pairs (m, 2), stiffness, in [N/m].

        They stretch as the ply does along its fibers, and shear as it does.
        """
        n = self.numbers
        ds, dt = np.diff(self.s), np.diff(self.t)
        width_s, width_t = (_widths(lines) for lines in (self.s, self.t))
        along_s = STRETCH * width_t[:, None] / ds
        along_t = STRETCH * width_s / dt[:, None]
        # both diagonals of a rectangle a x b shear it with 2 k a b / (a^2 + b^2)
        a, b = np.meshgrid(ds, dt)
        across = SHEAR * (a**2 + b**2) / (2 * a * b)
        pairs = [
            (n[:, :-1], n[:, 1:], along_s),
            (n[:-1], n[1:], along_t),
            (n[:-1, :-1], n[1:, 1:], across),
            (n[:-1, 1:], n[1:, :-1], across),
        ]
        ends = [np.stack([i.ravel(), j.ravel()], axis=-1) for i, j, _ in pairs]
        return np.concatenate(ends), np.concatenate([k.ravel() for *_, k in pairs])

    def points(self, vertices: Array, case: Case) -> Array:
        """Points of the case, on the spline through the vertices, in [m]."""
        samples = vertices.reshape(len(self.t), len(self.s), 3)
        return Surface(self.s, self.t, samples).points(case.st * MM)


def cloth(case: Case, per_span: int) -> Cloth:
    """Mesh of a case with so many intervals a free span and as fine on the cups."""
    grid = case.grid
    s = _mesh_lines(grid.columns, grid.pitch, grid.half_width, per_span)
    t = _mesh_lines(grid.rows, grid.pitch, grid.half_width, per_span)
    st = np.stack(np.meshgrid(s, t), axis=-1).reshape(-1, 2)
    poses = case.positions, case.rotations
    start = evaluate(grid, ply_fibers(grid, *poses, model="cubic"), *poses, st)
    off = np.abs(st[:, None] - grid.centers).max(axis=-1).min(axis=-1)
    flat = np.column_stack([st, np.zeros(len(st))])
    return Cloth(s, t, flat, start, off < grid.half_width + 1e-9)


def _mesh_lines(cups: int, pitch: float, half: float, per_span: int) -> Array:
    span = pitch - 2 * half
    across = max(2, round(per_span * 2 * half / span))
    lines = [np.linspace(-half, half, across + 1)]
    for k in range(1, cups):
        lines.append(
            np.linspace((k - 1) * pitch + half, k * pitch - half, per_span + 1)
        )
        lines.append(np.linspace(k * pitch - half, k * pitch + half, across + 1))
    return np.unique(np.concatenate(lines).round(12))


def _widths(lines: Array) -> Array:
    """Width of ply that belongs to each line."""
    gaps = np.diff(lines)
    return np.concatenate([[gaps[0] / 2], (gaps[1:] + gaps[:-1]) / 2, [gaps[-1] / 2]])
