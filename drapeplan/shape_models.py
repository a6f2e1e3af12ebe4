"""The ply models by name: what `shape` and `validate` hold a ply with."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from drapeplan.cups_file import MM, Array, Cups
from drapeplan.errors import InputError
from ply.ladder import TOLERANCE, Climb, Rung, ladder_alternatives
from ply.measures import estimates, measures
from ply.reconcile import reconcile
from ply.shape import PlyFibers, evaluate, ply_fibers
from ply.sides import alternatives

MODELS = ("auto", "cubic", "quartic", "modal", "coupled")
BENDING, AREAL_MASS = 5e-3, 0.31  # [N m], [kg/m^2] woven prepreg, assumed by estimates
FEWEST_COUPLED = 4  # shapes by side, of which the one of least energy comes first


@dataclass(frozen=True, eq=False)
class Held:
    """A ply in one shape.

    Attributes:
        cups: The cups, with poses reconciled where their uncertainty is stated.
        fibers: Fibers whose lengths a report speaks of.
        climb: The ladder that shaped it, or None for a model of single fibers.
    """

    cups: Cups
    fibers: PlyFibers
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
    def words(self) -> list[str]:
        """Rungs of the patches and why, one line for those that are alike."""
        return [] if self.climb is None else self.climb.lines()


def hold(
    cups: Cups, model: str, count: int = 1, tolerance: float = TOLERANCE
) -> list[Held]:
    """Shapes of the ply between cups, least energy first.

    Args:
        cups: The cups.
        model: One of MODELS.
        count: Largest number of shapes; cubic and quartic know one.
        tolerance: What "auto" may lose, in [m].

    Returns:
        The shapes, one or more.

    Raises:
        InputError: The model does not exist.
    """
    check_model(model)
    take_up = cups.take_up
    uncertain = cups.pose_sigma > 0 or cups.pose_sigma_angle > 0
    if model not in ("cubic", "quartic") and uncertain:
        poses = cups.positions, cups.rotations
        found = reconcile(cups.grid, *poses, cups.pose_sigma, cups.pose_sigma_angle)
        cups = replace(cups, positions=found.positions, rotations=found.rotations)
        take_up = max(take_up, found.take_up)
    band = take_up if take_up > 0 else None
    held = cups.grid, cups.positions, cups.rotations
    if model in ("auto", "coupled"):
        lowest = Rung.COUPLED if model == "coupled" else Rung.CUBIC
        many = max(count, FEWEST_COUPLED)
        climbs = ladder_alternatives(
            *held, many, tolerance=tolerance, take_up=band, lowest=lowest
        )
        fibers = ply_fibers(*held, model="modal", take_up=band)
        kept = range(min(count, len(climbs.positions)))
        return [Held(cups, fibers, climbs.pose(n)) for n in kept]
    if model == "modal" and count > 1:
        found_shapes = alternatives(*held, count=count, take_up=band)
        return [Held(cups, fibers, None) for fibers, _ in found_shapes]
    return [Held(cups, ply_fibers(*held, model=model, take_up=band), None)]


def check_model(model: str) -> None:
    """Refuse a model that does not exist, as InputError."""
    if model not in MODELS:
        problem = f"there is no model {model!r}"
        raise InputError("--model", "", problem, f"choose from {', '.join(MODELS)}")


def estimate_lines(cups: Cups) -> list[str]:
    """What independent fibers leave out, estimated, one line each."""
    held = cups.grid, cups.positions, cups.rotations
    found = measures(*held, BENDING, AREAL_MASS)
    return [
        f"{one.name}: {one.value:.3g} {one.unit}, {one.source}"
        for one in estimates(found, cups.grid)
    ] + [f"estimates assume D = {BENDING / MM:g} N mm and {AREAL_MASS:g} kg/m2"]
