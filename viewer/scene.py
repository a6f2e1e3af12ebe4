"""From a plan of drapeplan to the plain arrays that the page is made from."""

from pathlib import PurePath
from typing import Any

import numpy as np

from drapeplan.cell import Cell
from drapeplan.contact import front_tolerance
from drapeplan.mold import HeightGrid
from drapeplan.plan import Plan
from drapeplan.scene import Scene
from drapeplan.track import Track
from drapeplan.visuals import ArmVisuals, arm_visuals
from drapeplan.words import describe
from urdf.sidecar import neighbor_pairs
from viewer import findings
from viewer.geometry import bounds, grid_triangles
from viewer.plan_view import BESIDE, Mesh, PlanView
from viewer.statements import facts, statements

__all__ = ["PlanView", "view_of"]

Array = np.ndarray

NODES = 101  # of the drawn mold along each side: 10 mm on a mold of 1 m
RIM = 0.04  # [m] of the platform beyond the outer universal joints
TABLE_RIM = 0.02  # [m] of the pick table beyond the ply
TABLE_DROP = 2e-3  # [m] of the drawn table below the ply, so that both can be seen


def view_of(plan: Plan) -> PlanView:
    """Everything the preview shows of a plan.

    Args:
        plan: The plan; its verdict is shown as recomputed, whatever the file says.

    Returns:
        One pose for each waypoint. After the wave the ply stays as it was laid.
    """
    found = {**plan.document, "verdict": plan.judged[0]}
    plan = Plan(found).known(plan.cell, plan.judged)
    cell, track = plan.cell, plan.track
    fibers = findings.long_fibers(plan)
    told = statements(plan, fibers)
    names, strip_rungs = findings.rungs(plan)
    return PlanView(
        subtitle=(
            f"Ply model {plan.verdict['ply_model']['model']}, "
            f"fidelity {plan.verdict['fidelity']}, {size_of(cell)}"
        ),
        verdict=[one.text for one in told],
        good=bool(plan.verdict["good"]),
        labels=describe(track),
        wave_step=findings.wave_steps(track),
        margins=findings.margins(plan),
        events=findings.events(plan),
        long_fibers=fibers,
        rungs=names,
        strip_rungs=strip_rungs,
        statements=told,
        facts=facts(plan, mold_name(cell.scene)),
        robustness=plan.document.get("robustness"),
        **drape_of(cell, track, ply_of(plan), arm_visuals(cell.sources.arm_urdf)),
    )


def drape_of(
    cell: Cell, track: Track, ply: tuple[Array, Array], visuals: ArmVisuals
) -> dict[str, Any]:
    """What of a view is known before any verdict.

    Args:
        cell: Robot, mold and ply.
        track: Waypoints.
        ply: Its points in the world and its gaps at them, of `ply_of`.
        visuals: Bodies of the arm.

    Returns:
        Arguments of PlanView.
    """
    robot, tolerance = cell.robot, front_tolerance(cell)
    positions, rotations = track.poses
    points, gap = ply
    upper = robot.geometry.universals
    vertices, faces = mold_mesh(cell.mold, cell.world_mold)
    platform = np.ptp(upper[:, :2], axis=0) + 2 * RIM
    turn, shift = track.tool[:, None, :3, :3], track.tool[:, None, :3, 3]
    return {
        "title": f"Drape on {mold_name(cell.scene)}",
        "mold_vertices": vertices,
        "mold_faces": faces,
        "ply_points": points,
        "gap": gap,
        "phases": list(track.phase),
        "tau": track.tau,
        "cup_positions": positions,
        "cup_rotations": rotations,
        "cup_states": track.states,
        "cup_names": [f"{i},{j}" for i, j in np.ndindex(robot.rows, robot.columns)],
        "universals": (turn @ upper[..., None])[..., 0] + shift,
        "balls": positions + robot.geometry.ball_height * rotations[..., 2],
        "interlinks": np.array(neighbor_pairs(robot.rows, robot.columns)),
        "half_width": robot.half_width,
        "tool_placement": track.tool,
        "platform_size": (float(platform[0]), float(platform[1])),
        "arm_meshes": [Mesh(*body) for body in visuals.bodies],
        "arm_placements": visuals.placements(track.arm),
        "mold_placement": cell.world_mold,
        "table": pick_table(points[0]),
        "s": cell.sampling.s,
        "t": cell.sampling.t,
        "cups_around": cell.sampling.cups_around,
        "pads": cell.sampling.cup_index,
        "touch": tolerance.touch,
        "penetration": tolerance.pad_penetration,
    }


def size_of(cell: Cell) -> str:
    """Size of the tool in words."""
    return f"{cell.grid.columns} x {cell.grid.rows} cups"


def ply_of(plan: Plan) -> tuple[Array, Array]:
    """The ply at each waypoint, as it lies.

    Returns:
        Points in the world, none inside the mold, shape (K, nt, ns, 3), and the gaps of
        the free shape, which is pushed in where they are negative, shape (K, nt, ns),
        both in [m].
    """
    cell, contact = plan.cell, plan.judged[1]
    points, gap = (
        findings.held_throughout(plan, held) for held in (contact.drawn[0], contact.gap)
    )
    return in_world(cell, points, gap)


def in_world(cell: Cell, points: Array, gap: Array) -> tuple[Array, Array]:
    """The ply in the world, from points in the mold frame, and its gaps as shown."""
    world = points @ cell.world_mold[:3, :3].T + cell.world_mold[:3, 3]
    return world, np.minimum(gap, BESIDE)


def mold_mesh(mold: HeightGrid, world_mold: Array) -> tuple[Array, Array]:
    """Triangles through some nodes of a height grid, where they lie on the mold.

    Args:
        mold: The grid.
        world_mold: Placement of its frame, shape (4, 4), in [m].

    Returns:
        Vertices in the world, shape (V, 3), in [m], and faces, shape (F, 3).
    """
    i, j = (_some(n) for n in mold.heights.shape)
    x, y = (
        start + step * nodes
        for start, step, nodes in zip(mold.origin, mold.step, (i, j), strict=True)
    )
    X, Y = np.meshgrid(x, y)  # rows along y
    heights, covered = (v[np.ix_(i, j)].T for v in (mold.heights, mold.covered))
    faces = grid_triangles(len(j), len(i))
    faces = faces[covered.ravel()[faces].all(axis=1)]
    used, faces = np.unique(faces, return_inverse=True)
    local = np.stack([X, Y, heights], axis=-1).reshape(-1, 3)[used]
    return local @ world_mold[:3, :3].T + world_mold[:3, 3], faces.reshape(-1, 3)


def _some(count: int) -> Array:
    """Indices of at most NODES nodes at nearly equal distances, ends included."""
    return np.unique(np.rint(np.linspace(0, count - 1, min(count, NODES))).astype(int))


def mold_name(scene: Scene) -> str:
    """What the mold is called: its file or its kind of surface."""
    mold = scene.mold
    if mold.mesh is not None:
        return PurePath(mold.mesh.path).name
    return f"a {mold.surface.kind}" if mold.surface is not None else "a mold"


def pick_table(ply: Array) -> Array:
    """Opposite corners of the table below the ply of shape (nt, ns, 3), in [m]."""
    low, high = bounds(ply)
    top = low[2] - TABLE_DROP
    corners = np.array([low - TABLE_RIM, high + TABLE_RIM])
    corners[:, 2] = min(0.0, top - 0.05), top
    return corners
