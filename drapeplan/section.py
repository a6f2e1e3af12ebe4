"""Sections: parts of a scene that are checked where they enter, and their numbers."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

# Bounds far beyond any cell, yet short of where float64 loses or overflows.
Meters = Annotated[float, Field(ge=-100, le=100)]
Offset = Annotated[float, Field(ge=-10, le=10)]  # [m] along the mold
Degrees = Annotated[float, Field(ge=-360, le=360)]
Radians = Annotated[float, Field(ge=-10, le=10)]
Signed = Annotated[float, Field(ge=-1000, le=1000)]  # [mm] either way
Size = Annotated[float, Field(gt=0, le=10000)]  # [mm] of a feature or a move
Width = Annotated[float, Field(ge=1, le=10000)]  # [mm] of what a cup can feel
Small = Annotated[float, Field(gt=0, le=100)]  # [mm] of a tolerance
Point3 = tuple[Meters, Meters, Meters]
CupIndex = tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]]


class Section(BaseModel):
    """A part of the scene: unknown keys, infinities and NaN are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
