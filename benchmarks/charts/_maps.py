"""Where methods find what they look for: one function a map, each gives its cells.

A cell has `x`, `y` and an `outcome`, a key of OUTCOMES, or a `share`. Boundaries that
follow from theory are rows too, with the `name` of the line that they are points of.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from benchmarks._stability import count, settle_mold, smooth_jump
from benchmarks.charts._drapes import EXAMPLES, cell_of, order_of, over, sized
from benchmarks.robustness import KNOWN
from drapeplan.cell import Cell
from drapeplan.closures import Chords
from drapeplan.equilibrium import Equilibrium, SettledStatus, ToolPhysics
from drapeplan.errors import InfeasibleError
from drapeplan.motion import follow
from drapeplan.net import least_shear_net
from drapeplan.planner import Request, make_plan, make_request
from drapeplan.robot import Robot, arm_description
from drapeplan.robustness import robustness
from drapeplan.scene import UncertaintySection, scene_from
from drapeplan.surfaces import Sphere
from ply.coupled import CoupledModel, CoupledStatus
from ply.coupled_choice import coupled_alternatives
from ply.elastica import ElasticaStatus, elastica
from ply.fiber import FiberStatus, quartic_fibers
from ply.grid import CupGrid
from ply.modal import modal_fibers
from urdf import read_tool, tool_names

Array = NDArray[np.float64]
OUTCOMES = {
    "all": "paper's root, modal, exact fiber",
    "side": "all three, the paper to the other side",
    "modal": "modal and exact; paper's root fails",
    "exact": "exact fiber alone",
    "none": "no curve is so long",
    "solved": "solved",
    "several": "solved, several stable shapes",
    "stretched": "solved, fibers stretched > 0.1 %",
    "failed": "failed, and said so",
}
L = 0.07  # [m] fiber between cups
PITCH, HALF = 0.110, 0.020  # [m]
MM = 1e-3
SAMPLES = 24  # [-] of a plan under errors
RATIO = 0.6  # [mm/deg] of errors of cups, as measured ones have it
STRETCHED = 1e-3  # [-] strain beyond which a patch's cups are too far apart
SMALL = (4, 3)  # rows and columns of a small tool
ROWS, COLUMNS = 8, 6  # of the net
PLY = ToolPhysics(bending=0.02, areal_mass=0.31, longest_fiber=0.0708)


def fiber(quick: bool) -> list[dict]:
    """Cups tilted towards each other by so much, chord shorter by so much."""
    n = 7 if quick else 25
    tilt = np.radians(np.linspace(-40, 40, n))[:, None] * np.ones(n)
    slack = np.linspace(-0.5, 4.0, n) * MM * np.ones((n, 1))
    chord = L - slack
    r0, r1 = np.zeros((n, n, 3)), chord[..., None] * [1.0, 0, 0]
    flat, up = np.cos(tilt), np.sin(tilt)
    dr0 = np.stack([flat, 0 * flat, up], axis=-1)
    dr1 = dr0 * [1, 1, -1]
    paper, root = quartic_fibers(r0, r1, dr0, dr1, L)
    normal = np.broadcast_to([0.0, 0, 1], r0.shape)
    modal = modal_fibers(r0, r1, dr0, dr1, L, normal, ribbon=False)
    bow = np.where(tilt < 0, -1, 1) * 2 / np.pi * np.sqrt(np.maximum(slack, 0) / L)
    ends = np.stack([chord, 0 * chord], axis=-1)
    exact = elastica(ends, tilt, -tilt, L, bow)
    height = exact.points([0.5])[..., 0, 1]
    met = [FiberStatus.MET, FiberStatus.WEAK_DIRECTION]
    found = {
        "paper": np.isin(root, met),
        "modal": np.isin(modal.status, met),
        "exact": exact.status == ElasticaStatus.STABLE,
    }
    sag = paper[..., 2] @ 0.5 ** np.arange(paper.shape[-2])
    other = (sag * height < 0) & (np.minimum(abs(sag), abs(height)) > 0.1 * MM)
    outcome = np.select(
        [
            slack < 0,
            found["paper"] & found["modal"] & other,
            found["paper"] & found["modal"],
            found["modal"],
            found["exact"],
        ],
        ["none", "side", "all", "modal", "exact"],
        "failed",
    )
    rows = _cells("fiber", np.degrees(tilt), slack / MM, outcome)
    return rows + _roots()


def _roots() -> list[dict]:
    """Where c = 196: the paper's root becomes complex (docs/derivations.md, D1)."""
    angles = np.radians(np.linspace(-40, 40, 81))
    turn = 2 * np.sin(angles) / 8  # d / L of Eq. 15, along the normal
    needed = 196 / 52.5 * turn**2  # gamma at c = 196
    slack = np.linspace(-1, 6, 1401) * MM
    x = 1 - slack / L
    lines = []
    for angle, gamma in zip(angles, needed, strict=True):
        error = _length_error(x, angle)
        beyond = np.flatnonzero(np.diff(np.sign(error - gamma)))
        if beyond.size:
            at = float(slack[beyond[0]] / MM)
            lines.append(_point("fiber", "c = 196", float(np.degrees(angle)), at))
    ends = [_point("fiber", "chord = L", float(x), 0.0) for x in (-40, 40)]
    return lines + ends


