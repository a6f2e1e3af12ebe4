"""The scene file: what to drape, where, with which tool, in which order."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from drapeplan.errors import InputError

Vector3 = tuple[float, float, float]
Vector2 = tuple[float, float]
CupIndex = tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]


class Section(BaseModel):
    """A part of the scene: unknown keys, infinities and NaN are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class RobotSection(Section):
    """The arm: a name in example-robot-data, or a URDF file."""

    name: str | None = None
    urdf: str | None = None
    home_rad: tuple[float, ...] = (0.0, -1.2, 1.6, -1.97, -1.5708, 0.0)

    @model_validator(mode="after")
    def _one_source(self) -> RobotSection:
        if (self.name is None) == (self.urdf is None):
            raise ValueError("give either name or urdf")
        return self


class ToolSection(Section):
    """The drape tool: a name in urdf/, or a URDF file with its sidecar beside it."""

    name: str | None = None
    urdf: str | None = None

    @model_validator(mode="after")
    def _one_source(self) -> ToolSection:
        if (self.name is None) == (self.urdf is None):
            raise ValueError("give either name or urdf")
        return self


def _signed_radius(**kwargs: Any) -> Any:
    return Field(description="[m]; negative: concave", **kwargs)


class PlaneSurface(Section):
    """A flat mold."""

    kind: Literal["plane"]


class ParaboloidSurface(Section):
    """z = -x^2 / (2 radius_x) - y^2 / (2 radius_y)."""

    kind: Literal["paraboloid"]
    radius_x_m: float = _signed_radius()
    radius_y_m: float = _signed_radius()

    @model_validator(mode="after")
    def _no_zero(self) -> ParaboloidSurface:
        if self.radius_x_m == 0 or self.radius_y_m == 0:
            raise ValueError("a radius of 0 has no surface; kind: plane is flat")
        return self


class SphereSurface(Section):
    """A spherical cap."""

    kind: Literal["sphere"]
    radius_m: float = _signed_radius()

    @model_validator(mode="after")
    def _no_zero(self) -> SphereSurface:
        if self.radius_m == 0:
            raise ValueError("a radius of 0 has no surface")
        return self


class CylinderSurface(Section):
    """A cylinder with its axis along y."""

    kind: Literal["cylinder"]
    radius_m: float = _signed_radius()

    @model_validator(mode="after")
    def _no_zero(self) -> CylinderSurface:
        if self.radius_m == 0:
            raise ValueError("a radius of 0 has no surface")
        return self


class RidgeSurface(Section):
    """A Gaussian ridge along t."""

    kind: Literal["ridge"]
    height_mm: float = 15.0
    sigma_mm: Positive = 100.0
    offset_mm: float = 110.0


class StepSurface(Section):
    """A smooth step along t."""

    kind: Literal["step"]
    height_mm: float = 30.0
    width_mm: Positive = 40.0
    offset_mm: float = 110.0


class KindrapeSurface(Section):
    """KinDrape's generic double-curved mold, scaled."""

    kind: Literal["kindrape"]
    relief: float = 0.3
    size_m: Positive = 1.0


SurfaceSection = Annotated[
    PlaneSurface
    | ParaboloidSurface
    | SphereSurface
    | CylinderSurface
    | RidgeSurface
    | StepSurface
    | KindrapeSurface,
    Field(discriminator="kind"),
]


class MeshSection(Section):
    """A mesh file; its own coordinates are the mold frame, z up."""

    path: str
    unit: Literal["mm", "cm", "m", "inch"]


class MoldSection(Section):
    """The mold: an analytic surface or a mesh, and where it stands."""

    surface: SurfaceSection | None = None
    mesh: MeshSection | None = None
    position_m: Vector3 = (0.75, 0.0, 0.20)
    rotation_deg: Vector3 = (0.0, 0.0, 0.0)
    grid_step_mm: Annotated[float, Field(ge=1, le=20)] = 5.0

    @model_validator(mode="after")
    def _one_source(self) -> MoldSection:
        if (self.surface is None) == (self.mesh is None):
            raise ValueError("give either surface or mesh")
        return self


class PlySection(Section):
    """The ply and its material."""

    take_up_mm: NonNegative = 0.8
    areal_mass_kg_m2: NonNegative = 0.31
    bending_stiffness_Nm: Positive = 0.02
    overhang_mm: NonNegative = 20.0
    sample_mm: Annotated[float, Field(ge=2, le=35)] = 10.0


class PlacementSection(Section):
    """Which cup meets which point of the mold; default: middle on middle."""

    cup: CupIndex | None = None
    mold_point_m: Vector2 = (0.0, 0.0)
    warp_deg: float = 0.0


class PickSection(Section):
    """The flat table that the ply is picked from."""

    position_m: Vector3 = (0.0, 0.75, 0.20)
    yaw_deg: float = 0.0


class SequenceSection(Section):
    """Start cup and wave steps."""

    start: CupIndex | Literal["auto"] = "auto"
    pattern: Literal["auto", "all_sides", "alternate_sides", "spine_s", "spine_t"] = (
        "auto"
    )
    steps: tuple[tuple[CupIndex, ...], ...] | None = None


