"""The scene file: what to drape, where, with which tool, in which order."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationError, model_validator

from drapeplan.families import PathSection, RectangleBlendPath
from drapeplan.orders import SequenceChoice, SequenceSection
from drapeplan.reading import first_mistake, read_yaml
from drapeplan.section import (
    CupIndex,
    Degrees,
    Offset,
    Point3,
    Radians,
    Section,
    Signed,
    Size,
    Small,
    Width,
)


class RobotSection(Section):
    """The arm: a name in example-robot-data, or a URDF file."""

    name: str | None = None
    urdf: str | None = None
    home_rad: tuple[Radians, ...] = (0.0, -1.2, 1.6, -1.97, -1.5708, 0.0)
    payload_kg: Annotated[float, Field(gt=0, le=10000)] | None = None

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


def _curved(radius: float) -> float:
    if radius == 0:
        raise ValueError("a radius of 0 has no surface; kind: plane is flat")
    if not 0.01 <= abs(radius) <= 1e6:
        raise ValueError("a radius is 0.01 to 1e6 m either way; kind: plane is flat")
    return radius


Radius = Annotated[
    float, AfterValidator(_curved), Field(description="[m]; negative: concave")
]


class PlaneSurface(Section):
    """A flat mold."""

    kind: Literal["plane"]


class ParaboloidSurface(Section):
    """z = -x^2 / (2 radius_x) - y^2 / (2 radius_y)."""

    kind: Literal["paraboloid"]
    radius_x_m: Radius
    radius_y_m: Radius


class SphereSurface(Section):
    """A spherical cap."""

    kind: Literal["sphere"]
    radius_m: Radius


class CylinderSurface(Section):
    """A cylinder with its axis along y."""

    kind: Literal["cylinder"]
    radius_m: Radius


class RidgeSurface(Section):
    """A Gaussian ridge along t."""

    kind: Literal["ridge"]
    height_mm: Signed = 15.0
    sigma_mm: Width = 100.0
    offset_mm: Signed = 110.0


class StepSurface(Section):
    """A smooth step along t."""

    kind: Literal["step"]
    height_mm: Signed = 30.0
    width_mm: Width = 40.0
    offset_mm: Signed = 110.0


class KindrapeSurface(Section):
    """KinDrape's generic double-curved mold, scaled."""

    kind: Literal["kindrape"]
    relief: Annotated[float, Field(ge=-10, le=10)] = 0.3
    size_m: Annotated[float, Field(ge=0.1, le=10)] = 1.0


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

    path: Annotated[str, Field(min_length=1)]
    unit: Literal["mm", "cm", "m", "inch"]


class MoldSection(Section):
    """The mold: an analytic surface or a mesh, and where it stands."""

    surface: SurfaceSection | None = None
    mesh: MeshSection | None = None
    position_m: Point3 = (0.75, 0.0, 0.20)
    rotation_deg: tuple[Degrees, Degrees, Degrees] = (0.0, 0.0, 0.0)
    grid_step_mm: Annotated[float, Field(ge=1, le=20)] = 5.0

    @model_validator(mode="after")
    def _one_source(self) -> MoldSection:
        if (self.surface is None) == (self.mesh is None):
            raise ValueError("give either surface or mesh")
        return self


OF_PATH = "hash of the path section that it was found for"
SAMPLES = "of the samples of check --robustness"
MODEL = "shape between the cups; auto: the cheapest within tolerance.shape_mm"
LEFT_OUT = "change of the ply's shape that need not be modeled"


class PlySection(Section):
    """The ply and its material."""

    take_up_mm: Annotated[float, Field(ge=0, le=50)] = 0.8
    areal_mass_kg_m2: Annotated[float, Field(ge=0, le=100)] = 0.31
    bending_stiffness_Nm: Annotated[float, Field(ge=1e-6, le=1000)] = 0.02
    overhang_mm: Annotated[float, Field(ge=0, le=500)] = 20.0
    sample_mm: Annotated[float, Field(ge=2, le=35)] = 10.0
    model: Annotated[Literal["auto", "cubic", "modal"], Field(description=MODEL)] = (
        "auto"
    )


class PlacementSection(Section):
    """Which cup meets which point of the mold; default: middle on middle."""

    cup: CupIndex | None = None
    mold_point_m: tuple[Offset, Offset] = (0.0, 0.0)
    warp_deg: Degrees = 0.0


class PickSection(Section):
    """The flat table that the ply is picked from."""

    position_m: Point3 = (0.0, 0.85, 0.20)
    yaw_deg: Degrees = 90.0


class MotionSection(Section):
    """Heights and times of the path."""

    lift_mm: Size = 120.0
    clearance_mm: Size = 50.0
    step_time_s: Annotated[float, Field(ge=0.01, le=3600)] = 4.0
    speed_fraction: Annotated[float, Field(ge=0.001, le=1)] = 0.25


