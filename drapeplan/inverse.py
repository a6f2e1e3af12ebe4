"""Inverse kinematics of an arm by damped Newton steps, from many starts if need be."""

from collections.abc import Callable, Iterable
from itertools import chain

import numpy as np

from drapeplan.legs import Array

Residual = Callable[[Array], tuple[Array, Array]]
"""Coordinates to (twist that is left, shape (6,); its Jacobian, shape (6, n))."""

TURN = 2 * np.pi  # [rad]
REACHED = 1e-12  # [m, rad] norm of the twist that is left: some 1e3 roundings at 1 m
STEPS = 60  # Newton steps from one start; a good start needs 4 to 8
LARGEST_STEP = 0.5  # [rad] of any joint in one Newton step: stays on one branch
DAMPING = 1e-3  # [-] times the squared residual: gone where Newton converges
NEAR = 0.8  # [rad] largest joint travel to a solution that is taken without a search


def nearest_solution(
    residual: Residual,
    lower: Array,
    upper: Array,
    seed: Array,
    starts: Iterable[Array],
    period: Array | float = TURN,
) -> tuple[Array | None, list[Array]]:
    """Coordinates with no residual, within limits, nearest to a seed.

    What Newton's method finds from the seed is taken at once if no joint travels more
    than NEAR; otherwise every start is tried, and the solution with the least largest
    travel wins.

    Args:
        residual: What is left to go, and its Jacobian.
        lower: Lower limits, shape (n,), in [rad].
        upper: Upper limits, shape (n,), in [rad].
        seed: Where the arm comes from, shape (n,), in [rad].
        starts: Further starts, each of shape (n,), in [rad].
        period: After which a coordinate is the same again, shape (n,); 0 for slides.

    Returns:
        The solution, shape (n,), or None, and where the failed starts ended.
    """
    best: Array | None = None
    ends = []
    for start in chain([seed], starts):
        q, reached = newton(residual, start)
        q = nearest_turn(q, lower, upper, seed, period)
        if not reached or np.any((q < lower) | (q > upper)):
            ends.append(q)
            continue
        if best is None or _travel(q, seed) < _travel(best, seed):
            best = q
        if start is seed and _travel(q, seed) < NEAR:
            break
    return best, ends


def newton(residual: Residual, q: Array) -> tuple[Array, bool]:
    """Damped Newton steps until nothing is left to go.

    Args:
        residual: What is left to go, and its Jacobian.
        q: Start, shape (n,), in [rad].

    Returns:
        The last iterate, shape (n,), in [rad], and whether it has no residual.
    """
    for _ in range(STEPS):
        left, J = residual(q)
        size = float(np.linalg.norm(left))
        if not size >= REACHED:
            return q, size < REACHED
        damping = DAMPING * min(1.0, size * size) * np.eye(len(left))
        step = J.T @ np.linalg.lstsq(J @ J.T + damping, left, rcond=None)[0]
        q = q + step * min(1.0, LARGEST_STEP / np.abs(step).max(initial=1e-300))
    return q, False


def nearest_turn(
    q: Array, lower: Array, upper: Array, seed: Array, period: Array | float = TURN
) -> Array:
    """The same posture, full turns chosen within limits and near a seed.

    Args:
        q: Angles, shape (n,), in [rad].
        lower: Lower limits, shape (n,), in [rad].
        upper: Upper limits, shape (n,), in [rad].
        seed: Angles to be near, shape (n,), in [rad].
        period: Of each, shape (n,); 0 for slides.

    Returns:
        Angles, shape (n,), in [rad]; outside the limits only where no turn is inside.
    """
    turns = np.round((seed - q) / TURN) + np.arange(-2, 3)[:, None]
    choices = q + turns * period
    outside = (choices < lower) | (choices > upper)
    cost = np.abs(choices - seed) + 1e3 * outside
    nearest: Array = np.take_along_axis(choices, cost.argmin(axis=0)[None], axis=0)[0]
    return nearest


def spread(lower: Array, upper: Array, count: int) -> Array:
    """Starts spread evenly between limits, the same each time.

    An additive recurrence with the powers of the root of x^(n + 1) = x + 1.

    Args:
        lower: Lower limits, shape (n,), in [rad].
        upper: Upper limits, shape (n,), in [rad].
        count: Number of starts.

    Returns:
        Starts, shape (count, n), in [rad].
    """
    n = len(lower)
    root = 2.0
    for _ in range(64):
        root = (1 + root) ** (1 / (n + 1))
    share = (
        0.5 + np.arange(1, count + 1)[:, None] * root ** -np.arange(1.0, n + 1)
    ) % 1
    points: Array = lower + share * (upper - lower)
    return points


def _travel(q: Array, seed: Array) -> float:
    """Largest joint travel, [rad]."""
    return float(np.abs(q - seed).max())