class RectangleBlendPath(Section):
    """The lifted surface rolls down on the sides of the placed rectangle."""

    family: Literal["rectangle_blend"] = "rectangle_blend"
    lift_per_m: Positive = 0.6
    bend_mm: Positive = 120.0
    poses_per_step: Annotated[int, Field(ge=3, le=200)] = 10
    last_gap_mm: Positive = 0.2


class HoverPath(Section):
    """The ply arrives, hovers over the mold, and its cups are pressed down."""

    family: Literal["hover"]
    height_mm: Positive = 5.0
    arrival: Literal["flat", "shaped"] = "flat"
    poses_per_step: Annotated[int, Field(ge=3, le=200)] = 10
    last_gap_mm: Positive = 0.2


PathSection = Annotated[RectangleBlendPath | HoverPath, Field(discriminator="family")]


class MotionSection(Section):
    """Heights and times of the path."""

    lift_mm: Positive = 120.0
    clearance_mm: Positive = 50.0
    step_time_s: Positive = 4.0
    speed_fraction: Annotated[float, Field(gt=0, le=1)] = 0.25


class ToleranceSection(Section):
    """What counts as touching, as a barrier, and as penetration."""

    touch_mm: Positive = 0.5
    barrier_mm: Positive = 0.5
    penetration_mm: Positive = 0.3
    pad_penetration_mm: Positive = 1.0
    shape_mm: Positive = 0.2


class Scene(Section):
    """Everything that a plan is made from."""

    format: Literal["drapeplan-scene/1"]
    robot: RobotSection = RobotSection(name="ur10")
    tool: ToolSection = ToolSection(name="drape_tool_6x8")
    mold: MoldSection
    ply: PlySection = PlySection()
    placement: PlacementSection = PlacementSection()
    pick: PickSection = PickSection()
    sequence: SequenceSection = SequenceSection()
    path: PathSection = RectangleBlendPath()
    motion: MotionSection = MotionSection()
    tolerance: ToleranceSection = ToleranceSection()
    fidelity: Literal["kinematic"] = "kinematic"
    seed: Annotated[int, Field(ge=0)] = 0


def read_scene(path: Path) -> Scene:
    """Scene from a YAML file.

    Args:
        path: The file.

    Raises:
        InputError: If the file is missing, is not YAML, or a value is not allowed;
            the message names the file, the key and the remedy.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "is not a text file"
        raise InputError(str(path), "", f"cannot read it ({reason})") from error
    try:
        data = yaml.safe_load(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f"line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or "is not YAML"
        raise InputError(str(path), line, str(problem), "mend the YAML") from error
    if not isinstance(data, dict):
        raise InputError(
            str(path), "", "holds no keys", "start from a file in examples/"
        )
    return scene_from(data, str(path))


def scene_from(data: dict[str, Any], source: str) -> Scene:
    """Scene from plain data; `source` names it in error messages."""
    try:
        return Scene.model_validate(data)
    except ValidationError as error:
        raise _clear_line(error, source) from error


def _clear_line(error: ValidationError, source: str) -> InputError:
    """The first mistake of many as one line; misspelled keys come first."""
    errors = sorted(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
    first = errors[0]
    location = [str(part) for part in first["loc"] if not _is_variant(str(part))]
    kind, limits = first["type"], first.get("ctx", {})
    problem = first["msg"].removeprefix("Value error, ")
    problem = problem[0].lower() + problem[1:]
    remedy = "drapeplan schema lists what is allowed"
    if kind == "extra_forbidden":
        problem = "unknown key"
        near = difflib.get_close_matches(location[-1], _KEYS, 1)
        remedy = f"did you mean {near[0]}?" if near else "remove it"
    elif kind == "missing":
        problem, remedy = "is missing", "add it"
    elif kind == "finite_number":
        problem, remedy = "must be a finite number", "kind: plane is flat"
        if "radius" not in location[-1]:
            remedy = "give a finite number"
    elif kind in _BOUNDS:
        words, key = _BOUNDS[kind]
        problem, remedy = f"must be {words} {limits[key]:g}", "mend the number"
    elif kind == "union_tag_invalid":
        problem = f"unknown {limits['discriminator']} {limits['tag']!r}"
        remedy = f"known: {limits['expected_tags']}"
    elif kind == "union_tag_not_found":
        problem = f"needs a key {limits['discriminator']}"
    if not isinstance(first["input"], dict | list | tuple):
        problem = f"{problem} (found {first['input']!r})"
    if len(errors) > 1:
        remedy += f" ({len(errors) - 1} more to mend)"
    return InputError(source, ".".join(location), problem, remedy)


def _is_variant(part: str) -> bool:
    """Whether pydantic put the chosen variant of a union into an error's place."""
    return part in _VARIANTS or part.startswith(("tuple[", "literal["))


def _all_keys() -> set[str]:
    """Names of all keys, to suggest one for a misspelled key."""
    schema = Scene.model_json_schema()
    parts = [schema, *schema["$defs"].values()]
    return {key for part in parts for key in part.get("properties", {})}


_KEYS = sorted(_all_keys())
_VARIANTS = {
    *("plane", "paraboloid", "sphere", "cylinder", "ridge", "step", "kindrape"),
    *("rectangle_blend", "hover"),
}
_BOUNDS = {
    "greater_than": ("greater than", "gt"),
    "greater_than_equal": ("at least", "ge"),
    "less_than": ("less than", "lt"),
    "less_than_equal": ("at most", "le"),
}
