"""Chebyshev nets of cup targets: every two neighbors one pitch apart on the mold.

Rigid ball-ended interlinks and the fibers of the weave both keep their lengths on such
a net alone, so where the cups go is a fishnet, never a grid in x and y.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from drapeplan.errors import InfeasibleError
from drapeplan.geodesic import geodesic_net
from drapeplan.links import (
    Indices,
    Links,
    corner_cosines,
    corner_links,
    measure_links,
    neighbor_pairs,
)
from drapeplan.shear import cell_shear, corner_shear, node_shear
from drapeplan.surfaces import AbstractSurface, Array, Mask, upward_normal

__all__ = [
    "Links",
    "Net",
    "cell_shear",
    "corner_cosines",
    "corner_links",
    "corner_shear",
    "frame_net",
    "least_shear_net",
    "measure_links",
    "nearest_net",
    "neighbor_pairs",
    "node_shear",
]

EXACT = 1e-9  # [m] link error that a net may keep
CLOSE = 1e-12  # [m] link error at which Newton stops: float64 noise at a meter
STILL = 1e-9  # [m] step at which the objective counts as minimal
ITERATIONS = 60  # 4-15 are usual
STRIDE = 0.5  # [-] longest step of a cup over the pitch, so that no cell folds
RIDGE = 1e-12  # [-] share of the diagonal added where links leave no choice, or none


@dataclass(frozen=True)
class Net:
    """Cup targets on a surface, cup (i, j) at index i * columns + j.

    Attributes:
        rows: Number of cups along t.
        columns: Number of cups along s.
        xy: Plan view of the cup centers, shape (n, 2), in [m].
        positions: Cup centers, shape (n, 3), in [m].
        normals: Unit normals of the surface there, upward, shape (n, 3).
        rotations: Cup frames, columns s, t and n = s x t, shape (n, 3, 3).
        residual: Largest error of a link's length, in [m].
        converged: Whether links and objective met their tolerances.
        shear: Largest shear angle of a corner, in [rad].
    """

    rows: int
    columns: int
    xy: Array
    positions: Array
    normals: Array
    rotations: Array
    residual: float
    converged: bool
    shear: float


def least_shear_net(
    surface: AbstractSurface,
    rows: int,
    columns: int,
    pitch: float,
    anchor_xy: tuple[float, float] = (0.0, 0.0),
    anchor_cup: tuple[int, int] | None = None,
    warp: float = 0.0,
) -> Net:
    """Net with the least sum of squared corner cosines.

    Gauss-Newton on the shear under linearized links. The shear left over is small
    where the net exists at all, so the neglected curvature costs a linear rate and no
    more; the links themselves converge quadratically.

    Args:
        surface: Surface to lie on.
        rows: Number of cups along t.
        columns: Number of cups along s.
        pitch: Straight distance between neighbors, in [m].
        anchor_xy: Where the anchor lies, x and y in [m].
        anchor_cup: Row and column of the anchor; None for the mean of all cups.
        warp: Plan-view direction of the sum of all s links, in [rad].

    Returns:
        The net, links exact to 1e-9 m.

    Raises:
        InfeasibleError: No such net was found, or a cup lies off the surface.
    """
    center = rows // 2, columns // 2
    start = _start(surface, rows, columns, pitch, anchor_xy, anchor_cup or center, warp)
    weights, target = _placement(rows, columns, anchor_xy, anchor_cup, warp)
    xy, converged = start[:, :2].copy(), False
    size = xy.size
    for _ in range(ITERATIONS):
        links = measure_links(surface, xy, rows, columns, pitch)
        shear, slope = corner_cosines(links, rows, columns, pitch)
        rows_a = np.vstack([links.jacobian, weights])
        values = np.concatenate([links.error, weights @ xy.ravel() - target])
        scale = pitch**2  # brings the objective to the size of the links
        kkt = np.zeros((size + len(values), size + len(values)))
        kkt[:size, :size] = scale * slope.T @ slope + RIDGE * np.eye(size)
        kkt[size:, :size], kkt[:size, size:] = rows_a, rows_a.T
        right = -np.concatenate([scale * slope.T @ shear, values])
        step = np.linalg.solve(kkt, right)[:size].reshape(-1, 2)
        if np.max(abs(step)) < STILL and np.max(abs(values)) < CLOSE:
            converged = True
            break
        xy = xy + step * _shorten(step, pitch)
    net = frame_net(surface, xy, rows, columns, pitch, converged=converged)
    _require(net, surface)
    return net


def nearest_net(
    surface: AbstractSurface,
    previous_xy: Array,
    rows: int,
    columns: int,
    pitch: float,
    placed: Mask,
    offsets: Array | None = None,
) -> Net:
    """Net nearest to a previous one, with its placed cups pinned.

    Sequential projection: least sum of squared distances in plan view to the previous
    net, under linearized links. Links between two placed cups are left as they are.
    A small move needs small multipliers, so the neglected curvature slows the
    objective only; the links converge quadratically. Never raises: the caller judges
    the residual.

    Args:
        surface: Surface to lie on, the lifted one during a wave.
        previous_xy: Plan view of the previous net, shape (n, 2), in [m].
        rows: Number of cups along t.
        columns: Number of cups along s.
        pitch: Straight distance between neighbors, in [m].
        placed: Cups that must not move, shape (n,).
        offsets: Height of each cup above the surface, shape (n,), in [m].

    Returns:
        The net; its residual counts all links.
    """
    previous_xy = np.asarray(previous_xy, float)
    free = np.flatnonzero(np.repeat(~np.asarray(placed, bool), 2))
    pairs = np.concatenate(neighbor_pairs(rows, columns))
    live = ~np.asarray(placed, bool)[pairs].all(axis=1)
    xy, converged = previous_xy.copy(), len(free) == 0
    for _ in range(ITERATIONS if len(free) else 0):
        links = measure_links(surface, xy, rows, columns, pitch, offsets)
        error, jacobian = links.error[live], links.jacobian[np.ix_(live, free)]
        back = (previous_xy - xy).ravel()[free]
        gram = jacobian @ jacobian.T
        gram[np.diag_indices_from(gram)] *= 1 + RIDGE
        try:
            multipliers = cho_solve(cho_factor(gram), error + jacobian @ back)
        except (LinAlgError, ValueError):  # contradictory links drove it off
            break
        step = np.zeros_like(xy)
        step.ravel()[free] = back - jacobian.T @ multipliers
        if np.max(abs(step)) < STILL and np.max(abs(error), initial=0) < CLOSE:
            converged = True
            break
        xy = xy + step * _shorten(step, pitch)
    return frame_net(surface, xy, rows, columns, pitch, offsets, converged)


def frame_net(
    surface: AbstractSurface,
    xy: Array,
    rows: int,
    columns: int,
    pitch: float,
    offsets: Array | None = None,
    converged: bool = True,
) -> Net:
    """Net with its cup frames, from the plan view of its cups.

    The fiber directions at a cup are the mean of its links, projected on the tangent
    plane; s and t of the frame split their shear symmetrically.

    Args:
        surface: Surface the cups lie on.
        xy: Plan view of the cups, shape (n, 2), in [m].
        rows: Number of cups along t.
        columns: Number of cups along s.
        pitch: Length the links should have, in [m].
        offsets: Height of each cup above the surface, shape (n,), in [m].
        converged: What the solver found.

    Returns:
        The net.
    """
    z, zx, zy = surface.evaluate(xy[:, 0], xy[:, 1])
    positions = np.column_stack([xy, z if offsets is None else z + offsets])
    n = upward_normal(zx, zy)
    along_s, along_t = neighbor_pairs(rows, columns)
    s = _fiber_directions(positions, n, along_s)
    t = _fiber_directions(positions, n, along_t)
    middle = _unit(s + t)
    aside = np.cross(n, middle)
    rotations = np.stack([middle - aside, middle + aside, n], axis=-1)
    rotations[:, :, :2] /= np.sqrt(2)
    pairs = np.concatenate([along_s, along_t])
    length = np.linalg.norm(positions[pairs[:, 1]] - positions[pairs[:, 0]], axis=1)
    residual = float(np.max(abs(length - pitch), initial=0))
    shear = corner_shear(positions.reshape(rows, columns, 3))
    largest = float(np.max(abs(shear), initial=0))
    return Net(rows, columns, xy, positions, n, rotations, residual, converged, largest)


def _fiber_directions(positions: Array, n: Array, pairs: Indices) -> Array:
    """Mean unit chord of the links at each cup, in its tangent plane, shape (n, 3)."""
    i, j = pairs.T
    chords = _unit(positions[j] - positions[i])
    total = np.zeros_like(positions)
    np.add.at(total, i, chords)
    np.add.at(total, j, chords)
    return _unit(total - n * np.sum(total * n, axis=1, keepdims=True))


def _unit(v: Array) -> Array:
    """Vectors scaled to length one, shape (..., 3)."""
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return v / np.where(length > 0, length, 1.0)


def _shorten(step: Array, pitch: float) -> float:
    """Factor that keeps every cup's step within the stride."""
    return min(1.0, STRIDE * pitch / max(float(np.max(abs(step))), 1e-300))


