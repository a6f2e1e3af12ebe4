"""The parts of the scene that keep their shape, as meshcat commands.

A command is what meshcat's server would send to its page: a dictionary, packed with
msgpack. The identifiers that three.js asks for are made from the paths, not drawn at
random, so the same plan gives the same bytes.
"""

import numpy as np
import umsgpack

from viewer import geometry
from viewer.plan_view import PlanView

Array = np.ndarray

MSGPACK_TYPES = {"float32": 0x17, "uint32": 0x16}  # meshcat's codes for typed arrays
BEHIND = {"polygonOffset": True, "polygonOffsetFactor": 2, "polygonOffsetUnits": 4}
MOLD = {"color": 0xCBC7BC, "shininess": 8, "side": 2, **BEHIND}
BLOCK = {"color": 0xA8A499, "shininess": 4, "side": 2, **BEHIND}
MOLD_LINES = {"color": 0x3B3A36, "opacity": 0.35, "transparent": True}
PLATFORM = {"color": 0x6B7682, "opacity": 0.13, "transparent": True, "side": 2}
PLATFORM |= {"depthWrite": False}
EDGES = {"color": 0x4B5663}
NECK = {"color": 0x8B949E, "side": 2}
ARM = {"vertexColors": True, "shininess": 18, "side": 2}
GROUND = {"color": 0xC4C8CB, "emissive": 0x34373A, "side": 2}  # hardly a spot of light
TABLE = {"color": 0xD3D9DE, "side": 2}
BACKGROUND = ((1.0, 1.0, 1.0), (0.90, 0.92, 0.94))  # top and bottom

THICKNESS = 0.02  # [m] of the platform, above the universal joints
NECK_RADIUS = 0.045  # [m] of the drawn link between flange and platform

Command = dict[str, object]


def _array(values: Array, dtype: str) -> dict[str, object]:
    data = np.ascontiguousarray(values, dtype)
    return {
        "itemSize": data.shape[-1],
        "type": dtype.capitalize() + "Array",
        "array": umsgpack.Ext(MSGPACK_TYPES[dtype], data.tobytes()),
        "normalized": False,
    }


def _object(
    path: str, kind: str, shape: Command, material: Command, matrix: Array
) -> Command:
    """A three.js object in its JSON form, wrapped as a meshcat command."""
    node = {
        "uuid": path,
        "type": kind,
        "geometry": path + "#g",
        "material": path + "#m",
    }
    return {
        "type": "set_object",
        "path": path,
        "object": {
            "metadata": {"version": 4.5, "type": "Object"},
            "geometries": [{"uuid": path + "#g", **shape}],
            "materials": [{"uuid": path + "#m", **material}],
            "object": {**node, "matrix": matrix.T.ravel().tolist()},
        },
    }


def mesh(
    path: str,
    vertices: Array,
    faces: Array,
    material: Command,
    colors: Array | None = None,
) -> Command:
    """Command that adds triangles: vertices (V, 3) in [m], faces (F, 3)."""
    attributes = {"position": _array(vertices, "float32")}
    if colors is not None:
        attributes["color"] = _array(colors, "float32")
    data = {"attributes": attributes, "index": _array(faces.reshape(-1, 1), "uint32")}
    shape = {"type": "BufferGeometry", "data": data}
    style = {"type": "MeshPhongMaterial", **material}
    return _object(path, "Mesh", shape, style, np.eye(4))


def lines(path: str, segments: Array, material: Command) -> Command:
    """Command that adds thin lines: segments (S, 2, 3) in [m]."""
    attributes = {"position": _array(segments.reshape(-1, 3), "float32")}
    shape = {"type": "BufferGeometry", "data": {"attributes": attributes}}
    style = {"type": "LineBasicMaterial", **material}
    return _object(path, "LineSegments", shape, style, np.eye(4))


def box(path: str, corners: Array, material: Command) -> Command:
    """Command that adds an axis-aligned box between two corners (2, 3), in [m]."""
    size, placement = corners[1] - corners[0], np.eye(4)
    placement[:3, 3] = corners.mean(axis=0)
    lengths = dict(zip(("width", "height", "depth"), size.tolist(), strict=True))
    style = {"type": "MeshPhongMaterial", **material}
    return _object(path, "Mesh", {"type": "BoxGeometry", **lengths}, style, placement)


