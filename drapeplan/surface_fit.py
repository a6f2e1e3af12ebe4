"""A smooth surface through a scan, and the fiber lengths that it shows.

Section 6 of [Nielsen2018] takes L_s and L_t from a NURBS surface fit to the scan, since
cups slide. Here the surface is a height over the plane of the cups: a cubic tensor
spline with a small penalty on its second differences, which carries it over holes, and
weights that let go of stray points.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline
from scipy.sparse import csr_array, diags_array, eye_array, kron
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from ply.grid import CupGrid

Array = NDArray[np.float64]

KNOTS_A_SPAN = 4  # a fiber bows in one or two waves a span; finer knots fit the noise
STIFFNESS = 1e-3  # [-] penalty over data: damps a bow of one span by less than 1e-3
ROUNDS = 4  # of reweighting: strays of 20 mm are gone after two
CUTOFF = 4.685  # [-] standard deviations where Tukey's weight ends
LEAST_SCALE = 3e-4  # [m] of the noise: below it, shapes finer than the knots look stray
MOST_POINTS = 60000  # of a fit: 100 for each coefficient of the largest ply
NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)  # along a fiber


@dataclass(frozen=True, eq=False)
class Frame:
    """Frame of the plane of least squares through the squares that the cups hold.

    Attributes:
        origin: Middle of the cups, shape (3,), in [m].
        axes: Columns x (mean s), y and z (mean normal of the cups), shape (3, 3).
    """

    origin: Array
    axes: Array

    def local(self, points: ArrayLike) -> Array:
        """Points of the world in this frame, shape (..., 3)."""
        return (np.asarray(points, dtype=float) - self.origin) @ self.axes


@dataclass(frozen=True, eq=False)
class Field:
    """A smooth function of two coordinates, fit to scattered values.

    Attributes:
        x_knots: Knots along the first coordinate, full multiplicity at the ends.
        y_knots: Knots along the second.
        coefficients: Of the tensor B-splines, shape (n_x, n_y).
        noise: Standard deviation of the values, robust: what the fit leaves, over the
            share of freedom that it leaves.
    """

    x_knots: Array
    y_knots: Array
    coefficients: Array
    noise: float

    def __call__(self, xy: ArrayLike) -> Array:
        """Values at places of shape (..., 2); beyond the edge, those of the edge."""
        xy = np.asarray(xy, dtype=float)
        rows = _design(self.x_knots, self.y_knots, xy.reshape(-1, 2))
        return (rows @ self.coefficients.ravel()).reshape(xy.shape[:-1])


@dataclass(frozen=True)
class LengthEstimate:
    """Length of the fibers of one family, from a surface fit.

    Attributes:
        length: Median over the fibers, in [m].
        spread: Standard deviation from fiber to fiber, robust, in [m].
        fibers: Number of fibers that the scan covers.
    """

    length: float
    spread: float
    fibers: int


def cup_frame(grid: CupGrid, positions: Array, rotations: Array) -> Frame:
    """Plane of least squares of the cups; tells up from down by their normals.

    Args:
        grid: The cup array.
        positions: Centers of the suction faces, shape (n_cups, 3), in [m].
        rotations: Cup frames, shape (n_cups, 3, 3).

    Returns:
        The frame.
    """
    sides = grid.half_width * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    corners = positions[:, None] + sides @ np.swapaxes(rotations[:, :, :2], 1, 2)
    origin = positions.mean(axis=0)
    z = np.linalg.svd((corners - origin).reshape(-1, 3), full_matrices=False)[2][2]
    z = z * np.copysign(1.0, z @ rotations[:, :, 2].mean(axis=0))
    x = rotations[:, :, 0].mean(axis=0)
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    return Frame(origin, np.column_stack([x, np.cross(z, x), z]))


def plan_knots(grid: CupGrid, positions: Array, frame: Frame) -> tuple[Array, Array]:
    """Inner knots in the plane of the cups: four meshes a span, and one a cup.

    Knots at the edges of the cups are double, since the ply's curvature jumps there.

    Args:
        grid: The cup array.
        positions: Centers of the suction faces, shape (n_cups, 3), in [m].
        frame: Frame of the cups.

    Returns:
        Knots along x and along y, in [m].
    """
    local = frame.local(positions).reshape(grid.rows, grid.columns, 3)
    columns, rows = local[..., 0].mean(axis=0), local[..., 1].mean(axis=1)
    return _cup_knots(columns, grid.half_width), _cup_knots(rows, grid.half_width)


def material_knots(grid: CupGrid) -> tuple[Array, Array]:
    """The same along the material coordinates s and t."""
    count = (grid.columns, grid.rows)
    columns, rows = (grid.pitch * np.arange(n, dtype=np.float64) for n in count)
    return _cup_knots(columns, grid.half_width), _cup_knots(rows, grid.half_width)


def fit_field(
    places: ArrayLike, values: ArrayLike, knots: tuple[Array, Array]
) -> Field:
    """Fit a smooth function to scattered values with noise, holes and strays.

    Args:
        places: Places, shape (n, 2), in [m].
        values: Values, shape (n,), in [m].
        knots: Inner knots along both coordinates, rising, in [m]; the outer ones make
            room for all places.

    Returns:
        The function.
    """
    places, values = np.asarray(places, dtype=float), np.asarray(values, dtype=float)
    stride = -(-len(values) // MOST_POINTS)
    places, values = places[::stride], values[::stride]
    x_knots, y_knots = (_padded(knots[k], places[:, k]) for k in (0, 1))
    shape = (len(x_knots) - 4, len(y_knots) - 4)
    rows = _design(x_knots, y_knots, places)
    penalty = STIFFNESS * len(values) / np.prod(shape) * _roughness(*shape)
    weights = np.ones(len(values))
    for _ in range(ROUNDS):
        weighted = rows.T @ diags_array(weights)
        flat = spsolve((weighted @ rows + penalty).tocsc(), weighted @ values)
        residual = values - rows @ flat
        noise = 1.4826 * float(np.median(abs(residual)))
        ratio = residual / (CUTOFF * max(noise, LEAST_SCALE))
        weights = np.maximum(1 - ratio**2, 0.0) ** 2
    free = max(1 - len(flat) / len(values), 0.25)
    return Field(x_knots, y_knots, flat.reshape(shape), noise / free**0.5)


def fiber_lengths(
    grid: CupGrid,
    positions: Array,
    rotations: Array,
    frame: Frame,
    surface: Field,
    scanned: Array,
) -> tuple[LengthEstimate | None, LengthEstimate | None]:
    """Lengths of the free fibers on a fitted surface, between the rims of the cups.

    Each span counts three fibers: the two along its edges and the one in its middle.
    They run straight in the plan of the cups' plane, and are left out where the scan
    has a hole of half a span.

    Args:
        grid: The cup array.
        positions: Centers of the suction faces, shape (n_cups, 3), in [m].
        rotations: Cup frames, shape (n_cups, 3, 3).
        frame: Frame of the cups.
        surface: Heights over that frame's plane.
        scanned: Points of the scan in that frame, shape (n, 3), in [m].

    Returns:
        The estimates along s and along t; None where no fiber is covered.
    """
    tree, half = cKDTree(scanned[:, :2]), grid.half_width
    found: list[LengthEstimate | None] = []
    for k, pairs in enumerate(np.split(grid.neighbors, [grid.n_s_pairs])):
        along, across = rotations[:, :, k], rotations[:, :, 1 - k]
        lateral = np.array([-half, 0.0, half])[:, None, None] * across
        ends = [
            (positions + sign * half * along + lateral)[:, pairs[:, side]]
            for side, sign in ((0, 1), (1, -1))
        ]
        a, b = (frame.local(end)[..., :2].reshape(-1, 1, 2) for end in ends)
        path = a + (NODES[:, None] + 1) / 2 * (b - a)
        away = tree.query(path)[0].max(axis=-1, initial=0.0)
        covered = away < grid.span / KNOTS_A_SPAN
        if not covered.any():
            found.append(None)
            continue
        lengths = _arc_lengths(surface, a[covered], b[covered], path[covered])
        middle = float(np.median(lengths))
        spread = 1.4826 * float(np.median(abs(lengths - middle)))
        found.append(LengthEstimate(middle, spread, len(lengths)))
    return found[0], found[1]


def _arc_lengths(surface: Field, a: Array, b: Array, path: Array) -> Array:
    """Lengths of paths that are straight in plan, by Gauss quadrature."""
    run = b - a
    step = 1e-3 * run  # central differences, exact to 1e-6 of a cubic's slope
    rise = (surface(path + step / 2) - surface(path - step / 2)) / 1e-3
    return np.sqrt(np.sum(run**2, axis=-1) + rise**2) @ WEIGHTS / 2


def _cup_knots(centers: ArrayLike, half_width: float) -> Array:
    """Both ends of the array, its inner cup edges twice, and three knots a span."""
    centers = np.sort(np.asarray(centers, dtype=float))
    first, last = centers[0] - half_width, centers[-1] + half_width
    low, high = centers[:-1] + half_width, centers[1:] - half_width
    inner = low + np.linspace(0, 1, KNOTS_A_SPAN + 1)[:, None] * (high - low)
    return np.sort(np.concatenate([[first], low, inner.ravel(), high, [last]]))


def _padded(knots: Array, x: Array) -> Array:
    """Knots whose ends have full multiplicity and take in all coordinates."""
    low, high = min(knots[0], x.min()), max(knots[-1], x.max())
    return np.concatenate([[low] * 4, knots[1:-1], [high] * 4])


def _design(x_knots: Array, y_knots: Array, places: Array) -> csr_array:
    """Rows of the tensor B-splines at places, shape (n, n_x n_y)."""
    data, columns = [], []
    for k, knots in enumerate((x_knots, y_knots)):
        x = np.clip(places[:, k], knots[0], knots[-1])
        one = BSpline.design_matrix(x, knots, 3)
        data.append(one.data.reshape(-1, 4))
        columns.append(one.indices.reshape(-1, 4).astype(np.int64))
    n, width = len(places), len(y_knots) - 4
    values = data[0][:, :, None] * data[1][:, None, :]
    index = columns[0][:, :, None] * width + columns[1][:, None, :]
    starts = 16 * np.arange(n + 1)
    shape = (n, (len(x_knots) - 4) * width)
    return csr_array((values.ravel(), index.ravel(), starts), shape=shape)


def _roughness(n_x: int, n_y: int) -> csr_array:
    """Sum of squared second differences along both coordinates and across."""
    x, y = (_differences(n, 2) for n in (n_x, n_y))
    xy = kron(_differences(n_x, 1), _differences(n_y, 1))
    square = (
        xy.T @ xy * 2 + kron(x.T @ x, eye_array(n_y)) + kron(eye_array(n_x), y.T @ y)
    )
    return csr_array(square)


def _differences(n: int, order: int) -> csr_array:
    matrix = csr_array(eye_array(n))
    for _ in range(order):
        matrix = matrix[1:] - matrix[:-1]
    return matrix
