r"""Newton's method for the tool at rest, with interlinks and fibers as its rows.

A row holds a distance between two bounds. Interlinks of one length are always in force;
the others (fibers, links with a range) only where they pull or push: the working set.
Each linearization is solved with the working set of the last, and again with rows
dropped that would push the wrong way and rows added that would be passed, until none is
left: the primal active set of the quadratic program, warm from the last pose.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drapeplan.kkt import Layouts, Mask, SingularError
from drapeplan.legs import Array
from drapeplan.tool_energy import PASSIVE, ToolEnergy, ToolTerms

Sides = NDArray[np.int8]

AT_REST = 1e-9  # [N m] largest moment left: 1e-7 of what a cup's weight does to its leg
CLOSED = 1e-11  # [m] largest error of a length: 1e-8 mm
LONGEST_STEP = 0.2  # [rad] largest change of an angle in one iteration
ITERATIONS = 20  # Newton takes 3-6 where it converges, more over large angles
CAREFUL_ITERATIONS = 100  # of steps that go downhill
PATIENCE = 10  # iterations in which the errors must halve
STIFF = 10.0  # [N] brings lengths to moments, so that both errors can be added
CAREFUL_STEP = 0.1  # [rad]
PASSES = 6  # solutions of one linearization with different working sets
ONE_BY_ONE = 3  # passes after which one row changes at a time, against cycles
STRONGEST = 1e5  # [N] forces beyond it belong to no pose of rest
FLOOR = (
    1e-4  # [N m/rad] least curvature of a careful step: a tenth of the softest cup's
)


@dataclass(frozen=True)
class Pose:
    """Coordinates of the legs, and the rows' forces.

    Attributes:
        legs: ux, uy, stroke, sx, sy, sz, shape (n, 6), in [rad] and [m].
        forces: Tension of each row, shape (r,), in [N].
        sides: 1 where a row is held at its longest, -1 at its shortest, 0 where it is
            free between the two, shape (r,).
    """

    legs: Array
    forces: Array
    sides: Sides


@dataclass(frozen=True)
class Rest:
    """Where Newton's method ended.

    Attributes:
        pose: The last pose.
        terms: Energy of the tool there.
        found: Whether all tolerances are met.
        iterations: Linear systems that moved the tool.
        residual: Largest moment left on a passive coordinate of a free leg, [N m].
        closure: Largest violation of a row's bounds, [m].
    """

    pose: Pose
    terms: ToolTerms
    found: bool
    iterations: int
    residual: float
    closure: float

    @property
    def torn(self) -> bool:
        """Whether forces grew beyond bounds: no pose keeps all rows."""
        return not float(np.abs(self.pose.forces).max(initial=0.0)) < STRONGEST


class Settler:
    """Newton's method on one tool with one ply."""

    def __init__(self, energy: ToolEnergy, layouts: Layouts) -> None:
        """Keep what is fixed: which rows hold one length, which a range."""
        self.energy, self.layouts = energy, layouts
        self.rigid = energy.shortest == energy.longest

    def settle(
        self, T_world_tool: Array, pose: Pose, free: Mask, careful: bool = False
    ) -> Rest:
        """Bring the free legs' passive coordinates to rest.

        Args:
            T_world_tool: Placement of tool0, shape (4, 4), in [m].
            pose: Where to start; strokes and fixed legs stay as they are.
            free: Legs that are free, shape (n,).
            careful: Whether to step downhill wherever the energy curves downward, at
                the price of a dense decomposition a step.

        Returns:
            The last pose, and whether it is one of rest.
        """
        live = free[self.energy.row_pairs].any(axis=1)
        pose = self._start(pose, live)
        limit = CAREFUL_ITERATIONS if careful else ITERATIONS
        best, since = np.inf, 0
        for iteration in range(limit + 1):
            terms = self.energy.evaluate(T_world_tool, pose.legs, pose.forces)
            residual = np.abs(terms.gradient[free][:, PASSIVE]).max(initial=0.0)
            closure = self._violation(terms.lengths)[live].max(initial=0.0)
            good = not np.any(self._pushes(pose.forces, pose.sides))
            found = bool(residual <= AT_REST and closure <= CLOSED and good)
            rest = Rest(pose, terms, found, iteration, float(residual), float(closure))
            error = residual + STIFF * closure
            since = 0 if error < best / 2 else since + 1
            best = min(best, error)
            stuck = since > PATIENCE and not careful
            lost = stuck or rest.torn or not np.isfinite(error)
            if found or iteration == limit or lost:
                break
            try:
                pose = self._step(pose, terms, free, live, careful)
            except SingularError:
                break
        return rest

    def _start(self, pose: Pose, live: Mask) -> Pose:
        """Rows between fixed legs carry nothing; rigid links are always in force."""
        sides = np.where(live, np.where(self.rigid, 1, pose.sides), 0).astype(np.int8)
        return Pose(pose.legs, np.where(sides != 0, pose.forces, 0.0), sides)

    def _violation(self, lengths: Array) -> Array:
        """How far lengths lie outside their bounds, shape (r,), in [m]."""
        energy = self.energy
        return np.maximum(lengths - energy.longest, energy.shortest - lengths)

    def _pushes(self, forces: Array, sides: Sides) -> Mask:
        """Rows in force that pull or push the wrong way."""
        return (sides * forces < 0) & ~self.rigid

    def _step(
        self, pose: Pose, terms: ToolTerms, free: Mask, live: Mask, careful: bool
    ) -> Pose:
        """Solve one linearization, working set included."""
        energy, sides = self.energy, pose.sides.copy()
        step, solve = (
            (CAREFUL_STEP, self._downhill)
            if careful
            else (
                LONGEST_STEP,
                self._newton,
            )
        )
        for k in range(PASSES):
            dx, forces = solve(Pose(pose.legs, pose.forces, sides), terms, free)
            share = min(1.0, step / max(np.abs(dx).max(initial=0.0), 1e-300))
            move = np.zeros_like(pose.legs)
            move[np.ix_(free, PASSIVE)] = share * dx
            change = np.sum(terms.rows * move[energy.row_pairs], axis=(1, 2))
            lengths = terms.lengths + change
            wrong = np.where(self._pushes(forces, sides), np.abs(forces), 0.0)
            excess = np.where(live & (sides == 0), self._violation(lengths), 0.0)
            excess[excess <= CLOSED] = 0.0
            if not (wrong.any() or excess.any()):
                break
            if k >= ONE_BY_ONE:
                wrong, excess = _worst(wrong, excess)
            sides[wrong > 0] = 0
            over = lengths > (energy.longest + energy.shortest) / 2
            sides[excess > 0] = np.where(over, 1, -1)[excess > 0]
        forces = pose.forces + share * (forces - pose.forces)
        return Pose(pose.legs + move, np.where(sides != 0, forces, 0.0), sides)

    def _system(
        self, pose: Pose, terms: ToolTerms, free: Mask
    ) -> tuple[Array, Array, Array]:
        """Gradient without the rows let go, forces kept, and lengths to take up."""
        energy, active = self.energy, pose.sides != 0
        forces = np.where(active, pose.forces, 0.0)
        gradient = terms.gradient
        gone = np.flatnonzero(pose.forces - forces)
        if gone.size:
            gradient = gradient.copy()
            pull = pose.forces[gone, None, None] * terms.rows[gone]
            np.add.at(gradient, energy.row_pairs[gone], -pull)
        bound = np.where(pose.sides > 0, energy.longest, energy.shortest)
        return gradient[free][:, PASSIVE], forces, terms.lengths - bound

    def _newton(self, pose: Pose, terms: ToolTerms, free: Mask) -> tuple[Array, Array]:
        """Newton's step of the passive coordinates, shape (free, 5), and all forces."""
        layout = self.layouts(free, pose.sides != 0)
        gradient, forces, gap = self._system(pose, terms, free)
        right = np.zeros(layout.size)
        right[layout.x[layout.cups]] = -gradient
        right[layout.f[layout.rows]] = -gap[layout.rows]
        solution = layout.factor(terms).solve(right)
        forces = forces.copy()
        forces[layout.rows] += solution[layout.f[layout.rows]]
        return solution[layout.x[layout.cups]], forces

    def _downhill(
        self, pose: Pose, terms: ToolTerms, free: Mask
    ) -> tuple[Array, Array]:
        """The same with every curvature along the rows made positive."""
        layout = self.layouts(free, pose.sides != 0)
        gradient, forces, gap = self._system(pose, terms, free)
        H, J = layout.dense(terms)
        value, Z, pinned = reduced(H, J)
        y = -pinned @ gap[layout.rows]
        slope = Z.T @ (gradient.ravel() + H @ y)
        x = y - Z @ (slope / np.maximum(np.abs(value), FLOOR))
        forces = forces.copy()
        forces[layout.rows] -= pinned.T @ (gradient.ravel() + H @ x)
        return x.reshape(-1, 5), forces


def reduced(H: Array, J: Array) -> tuple[Array, Array, Array]:
    """Curvature of the energy along motions that keep the rows.

    Args:
        H: Second derivatives, shape (k, k).
        J: Rows, shape (r, k).

    Returns:
        Eigenvalues, ascending, shape (k - r,); their directions, shape (k, k - r);
        and the pseudo-inverse of J, shape (k, r).
    """
    U, size, V = np.linalg.svd(J)
    rank = int(np.sum(size > 1e-9 * size.max(initial=1.0)))
    Z = V[rank:].T
    values, directions = np.linalg.eigh(Z.T @ H @ Z)
    pinned = V[:rank].T @ (U[:, :rank] / size[:rank]).T
    return values, Z @ directions, pinned


def _worst(wrong: Array, excess: Array) -> tuple[Array, Array]:
    """Only the one row that is worst: passed bounds first."""
    which = excess if excess.any() else wrong
    one = np.zeros_like(which)
    one[which.argmax()] = which.max()
    return (np.zeros_like(wrong), one) if excess.any() else (one, np.zeros_like(excess))
