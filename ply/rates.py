r"""How the curves of fibers change with the ends that their cups give them.

A fiber is made of parts, each a vector times a polynomial of u: its first end, its
chord, both end slopes, and the bulge or the bending modes. The rates of the parts along
D directions follow from those of the ends; where a length is asked for, by implicit
differentiation of Eq. 22 or of the secular equation, docs/derivations.md, D16.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ply.fiber import BULGE, STRAIGHT, WEAK, Array, dot, length_error
from ply.modes import CUBIC, Modes, bending_modes

SQUARE_OF_FLAT = 1e-20  # [-] sum of squared shares below which a fiber is flat or taut
STEEPEST = 1e-9  # [-] of 14 + kappa and the like: keeps rates finite at their poles


class Ends(NamedTuple):
    """Fibers between two cups.

    Attributes:
        chord: Second ends less first ends, shape (..., 3), in [m].
        dr0: Unit tangents at the first ends, shape (..., 3).
        dr1: Unit tangents at the second ends, shape (..., 3).
        normal: Sums of the normals of the two cups, shape (..., 3).
        length: Lengths that the curves have, shape (...), in [m].
    """

    chord: Array
    dr0: Array
    dr1: Array
    normal: Array
    length: Array


class EndRates(NamedTuple):
    """Rates of fibers' ends along D directions.

    Attributes:
        r0: Of the first ends, shape (..., D, 3), as all but the last.
        chord: Of the chords.
        dr0: Of the first tangents.
        dr1: Of the second tangents.
        normal: Of the sums of the normals.
        length: Of the lengths, shape (..., D).
    """

    r0: Array
    chord: Array
    dr0: Array
    dr1: Array
    normal: Array
    length: Array


class Loading(NamedTuple):
    """What modal fibers follow beside their cups.

    Attributes:
        load: Weight over bending stiffness, as of `modal_fibers`.
        softness: As of `modal_fibers`.
        in_band: Whether a fiber has its natural length, shape (...).
    """

    load: Array | None = None
    softness: float = 0.0
    in_band: ArrayLike = False


def part_polynomials(model: str, terms: int) -> Array:
    """Polynomials of the parts of a fiber, in powers of u.

    Args:
        model: "cubic", "quartic" or "modal".
        terms: Number of coefficients of a fiber.

    Returns:
        Coefficients of u^0, u^1, ..., shape (parts, terms): first end, chord, both end
        slopes; then Eq. 14's bulge, or the modes.
    """
    if model == "modal":
        return bending_modes(terms - 4).powers
    rows = np.zeros((5, 5))
    rows[:4, :4], rows[4] = CUBIC, BULGE
    return rows


def natural_length_rates(ends: Ends, rates: EndRates) -> Array:
    """Rates of the natural length, from its quadratic equation (D2).

    Args:
        ends: The fibers, their lengths the natural ones.
        rates: Rates of their ends; those of the length are not read.

    Returns:
        Rates, shape (..., D).
    """
    chord, dr0, dr1, _, length = (array[..., None, :] for array in _vectors(ends))
    both = dot(dr0, rates.dr1) + dot(dr1, rates.dr0)
    slope = dot(rates.chord, dr0 + dr1) + dot(chord, rates.dr0 + rates.dr1)
    L = length[..., 0]
    steep = (44 + 4 * dot(dr0, dr1)) * L + 6 * dot(chord, dr0 + dr1)
    change = 2 * both * L**2 + 6 * slope * L - 72 * dot(chord, rates.chord)
    return -change / np.maximum(steep, STEEPEST * abs(L) + 1e-300)


def fiber_rates(
    model: str,
    coefficients: Array,
    ends: Ends,
    rates: EndRates,
    loading: Loading | None = None,
) -> Array:
    """Rates of the parts of fibers, as they stand and on the side they are on.

    A fiber that keeps its cubic although its length is wrong goes on doing so. One
    whose cubic has the right length to rounding changes as the model does beyond
    rounding, if its cups are not parallel.

    Args:
        model: "cubic", "quartic" or "modal".
        coefficients: Coefficients of the fibers, shape (..., terms, 3), in [m].
        ends: The fibers.
        rates: Rates of their ends along D directions.
        loading: Gravity and softness of modal fibers.

    Returns:
        Rates of the parts, shape (..., D, 3, parts).
    """
    size = ends.chord.shape[:-1]
    shape = (*size, rates.length.shape[-1], 3, coefficients.shape[-2])
    parts = np.zeros(shape)
    L, dL = ends.length[..., None, None], rates.length[..., None]
    parts[..., 0], parts[..., 1] = rates.r0, rates.chord
    parts[..., 2] = dL * ends.dr0[..., None, :] + L * rates.dr0
    parts[..., 3] = dL * ends.dr1[..., None, :] + L * rates.dr1
    if model == "quartic":
        parts[..., 4] = _bulge_rates(coefficients[..., 4, :], ends, rates)
    elif model == "modal":
        _fill_modes(
            parts[..., 4:], coefficients[..., 4:, :], ends, rates, loading or Loading()
        )
    return parts


def _vectors(ends: Ends) -> tuple[Array, ...]:
    return (*ends[:4], ends.length[..., None])


def _gamma_rates(ends: Ends, rates: EndRates) -> tuple[Array, Array]:
    """Gamma of Eq. 20, shape (...), and its rates, shape (..., D)."""
    gamma = length_error(ends.chord, ends.dr0, ends.dr1, ends.length)
    chord, dr0, dr1, _, length = (array[..., None, :] for array in _vectors(ends))
    h = chord / length
    dh = (rates.chord - h * rates.length[..., None]) / length
    total, dtotal = dr0 + dr1, rates.dr0 + rates.dr1
    both = dot(rates.dr0, dr1) + dot(dr0, rates.dr1)
    change = 2.4 * dot(h, dh) - (dot(dh, total) + dot(h, dtotal)) / 5 - both / 15
    return gamma, change


def _bulge_rates(bulge: Array, ends: Ends, rates: EndRates) -> Array:
    """Rates of L kappa d / L, the paper's bulge; shape (..., D, 3)."""
    gamma, dgamma = _gamma_rates(ends, rates)
    turn = (ends.dr0 - ends.dr1) / 8
    dturn = (rates.dr0 - rates.dr1) / 8
    square = dot(turn, turn)
    moves = bulge.any(axis=-1) | ((abs(gamma) <= STRAIGHT) & (square > WEAK**2))
    square = np.where(moves, square, 1.0)
    kappa = (dot(bulge, turn) / (square * ends.length))[..., None]
    c = -kappa * (kappa + 28)
    growth = 2 * dot(turn[..., None, :], dturn)
    dc = (52.5 * dgamma - c * growth) / square[..., None]
    dkappa = -dc / (2 * np.maximum(14 + kappa, STEEPEST))
    L = ends.length[..., None]
    size = (kappa * rates.length + L * dkappa)[..., None] * turn[..., None, :]
    change = size + (L * kappa)[..., None] * dturn
    return np.where(moves[..., None, None], change, 0.0)


