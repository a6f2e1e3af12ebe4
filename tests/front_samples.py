"""Plies and paths by hand, on which the front tests stand."""

import numpy as np

from drapeplan.front import FrontGrid

PITCH, HALF = 0.11, 0.02  # [m] the default tool
MM = 1e-3
RIM = 0.02  # [m] overhang beyond the outer cups' edges


def line(n_cups):
    """Coordinates of one direction in [m]: 10 mm apart, 5 and 15 in the overhang."""
    inner = np.arange(-2, 11 * (n_cups - 1) + 3) * 0.01
    return np.concatenate(
        [[-HALF - RIM, -HALF - 0.005], inner, inner[-1] + [0.005, RIM]]
    )


def nearest_two(x, n_cups):
    """Cups before and behind each coordinate, and whether it is on a pad's line."""
    nearest = np.clip(np.round(x / PITCH), 0, n_cups - 1).astype(int)
    on = np.abs(x - nearest * PITCH) <= HALF + 1e-9
    low = np.clip(np.floor(x / PITCH + 1e-9), 0, n_cups - 1).astype(int)
    high = np.clip(np.ceil(x / PITCH - 1e-9), 0, n_cups - 1).astype(int)
    return np.where(on, nearest, low), np.where(on, nearest, high), on


def make_grid(rows=3, columns=4, start_cup=5):
    """Samples of a ply with `rows` x `columns` cups."""
    s, t = line(columns), line(rows)
    j0, j1, on_s = nearest_two(s, columns)
    i0, i1, on_t = nearest_two(t, rows)
    corners = [i[:, None] * columns + j for i in (i0, i1) for j in (j0, j1)]
    cup_index = np.where(on_t[:, None] & on_s, corners[0], -1)
    return FrontGrid(s, t, cup_index, np.stack(corners, -1), columns, start_cup)


def no_cups(grid, poses):
    """Cups flags that are all false, shape (poses, n_cups)."""
    return np.zeros((poses, len(grid.cup_centers)), dtype=bool)


def distance(grid, place):
    """Distance of each sample from a place (s, t), shape (nt, ns), in [m]."""
    return np.hypot(grid.s - place[0], (grid.t - place[1])[:, None])


def box(grid, s_range, t_range):
    """Samples inside closed ranges of s and t, in [m]."""
    in_s = (grid.s >= s_range[0] - 1e-9) & (grid.s <= s_range[1] + 1e-9)
    in_t = (grid.t >= t_range[0] - 1e-9) & (grid.t <= t_range[1] + 1e-9)
    return in_t[:, None] & in_s


def growing_disk(grid, poses=40):
    """A path that touches outward from the start, whole: gap, placed, landing.

    Returns:
        Gaps, shape (poses, nt, ns), in [m], with placed and landing cups.
    """
    r = distance(grid, grid.cup_centers[grid.start_cup])
    front = np.linspace(-0.02, 0.55, poses)[:, None, None]
    gap = 0.4 * np.maximum(0, r - front) ** 2 + 0.5 * np.maximum(0, -front)
    gap = gap * (r > front)
    cup_r = np.linalg.norm(grid.cup_centers - grid.cup_centers[grid.start_cup], axis=1)
    placed = cup_r + 1.5 * HALF <= front[:, 0]
    return gap, placed, ~placed & (cup_r - PITCH <= front[:, 0])
