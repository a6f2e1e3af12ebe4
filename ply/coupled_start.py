"""Shapes that Newton's method starts from: strips bulged to chosen sides (D12)."""

from collections.abc import Sequence

import numpy as np

from ply.coupled_basis import STRIP_INTERVALS, PatchBasis, Piece, band
from ply.coupled_body import Body
from ply.fiber import Array, dot, length_error

STRIP_CUPS = np.array([[0, 1], [2, 3], [0, 2], [1, 3]])  # both cups of each strip
OUTER = np.array([-1, 1, -1, 1])  # side of a strip's middle line where its rim lies
TIE = 1e-6  # [-] bulge over length below which two sides are equally flat
AFTER, BEFORE = [1, 2, 0], [2, 0, 1]  # of each axis, as in a cross product
BULGE_SQUARE = 2 / 105  # [-] integral of (d/du u^2 (1 - u)^2)^2
BUBBLE = 0.5  # [-] first bubble is 2 u^2 (1 - u)^2


def cup_rows(positions: Array, rotations: Array) -> Array:
    """Position, s and t direction of each cup, shape (..., 3 cups, 3)."""
    frames = np.swapaxes(rotations[..., :2], -1, -2)
    rows = np.concatenate([positions[..., None, :], frames], axis=-2)
    return rows.reshape(*rows.shape[:-3], -1, 3)


def mean_turn(before: Array, after: Array) -> Array:
    """Rotation that takes cups nearest to where they have turned (D11).

    Args:
        before: Position, s and t direction of each cup, shape (..., 3 cups, 3).
        after: The same, later.

    Returns:
        Rotations, shape (..., 3, 3).
    """
    frames = []
    for rows in (before, after):
        x, y = rows[..., 1::3, :], rows[..., 2::3, :]
        normal = x[..., AFTER] * y[..., BEFORE] - x[..., BEFORE] * y[..., AFTER]
        frames.append(np.concatenate([x, y, normal], axis=-2))
    u, _, v = np.linalg.svd(frames[1].mT @ frames[0])
    u[..., -1] *= np.sign(np.linalg.det(u @ v))[..., None]
    return np.asarray(u @ v)


def patch_start(
    basis: PatchBasis,
    positions: Array,
    rotations: Array,
    sides: Array,
    take_up: float = 0.0,
) -> tuple[Array, Array]:
    """Unknowns of patches whose strips are bulged, the inside as they ask.

    Args:
        basis: Functions of the patch.
        positions: Cup centers, shape (..., 4, 3), in [m].
        rotations: Cup frames, shape (..., 4, 3, 3).
        sides: Side of each strip, shape (..., 4): 1, -1, or 0 for the flatter.
        take_up: Length that the weave gives either way, in [m].

    Returns:
        Unknowns, shape (..., size, 3), in [m], and of each strip the strain that its
        fibers have to take beyond the take-up, shape (..., 4).
    """
    strips, asked = zip(
        *(
            strip_start(
                basis,
                k,
                positions[..., STRIP_CUPS[k], :],
                rotations[..., STRIP_CUPS[k], :, :],
                sides[..., k],
                take_up,
            )
            for k in range(len(STRIP_INTERVALS))
        ),
        strict=True,
    )
    inside = np.zeros((*strips[0].shape[:-2], len(basis.inside), 3))
    return np.concatenate([*strips, inside], axis=-2), np.stack(asked, axis=-1)


def strip_start(
    basis: PatchBasis,
    strip: int,
    positions: Array,
    rotations: Array,
    side: Array,
    take_up: float = 0.0,
) -> tuple[Array, Array]:
    """Unknowns of strips: cubics along both edges, bulged to have their length.

    Args:
        basis: Functions of the patch.
        strip: Number of the strip in the patch.
        positions: Centers of its two cups, shape (..., 2, 3), in [m].
        rotations: Frames of its two cups, shape (..., 2, 3, 3).
        side: Side to bulge to, shape (...): 1, -1, or 0 for the flatter.
        take_up: Length that the weave gives either way, in [m].

    Returns:
        Unknowns, shape (..., 4 order, 3), in [m], and the strain that the fibers have
        to take beyond the take-up, shape (...).
    """
    along = 0 if strip < 2 else 1
    d = basis.s.half_width
    length = (basis.s, basis.t)[along].length
    x, y = rotations[..., along], rotations[..., 1 - along]
    rim = OUTER[strip] * d * np.array([1, -1])[:, None]  # outer edge, then inner
    r0 = (positions + d * x)[..., 0, None, :] + rim * y[..., 0, None, :]
    r1 = (positions - d * x)[..., 1, None, :] + rim * y[..., 1, None, :]
    dr0, dr1 = x[..., 0, None, :], x[..., 1, None, :]
    normal = rotations[..., 2].sum(-2)
    size = np.sqrt(dot(normal, normal))
    normal = normal / np.where(size > 0, size, 1)[..., None]
    gamma = length_error(r1 - r0, dr0, dr1, length)
    surplus = (gamma - np.clip(gamma, *(2 * band(take_up / length)))) * length**2
    turn = length / 15 * dot(normal[..., None, :], dr0 - dr1)
    middle = -turn / (2 * BULGE_SQUARE)
    reach = np.sqrt(np.maximum(middle**2 - surplus / BULGE_SQUARE, 0))
    up, down = abs(middle + reach).sum(-1), abs(middle - reach).sum(-1)
    flatter = np.where(up <= down + TIE * length, 1, -1)
    sign = np.where(side == 0, flatter, np.sign(side))
    bulge = BUBBLE * (middle + sign[..., None] * reach)
    slope = (bulge[..., 0] - bulge[..., 1]) * OUTER[strip] / (2 * d)
    out = np.zeros((*size.shape, 4, basis.s.order, 3))
    for k, amount in enumerate((bulge[..., 0], slope, bulge[..., 1], slope)):
        out[..., k, 0, :] = amount[..., None] * normal
    return out.reshape(*size.shape, -1, 3), surplus.mean(-1) / (2 * length**2)


def start_strains(body: Body, along: Sequence[int], asked: Array) -> list[Array]:
    """Strains that a start foresees: those of the take-up where it is used up (D8).

    Args:
        body: The patch or strip.
        along: Axis of each strip.
        asked: Strain of each strip beyond the take-up, shape (b, strips).

    Returns:
        Strains of core and strips, shapes (b, 3, G) and (b, strips, 3, G).
    """
    out = [
        np.zeros((len(asked), *piece.low.shape)) for piece in (body.core, body.strips)
    ]
    each = np.arange(len(along))
    for axis in set(along):
        own = each[np.equal(along, axis)]
        out[0][:, axis] = _edge(body.core, axis, asked[:, own].mean(-1))
        if len(body.strips.low):
            out[1][:, own, axis] = _edge(body.strips, axis, asked)[:, own]
    return out


def _edge(piece: Piece, axis: int, asked: Array) -> Array:
    """The edge of the band beyond which strains are asked for, or zero within it."""
    sign = asked[..., None]
    low, high = piece.low[..., axis, :], piece.high[..., axis, :]
    edge = np.select([sign < 0, sign > 0], [low, high], 0.0)
    return (1 + TIE) * edge
