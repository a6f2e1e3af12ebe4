r"""The ply beyond its outer cups: how far gravity bends its free edge down.

Ply beyond an outer cup leaves along the cup's tangent, as every model has it, and
droops like a cantilever from there. In a corner the cantilevers of both edges add up,
and the corner hangs on them: docs/derivations.md, D17.
"""

import numpy as np
from numpy.typing import ArrayLike

from ply.errors import PlyError
from ply.fiber import Array, dot
from ply.gravity import cantilever_droop
from ply.grid import EDGE, AxisPlace, CupGrid

CORNER_TIP = 3.0  # [-] droop of a corner's tip over that of an edge: a plate's, D17


def tip_droop(
    rotations: Array, weight: ArrayLike, stiffness: float, overhang: float
) -> Array:
    """Droop of the ply's edge beyond each cup, were it an outer one.

    Args:
        rotations: Cup frames, shape (..., 3, 3).
        weight: Weight of the ply per area, a vector, shape (3,), in [N/m^2].
        stiffness: Bending stiffness, in [N m].
        overhang: Ply beyond the edges of the outer cups, in [m].

    Returns:
        q l^4 / (8 D) for the part q of the weight along the normal, shape (...), in
        [m]; negative against it. A corner's tip droops CORNER_TIP times as much.
    """
    load = rotations[..., 2] @ np.asarray(weight, dtype=float)
    return cantilever_droop(overhang, overhang, load, stiffness)


def free_edge_droop(
    grid: CupGrid,
    rotations: Array,
    points_st: ArrayLike,
    weight: ArrayLike,
    stiffness: float,
    overhang: float,
    tolerance: float = 0.0,
) -> Array:
    """Displacement of material points by the droop of the free edge, to add to points.

    It keeps the ply smooth: value and slope vanish at the edges of the outer cups and
    of the strips between them.

    Args:
        grid: The cup array.
        rotations: Cup frames, shape (..., n_cups, 3, 3).
        points_st: Material coordinates (s, t), shape (n, 2), in [m].
        weight: Weight of the ply per area, a vector, shape (3,), in [N/m^2].
        stiffness: Bending stiffness, in [N m].
        overhang: Ply beyond the edges of the outer cups, in [m].
        tolerance: A pose whose tips, corners included, droop less gets none, in [m].

    Returns:
        Displacements along the normals of the cups, shape (..., n, 3), in [m]; zero for
        points between and on the cups.

    Raises:
        PlyError: A number is not finite or has the wrong sign, points are not pairs, or
            one lies beyond the overhang.
    """
    points_st, weight = (np.asarray(a, dtype=float) for a in (points_st, weight))
    _check(points_st, weight, stiffness, overhang, tolerance)
    s, t = grid.place_s(points_st[:, 0]), grid.place_t(points_st[:, 1])
    far = [_beyond(place, grid.half_width) for place in (s, t)]
    if np.max(far, initial=0.0) > overhang + EDGE:
        problem = f"{1e3 * np.max(far):g} mm beyond the cups"
        raise PlyError("points_st", problem, f"the overhang is {1e3 * overhang:g} mm")
    out = np.zeros((*np.shape(rotations)[:-3], len(points_st), 3))
    n = np.flatnonzero(s.overhang | t.overhang)
    if not len(n) or overhang == 0:
        return out
    edges = [cantilever_droop(x[n], overhang, 1.0, stiffness) for x in far]
    tip = cantilever_droop(overhang, overhang, 1.0, stiffness)
    both = edges[0] * edges[1] / tip
    shape = edges[0] + edges[1] + (CORNER_TIP - 2) * both
    first = (t.cup * grid.columns + s.cup)[n]
    second = first + (t.in_span * grid.columns + s.in_span)[n]
    u = (s.u + t.u)[n]  # one of them is beyond the cups and zero
    share = (u**2 * (3 - 2 * u))[:, None]
    normals = rotations[..., 2]
    normal = (1 - share) * normals[..., first, :] + share * normals[..., second, :]
    size = np.sqrt(dot(normal, normal))[..., None]
    normal = normal / np.where(size > 0, size, 1.0)
    load = dot(normal, weight)
    asked = largest_droop(grid, rotations, weight, stiffness, overhang) > tolerance
    out[..., n, :] = (asked[..., None] * load * shape)[..., None] * normal
    return out


def _beyond(place: AxisPlace, half_width: float) -> Array:
    """Distances beyond the outer edges of the outer cups, 0 for points within."""
    return np.where(place.overhang, abs(place.y) - half_width, 0.0)


def largest_droop(
    grid: CupGrid,
    rotations: Array,
    weight: ArrayLike,
    stiffness: float,
    overhang: float,
) -> Array:
    """Largest droop of any tip of each pose, corners included.

    Args:
        grid: The cup array.
        rotations: Cup frames, shape (..., n_cups, 3, 3).
        weight: Weight of the ply per area, a vector, shape (3,), in [N/m^2].
        stiffness: Bending stiffness, in [N m].
        overhang: Ply beyond the edges of the outer cups, in [m].

    Returns:
        Droops without a sign, shape (...), in [m].
    """
    droop = abs(tip_droop(rotations, weight, stiffness, overhang))
    droop = droop.reshape(*droop.shape[:-1], grid.rows, grid.columns)
    rim = np.ones((grid.rows, grid.columns))
    rim[1:-1, 1:-1] = 0
    rim[np.ix_([0, -1], [0, -1])] = CORNER_TIP
    return np.asarray((rim * droop).max(axis=(-1, -2)))


def _check(
    points_st: Array,
    weight: Array,
    stiffness: float,
    overhang: float,
    tolerance: float,
) -> None:
    if points_st.ndim != 2 or points_st.shape[1] != 2:
        problem = f"shape {points_st.shape} is not (n, 2)"
        raise PlyError("points_st", problem, "give pairs (s, t)")
    if not (weight.shape == (3,) and np.isfinite(weight).all()):
        raise PlyError("weight", "is not three finite numbers")
    if not (np.isfinite(stiffness) and stiffness > 0):
        raise PlyError("stiffness", f"{stiffness:g} N m", "use more than 0")
    for name, value in {"overhang": overhang, "tolerance": tolerance}.items():
        if not (np.isfinite(value) and value >= 0):
            raise PlyError(name, f"{value:g} m", "use 0 or more")