def _start(
    surface: AbstractSurface,
    rows: int,
    columns: int,
    pitch: float,
    anchor_xy: tuple[float, float],
    node: tuple[int, int],
    warp: float,
) -> Array:
    """Geodesic-grown net through the anchor, shape (n, 3), in [m]."""
    net = geodesic_net(surface, rows, columns, pitch, node, anchor_xy, warp, False)
    return net.reshape(-1, 3)


def _placement(
    rows: int,
    columns: int,
    anchor_xy: tuple[float, float],
    anchor_cup: tuple[int, int] | None,
    warp: float,
) -> tuple[Array, Array]:
    """Linear conditions on xy, flattened, that hold the anchor and the warp direction.

    Returns:
        Weights, shape (3, 2 n), and their targets, shape (3,): x and y of the anchor,
        and the sum of the s links across the warp direction.
    """
    n = rows * columns
    weights = np.zeros((3, n, 2))
    if anchor_cup is None:
        weights[0, :, 0] = weights[1, :, 1] = 1 / n
    else:
        cup = anchor_cup[0] * columns + anchor_cup[1]
        weights[0, cup, 0] = weights[1, cup, 1] = 1
    ends = np.arange(n).reshape(rows, columns)[:, [0, -1]]  # inner cups cancel
    across = np.array([-np.sin(warp), np.cos(warp)])
    weights[2, ends[:, 0]], weights[2, ends[:, 1]] = -across / rows, across / rows
    return weights.reshape(3, -1), np.array([*anchor_xy, 0.0])


def _require(net: Net, surface: AbstractSurface) -> None:
    """Raise if the net was not found or a cup lies off the surface."""
    if not net.converged or net.residual > EXACT:
        raise InfeasibleError(
            f"no net of least shear on this mold: {ITERATIONS} steps did not settle it",
            remedy="use a mold with larger radii, or place the ply elsewhere on it",
        )
    off = np.flatnonzero(~surface.inside(net.xy[:, 0], net.xy[:, 1]))
    if len(off):
        i, j = divmod(int(off[0]), net.columns)
        x, y = net.xy[off[0]] * 1e3
        more = f", as would {len(off) - 1} more" if len(off) > 1 else ""
        raise InfeasibleError(
            f"cup ({i}, {j}) would land off the mold, at x = {x:.0f} mm, "
            f"y = {y:.0f} mm, beyond its edge or over a hole{more}",
            remedy="place the ply elsewhere (placement.mold_point_m, warp_deg), or use "
            "a larger mold or a smaller tool",
        )
