"""The ply models by name: what `shape` and `validate` hold a ply with."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from drapeplan.cups_file import EARTH, MM, Array, Cups
from drapeplan.errors import InputError
from ply.coupled import CoupledModel
from ply.ladder import TOLERANCE, Climb, Rung, ladder_alternatives
from ply.ladder_climb import Effect, gravity_effects
from ply.ladder_estimate import RIVAL
from ply.ladder_load import loaded
from ply.measures import estimates, measures
from ply.reconcile import reconcile
from ply.shape import PlyFibers, evaluate, ply_fibers

MODELS = ("auto", "cubic", "quartic", "modal", "coupled")
RUNGS = {  # lowest and highest rung of the models that know gravity and free edges
    "auto": (Rung.CUBIC, Rung.COUPLED),
    "modal": (Rung.MODAL, Rung.MODAL),
    "coupled": (Rung.COUPLED, Rung.COUPLED),
}
BENDING, AREAL_MASS = 5e-3, 0.31  # [N m], [kg/m^2] woven prepreg, where none is known
FEWEST_SHAPES = 4  # shapes by side, of which the one of least energy comes first


@dataclass(frozen=True, eq=False)
class Held:
    """A ply in one shape.

    Attributes:
        cups: The cups, with poses reconciled where their uncertainty is stated.
        model: Name of the model.
        fibers: Fibers of the shape.
        effects: What may bend the ply beyond the model, and whether it does here.
        climb: The ladder that shaped it, or None for the paper's models.
    """

    cups: Cups
    model: str
    fibers: PlyFibers
    effects: list[Effect]
    climb: Climb | None

    def points(self, s: ArrayLike, t: ArrayLike) -> Array:
        """Positions of material points (s, t) of equal shapes, in [m]."""
        s, t = np.broadcast_arrays(np.asarray(s, float), np.asarray(t, float))
        if self.climb is not None:
            return self.climb.points(s, t)
        cups, st = self.cups, np.stack([s.ravel(), t.ravel()], axis=-1)
        found = evaluate(cups.grid, self.fibers, cups.positions, cups.rotations, st)
        return found.reshape(*s.shape, 3)

    @property
    def rungs(self) -> list[str]:
        """Rungs of the patches and why, one line for those that are alike."""
        choice = self.climb is not None and self.model != "modal"
        return self.climb.lines() if choice and self.climb else []

    @property
    def words(self) -> list[str]:
        """Rungs, and what became of each effect."""
        return [*self.rungs, *effect_lines(self.cups, self.model, self.effects)]


def effect_lines(cups: Cups, model: str, effects: list[Effect]) -> list[str]:
    """What became of each effect; where the weight is unknown, what is missing."""
    lines = [effect.line for effect in effects]
    missing = [
        name
        for name, value in (
            ("areal mass", cups.areal_mass),
            ("bending stiffness", cups.bending),
        )
        if value is None
    ]
    if missing:
        return [
            *lines,
            f"gravity: not modeled: the cups file has no {' and no '.join(missing)}",
        ]
    if model not in RUNGS:
        lines += [f"gravity: not modeled: {model} fibers have no weight"]
    return lines


def hold(
    cups: Cups, model: str, count: int = 1, tolerance: float = TOLERANCE
) -> list[Held]:
    """Shapes of the ply between cups, least energy first.

    Args:
        cups: The cups.
        model: One of MODELS.
        count: Largest number of shapes; cubic and quartic know one. With more than one,
            every side that a strip may bulge to is tried, however much it bends.
        tolerance: What "auto" may lose, in [m]; gravity whose estimate is smaller is
            left out of every model.

    Returns:
        The shapes, one or more.

    Raises:
        InputError: The model does not exist, or the take-up is longer than a span.
    """
    check_model(model)
    if model not in RUNGS:
        return [_as_the_paper(cups, model, tolerance)]
    take_up = cups.take_up
    if cups.pose_sigma > 0 or cups.pose_sigma_angle > 0:
        poses = cups.positions, cups.rotations
        found = reconcile(cups.grid, *poses, cups.pose_sigma, cups.pose_sigma_angle)
        cups = replace(cups, positions=found.positions, rotations=found.rotations)
        take_up = max(take_up, found.take_up)
    lowest, highest = RUNGS[model]
    climbs = ladder_alternatives(
        *(cups.grid, cups.positions, cups.rotations, max(count, FEWEST_SHAPES)),
        tolerance=tolerance,
        model=_ply_model(cups, take_up),
        overhang=cups.overhang or 0.0,
        lowest=lowest,
        highest=highest,
        rival=RIVAL if count == 1 else np.inf,
    )
    shapes = [climbs.pose(n) for n in range(min(count, len(climbs.positions)))]
    return [Held(cups, model, one.fibers, one.effects(), one) for one in shapes]


def _as_the_paper(cups: Cups, model: str, tolerance: float) -> Held:
    """Fibers without a weight; what they leave out is estimated."""
    held = cups.grid, cups.positions, cups.rotations
    fibers = ply_fibers(*held, model=model, take_up=cups.take_up or None)
    own = _ply_model(cups, 0.0)
    load = loaded(cups.grid, held[1:], own, tolerance)[2]
    effects = gravity_effects(
        *(cups.grid, cups.rotations, own, cups.overhang or 0.0, tolerance),
        *(load.sag, np.zeros_like(load.heavy)),
    )
    return Held(cups, model, fibers, [e._replace(modeled=0) for e in effects], None)


def _ply_model(cups: Cups, take_up: float) -> CoupledModel:
    """Stiffness and weight of the ply, those of prepreg where they are unknown."""
    bending = BENDING if cups.bending is None else cups.bending
    return CoupledModel(
        cups.grid, bending=bending, weight=cups.weight(), take_up=take_up
    )


def check_model(model: str) -> None:
    """Refuse a model that does not exist, as InputError."""
    if model not in MODELS:
        problem = f"there is no model {model!r}"
        raise InputError("--model", "", problem, f"choose from {', '.join(MODELS)}")


def effect_facts(effect: Effect) -> dict[str, Any]:
    """An effect as plain data, units in the keys."""
    return {
        "effect": effect.name,
        "estimate_mm": effect.estimate / MM,
        "tolerance_mm": effect.tolerance / MM,
        "modeled_cells": effect.modeled,
        "cells": effect.cells,
    }


def estimate_lines(cups: Cups) -> list[str]:
    """What independent fibers leave out, estimated, one line each."""
    held = cups.grid, cups.positions, cups.rotations
    bending = BENDING if cups.bending is None else cups.bending
    mass = AREAL_MASS if cups.areal_mass is None else cups.areal_mass
    found = measures(
        *(*held, bending, mass),
        overhang=cups.overhang or 0.0,
        gravity=np.multiply(-EARTH, cups.up),
    )
    lines = [
        f"{one.name}: {one.value:.3g} {one.unit}, {one.source}"
        for one in estimates(found, cups.grid)
        if cups.overhang is not None or "droop" not in one.name
    ]
    assumed = [f"D = {BENDING / MM:g} N mm"] if cups.bending is None else []
    assumed += [f"{AREAL_MASS:g} kg/m2"] if cups.areal_mass is None else []
    if assumed:
        lines.append(f"estimates assume {' and '.join(assumed)}")
    return lines
