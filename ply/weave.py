"""The fibers of the whole ply, from the cup poses [Nielsen2018, Eq. 1-4].

Two fibers run along the edges of each strip, between the facing edges of two cups.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ply.errors import PlyError
from ply.fiber import (
    STRAIGHT,
    Array,
    FiberStatus,
    LengthStatus,
    Statuses,
    band_length,
    cubic_fibers,
    dot,
    natural_length,
    quartic_fibers,
)
from ply.grid import CupGrid

MODELS = ("quartic", "cubic")


@dataclass(frozen=True)
class PlyFibers:
    """The fibers along the edges of the strips, two for each pair of neighbors.

    Arrays of the s family have shape (..., rows, columns - 1, 2), those of the t family
    (..., rows - 1, columns, 2); the last axis is the side, -half_width first.

    Attributes:
        s: Coefficients of u^0 ... u^4 along s, shape (..., 2, 5, 3), in [m].
        t: Coefficients along t, as for s.
        s_status: FiberStatus of each fiber along s.
        t_status: FiberStatus of each fiber along t.
        s_band: LengthStatus along s: the natural length against the take-up.
        t_band: LengthStatus along t.
        s_natural: Lengths that the cups ask for along s, in [m].
        t_natural: Lengths that the cups ask for along t, in [m].
        s_used: Lengths that the curves were given along s, in [m].
        t_used: Lengths that the curves were given along t, in [m].
    """

    s: Array
    t: Array
    s_status: Statuses
    t_status: Statuses
    s_band: Statuses
    t_band: Statuses
    s_natural: Array
    t_natural: Array
    s_used: Array
    t_used: Array


def ply_fibers(
    grid: CupGrid,
    positions: Array,
    rotations: Array,
    *,
    model: str = "quartic",
    take_up: float | None = None,
) -> PlyFibers:
    """Fibers of the ply that cups hold.

    Without a take-up a fiber has the length of the grid, as in the paper. With one, its
    length is the natural length, for which the quartic is the cubic, as far as the band
    allows; a fiber outside the band keeps its cubic and says so: its bubble has a size
    (`bubble_height`) but no shape worth solving for.

    Args:
        grid: The cup array.
        positions: Centers of the suction faces, shape (..., n_cups, 3), in [m].
        rotations: Cup frames, shape (..., n_cups, 3, 3); the columns are the directions
            of s, t and the normal s x t.
        model: "quartic", the paper's, or "cubic", which corrects no length.
        take_up: Largest change of fiber length either way, in [m], or None.

    Returns:
        The fibers, with what became of each.

    Raises:
        PlyError: The model is unknown, the take-up negative, a shape does not fit the
            grid, or a number is not finite.
    """
    _check(grid, positions, rotations, model, take_up)
    batch = np.shape(positions)[:-2]
    p = np.reshape(positions, (*batch, grid.rows, grid.columns, 3))
    frames = np.reshape(rotations, (*batch, grid.rows, grid.columns, 3, 3))
    x, y = frames[..., 0], frames[..., 1]
    half = grid.half_width
    s_ends = (
        _edges(p + half * x, y, half)[..., :, :-1, :, :],
        _edges(p - half * x, y, half)[..., :, 1:, :, :],
        x[..., :, :-1, None, :],
        x[..., :, 1:, None, :],
    )
    t_ends = (
        _edges(p + half * y, x, half)[..., :-1, :, :, :],
        _edges(p - half * y, x, half)[..., 1:, :, :, :],
        y[..., :-1, :, None, :],
        y[..., 1:, :, None, :],
    )
    s = _family(s_ends, grid.s_length, model, take_up)
    t = _family(t_ends, grid.t_length, model, take_up)
    return PlyFibers(
        *(s.coefficients, t.coefficients),
        *(s.status, t.status),
        *(s.band, t.band),
        *(s.natural, t.natural),
        *(s.used, t.used),
    )


class _Family(NamedTuple):
    """One family's part of PlyFibers."""

    coefficients: Array
    status: Statuses
    band: Statuses
    natural: Array
    used: Array


def _edges(middle: Array, across: Array, half_width: float) -> Array:
    """Both ends of a cup's edge, shape (..., 3) to (..., 2, 3)."""
    side = np.array([[-half_width], [half_width]])
    return middle[..., None, :] + side * across[..., None, :]


def _family(
    ends: tuple[Array, Array, Array, Array],
    L: float,
    model: str,
    take_up: float | None,
) -> _Family:
    r0, r1, dr0, dr1 = ends
    natural = natural_length(r0, r1, dr0, dr1)
    used, band = band_length(natural, L, take_up or 0.0)
    if model == "quartic" and take_up is None:
        a, status = quartic_fibers(r0, r1, dr0, dr1, L)
        return _Family(a, status, band, natural, used)
    a = cubic_fibers(r0, r1, dr0, dr1, used)
    over = np.sqrt(dot(r1 - r0, r1 - r0)) > used * (1 + STRAIGHT)
    status = np.where(over, FiberStatus.OVERSTRETCHED, FiberStatus.NOT_ASKED)
    status = np.where(band == LengthStatus.IN_BAND, FiberStatus.MET, status)
    return _Family(a, status, band, natural, used)


def _check(
    grid: CupGrid,
    positions: Array,
    rotations: Array,
    model: str,
    take_up: float | None,
) -> None:
    if model not in MODELS:
        problem = f"there is no model {model!r}"
        raise PlyError("model", problem, f"choose from {', '.join(MODELS)}")
    if take_up is not None and not (np.isfinite(take_up) and take_up >= 0):
        raise PlyError("take_up", f"{take_up:g} m", "use a length of 0 or more")
    arrays: dict[str, tuple[NDArray, tuple[int, ...]]] = {
        "positions": (positions, (grid.n_cups, 3)),
        "rotations": (rotations, (grid.n_cups, 3, 3)),
    }
    for name, (array, tail) in arrays.items():
        if np.shape(array)[-len(tail) :] != tail:
            problem = f"shape {np.shape(array)} does not end in {tail}"
            raise PlyError(name, problem, f"the grid has {grid.n_cups} cups")
        if not np.isfinite(array).all():
            raise PlyError(name, "a number is not finite")
