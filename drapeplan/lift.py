"""Moving surfaces: the mold plus a lift that rolls down as the wave advances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from drapeplan.surfaces import AbstractSurface, Array, Field


@dataclass(frozen=True)
class Fronts:
    """Where the lift begins on the four sides of the start cup.

    Attributes:
        center: Start cup in the mold's xy-plane, shape (2,), in [m].
        warp: Direction of s in that plane, [rad].
        distances: Fronts along -s, +s, -t, +t, shape (4,), in [m].
    """

    center: Array
    warp: float
    distances: Array


@dataclass(frozen=True)
class RectangleLift(AbstractSurface):
    """Separable lift beyond the four sides of a rectangle.

    A side lifts by c d^2, d being the distance beyond its front, over a bend
    zone w, and linearly after it, so that its front stays parallel to the cups.

    Attributes:
        fronts: The rectangle.
        curvature: c along s and along t, in [1/m].
        bend: w in [m].
    """

    fronts: Fronts
    curvature: tuple[float, float]
    bend: float

    def evaluate(self, x: ArrayLike, y: ArrayLike) -> Field:
        """Lift and its gradient at (x, y), each of their shape, in [m] and [1]."""
        c, w = np.repeat(self.curvature, 2), self.bend
        cos, sin = np.cos(self.fronts.warp), np.sin(self.fronts.warp)
        dx = np.asarray(x, float) - self.fronts.center[0]
        dy = np.asarray(y, float) - self.fronts.center[1]
        s, t = cos * dx + sin * dy, cos * dy - sin * dx
        along = np.stack([-s, s, -t, t], axis=-1)
        d = np.maximum(0.0, along - self.fronts.distances)
        lift = (c * _bent(d, w)).sum(axis=-1)
        slope = 2 * c * np.minimum(d, w)
        slope_s, slope_t = (
            slope[..., 1] - slope[..., 0],
            slope[..., 3] - slope[..., 2],
        )
        return lift, cos * slope_s - sin * slope_t, sin * slope_s + cos * slope_t


@dataclass(frozen=True)
class RadialLift(AbstractSurface):
    """Lift beyond a circle around the start cup, by the same law.

    Attributes:
        center: Start cup in the mold's xy-plane, shape (2,), in [m].
        front: Radius of the circle, [m].
        curvature: c in [1/m].
        bend: w in [m].
    """

    center: Array
    front: float
    curvature: float
    bend: float

    def evaluate(self, x: ArrayLike, y: ArrayLike) -> Field:
        """Lift and its gradient at (x, y), each of their shape, in [m] and [1]."""
        dx = np.asarray(x, float) - self.center[0]
        dy = np.asarray(y, float) - self.center[1]
        radius = np.hypot(dx, dy)
        d = np.maximum(0.0, radius - self.front)
        slope = 2 * self.curvature * np.minimum(d, self.bend)
        slope = slope / np.where(d > 0, radius, 1.0)
        return self.curvature * _bent(d, self.bend), slope * dx, slope * dy


def _bent(d: Array, w: float) -> Array:
    """Square of a distance over the bend zone w, then straight on, in [m^2]."""
    return np.where(d < w, d**2, w * (2 * d - w))


@dataclass(frozen=True)
class WeightedSum(AbstractSurface):
    """Weighted sum of surfaces: blends and lifted molds."""

    terms: tuple[tuple[float, AbstractSurface], ...]

    def evaluate(self, x: ArrayLike, y: ArrayLike) -> Field:
        """Height and gradient at (x, y), each of their shape."""
        parts = [np.stack(term.evaluate(x, y)) for _, term in self.terms]
        weights = np.array([weight for weight, _ in self.terms])
        z, zx, zy = np.tensordot(weights, np.stack(parts), axes=1)
        return z, zx, zy
