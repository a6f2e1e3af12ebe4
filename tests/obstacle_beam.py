"""A beam between two clamped ends over a rigid obstacle, by an exact active set."""

import numpy as np
from scipy.optimize import nnls


def obstacle_beam(ends, slopes, obstacle, length, n=140):
    """Least bending energy of w over an obstacle, for small slopes.

    With v = w - obstacle the energy is a sum of squares over v >= 0: the active set of
    Lawson and Hanson ends at its exact minimum.

    Args:
        ends: Heights of both ends, in [m].
        slopes: Slopes there.
        obstacle: Heights of the obstacle as a function of x.
        length: Distance between the ends, in [m].
        n: Intervals.

    Returns:
        Places and heights, shape (n + 1,), in [m].
    """
    x, h = np.linspace(0, length, n + 1, retstep=True)
    low, k = obstacle(x), np.arange(n + 1)
    bend = np.zeros((n + 1, n + 3))  # second differences, with a node beyond each end
    bend[k, k], bend[k, k + 1], bend[k, k + 2] = 1, -2, 1
    bend[[0, -1]] *= np.sqrt(0.5)  # half cells at the ends
    # The nodes beyond mirror the inner ones, up to the slope.
    known = bend[:, 0] * -2 * h * slopes[0] + bend[:, -1] * 2 * h * slopes[1]
    inner = bend[:, 1:-1].copy()
    inner[:, 1] += bend[:, 0]
    inner[:, -2] += bend[:, -1]
    known += inner[:, 0] * ends[0] + inner[:, -1] * ends[1]
    free = inner[:, 1:-1]
    above = nnls(free, -known - free @ low[1:-1], maxiter=50 * n)[0]
    return x, np.concatenate([[ends[0]], low[1:-1] + above, [ends[1]]])
