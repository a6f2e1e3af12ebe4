r"""Interlinks and fiber chords: distances between points that ride on two cups.

The distance of two points, :math:`|x_j - x_i|`, changes with a coordinate of a leg by
the velocity of the point on that leg along the line, :math:`e \cdot (v + \omega \times
x)` with the unit vector e from x_i to x_j and the coordinate's spatial twist
:math:`(v, \omega)`. As :math:`e \cdot (\omega \times x) = \omega \cdot (x \times e)`,
that is the twist times the wrench :math:`w = (e, x \times e)`; both points lie on its
line, so one wrench serves both cups:

.. math::
    \partial |x_j - x_i| / \partial q_i = - J_i w, \qquad
    \partial |x_j - x_i| / \partial q_j = J_j w.

The arm moves both points as one body: its columns are exactly zero and not stored.
"""

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from drapeplan.legs import Array, cross
from drapeplan.robot import Robot, State
from urdf.sidecar import neighbor_pairs


class AbstractDistances(ABC):
    """Distances between points fixed to pairs of cups, less a constant.

    The pattern of the Jacobian is fixed: one row holds the six coordinates of either
    cup's own leg, in the order of q.

    Attributes:
        pairs: Indices of both cups, shape (m, 2).
        columns: Places in q of the stored columns of each row, shape (m, 12).
    """

    def __init__(self, robot: Robot) -> None:
        """Fix the pattern.

        Args:
            robot: Gives the pairs, and the places of the legs' coordinates in q.
        """
        self.pairs, self._points, self._rest = self._layout(robot)
        columns = robot.leg_columns[self.pairs].reshape(-1, 12)
        self._order = np.argsort(columns, axis=1)
        self.columns = np.take_along_axis(columns, self._order, axis=1)
        self._indices = self.columns.ravel().astype(np.int32)
        self._starts = np.arange(0, columns.size + 1, 12, dtype=np.int32)
        self._shape = len(columns), robot.nq

    @staticmethod
    @abstractmethod
    def _layout(robot: Robot) -> tuple[NDArray[np.int64], Array, float]:
        """Lay the distances out.

        Returns:
            Indices of both cups, shape (m, 2); both points in their cup's directions
            s, t, n from the center of the suction face, shape (m, 2, 3), in [m]; what
            is taken off every distance, [m].
        """

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.pairs)

    def ends(self, positions: Array, rotations: Array) -> Array:
        """Both ends of every distance in the world.

        Args:
            positions: Centers of the suction faces, shape (..., n, 3), in [m].
            rotations: Columns are the directions of s, t and n, shape (..., n, 3, 3).

        Returns:
            Points, shape (..., m, 2, 3), in [m].
        """
        arms = rotations[..., self.pairs, :, :] @ self._points[..., None]
        points: Array = positions[..., self.pairs, :] + arms[..., 0]
        return points

    def values(self, positions: Array, rotations: Array) -> Array:
        """Distances less the constant.

        Args:
            positions: Centers of the suction faces, shape (..., n, 3), in [m].
            rotations: Columns are the directions of s, t and n, shape (..., n, 3, 3).

        Returns:
            Values, shape (..., m), in [m].
        """
        ends = self.ends(positions, rotations)
        gap = ends[..., 1, :] - ends[..., 0, :]
        return np.sqrt(np.sum(gap * gap, axis=-1)) - self._rest

    def gradients(self, state: State) -> Array:
        """Derivatives by the coordinates of both legs, in the order of `columns`.

        Points that coincide have no direction between them; their rows are zero.

        Args:
            state: Kinematics of n cups.

        Returns:
            Derivatives, shape (m, 12), in [m/rad], or [-] by a stroke.
        """
        ends = self.ends(state.positions, state.rotations)
        gap = ends[:, 1] - ends[:, 0]
        length = np.sqrt(np.sum(gap * gap, axis=1))[:, None]
        e = gap / np.where(length > 0, length, 1.0)
        wrench = np.concatenate([e, cross(ends[:, 0], e)], axis=1)
        rates = (state.leg_twists[self.pairs] @ wrench[:, None, :, None])[..., 0]
        rates[:, 0] *= -1
        return np.take_along_axis(rates.reshape(-1, 12), self._order, axis=1)

    def jacobian(self, state: State) -> sparse.csr_matrix:
        """Derivatives by the whole configuration.

        Args:
            state: Kinematics of n cups.

        Returns:
            Sparse matrix of shape (m, nq), in [m/rad], or [-] by a stroke; its pattern
            is the same at every state.
        """
        data = self.gradients(state).ravel()
        pattern = self._indices.copy(), self._starts.copy()
        matrix = sparse.csr_matrix((data, *pattern), shape=self._shape)
        matrix.has_sorted_indices = matrix.has_canonical_format = True
        return matrix


class Closures(AbstractDistances):
    """Interlinks: distance of their ends less their length, zero where they hold.

    Ends lie on the cups' axes, the sidecar's height above the suction face. Resilient
    links bend, which the equilibrium counts, but keep their length all the same.
    """

    @staticmethod
    def _layout(robot: Robot) -> tuple[NDArray[np.int64], Array, float]:
        """Links of the robot's tool."""
        links = robot.tool.interlinks
        points = np.zeros((len(links.pairs), 2, 3))
        points[..., 2] = links.height
        return links.pairs, points, links.length


class Chords(AbstractDistances):
    """Chords of the fibers along both rims of the strips between neighboring cups.

    Rows 2k and 2k + 1 belong to neighbor pair k (all pairs along s, then along t), at
    the lateral offsets -half_width and +half_width. A fiber runs from the near edge of
    one held square to the near edge of the next; it is as long as pitch less two half
    widths, so a chord beyond that, and the weave's take-up, stretches it.
    """

    @staticmethod
    def _layout(robot: Robot) -> tuple[NDArray[np.int64], Array, float]:
        """Two fibers on every neighbor pair of the robot's grid."""
        d = robot.half_width
        pairs = np.repeat(neighbor_pairs(robot.rows, robot.columns), 2, axis=0)
        along = (pairs[:, 1] - pairs[:, 0] != 1).astype(int)  # 0: along s, 1: along t
        row = np.arange(len(pairs))
        points = np.zeros((len(pairs), 2, 3))
        points[row, :, along] = [d, -d]
        points[row, :, 1 - along] = np.where(row % 2, d, -d)[:, None]
        return pairs, points, 0.0
