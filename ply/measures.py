r"""What the closed-form models leave out, estimated before it is modeled.

Each estimate is a length: how far the ply may lie from the shape of independent fibers
because of gravity, shear, or strips that disagree. A caller compares it with its
tolerance and climbs to a dearer model only where it must. Derivations: D7.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ply.errors import PlyError
from ply.fiber import Array, bubble_height, dot, natural_length
from ply.gravity import EARTH, PATCH_SAG, around, cantilever_droop, gravity_sags
from ply.grid import CupGrid
from ply.sampling import PlySampling
from ply.weave import ply_fibers

SHEAR_STIFFNESS = 300.0  # [N/m] in-plane, of woven prepreg: plausible, not measured
CLAMPED_SHEAR = 14.71  # [-] of pi^2 D / L^2: a clamped square buckles in shear
MOST_AMPLIFIED = 0.9  # [-] of that load: past it, linear amplification says nothing
CORNER = 4.0  # [-] droop of a corner over an edge: its cantilever is sqrt(2) longer
UNITS = {"mm": 1e3, "deg": 1.0, "1/m": 1.0}  # of a report, from SI and degrees
MIDDLE = 16  # chords of a patch's middle fiber: its length to 1e-4 of its slack


@dataclass(frozen=True, eq=False)
class Measures:
    """Estimates for each pose of a batch, in [m] but for angles.

    Spans have shape (..., rows, columns - 1) along s and (..., rows - 1, columns) along
    t, patches (..., rows - 1, columns - 1), cups (..., rows, columns).

    Attributes:
        s_surplus: Length that a fiber has beyond what its cups ask for, negative where
            it misses some; of both edges of the span the one further from 0.
        t_surplus: The same along t.
        s_turn: Angle between the fiber directions of both cups, in [rad].
        t_turn: The same along t.
        s_shear: Largest in-plane angle between a cup's s and the chord, in [rad].
        t_shear: The same along t.
        shear: Shear angle of each patch: of its strips' chords or within its strips,
            whichever is larger, in [rad].
        s_sag: Gravity sag in the middle of a span of single strips along s.
        t_sag: The same along t.
        sag: Gravity sag in the middle of each patch.
        droop: Gravity droop of the ply's edge at each cup, were it an outer one.
        corner_droop: The same for a corner.
        shear_effect: What shear may add to the shape of each patch.
        coupling: How far the strips around each patch may be off, since the fiber in
            its middle has another length than they give it.
    """

    s_surplus: Array
    t_surplus: Array
    s_turn: Array
    t_turn: Array
    s_shear: Array
    t_shear: Array
    shear: Array
    s_sag: Array
    t_sag: Array
    sag: Array
    droop: Array
    corner_droop: Array
    shear_effect: Array
    coupling: Array


class Estimate(NamedTuple):
    """One line of a report.

    Attributes:
        name: What is estimated.
        value: Largest value over the ply, in `unit`.
        unit: "mm", "deg" or "1/m".
        source: Formula and where it comes from.
    """

    name: str
    value: float
    unit: str
    source: str


def measures(
    grid: CupGrid,
    positions: Array,
    rotations: Array,
    bending: float,
    areal_mass: float,
    *,
    overhang: float = 0.0,
    shear_stiffness: float = SHEAR_STIFFNESS,
    gravity: ArrayLike = EARTH,
    take_up: float = 0.0,
) -> Measures:
    """Estimate what independent fibers leave out.

    Args:
        grid: The cup array.
        positions: Centers of the suction faces, shape (..., n_cups, 3), in [m].
        rotations: Cup frames, shape (..., n_cups, 3, 3).
        bending: Bending stiffness of the ply, in [N m].
        areal_mass: Mass of the ply, in [kg/m^2].
        overhang: Ply beyond the outer cups, in [m].
        shear_stiffness: In-plane shear stiffness, in [N/m].
        gravity: Acceleration, shape (3,), in [m/s^2].
        take_up: Largest change of fiber length either way, in [m].

    Returns:
        The measures.

    Raises:
        PlyError: A stiffness is not positive, a mass or an overhang is negative, or the
            poses do not fit the grid.
    """
    _check(bending, areal_mass, overhang, shear_stiffness)
    coupling = _coupling(grid, positions, rotations, take_up)
    batch = np.shape(positions)[:-2]
    p = np.reshape(positions, (*batch, grid.rows, grid.columns, 3))
    frames = np.reshape(rotations, (*batch, grid.rows, grid.columns, 3, 3))
    s, t = _family(grid, p, frames, 0), _family(grid, p, frames, 1)
    weight = areal_mass * np.asarray(gravity, dtype=float)
    sags = gravity_sags(grid, rotations, weight, bending)
    turn = around(s.turn, t.turn)
    inside = around(s.shear, t.shear)
    shear = np.maximum(inside, _patch_shear(s.chord, t.chord))
    length = max(grid.s_length, grid.t_length)
    pressure = abs(frames[..., 2] @ weight)
    droop = cantilever_droop(overhang, overhang, pressure, bending)
    return Measures(
        *(s.surplus, t.surplus, s.turn, t.turn, s.shear, t.shear, shear),
        *(*sags, droop, CORNER * droop),
        shear_effect(shear, turn, length, bending, shear_stiffness),
        coupling,
    )


def shear_effect(
    shear: ArrayLike,
    turn: ArrayLike,
    length: float,
    bending: float,
    shear_stiffness: float,
) -> Array:
    """What in-plane shear adds to the height of a curved patch.

    A compressive load amplifies a height h by h x / (1 - x), x the load over the one
    that buckles the flat patch (Timoshenko and Gere); the height is that of an arc over
    the patch's diagonal.

    Args:
        shear: Shear angles, shape (...), in [rad].
        turn: Angles by which the fibers turn over the span, shape (...), in [rad].
        length: Side of the patch, in [m].
        bending: Bending stiffness, in [N m].
        shear_stiffness: In-plane shear stiffness, in [N/m].

    Returns:
        Heights, shape (...), in [m]; those at 0.9 of the buckling load, where it is
        more.
    """
    buckling = CLAMPED_SHEAR * np.pi**2 * bending / length**2
    x = np.minimum(shear_stiffness * np.abs(shear) / buckling, MOST_AMPLIFIED)
    return np.abs(turn) * length / 4 * x / (1 - x)


def estimates(found: Measures, grid: CupGrid) -> list[Estimate]:
    """The largest of each measure over the ply and the batch, to print.

    Args:
        found: The measures.
        grid: The cup array.

    Returns:
        One estimate for each line; those that the array has no place for are left out.
    """
    lengths = (grid.s_length, grid.t_length)
    turns, surpluses = (found.s_turn, found.t_turn), (found.s_surplus, found.t_surplus)
    curvature = [turn / length for turn, length in zip(turns, lengths, strict=True)]
    pairs = list(zip(surpluses, lengths, strict=True))
    bows = [bubble_height(surplus, length) for surplus, length in pairs]
    missing = [np.maximum(-surplus, 0.0) for surplus in surpluses]
    degrees = np.rad2deg(found.shear)
    clamped, chords = "q L^4 / (384 D), D7", "chords of patches, and of strips to cups"
    rows = [
        ("curvature", curvature, "1/m", "turn between neighboring cups over L"),
        ("fiber length missing", missing, "mm", "natural length less L, D2"),
        ("bow of slack", bows, "mm", "(2 / pi) sqrt(L e), D4"),
        ("gravity sag, strips", [found.s_sag, found.t_sag], "mm", clamped),
        ("gravity sag, patches", [found.sag], "mm", f"{PATCH_SAG} {clamped}"),
        ("gravity droop, edge", [found.droop], "mm", "q l^4 / (8 D), D7"),
        ("gravity droop, corner", [found.corner_droop], "mm", "q l^4 / (2 D), D7"),
        ("shear", [degrees], "deg", chords),
        ("shear effect", [found.shear_effect], "mm", "h x / (1 - x), D7"),
        ("coupling of strips", [found.coupling], "mm", "bow of the middle fiber, D7"),
    ]
    lines = []
    for name, arrays, unit, source in rows:
        if any(array.size for array in arrays):
            value = max(float(np.max(array, initial=0.0)) for array in arrays)
            lines.append(Estimate(name, value * UNITS[unit], unit, source))
    return lines


class _Family(NamedTuple):
    """One family of spans."""

    surplus: Array
    turn: Array
    shear: Array
    chord: Array  # unit chords, shape (..., 3)


def _family(grid: CupGrid, p: Array, frames: Array, k: int) -> _Family:
    """Measures of the spans along s (k = 0) or t (k = 1)."""
    axis = -2 + k if k == 0 else -3
    half, length = grid.half_width, (grid.s_length, grid.t_length)[k]
    along, across = frames[..., k], frames[..., 1 - k]

    def ends(array: Array) -> tuple[Array, Array]:
        count = array.shape[axis]
        first, last = np.arange(count - 1), np.arange(1, count)
        return np.take(array, first, axis), np.take(array, last, axis)

    (x0, x1), (y0, y1) = ends(along), ends(across)
    r0, r1 = ends(p)[0] + half * x0, ends(p)[1] - half * x1
    sides = [
        length - natural_length(r0 + d * y0, r1 + d * y1, x0, x1) for d in (-half, half)
    ]
    surplus = np.where(abs(sides[0]) > abs(sides[1]), sides[0], sides[1])
    chord = _unit(r1 - r0)
    turn = np.arctan2(np.linalg.norm(np.cross(x0, x1), axis=-1), dot(x0, x1))
    lateral = np.maximum(abs(dot(chord, y0)), abs(dot(chord, y1)))
    return _Family(surplus, turn, np.arcsin(np.minimum(lateral, 1.0)), chord)


def _patch_shear(s_chord: Array, t_chord: Array) -> Array:
    """Angle by which the mean chords of each patch miss the right one, in [rad]."""
    s = _unit(s_chord[..., :-1, :, :] + s_chord[..., 1:, :, :])
    t = _unit(t_chord[..., :, :-1, :] + t_chord[..., :, 1:, :])
    return abs(np.arcsin(np.clip(dot(s, t), -1.0, 1.0)))


def _coupling(
    grid: CupGrid, positions: Array, rotations: Array, take_up: float
) -> Array:
    """Change of bow that gives a patch's middle fibers their length, shape of patches.

    Of both directions the larger one.
    """
    batch = np.shape(positions)[:-2]
    u = np.linspace(0.0, 1.0, MIDDLE + 1)
    shape = (grid.rows - 1, grid.columns - 1)
    worst = np.zeros((*batch, *shape))
    if not worst.size:
        return worst
    fibers = ply_fibers(grid, positions, rotations, take_up=take_up or None)
    middle, lines = (
        [
            grid.pitch * np.arange(count - 1)[:, None] + grid.half_width + grid.span * v
            for count in (grid.columns, grid.rows)
        ]
        for v in (np.array([0.5]), u)
    )
    for k, length in enumerate((grid.s_length, grid.t_length)):
        places = [(lines if axis == k else middle)[axis].ravel() for axis in (0, 1)]
        points = PlySampling(grid, *places).points(fibers, positions, rotations)
        counts = [len(u) if axis == k else 1 for axis in (0, 1)]
        split = (*batch, shape[0], counts[1], shape[1], counts[0], 3)
        curve = np.swapaxes(points.reshape(split), -4, -3)  # patches, then their points
        curve = curve.reshape(*batch, *shape, len(u), 3)
        worst = np.maximum(worst, _missing_bow(curve, length, take_up))
    return worst


def _missing_bow(curve: Array, length: float, take_up: float) -> Array:
    """Bow of a fiber of given length less that of a curve with the same ends."""
    chord = np.linalg.norm(curve[..., -1, :] - curve[..., 0, :], axis=-1)
    arc = np.linalg.norm(np.diff(curve, axis=-2), axis=-1).sum(axis=-1)
    own = np.clip(arc, length - take_up, length + take_up)
    return abs(bubble_height(own - chord, length) - bubble_height(arc - chord, length))


def _unit(vectors: Array) -> Array:
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(size > 0, size, 1.0)


def _check(
    bending: float, areal_mass: float, overhang: float, shear_stiffness: float
) -> None:
    positive = {"bending": bending, "shear_stiffness": shear_stiffness}
    for name, value in positive.items():
        if not (np.isfinite(value) and value > 0):
            raise PlyError(name, f"{value:g}", "use more than 0")
    for name, value in {"areal_mass": areal_mass, "overhang": overhang}.items():
        if not (np.isfinite(value) and value >= 0):
            raise PlyError(name, f"{value:g}", "use 0 or more")
