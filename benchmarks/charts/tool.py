"""Where cups hover: what each way believes against where the tool comes to rest.

Every method gives strokes for each pose of a wave, and says where the free cups are.
The truth is the tool's equilibrium at those strokes, to a tolerance far below any
method's. So a kinematic method errs by what it does not know of weight and ply, an
equilibrium by how far it was solved. Times are those of all poses of a wave,
in turns.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from functools import partial
from importlib.util import find_spec

import numpy as np
from matplotlib.figure import Figure

from benchmarks._pink import PinkTool
from benchmarks._timing import uncollected
from benchmarks.charts._drapes import (
    DOME,
    Drape,
    cell_of,
    drape,
    example,
    over,
    swapped,
)
from benchmarks.charts.drawing import WIDTH, front, legend, log_log, scatter
from benchmarks.charts.results import Results, made_with
from drapeplan import settle
from drapeplan.equilibrium import Equilibrium
from drapeplan.frames import rotation_vectors
from drapeplan.hanging import tool_physics
from drapeplan.legs import Array, cup_poses, leg_coordinates
from drapeplan.motion import follow
from drapeplan.settling import settle_path
from tests.cartesian import CartesianTool

SETS = {
    "small": "dome, 3 x 4 cups",
    "panel": "panel, 6 x 8 cups",
    "saddle": "saddle, 6 x 8 cups",
}
SMALL = (4, 3)  # rows and columns; Pink's dense data of 48 legs would hold 760 MB
QUICK_WAVE = 3  # [-] poses when quick
MOMENTS = (1e-2, 1e-3, 1e-4, 1e-9)  # [N m] left at rest; the planner's is the last
CLOSED = 1e-2  # [m/(N m)] lengths are met to as much of it
TRUTH = 1e-11  # [N m] of the reference: some 1e4 roundings of a cup's weight at 0.3 m
LINEARIZATIONS = (1, 2, 4)  # of Pink, each pose warm from the one before
REPEATS = 7  # [-] of which the least time counts, see `_timing.interleaved`
ORACLE = 3  # [-] poses of the Cartesian oracle: a minute for a whole wave
FLOOR = 1e-9  # [mm] errors below are drawn there
LOOKS = (
    *("closed form", "QP", "Pink", "equilibrium, cold", "equilibrium, warm"),
    *("strokes that lead the lag", "Cartesian oracle"),
)
KNOB = "warm"  # the method whose settings are told beside its points
Belief = tuple[Array, Array, Array]
"""Configurations (m, nq), and what is believed of the cups: (m, n, 3), (m, n, 3, 3)."""
Method = Callable[[], tuple[float, Belief]]
"""Seconds of processor time for a wave, and what came out."""


def measure(quick: bool) -> Results:
    """All methods on a small tool, ours on the examples."""
    rows = _rows("small", drape(cell_of(over(DOME), SMALL)), quick, peers=True)
    for name in () if quick else ("panel", "saddle"):
        rows += _rows(name, drape(cell_of(example(name))), quick, peers=False)
    missing = {} if find_spec("pink") else {"Pink": "pip install .[peers] brings it"}
    made = made_with("pin", "pin-pink", "qpsolvers", "osqp", "piqp", quick=quick)
    return Results("tool", rows, made, missing)


def draw(results: Results) -> Figure:
    """A panel for each tool and mold: error against time."""
    sets = [name for name in SETS if results.where(set=name)]
    figure = Figure(figsize=(WIDTH, 3.6), layout="constrained")
    for axes, name in zip(
        figure.subplots(1, len(sets), squeeze=False, sharey=True)[0], sets, strict=True
    ):
        rows = results.where(set=name)
        y_label = "worst error of a hovering cup [mm]" if name == sets[0] else ""
        title = f"{SETS[name]}, {rows[0]['poses']} poses"
        log_log(axes, title, "time of a wave [ms]", y_label)
        for k, method in enumerate(LOOKS):
            own = [row for row in rows if row["method"] == method]
            x = [row["wave_ms"] for row in own]
            y = [max(row["worst_mm"], FLOOR) for row in own]
            notes = [str(row["setting"]) if KNOB in method else "" for row in own]
            if own:
                scatter(axes, x, y, method, k, joined=True, notes=notes)
        front(
            axes,
            [row["wave_ms"] for row in rows],
            [max(row["worst_mm"], FLOOR) for row in rows],
        )
    legend(figure, columns=4)
    return figure


def _rows(name: str, made: Drape, quick: bool, peers: bool) -> list[dict]:
    """Figures of every method on one drape; the methods take turns."""
    wave = made.wave()[: QUICK_WAVE if quick else None]
    count = 1 if quick else ORACLE
    few = wave[:: max(1, len(wave) // count)][:count]
    methods = _methods(made, wave)
    if peers and find_spec("pink"):
        methods |= _pink(made, wave)
    told: dict[tuple[str, str], list[tuple[float, Belief]]] = {k: [] for k in methods}
    with uncollected():
        for n in range(1 + (1 if quick else REPEATS)):  # the first one compiles
            for key in list(methods)[:: -1 if n % 2 else 1]:
                told[key].append(methods[key]())
    if peers:
        told["Cartesian oracle", f"{len(few)} poses"] = [_cartesian(made, few)]
    rows = []
    for (method, setting), each in told.items():
        chosen = few if len(each) == 1 else wave
        seconds = min(seconds for seconds, _ in each[1:] or each)
        error, angle = _errors(made, chosen, each[-1][1])
        rows.append(
            {
                "set": name,
                "method": method,
                "setting": setting,
                "poses": len(wave),
                "wave_ms": 1e3 * seconds * len(wave) / len(chosen),
                "worst_mm": 1e3 * float(error.max()),
                "rms_mm": 1e3 * float(np.sqrt(np.mean(error**2))),
                "worst_deg": float(np.degrees(angle.max())),
            }
        )
    return rows


def _methods(made: Drape, wave: Array) -> dict[tuple[str, str], Method]:
    """Ours: what plans without equilibrium believe, and the equilibrium itself."""

    def closed_form() -> tuple[float, Belief]:
        begin = time.process_time()
        q = _closed_form(made, wave)
        return time.process_time() - begin, _cups(made, q)

    def programs() -> tuple[float, Belief]:
        clock = _Clock()
        motion = follow(made.cell, made.path, clock)
        return clock.of(wave), _cups(made, motion.q[wave])

    def led() -> tuple[float, Belief]:
        clock = _Clock()
        found = settle_path(made.cell, made.path, made.motion, progress=clock)
        return clock.of(wave), _cups(made, found.motion.q[wave])

    methods: dict[tuple[str, str], Method] = {
        ("closed form", ""): closed_form,
        ("QP", ""): programs,
        ("strokes that lead the lag", ""): led,
    }
    for warm in (False, True):
        name = f"equilibrium, {'warm' if warm else 'cold'}"
        for moment in MOMENTS if warm else MOMENTS[-1:]:
            setting = f"{moment:g} N m" if warm else ""
            methods[name, setting] = partial(_settled, made, wave, warm, moment)
    return methods


class _Clock:
    """Processor time at which each waypoint was done."""

    def __init__(self) -> None:
        self.times = [time.process_time()]

    def __call__(self, done: int, q: Array) -> None:
        self.times.append(time.process_time())

    def of(self, chosen: Array) -> float:
        """Seconds that some waypoints took."""
        return float(np.diff(self.times)[chosen].sum())


def _closed_form(made: Drape, chosen: Array) -> Array:
    """Configurations from the inverse of the legs, shape (m, nq)."""
    robot, path = made.cell.robot, made.path
    arm = made.motion.q[chosen][:, robot.arm_columns]
    poses = path.positions[chosen], path.rotations[chosen]
    legs = leg_coordinates(robot.geometry, path.tool[chosen], *poses)
    return robot.configuration(arm, legs)


def _cups(made: Drape, q: Array) -> Belief:
    """Configurations with the poses of their cups."""
    robot = made.cell.robot
    tool = np.stack([robot.arm_forward(x) for x in q[:, robot.arm_columns]])
    return q, *cup_poses(robot.geometry, tool, q[:, robot.leg_columns])


def _settled(
    made: Drape, chosen: Array, warm: bool, moment: float
) -> tuple[float, Belief]:
    """Rest from the strokes of the closed form, to a tolerance."""
    q = _closed_form(made, chosen)
    with _tolerance(moment):
        begin = time.process_time()
        found = np.stack(list(_rests(made, chosen, q, warm)))
        seconds = time.process_time() - begin
    return seconds, _cups(made, found)


def _rests(made: Drape, chosen: Array, q: Array, warm: bool) -> Iterator[Array]:
    tool, settled = Equilibrium(made.cell.robot, tool_physics(made.cell)), None
    for k, asked in zip(chosen, q, strict=True):
        fixed = ~made.hovering[k]
        settled = tool.settle(asked, fixed, settled if warm else None, stability=False)
        yield settled.q


def _tolerance(moment: float) -> AbstractContextManager[None]:
    """Newton's method stops where no more is left than a moment, [N m]."""
    return swapped(settle, AT_REST=moment, CLOSED=CLOSED * moment)


