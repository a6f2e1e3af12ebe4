"""Tuning space: the typed parameters of a path family as a point of a unit box.

Times are no parameters: the drape is judged at rest, so no margin depends on them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drapeplan.families import HoverPath, RadialPath, RectangleBlendPath, known
from drapeplan.path_choice import STEEP, WIDE
from drapeplan.scene import Scene

Array = NDArray[np.float64]
Path = RectangleBlendPath | RadialPath | HoverPath
DIGITS = 4  # [-] of a parameter: far finer than anything that can be told apart


@dataclass(frozen=True)
class Knob:
    """One parameter and where it is looked for.

    Attributes:
        name: Its key in the path section; lift along s and t have one each.
        low: Least value, in the unit of the name.
        high: Largest value.
        log: Whether ratios count rather than differences.
        of_rest: Whether it shows at equilibrium alone.
    """

    name: str
    low: float
    high: float
    log: bool = False
    of_rest: bool = False


TOE = Knob("toe_up_deg", 0.0, 6.0, of_rest=True)
BEND = Knob("bend_mm", 40.0, 400.0, log=True)
KNOBS: dict[str, tuple[Knob, ...]] = {
    "rectangle_blend": (
        Knob("lift_s_per_m", 0.15, 3.0, log=True),
        Knob("lift_t_per_m", 0.15, 3.0, log=True),
        BEND,
        Knob("rim_offset_mm", -20.0, 60.0),
        TOE,
    ),
    "radial": (
        Knob("lift_per_m", 0.15, 3.0, log=True),
        BEND,
        Knob("front_offset_mm", 0.0, 80.0),
        TOE,
    ),
    "hover": (Knob("height_mm", 2.0, 40.0, log=True), TOE),
}
# Paths that have proved themselves, values in the order of the knobs: that of flat and
# convex molds, those of hollow borders either way, and one between them.
KNOWN: dict[str, tuple[Sequence[float], ...]] = {
    "rectangle_blend": (
        STEEP.tolist(),
        WIDE.tolist(),
        [WIDE[1], WIDE[0], *WIDE[2:]],
        [0.27, 0.36, 400.0, -8.0, 3.0],
    ),
    "radial": ((0.6, 120.0, 10.0, 2.0),),
    "hover": ((5.0, 2.0),),
}


MOST_TOE = 8.0  # [deg] of the steps that are looked at by themselves


class StepSpace:
    """Lean of the cups of some steps of one path, as a point of a unit box."""

    def __init__(self, base: Path, steps: list[int]) -> None:
        """Lay out the box.

        Args:
            base: The path; the rest of it stays.
            steps: Wave steps, from 1.
        """
        self.base, self.steps, self.size = base, steps, len(steps)

    def point(self, path: Path) -> Array:
        """A path as a point of the box, shape (n,), from 0 to 1."""
        angles = dict(path.toe_up_steps)
        found = [angles.get(step, known(path.toe_up_deg)) for step in self.steps]
        return np.clip(np.array(found) / MOST_TOE, 0, 1)

    def path(self, point: Array) -> Path:
        """The path of a point, shape (n,), its angles rounded to DIGITS."""
        angles = (MOST_TOE * np.clip(point, 0, 1)).tolist()
        found = (float(f"{angle:.{DIGITS}g}") for angle in angles)
        every = dict(self.base.toe_up_steps) | dict(zip(self.steps, found, strict=True))
        pairs = tuple(sorted(every.items()))
        return self.base.model_copy(update={"toe_up_steps": pairs})


class Space:
    """The box around a scene's path family, wide enough for the scene's own values."""

    def __init__(self, scene: Scene, rest: bool) -> None:
        """Lay out the box.

        Args:
            scene: Gives the family and the values that nothing tunes.
            rest: Whether paths are judged at equilibrium.
        """
        self.base: Path = scene.path
        family = KNOBS[self.base.family]
        self.knobs = tuple(knob for knob in family if rest or not knob.of_rest)
        own = list(self.values(self.base).values())
        low = np.minimum([knob.low for knob in self.knobs], own)
        high = np.maximum([knob.high for knob in self.knobs], own)
        self.size = len(self.knobs)
        self.log = np.array([knob.log for knob in self.knobs])
        self.low, self.high = self._scaled(low), self._scaled(high)

    def values(self, path: Path) -> dict[str, float]:
        """What is tuned, by name.

        Args:
            path: A path of the family.
        """
        section = path.model_dump()
        lift = section.get("lift_per_m")
        s, t = lift if isinstance(lift, tuple) else (lift, lift)
        section |= {"lift_s_per_m": s, "lift_t_per_m": t}
        return {knob.name: float(section[knob.name]) for knob in self.knobs}

    def point(self, path: Path) -> Array:
        """A path as a point of the box, shape (n,), from 0 to 1."""
        own = np.array(list(self.values(path).values()))
        return np.asarray((self._scaled(own) - self.low) / (self.high - self.low))

    def path(self, point: Array) -> Path:
        """The path of a point, its values rounded to DIGITS.

        Args:
            point: Shape (n,); what lies outside the box is brought to its border.
        """
        scaled = self.low + np.clip(point, 0, 1) * (self.high - self.low)
        return self._path(np.where(self.log, np.exp(scaled), scaled).tolist())

    def known(self) -> list[Path]:
        """Paths of the family that have proved themselves on some mold."""
        every = KNOWN[self.base.family]
        return [self._path(values[: len(self.knobs)]) for values in every]

    def _path(self, values: Iterable[float]) -> Path:
        found: dict[str, Any] = {
            knob.name: float(f"{value:.{DIGITS}g}")
            for knob, value in zip(self.knobs, values, strict=True)
        }
        if "lift_s_per_m" in found:
            lift = found.pop("lift_s_per_m"), found.pop("lift_t_per_m")
            found["lift_per_m"] = lift
        return type(self.base).model_validate(self.base.model_dump() | found)

    def _scaled(self, values: Array) -> Array:
        return np.where(self.log, np.log(np.maximum(values, 1e-12)), values)
