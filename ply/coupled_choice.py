"""Different stable shapes of one patch, by increasing energy (D12).

Slack lets a strip bow to either side, so a patch has up to sixteen stable shapes or
more, and its poses do not say which of them it has.
"""

from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from ply.coupled import ARRAYS, CoupledModel, CoupledPatches, CoupledStatus
from ply.coupled_start import OUTER, STRIP_CUPS
from ply.errors import PlyError
from ply.fiber import Array
from ply.grid import Region

DISTINCT = 1e-4  # [m] rms distance below which two shapes are one
SIDES = np.array(list(product((1, -1), repeat=4)))
FIRST = SIDES == 1  # starts that leave a strip on its first side
STRIP_REGIONS = (Region.S_STRIP, Region.S_STRIP, Region.T_STRIP, Region.T_STRIP)


def coupled_alternatives(
    model: CoupledModel,
    positions: ArrayLike,
    rotations: ArrayLike,
    count: int = 4,
    thorough: bool = False,
) -> CoupledPatches:
    """Stable shapes of least energy that the same cups allow.

    Each strip is first shaped alone, started up and down. A patch then starts from
    every combination of what its strips can do: from 1 start without slack to 16.

    Args:
        model: The energy.
        positions: Cup centers, shape (..., 4, 3), or (..., 2, 3) for strips along s,
            in [m].
        rotations: Cup frames, shape (..., 4, 3, 3) or (..., 2, 3, 3).
        count: Number of shapes to give.
        thorough: Start patches from all 16 combinations of bulged strips, stable alone
            or not: finds more shapes of high energy, at several times the cost.

    Returns:
        Shapes with a last batch axis of length `count`; where fewer exist, the rest
        repeats the first and has the status ABSENT.

    Raises:
        PlyError: The shape of an array does not fit.
    """
    p, frames = np.asarray(positions, float), np.asarray(rotations, float)
    if p.ndim < 2 or frames.ndim != p.ndim + 1:
        raise PlyError("positions", f"shape {p.shape} for rotations {frames.shape}")
    if p.shape[-2] == 2:
        sides = np.array([1, -1])
        found = model.solve_strips(
            p[..., None, :, :], frames[..., None, :, :, :], sides
        )
    elif thorough:
        found = model.solve(p[..., None, :, :], frames[..., None, :, :, :], SIDES)
    else:
        found = _from_strips(model, p, frames)
    return _distinct(model, found, count)


def _from_strips(model: CoupledModel, p: Array, frames: Array) -> CoupledPatches:
    """Shapes from all combinations of stable strips; a last batch axis of 16."""
    first = model.solve(p, frames)  # tells bad input, and fills what has no start
    batch = first.energy.shape
    rest = np.zeros((*batch, 16, model.order**2, 3))
    shapes, wanted = [], np.ones((*batch, 16), dtype=bool)
    for k, region in enumerate(STRIP_REGIONS):
        own = STRIP_CUPS[k]
        sided = model.solve_strips(
            p[..., None, own, :], frames[..., None, own, :, :], (1, -1), along=region
        )
        q = sided.coefficients
        if OUTER[k] > 0:  # the outer edge stands first
            q = np.roll(q, 2 * model.order, axis=-2)
        far = abs(q[..., 0, :, :] - q[..., 1, :, :]).max((-1, -2)) > DISTINCT
        stable = (sided.status == CoupledStatus.CONVERGED).all(-1)
        wanted &= (far & stable)[..., None] | FIRST[:, k]
        shapes.append(q[..., np.where(FIRST[:, k], 0, 1), :, :])
    q = np.concatenate([*shapes, rest], axis=-2)
    wanted &= (first.status != CoupledStatus.BAD_INPUT)[..., None]
    cups = np.broadcast_to(first.cups[..., None, :, :], (*batch, 16, 12, 3))
    arrays = {
        name: np.stack([getattr(first, name)] * 16, axis=len(batch)) for name in ARRAYS
    }
    arrays["status"][..., 1:] = CoupledStatus.ABSENT
    if wanted.any():
        found = model.relax(Region.PATCH, q[wanted], cups[wanted])
        for name, array in arrays.items():
            array[wanted] = getattr(found, name)
    return CoupledPatches(Region.PATCH, **arrays)


def _distinct(model: CoupledModel, found: CoupledPatches, count: int) -> CoupledPatches:
    """The first different shapes of the last batch axis, by status and energy."""
    order = np.lexsort((found.energy, found.status), axis=-1)
    found = found[(*np.indices(order.shape)[:-1], order)]
    rows, _ = model.rows(found.region, *_probes(model, found.region))
    points = rows @ found.coefficients
    keep = found.status == CoupledStatus.CONVERGED
    keep[..., 0] = True
    for k in range(1, order.shape[-1]):
        away = points[..., :k, :, :] - points[..., k, None, :, :]
        near = np.sqrt((away**2).sum(-1).mean(-1)) < DISTINCT
        keep[..., k] &= ~(near & keep[..., :k]).any(-1)
    chosen = np.argsort(~keep, axis=-1, kind="stable")[..., :count]
    kept = np.take_along_axis(keep, chosen, axis=-1)
    chosen = np.where(kept, chosen, 0)
    out = found[(*np.indices(chosen.shape)[:-1], chosen)]
    out.status[~kept] = CoupledStatus.ABSENT
    return out


def _probes(model: CoupledModel, region: Region) -> tuple[Array, Array]:
    """Material points of the free ply at which shapes are compared, s and t."""
    d, span = model.grid.half_width, model.grid.span
    along = d + span * np.arange(0.5, 8) / 8
    across = np.array([-d, 0, d])
    if region == Region.S_STRIP:
        return _grid(along, across)
    both = np.concatenate([across, along, across + 2 * d + span])
    return _grid(both, both)


def _grid(s: Array, t: Array) -> tuple[Array, Array]:
    return np.repeat(s, len(t)), np.tile(t, len(s))
