r"""Gap table: heights and slopes of a mold at close nodes, for gaps by the million.

Between four nodes with heights :math:`f_i`, slopes :math:`g_i` and bilinear weights
:math:`w_i` the height is

.. math:: f(x) = \sum_i w_i(x) \, (f_i + g_i \cdot (x - x_i) / 2).

Heights alone err by h^2/8 of the second derivative, tangent planes alone by as much to
the other side: their mean is exact for quadratics and errs by 0.008 h^3 of the third.
The cosine between the normal and z, which turns a height into a distance, is bilinear.
"""

from dataclasses import dataclass, field
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ON_NODE = 1e-6  # [-] share of a step within which a point counts as on a node


@dataclass(frozen=True, eq=False)
class GapTable:
    """Gaps of a height field from nodes on a regular grid.

    Beyond the nodes the surface goes on straight.

    Attributes:
        origin: x and y of the first node, in [m].
        step: Distances between nodes along x and y, in [m].
        nodes: Heights, in [m], and slopes along x and y, shape (nx, ny, 3).
        covered: Nodes that lie on the mold, shape (nx, ny); between them is mold where
            all around are.
    """

    origin: tuple[float, float]
    step: tuple[float, float]
    nodes: Array
    covered: Mask
    kernel: tuple[Any, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Arrange what kernels read: nodes, whole cells, nodes covered, lattice."""
        f, fx, fy = np.moveaxis(self.nodes, -1, 0)
        half_x, half_y = self.step[0] / 2, self.step[1] / 2
        cosine = 1 / np.sqrt(1 + fx * fx + fy * fy)
        nodes = np.stack([f, half_x * fx, half_y * fy, cosine], axis=-1)
        on = np.ascontiguousarray(self.covered)
        cells = on[1:, 1:] & on[:-1, 1:] & on[1:, :-1] & on[:-1, :-1]
        lattice = (*self.origin, 1 / self.step[0], 1 / self.step[1])
        object.__setattr__(self, "kernel", (nodes, cells, on, lattice))

    def gap(self, points: Array, beside: float | None = None) -> Array:
        """Signed distances to first order, as of any surface.

        Args:
            points: Points in the mold frame, shape (..., 3), in [m].
            beside: The answer beside the mold; None goes on with the surface there.

        Returns:
            Distances, shape (...), positive above the mold, in [m].
        """
        flat = np.ascontiguousarray(points).reshape(-1, 3)
        answer = np.nan if beside is None else beside  # never given: nothing is beside
        out = _gaps(flat, *self.kernel, beside is None, answer)
        return np.asarray(out.reshape(points.shape[:-1]))


@numba.njit(cache=True, error_model="numpy", inline="always")
def gap_at(x, y, z, nodes, cells, covered, lattice, everywhere, beside):  # type: ignore[no-untyped-def]  # numba
    """Gap of one point; `beside` off the mold, unless asked for everywhere."""
    u, v = (x - lattice[0]) * lattice[2], (y - lattice[1]) * lattice[3]
    first_u = min(max(np.floor(u), 0.0), nodes.shape[0] - 2.0)
    first_v = min(max(np.floor(v), 0.0), nodes.shape[1] - 2.0)
    i, j = np.uintp(first_u), np.uintp(first_v)  # unsigned: no test for wrapping around
    a, b = u - first_u, v - first_v
    p, q = 1 - a, 1 - b
    within = a >= 0 and p >= 0 and b >= 0 and q >= 0
    if not (within and (everywhere or cells[i, j])):
        if not (everywhere or _covers(u, v, covered)):
            return beside
        if not within:
            return _beyond(u, v, z, nodes)
    k, m = i + np.uintp(1), j + np.uintp(1)
    f0, f1, f2, f3 = nodes[i, j, 0], nodes[i, j, 1], nodes[i, j, 2], nodes[i, j, 3]
    g0, g1, g2, g3 = nodes[i, m, 0], nodes[i, m, 1], nodes[i, m, 2], nodes[i, m, 3]
    near = q * (f0 + f1 * a + f2 * b) + b * (g0 + g1 * a - g2 * q)
    near_cosine = q * f3 + b * g3
    f0, f1, f2, f3 = nodes[k, j, 0], nodes[k, j, 1], nodes[k, j, 2], nodes[k, j, 3]
    g0, g1, g2, g3 = nodes[k, m, 0], nodes[k, m, 1], nodes[k, m, 2], nodes[k, m, 3]
    far = q * (f0 - f1 * p + f2 * b) + b * (g0 - g1 * p - g2 * q)
    height = p * near + a * far
    return (z - height) * (p * near_cosine + a * (q * f3 + b * g3))


@numba.njit(cache=True, error_model="numpy")
def _beyond(u, v, z, nodes):  # type: ignore[no-untyped-def]  # numba
    """Gap beyond the nodes, where the surface of the rim goes on straight."""
    cu, cv = (
        min(max(u, 0.0), nodes.shape[0] - 1.0),
        min(max(v, 0.0), nodes.shape[1] - 1.0),
    )
    i, j = min(int(cu), nodes.shape[0] - 2), min(int(cv), nodes.shape[1] - 2)
    a, b = cu - i, cv - j
    height, slope_u, slope_v, cosine = 0.0, 0.0, 0.0, 0.0
    for k in range(2):
        for m in range(2):
            w = (a if k else 1 - a) * (b if m else 1 - b)
            f = nodes[i + k, j + m]
            height += w * (f[0] + f[1] * (a - k) + f[2] * (b - m))
            slope_u += 2 * w * f[1]
            slope_v += 2 * w * f[2]
            cosine += w * f[3]
    return (z - height - slope_u * (u - cu) - slope_v * (v - cv)) * cosine


@numba.njit(cache=True, error_model="numpy")
def _covers(u, v, covered):  # type: ignore[no-untyped-def]  # numba
    """Whether all nodes around a place lie on the mold; u and v count steps."""
    nx, ny = covered.shape
    if not (0 <= u <= nx - 1 and 0 <= v <= ny - 1):
        return False
    i, k = min(int(u + ON_NODE), nx - 1), max(int(np.ceil(u - ON_NODE)), 0)
    j, m = min(int(v + ON_NODE), ny - 1), max(int(np.ceil(v - ON_NODE)), 0)
    return covered[i, j] and covered[i, m] and covered[k, j] and covered[k, m]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _gaps(points, nodes, cells, covered, lattice, everywhere, beside):  # type: ignore[no-untyped-def]  # numba
    """Gaps of points of shape (n, 3), shape (n,)."""
    out = np.empty(len(points))
    for k in range(len(points)):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        out[k] = gap_at(x, y, z, nodes, cells, covered, lattice, everywhere, beside)
    return out
