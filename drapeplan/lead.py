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
keep to their longest natural length, strokes to their limits, and ply that is too low
has a price.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix, csr_matrix

from drapeplan.closures import Chords
from drapeplan.frames import rotation_vectors
from drapeplan.legs import cross
from drapeplan.qp import QpSolution, QpSolver, QuadraticProgram
from ply.fiber import natural_length
from ply.rates import EndRates, Ends, natural_length_rates

Array = NDArray[np.float64]

FINE = 1e-5  # [mm], and cost per mm: what is asked of the solver
MILLI = 1e3  # rows and strokes of the QP are in mm, so that they are of order one
TILT_LEVER = 35.0  # [mm/rad] a tilt counts like the rise of half a free span
HEIGHT = np.array([0.0, 1.0, 0.1, 0.03])  # [-] weight of a cup's height, by its ring
TILT = np.array([0.0, 1.0, 0.3, 0.1])  # [-] weight of its tilt; the last: further out
KEEP = 1e-3  # [-] pulls strokes back to those of the request
SINK = 0.1e-3  # [m] a cup outside the landing ring may be lower by this
DEPTH = 0.1e-3  # [m] the free ply may be lower than its laid state by this
RESERVE = 0.03e-3  # [m] kept of a fiber's length for what linearization misses
PRICES = np.array([1e3, 25.0])  # [-] of a squared mm of stretch, and of depth beyond
FIRM = 10.0  # [-] by which stretch costs more where that may end it
MOST = 1e3  # [mm] more than any fiber is stretched, or any sample deep
NEAR = 1.5e-3  # [m] fibers with less slack than this are watched
MANY = 400  # [-] rows; fewer are handed to the solver all at once
CLOSE, OPEN = 0.05, 1e-4  # [mm] rows that may bind; rows that do not hold
LONGEST = 20e-3  # [m] longest change of one stroke in one correction


class Response(Protocol):
    """How cups respond to strokes: what `drapeplan.equilibrium` returns."""

    @property
    def position(self) -> Array:
        """Derivatives of cup positions, shape (n, 3, n_free), [-]."""

    @property
    def rotation(self) -> Array:
        """Derivatives of their rotation vectors, shape (n, 3, n_free), in [rad/m]."""


@dataclass(frozen=True)
class Task:
    """What the strokes of one pose are to achieve.

    Attributes:
        request: Cup positions (n, 3), in [m], and rotations (n, 3, 3), in the world.
        ring: Ring of each cup, as from `drapeplan.rings`, shape (n,).
        outward: Outward directions along (s, t), shape (n, 2).
        lean: Angle by which cups of the landing ring shall lean back, about their heel,
            shape (n,), in [rad].
        half_width: Distance of the heel from a cup's center, [m].
    """

    request: tuple[Array, Array]
    ring: NDArray[np.int_]
    outward: Array
    lean: Array
    half_width: float


