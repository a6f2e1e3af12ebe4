"""The fibers of the whole ply, from the cup poses [Nielsen2018, Eq. 1-4].

Two fibers run along the edges of each strip, between the facing edges of two cups; a
third one in the middle, where a model asks for it, lets the strip twist.
"""

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
from ply.modal import modal_fibers

MODELS = ("quartic", "cubic", "modal")
MODES = 3  # [-] bending modes of "modal": a fourth moves planar fibers by < 0.05 mm
MOST_MODES = 8  # [-] powers of u beyond lose digits
ORTHONORMAL = 1e-3  # [-] of R'R: rotations as files print them stay below
MEET = 1e-3  # [-] chord over length below which facing edges coincide


class Sides(NamedTuple):
    """Side to which each strip bulges: 1 along the cup normals, -1 against, 0 open.

    Attributes:
        s: Sides of the strips along s, shape (..., rows, columns - 1).
        t: Sides of the strips along t, shape (..., rows - 1, columns).
    """

    s: Statuses
    t: Statuses


@dataclass(frozen=True)
class PlyFibers:
    """The fibers of the strips, count of them (two or three) for each pair of cups.

    Arrays of the s family have shape (..., rows, columns - 1, count), those of the t
    family (..., rows - 1, columns, count); the last axis leads across the strip, from
    -half_width to +half_width.

    Attributes:
        s: Coefficients of u^0, u^1, ... along s, shape (..., count, K, 3), in [m]; K is
            5 for the cubic and the quartic, 7 for three modes.
        t: Coefficients along t, as for s.
        s_status: FiberStatus of each fiber along s.
        t_status: FiberStatus of each fiber along t.
        s_band: LengthStatus along s: the natural length against the take-up.
        t_band: LengthStatus along t.
        s_natural: Lengths that the cups ask for along s, in [m].
        t_natural: Lengths that the cups ask for along t, in [m].
        s_used: Lengths that the curves were given along s, in [m].
        t_used: Lengths that the curves were given along t, in [m].
        s_side: Side of each bulge along s: 1 along the cup normals, -1 against them, 0
            for none; all 0 but for the modal model.
        t_side: Sides along t.
        s_excess: The number behind each status along s. MET and the like: the length
            that the cups ask for beyond that of the fiber, in [m]; OVERSTRETCHED: that
            of the chord, in [m]; COINCIDENT: the chord, in [m]; INVERTED: the least
            cosine between normals, or tangents and chord; SKEWED: largest error of R'R.
        t_excess: The numbers along t.
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
    s_side: Statuses
    t_side: Statuses
    s_excess: Array
    t_excess: Array

    @property
    def sides(self) -> Sides:
        """Sides of the strips: hand them to the next pose of a trajectory."""
        return Sides(
            np.sign(self.s_side.sum(axis=-1)), np.sign(self.t_side.sum(axis=-1))
        )

    def pose(self, *index: int) -> "PlyFibers":
        """The fibers of one pose of a batch, by its place on the batch axes."""
        arrays = {one.name: getattr(self, one.name)[index] for one in fields(self)}
        return PlyFibers(**arrays)


def ply_fibers(
    grid: CupGrid,
    positions: Array,
    rotations: Array,
    *,
    model: str = "quartic",
    take_up: float | None = None,
    across: int | None = None,
    modes: int = MODES,
    sides: tuple[ArrayLike, ArrayLike] | None = None,
    gravity: ArrayLike | None = None,
    stiffness: float | None = None,
    softness: float = 0.0,
) -> PlyFibers:
    """Fibers of the ply that cups hold.

    Without a take-up a fiber has the length of the grid, as in the paper. With one, its
    length is the natural length, for which every model is the cubic, as far as the band
    allows. A quartic outside the band keeps its cubic and says so: its bubble has a
    size (`bubble_height`) but no shape worth solving for. A modal fiber there has the
    nearest length of the band.

    Args:
        grid: The cup array.
        positions: Centers of the suction faces, shape (..., n_cups, 3), in [m].
        rotations: Cup frames, shape (..., n_cups, 3, 3); the columns are the directions
            of s, t and the normal s x t.
        model: "quartic", the paper's; "cubic", which corrects no length; or "modal".
        take_up: Largest change of fiber length either way, in [m], or None.
        across: Fibers of a strip, 2 or 3; by default 3 for "modal", else 2.
        modes: Bending modes of "modal".
        sides: Sides of the strips along s and along t for "modal", as in `Sides`; None
            leaves all of them to the cups.
        gravity: Weight of the ply per area, a vector, shape (3,), in [N/m^2], for
            "modal".
        stiffness: Bending stiffness, in [N m]; gravity and softness ask for it.
        softness: Strain of a fiber per axial force and width, in [m/N], for "modal".

    Returns:
        The fibers, with what became of each.

    Raises:
        PlyError: The model is unknown, a number negative or missing, a shape does not
            fit the grid, or a number is not finite.
    """
    _check(grid, positions, rotations, model, take_up)
    _check_modal(grid, across, modes, sides)
    load, slope = _loads(gravity, stiffness, softness)
    batch = np.shape(positions)[:-2]
    p = np.reshape(positions, (*batch, grid.rows, grid.columns, 3))
    frames = np.reshape(rotations, (*batch, grid.rows, grid.columns, 3, 3))
    errors = _rotation_errors(frames)
    count = across or (3 if model == "modal" else 2)
    offsets = np.linspace(-grid.half_width, grid.half_width, count)[:, None]
    families = []
    for axis, length in enumerate((grid.s_length, grid.t_length)):
        ends = _ends(p, frames, axis, grid.half_width, offsets)
        side: NDArray = np.asarray(0 if sides is None else sides[axis])[..., None]
        settings = _Modal(modes, side, load, slope) if model == "modal" else None
        family = _family(ends, length, model, take_up, settings)
        families.append(_with_faults(family, ends, errors, axis, length))
    return PlyFibers(*(array for pair in zip(*families, strict=True) for array in pair))


class _Family(NamedTuple):
    """One family's part of PlyFibers."""

    coefficients: Array
    status: Statuses
    band: Statuses
    natural: Array
    used: Array
    side: Statuses
    excess: Array


