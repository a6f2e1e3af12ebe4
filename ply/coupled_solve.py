"""Newton's method for many coupled bodies of equal shape at once (D11).

A body is a core and the strips that hang on it. The outer edge of a strip meets nothing
but the strip, so it is eliminated before the core is solved. Cholesky tells whether the
tangent is positive definite; where it is not, bending is added until it is.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ply.coupled_body import Body, Tangent, tangent
from ply.coupled_energy import (
    add_to_blocks,
    next_foreseen,
    strain_changes,
    strains,
    tangents,
)
from ply.coupled_factor import factors, solve_factored
from ply.fiber import Array, Statuses, dot

Bools = NDArray[np.bool_]

TOLERANCE = 2e-5  # [m] largest move of the last step, which leaves about 1e-6 m
AT_REST = 2e-8  # [m] the same of a step with bending added, which is a short one
LONGEST_STEP = 0.01  # [m] largest move of one step: linearization of a 70 mm span
MAX_ITERATIONS = 40  # [-] steps; 2 to 12 are usual
EAGER = 10  # [-] steps after which fibers pull and let go by turns, if they ever do
CALM = 0.5  # [-] share of new strains in those foreseen from then on
FIRST_AID, MORE_AID = 0.3, 2.5  # [-] share of bending first added, and its growth
MOST_AID = 1e4  # [-] bending added at most: no help beyond


class CoupledStatus(IntEnum):
    """What became of one patch or strip."""

    CONVERGED = 0  # an equilibrium, and a stable one
    UNSTABLE = 1  # an equilibrium that any disturbance leaves: a saddle
    NOT_CONVERGED = 2  # no equilibrium in the steps allowed
    BAD_INPUT = 3  # a pose is not finite, too far off or no rotation: rest shape given
    ABSENT = 4  # fewer shapes exist than were asked for


class Solution(NamedTuple):
    """Result of `newton`, arrays of length b."""

    q: Array
    status: Statuses
    iterations: NDArray[np.int64]


def newton(
    body: Body, start: Array, cups: Array, foreseen: list[Array] | None = None
) -> Solution:
    """Stable equilibria nearest to the starts, as Newton's method goes.

    The stresses in the tangent are those that the last linear step foresaw: they are
    smooth where the strains of its end are not, which saves most steps
    (Magisano, Leonetti and Garcea, 2017). They also tell which fibers pull (D8).

    Args:
        body: The body.
        start: Unknowns to start from, shape (b, size, 3), in [m].
        cups: Position, s and t direction of its cups, shape (b, 12, 3).
        foreseen: Strains expected in core and strips; by default none.

    Returns:
        The unknowns, the CoupledStatus and the steps taken.
    """
    q, b = start.copy(), len(start)
    status = np.full(b, CoupledStatus.NOT_CONVERGED, dtype=np.int64)
    iterations = np.full(b, MAX_ITERATIONS)
    live = np.arange(b)
    for iteration in range(1, MAX_ITERATIONS + 1):
        trust = 1.0 if iteration <= EAGER else CALM
        step, moved, aid, foreseen = _step(body, q[live], cups[live], foreseen, trust)
        q[live] += step
        found = np.select(
            [(moved > TOLERANCE) | (aid > MOST_AID), aid > 0],
            [CoupledStatus.NOT_CONVERGED, CoupledStatus.UNSTABLE],
            CoupledStatus.CONVERGED,
        )
        status[live] = found
        # the first tangent has the stresses of the start: no word on stability
        settled = (moved < np.where(aid > 0, AT_REST, TOLERANCE)) & (iteration > 1)
        done = settled | (aid > MOST_AID)
        iterations[live[done]] = iteration
        live, foreseen = live[~done], [e[~done] for e in foreseen]
        if not len(live):
            break
    return Solution(q, status, iterations)


def _step(
    body: Body, q: Array, cups: Array, foreseen: list[Array] | None, trust: float
) -> tuple[Array, Array, Array, list[Array]]:
    """One step of each body: step, its largest move, aid, strains foreseen."""
    pieces = ((body.core, cups), (body.strips, cups[:, None]))
    ends = [
        tangents(piece, part, c)
        for (piece, c), part in zip(pieces, body.split(q), strict=True)
    ]
    if foreseen is None:
        foreseen = [np.zeros((*rs.shape[:-2], 3, rs.shape[-2])) for rs, _ in ends]
    step, aid = _aided_step(body, tangent(body, q, cups, foreseen, ends))
    moves = [
        piece.values @ part
        for (piece, _), part in zip(pieces, body.split(step), strict=True)
    ]
    moved = np.sqrt(
        np.maximum(
            dot(moves[0], moves[0]).max(-1),
            dot(moves[1], moves[1]).max((-1, -2), initial=0),
        )
    )
    share = np.minimum(1, LONGEST_STEP / np.maximum(moved, LONGEST_STEP))
    step = share[:, None, None] * step
    foreseen = [
        next_foreseen(
            piece, e, strains(rs, rt) + strain_changes(piece, rs, rt, part), trust
        )
        for (piece, _), (rs, rt), part, e in zip(
            pieces, ends, body.split(step), foreseen, strict=True
        )
    ]
    return step, moved, aid, foreseen


def _aided_step(body: Body, now: Tangent) -> tuple[Array, Array]:
    """Newton steps (b, size, 3), and the share of bending that had to be added (b,).

    Beyond MOST_AID the step is zero.
    """
    b = len(now.core)
    step, aid = np.zeros((b, body.size, 3)), np.zeros(b)
    todo = np.arange(b)
    while len(todo) and aid[todo[0]] <= MOST_AID:
        some = Tangent(*(array[todo] for array in now)) if len(todo) < b else now
        found, good = _solve(body, some, aid[todo])
        step[todo[good]] = found
        todo = todo[~good]
        aid[todo] = np.maximum(FIRST_AID, MORE_AID * aid[todo])
    return step, aid


def _solve(body: Body, now: Tangent, aid: Array) -> tuple[Array, Bools]:
    """Steps of the bodies whose aided tangent is positive definite, and which."""
    core, strips = now.core.copy(), now.strips
    if aid.any():
        strips = strips.copy()
        add_to_blocks(core, aid[:, None, None] * body.core.bending)
        add_to_blocks(strips, aid[:, None, None, None] * body.strips.bending)
    load, outer = _condense(core, strips, now)
    lower, good = factors(core)
    good &= outer.definite
    lower, load, solved = (
        array if good.all() else array[good] for array in (lower, load, outer.solved)
    )
    found = solve_factored(lower, load[..., None])[..., 0]
    count, functions = strips.shape[1], strips.shape[-1] // 3
    half, some = functions // 2, len(load)
    q_core = found.reshape(some, 3, core.shape[-1] // 3).mT
    inner = q_core[:, : count * half].reshape(some, count, half, 3).mT
    inner = inner.reshape(some, count, 3 * half, 1)
    q_outer = (solved[..., -1:] - solved[..., :-1] @ inner)[..., 0]
    return body.join(q_core, q_outer.reshape(some, count, 3, half).mT), good


class _Outer(NamedTuple):
    solved: Array  # (b, strips, 3 h, 3 h + 1): times inner edge, and load
    definite: Bools  # (b,)


def _condense(core: Array, strips: Array, now: Tangent) -> tuple[Array, _Outer]:
    """Add the strips to the core, their outer edges eliminated; loads (b, 3 n)."""
    b, count, size = strips.shape[:3]
    n, k = core.shape[-1] // 3, size // 3
    half = k // 2
    six = strips.reshape(b, count, 3, k, 3, k)
    force = now.strip_force.mT
    edge = (b, count, 3 * half, 3 * half)

    def part(first: slice, second: slice) -> Array:
        return six[:, :, :, first, :, second].reshape(edge)

    out, inn = slice(0, half), slice(half, k)
    outer, cross = part(out, out), part(out, inn)
    right = -force[..., out].reshape(b, count, 3 * half, 1)
    lower, sound = factors(outer.reshape(b * count, *edge[2:]))
    sides = np.concatenate([cross, right], axis=-1)
    solved = solve_factored(lower, sides.reshape(b * count, *sides.shape[2:]))
    solved = solved.reshape(sides.shape)
    less = cross.mT @ solved
    added = (part(inn, inn) - less[..., :-1]).reshape(b, count, 3, half, 3, half)
    loads = -force[..., inn] - less[..., -1].reshape(b, count, 3, half)
    matrix = core.reshape(b, 3, n, 3, n)  # a view: the core is changed
    load = -now.core_force.mT
    for strip in range(count):
        own = slice(strip * half, (strip + 1) * half)
        matrix[:, :, own, :, own] += added[:, strip]
        load[:, :, own] += loads[:, strip]
    every = sound.reshape(b, count).all(-1)
    return load.reshape(b, 3 * n), _Outer(solved, np.asarray(every))
