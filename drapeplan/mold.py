"""The mold as planning asks for it: a spline over a height grid that is filled once."""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self

import numba
import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import spline_filter
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from drapeplan.errors import InputError
from drapeplan.gap_table import GapTable
from drapeplan.mesh import Faces, check_size, look_down, read_mesh
from drapeplan.surfaces import AbstractSurface, Array, Field, Mask

__all__ = ["HeightGrid", "check_size", "read_mesh"]

BORDER = 8  # [-] nodes beyond the mold on each side: room for a cup that overhangs it
RUN_IN = 16  # [-] nodes over which the spline's end condition dies out, 0.27 each
INSET = 1e-6  # [m] outermost rays stay this far within the mesh's outline
ON_NODE = 1e-6  # [-] share of a step within which a point counts as on a node
DIGITS = 9  # decimals of all lengths in [m]: files hold the grid exactly
TABLE_ERROR = 1e-6  # [m] of the heights that gaps are read from
MOST_REFINED = 8  # [-] steps of those for one of the grid
MOST_NODES = 4_000_000  # a finer grid costs more than any plan gains


@dataclass(frozen=True, eq=False)
class HeightGrid(AbstractSurface):
    """Uniform cubic B-spline through heights on a regular grid, C2 everywhere.

    Beyond the grid the spline goes on straight. A coarse mesh is followed facet by
    facet: heights are the mesh's own, and slopes turn over one step at its edges.

    Attributes:
        origin: x and y of the first node, in [m].
        step: Distances between nodes along x and y, in [m].
        heights: Heights of the nodes, shape (nx, ny), in [m]; rounded to nanometers.
        covered: Nodes that lie on the mold, shape (nx, ny).
    """

    origin: tuple[float, float]
    step: tuple[float, float]
    heights: Array
    covered: Mask
    _coefficients: Array = field(init=False, repr=False)
    _lattice: tuple[float, float, float, float] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Round what files hold, and filter the heights to spline coefficients."""
        heights = np.round(self.heights, DIGITS)
        extended = np.pad(heights, RUN_IN, mode="reflect", reflect_type="odd")
        spline = spline_filter(extended, order=3, mode="mirror")
        cut = slice(RUN_IN - 1, 1 - RUN_IN)  # one coefficient beyond the grid each side
        origin = tuple(round(float(v), DIGITS) for v in self.origin)
        step = tuple(round(float(v), DIGITS) for v in self.step)
        values = {
            "origin": origin,
            "step": step,
            "heights": heights,
            "covered": np.array(self.covered, bool),
            "_coefficients": np.ascontiguousarray(spline[cut, cut]),
            "_lattice": (*origin, *step),
        }
        for name, value in values.items():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            object.__setattr__(self, name, value)

    @classmethod
    def from_surface(
        cls, surface: AbstractSurface, half_x: float, half_y: float, step: float = 0.005
    ) -> Self:
        """Sample a surface over a rectangle about the origin.

        Args:
            surface: The surface.
            half_x: Half size of the rectangle along x, in [m].
            half_y: Half size along y, in [m].
            step: Largest distance between nodes, in [m].

        Returns:
            The grid; it covers what lies inside the rectangle and the surface.
        """
        origin, steps, shape = _lattice(
            np.array([-half_x, -half_y]), np.array([half_x, half_y]), step
        )
        x, y, framed = _nodes(origin, steps, shape)
        return cls(origin, steps, surface.height(x, y), framed & surface.inside(x, y))

    @classmethod
    def from_mesh(cls, vertices: Array, faces: Faces, step: float = 0.005) -> Self:
        """Look at a mesh from above; where it is missed the grid goes on smoothly.

        Args:
            vertices: Vertices in the mold frame, shape (v, 3), in [m].
            faces: Vertex indices of the triangles, shape (f, 3).
            step: Largest distance between nodes, in [m].

        Returns:
            The grid; it covers what the rays hit, holes left out.

        Raises:
            InputError: Nothing of the mesh is seen from above.
        """
        outline = vertices[faces.ravel(), :2]
        low, high = outline.min(axis=0) + INSET, outline.max(axis=0) - INSET
        if np.any(high - low < 2 * step):
            raise _unseen("its outline has no width")
        origin, steps, shape = _lattice(low, high, step)
        x, y, framed = _nodes(origin, steps, shape)
        covered, heights = np.zeros(shape, bool), np.zeros(shape)
        heights[framed], covered[framed] = look_down(
            vertices, faces, x[framed], y[framed]
        )
        if not (covered[1:, 1:] & covered[:-1, 1:] & covered[1:, :-1]).any():
            raise _unseen("no face looks up or down")
        return cls(origin, steps, _extend(heights, covered), covered)

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Self:
        """The grid that `to_data` wrote, the same to the last bit."""
        heights = np.array(data["heights_m"], float)
        covered = np.array([[c == "1" for c in row] for row in data["covered"]])
        x, y = data["origin_m"]
        step_x, step_y = data["step_m"]
        return cls((x, y), (step_x, step_y), heights, covered)

    def to_data(self) -> dict[str, Any]:
        """The grid as plain lists, lengths in [m] rounded to nanometers."""
        return {
            "origin_m": list(self.origin),
            "step_m": list(self.step),
            "heights_m": self.heights.tolist(),
            "covered": ["".join("01"[int(c)] for c in row) for row in self.covered],
        }

    @property
    def extent(self) -> tuple[float, float]:
        """Largest |x| and |y| of the mold, in [m]."""
        where = np.argwhere(self.covered)
        ends = np.array([where.min(axis=0), where.max(axis=0)])
        half_x, half_y = abs(np.array(self.origin) + ends * self.step).max(axis=0)
        return float(half_x), float(half_y)

    def inside(self, x: ArrayLike, y: ArrayLike) -> Mask:
        """Whether points lie over the mold: all nodes around them do."""
        u = (np.asarray(x, float) - self.origin[0]) / self.step[0]
        v = (np.asarray(y, float) - self.origin[1]) / self.step[1]
        u, v = np.broadcast_arrays(u, v)
        nx, ny = self.covered.shape
        answer = (u >= 0) & (u <= nx - 1) & (v >= 0) & (v <= ny - 1)
        for end_u in (np.floor(u + ON_NODE), np.ceil(u - ON_NODE)):
            for end_v in (np.floor(v + ON_NODE), np.ceil(v - ON_NODE)):
                i = np.clip(end_u, 0, nx - 1).astype(int)
                j = np.clip(end_v, 0, ny - 1).astype(int)
                answer &= self.covered[i, j]
        return np.asarray(answer)

    def evaluate(self, x: ArrayLike, y: ArrayLike) -> Field:
        """Height and slopes of the spline."""
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        out = _evaluate(self._coefficients, self._lattice, x.ravel(), y.ravel())
        return out[0].reshape(x.shape), out[1].reshape(x.shape), out[2].reshape(x.shape)

    @cached_property
    def table(self) -> GapTable:
        """What gaps are read from: heights and slopes as close as their error asks."""
        table = self._table(1)
        ratio = self._error(table) / TABLE_ERROR
        if ratio <= 1:
            return table
        most = min(MOST_REFINED, math.isqrt(MOST_NODES // self.heights.size))
        finer = math.ceil(ratio ** (1 / 3) + ON_NODE)  # errors fall by its third power
        return self._table(max(1, min(finer, most)))

    def _table(self, refine: int) -> GapTable:
        """Nodes at the steps of the grid, divided by a whole number."""
        nx, ny = ((n - 1) * refine + 1 for n in self.heights.shape)
        step = self.step[0] / refine, self.step[1] / refine
        x = self.origin[0] + step[0] * np.arange(nx)
        y = self.origin[1] + step[1] * np.arange(ny)
        x, y = np.broadcast_arrays(x[:, None], y)
        nodes = np.stack(self.evaluate(x, y), axis=-1)
        return GapTable(self.origin, step, nodes, self.inside(x, y))

    def _error(self, table: GapTable) -> float:
        """Largest error of the table's heights where they err most, in [m]."""
        i, j = np.nonzero(table.covered)
        worst = 0.0
        for a, b in ((0.2, 0.2), (0.2, 0.8), (0.8, 0.2), (0.8, 0.8)):
            x = self.origin[0] + table.step[0] * (i + a)
            y = self.origin[1] + table.step[1] * (j + b)
            points = np.stack([x, y, self.height(x, y)], axis=-1)
            on = np.abs(table.gap(points, beside=0.0))
            worst = max(worst, float(on.max(initial=0.0)))
        return worst

    def gap(self, points: ArrayLike, beside: float | None = None) -> Array:
        """Signed distances to first order, as for any surface, in one pass.

        Args:
            points: Points in the mold frame, shape (..., 3), in [m].
            beside: The answer beside the mold; None goes on with the surface there.

        Returns:
            Distances, shape (...), positive above the mold, in [m].
        """
        return self.table.gap(np.asarray(points, float), beside)

    def opening(self, points: ArrayLike) -> Mask:
        """Whether points lie over an opening: the mold goes on under an edge.

        Args:
            points: Points in the mold frame, shape (..., 3), in [m].

        Returns:
            Shape (...); nowhere, as a height field has no openings.
        """
        return np.zeros(np.shape(points)[:-1], bool)


