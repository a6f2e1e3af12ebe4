"""Arm and drape tool in one model: kinematics of every cup, inverse of the arm.

This is one of the two homes of Pinocchio; everything that leaves it is a plain array.
Pinocchio moves the arm only: its `Data` of arm and 48 legs holds four tensors of nv^3
numbers, 820 MB. So the legs take their closed forms, and their URDF is held to them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from drapeplan.errors import InfeasibleError, InputError
from drapeplan.inverse import TURN, nearest_solution, spread
from drapeplan.legs import (
    STROKE,
    Array,
    LegGeometry,
    cross,
    cup_poses,
    grid_universals,
    leg_twists,
)
from urdf.arm import NO_ARM, bound_joints, read_arm
from urdf.check import LEG_JOINTS, check_tool, leg_names
from urdf.sidecar import Sidecar, read_sidecar

__all__ = [
    "LEG_JOINTS",
    "ReachError",
    "Robot",
    "State",
    "arm_description",
    "face_jacobian",
]

arm_description = read_arm
ARM_HOME = (0.0, -1.2, 1.6, -np.pi / 2 - 0.4, -np.pi / 2, -np.pi / 2)
"""[rad] elbow up, tool straight down, s along +x of base_link (a UR10's angles)."""
STARTS = 32  # further starts: they found all eight postures of a UR10, 16 did not


class ReachError(InfeasibleError):
    """The arm cannot bring tool0 to a placement.

    Attributes:
        target: Wanted origin of tool0 in base_link, shape (3,), in [m].
        error: Distance of the nearest placement found within the limits, in [m].
    """

    def __init__(self, target: Array, error: float, phase: str = "") -> None:
        """Say when, where and by how much."""
        self.target, self.error = target, error
        place = ", ".join(f"{x:.3f}" for x in target)
        what = f"the arm stays short of tool0 at ({place}) m in this orientation"
        what = f"{phase}: {what}" if phase else what
        remedy = "move the mold or the pick table nearer to the arm"
        super().__init__(what, f"{1e3 * error:.3g} mm", remedy)


@dataclass(frozen=True)
class State:
    """Kinematics of arm and tool at one configuration, in the world; read-only arrays.

    A row of `arm_twists` or `leg_twists` is the spatial twist of one coordinate: the
    velocity of the body's point at the world's origin, then its angular velocity.

    Attributes:
        q: Configuration, shape (nq,), in [rad] and [m].
        T_world_tool: Placement of tool0, shape (4, 4), in [m].
        positions: Centers of the suction faces, shape (n, 3), in [m].
        rotations: Columns are the directions of s, t and n, shape (n, 3, 3).
        arm_twists: Of the arm's coordinates, shape (6, 6).
        leg_twists: Of each cup's own leg, by coordinate, shape (n, 6, 6).
    """

    q: Array
    T_world_tool: Array
    positions: Array
    rotations: Array
    arm_twists: Array
    leg_twists: Array


class Robot:
    """An arm of six revolute joints, or none, with a drape tool at its tool0.

    Attributes:
        tool: The sidecar's content: grid, springs, interlinks.
        rows: Cups along t.
        columns: Cups along s.
        n_cups: Number of cups, n.
        pitch: Distance between neighboring cups of a flat ply, [m].
        half_width: Half side of the square that a cup holds, [m].
        armless: Whether three slides and three turns without a body stand for the arm.
        model: Pinocchio's model of arm and tool; nq = nv.
        nq: Number of coordinates.
        arm_names: Names of the arm's joints.
        leg_names: Names of each leg's joints, ux, uy, stroke, sx, sy, sz.
        arm_columns: Places of the arm's joints in q, shape (6,).
        leg_columns: Places of each leg's joints in q, shape (n, 6).
        lower: Lower limits, shape (nq,), in [rad] and [m].
        upper: Upper limits, shape (nq,), in [rad] and [m].
        velocity: Limits of the rates, shape (nq,), in [rad/s] and [m/s].
        geometry: Lengths for the closed forms of drapeplan.legs.
    """

    def __init__(
        self, arm_urdf: str, tool_urdf: str, sidecar: str | Mapping[str, Any]
    ) -> None:
        """Build the model from texts, so that a plan can carry all it needs.

        Args:
            arm_urdf: Text of the arm's URDF; its world is base_link, its flange tool0.
            tool_urdf: Text of the tool's URDF.
            sidecar: The tool's sidecar, as text or as plain data.

        Raises:
            InputError: A text is no such description, or they contradict one another.
        """
        self.tool = read_sidecar(sidecar)
        self.rows, self.columns = self.tool.rows, self.tool.columns
        self.pitch, self.half_width = self.tool.pitch, self.tool.half_width
        self.n_cups = self.rows * self.columns
        self._arm = _arm_model(arm_urdf)
        self._arm_data = self._arm.createData()
        self._tool0 = self._arm.getFrameId("tool0")
        self.armless = self._arm.name == NO_ARM
        tool = _parse(tool_urdf, "tool URDF")
        self.leg_names = leg_names(self.tool)
        self.geometry = _leg_geometry(self.tool)
        check_tool(tool_urdf, self.tool, self.geometry.universals)
        self.model = _join(self._arm, tool)
        self.nq = int(self.model.nq)
        self.arm_names = tuple(self._arm.names)[1:]
        self.arm_columns = _columns(self.model, self.arm_names)
        flat = [name for leg in self.leg_names for name in leg]
        self.leg_columns = _columns(self.model, flat).reshape(-1, 6)
        self.lower, self.upper, self.velocity = _limits(self.model)

    def configuration(self, q_arm: Array, legs: Array) -> Array:
        """Put the coordinates of arm and legs into one vector.

        Args:
            q_arm: Shape (..., 6), in [rad].
            legs: Shape (..., n, 6), in [rad] and [m].

        Returns:
            Configurations, shape (..., nq).
        """
        batch = np.broadcast_shapes(np.shape(q_arm)[:-1], np.shape(legs)[:-2])
        q = np.zeros((*batch, self.nq))
        q[..., self.arm_columns] = q_arm
        q[..., self.leg_columns] = legs
        return q

    def home(self) -> Array:
        """Arm at home, legs straight down at mid stroke, shape (nq,)."""
        legs = np.zeros((self.n_cups, 6))
        legs[:, STROKE] = (self.geometry.leg_max - self.geometry.leg_min) / 2
        return self.configuration(np.array(ARM_HOME), legs)

    def kinematics(self, q: Array) -> State:
        """Poses and twists of all cups at one configuration.

        Args:
            q: Configuration, shape (nq,), in [rad] and [m].

        Returns:
            The state.
        """
        q = np.array(q, dtype=float)
        if q.shape != (self.nq,):
            raise ValueError(f"q has shape {q.shape}, not {(self.nq,)}")
        q_arm, legs = q[self.arm_columns], q[self.leg_columns]
        T_world_tool = self.arm_forward(q_arm)
        J = pin.computeJointJacobians(self._arm, self._arm_data, q_arm)
        state = State(
            q,
            T_world_tool,
            *cup_poses(self.geometry, T_world_tool, legs),
            J.T,
            leg_twists(self.geometry, T_world_tool, legs),
        )
        for array in vars(state).values():
            array.setflags(write=False)
        return state

    def face_columns(self) -> NDArray[np.int64]:
        """Places in q of the columns of face_jacobian, shape (n, 12)."""
        arm = np.broadcast_to(self.arm_columns, (self.n_cups, 6))
        return np.concatenate([arm, self.leg_columns], axis=1)

    def arm_forward(self, q_arm: Array) -> Array:
        """Placement of tool0 in base_link, shape (4, 4), in [m].

        Args:
            q_arm: Shape (6,), in [rad].
        """
        arm, data = self._arm, self._arm_data
        pin.forwardKinematics(arm, data, np.asarray(q_arm, dtype=float))
        placement = pin.updateFramePlacement(arm, data, self._tool0)
        return np.array(placement.homogeneous)

    def arm_inverse(self, T_world_tool: Array, q_seed: Array) -> Array:
        """Arm coordinates that bring tool0 to a placement, nearest to a seed.

        See drapeplan.inverse for what nearest means.

        Args:
            T_world_tool: Placement of tool0 in base_link, shape (4, 4), in [m].
            q_seed: Where the arm comes from, shape (6,), in [rad].

        Returns:
            Coordinates within the limits, shape (6,), in [rad]; the placement is met
            to 1e-12.

        Raises:
            ReachError: No start leads there; carries the least position error found.
        """
        target = np.asarray(T_world_tool, dtype=float)
        goal = pin.SE3(target)
        lower, upper, _ = _limits(self._arm)

        def residual(q: Array) -> tuple[Array, Array]:
            pin.computeJointJacobians(self._arm, self._arm_data, q)
            arguments = self._arm, self._arm_data, self._tool0
            left = pin.log6(pin.updateFramePlacement(*arguments).actInv(goal)).vector
            return left, pin.getFrameJacobian(*arguments, pin.LOCAL)

        periods = TURN * np.repeat([not self.armless, 1], 3)  # slides come first
        half_turn = np.minimum(np.pi, upper), np.maximum(-np.pi, lower)
        starts = spread(half_turn[1], half_turn[0], STARTS)
        seed = np.asarray(q_seed, dtype=float)
        best, ends = nearest_solution(residual, lower, upper, seed, starts, periods)
        if best is None:
            placed = [self.arm_forward(np.clip(q, lower, upper)) for q in ends]
            miss = np.linalg.norm(np.array(placed)[:, :3, 3] - target[:3, 3], axis=1)
            raise ReachError(target[:3, 3], float(miss.min()))
        return best


def face_jacobian(state: State) -> Array:
    """Velocities of the suction faces by coordinates of the arm and of the own leg.

    Args:
        state: Kinematics of n cups.

    Returns:
        Rows: velocity of the face's center, then angular velocity, in the world;
        columns: six of the arm, six of the leg (Robot.face_columns). Shape (n, 6, 12),
        in [m] and [rad] per [rad], or per [m] for the stroke.
    """
    arm = np.broadcast_to(state.arm_twists, (len(state.positions), 6, 6))
    twists = np.concatenate([arm, state.leg_twists], axis=1)
    linear = twists[..., :3] + cross(twists[..., 3:], state.positions[:, None])
    return np.concatenate([linear, twists[..., 3:]], axis=-1).swapaxes(-1, -2)


def _parse(urdf: str, source: str) -> pin.Model:
    """Pinocchio's model of a URDF whose limits are finite and in order."""
    try:
        model = pin.buildModelFromXML(bound_joints(urdf, source))
    except (ValueError, RuntimeError) as error:
        raise InputError(source, "", f"no valid URDF: {str(error).strip()}") from error
    lower, upper, velocity = _limits(model)
    if model.nq != model.nv:
        raise InputError(source, "", "has a joint with more numbers than freedoms")
    good = np.isfinite(upper - lower) & (lower < upper) & (velocity > 0)
    if not np.all(good & np.isfinite(velocity)):
        name = model.names[1 + int(np.argmin(good & np.isfinite(velocity)))]
        raise InputError(source, name, "needs lower < upper and a velocity limit")
    return model


def _arm_model(urdf: str) -> pin.Model:
    """Model of an arm that stands on base_link and ends in tool0."""
    arm = _parse(urdf, "arm URDF")
    for frame in ("base_link", "tool0"):
        if not arm.existFrame(frame):
            raise InputError("arm URDF", frame, "there is no such link")
    kinds = [joint.shortname() for joint in list(arm.joints)[1:]]
    turns = [k.startswith("JointModelR") for k in kinds]
    if len(kinds) != 6 or not (all(turns) or arm.name == NO_ARM):
        raise InputError(
            "arm URDF", "", f"has {len(kinds)} joints, not six revolute ones"
        )
    base = arm.frames[arm.getFrameId("base_link")]
    if base.parentJoint != 0 or not base.placement.isIdentity():
        raise InputError("arm URDF", "base_link", "is not the origin of the world")
    return arm


def _join(arm: pin.Model, tool: pin.Model) -> pin.Model:
    """Both in one model, the tool's root at tool0."""
    try:
        at = arm.getFrameId("tool0")
        return pin.appendModel(arm, tool, at, pin.SE3.Identity())
    except (ValueError, RuntimeError) as error:
        problem = f"does not fit the arm: {str(error).strip()}"
        raise InputError("tool URDF", "", problem, "rename what both have") from error


def _leg_geometry(tool: Sidecar) -> LegGeometry:
    """Lengths for the closed forms."""
    depth = tool.universal_depth
    universals = grid_universals(tool.rows, tool.columns, tool.pitch, depth)
    return LegGeometry(universals, tool.leg_min, tool.leg_max, tool.ball_height)


def _columns(model: pin.Model, names: Sequence[str]) -> NDArray[np.int64]:
    """Places of joints in q; Pinocchio orders children by name, so it is asked."""
    return np.array([model.joints[model.getJointId(name)].idx_q for name in names])


def _limits(model: pin.Model) -> tuple[Array, Array, Array]:
    """Lower, upper and rate limits, each a read-only copy of shape (nq,)."""
    given = model.lowerPositionLimit, model.upperPositionLimit, model.velocityLimit
    lower, upper, velocity = (np.array(limit) for limit in given)
    for limit in (lower, upper, velocity):
        limit.setflags(write=False)
    return lower, upper, velocity
