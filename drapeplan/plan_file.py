"""Plan file: its keys, checked when it is read and published as a schema.

Besides what every plan has, `robustness` is there if the plan was asked for it: what
becomes of the drape in samples of its scene's `uncertainty`. Millimeters, newtons and
shares; None stands where nothing threatens, and margins of `parameters` end at 3 mm.
Quantiles are samples themselves, under the keys "5", "50" and "95".

    {"samples": 64, "seed": 0, "depth": "poses",
     "uncertainty": {"position_mm": 0.3, ...},
     "wrong_order": {"samples": 2, "share": 0.03125, "low_95": 0.004, "high_95": 0.108,
                     "premature": 2, "air_pocket": 0, "no_rest": 0},
     "planned_margin_mm": 0.61,
     "margin_mm": {"premature": {"5": 0.1, "50": 0.4, "95": 0.7}, "air": {...}},
     "press": {"depth_mm": {...}, "planned_depth_mm": 0.1, "force_N": {...}},
     "worst_step": {"step": 6, "cups": [[5, 2]], "wrong": 2, "mean_margin_mm": 0.4},
     "parameters": [{"parameter": "angle", "samples": 32, "P": 0.03,
                     "margin_mm": {...}, "press_mm": {...}}, ...],
     "largest_link_error_mm": 1e-6, "approximations": ["...", ...]}

`parameters` looks at each uncertainty alone, the one that hurts most first: the bars of
a tornado. Step 0 of `worst_step` is the start cup; it is None where no step is near.

`candidates` is there if the scene left the sequence to a search; the plan's `scene` has
the one that was taken. The best stands first and is this plan: a check makes its row
anew. The others are taken as given.

    {"samples": 64, "seed": 0, "rows": [
        {"start": [3, 2], "pattern": "spine_t", "why": "...", "fidelity": "equilibrium",
         "good": true, "refused": null, "not_good": [], "shortfall": 0.0, "samples": 64,
         "wrong": 0, "low_margin_mm": 3.0, "margin_mm": null, "penetration_mm": 0.08,
         "stroke_mm": 180.0, "largest_shear_deg": 1.2, "take_up_left_mm": 0.5,
         "steps": 7, "time_s": 33.0}, ...]}

`samples` of 0 stands where a kinematic plan was enough to see that others are better,
`refused` where no joint positions lay the ply, `low_margin_mm` for the 5 % quantile of
the samples' margins, at most 3 mm.

`path_choice` is there if the scene left its path to the mold; the plan's `scene` has
the values that were taken. Curvatures are those of the mold where the ply's
border lands, positive where it is hollow, of both ends the more hollow one; `wide` is
the share of the path for hollow borders.

    {"hollow_s_per_m": 0.65, "hollow_t_per_m": -0.53, "wide": 1.0}
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from drapeplan.scene import UncertaintySection

MOST_SAMPLES = 100_000  # [-] of a plan under uncertainty: hours of work
Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0, le=MOST_SAMPLES)]
Samples = Annotated[int, Field(ge=1, le=MOST_SAMPLES)]
Quantiles = dict[Literal["5", "50", "95"], float | None]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class _Arm(_Strict):
    urdf: str
    joint_names: list[str]


class _Tool(_Strict):
    urdf: str
    sidecar: str
    leg_joint_names: list[list[str]]


class _Targets(_Strict):
    position_m: list[list[float]]
    rotation: list[list[list[float]]]


class _Sequence(_Strict):
    start_cup: tuple[int, int]
    pattern: str
    steps: list[list[tuple[int, int]]]


class _Waypoint(_Strict):
    phase: Literal["pick", "lift", "preshape", "approach", "wave", "release", "retreat"]
    step: int
    tau: float
    time_s: float
    arm_rad: list[float]
    legs: list[list[float]]
    strokes_m: list[float]
    position_m: list[list[float]]
    rotation: list[list[list[float]]]
    cups: str


class _WrongOrder(_Strict):
    samples: Count
    share: Share
    low_95: Share
    high_95: Share
    premature: Count
    air_pocket: Count
    no_rest: Count


class _Margins(_Strict):
    premature: Quantiles
    air: Quantiles


class _Press(_Strict):
    depth_mm: Quantiles
    planned_depth_mm: float
    force_N: Quantiles


class _WorstStep(_Strict):
    step: Annotated[int, Field(ge=0)]
    cups: list[tuple[int, int]]
    wrong: Count
    mean_margin_mm: float


class _Alone(_Strict):
    parameter: str
    samples: Samples
    P: Share
    margin_mm: Quantiles
    press_mm: Quantiles


class RobustnessBlock(_Strict):
    """A plan under uncertainty, as `robustness_words.document` writes it."""

    samples: Samples
    seed: Annotated[int, Field(ge=0)]
    depth: Literal["poses", "tool"]
    uncertainty: UncertaintySection
    wrong_order: _WrongOrder
    planned_margin_mm: float | None
    margin_mm: _Margins
    press: _Press
    worst_step: _WorstStep | None
    parameters: list[_Alone]
    largest_link_error_mm: float
    approximations: list[str]

    @model_validator(mode="after")
    def _counted(self) -> Self:
        """Refuse more samples gone wrong than there are."""
        wrong = self.wrong_order
        counts = [wrong.samples, wrong.premature, wrong.air_pocket, wrong.no_rest]
        counts += [self.worst_step.wrong] if self.worst_step else []
        if max(counts) > self.samples:
            raise ValueError(f"{max(counts)} of {self.samples} samples are too many")
        return self


class CandidateRow(_Strict):
    """One way to lay the ply, and what becomes of it."""

    start: tuple[int, int]
    pattern: str
    why: str
    fidelity: Literal["equilibrium", "kinematic"]
    good: bool
    refused: str | None = None
    not_good: list[str] = []
    shortfall: float = 0.0
    samples: Count = 0
    wrong: Count = 0
    low_margin_mm: float | None = None
    margin_mm: float | None = None
    penetration_mm: float | None = None
    stroke_mm: float | None = None
    largest_shear_deg: float | None = None
    take_up_left_mm: float | None = None
    steps: int
    time_s: float | None = None

    @property
    def wrong_share(self) -> float:
        """Share of samples in the wrong order."""
        return self.wrong / self.samples if self.samples else 0.0


class CandidatesBlock(_Strict):
    """What a plan was chosen from, as `drapeplan rank` tells it, the best first."""

    samples: Count
    seed: int
    rows: Annotated[list[CandidateRow], Field(min_length=1)]


class PathChoiceBlock(_Strict):
    """What of the mold decided on the path; see `path_choice`."""

    hollow_s_per_m: float
    hollow_t_per_m: float
    wide: Share


class Document(_Strict):
    """The file's keys; `scene` and `mold` have readers of their own.

    A `waypoint` here is an index, from 0; sentences and the preview count from 1.
    """

    format: Literal["drapeplan-plan/1"]
    hash: str
    versions: dict[str, str]
    scene: dict[str, Any]
    sources_sha256: dict[str, str]
    arm: _Arm
    tool: _Tool
    mold: dict[str, Any]
    sequence: _Sequence
    net: dict[str, float]
    kinematic_lag: dict[str, float]
    tool_shift_m: tuple[float, float, float]
    targets: _Targets
    waypoints: list[_Waypoint]
    verdict: dict[str, Any]
    robustness: RobustnessBlock | None = None
    candidates: CandidatesBlock | None = None
    path_choice: PathChoiceBlock | None = None
