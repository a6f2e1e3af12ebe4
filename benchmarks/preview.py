"""Size and speed of the exported preview, on a synthetic drape."""

import tempfile
import time
from pathlib import Path

import numpy as np

from drapeplan.visuals import arm_visuals
from urdf.arm import read_arm
from viewer.geometry import grid_triangles
from viewer.page import export
from viewer.plan_view import Mesh, PlanView

ROWS, COLUMNS, PITCH = 8, 6, 0.110  # [m] the tool of the defaults
RUNS = 3  # of each export; the fastest counts


def drape(poses: int, samples: tuple[int, int]) -> PlanView:
    """A ply lowered on a paraboloid from its middle outward, with a UR10 beside it."""
    along_t, along_s = (np.linspace(-0.5, 0.5, n) for n in samples)
    t, s = np.meshgrid(0.85 * along_t, 0.63 * along_s, indexing="ij")
    front = np.linspace(0, 0.45, poses)[:, None, None]
    z = -(s**2) / 2.4 - t**2 / 5.0
    gap = 0.9 * np.maximum(0, abs(t) - front) ** 2
    points = np.stack(np.broadcast_arrays(s + 0.75, t, 0.2 + z + gap), axis=-1)
    i, j = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
    x, y = 0.75 + (j - 2.5) * PITCH, (i - 3.5) * PITCH
    lift = 0.9 * np.maximum(0, abs(y) - front[:, 0]) ** 2
    height = 0.2 - (x - 0.75) ** 2 / 2.4 - y**2 / 5.0 + lift
    cups = np.stack(np.broadcast_arrays(x, y, height), axis=-1)
    tool = np.tile(np.diag([1.0, -1, -1, 1]), (poses, 1, 1))
    tool[:, :3, 3] = 0.75, 0, 0.6
    arm = arm_visuals(read_arm("ur10"))
    angles = np.tile([0.0, -1.2, 1.6, -2.0, -1.57, -1.57], (poses, 1))
    return PlanView(
        title="Benchmark",
        subtitle="",
        verdict=["Good."],
        good=True,
        mold_vertices=points[-1].reshape(-1, 3),
        mold_faces=grid_triangles(*samples),
        ply_points=points,
        gap=gap,
        labels=[f"pose {k}" for k in range(poses)],
        phases=["wave"] * poses,
        cup_positions=cups,
        cup_rotations=np.broadcast_to(np.eye(3), (*cups.shape, 3)),
        cup_states=np.where(lift > 0, 0, 2).astype(np.uint8),
        cup_names=[f"{a},{b}" for a, b in zip(i, j, strict=True)],
        universals=cups * np.array([1, 1, 0]) + np.array([0, 0, 0.54]),
        balls=cups + np.array([0, 0, 0.005]),
        interlinks=np.zeros((0, 2), int),
        half_width=0.02,
        tool_placement=tool,
        platform_size=(0.63, 0.85),
        arm_meshes=[Mesh(*body) for body in arm.bodies],
        arm_placements=arm.placements(angles),
    )


def run(quick: bool = False) -> dict[str, object]:
    """Export previews of growing length.

    Args:
        quick: Measure the shortest alone.

    Returns:
        Rows with poses, samples a pose, seconds of the export and size in megabytes.
    """
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for poses in (25,) if quick else (25, 100, 400):
            view = drape(poses, (86, 64))
            seconds = []
            for _ in range(1 if quick else RUNS):
                start = time.perf_counter()
                figures = export(view, Path(folder) / "preview.html")
                seconds.append(time.perf_counter() - start)
            row = {"poses": poses, "samples": figures["samples"]}
            row |= {"seconds": min(seconds), "megabytes": figures["size_bytes"] / 1e6}
            rows.append(row)
    return {"preview": rows}
