"""The tool at rest by another road: free poses of all cups, no leg coordinates.

Unknowns are the position and the turn of every cup; what holds them are the lengths of
legs, interlinks and taut fibers. Tubes and rods lie on the lines from the universal
joints to the balls. Derivatives are complex steps, exact to rounding, so this shares
neither kinematics nor derivatives with what it checks.
"""

import numpy as np

TINY = 1e-30  # complex step
AFRESH = 1e-3  # [m, rad] moves after which second derivatives are kept
COARSE = 1e-6  # [m, rad] central differences of exact gradients


class CartesianTool:
    """Energy and lengths of a tool in the cups' poses."""

    def __init__(self, robot, physics, q, taut):
        """Read what the other side reads, nothing that it computes."""
        self.robot, self.ply = robot, physics
        T = robot.arm_forward(q[robot.arm_columns])
        self.U = robot.geometry.universals @ T[:3, :3].T + T[:3, 3]
        self.reach = robot.geometry.leg_min + q[robot.leg_columns[:, 2]]
        self.taut = taut
        cup = np.arange(robot.n_cups).reshape(robot.rows, robot.columns)
        s_ends, t_ends = (cup[:, :-1], cup[:, 1:]), (cup[:-1], cup[1:])
        self.first, self.second = (
            np.concatenate([s_ends[k].ravel(), t_ends[k].ravel()]) for k in (0, 1)
        )
        self.along = np.repeat([0, 1], [s_ends[0].size, t_ends[0].size])

    def poses(self, x, start):
        """Positions and rotations after moves x, shape (..., n, 6)."""
        p, R = start
        return p + x[..., :3], exponential(x[..., 3:]) @ R

    def rims(self, p, R):
        """Vectors along both rims of all strips, shape (..., strips, 2, 3)."""
        d, cups = self.robot.half_width, (self.first, self.second)
        edges = []
        for cup, way in zip(cups, (d, -d), strict=True):
            middle = p[..., cup, :] + way * R[..., cup, :, self.along].swapaxes(0, -2)
            across = d * R[..., cup, :, 1 - self.along].swapaxes(0, -2)
            edges.append(np.stack([middle - across, middle + across], axis=-2))
        return edges[1] - edges[0]

    def energy(self, p, R):
        """Potential energy, shape (...), in [J]."""
        tool, ply = self.robot.tool, self.ply
        d, L = tool.half_width, tool.pitch - 2 * tool.half_width
        n = R[..., 2]
        ball = p + tool.ball_height * n
        line = ball - self.U
        line = line / np.sqrt(np.sum(line * line, axis=-1, keepdims=True))
        masses, total = bodies(self.robot), 0.0
        tube, rod, cup = masses
        total = total + 9.81 * tube[0] * np.sum((self.U + tube[1] * line)[..., 2], -1)
        total = total + 9.81 * rod[0] * np.sum((ball + rod[1] * line)[..., 2], -1)
        total = total + 9.81 * cup[0] * np.sum((ball - cup[1] * n)[..., 2], -1)
        total = total + 9.81 * ply.areal_mass * tool.pitch**2 * np.sum(p[..., 2], -1)
        links = tool.interlinks
        ends = (p + links.height * n)[..., links.pairs, 2]
        total = total + 9.81 * links.mass / 2 * np.sum(ends, axis=(-1, -2))
        rims, slopes = self.rims(p, R), []
        for cup in (self.first, self.second):
            slopes.append(-np.sum(n[..., cup, None, :] * rims, -1) / L)
            lateral = R[..., cup, :, 1 - self.along].swapaxes(0, -2)[..., None, :]
            y = np.sum(lateral * rims, -1) / L
            total = total + ply.yaw / 4 * np.sum(y * y, (-1, -2))
        s0, s1 = slopes
        bent = np.sum(s0 * s0 + s0 * s1 + s1 * s1, (-1, -2))
        total = total + 2 * ply.bending * d / L * bent
        if links.bending_stiffness:
            a, b = links.pairs.T
            height = links.height * n
            line = (p + height)[..., b, :] - (p + height)[..., a, :]
            s0, s1 = (np.sum(n[..., c, :] * line, -1) / links.length for c in (a, b))
            EI = links.bending_stiffness * 2 * d
            bent = np.sum(s0 * s0 + s0 * s1 + s1 * s1, -1)
            total = total + 2 * EI / links.length * bent
        return total

    def lengths(self, p, R):
        """What must vanish: legs, interlinks, taut fibers, shape (..., k), in [m]."""
        tool = self.robot.tool
        legs = p + tool.ball_height * R[..., 2] - self.U
        ends = p + tool.interlinks.height * R[..., 2]
        first, second = tool.interlinks.pairs.T
        links = ends[..., second, :] - ends[..., first, :]
        rims = self.rims(p, R).reshape(*p.shape[:-2], -1, 3)[..., self.taut, :]
        bounds = self.reach, tool.interlinks.length, self.ply.longest_fiber
        return np.concatenate(
            [
                np.sqrt(np.sum(v * v, axis=-1)) - bound
                for v, bound in zip((legs, links, rims), bounds, strict=True)
            ],
            axis=-1,
        )

    def slopes(self, x, start):
        """Gradient of the energy, shape (6 n,), and of the lengths, (k, 6 n)."""
        steps = x + 1j * TINY * np.eye(x.size).reshape(-1, *x.shape)
        poses = self.poses(steps, start)
        return self.energy(*poses).imag / TINY, self.lengths(*poses).imag.T / TINY

    def rest(self, p, R, fixed, rounds=20):
        """Poses at rest and the forces in what holds them, by Newton's method."""
        free = np.repeat(~fixed, 6)
        forces, x = np.zeros(self.lengths(p, R).shape[-1]), np.full(1, np.inf)
        for _ in range(rounds):
            zero = np.zeros((len(p), 6))
            g, J = self.slopes(zero, (p, R))
            gap = self.lengths(p, R)
            live = np.abs(J[:, free]).max(axis=1) > 0
            A, columns = J[np.ix_(live, free)], []
            forces[live] = np.linalg.lstsq(A.T, -g[free], rcond=None)[0]
            if np.abs(x).max() > AFRESH:
                for k in np.flatnonzero(free):
                    ends = []
                    for way in (COARSE, -COARSE):
                        step = zero.ravel().copy()
                        step[k] = way
                        g_k, J_k = self.slopes(step.reshape(-1, 6), (p, R))
                        ends.append(g_k + J_k.T @ forces)
                    columns.append((ends[0] - ends[1])[free] / (2 * COARSE))
                H, m = np.array(columns), len(A)
            K = np.block([[(H + H.T) / 2, A.T], [A, np.zeros((m, m))]])
            move = np.linalg.solve(K, -np.concatenate([g[free], gap[live]]))
            x = zero.ravel().copy()
            x[free] = move[: len(A.T)]
            p, R = self.poses(x.reshape(-1, 6), (p, R))
            if np.abs(x).max() < 1e-11:
                break
        return p, R, forces


def exponential(w):
    """Rotations of small vectors, entire in w, so that complex steps pass."""
    W = np.zeros((*w.shape, 3), w.dtype)
    W[..., 0, 1], W[..., 0, 2], W[..., 1, 2] = -w[..., 2], w[..., 1], -w[..., 0]
    W = W - np.swapaxes(W, -1, -2)
    total, term = np.eye(3) + 0 * W, np.eye(3) + 0 * W
    for k in range(1, 9):
        term = term @ W / k
        total = total + term
    return total


def bodies(robot):
    """Mass and center along the leg of tube, rod and cup; z as in the URDF."""
    model = robot.model
    found = []
    for name in (robot.leg_names[0][k] for k in (1, 2, 5)):
        inertia = model.inertias[model.getJointId(name)]
        found.append((inertia.mass, inertia.lever[2]))
    return found
