"""Tools small enough for dense and independent solutions, and poses of them."""

import numpy as np

from drapeplan.robot import Robot, arm_description
from drapeplan.tool_energy import ToolPhysics
from urdf.generate import tool_sidecar, tool_urdf
from urdf.spec import ToolSpec

PLY = ToolPhysics(bending=0.02, areal_mass=0.31, longest_fiber=0.0708)


def small_tool(**fields):
    """Arm and tool of 3 columns by 4 rows."""
    spec = ToolSpec("small", rows=4, columns=3, **fields)
    return Robot(arm_description("ur10"), tool_urdf(spec), tool_sidecar(spec))


def rich_tool():
    """A small tool with everything that can give: springs, bent links off the face."""
    return small_tool(
        interlink_kind="resilient",
        interlink_bending_stiffness=0.1,
        interlink_height=0.007,
        universal_stiffness=0.02,
        ball_stiffness=0.03,
        yaw_stiffness=0.04,
    )


def random_legs(robot, rng):
    """Coordinates of all legs, well within their range, shape (n, 6)."""
    scale = [0.1, 0.1, 0.03, 0.2, 0.2, 0.2]
    return robot.home()[robot.leg_columns] + rng.normal(size=(robot.n_cups, 6)) * scale


def shaped(robot, radius_s, radius_t, fixed_cup):
    """Home with strokes that put the cups on a paraboloid, shape (nq,).

    Args:
        robot: Arm and tool.
        radius_s: Of curvature along s, [m]; positive: the middle is nearest the arm.
        radius_t: Along t, [m].
        fixed_cup: Cup whose stroke stays.
    """
    q, n = robot.home(), np.arange(robot.n_cups)
    i, j = np.divmod(n, robot.columns)
    x = (j - (robot.columns - 1) / 2) * robot.pitch
    y = (i - (robot.rows - 1) / 2) * robot.pitch
    z = -(x * x) / (2 * radius_s) - y * y / (2 * radius_t)
    q[robot.leg_columns[:, 2]] -= z - z[fixed_cup]
    return q