class _Shape(NamedTuple):
    """Turn, skew and directions of `ply.modal`, or their rates: shape (..., D, 3)."""

    turn: Array
    skew: Array
    turn_kept: Array
    skew_kept: Array
    up: Array


def _shapes(ends: Ends, rates: EndRates) -> tuple[_Shape, _Shape]:
    """What the modes of fibers follow, with a unit axis for D, and its rates."""
    chord, dr0, dr1, normal, length = (array[..., None, :] for array in _vectors(ends))
    h = chord / length
    dh = (rates.chord - h * rates.length[..., None]) / length
    total, dtotal = dr0 + dr1, rates.dr0 + rates.dr1
    turn, dturn = dr0 - dr1, rates.dr0 - rates.dr1
    skew, dskew = total - 2 * h, dtotal - 2 * dh
    across = _cross(normal, total)
    dacross = _cross(rates.normal, total) + _cross(normal, dtotal)
    sideways, dsideways = _unit_rates(across, dacross)
    dup = _cross(dtotal, sideways) + _cross(total, dsideways)
    up, dup = _unit_rates(_cross(total, sideways), dup)

    def kept(vector: Array, rate: Array) -> tuple[Array, Array]:
        part = dot(vector, sideways)[..., None]
        change = (dot(rate, sideways) + dot(vector, dsideways))[..., None]
        return vector - part * sideways, rate - change * sideways - part * dsideways

    turn_kept, dturn_kept = kept(turn, dturn)
    skew_kept, dskew_kept = kept(skew, dskew)
    here = _Shape(turn, skew, turn_kept, skew_kept, up)
    return here, _Shape(dturn, dskew, dturn_kept, dskew_kept, dup)


