r"""Lead: strokes that make up for the tilt lag of the cups, before it happens.

Strokes steer where cups are; how they tilt follows from the ply, the links and
gravity. Near an equilibrium both change linearly with the strokes x of the free legs,
and a small QP chooses

.. math::
    \min_x \; \sum_c w_t^2 |e_\theta - \Theta_c x|^2 + w_z^2 (e_z - z_c \cdot P_c x)^2
    + \epsilon |x + x_0|^2

with the tilt and height that cup c misses of its request, and x_0 what the strokes
already differ from those of the request. Cups of the landing ring count fully; those
outside pay for them and count little, but may not sink below their request. Fibers
stay as short as they are, strokes within their limits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from drapeplan.closures import Chords
from drapeplan.frames import rotation_vectors
from drapeplan.legs import cross
from drapeplan.qp import QpSolver, QuadraticProgram

Array = NDArray[np.float64]

MILLI = 1e3  # rows and strokes of the QP are in mm, so that they are of order one
TILT_LEVER = 35.0  # [mm/rad] a tilt counts like the rise of half a free span
HEIGHT = np.array([0.0, 1.0, 0.1, 0.03])  # [-] weight of a cup's height, by its ring
TILT = np.array([0.0, 1.0, 0.3, 0.1])  # [-] weight of its tilt; the last: further out
KEEP = 1e-3  # [-] pulls strokes back to those of the request
SINK = 0.1e-3  # [m] a cup outside the landing ring may be lower by this
NEAR = 1.5e-3  # [m] fibers with less slack than this are watched
LONGEST = 20e-3  # [m] longest change of one stroke in one correction


class Response(Protocol):
    """How cups respond to strokes: what `drapeplan.equilibrium` returns."""

    position: Array  # (n, 3, n_free), [-]
    rotation: Array  # (n, 3, n_free), [rad/m]


@dataclass(frozen=True)
class Task:
    """What the strokes of one pose are to achieve.

    Attributes:
        request: Cup positions (n, 3), in [m], and rotations (n, 3, 3), in the world.
        ring: Ring of each cup, as from `drapeplan.rings`, shape (n,).
        outward: Outward directions along (s, t), shape (n, 2).
        toe_up: Angle by which the landing ring shall lean back, in [rad].
    """

    request: tuple[Array, Array]
    ring: NDArray[np.int_]
    outward: Array
    toe_up: float


class StrokeLead:
    """The leading QP of one tool."""

    def __init__(self, chords: Chords, longest_fiber: float) -> None:
        """Prepare.

        Args:
            chords: Fiber chords of the tool.
            longest_fiber: Free length of a fiber plus its take-up, [m].
        """
        self.chords, self.longest_fiber = chords, longest_fiber
        self.solver = QpSolver()

    def correction(
        self,
        poses: tuple[Array, Array],
        response: Response,
        task: Task,
        offset: Array,
        room: tuple[Array, Array],
    ) -> Array:
        """Change of the free strokes that brings the cups nearer to their task.

        No change at all meets every constraint, so that there is always an answer.

        Args:
            poses: Cup positions (n, 3), in [m], and rotations, at equilibrium.
            response: How they change with the strokes.
            task: What they are to achieve.
            offset: Free strokes less those of the request, shape (n_free,), in [m].
            room: Least and largest change of each free stroke, in [m].

        Returns:
            Changes, shape (n_free,), in [m].
        """
        A, b = _objective(poses, response, task)
        H = A.T @ A + KEEP * np.eye(A.shape[1])
        c = -A.T @ b + KEEP * MILLI * offset
        rows = [_heights(poses, response, task), self._fibers(poses, response)]
        G, h = (np.concatenate(parts) for parts in zip(*rows, strict=True))
        lower, upper = (MILLI * np.clip(x, -LONGEST, LONGEST) for x in room)
        none = csc_matrix((0, len(c)))
        program = QuadraticProgram(
            csc_matrix(H),
            c,
            csc_matrix(G),
            MILLI * h,
            none,
            np.zeros(0),
            np.minimum(lower, 0.0),
            np.maximum(upper, 0.0),
        )
        solution = self.solver.solve(program)
        return solution.x / MILLI if solution.found else np.zeros(len(c))

    def _fibers(
        self, poses: tuple[Array, Array], response: Response
    ) -> tuple[Array, Array]:
        """Chords of nearly taut fibers: they may grow to their fiber's length."""
        slack = self.longest_fiber - self.chords.values(*poses)
        near = slack < NEAR
        ends = self.chords.ends(*poses)[near]
        pairs = self.chords.pairs[near]
        gap = ends[:, 1] - ends[:, 0]
        e = gap / np.linalg.norm(gap, axis=1, keepdims=True)
        sides = []
        for k in (0, 1):
            cup = pairs[:, k]
            moment = cross(ends[:, k] - poses[0][cup], e)
            sides.append(
                np.einsum("rx,rxf->rf", e, response.position[cup])
                + np.einsum("rx,rxf->rf", moment, response.rotation[cup])
            )
        return sides[1] - sides[0], np.maximum(slack[near], 0.0)


def _objective(
    poses: tuple[Array, Array], response: Response, task: Task
) -> tuple[Array, Array]:
    """Rows and right-hand sides of the least squares, in mm."""
    wanted, frames = task.request
    ring = np.minimum(task.ring, len(HEIGHT) - 1)
    s, t, n = np.moveaxis(frames, -1, 0)
    away = (frames[..., :2] @ task.outward[..., None])[..., 0]
    lean = np.where((task.ring == 1)[:, None], task.toe_up * cross(n, away), 0.0)
    tilt = rotation_vectors(poses[1], frames) - lean
    rows, right = [], []
    for axis in (s, t):
        weight = TILT_LEVER * TILT[ring]
        turn = np.einsum("cx,cxf->cf", axis, response.rotation) / MILLI
        rows.append(weight[:, None] * turn)
        right.append(weight * np.sum(axis * tilt, axis=1))
    rise = np.einsum("cx,cxf->cf", n, response.position)
    rows.append(HEIGHT[ring][:, None] * rise)
    right.append(HEIGHT[ring] * MILLI * np.sum(n * (wanted - poses[0]), axis=1))
    return np.concatenate(rows), np.concatenate(right)


def _heights(
    poses: tuple[Array, Array], response: Response, task: Task
) -> tuple[Array, Array]:
    """Cups beyond the landing ring: not lower than their request, or than they are."""
    far = task.ring > 1
    n = task.request[1][far][..., 2]
    above = np.sum(n * (poses[0] - task.request[0])[far], axis=1)
    rise = np.einsum("cx,cxf->cf", n, response.position[far])
    return -rise, np.maximum(above + SINK, 0.0)