Spread = Annotated[float, Field(ge=0, le=20)]  # [mm], [deg] standard deviation
Share = Annotated[float, Field(ge=0, le=1)]


class UncertaintySection(Section):
    """What is not known: standard deviations, and what presses back."""

    position_mm: Spread = 0.3
    angle_deg: Spread = 0.5
    redrawn_share: Share = 0.0
    tilt_deg: Spread = 0.2
    take_up_share: Share = 0.1
    stiffness_log: Share = 0.2
    mold_xy_mm: Spread = 0.3
    mold_z_mm: Spread = 0.2
    mold_yaw_deg: Spread = 0.05
    press_N_per_mm: Annotated[float, Field(gt=0, le=1000)] = 2.0


class ToleranceSection(Section):
    """What counts as touching, as a barrier, and as penetration."""

    touch_mm: Small = 0.5
    barrier_mm: Small = 0.5
    penetration_mm: Small = 0.5
    pad_penetration_mm: Small = 1.0
    laid_sink_mm: Small = 3.0
    laid_bridge_mm: Small = 3.0
    shape_mm: Annotated[Small, Field(description=LEFT_OUT)] = 0.2


class CountedSection(Section):
    """Samples in the wrong order, null where there is no plan, and the plan itself."""

    wrong: Annotated[int, Field(ge=0)] | None
    good: bool


class TunedSection(Section):
    """What `tune` gained, on samples that it chose nothing by; nothing reads it."""

    samples: Annotated[int, Field(ge=1)]
    before: CountedSection
    after: CountedSection
    path: Annotated[str, Field(description=OF_PATH)]


class Scene(Section):
    """Everything that a plan is made from."""

    format: Literal["drapeplan-scene/1"]
    robot: RobotSection = RobotSection(name="ur10")
    tool: ToolSection = ToolSection(name="drape_tool_6x8")
    mold: MoldSection
    ply: PlySection = PlySection()
    placement: PlacementSection = PlacementSection()
    pick: PickSection = PickSection()
    sequence: SequenceChoice = SequenceSection()
    path: PathSection = RectangleBlendPath()
    motion: MotionSection = MotionSection()
    tolerance: ToleranceSection = ToleranceSection()
    uncertainty: UncertaintySection = UncertaintySection()
    fidelity: Literal["equilibrium", "kinematic"] = "equilibrium"
    seed: Annotated[int, Field(ge=0, description=SAMPLES)] = 0
    tuned: TunedSection | None = None

    @model_validator(mode="before")
    @classmethod
    def _radial_order(cls, data: Any) -> Any:
        """The radial family lays cups in the order of their distance."""
        if not isinstance(data, dict) or _named(data, "path", "family") != "radial":
            return data
        sequence = data.get("sequence") or {}
        if not isinstance(sequence, dict):
            return data
        if _named(data, "sequence", "pattern") in (None, "auto"):
            sequence = {**sequence, "pattern": "radial"}
        return {**data, "sequence": sequence}

    @model_validator(mode="after")
    def _family_fits_the_order(self) -> Scene:
        if self.sequence == "auto":
            if self.path.toe_up_steps:
                raise ValueError("path.toe_up_steps needs a sequence that is known")
            return self
        pattern, family = self.sequence.pattern, self.path.family
        if pattern == "radial" and family == "rectangle_blend":
            raise ValueError("pattern radial needs path.family radial or hover")
        if family == "radial" and (pattern != "radial" or self.sequence.steps):
            raise ValueError("path.family radial needs pattern radial")
        return self


def read_scene(path: Path) -> Scene:
    """Scene from a YAML file.

    Args:
        path: The file.

    Raises:
        InputError: If the file is missing, is not YAML, or a value is not allowed;
            the message names the file, the key and the remedy.
    """
    return scene_from(read_yaml(path), str(path))


def scene_from(data: dict[str, Any], source: str) -> Scene:
    """Scene from plain data; `source` names it in error messages."""
    try:
        return Scene.model_validate(data)
    except ValidationError as error:
        raise first_mistake(error, source, _KEYS, _VARIANTS) from error


def _named(data: dict[str, Any], section: str, key: str) -> Any:
    """What raw data say under a key, None if nothing."""
    part = data.get(section)
    return part.get(key) if isinstance(part, dict) else getattr(part, key, None)


def _all_keys() -> set[str]:
    """Names of all keys, to suggest one for a misspelled key."""
    schema = Scene.model_json_schema()
    parts = [schema, *schema["$defs"].values()]
    return {key for part in parts for key in part.get("properties", {})}


_KEYS = sorted(_all_keys())
_VARIANTS = {
    *("plane", "paraboloid", "sphere", "cylinder", "ridge", "step", "kindrape"),
    *("rectangle_blend", "radial", "hover", "constrained-float"),
    *("keys", "word"),
}
