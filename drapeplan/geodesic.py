"""Chebyshev nets grown from two geodesics, as the published tables grow them."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from drapeplan.errors import InfeasibleError
from drapeplan.surfaces import AbstractSurface, Array, upward_normal

ITERATIONS = 50  # Newton takes 3-6; more are steps that were shortened
CLOSE = 1e-13  # [-] residual over spacing at which Newton stops: float64 noise
EXACT = 1e-9  # [-] residual over spacing that a node may keep
STRIDE = 0.5  # [-] longest Newton step over spacing: keeps to the outer of two roots
SINGULAR = 1e-9  # [-] singular values below this share of the largest take no step

Residual = Callable[[Array], tuple[Array, Array]]


def geodesic_net(
    surface: AbstractSurface,
    rows: int,
    columns: int,
    spacing: float,
    origin_node: tuple[int, int],
    origin_xy: tuple[float, float],
    heading: float = 0.0,
    within: bool = True,
) -> Array:
    """Net whose row and column through the origin node are orthogonal geodesics.

    A step of a geodesic lies in the plane of the step before and the normal between.
    Each further node lies one spacing from its two neighbors toward the origin: two
    spheres and the surface meet there.

    Args:
        surface: Surface to lie on.
        rows: Number of nodes along t.
        columns: Number of nodes along s.
        spacing: Straight distance between neighbors, in [m].
        origin_node: Row and column of the node where the geodesics cross.
        origin_xy: Where that node lies, x and y in [m].
        heading: Direction of s there, seen from above, from x toward y, in [rad].
        within: Whether a node off the surface is an error.

    Returns:
        Nodes, shape (rows, columns, 3), in [m].

    Raises:
        InfeasibleError: A node does not exist, or it lies off the surface.
    """
    net = np.zeros((rows, columns, 3))
    i0, j0 = origin_node
    start = net[i0, j0] = surface.point(*origin_xy)
    s, t = _tangents(surface, start, heading)
    for direction, nodes in (
        (s, [(i0, j) for j in range(j0, columns)]),
        (t, [(i, j0) for i in range(i0, rows)]),
        (-s, [(i0, j) for j in range(j0, -1, -1)]),
        (-t, [(i, j0) for i in range(i0, -1, -1)]),
    ):
        _grow_geodesic(surface, net, nodes, direction, spacing)
    _fill_quadrants(surface, net, (i0, i0), (j0, j0), spacing)
    if within:
        _require_inside(surface, net)
    return net


def strip_net(
    surface: AbstractSurface,
    rows: int,
    columns: int,
    spacing: float,
    origin_node: tuple[int, int],
    origin_xy: tuple[float, float],
    heading: float = 0.0,
) -> Array:
    """Net grown from two strips of cells whose midlines are geodesics [KinDrape].

    The generator cells between two rows and between two columns have no shear in the
    mean, which for four equal sides means equal diagonals: each is symmetric about its
    midline. The strips cross in the cell from the origin node to the next row and
    column, and its first side runs along t, as KinDrape has it.

    Args:
        surface: Surface to lie on.
        rows: Number of nodes along t.
        columns: Number of nodes along s.
        spacing: Straight distance between neighbors, in [m].
        origin_node: Row and column of the first node of the crossing.
        origin_xy: Where that node lies, x and y in [m].
        heading: Direction of the first side along t less a quarter turn, seen from
            above, from x toward y, in [rad].

    Returns:
        Nodes, shape (rows, columns, 3), in [m].

    Raises:
        InfeasibleError: A node does not exist, or it lies off the surface.
    """
    net = np.zeros((rows, columns, 3))
    i0, j0 = origin_node
    net[i0, j0] = surface.point(*origin_xy)
    across = np.array([np.cos(heading), np.sin(heading), 0.0])
    residual = _sphere_and_plane(net[i0, j0], across, spacing)
    guess = net[i0, j0] + spacing * _tangents(surface, net[i0, j0], heading)[1]
    found, error = _newton(surface, guess[None, None, :2], residual, spacing)
    _require(error, f"net node ({i0 + 1}, {j0})", spacing)
    first = net[i0 + 1, j0] = found[0, 0]
    column = [((i0, j), (i0 + 1, j)) for j in range(columns)]  # edges along t
    row = [((i, j0), (i, j0 + 1)) for i in range(rows)]
    move = np.cross(first - net[i0, j0], surface.normal(*origin_xy))
    _grow_strip(surface, net, column[j0:], move, spacing)
    for edges in (column[j0 + 1 :: -1], row[i0:], row[i0 + 1 :: -1]):
        (a, b), (c, d) = edges[:2]  # two sides of the crossing
        move = (net[c] + net[d] - net[a] - net[b]) / 2
        _grow_strip(surface, net, edges[1:], move, spacing)
    _fill_quadrants(surface, net, (i0, i0 + 1), (j0, j0 + 1), spacing)
    _require_inside(surface, net)
    return net


def _tangents(
    surface: AbstractSurface, point: Array, heading: float
) -> tuple[Array, Array]:
    """Orthonormal tangents s and t, s over the plan-view heading, shapes (3,)."""
    _, zx, zy = surface.evaluate(point[0], point[1])
    s = np.array([np.cos(heading), np.sin(heading), 0.0])
    s[2] = zx * s[0] + zy * s[1]
    s /= np.linalg.norm(s)
    return s, np.cross(upward_normal(zx, zy), s)


def _grow_geodesic(
    surface: AbstractSurface,
    net: Array,
    nodes: list[tuple[int, int]],
    direction: Array,
    spacing: float,
) -> None:
    """Set the nodes after the first along a discrete geodesic in that direction."""
    for last, node in pairwise(nodes):
        p = net[last]
        across = np.cross(surface.normal(p[0], p[1]), direction)
        across /= np.linalg.norm(across)
        residual = _sphere_and_plane(p, across, spacing)
        guess = p + spacing * direction
        found, error = _newton(surface, guess[None, None, :2], residual, spacing)
        _require(error, f"net node {node}", spacing)
        net[node] = found[0, 0]
        direction = (net[node] - p) / spacing


def _grow_strip(
    surface: AbstractSurface,
    net: Array,
    edges: list[tuple[tuple[int, int], tuple[int, int]]],
    move: Array,
    spacing: float,
) -> None:
    """Set the edges after the first so that each cell between two is symmetric."""
    for last, edge in pairwise(edges):
        ends = np.stack([net[last[0]], net[last[1]]])
        residual = _symmetric_cell(ends, spacing)
        found, error = _newton(surface, (ends + move)[None, :, :2], residual, spacing)
        _require(error, f"net node {edge[0]} or {edge[1]}", spacing)
        net[edge[0]], net[edge[1]] = found[0]
        move = np.mean(found[0] - ends, axis=0)


def _fill_quadrants(
    surface: AbstractSurface,
    net: Array,
    i_cross: tuple[int, int],
    j_cross: tuple[int, int],
    spacing: float,
) -> None:
    """Set all nodes beyond the generators, one anti-diagonal of each at a time."""
    rows, columns = net.shape[:2]
    i, j = np.indices((rows, columns)).reshape(2, -1)
    beyond_i, beyond_j = i - np.clip(i, *i_cross), j - np.clip(j, *j_cross)
    corner = (beyond_i != 0) & (beyond_j != 0)
    level = np.where(corner, abs(beyond_i) + abs(beyond_j), 0)
    back_i, back_j = i - np.sign(beyond_i), j - np.sign(beyond_j)
    for step in range(2, int(level.max()) + 1):
        k = np.flatnonzero(level == step)
        a, b = net[back_i[k], j[k]], net[i[k], back_j[k]]
        guess = (a + b - net[back_i[k], back_j[k]])[:, None, :2]
        found, error = _newton(surface, guess, _two_spheres(a, b, spacing), spacing)
        worst = k[np.argmax(~(error <= EXACT))]
        _require(error, f"net node ({i[worst]}, {j[worst]})", spacing)
        net[i[k], j[k]] = found[:, 0]


def _sphere_and_plane(center: Array, across: Array, spacing: float) -> Residual:
    """Residuals of |p - center| = spacing and (p - center) . across = 0."""

    def residual(p: Array) -> tuple[Array, Array]:
        d = p[:, 0] - center
        plane = np.broadcast_to(across / spacing, d.shape)
        value = np.stack([_excess(d, spacing), d @ across / spacing], axis=-1)
        slope = np.stack([2 * d / spacing**2, plane], axis=-2)
        return value, slope[:, :, None]

    return residual


def _two_spheres(a: Array, b: Array, spacing: float) -> Residual:
    """Residuals of |p - a| = |p - b| = spacing."""

    def residual(p: Array) -> tuple[Array, Array]:
        d = p - np.stack([a, b], axis=1)
        return _excess(d, spacing), 2 * d[:, :, None] / spacing**2

    return residual


def _symmetric_cell(ends: Array, spacing: float) -> Residual:
    """Residuals of a cell beyond an edge: three sides of one spacing, equal diagonals.

    Args:
        ends: Ends of the known edge, shape (2, 3), in [m].
        spacing: Length of the sides, in [m].

    Returns:
        Function of the far edge, shape (1, 2, 3).
    """

    def residual(p: Array) -> tuple[Array, Array]:
        sides, diagonals = p - ends, p - ends[::-1]
        edge = p[:, 1] - p[:, 0]
        value = np.empty((1, 4))
        value[:, :2], value[:, 2] = _excess(sides, spacing), _excess(edge, spacing)
        value[:, 3] = np.diff(_excess(diagonals, spacing))[:, 0]
        slope = np.zeros((1, 4, 2, 3))
        slope[:, [0, 1], [0, 1]] = sides
        slope[:, 2] = np.stack([-edge, edge], axis=1)
        slope[:, 3] = diagonals * np.array([[-1], [1]])
        return value, 2 * slope / spacing**2

    return residual


def _excess(d: Array, spacing: float) -> Array:
    """Squared length over squared spacing, less one."""
    return np.sum(d**2, axis=-1) / spacing**2 - 1


def _newton(
    surface: AbstractSurface, xy: Array, residual: Residual, spacing: float
) -> tuple[Array, Array]:
    """Groups of m surface points where 2 m residuals vanish, each by its own Newton.

    Args:
        surface: Surface to lie on.
        xy: Guesses, shape (n, m, 2), in [m].
        residual: Gives the residuals of points of shape (n, m, 3), shape (n, 2 m), and
            their derivatives by the points, shape (n, 2 m, m, 3).
        spacing: Scale of the steps, in [m].

    Returns:
        Points, shape (n, m, 3), in [m], and the worst residual of each group, shape
        (n,), dimensionless.
    """
    n, m, _ = xy.shape
    for _ in range(ITERATIONS):
        z, zx, zy = surface.evaluate(xy[..., 0], xy[..., 1])
        p = np.concatenate([xy, z[..., None]], axis=-1)
        value, slope = residual(p)
        error = abs(value).max(axis=-1)
        if (error <= CLOSE).all():
            break
        uphill = np.stack([zx, zy], axis=-1)[:, None]
        jacobian = (slope[..., :2] + slope[..., 2:] * uphill).reshape(n, 2 * m, 2 * m)
        inverse = np.linalg.pinv(jacobian, rcond=SINGULAR)  # no step where no slope
        step = -(inverse @ value[..., None]).reshape(n, m, 2)
        longest = np.linalg.norm(step, axis=-1).max(axis=-1)
        shorten = np.minimum(1, STRIDE * spacing / np.maximum(longest, 1e-300))
        xy = xy + step * shorten[:, None, None]
    return p, error


def _require(error: Array, node: str, spacing: float) -> None:
    """Raise if a residual is not met, naming the node."""
    if (error <= EXACT).all():
        return
    raise InfeasibleError(
        f"no fishnet on this mold: {node} misses its {spacing * 1e3:.0f} mm to its "
        "neighbors",
        f"{np.max(error) * spacing / 2 * 1e3:.2g} mm",
        "the mold is too steep or too tightly curved for the ply: use larger radii, "
        "or place the ply elsewhere",
    )


def _require_inside(surface: AbstractSurface, net: Array) -> None:
    """Raise for the first node that lies off the surface."""
    off = ~surface.inside(net[..., 0], net[..., 1])
    if off.any():
        i, j = np.argwhere(off)[0]
        x, y = net[i, j, :2] * 1e3
        raise InfeasibleError(
            f"net node ({i}, {j}) lies off the mold, at x = {x:.0f} mm, y = {y:.0f} mm",
            remedy="the ply is larger than the mold there: place it elsewhere",
        )
