r"""How points of a coupled ply move with its cups, by implicit differentiation (D9).

At an equilibrium the forces :math:`F(q, c)` on the unknowns vanish, and go on vanishing
as the cups move: :math:`dq = -H^{-1} F_c dc`, with :math:`H` the stiffness of a shape.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ply.coupled import STRIPS, CoupledModel, CoupledPatches, CoupledStatus
from ply.coupled_basis import Piece
from ply.coupled_body import Body
from ply.coupled_energy import stiffness, strains, tangents
from ply.coupled_start import STRIP_CUPS
from ply.errors import PlyError
from ply.fiber import Array
from ply.grid import Region
from ply.jacobian import PointJacobian

ROWS = 12  # [-] rows of the cups: position, s and t direction of four


def coupled_jacobian(
    model: CoupledModel, patches: CoupledPatches, points_st: ArrayLike
) -> PointJacobian:
    """Derivatives of material points of coupled patches by the poses of their cups.

    Only an equilibrium has a derivative: where a status is not CONVERGED, points move
    as they would with their unknowns held.

    Args:
        model: The energy.
        patches: Its shapes, batch axes first.
        points_st: Material coordinates (s, t) as of `model.points`, shape (n, 2).

    Returns:
        Derivatives, values of shape (..., n, 4, 3, 6), and cups by their order in
        `model.solve` or `model.solve_strips`, shape (n, 4).

    Raises:
        PlyError: The points are not pairs.
    """
    points_st = np.asarray(points_st, dtype=float)
    if points_st.ndim != 2 or points_st.shape[1] != 2:
        problem = f"shape {points_st.shape} is not (n, 2)"
        raise PlyError("points_st", problem, "give pairs (s, t)")
    batch, n = patches.energy.shape, len(points_st)
    cups = patches.cups.reshape(-1, ROWS, 3)
    moves = _cup_moves(cups)
    free, held = model.rows(patches.region, *points_st.T)
    out = np.einsum("nr,bxrd->bnxd", held, moves)
    known = np.flatnonzero(patches.status.ravel() == CoupledStatus.CONVERGED)
    if known.size:
        q = patches.coefficients.reshape(len(cups), -1, 3)[known]
        rates = _unknown_rates(model.body(patches.region), q, cups[known])
        dq = rates @ moves[known].reshape(len(known), 3 * ROWS, -1)
        dq = dq.reshape(len(known), 3, free.shape[1], -1)
        out[known] += np.swapaxes(free @ dq, 1, 2)
    values = np.swapaxes(out.reshape(len(cups), n, 3, 4, 6), 2, 3)
    around = np.arange(4)
    if patches.region != Region.PATCH:
        own = STRIP_CUPS[STRIPS[patches.region]]
        values = np.concatenate([values[..., own, :, :], 0 * values[..., :2, :, :]], 2)
        around = np.array([0, 1, 0, 1])
    return PointJacobian(
        values.reshape(*batch, n, 4, 3, 6), np.broadcast_to(around, (n, 4))
    )


def _cup_moves(cups: Array) -> Array:
    """Rates of cup rows (b, 12, 3) by the twists of four cups, (b, 3, 12, 24)."""
    out = np.zeros((len(cups), 3, 4, 3, 4, 6))
    for axis in range(3):
        unit = np.eye(3)[axis]
        for cup in range(4):
            turned = np.cross(unit, cups[:, 3 * cup + 1 : 3 * cup + 3])
            out[:, axis, cup, 0, cup, axis] = 1
            out[:, :, cup, 1:, cup, 3 + axis] = np.swapaxes(turned, 1, 2)
    return out.reshape(len(cups), 3, ROWS, 24)


def _unknown_rates(body: Body, q: Array, cups: Array) -> Array:
    """Rates of the unknowns (coordinate, function) by the rows of the cups.

    Shape (b, 3 size, 36): those of the cups are ordered (coordinate, row).
    """
    b, size = len(q), body.size
    whole = np.zeros((b, 3 * size, 3 * size))
    right = np.zeros((b, 3 * size, 3 * ROWS))
    numbers = np.broadcast_to(np.arange(size)[:, None], (1, size, 3)).astype(float)
    core, strips = (part[0, ..., 0].astype(int) for part in body.split(numbers))
    core_q, strip_q = body.split(q)
    pieces = [(body.core, core_q, cups, core[None])]
    pieces += [(body.strips, strip_q, cups[:, None], strips)] if len(strips) else []
    for piece, own_q, c, functions in pieces:
        both = _with_cups(piece, own_q, c)
        n = functions.shape[-1]
        both = both.reshape(b, len(functions), 3, n + ROWS, 3, n + ROWS)
        for k, own in enumerate(functions):
            place = (size * np.arange(3)[:, None] + own).ravel()
            block = both[:, k, :, :n]
            square = block[..., :n].reshape(b, 3 * n, 3 * n)
            whole[:, place[:, None], place] += square
            right[:, place] += block[..., n:].reshape(b, 3 * n, 3 * ROWS)
    return np.asarray(-np.linalg.solve(whole, right), dtype=float)


def _with_cups(piece: Piece, q: Array, cups: Array) -> Array:
    """Stiffness over unknowns and cup rows alike, (..., 3 (n + 12), 3 (n + 12))."""
    rs, rt = tangents(piece, q, cups)
    bending = np.block(
        [
            [piece.bending, piece.bending_cups],
            [piece.bending_cups.mT, piece.cups_bending],
        ]
    )
    wide = replace(
        piece,
        ds=np.concatenate([piece.ds, piece.ds_cups], axis=-1),
        dt=np.concatenate([piece.dt, piece.dt_cups], axis=-1),
        bending=bending,
    )
    return stiffness(wide, rs, rt, strains(rs, rt))