def show(path: str, name: str, value: object) -> Command:
    """Command that sets a property of what stands at a path."""
    return {"type": "set_property", "path": path, "property": name, "value": value}


def surroundings(view: PlanView) -> list[Command]:
    """Background, light and floor; table where the ply is picked."""
    top, bottom = (list(color) for color in BACKGROUND)
    commands = [
        show("/Background", "top_color", top),
        show("/Background", "bottom_color", bottom),
        show("/Grid", "visible", False),
        show("/Axes", "visible", False),
        show("/Lights/AmbientLight/<object>", "intensity", 0.66),
        show("/Lights/FillLight/<object>", "intensity", 0.12),
        show("/Lights/PointLightNegativeX", "visible", False),
        show("/Lights/PointLightPositiveX", "visible", False),
        show("/Lights/SpotLight", "visible", True),
        show("/Lights/SpotLight/<object>", "intensity", 0.42),
    ]
    level, cell = floor_level(view), geometry.cell_box(view)
    reach = 8 * float(np.max(cell[1] - cell[0]))  # it fades before it ends
    middle = cell.mean(axis=0)
    low = [middle[0] - reach, middle[1] - reach, level - 0.002 * reach]
    high = [middle[0] + reach, middle[1] + reach, level]
    commands.append(box("/meshcat/floor", np.array([low, high]), GROUND))
    if view.table is not None:
        commands.append(box("/meshcat/table", geometry.bounds(view.table), TABLE))
    return commands


def floor_level(view: PlanView) -> float:
    """Height of the floor: the arm's foot, or below what reaches lower, in [m]."""
    lows = [0.0, geometry.block_bottom(view), float(view.ply_points[..., 2].min())]
    return min(lows) - 1e-3


def mold(view: PlanView) -> list[Command]:
    """The mold's surface, walls below its rim, and grid lines on it."""
    walls, faces = geometry.skirt(
        view.mold_vertices, view.mold_faces, geometry.block_bottom(view)
    )
    segments, _ = geometry.mold_grid(view)
    commands = [
        mesh("/meshcat/mold/surface", view.mold_vertices, view.mold_faces, MOLD),
        lines("/meshcat/mold/grid", segments, MOLD_LINES),
    ]
    if len(faces):
        commands.append(mesh("/meshcat/mold/block", walls, faces, BLOCK))
    return [*commands, *stand(view)]


def stand(view: PlanView) -> list[Command]:
    """What carries the mold's block where that does not reach the floor."""
    low, high = geometry.bounds(view.mold_vertices)
    bottom, level = geometry.block_bottom(view), floor_level(view)
    if bottom - level < 0.01 * float(high[0] - low[0]):
        return []
    inset = 0.08 * (high - low)
    corners = np.array([low + inset, high - inset])
    corners[:, 2] = level, bottom
    return [box("/meshcat/mold/stand", corners, TABLE)]


def platform(view: PlanView) -> list[Command]:
    """The tool's platform in the frame of tool0: its plate, edges and neck."""
    T_world_tool = view.tool_placement[0]
    upper = (view.universals[0] - T_world_tool[:3, 3]) @ T_world_tool[:3, :3]
    top = float(upper[:, 2].mean()) - THICKNESS
    size = np.array([*view.platform_size, THICKNESS])
    shift = np.array([0, 0, top + THICKNESS / 2])
    corners = np.array([-size / 2, size / 2]) + shift
    neck = np.array([[-NECK_RADIUS, -NECK_RADIUS, 0], [NECK_RADIUS, NECK_RADIUS, top]])
    return [
        box("/meshcat/tool/platform/plate", corners, PLATFORM),
        box("/meshcat/tool/platform/neck", neck, NECK),
        lines("/meshcat/tool/platform/edges", geometry.box_edges(size) + shift, EDGES),
    ]


def arm(view: PlanView) -> list[Command]:
    """The arm's bodies, each in its own frame, at /meshcat/arm/<number>."""
    return [
        mesh(f"/meshcat/arm/{k}", body.vertices, body.faces, ARM, body.colors)
        for k, body in enumerate(view.arm_meshes)
    ]


def commands(view: PlanView) -> list[bytes]:
    """All commands in the order in which the page carries them out, packed."""
    parts = [surroundings(view), mold(view), platform(view), arm(view)]
    return [umsgpack.packb(command) for part in parts for command in part]
