"""One kinematic step by Pink's differential IK and by ours; prints JSON.

The same tool, the same request, the same linearizations: all cups 5 mm down and tilted
with a gentle bowl. Pink gets a frame task for each cup, our interlinks as equality
constraints, our fibers and joint limits as inequalities; dense, as it is built.
"""

import json
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from drapeplan.robot import Robot
from drapeplan.strokes import StrokeSolver
from urdf.arm import read_arm
from urdf.generate import write_tool
from urdf.spec import ToolSpec

LONGEST = 0.0708  # [m]
STEPS = 4  # linearizations of either
DOWN = 5e-3  # [m]
RADIUS = 3.0  # [m] of the bowl
SOLVER = "piqp"  # as fast as any of its dense ones here


def main(rows: int, columns: int) -> dict:
    """Time and residuals of both, or what is missing."""
    try:
        import pink  # noqa: F401
        import piqp  # noqa: F401
    except ImportError as error:
        hint = "pip install 'drapeplan[peers,solvers]'"
        return {"missing": f"{error.name} is not installed; {hint} brings it"}
    robot, text = tool_on_arm(rows, columns)
    q, request = start_and_request(robot)
    ours, theirs = step_ours(robot, q, request), step_pink(robot, text, q, request)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    return {
        "tool": f"{columns} x {rows} cups",
        "ours": ours,
        "pink": {**theirs, "peak_MB": peak},
        "ratio": round(theirs["ms"] / ours["ms"], 1),
    }


def tool_on_arm(rows: int, columns: int) -> tuple[Robot, str]:
    """A generated tool on the UR10, and the tool's URDF."""
    with tempfile.TemporaryDirectory() as folder:
        spec = ToolSpec(name="tool", rows=rows, columns=columns)
        urdf, sidecar = (Path(path).read_text() for path in write_tool(spec, folder))
    return Robot(read_arm("ur10"), urdf, sidecar), urdf


def start_and_request(robot: Robot) -> tuple[np.ndarray, tuple]:
    """A flat ply in mid air, and a gentle bowl a little lower."""
    q = robot.home()
    state = robot.kinematics(q)
    center = state.positions.mean(axis=0)
    along = [state.rotations[0][:, k] for k in range(3)]
    s, t = ((state.positions - center) @ axis for axis in along[:2])
    rise = (s**2 + t**2) / (2 * RADIUS) - DOWN
    positions = state.positions + rise[:, None] * along[2]
    normal = along[2] - (s[:, None] * along[0] + t[:, None] * along[1]) / RADIUS
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    first = np.cross(along[1], normal)
    first /= np.linalg.norm(first, axis=1)[:, None]
    rotations = np.stack([first, np.cross(normal, first), normal], axis=-1)
    return q, (positions, rotations)


def residuals(robot: Robot, q: np.ndarray, request: tuple) -> dict:
    """What a step left, recomputed from the joints."""
    found = StrokeSolver(robot, LONGEST).judge(q, request)
    return {
        "closure_mm": float(f"{1e3 * np.abs(found.closure).max():.2g}"),
        "fiber_excess_mm": float(f"{1e3 * found.chord_excess.max():.2g}"),
        "position_mm": float(f"{1e3 * found.position_error.max():.3g}"),
    }


def step_ours(robot: Robot, q: np.ndarray, request: tuple) -> dict:
    """STEPS linearizations of the stroke QP, OSQP kept alive."""
    solver = StrokeSolver(robot, LONGEST)
    n = robot.n_cups
    nobody = np.zeros(n, bool)
    times = []
    for _ in range(6):
        step = solver.step(q, None, request, nobody, ~nobody, np.inf)
        start = time.perf_counter()
        there = q.copy()
        columns = solver.pattern(nobody).columns
        for _ in range(STEPS):
            program = solver.program(robot.kinematics(there), step)
            there[columns] += solver.qp.solve(program).x
        times.append(time.perf_counter() - start)
    ms = 1e3 * float(np.median(times[1:])) / STEPS
    return {"ms": round(ms, 3), **residuals(robot, there, request)}