class StrokeLead:
    """The leading QP of one tool."""

    def __init__(self, chords: Chords, longest_fiber: float) -> None:
        """Prepare.

        Args:
            chords: Fiber chords of the tool.
            longest_fiber: Free length of a fiber plus its take-up, [m].
        """
        self.chords, self.longest_fiber = chords, longest_fiber
        self._axis = (np.diff(chords.pairs)[:, 0] != 1).astype(int)  # 0: along s
        self.solver = QpSolver(tolerance=FINE)

    def correction(
        self,
        poses: tuple[Array, Array],
        response: Response,
        task: Task,
        offset: Array,
        room: tuple[Array, Array],
        low: tuple[Array, Array] | None = None,
        firm: bool = False,
    ) -> Array:
        """Change of the free strokes that brings the cups nearer to their task.

        Fibers that are too long already and ply that is too low already have a price,
        so that there is always an answer.

        Args:
            poses: Cup positions (n, 3), in [m], and rotations, at equilibrium.
            response: How they change with the strokes.
            task: What they are to achieve.
            offset: Free strokes less those of the request, shape (n_free,), in [m].
            room: Least and largest change of each free stroke, in [m].
            low: Derivatives of low heights of the ply by the free strokes, shape
                (r, n_free), and the heights, shape (r,), in [m]; the deepest one is
                raised towards DEPTH, as far as that is worth its price.
            firm: Whether stretch costs more than usual.

        Returns:
            Changes, shape (n_free,), in [m].
        """
        A, b = _objective(poses, response, task)
        size = A.shape[1]
        prices = PRICES * [FIRM if firm else 1.0, 1.0]
        H = np.diag(np.append(np.full(size, KEEP), prices))
        H[:size, :size] += A.T @ A
        c = np.append(-A.T @ b + KEEP * MILLI * offset, [0.0, 0.0])
        rows = [(*_heights(poses, response, task), (0, 0))]
        rows.append((*self._fibers(poses, response), (-1, 0)))
        if low is not None:
            rows.append((-low[0], low[1] + DEPTH, (0, -1)))
        G = np.concatenate(
            [np.hstack([g, np.tile(e, (len(g), 1))]) for g, _, e in rows]
        )
        h = MILLI * np.concatenate([h for _, h, _ in rows])
        lower = np.minimum(np.clip(room[0], -LONGEST, LONGEST), 0.0)
        upper = np.maximum(np.clip(room[1], -LONGEST, LONGEST), 0.0)
        program = QuadraticProgram(
            csc_matrix(H),
            c,
            csc_matrix(G),
            h,
            csc_matrix((0, size + 2)),
            np.zeros(0),
            np.append(MILLI * lower, [0.0, 0.0]),
            np.append(MILLI * upper, [MOST, MOST]),
        )
        solution = self._solved(program)
        x = solution.x[:size] / MILLI if solution.found else np.zeros(size)
        return np.clip(x, lower, upper)  # solvers pass bounds by their tolerance

    def _solved(self, program: QuadraticProgram) -> QpSolution:
        """Solution of the program; of many rows only those that may bind are handed on.

        They are chosen where the strokes would go without rows, and those that then do
        not hold are added until all hold: the minimum is that of all rows.
        """
        if len(program.h) <= MANY:
            return self.solver.solve(program)
        free = np.linalg.solve(program.H.toarray(), -program.c)
        G, h = program.G.tocsr(), program.h
        taken = G @ np.clip(free, program.lower, program.upper) > h - CLOSE
        while True:
            part = replace(program, G=csc_matrix(G[taken]), h=h[taken])
            solution = self.solver.solve(part)
            if not solution.found:
                return self.solver.solve(program)
            missed = (G @ solution.x > h + OPEN) & ~taken
            if not missed.any():
                return solution
            taken |= missed

    def _fibers(
        self, poses: tuple[Array, Array], response: Response
    ) -> tuple[Array, Array]:
        """Natural lengths of nearly taut fibers: they may grow to the longest."""
        ends, tangents, natural = self._lengths(poses)
        near = natural > self.longest_fiber - NEAR
        pairs = self.chords.pairs[near]
        arms = ends[near] - poses[0][pairs]
        gradient = _gradient(arms, ends[near], tangents[near], natural[near])
        places = (6 * pairs[..., None] + np.arange(6)).ravel()
        starts = 12 * np.arange(len(pairs) + 1)
        moves = np.concatenate([response.position, response.rotation], axis=1)
        size = len(moves) * 6
        rows = csr_matrix((gradient.ravel(), places, starts), (len(pairs), size))
        rates: Array = rows @ moves.reshape(size, -1)
        return rates, self.longest_fiber - RESERVE - natural[near]

    def _lengths(self, poses: tuple[Array, Array]) -> tuple[Array, Array, Array]:
        """Ends (m, 2, 3), tangents there, and natural lengths (m,) of all fibers."""
        ends = self.chords.ends(*poses)
        tangents = poses[1][self.chords.pairs, :, self._axis[:, None]]
        pairs = np.moveaxis(ends, 1, 0), np.moveaxis(tangents, 1, 0)
        return ends, tangents, natural_length(*pairs[0], *pairs[1])

    def overlong(self, poses: tuple[Array, Array]) -> float:
        """Largest natural length beyond the longest fiber, in [m].

        Args:
            poses: Cup positions, shape (n, 3), in [m], and rotations.
        """
        return float(self._lengths(poses)[2].max() - self.longest_fiber)


def _gradient(arms: Array, ends: Array, tangents: Array, natural: Array) -> Array:
    """Natural lengths by what their cups do, shape (m, 2, 6), in [m/m] and [m/rad].

    Args:
        arms: From each cup to its end of the fiber, shape (m, 2, 3), in [m].
        ends: Ends of the fibers, shape (m, 2, 3), in [m].
        tangents: Directions there, shape (m, 2, 3).
        natural: The lengths, shape (m,), in [m].
    """
    m, unit = len(arms), np.eye(3)
    shift = np.broadcast_to(unit, (m, 2, 3, 3)), cross(unit, arms[:, :, None])
    moves = np.concatenate(shift, axis=2)  # of the ends, by six motions of their cups
    turns = np.zeros((m, 2, 6, 3))
    turns[:, :, 3:] = cross(unit, tangents[:, :, None])
    still, none = np.zeros((m, 6, 3)), np.zeros((m, 3))
    chord = ends[:, 1] - ends[:, 0]
    rates = natural_length_rates(
        Ends(chord, tangents[:, 0], tangents[:, 1], none, natural),
        EndRates(
            none[:, None],
            np.concatenate([-moves[:, 0], moves[:, 1]], axis=1),
            np.concatenate([turns[:, 0], still], axis=1),
            np.concatenate([still, turns[:, 1]], axis=1),
            none[:, None],
            np.zeros((m, 1)),
        ),
    )
    return rates.reshape(m, 2, 6)


def _objective(
    poses: tuple[Array, Array], response: Response, task: Task
) -> tuple[Array, Array]:
    """Rows and right-hand sides of the least squares, in mm."""
    wanted, frames = task.request
    ring = np.minimum(task.ring, len(HEIGHT) - 1)
    s, t, n = np.moveaxis(frames, -1, 0)
    away = (frames[..., :2] @ task.outward[..., None])[..., 0]
    lean = np.where(task.ring == 1, task.lean, 0.0)[:, None] * cross(n, away)
    tilt = rotation_vectors(poses[1], frames) - lean
    heel = task.half_width * np.linalg.norm(lean, axis=1)
    missing = np.sum(n * (wanted - poses[0]), axis=1) + heel
    rows, right = [], []
    for axis in (s, t):
        weight = TILT_LEVER * TILT[ring]
        turn = np.einsum("cx,cxf->cf", axis, response.rotation) / MILLI
        rows.append(weight[:, None] * turn)
        right.append(weight * np.sum(axis * tilt, axis=1))
    rise = np.einsum("cx,cxf->cf", n, response.position)
    rows.append(HEIGHT[ring][:, None] * rise)
    right.append(HEIGHT[ring] * MILLI * missing)
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