def _lattice(
    low: Array, high: Array, step: float
) -> tuple[tuple[float, float], tuple[float, float], tuple[int, int]]:
    """Origin, steps and shape of a grid over a box from low to high, and a border."""
    cells = np.maximum(np.ceil((high - low) / step - ON_NODE), 1).astype(int)
    steps = np.round((high - low) / cells, DIGITS)
    origin = np.round(low - BORDER * steps, DIGITS)
    nx, ny = (int(n) for n in cells + 1 + 2 * BORDER)
    if nx * ny > MOST_NODES:
        size = " x ".join(f"{v:.2f}" for v in high - low)
        problem = f"a grid of {step * 1e3:g} mm over {size} m has {nx * ny} nodes"
        raise InputError("mold", "grid_step_mm", problem, "use a coarser step")
    x, y, step_x, step_y = (float(v) for v in (*origin, *steps))
    return (x, y), (step_x, step_y), (nx, ny)


def _nodes(
    origin: tuple[float, float], steps: tuple[float, float], shape: tuple[int, int]
) -> tuple[Array, Array, Mask]:
    """Coordinates of all nodes, and whether the border leaves them, shape (nx, ny)."""
    i, j = np.indices(shape).astype(float)
    framed = np.zeros(shape, bool)
    framed[BORDER:-BORDER, BORDER:-BORDER] = True
    return origin[0] + i * steps[0], origin[1] + j * steps[1], framed