class _Ends(NamedTuple):
    """Ends, unit tangents and cup normals of one family's fibers; shape (..., 3)."""

    r0: Array
    r1: Array
    dr0: Array
    dr1: Array
    n0: Array
    n1: Array


class _Modal(NamedTuple):
    """What the modal model asks for beyond ends and lengths."""

    modes: int
    side: NDArray
    load: Array | None
    softness: float


def _ends(
    p: Array, frames: Array, axis: int, half_width: float, offsets: Array
) -> _Ends:
    """Ends of the fibers of one family: axis 0 along s, 1 along t; Eq. 1-4."""
    along, lateral = frames[..., axis], frames[..., 1 - axis]
    lines = offsets * lateral[..., None, :]
    r0, _ = _neighbors((p + half_width * along)[..., None, :] + lines, axis)
    _, r1 = _neighbors((p - half_width * along)[..., None, :] + lines, axis)
    dr0, dr1 = _neighbors(along[..., None, :], axis)
    return _Ends(r0, r1, dr0, dr1, *_neighbors(frames[..., None, :, 2], axis))


def _neighbors(array: Array, axis: int) -> tuple[Array, Array]:
    """First and second cup of each pair, from shape (..., rows, columns, k, 3)."""
    if axis == 0:
        return array[..., :-1, :, :], array[..., 1:, :, :]
    return array[..., :-1, :, :, :], array[..., 1:, :, :, :]


