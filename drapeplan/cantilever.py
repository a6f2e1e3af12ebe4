r"""Bending stiffness from a strip of ply that hangs over an edge (D24).

A strip clamped level bends under its own weight: ASTM D1388, with the exact heavy
elastica in place of Peirce's formula. With the tangent's angle :math:`\psi` below level
and :math:`\xi` measured from the free end in units of :math:`(D / q)^{1/3}`,

.. math:: \psi'' = -\xi \cos \psi, \quad \psi(0) = \psi_0, \quad \psi'(0) = 0.

The clamp is where :math:`\psi` returns to 0, at :math:`\xi = (q l^3 / D)^{1/3}`: each
angle of the tip is one strip, and no boundary value is searched for.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from drapeplan.cups_file import EARTH

Array = NDArray[np.float64]

TIPS = np.linspace(0.0, 1.5, 61)[1:]  # [rad] of the strips that the splines go through
FARTHEST = 10.0  # [-] from the free end to the clamp: 6 at the steepest of the tips
EXACT = 1e-11  # [-] tolerance of the integration


class Hanging(NamedTuple):
    """Strips of all slopes, each of shape (n,): what fits any stiffness.

    Attributes:
        load: q l^3 / D.
        drop: How far the tip hangs below the clamp, over l.
        run: How far it is out, over l.
    """

    load: Array
    drop: Array
    run: Array


@cache
def hanging_strips() -> Hanging:
    """Exact strips, from nearly level to nearly upright."""
    return Hanging(*np.array([_strip(tip) for tip in TIPS]).T)


def _strip(tip: float) -> tuple[float, float, float]:
    """Load, drop and run of the strip whose tip has an angle, in [rad]."""

    def rates(x: float, y: Array) -> list[float]:
        return [y[1], -x * np.cos(y[0]), np.sin(y[0]), np.cos(y[0])]

    def level(_: float, y: Array) -> float:
        return float(y[0])

    level.terminal = True  # type: ignore[attr-defined]  # as solve_ivp asks for it
    start, span = [tip, 0.0, 0.0, 0.0], (0.0, FARTHEST)
    found = solve_ivp(
        rates, span, start, "DOP853", events=level, rtol=EXACT, atol=EXACT
    )
    x, (_, _, drop, run) = found.t_events[0][0], found.y_events[0][0]
    return x**3, drop / x, run / x


def load_of_drop(drop: ArrayLike) -> Array:
    """Load q l^3 / D of strips from the drop of their tips.

    Args:
        drop: Drop over overhang, shape (...), from 0 to `steepest().drop`.

    Returns:
        Loads, shape (...): 8 times the drop where it is small.
    """
    drop = np.asarray(drop, dtype=float)
    return drop * np.exp(_ratio("drop")(drop))


def load_of_incline(angle: ArrayLike) -> Array:
    """Load of strips from how steep the line from clamp to tip is.

    Args:
        angle: Angles below level, shape (...), in [rad]; ASTM D1388 has 41.5 degrees.

    Returns:
        Loads q l^3 / D, shape (...).
    """
    angle = np.asarray(angle, dtype=float)
    return angle * np.exp(_ratio("incline")(angle))


class Steepest(NamedTuple):
    """The most that a strip may hang: drop over overhang, incline in [rad]."""

    drop: float
    incline: float


def steepest() -> Steepest:
    """The end of the splines."""
    table = hanging_strips()
    return Steepest(float(table.drop[-1]), float(np.arctan2(table.drop, table.run)[-1]))


def bending_stiffness(load: ArrayLike, overhang: ArrayLike, areal_mass: float) -> Array:
    """Bending stiffness D = q l^3 / load.

    Args:
        load: Loads, shape (...).
        overhang: Lengths from clamp to tip along the strip, shape (...), in [m].
        areal_mass: Mass of the ply, in [kg/m^2].

    Returns:
        Stiffnesses, shape (...), in [N m].
    """
    length, load = (np.asarray(a, dtype=float) for a in (overhang, load))
    return np.asarray(EARTH * areal_mass * length**3 / load)


@cache
def _ratio(measure: str) -> CubicSpline:
    """Logarithm of load over drop, or over incline, which is smooth and starts at 8."""
    table = hanging_strips()
    x = table.drop if measure == "drop" else np.arctan2(table.drop, table.run)
    return CubicSpline(np.append(0.0, x), np.log(np.append(8.0, table.load / x)))
