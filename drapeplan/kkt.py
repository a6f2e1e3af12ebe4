r"""Newton's linear system of the tool's equilibrium, banded.

Unknowns are the passive coordinates x of the free legs and the forces f of the rows in
force (interlinks, taut fibers):

.. math::
    \begin{pmatrix} H & J^T \\ J & -\delta I \end{pmatrix}
    \begin{pmatrix} \Delta x \\ \Delta f \end{pmatrix} = - \begin{pmatrix} g \\ c
    \end{pmatrix}.

Cups are taken along the grid's short side, each followed by the rows that end at it,
so all entries lie near the diagonal: 50 places at 6 x 8 cups, and LAPACK's banded LU is
four times as fast as the dense one. The small :math:`\delta` lets rows depend on each
other; as it weighs the change of the forces alone, it moves no solution.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgbtrf, dgbtrs

from drapeplan.legs import Array
from drapeplan.tool_energy import PASSIVE, ToolEnergy, ToolTerms

Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]

SOFT = 1e-10  # [m/N] delta: far below what a fiber gives, 5e-6
KEPT = 64  # layouts kept: a wave step has one, and one more for each fiber gone taut
NONE = -1


class SingularError(ArithmeticError):
    """The system has no solution."""


class Layout:
    """Places of unknowns and entries for one set of free legs and rows in force.

    Attributes:
        x: Place of each passive coordinate, shape (n, 5); -1 where the leg is fixed.
        f: Place of each row's force, shape (r,); -1 where it is not in force.
        size: Number of unknowns.
        band: Entries on either side of the diagonal.
    """

    def __init__(
        self, order: Indices, energy: ToolEnergy, free: Mask, active: Mask
    ) -> None:
        """Lay the system out.

        Args:
            order: Rank of each cup in the sweep, shape (n,).
            energy: Gives the pairs of cups and the rows between them.
            free: Legs that are free, shape (n,).
            active: Rows in force, shape (r,); each has a free end.
        """
        row_pairs, pairs = energy.row_pairs, energy.pairs
        cups, rows = np.flatnonzero(free), np.flatnonzero(active)
        ends = row_pairs[rows]
        last = np.where(free[ends], order[ends], NONE).max(axis=1)
        key = np.concatenate([np.repeat(order[cups], 5) * 2, last * 2 + 1])
        place = np.empty(len(key), dtype=np.int64)
        place[np.argsort(key, kind="stable")] = np.arange(len(key))
        self.size = len(key)
        self.x = np.full((len(free), 5), NONE)
        self.x[cups] = place[: 5 * len(cups)].reshape(-1, 5)
        self.f = np.full(len(row_pairs), NONE)
        self.f[rows] = place[5 * len(cups) :]
        self.cups, self.rows = cups, rows
        self.pairs = np.flatnonzero(free[pairs].all(axis=1))
        self.ends = [rows[free[ends[:, k]]] for k in (0, 1)]
        i, j = pairs[self.pairs].T
        own = np.broadcast_arrays(self.x[cups, :, None], self.x[cups, None])
        mixed = np.broadcast_arrays(self.x[i, :, None], self.x[j, None])
        legs = [row_pairs[self.ends[k], k] for k in (0, 1)]
        slopes = [
            np.broadcast_arrays(self.f[self.ends[k], None], self.x[legs[k]])
            for k in (0, 1)
        ]
        soft = self.f[rows], self.f[rows]
        blocks = [own, mixed, mixed[::-1], *slopes, *(s[::-1] for s in slopes), soft]
        self.r, self.c = (
            np.concatenate([np.ravel(b[k]) for b in blocks]) for k in (0, 1)
        )
        self.band = int(np.abs(self.r - self.c).max(initial=0))
        self._height = 3 * self.band + 1
        self._flat = self.c * self._height + 2 * self.band + self.r - self.c
        self._lay_coordinates(energy, row_pairs[rows])

    def _lay_coordinates(self, energy: ToolEnergy, ends: Indices) -> None:
        """Places of the coordinates alone, for the band without rows."""
        rank = np.zeros(self.x.shape, dtype=np.int64)
        used = self.x[self.cups].ravel()
        order = np.empty(used.size, dtype=np.int64)
        order[np.argsort(used)] = np.arange(used.size)
        rank[self.cups] = order.reshape(-1, 5)
        i, j = energy.pairs[self.pairs].T
        lower = np.tril_indices(5)
        own = rank[self.cups][:, lower[0]], rank[self.cups][:, lower[1]]
        mixed = np.broadcast_arrays(rank[i, :, None], rank[j, None])
        r, c = (np.concatenate([own[k].ravel(), mixed[k].ravel()]) for k in (0, 1))
        r, c = np.maximum(r, c), np.minimum(r, c)
        self._held_shape = used.size, int((r - c).max(initial=0)) + 1
        self._held = c * self._held_shape[1] + r - c
        self._lower = PASSIVE[lower[0]], PASSIVE[lower[1]]
        self._row_ends, self._row_pair = ends, energy.row_pair[self.rows]

    def held(self, terms: ToolTerms, stiffness: float) -> Array:
        """H with the rows in force held by springs, as LAPACK's lower band.

        Args:
            terms: Energy of the tool.
            stiffness: Of the springs, [N/m].

        Returns:
            H + stiffness J^T J, shape (bands, k), in Fortran's order.
        """
        own, mixed, rows = terms.own.copy(), terms.mixed.copy(), terms.rows[self.rows]
        first, second = rows[:, 0], rows[:, 1]
        for k, side in enumerate((first, second)):
            square = stiffness * side[:, :, None] * side[:, None]
            np.add.at(own, self._row_ends[:, k], square)
        product = stiffness * first[:, :, None] * second[:, None]
        np.add.at(mixed, self._row_pair, product)
        lower = own[self.cups][:, self._lower[0], self._lower[1]].ravel()
        between = mixed[self.pairs][:, PASSIVE[:, None], PASSIVE].ravel()
        band = np.zeros(self._held_shape)
        band.ravel()[self._held] = np.concatenate([lower, between])
        return band.T

    def entries(self, terms: ToolTerms) -> Array:
        """Values of the entries, in the order of `r` and `c`."""
        own = terms.own[self.cups][:, PASSIVE[:, None], PASSIVE].ravel()
        mixed = terms.mixed[self.pairs][:, PASSIVE[:, None], PASSIVE].ravel()
        slopes = [terms.rows[self.ends[k], k][:, PASSIVE].ravel() for k in (0, 1)]
        soft = np.full(len(self.rows), -SOFT)
        return np.concatenate([own, mixed, mixed, *slopes, *slopes, soft])

    def dense(self, terms: ToolTerms) -> tuple[Array, Array]:
        """H and J as dense arrays.

        Args:
            terms: Energy of the tool.

        Returns:
            H, shape (k, k), and J, shape (rows in force, k), for the k passive
            coordinates of the free legs in the order of their cups.
        """
        matrix = np.zeros((self.size, self.size))
        matrix[self.r, self.c] = self.entries(terms)
        x, f = self.x[self.cups].ravel(), self.f[self.rows]
        return matrix[x[:, None], x], matrix[f[:, None], x]

    def factor(self, terms: ToolTerms) -> "Factor":
        """Factor the system.

        Args:
            terms: Energy of the tool.

        Raises:
            SingularError: A pivot is zero.
        """
        band = np.zeros((self.size, self._height))
        band.ravel()[self._flat] = self.entries(terms)
        lu, pivots, info = dgbtrf(band.T, self.band, self.band, overwrite_ab=1)
        if info:
            raise SingularError
        return Factor(lu, pivots, self.band)


class Factor:
    """A factored system."""

    def __init__(self, lu: Array, pivots: NDArray[np.int32], band: int) -> None:
        """Keep LAPACK's factors."""
        self._lu, self._pivots, self._band = lu, pivots, band

    def solve(self, right: Array) -> Array:
        """Solution for one right-hand side, shape (size,), or several, (size, k)."""
        if not right.size:
            return right
        solution: Array = dgbtrs(self._lu, self._band, self._band, right, self._pivots)[
            0
        ]
        return solution


class Layouts:
    """Layouts of one tool, kept for the sets of free legs and rows that come back."""

    def __init__(self, rows: int, columns: int, energy: ToolEnergy) -> None:
        """Fix the sweep: along the short side of the grid."""
        cup = np.arange(rows * columns)
        i, j = np.divmod(cup, columns)
        self._order = cup if columns <= rows else j * rows + i
        self._energy = energy
        self._kept: dict[tuple[bytes, bytes], Layout] = {}

    def __call__(self, free: Mask, active: Mask) -> Layout:
        """Layout for a set of free legs, shape (n,), and rows in force, shape (r,)."""
        key = free.tobytes(), active.tobytes()
        if key not in self._kept:
            if len(self._kept) >= KEPT:
                self._kept.pop(next(iter(self._kept)))
            self._kept[key] = Layout(self._order, self._energy, free, active)
        return self._kept[key]
