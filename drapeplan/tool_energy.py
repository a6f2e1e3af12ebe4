r"""Energy of the hanging tool: weight, ply, interlinks and springs, and what they pull.

Everything between two neighboring cups depends on their relative pose alone, so it is
told by two arrays a pair: the wrench W on the second cup (the first gets -W) and the
mixed second derivative C by the twists of first and second cup, 6 x 6. With the twists
T of a cup's own leg as rows, the second derivatives by the coordinates of both legs are

.. math::
    H_{ij} = T_i C T_j^T, \qquad
    H_{jj}[a, b] = -(T_j C T_j^T)[a, b], \qquad
    H_{ii}[a, b] = -(T_i C T_i^T)[b, a] \qquad (a \le b),

since a motion of both cups as one body changes nothing; docs/derivations.md, D20.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drapeplan.legs import Array, LegGeometry, cross, cup_poses, leg_twists
from drapeplan.robot import Robot
from drapeplan.tool_weight import ToolWeight
from drapeplan.twists import point_velocity, skew
from urdf.sidecar import neighbor_pairs

Indices = NDArray[np.int64]

PASSIVE = np.array([0, 1, 3, 4, 5])  # coordinates of a leg that nothing drives
YAW = 0.1  # [N m/rad] in-plane stiffness of a strip: assumed, woven prepreg


@dataclass(frozen=True)
class ToolPhysics:
    """What the equilibrium knows of the ply.

    Attributes:
        bending: Bending stiffness of the ply, [N m].
        areal_mass: Mass of the ply, [kg/m2].
        longest_fiber: Free length of a fiber plus its take-up, [m].
        yaw: Stiffness of a strip against a turn of a cup in its plane, [N m/rad].
    """

    bending: float
    areal_mass: float
    longest_fiber: float
    yaw: float = YAW


@dataclass(frozen=True)
class ToolTerms:
    """Energy of the tool at one pose of it, with forces in its rows.

    Rows are the distances that links and fibers bound: first the interlinks, then the
    rim chords of the strips.

    Attributes:
        positions: Centers of the suction faces, shape (n, 3), in [m].
        twists: Of each leg's coordinates, shape (n, 6, 6).
        energy: Without the rows' forces, [J].
        gradient: By the legs' coordinates, forces of the rows included, shape (n, 6),
            in [N m], or [N] by a stroke.
        lengths: Distances of the rows, shape (r,), in [m].
        rows: Their derivatives by the legs of both cups, shape (r, 2, 6).
        own: Second derivatives within each leg, shape (n, 6, 6).
        mixed: Second derivatives between the legs of each pair, shape (m, 6, 6).
    """

    positions: Array
    twists: Array
    energy: float
    gradient: Array
    lengths: Array
    rows: Array
    own: Array
    mixed: Array


@dataclass(frozen=True)
class _Bands:
    """Elastic bands between points of two cups, clamped to both.

    With d from first to second point, u a direction of a cup (its normal, or the one
    across the band in its plane), the energy is that of a cubic with the end slopes
    -u . d / L, and of independent springs in the plane.

    Attributes:
        pair: Index of the neighbor pair, shape (b,).
        points: Indices of both points, shape (b, 2).
        bend: 2 E I / L^3, [N/m].
        turn: In-plane stiffness over L^2, [N/m].
    """

    pair: Indices
    points: Indices
    bend: float
    turn: float


class ToolEnergy:
    """Energy of one tool with one ply; all that is fixed is laid out once.

    Attributes:
        pairs: Indices of neighboring cups, shape (m, 2), in the order of Chords.
        row_pairs: Cups of each row, shape (r, 2): interlinks, then rim chords.
        row_pair: Index of each row's pair, shape (r,).
        n_links: Number of interlinks.
        shortest: Least distance of each row, shape (r,), in [m].
        longest: Largest distance of each row, shape (r,), in [m].
    """

    def __init__(self, robot: Robot, physics: ToolPhysics) -> None:
        """Lay the tool out.

        Args:
            robot: Arm and tool.
            physics: The ply.
        """
        self.geometry: LegGeometry = robot.geometry
        self.pairs = neighbor_pairs(robot.rows, robot.columns)
        links = robot.tool.interlinks
        self._lay_points(robot)
        self._lay_rows(robot, physics)
        width, span = robot.half_width, robot.pitch - 2 * robot.half_width
        every = np.arange(len(self.pairs))
        self._bands = [
            _Bands(
                np.repeat(every, 2),
                self._row_points[self.n_links :],
                2 * physics.bending * width / span**3,
                physics.yaw / 2 / span**2,
            )
        ]
        if links.bending_stiffness > 0:
            stiffness = 2 * links.bending_stiffness * 2 * width / links.length**3
            points = self._row_points[: self.n_links]
            self._bands.append(
                _Bands(self.row_pair[: len(points)], points, stiffness, 0.0)
            )
        tool = robot.tool
        springs = [tool.universal_stiffness] * 2 + [0.0] + [tool.ball_stiffness] * 2
        self._springs = np.array([*springs, tool.yaw_stiffness])
        self._weight = ToolWeight(robot, physics.areal_mass)

    def _lay_points(self, robot: Robot) -> None:
        """Corners of the held squares and ends of the links, in cup coordinates."""
        d, height = robot.half_width, robot.tool.interlinks.height
        corners = [[x * d, y * d, 0.0] for y in (-1, 1) for x in (-1, 1)]
        self._anchors = np.array([*corners, [0.0, 0.0, height]])
        m, n = len(self.pairs), robot.n_cups
        first, second = np.zeros((2, n, m))
        first[self.pairs[:, 0], range(m)] = second[self.pairs[:, 1], range(m)] = 1.0
        self._first, self._second = first, second

    def _lay_rows(self, robot: Robot, physics: ToolPhysics) -> None:
        """Points, cups and bounds of interlinks and rim chords."""
        links, pairs, count = robot.tool.interlinks, self.pairs, len(self._anchors)
        joined = np.sort(links.pairs, axis=1)
        key = pairs @ [robot.n_cups, 1]
        place = np.searchsorted(np.sort(key), joined @ [robot.n_cups, 1])
        link_pair = np.argsort(key)[place]
        self.n_links = len(joined)
        along_t = (pairs[:, 1] - pairs[:, 0] != 1) * 1
        near = np.array([[[1, 3], [0, 2]], [[2, 3], [0, 1]]])[along_t]  # pair, end, rim
        rims = pairs[:, :, None] * count + near
        self._across = 1 - along_t  # index of the direction across the strip
        self.row_pair = np.concatenate([link_pair, np.repeat(np.arange(len(pairs)), 2)])
        self._row_points = np.concatenate(
            [joined * count + count - 1, rims.swapaxes(1, 2).reshape(-1, 2)]
        )
        self.row_pairs = pairs[self.row_pair]
        fibers = (
            np.zeros(2 * len(pairs)),
            np.full(2 * len(pairs), physics.longest_fiber),
        )
        low, high = (np.full(self.n_links, x) for x in (links.shortest, links.longest))
        self.shortest, self.longest = np.concatenate([[low, high], fibers], axis=1)

    def evaluate(self, T_world_tool: Array, legs: Array, forces: Array) -> ToolTerms:
        """Energy and its derivatives at one pose of the tool.

        Args:
            T_world_tool: Placement of tool0, shape (4, 4), in [m].
            legs: ux, uy, stroke, sx, sy, sz, shape (n, 6), in [rad] and [m].
            forces: Tension in every row, shape (r,), in [N].

        Returns:
            The terms.
        """
        p, R = cup_poses(self.geometry, T_world_tool, legs)
        T = leg_twists(self.geometry, T_world_tool, legs)
        points = (p[:, None] + self._anchors @ R.swapaxes(1, 2)).reshape(-1, 3)
        wrench, mixed = (
            np.zeros((len(self.pairs), 6)),
            np.zeros((len(self.pairs), 6, 6)),
        )
        lengths, row_wrench = self._rows(points, forces, wrench, mixed)
        energy = sum(self._band(b, points, R, wrench, mixed) for b in self._bands)
        on_cup = self._second @ wrench - self._first @ wrench
        flat, turned = mixed.reshape(-1, 36), mixed.swapaxes(1, 2).reshape(-1, 36)
        curved = (self._second @ flat + self._first @ turned).reshape(-1, 6, 6)
        fall, gradient, own = self._weight.add((p, R), T, legs, on_cup, curved)
        energy += fall
        energy += float(np.sum(self._springs * legs * legs)) / 2
        gradient += self._springs * legs
        own[:, range(6), range(6)] += self._springs
        i, j = self.pairs.T
        mixed = T[i] @ mixed @ T[j].swapaxes(1, 2)
        rows = (T[self.row_pairs] @ row_wrench[:, None, :, None])[..., 0]
        rows[:, 0] *= -1
        return ToolTerms(p, T, energy, gradient, lengths, rows, own, mixed)

    def _rows(
        self, points: Array, forces: Array, wrench: Array, mixed: Array
    ) -> tuple[Array, Array]:
        """Lengths and unit wrenches of the rows; adds what their forces do."""
        x, y = points[self._row_points.T]
        d = y - x
        length = np.sqrt(np.sum(d * d, axis=1))
        e = d / np.where(length > 0, length, 1.0)[:, None]
        unit = np.concatenate([e, cross(x, e)], axis=1)
        taut = np.flatnonzero(forces)
        if taut.size:
            pair, w = self.row_pair[taut], unit[taut]
            once = int(np.searchsorted(taut, self.n_links))  # links: one a pair
            _gather(wrench, pair, forces[taut, None] * w, once)
            product = point_velocity(x[taut]).swapaxes(1, 2) @ point_velocity(y[taut])
            share = forces[taut] / length[taut]
            C = share[:, None, None] * (w[:, :, None] * w[:, None, :] - product)
            _gather(mixed, pair, C, once)
        return length, unit

    def _band(
        self, band: _Bands, points: Array, R: Array, wrench: Array, mixed: Array
    ) -> float:
        """Energy of bands; adds their wrenches and mixed second derivatives."""
        i, j = self.pairs[band.pair].T
        across = self._across[band.pair]
        x, y = points[band.points.T]
        d = (y - x)[:, None]
        u = np.stack([R[i, :, 2], R[i, :, across]], axis=1)  # of the first cup
        v = np.stack([R[j, :, 2], R[j, :, across]], axis=1)
        first, second = np.sum(u * d, axis=2), np.sum(v * d, axis=2)
        k = np.array([band.bend, 0.0])
        own = np.array([2 * band.bend, band.turn])
        f, g = own * first + k * second, own * second + k * first
        fu, gv = np.sum(f[..., None] * u, axis=1), np.sum(g[..., None] * v, axis=1)
        added = np.concatenate([fu + gv, cross(y, fu) + cross(x, gv)], axis=1)
        a = np.concatenate([u, cross(y[:, None], u)], axis=2)  # d (u . d) / d twist
        b = np.concatenate([v, cross(x[:, None], v)], axis=2)
        own, k = own[:, None], k[:, None]
        left = np.concatenate([a, b], axis=1)
        right = np.concatenate([own * a + k * b, own * b + k * a], axis=1)
        C = -(left.swapaxes(1, 2) @ right)
        U, V = skew(fu), skew(gv)
        C[:, :3, 3:] += V
        C[:, 3:, :3] += U
        C[:, 3:, 3:] += skew(x) @ V - U @ skew(y)
        if len(band.pair) == 2 * len(wrench):  # the rims of a strip follow one another
            wrench += added.reshape(-1, 2, 6).sum(axis=1)
            mixed += C.reshape(-1, 2, 6, 6).sum(axis=1)
        else:
            _gather(wrench, band.pair, added, len(C))
            _gather(mixed, band.pair, C, len(C))
        return float(np.sum(f * first) + np.sum(g * second)) / 2


def _gather(total: Array, pair: Indices, part: Array, once: int) -> None:
    """Add parts to their pairs, quickly where no pair comes twice.

    Args:
        total: By pair, shape (m, ...); added to.
        pair: Of each part, shape (k,); no pair comes twice among the first `once`.
        part: Shape (k, ...).
        once: How many there are of these.
    """
    total[pair[:once]] += part[:once]
    if once < len(pair):
        np.add.at(total, pair[once:], part[once:])