def _length_error(chord: Array, angle: float) -> Array:
    """Eq. 19 less one for the cubic of symmetric tilts, chord over L."""
    u, weights = np.polynomial.legendre.leggauss(6)
    u, weights = (u + 1) / 2, weights / 2
    x = 6 * u * (1 - u) * chord[:, None] + np.cos(angle) * (1 - 6 * u * (1 - u))
    z = np.sin(angle) * (1 - 2 * u)
    return (x**2 + z**2) @ weights - 1


def patch(quick: bool) -> list[dict]:
    """Four cups on a sphere, their edges nearer by so much than fibers are long."""
    n = 3 if quick else 9
    radii, slack = np.geomspace(0.2, 4.0, n), np.linspace(-0.4, 1.2, n) * MM
    model = CoupledModel(CupGrid(2, 2, PITCH, HALF))
    rows = []
    for radius in radii:
        poses = [_on_sphere(radius, each) for each in slack]
        p, R = (np.stack(each) for each in zip(*poses, strict=True))
        found = coupled_alternatives(model, p, R, 4)
        first = found.status[:, 0] == CoupledStatus.CONVERGED
        more = (found.status[:, 1:] == CoupledStatus.CONVERGED).any(axis=1)
        torn = found.strain[:, 0] > STRETCHED
        kinds = ["failed", "stretched", "several"]
        outcome = np.select([~first, torn, more], kinds, "solved")
        rows += _cells("patch", slack / MM, radius + 0 * slack, outcome)
    return rows + [_point("patch", "chord = L", 0.0, float(r)) for r in radii[[0, -1]]]


def _on_sphere(radius: float, slack: float) -> tuple[Array, Array]:
    """Cups symmetric about the top whose facing edges are L less the slack apart."""
    signs = np.array([(-1, -1), (1, -1), (-1, 1), (1, 1)])

    def frames(h: float) -> Array:
        normal = np.column_stack([h * signs, np.full(4, np.sqrt(1 - 2 * h * h))])
        s, t = (np.eye(3)[k] - normal[:, k : k + 1] * normal for k in (0, 1))
        s, t = (each / np.linalg.norm(each, axis=1)[:, None] for each in (s, t))
        s = s + np.cross(t, normal)  # halfway between what s and t ask for
        s /= np.linalg.norm(s, axis=1)[:, None]
        return np.stack([s, np.cross(normal, s), normal], axis=-1)

    def excess(h: float) -> float:
        return float(2 * (radius * h - HALF * frames(h)[1, 0, 0]) - L + slack)

    R = frames(brentq(excess, 1e-6, 0.7))
    return radius * R[..., 2], R


def equilibrium(quick: bool) -> list[dict]:
    """Smooth jumps of the strokes of 6 x 8 cups at rest over a dome."""
    robot = Robot(arm_description("ur10"), *read_tool(tool_names()[0]))
    tool, rng = Equilibrium(robot, PLY), np.random.default_rng(0)
    jumps = (20, 60) if quick else (10, 20, 30, 40, 60)
    rows = []
    for radius in (1.0,) if quick else (2.0, 1.4, 1.0, 0.7, 0.5, 0.35):
        start = settle_mold(tool, radius)
        for jump in jumps:
            label = {"map": "equilibrium", "x": jump, "y": radius}
            if start.status != SettledStatus.SETTLED:
                rows.append({**label, "outcome": "failed"})
                continue
            cell = count(
                *(tool, start, radius, jump * MM, smooth_jump),
                *(1 if quick else 4, rng),
            )
            total = sum(cell["in_parts"].values())
            shares = {
                way: cell[way]["settled"] / total for way in ("in_parts", "at_once")
            }
            rows.append({**label, "share": shares["in_parts"], **shares})
    ends = (jumps[0], jumps[-1])
    name = "tool's envelope"
    return rows + [_point("equilibrium", name, float(x), 1.0) for x in ends]


