"""Export of a plan as one HTML file that needs no server and no network."""

import base64
import hashlib
import importlib.util
import json
import re
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

import numpy as np

from drapeplan.errors import DrapeplanError
from drapeplan.files import write_bytes
from viewer import colors, geometry, objects, packing
from viewer.details import details
from viewer.moments import moments
from viewer.plan_view import BESIDE, GAP_SHOWN, PlanView

Array = np.ndarray

SCRIPTS = (
    *("dom.js", "unpack.js", "camera.js", "stage.js", "ply.js", "marks.js", "cups.js"),
    *("drape.js", "timeline.js", "legend.js", "hover.js", "keys.js", "address.js"),
    *("app.js", "svg.js", "probe.js", "events.js", "curves.js", "section.js"),
    *("robustness.js", "facts.js", "start.js"),
)  # in reading order
STYLES = ("page.css", "panels.css")
PARTS = ("Arm", "Tool", "Interlinks", "Cups", "Mold", "Ply", "Fibers", "Front", "Marks")
VIEWS = (
    ("Iso", (0.60, -0.66, 0.46), 30, "tool", ()),
    ("Top", (0.0, -0.002, 1.0), 9, "drape", ("Arm", "Tool", "Interlinks")),
    ("Front", (0.0, -1.0, 0.12), 12, "tool", ("Arm",)),
    ("Side", (1.0, 0.0, 0.12), 12, "tool", ("Arm",)),
    ("Close", (0.60, -0.66, 0.46), 30, "drape", ("Arm", "Tool")),
    ("Cell", (0.62, -0.55, 0.45), 32, "cell", ()),
)  # name, direction to the camera, field of view [deg], what to frame, what to hide


def _asset(name: str) -> str:
    return resources.files("viewer").joinpath(name).read_text(encoding="utf-8")


def _meshcat(name: str) -> str:
    """Read a file of meshcat's bundle, without importing meshcat and its server."""
    spec = importlib.util.find_spec("meshcat")
    if spec is None or not spec.submodule_search_locations:
        raise DrapeplanError("meshcat is not installed: pip install meshcat")
    root = Path(next(iter(spec.submodule_search_locations)))
    return (root / "viewer" / "dist" / name).read_text(encoding="utf-8")


def notices() -> str:
    """Licenses of the software and the meshes inside the file."""
    parts = ["Drawn with meshcat (MIT License) and the software in its bundle."]
    spec = importlib.util.find_spec("meshcat")
    origin = Path(next(iter(spec.submodule_search_locations or []))) if spec else None
    if origin:
        license_file = origin / "viewer" / "LICENSE"
        parts.append("meshcat\n\n" + license_file.read_text(encoding="utf-8"))
    for item in json.loads(_meshcat("main.min.js.THIRD_PARTY_LICENSES.json")):
        lines = [f"{item['name']} {item['version']} ({item['license']} License)"]
        lines += [f"by {item['author']}, {item['repository']}"]
        parts.append("\n\n".join([*lines, item.get("licenseText") or ""]))
    parts.append(
        "Meshes of the UR10, where shown: example-robot-data, ur_description "
        "(BSD-3-Clause), simplified."
    )
    return ("\n\n" + 72 * "-" + "\n\n").join(part.strip() for part in parts)


def header(views: Sequence[PlanView], payload: packing.Payload) -> dict[str, object]:
    """Describe the page: what its drapes share, and each of them."""
    names = ("name", "direction", "fov", "box", "hide")
    return {
        "states": [state._asdict() for state in colors.CUP_STATES],
        "palettes": {
            name: payload.add(colors.gap_colors(name), "u1") for name in colors.MAPS
        },
        "gap_shown": GAP_SHOWN,
        "beside": BESIDE,
        "parts": PARTS,
        "views": [dict(zip(names, v, strict=True)) for v in VIEWS],
        "moments": [moment._asdict() for moment in moments(views)],
        "drapes": [_drape(view, payload) for view in views],
    }


def _drape(view: PlanView, payload: packing.Payload) -> dict[str, object]:
    """Describe one drape, its arrays appended to the payload."""
    rows, columns = view.gap.shape[1:]
    _, spacing = geometry.mold_grid(view)
    drape, cell = geometry.drape_box(view), geometry.cell_box(view)
    tool = geometry.tool_box(view)
    boxes = {"drape": drape.tolist(), "tool": tool.tolist(), "cell": cell.tolist()}
    return {
        "title": view.title,
        "subtitle": view.subtitle,
        "verdict": view.verdict,
        "good": view.good,
        "touch": view.touch,
        "penetration": view.penetration,
        "spacing": spacing,
        "boxes": boxes,
        "floor": objects.floor_level(view),
        "opening": "Iso" if _inside(view, drape) else "Cell",
        "commands": [payload.add_bytes(c) for c in objects.commands(view)],
        "triangles": payload.add(geometry.grid_triangles(rows, columns), "<u4"),
        "fibers": payload.add(geometry.fiber_lines(rows, columns), "<u4"),
        **moving(view, payload),
        "details": details(view, payload),
    }


