"""Weight of the tool's legs, with all that hangs on their cups."""

import numpy as np

from drapeplan.legs import Array, cross
from drapeplan.robot import Robot
from drapeplan.twists import chain_curvature, skew


class ToolWeight:
    """Bodies of all legs; masses and centers of mass are those of the URDF.

    Half of each interlink hangs at its end on the cup's axis, the ply of one pitch by
    one pitch in the suction face: both ride on the last body of the leg.
    """

    def __init__(self, robot: Robot, areal_mass: float) -> None:
        """Read the masses.

        Args:
            robot: Arm and tool.
            areal_mass: Of the ply, [kg/m2].
        """
        model, links = robot.model, robot.tool.interlinks
        self._geometry = robot.geometry
        self._gravity = -np.asarray(model.gravity.linear)
        joints = [[model.getJointId(name) for name in leg] for leg in robot.leg_names]
        mass = np.array([[model.inertias[k].mass for k in leg] for leg in joints])
        lever = np.array([[model.inertias[k].lever for k in leg] for leg in joints])
        moment = mass[:, :, None] * lever
        ends = np.bincount(links.pairs.ravel(), minlength=robot.n_cups) * links.mass / 2
        ply, drop = areal_mass * robot.pitch**2, robot.geometry.ball_height
        mass[:, 5] += ends + ply
        moment[:, 5, 2] += ends * (drop - links.height) + ply * drop
        center = moment / np.where(mass > 0, mass, 1.0)[:, :, None]
        self._bodies = [
            (k, mass[:, k].copy(), center[:, k].copy())
            for k in range(6)
            if k == 5 or mass[:, k].any()
        ]

    def add(
        self,
        poses: tuple[Array, Array],
        twists: Array,
        legs: Array,
        on_cup: Array,
        curved: Array,
    ) -> tuple[float, Array, Array]:
        """Weight of all bodies, and what else pulls on the cups, by coordinates.

        Args:
            poses: Cup positions, shape (n, 3), in [m], and rotations, shape (n, 3, 3).
            twists: Of the legs' coordinates, shape (n, 6, 6).
            legs: The coordinates, shape (n, 6).
            on_cup: Wrench on each cup besides its weight, shape (n, 6).
            curved: C of docs/derivations.md, D20, of the same, shape (n, 6, 6).

        Returns:
            Energy of the weight above the world's origin, [J]; gradient of all, shape
            (n, 6); second derivatives within each leg, shape (n, 6, 6).
        """
        energy, n = 0.0, len(legs)
        gradient, own = np.zeros((n, 6)), np.zeros((n, 6, 6))
        for level, mass, x in self._centers(poses, twists, legs):
            k = level + 1
            force = mass[:, None] * self._gravity
            energy += float(np.sum(force * x))
            wrench = np.concatenate([force, cross(x, force)], axis=1)
            F = skew(force)
            mixed = np.zeros((n, 6, 6))
            mixed[:, 3:, :3], mixed[:, 3:, 3:] = F, -F @ skew(x)
            if level == 5:
                wrench, mixed = wrench + on_cup, mixed + curved
            gradient[:, :k] += (twists[:, :k] @ wrench[..., None])[..., 0]
            own[:, :k, :k] += chain_curvature(twists[:, :k], mixed)
        return energy, gradient, own

    def _centers(
        self, poses: tuple[Array, Array], twists: Array, legs: Array
    ) -> list[tuple[int, Array, Array]]:
        """Last coordinate that moves it, mass and center in the world of every body.

        Axes of its frame are read from the twists: uy turns about the y axis of the
        frame before it, sx about the x axis of the leg, the stroke runs along z.
        """
        a, z = twists[..., 3:], twists[:, 2, :3]
        (p, R), leg_min = poses, self._geometry.leg_min
        ball = p + self._geometry.ball_height * R[:, :, 2]
        universal = ball - (leg_min + legs[:, 2])[:, None] * z
        found = []
        for level, mass, lever in self._bodies:
            if level == 5:
                axes = R[:, :, 0], -R[:, :, 1], -R[:, :, 2]
            elif level == 4:
                axes = cross(a[:, 4], a[:, 5]), a[:, 4], a[:, 5]
            elif level == 3:
                axes = a[:, 3], a[:, 4], cross(a[:, 3], a[:, 4])
            elif level == 0:
                axes = a[:, 0], a[:, 1], cross(a[:, 0], a[:, 1])
            else:
                axes = a[:, 3], cross(z, a[:, 3]), z
            arm = (np.stack(axes, axis=2) @ lever[..., None])[..., 0]
            found.append((level, mass, (universal if level < 2 else ball) + arm))
        return found
