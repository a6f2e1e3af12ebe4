"""Path families: how the ply comes down, and the parameters of each.

Keys of a rectangle blend that a scene leaves open, or gives as null, are taken from its
mold if all are; see `path_choice`.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    AfterValidator,
    Field,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)

from drapeplan.section import Section, Size, Small

T = TypeVar("T")
OPEN = "; null: from the mold, or {} if others are stated"
TOE = "[deg] by which landing cups lean back, their outer edge up"
OFFSET = (
    "[mm] from the placed pads' outer rim to where the lift begins; centers at least"
)
STEPS = "[wave step, deg], ... of steps whose cups lean back by another angle"
CIRCLE = "[mm] from the outermost placed center to where the lift begins"
LIFT = "[1/m] c of c d^2; one number, or one along s and one along t"
BEND = "[mm] over which the lift curves; straight beyond"
STEEPEST = 5  # [1/m] lifts a ply by half a meter at its corners, far beyond any use
Lift = Annotated[float, Field(gt=0, le=STEEPEST)]
Rim = Annotated[float, Field(ge=-20, le=100)]
Toe = Annotated[float, Field(ge=0, le=10)]
StepToe = tuple[Annotated[int, Field(ge=1)], Toe]


def _once(steps: tuple[StepToe, ...]) -> tuple[StepToe, ...]:
    """Each step has one angle."""
    if len({number for number, _ in steps}) < len(steps):
        raise ValueError("a step is named twice")
    return steps


StepToes = Annotated[
    tuple[StepToe, ...], AfterValidator(_once), Field(description=STEPS)
]


def _one_or_pair(value: Any, checked: ValidatorFunctionWrapHandler) -> Any:
    """A lift, or one sentence for all that can be wrong with it."""
    try:
        return checked(value)
    except ValidationError as error:
        raise ValueError(
            "must be one number or a pair (along s, along t), each greater than 0 and "
            f"at most {STEEPEST}"
        ) from error


Lifts = Annotated[Lift | tuple[Lift, Lift], WrapValidator(_one_or_pair)]


def known(value: T | None) -> T:
    """A key's value, which by now is no longer open.

    Raises:
        ValueError: It is: `path_choice.chosen_path` was not asked.
    """
    if value is None:
        raise ValueError("a key of the path is open still")
    return value


class FamilySection(Section):
    """What all families have: how finely cups come down, and steps that lean more."""

    poses_per_step: Annotated[int, Field(ge=3, le=200)] = 10
    last_gap_mm: Small = 0.2
    toe_up_steps: StepToes = ()


class RectangleBlendPath(FamilySection):
    """The lifted surface rolls down on the sides of the placed rectangle."""

    family: Literal["rectangle_blend"] = "rectangle_blend"
    lift_per_m: Lifts | None = Field(default=None, description=LIFT + OPEN.format(0.6))
    bend_mm: Size | None = Field(default=None, description=BEND + OPEN.format(120))
    rim_offset_mm: Rim | None = Field(default=None, description=OFFSET + OPEN.format(0))
    toe_up_deg: Toe | None = Field(default=None, description=TOE + OPEN.format(2))


class RadialPath(FamilySection):
    """The lifted surface rolls down in rings around the start cup."""

    family: Literal["radial"]
    lift_per_m: Lift = 0.6
    bend_mm: Annotated[Size, Field(description=BEND)] = 120.0
    front_offset_mm: Annotated[float, Field(ge=0, le=100, description=CIRCLE)] = 10.0
    toe_up_deg: Annotated[Toe, Field(description=TOE)] = 2.0


class HoverPath(FamilySection):
    """The ply arrives, hovers over the mold, and its cups are pressed down."""

    family: Literal["hover"]
    height_mm: Size = 5.0
    arrival: Literal["flat", "shaped"] = "flat"
    toe_up_deg: Annotated[Toe, Field(description=TOE)] = 2.0


PathSection = Annotated[
    RectangleBlendPath | RadialPath | HoverPath, Field(discriminator="family")
]