def net(quick: bool) -> list[dict]:
    """Nets of 6 x 8 cups on a sphere, their middle off its top along t."""
    radii = (0.25, 0.5) if quick else (0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.7, 1.0)
    offsets = np.linspace(0, 0.3, 2 if quick else 9)
    rows = []
    for radius in radii:
        for offset in offsets:
            try:
                size = ROWS, COLUMNS, PITCH
                least_shear_net(Sphere(radius), *size, (0.0, float(offset)))
                outcome = "solved"
            except (InfeasibleError, ValueError):
                outcome = "failed"
            cell = {"map": "net", "x": float(offset / MM), "y": radius}
            rows.append({**cell, "outcome": outcome})
    reach = np.linspace(0.2, 1.0, 81)
    links = (ROWS - 1) * np.arcsin(PITCH / 2 / reach)  # half of the middle column
    offset = reach * np.sin(np.maximum(np.pi / 2 - links, 0))
    return rows + [
        _point("net", "middle column ends at the equator", float(x / MM), float(y))
        for x, y, angle in zip(offset, reach, links, strict=True)
        if angle < np.pi / 2 and x <= offsets[-1]
    ]


def motion(quick: bool) -> list[dict]:
    """Strokes of a small tool over a sphere, by what the weave takes up."""
    radii = (0.5,) if quick else (0.3, 0.4, 0.5, 0.7, 1.0, 1.4)
    take_ups = (0.2, 1.2) if quick else (0.1, 0.2, 0.4, 0.6, 0.8, 1.2, 1.6)
    rows = []
    for radius in radii:
        surface = {"kind": "sphere", "radius_m": radius}
        path = {"family": "rectangle_blend", "poses_per_step": 3}
        data = over(surface, path=path, fidelity="kinematic")
        cell, request = cell_of(data, SMALL), None
        try:
            request = make_request(cell, order_of(cell))
        except InfeasibleError:
            pass
        for take_up in take_ups:
            outcome = _followed(cell, request, take_up)
            label = {"map": "motion", "x": take_up, "y": radius}
            rows.append({**label, "outcome": outcome})
        if request is not None:
            longest = Chords(cell.robot).values(*request.landing).max()
            need = max(0.0, float(longest - L) / MM)
            rows.append(_point("motion", "need of the landed net", need, radius))
    return rows


def _followed(cell: Cell, request: Request | None, take_up: float) -> str:
    if request is None:
        return "failed"
    ply = cell.scene.ply.model_copy(update={"take_up_mm": take_up})
    other = replace(cell, scene=cell.scene.model_copy(update={"ply": ply}))
    try:
        follow(other, request.path)
    except InfeasibleError:
        return "failed"
    return "solved"


def verdict(quick: bool) -> list[dict]:
    """Share of samples of a small tool's plan over a saddle that keep the order."""
    take_ups = (0.8,) if quick else (0.1, 0.2, 0.4, 0.8, 1.6)
    noises = (0.3,) if quick else (0.1, 0.2, 0.3, 0.5, 0.7)
    surface = {"kind": "paraboloid", "radius_x_m": -1.5, "radius_y_m": 1.8}
    rows = []
    for take_up in take_ups:
        data = over(surface, fidelity="kinematic", ply={"take_up_mm": take_up})
        label = {"map": "verdict", "x": take_up}
        try:
            with sized(data, SMALL) as whole:
                plan = make_plan(scene_from(whole, "chart"), EXAMPLES, "chart").plan
        except InfeasibleError:
            rows += [{**label, "y": noise, "outcome": "failed"} for noise in noises]
            continue
        for noise in noises:
            errors = {"position_mm": noise, "angle_deg": noise / RATIO, **KNOWN}
            settings = {"seed": 0, "workers": 1, "tornado": False}
            stated, samples = UncertaintySection(**errors), 2 if quick else SAMPLES
            found = robustness(plan, samples, stated=stated, **settings)
            rows.append({**label, "y": noise, "share": 1 - found.wrong / samples})
    return rows


def _cells(name: str, x: Array, y: Array, outcome: Array) -> list[dict]:
    """Rows of a map from arrays of one shape."""
    each: Iterable = zip(*(np.ravel(a).tolist() for a in (x, y, outcome)), strict=True)
    return [{"map": name, "x": a, "y": b, "outcome": str(c)} for a, b, c in each]


def _point(name: str, line: str, x: float, y: float) -> dict:
    """A point of a boundary."""
    return {"map": name, "boundary": line, "x": x, "y": y}