def _cross(a: Array, b: Array) -> Array:
    """Cross products, shape (..., 3): np.cross spends its time on its arguments."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., k] = a[..., i] * b[..., j] - a[..., j] * b[..., i]
    return out


def _unit_rates(vector: Array, rate: Array) -> tuple[Array, Array]:
    """Unit vectors and their rates."""
    size = np.sqrt(dot(vector, vector))[..., None]
    size = np.where(size > 0, size, 1.0)
    unit = vector / size
    return unit, (rate - dot(unit, rate)[..., None] * unit) / size


def _fill_modes(
    parts: Array, last: Array, ends: Ends, rates: EndRates, loading: Loading
) -> None:
    """Rates of the amplitudes of the modes, into shape (..., D, 3, m).

    Inside the band a straight fiber is the cubic and remains it. Elsewhere one that
    just has its length keeps it, but for what bends it in the strip's own plane.
    """
    basis = bending_modes(last.shape[-2])
    here, moved = _shapes(ends, rates)
    L, dL = ends.length[..., None], rates.length
    push, dpush = np.zeros_like(L), np.zeros_like(dL)
    if loading.load is not None:
        push = dot(loading.load, here.up) * L**3
        dpush = dot(loading.load, moved.up) * L**3 + 3 * push / L * dL
    inverse = np.linalg.inv(basis.powers[4:, 4:])
    amplitude = np.moveaxis(np.swapaxes(last, -1, -2) @ inverse, -1, 0)[..., None, :]
    amplitude = amplitude / L[..., None]
    cubic = _of_modes(basis, here.turn, here.skew)
    dcubic = _of_modes(basis, moved.turn, moved.skew)
    kept = _of_modes(basis, here.turn_kept, here.skew_kept)
    dkept = _of_modes(basis, moved.turn_kept, moved.skew_kept)
    lift = (basis.areas / basis.loads).reshape(-1, *[1] * parts[..., 0].ndim)
    free = kept + lift * push[..., None] * here.up
    dlift = dpush[..., None] * here.up + push[..., None] * moved.up
    gamma, dgamma = _gamma_rates(ends, rates)
    droom = 2 * dot(cubic, dcubic).sum(axis=0) - dgamma
    shares = _Shares(
        *(amplitude + cubic, free, dkept + lift * dlift, here.up, moved.up, droom)
    )
    straight = (abs(gamma) <= STRAIGHT)[..., None] & (push == 0)
    dshare, known = _share_rates(basis, shares, loading.softness, straight)
    dshare = np.where((straight & ~known)[..., None], dkept, dshare)
    change = L[..., None] * (dshare - dcubic) + dL[..., None] * amplitude
    still = straight[..., None] & np.asarray(loading.in_band)[..., None, None]
    parts[...] = np.moveaxis(np.where(still, 0.0, change), 0, -1)


class _Shares(NamedTuple):
    """Shares of the modes of fibers, shape (m, ..., D, 3), D one or all directions.

    Without axial force they would be free; droom are the rates of R_0, (..., D).
    """

    share: Array
    free: Array
    dfree: Array
    up: Array
    dup: Array
    droom: Array


def _share_rates(
    basis: Modes, shares: _Shares, softness: float, straight: NDArray
) -> tuple[Array, NDArray]:
    """Rates of the shares, and whether their fiber has any.

    With x the force beyond buckling, it solves the rates of x y_1 = lambda_1 lean and
    of the length condition together: these are regular where the fiber buckles, too.
    """
    share, free, dfree, up, dup, droom = shares
    bent = dot(share - free, share - free).sum(axis=0) > STRAIGHT**2
    first = dot(share[0], up)
    share = np.concatenate([(first[..., None] * up)[None], share[1:]])
    loads = basis.loads.reshape(-1, *[1] * droom.ndim)
    square = dot(share, share).sum(axis=0)
    bends = square > SQUARE_OF_FLAT
    force = (loads * dot(share, free - share)).sum(axis=0)
    force = force / np.where(bends, square, 1.0)
    further = np.where(loads > loads[0], loads + force, 1.0)  # > 0 but for buckling
    falls = np.where(bends & (loads > loads[0]), loads / further, 0.0)

    steep = 2 * (dot(share, share) * falls / loads).sum(axis=0) + softness
    a = loads[0] * (dot(dfree[0], up) + dot(free[0], dup))
    b = droom - 2 * (falls**2 * dot(free, dfree)).sum(axis=0)
    x = loads[0] + force
    det = 2 * first**2 + x * steep
    known = bends & np.where(straight, ~bent & (square > WEAK**2), det > 0)
    det = np.where(known, det, 1.0)
    dx = np.where(known, (2 * first * a - x * b) / det, 0.0)
    dfirst = np.where(known, (first * b + steep * a) / det, 0.0)
    dfalls = -(falls**2) / loads * dx
    dshare = dfalls[..., None] * free + falls[..., None] * dfree
    dshare[0] = dfirst[..., None] * up + first[..., None] * dup
    return dshare, known


def _of_modes(basis: Modes, turn: Array, skew: Array) -> Array:
    """Shares g_k of the modes in a cubic, shape (m, ..., D, 3)."""
    extra = [1] * skew.ndim
    areas, tilts = (w.reshape(-1, *extra) for w in (basis.areas, basis.tilts))
    return areas * turn - 3 * tilts * skew