def _unseen(why: str) -> InputError:
    """Failure of a mesh that shows nothing from above."""
    remedy = "turn the mesh so that z points out of the mold"
    return InputError("mold.mesh", "", f"the mesh is no height field: {why}", remedy)


def _extend(heights: Array, covered: Mask) -> Array:
    """Heights with those off the mold filled in, smoothly and straight far away.

    Args:
        heights: Heights of the nodes, shape (nx, ny), in [m].
        covered: Nodes whose heights are known, shape (nx, ny).

    Returns:
        Heights, the known ones unchanged, with the least sum of squared second
        differences along x and y, shape (nx, ny), in [m].
    """
    k = np.arange(heights.size).reshape(heights.shape)
    row, column, value, count = [], [], [], 0
    for nodes in ((k[:-2], k[1:-1], k[2:]), (k[:, :-2], k[:, 1:-1], k[:, 2:])):
        for node, sign in zip(nodes, (1.0, -2.0, 1.0), strict=True):
            row.append(count + np.arange(node.size))
            column.append(node.ravel())
            value.append(np.full(node.size, sign))
        count += nodes[0].size
    entries = np.concatenate(value), (np.concatenate(row), np.concatenate(column))
    bend = coo_array(entries, shape=(count, heights.size)).tocsc()
    known, unknown = np.flatnonzero(covered), np.flatnonzero(~covered)
    stiffness = bend[:, unknown].T @ bend
    load = stiffness[:, known] @ heights.ravel()[known]
    filled = heights.copy()
    filled.ravel()[unknown] = spsolve(stiffness[:, unknown].tocsc(), -load)
    return filled


@numba.njit(cache=True)
def _spline(coefficients, lattice, x, y):  # type: ignore[no-untyped-def]  # numba
    """Height and slopes at one point; straight on beyond the grid."""
    x0, y0, step_x, step_y = lattice
    nx, ny = coefficients.shape[0] - 2, coefficients.shape[1] - 2
    u, v = (x - x0) / step_x, (y - y0) / step_y
    cu, cv = min(max(u, 0.0), nx - 1.0), min(max(v, 0.0), ny - 1.0)
    i, j = min(int(cu), nx - 2), min(int(cv), ny - 2)
    a, b = cu - i, cv - j
    p, q = 1 - a, 1 - b
    bu = (
        p * p * p / 6,
        (4 - 3 * a * a * (1 + p)) / 6,
        (4 - 3 * p * p * (1 + a)) / 6,
        a * a * a / 6,
    )
    du = (-p * p / 2, a * (3 * a - 4) / 2, p * (4 - 3 * p) / 2, a * a / 2)
    bv = (
        q * q * q / 6,
        (4 - 3 * b * b * (1 + q)) / 6,
        (4 - 3 * q * q * (1 + b)) / 6,
        b * b * b / 6,
    )
    dv = (-q * q / 2, b * (3 * b - 4) / 2, q * (4 - 3 * q) / 2, b * b / 2)
    f, fu, fv, fuv = 0.0, 0.0, 0.0, 0.0
    for k in range(4):
        row, slope = 0.0, 0.0
        for m in range(4):
            c = coefficients[i + k, j + m]
            row += bv[m] * c
            slope += dv[m] * c
        f += bu[k] * row
        fu += du[k] * row
        fv += bu[k] * slope
        fuv += du[k] * slope
    over_u, over_v = u - cu, v - cv
    z = f + fu * over_u + fv * over_v + fuv * over_u * over_v
    return z, (fu + fuv * over_v) / step_x, (fv + fuv * over_u) / step_y


@numba.njit(cache=True)
def _evaluate(coefficients, lattice, x, y):  # type: ignore[no-untyped-def]  # numba
    """Height and slopes at points, shape (3, n)."""
    out = np.empty((3, x.size))
    for k in range(x.size):
        out[0, k], out[1, k], out[2, k] = _spline(coefficients, lattice, x[k], y[k])
    return out