def _family(
    ends: _Ends, L: float, model: str, take_up: float | None, modal: _Modal | None
) -> _Family:
    r0, r1, dr0, dr1, n0, n1 = ends
    natural = natural_length(r0, r1, dr0, dr1)
    if not natural.size:  # a lone row or column
        none = np.zeros(natural.shape, dtype=np.int64)
        a = np.zeros((*natural.shape, 5 if modal is None else modal.modes + 4, 3))
        return _Family(a, none, none, natural, natural, none, natural)
    used, band = band_length(natural, L, take_up or 0.0)
    side: Statuses = np.zeros(natural.shape, dtype=np.int64)
    if modal is not None:
        a, status, side, _ = modal_fibers(
            *(r0, r1, dr0, dr1, used, n0 + n1),
            modes=modal.modes,
            side=modal.side,
            load=modal.load,
            softness=modal.softness / L**2,
        )
    elif model == "quartic" and take_up is None:
        a, status = quartic_fibers(r0, r1, dr0, dr1, L)
    else:
        a = cubic_fibers(r0, r1, dr0, dr1, used)
        over = np.sqrt(dot(r1 - r0, r1 - r0)) > used * (1 + STRAIGHT)
        status = np.where(over, FiberStatus.OVERSTRETCHED, FiberStatus.NOT_ASKED)
        status = np.where(band == LengthStatus.IN_BAND, FiberStatus.MET, status)
    return _Family(a, status, band, natural, used, side, natural - L)


def _with_faults(
    family: _Family, ends: _Ends, errors: Array, axis: int, L: float
) -> _Family:
    """The family with the faults of its cups in place of its own verdicts."""
    chord = ends.r1 - ends.r0
    size = np.sqrt(dot(chord, chord))
    ahead = dot(chord, ends.dr0 + ends.dr1) / 2 / np.where(size > 0, size, 1)
    turned = np.minimum(dot(ends.n0, ends.n1), ahead)
    skew = np.maximum(*_neighbors(errors[..., None, None], axis))[..., 0]
    faults = [skew > ORTHONORMAL, size < MEET * L, turned <= 0]
    faults += [family.status == FiberStatus.OVERSTRETCHED]
    if not any(fault.any() for fault in faults):
        return family
    faults[0] = np.broadcast_to(faults[0], size.shape)
    kinds = [FiberStatus.SKEWED, FiberStatus.COINCIDENT, FiberStatus.INVERTED]
    status = np.select(faults[:3], kinds, family.status)
    numbers = [np.broadcast_to(skew, size.shape), size, turned, size - family.used]
    return family._replace(
        status=status, excess=np.select(faults, numbers, family.excess)
    )


def _rotation_errors(frames: Array) -> Array:
    """Largest error of R'R, shape (..., 3, 3) to (...)."""
    columns = np.moveaxis(frames, -1, 0)
    pairs = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
    errors = [abs(dot(columns[i], columns[j]) - (i == j)) for i, j in pairs]
    return np.maximum.reduce(errors)


def _loads(
    gravity: ArrayLike | None, stiffness: float | None, softness: float
) -> tuple[Array | None, float]:
    """Load over bending stiffness, and softness over L^2, as the fibers take them."""
    if not (np.isfinite(softness) and softness >= 0):
        raise PlyError("softness", f"{softness:g} m/N", "use 0 or more")
    if gravity is None and softness == 0:
        return None, 0.0
    if stiffness is None or not (np.isfinite(stiffness) and stiffness > 0):
        problem = "gravity and softness ask for a bending stiffness"
        raise PlyError("stiffness", problem, "give one above 0 N m")
    load = None if gravity is None else np.asarray(gravity, dtype=float) / stiffness
    if load is not None and not (load.shape == (3,) and np.isfinite(load).all()):
        raise PlyError("gravity", "is not three finite numbers")
    return load, 2 * softness * stiffness


def _check_modal(
    grid: CupGrid,
    across: int | None,
    modes: int,
    sides: tuple[ArrayLike, ArrayLike] | None,
) -> None:
    if across not in (None, 2, 3):
        raise PlyError("across", f"{across} fibers a strip", "use 2 or 3")
    if not 1 <= modes <= MOST_MODES:
        raise PlyError("modes", f"{modes}", f"use 1 to {MOST_MODES}")
    shapes = (grid.rows, grid.columns - 1), (grid.rows - 1, grid.columns)
    for side, shape in zip(sides or (), shapes, strict=False):
        if np.shape(side)[-2:] not in (shape, ()):
            problem = f"shape {np.shape(side)} does not end in {shape}"
            raise PlyError("sides", problem, "give one for each strip")


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
