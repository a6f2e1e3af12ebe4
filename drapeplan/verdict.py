"""The verdict of the front check: tolerances, events, margins, and their plain form."""

from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np

from drapeplan.flood import Bools, Floats

DIGITS = 9  # decimals of a millimeter in the plain form: 1e-12 m, below any solver


@dataclass(frozen=True)
class Tolerance:
    """Sizes below which the front check sees nothing, all in [m].

    Attributes:
        touch: Height up to which the ply counts as touching (eps).
        barrier: Least height of a hump that separates, or of a hollow that traps.
        penetration: Depth that a span may sink below its laid state.
        pad_penetration: The same for the pads of cups that are landing.
    """

    touch: float = 0.5e-3
    barrier: float = 0.5e-3
    penetration: float = 0.3e-3
    pad_penetration: float = 1.0e-3


class EventKind(StrEnum):
    """What can go wrong at the front."""

    PREMATURE = "premature_contact"
    AIR_POCKET = "air_pocket"
    PENETRATION = "penetration"
    PAD_PENETRATION = "pad_penetration"


@dataclass(frozen=True)
class FrontEvent:
    """One thing that went wrong, in one pose.

    Attributes:
        kind: What.
        pose: Index of the pose.
        place_st: Its deepest sample, material coordinates (s, t) in [m].
        cup: Nearest cup, (row, column).
        area: Touching, hollow or sunken area on the ply, in [m^2].
        volume: Volume between it and its laid state, in [m^3].
        depth: Largest height of a pocket, else largest depth below the laid state, in
            [m]; zero for a premature contact that only touches.
    """

    kind: EventKind
    pose: int
    place_st: tuple[float, float]
    cup: tuple[int, int]
    area: float
    volume: float
    depth: float

    @property
    def severity(self) -> float:
        """What ranks events of one kind: volume of air, area of contact, or depth."""
        if self.kind is EventKind.AIR_POCKET:
            return self.volume
        return self.area if self.kind is EventKind.PREMATURE else self.depth

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, the unit in the key."""
        return {
            "kind": self.kind.value,
            "pose": self.pose,
            "place_mm": [_rounded(1e3 * x) for x in self.place_st],
            "cup": list(self.cup),
            "area_mm2": _rounded(1e6 * self.area),
            "volume_mm3": _rounded(1e9 * self.volume),
            "depth_mm": _rounded(1e3 * self.depth),
        }


@dataclass(frozen=True)
class Spot:
    """A value and where on the ply it stands.

    Attributes:
        value: The value, in [m].
        place_st: Material coordinates (s, t), in [m].
        cup: Nearest cup, (row, column).
        pose: Index of the pose, or None for the laid state.
    """

    value: float
    place_st: tuple[float, float]
    cup: tuple[int, int]
    pose: int | None = None

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, the unit in the key."""
        plain = {
            "value_mm": _rounded(1e3 * self.value),
            "place_mm": [_rounded(1e3 * x) for x in self.place_st],
            "cup": list(self.cup),
        }
        return plain if self.pose is None else {"pose": self.pose, **plain}


@dataclass(frozen=True)
class FrontVerdict:
    """Whether the ply touches the mold outward from the start, with the evidence.

    Margins are infinite where nothing threatens; at zero or below, the thing happens.

    Attributes:
        tolerance: What the verdict was judged by.
        start_cup: The cup placed first, (row, column).
        premature_margin: Fall left until a premature contact, shape (K,), in [m].
        air_margin: Fall left until an air pocket closes, shape (K,), in [m].
        span_penetration: Deepest free sample off landing pads, shape (K,), in [m].
        pad_penetration: Deepest sample on landing pads, shape (K,), in [m].
        contact_area: Touching part of the ply's area, shape (K,).
        laid_deviation: Largest abs(gap - final gap) of laid samples, shape (K,), in
            [m]: whether what counts as laid is where the laid state has it.
        worst_premature: Least premature margin, or None where nothing ever threatens.
        worst_air: Least air margin, or None.
        highest: Where the laid ply stands highest above the mold: bridging.
        lowest: Where the laid ply stands lowest; negative is inside the mold.
        events: Per kind the first occurrence and, if it is another one, the worst.
        starts_free: Whether nothing touches in the first pose.
        first_touch: Pose of the first touch, shape (nt, ns), interpolated between
            poses: a sample touches by pose k if first_touch <= k; infinite for never.
        premature_region: Samples ever in a premature contact, shape (nt, ns).
        pocket_region: Samples ever in an air pocket, shape (nt, ns).
        poses_between: Poses that were judged between the K poses; what they show
            counts for the pose that follows.
    """

    tolerance: Tolerance
    start_cup: tuple[int, int]
    premature_margin: Floats
    air_margin: Floats
    span_penetration: Floats
    pad_penetration: Floats
    contact_area: Floats
    laid_deviation: Floats
    worst_premature: Spot | None
    worst_air: Spot | None
    highest: Spot
    lowest: Spot
    events: tuple[FrontEvent, ...]
    starts_free: bool
    first_touch: Floats = field(repr=False)
    premature_region: Bools = field(repr=False)
    pocket_region: Bools = field(repr=False)
    poses_between: int = 0

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    @property
    def in_order(self) -> bool:
        """Whether there is no premature contact and no air pocket in any pose."""
        return bool(min(self.premature_margin.min(), self.air_margin.min()) > 0)

    @property
    def penetrates(self) -> bool:
        """Whether spans or landing pads sink deeper than they may."""
        spans = self.span_penetration.max() > self.tolerance.penetration
        pads = self.pad_penetration.max() > self.tolerance.pad_penetration
        return bool(spans or pads)

    @property
    def passed(self) -> bool:
        """Whether the ply is in order and does not penetrate."""
        return self.in_order and not self.penetrates

    def to_dict(self) -> dict[str, Any]:
        """Everything but the fields over the ply, as plain numbers for a plan file.

        Lengths are in the key's unit, rounded to 1e-9 of it; None stands for infinite.
        The same verdict gives the same dictionary, and so the same bytes of JSON.
        """
        spots = ("worst_premature", "worst_air", "highest", "lowest")
        found = {name: getattr(self, name) for name in spots}
        per_pose = {
            "premature_margin_mm": _plain(1e3 * self.premature_margin),
            "air_margin_mm": _plain(1e3 * self.air_margin),
            "span_penetration_mm": _plain(1e3 * self.span_penetration),
            "pad_penetration_mm": _plain(1e3 * self.pad_penetration),
            "laid_deviation_mm": _plain(1e3 * self.laid_deviation),
            "contact_area": _plain(self.contact_area),
        }
        return {
            "passed": self.passed,
            "in_order": self.in_order,
            "penetrates": self.penetrates,
            "starts_free": self.starts_free,
            "poses_between": self.poses_between,
            "start_cup": list(self.start_cup),
            "tolerance": {
                f"{name}_mm": _rounded(1e3 * x)
                for name, x in asdict(self.tolerance).items()
            },
            **{name: x and x.to_dict() for name, x in found.items()},
            "events": [event.to_dict() for event in self.events],
            "per_pose": per_pose,
        }


def _plain(values: Floats) -> list[float | None]:
    """Rounded Python numbers, None where infinite."""
    return [_rounded(x) if np.isfinite(x) else None for x in values]


def _rounded(value: float) -> float:
    """Python number with DIGITS decimals and no negative zero."""
    return round(float(value), DIGITS) + 0.0