def step_pink(robot: Robot, urdf: str, q: np.ndarray, request: tuple) -> dict:
    """STEPS linearizations by Pink, integrated in between."""
    tool = PinkTool(robot, urdf, q)
    times = []
    for _ in range(3):
        begun = time.perf_counter()
        there = tool.solve(q, request, STEPS)
        times.append(time.perf_counter() - begun)
    ms = 1e3 * float(np.median(times)) / STEPS
    return {"ms": round(ms, 3), **residuals(robot, there, request)}


class PinkTool:
    """A tool in Pink: cups are frame tasks, interlinks constraints, fibers limits."""

    def __init__(
        self, robot: Robot, urdf: str, q: np.ndarray, longest: float = LONGEST
    ) -> None:
        """Build the model; the arm stands still.

        Args:
            robot: Arm and tool.
            urdf: The tool's URDF.
            q: Gives the arm's coordinates, shape (nq,).
            longest: Of the fibers, [m].
        """
        import pinocchio as pin
        from pink.limits import ConfigurationLimit, Limit
        from pink.tasks import FrameTask, Task

        self.robot, self.q = robot, q
        self.model = model = pin.buildModelFromXML(urdf)
        self.data = model.createData()
        names = [name for leg in robot.leg_names for name in leg]
        place = np.array([model.joints[model.getJointId(name)].idx_q for name in names])
        self.place, columns = place, robot.leg_columns.ravel()
        ours, whole = StrokeSolver(robot, longest), self._whole

        def dense(distances, state):
            matrix = np.zeros((len(distances), model.nv))
            matrix[:, place] = distances.jacobian(state)[:, columns].toarray()
            return matrix

        class Interlinks(Task):
            def compute_error(self, configuration):
                state = robot.kinematics(whole(configuration.q))
                return ours.closures.values(state.positions, state.rotations)

            def compute_jacobian(self, configuration):
                return dense(ours.closures, robot.kinematics(whole(configuration.q)))

            def __repr__(self):
                return "Interlinks()"

        class Fibers(Limit):
            def compute_qp_inequalities(self, configuration, dt):
                state = robot.kinematics(whole(configuration.q))
                chords = ours.chords.values(state.positions, state.rotations)
                return dense(ours.chords, state), longest - chords

        self.tool = robot.kinematics(q).T_world_tool
        cups = [divmod(cup, robot.columns) for cup in range(robot.n_cups)]
        self.tasks = [
            FrameTask(f"cup_{i}_{j}_face", position_cost=1e3, orientation_cost=35.0)
            for i, j in cups
        ]
        self.options = {
            "limits": [ConfigurationLimit(model, 1.0), Fibers()],
            "constraints": [Interlinks()],
            "safety_break": False,
        }

    def _whole(self, local: np.ndarray) -> np.ndarray:
        q = self.q.copy()
        q[self.robot.leg_columns.ravel()] = local[self.place]
        return q

    def solve(self, q: np.ndarray, request: tuple, steps: int) -> np.ndarray:
        """Joints, shape (nq,), after some linearizations towards poses of the cups."""
        import pink
        import pinocchio as pin

        R_tool, origin = self.tool[:3, :3], self.tool[:3, 3]
        for task, p, R in zip(self.tasks, *request, strict=True):
            turned = R_tool.T @ R @ np.diag([1.0, -1.0, -1.0])
            task.set_target(pin.SE3(turned, R_tool.T @ (p - origin)))
        local = np.zeros(self.model.nq)
        local[self.place] = q[self.robot.leg_columns.ravel()]
        at = pink.Configuration(self.model, self.data, local, copy_data=False)
        for _ in range(steps):
            v = pink.solve_ik(at, self.tasks, 1.0, SOLVER, 1e-6, **self.options)
            at.integrate_inplace(v, 1.0)
        return self._whole(at.q)


if __name__ == "__main__":
    print(json.dumps(main(int(sys.argv[1]), int(sys.argv[2]))))
