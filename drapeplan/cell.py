"""Cell: what a scene stands for, as objects: robot, mold, ply, and where they are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drapeplan.errors import InputError
from drapeplan.frames import pose, rpy
from drapeplan.mold import HeightGrid, check_size, read_mesh
from drapeplan.overhang import mold_from_data, mold_of
from drapeplan.path_choice import chosen_path
from drapeplan.robot import Robot, arm_description
from drapeplan.scene import (
    CylinderSurface,
    KindrapeSurface,
    ParaboloidSurface,
    RidgeSurface,
    Scene,
    SphereSurface,
    StepSurface,
    SurfaceSection,
)
from drapeplan.surfaces import (
    AbstractSurface,
    Cylinder,
    KinDrape,
    Paraboloid,
    Plane,
    Ridge,
    Sphere,
    Step,
    Trimmed,
)
from drapeplan.wave import Grid
from ply.errors import PlyError
from ply.grid import CupGrid
from ply.shape import PlySampling
from urdf import read_tool

Array = NDArray[np.float64]
MARGIN = 0.06  # [m] analytic molds reach this far beyond the flat ply
MOST_SAMPLES = 150_000  # [-] 2 GB of ply shapes along a path of a hundred poses


@dataclass(frozen=True)
class Sources:
    """Texts and data that a cell is built from, as a plan file embeds them."""

    arm_urdf: str
    tool_urdf: str
    tool_sidecar: str
    mold: dict[str, Any]


@dataclass(frozen=True)
class Cell:
    """Robot, mold and ply of a scene.

    Attributes:
        scene: The scene; no key of its path is open any longer.
        sources: What the objects were built from.
        robot: Arm and tool.
        mold: Mold in its own frame: what is seen from above, and distances to it.
        world_mold: Placement of the mold frame in the world, shape (4, 4).
        grid: Rows, columns, pitch and half width of the tool.
        sampling: Material points at which the ply is evaluated.
    """

    scene: Scene
    sources: Sources
    robot: Robot
    mold: HeightGrid
    world_mold: Array
    grid: Grid
    sampling: PlySampling


def read_sources(scene: Scene, folder: Path) -> Sources:
    """Read what the scene names: URDFs, sidecar and mold.

    Args:
        scene: The scene.
        folder: Folder that its paths are relative to.

    Raises:
        InputError: If a file is missing or holds something else.
    """
    arm = scene.robot.name or str(_beside(folder, scene.robot.urdf))
    tool = scene.tool.name or str(_beside(folder, scene.tool.urdf))
    tool_urdf, sidecar = read_tool(tool)
    arm_urdf = arm_description(arm)
    names = {"arm URDF": arm, "tool URDF": tool}
    names["sidecar"] = str(Path(tool).with_suffix(".yaml"))
    try:
        robot = Robot(arm_urdf, tool_urdf, sidecar)
    except InputError as error:
        source = names.get(error.source, error.source)
        raise InputError(source, error.key, error.problem, error.remedy) from error
    return Sources(arm_urdf, tool_urdf, sidecar, _fill(scene, robot, folder))


def build_cell(scene: Scene, sources: Sources) -> Cell:
    """Objects of a scene from what was read."""
    robot = Robot(sources.arm_urdf, sources.tool_urdf, sources.tool_sidecar)
    _check_home(scene, robot)
    grid = Grid(robot.rows, robot.columns, robot.pitch, robot.half_width)
    cups = CupGrid(grid.rows, grid.columns, grid.pitch, grid.half_width)
    _check_placement(scene, grid)
    step, overhang = scene.ply.sample_mm * 1e-3, scene.ply.overhang_mm * 1e-3
    samples = int(np.prod(_ply_size(scene, robot) / step + 1))
    if samples > MOST_SAMPLES:
        problem = f"{scene.ply.sample_mm:g} mm gives {samples} points of the ply"
        remedy = f"{MOST_SAMPLES} are the most: use a coarser step or less overhang"
        raise InputError("scene", "ply.sample_mm", problem, remedy)
    try:
        sampling = PlySampling.regular(cups, step, overhang)
    except PlyError as error:
        raise InputError("scene", "ply.sample_mm", str(error)) from error
    mold = mold_from_data(sources.mold)
    return Cell(
        chosen_path(scene, mold, grid)[0],
        sources,
        robot,
        mold,
        pose(rpy(np.radians(scene.mold.rotation_deg)), scene.mold.position_m),
        grid,
        sampling,
    )


def _check_home(scene: Scene, robot: Robot) -> None:
    """Refuse a home that the arm cannot take."""
    home, names = np.array(scene.robot.home_rad), robot.arm_names
    if len(home) != len(names):
        problem = f"has {len(home)} angles, the arm {len(names)} joints"
        raise InputError("scene", "robot.home_rad", problem, "give one for each")
    lower, upper = robot.lower[robot.arm_columns], robot.upper[robot.arm_columns]
    beyond = np.flatnonzero((home < lower) | (home > upper))
    if beyond.size:
        k = int(beyond[0])
        problem = f"{home[k]:g} rad is beyond the limits of {names[k]}"
        remedy = f"stay within {lower[k]:.3f} to {upper[k]:.3f}"
        raise InputError("scene", "robot.home_rad", problem, remedy)


def _beside(folder: Path, path: str | None) -> Path:
    return folder / (path or "")


def _fill(scene: Scene, robot: Robot, folder: Path) -> dict[str, Any]:
    """The mold as data, and what was chosen for it and why where it is a mesh."""
    mesh = scene.mold.mesh
    if mesh is None:
        return fill_surface(scene, robot).to_data()
    path = _beside(folder, mesh.path)
    vertices, faces = read_mesh(path, mesh.unit)
    extent = np.ptp(vertices[:, :2], axis=0)
    needed_x, needed_y = _ply_size(scene, robot)
    check_size(extent, needed_x, needed_y, str(path), mesh.unit)
    reach = max(robot.pitch - 2 * robot.half_width, scene.ply.overhang_mm * 1e-3)
    half = _ply_size(scene, robot) / 2 + MARGIN
    middle, warp = _ply_middle(scene, robot), np.radians(scene.placement.warp_deg)

    def near(x: Array, y: Array) -> NDArray[np.bool_]:
        s = np.cos(warp) * (x - middle[0]) + np.sin(warp) * (y - middle[1])
        t = np.cos(warp) * (y - middle[1]) - np.sin(warp) * (x - middle[0])
        return np.asarray((abs(s) <= half[0]) & (abs(t) <= half[1]))

    step = scene.mold.grid_step_mm * 1e-3
    mold, chosen = mold_of(vertices, faces, step, near, reach)
    return {**mold.to_data(), "chosen": chosen}


def fill_surface(scene: Scene, robot: Robot) -> HeightGrid:
    """Height grid of the scene's analytic surface, a margin larger than the ply."""
    step, warp = scene.mold.grid_step_mm * 1e-3, np.radians(scene.placement.warp_deg)
    half_s, half_t = (float(size) / 2 + MARGIN for size in _ply_size(scene, robot))
    surface = Trimmed(
        _surface(scene.mold.surface),
        _ply_middle(scene, robot),
        (half_s, half_t),
        float(warp),
    )
    half_x, half_y = (float(np.ceil(half / step) * step) for half in surface.extent)
    return HeightGrid.from_surface(surface, half_x, half_y, step)