def moving(view: PlanView, payload: packing.Payload) -> dict[str, object]:
    """Describe what of a drape changes from pose to pose."""
    gap = packing.pack_gap(view.gap, GAP_SHOWN, view.penetration)
    return {
        "labels": view.labels,
        "contact": np.round(view.contact_share(), 5).tolist(),
        "lowest": np.round(view.gap.min(axis=(1, 2)), 6).tolist(),
        "highest": np.round(view.largest_gap(), 6).tolist(),
        "ply": payload.add_track(view.ply_points),
        "gap": payload.add_folded(gap[None]),
        "cups": _cups(view, payload),
        "tool": payload.add(_column_major(view.tool_placement), "<f4"),
        "arm": payload.add(
            _column_major(np.moveaxis(view.arm_placements, 1, 0)), "<f4"
        ),
    }


def _inside(view: PlanView, corners: Array) -> bool:
    """Whether the view of the drape also shows the ply of the first pose."""
    middle = view.ply_points[0].mean(axis=(0, 1))
    return bool(np.all((middle[:2] > corners[0, :2]) & (middle[:2] < corners[1, :2])))


def _column_major(placements: Array) -> Array:
    """Matrices in the order three.js reads them."""
    return np.swapaxes(placements, -1, -2)


def _cups(view: PlanView, payload: packing.Payload) -> dict[str, object]:
    """Cups, legs and interlinks: tracks of points, and who belongs to whom."""
    radius = 0.75 * view.half_width
    normals = view.cup_rotations[..., 2]
    tops = view.cup_positions + radius * normals
    return {
        "names": view.cup_names,
        "radius": radius,
        "states": payload.add(view.cup_states, "u1"),
        "faces": payload.add_track(view.cup_positions[:, None]),
        "tops": payload.add_track(tops[:, None]),
        "balls": payload.add_track(view.balls[:, None]),
        "universals": payload.add_track(view.universals[:, None]),
        "interlinks": payload.add(view.interlinks, "<u4"),
    }


def _hash(script: str) -> str:
    digest = hashlib.sha256(script.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"


def render(views: PlanView | Sequence[PlanView], since: int | None = None) -> str:
    """Text of the page, of one drape or of two side by side.

    The security policy of the page lets nothing run but its own two scripts, named by
    their hashes, and lets nothing be fetched.

    Args:
        views: What to show.
        since: Waypoints solved so far, where more will come from the server that the
            page comes from; None for a page that stands alone.

    Raises:
        DrapeplanError: If a script or a notice would end its own element.
    """
    views = _several(views)
    payload = packing.Payload()
    head = header(views, payload)
    bundle = _meshcat("main.min.js")
    *scripts, start = SCRIPTS
    if since is not None:
        head["live"] = since
        scripts.append("live.js")
    scripts.append(start)
    script = "\n".join(['"use strict";', *map(_asset, scripts)])
    policy = [
        "default-src 'none'",
        f"script-src {_hash(bundle)} {_hash(script)}",
        "style-src 'unsafe-inline'",  # meshcat's own tree sets styles
        "img-src data: blob:",
        "base-uri 'none'",
        "form-action 'none'",
        *([] if since is None else ["connect-src 'self'"]),
    ]
    parts = {
        "policy": "; ".join(policy),
        "style": "\n".join(map(_asset, STYLES)),
        "notices": notices(),
        "payload": base64.b64encode(payload.to_bytes(head)).decode(),
        "meshcat": bundle,
        "script": script,
    }
    for name in ("notices", "meshcat", "script"):
        if "</script" in parts[name].lower():
            raise DrapeplanError(f"the preview's {name} would end its own element")
    template = _asset("page.html")
    return re.sub(r"\{\{(\w+)\}\}", lambda m: parts[m[1]], template)


def _several(views: PlanView | Sequence[PlanView]) -> Sequence[PlanView]:
    """What to show, always more than one at a time."""
    return [views] if isinstance(views, PlanView) else views


def export(
    views: PlanView | Sequence[PlanView], path: str | Path
) -> dict[str, int | list[int]]:
    """Write the preview: all of it, or nothing.

    Args:
        views: What to show: a drape, or two to compare on one time line.
        path: HTML file to write; an older one stays until the new one is complete.

    Returns:
        Figures of the file: size_bytes, poses, samples; the last two as lists with more
        than one drape.

    Raises:
        InputError: If the file cannot be written.
    """
    data = render(views).encode()
    write_bytes(Path(path), data)
    poses = [view.poses for view in _several(views)]
    samples = [view.gap[0].size for view in _several(views)]
    if len(poses) == 1:
        return {"size_bytes": len(data), "poses": poses[0], "samples": samples[0]}
    return {"size_bytes": len(data), "poses": poses, "samples": samples}
