"""The numbers that make a drape tool; README.md gives the source of each."""

import math
import re
from dataclasses import dataclass
from typing import NoReturn

from drapeplan.errors import InputError

DEGREE = math.pi / 180  # [rad]
MARGIN = 0.02  # [m] platform beyond the edges of the outer cups
MOST_CUPS_A_SIDE = 64  # rows or columns; beyond it the model outgrows its solvers
KINDS = ("rigid", "resilient")
SIGNED = ("interlink_height", "cup_center_of_mass")
MAY_BE_ZERO = (
    "interlink_mass",
    "interlink_length_range",
    "interlink_bending_stiffness",
    "universal_stiffness",
    "ball_stiffness",
    "yaw_stiffness",
)


class SpecError(InputError, ValueError):
    """A field of a ToolSpec makes no tool; the key is the field's name."""


@dataclass(frozen=True)
class ToolSpec:
    """Dimensions, limits, masses and stiffnesses of a drape tool, SI and radians.

    Attributes:
        name: Robot name and stem of both files.
        rows: Cups along t.
        columns: Cups along s.
        pitch: Distance between neighboring cups and length of an interlink, [m].
        half_width: Half side of the square that a cup holds, [m].
        leg_min: Universal joint to ball at stroke 0, [m].
        leg_max: Universal joint to ball at full stroke, [m].
        universal_depth: Universal joints below tool0, [m].
        ball_height: Ball center above the suction face, [m].
        universal_limit: Largest angle of ux and of uy, [rad].
        ball_limit: Largest angle of sx and of sy, [rad].
        yaw_limit: Largest angle of sz, [rad].
        stroke_velocity: Limit of the actuators, [m/s].
        joint_velocity: Limit of the passive joints, [rad/s].
        stroke_effort: Limit of the actuators, [N].
        joint_effort: Limit of the passive joints, [N m].
        platform_mass: Platform with all that is fixed to it, [kg].
        tube_mass: Fixed half of one leg, [kg].
        rod_mass: Moving half of one leg, [kg].
        rod_center_of_mass: Its center of mass above the ball, [m].
        cup_mass: One cup, [kg].
        cup_center_of_mass: Its center of mass above the ball, [m]; negative: below.
        interlink_kind: "rigid" with balls at its ends, or "resilient", clamped.
        interlink_height: Ends above the suction face, [m]; negative: below.
        interlink_length_range: How far its length may go from the pitch, either way,
            [m]; 0 holds it.
        interlink_mass: One interlink, [kg].
        interlink_bending_stiffness: Equivalent, [N m]; 0 where rigid.
        universal_stiffness: Spring of ux and of uy, [N m/rad].
        ball_stiffness: Spring of sx and of sy, [N m/rad].
        yaw_stiffness: Spring of sz, [N m/rad].
    """

    name: str = "drape_tool_6x8"
    rows: int = 8
    columns: int = 6
    pitch: float = 0.110
    half_width: float = 0.020
    leg_min: float = 0.150
    leg_max: float = 0.450
    universal_depth: float = 0.060
    ball_height: float = 0.005
    universal_limit: float = 15 * DEGREE
    ball_limit: float = 40 * DEGREE
    yaw_limit: float = 15 * DEGREE
    stroke_velocity: float = 0.2
    joint_velocity: float = 1.0
    stroke_effort: float = 200.0
    joint_effort: float = 100.0
    platform_mass: float = 12.0
    tube_mass: float = 0.45
    rod_mass: float = 0.10
    rod_center_of_mass: float = 0.075
    cup_mass: float = 0.060
    cup_center_of_mass: float = 0.0015
    interlink_kind: str = "rigid"
    interlink_height: float = 0.0
    interlink_length_range: float = 0.0
    interlink_mass: float = 0.02
    interlink_bending_stiffness: float = 0.0
    universal_stiffness: float = 0.0
    ball_stiffness: float = 0.0
    yaw_stiffness: float = 0.0

    def __post_init__(self) -> None:
        """Check every field once.

        Raises:
            SpecError: A field makes no tool; names the field and what it may be.
        """
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", str(self.name)):
            self._refuse("name", "a letter, then letters, digits, _ or -")
        for side in ("rows", "columns"):
            count = getattr(self, side)
            whole = isinstance(count, int) and not isinstance(count, bool)
            if not (whole and 2 <= count <= MOST_CUPS_A_SIDE):
                self._refuse(side, f"a whole number from 2 to {MOST_CUPS_A_SIDE}")
        for field, kind in type(self).__annotations__.items():
            if kind is float:
                self._check_number(field)
        self._check_relations()

    @property
    def platform_size(self) -> tuple[float, float]:
        """Length of the platform along s and along t, [m]."""
        edge = 2 * (self.half_width + MARGIN)
        return (
            (self.columns - 1) * self.pitch + edge,
            (self.rows - 1) * self.pitch + edge,
        )

    def _check_number(self, field: str) -> None:
        """One field is finite and has the sign it needs."""
        value = getattr(self, field)
        if isinstance(value, bool) or not isinstance(value, int | float):
            self._refuse(field, "a number")
        if not math.isfinite(value):
            self._refuse(field, "finite")
        if field in MAY_BE_ZERO and value < 0:
            self._refuse(field, "zero or more")
        if field not in MAY_BE_ZERO + SIGNED and value <= 0:
            self._refuse(field, "more than zero")

    def _check_relations(self) -> None:
        """Fields agree with one another."""
        if self.half_width * 2 >= self.pitch:
            self._refuse("half_width", f"less than half the pitch, {self.pitch} m")
        if self.interlink_length_range >= self.pitch:
            self._refuse("interlink_length_range", f"less than {self.pitch} m")
        if self.leg_max <= self.leg_min:
            self._refuse("leg_max", f"more than leg_min, {self.leg_min} m")
        for field in ("universal_limit", "ball_limit", "yaw_limit"):
            if getattr(self, field) >= 90 * DEGREE:
                self._refuse(field, "less than pi/2 rad")
        if self.interlink_kind not in KINDS:
            self._refuse("interlink_kind", " or ".join(KINDS))
        resilient = self.interlink_kind == "resilient"
        if resilient != (self.interlink_bending_stiffness > 0):
            wanted = "more than zero" if resilient else "zero"
            self._refuse(
                "interlink_bending_stiffness", f"{wanted} in this kind of link"
            )

    def _refuse(self, field: str, wanted: str) -> NoReturn:
        """Raise the error of one field."""
        problem = f"{getattr(self, field)!r} makes no tool"
        raise SpecError("tool specification", field, problem, f"it must be {wanted}")


RIGID = ToolSpec()
RESILIENT = ToolSpec(
    name="drape_tool_6x8_resilient",
    ball_height=0.010,
    interlink_kind="resilient",
    interlink_bending_stiffness=0.1,
)