def _ply_size(scene: Scene, robot: Robot) -> Array:
    """Size of the flat ply along s and t, shape (2,), in [m]."""
    edge = 2 * (robot.half_width + scene.ply.overhang_mm * 1e-3)
    return np.array([robot.columns - 1, robot.rows - 1]) * robot.pitch + edge


def _ply_middle(scene: Scene, robot: Robot) -> tuple[float, float]:
    """Where the middle of the ply would land on a flat mold, x and y, in [m]."""
    place, rows, columns = scene.placement, robot.rows, robot.columns
    i, j = place.cup or ((rows - 1) / 2, (columns - 1) / 2)
    s = ((columns - 1) / 2 - j) * robot.pitch
    t = ((rows - 1) / 2 - i) * robot.pitch
    cos, sin = np.cos(np.radians(place.warp_deg)), np.sin(np.radians(place.warp_deg))
    x, y = place.mold_point_m
    return float(x + cos * s - sin * t), float(y + sin * s + cos * t)


def _surface(section: SurfaceSection | None) -> AbstractSurface:
    """The analytic surface that a scene describes, in SI units."""
    match section:
        case ParaboloidSurface(radius_x_m=radius_x, radius_y_m=radius_y):
            return Paraboloid(radius_x, radius_y)
        case SphereSurface(radius_m=radius):
            return Sphere(radius)
        case CylinderSurface(radius_m=radius):
            return Cylinder(radius)
        case RidgeSurface(height_mm=height, sigma_mm=sigma, offset_mm=offset):
            return Ridge(height * 1e-3, sigma * 1e-3, offset * 1e-3)
        case StepSurface(height_mm=height, width_mm=width, offset_mm=offset):
            return Step(height * 1e-3, width * 1e-3, offset * 1e-3)
        case KindrapeSurface(relief=relief, size_m=size):
            return KinDrape(relief, size)
        case _:
            return Plane()


def _check_placement(scene: Scene, grid: Grid) -> None:
    """Refuse a placement cup that is not on the tool."""
    cup = scene.placement.cup
    if cup is not None and (cup[0] >= grid.rows or cup[1] >= grid.columns):
        problem = f"cup {list(cup)} is outside the tool"
        remedy = f"the tool has {grid.rows} rows and {grid.columns} columns"
        raise InputError("scene", "placement.cup", problem, remedy)