def _pink(made: Drape, wave: Array) -> dict[tuple[str, str], Method]:
    """Pink's differential IK along the wave, each pose warm from the one before."""
    cell, path = made.cell, made.path
    longest = tool_physics(cell).longest_fiber
    start = made.motion.q[wave[0]]
    tool = PinkTool(cell.robot, cell.sources.tool_urdf, start, longest)

    def steps(count: int) -> tuple[float, Belief]:
        rows, q = [], start
        begin = time.process_time()
        for k in wave:
            q = tool.solve(q, (path.positions[k], path.rotations[k]), count)
            rows.append(q)
        return time.process_time() - begin, _cups(made, np.stack(rows))

    return {
        ("Pink", f"{count} QP a pose"): partial(steps, count)
        for count in LINEARIZATIONS
    }


def _cartesian(made: Drape, chosen: Array) -> tuple[float, Belief]:
    """The oracle: poses and lengths by complex steps; it is told which fibers pull."""
    robot, physics = made.cell.robot, tool_physics(made.cell)
    q = _closed_form(made, chosen)
    rests = _rests(made, chosen, q, warm=True)
    tool, poses, seconds = Equilibrium(robot, physics), [], 0.0
    for k, asked, near in zip(chosen, q, rests, strict=True):
        fixed = ~made.hovering[k]
        taut = tool.settle(near, fixed, stability=False).chord_forces > 0
        p, R = (each[0] for each in _cups(made, asked[None])[1:])
        begin = time.process_time()
        other = CartesianTool(robot, physics, asked, taut)
        poses.append(other.rest(p, R, fixed)[:2])
        seconds += time.process_time() - begin
    return seconds, (q, *(np.stack(each) for each in zip(*poses, strict=True)))


def _errors(made: Drape, chosen: Array, belief: Belief) -> tuple[Array, Array]:
    """Distances and angles of hovering cups from the truth at the same strokes."""
    q, positions, rotations = belief
    with _tolerance(TRUTH):
        truth = np.stack(list(_rests(made, chosen, q, warm=True)))
    _, p, R = _cups(made, truth)
    free = made.hovering[chosen]
    away = np.linalg.norm(positions - p, axis=-1)[free]
    turned = np.linalg.norm(rotation_vectors(R, rotations), axis=-1)[free]
    return away, turned
