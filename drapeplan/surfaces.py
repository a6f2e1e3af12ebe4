"""Analytic mold surfaces: height fields z = f(x, y) in the mold frame.

The mold frame has z up, away from the mold; s runs along x and t along y at zero warp.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Field = tuple[Array, Array, Array]  # height [m], slope along x [-], slope along y [-]

RIM = 0.999  # [-] share of a radius beyond which a round surface goes on straight


class AbstractSurface(ABC):
    """Height field in the mold frame.

    A subclass has one method to write, `evaluate`. It answers every finite point with
    finite numbers and continuous slopes; where the surface itself ends it goes on
    smoothly, and `inside` says that this is no longer the mold.
    """

    @abstractmethod
    def evaluate(self, x: ArrayLike, y: ArrayLike) -> Field:
        """Height and slopes.

        Args:
            x: Coordinates along x, any shape, in [m].
            y: Coordinates along y, of the same shape, in [m].

        Returns:
            Height in [m] and its derivatives by x and y, each of that shape.
        """

    @property
    def extent(self) -> tuple[float, float] | None:
        """Half sizes along x and y about the origin, in [m]; None if unbounded."""
        return None

    def inside(self, x: ArrayLike, y: ArrayLike) -> Mask:
        """Whether points lie over the mold, boolean array of the shape of x and y."""
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        half_x, half_y = self.extent or (np.inf, np.inf)
        return np.asarray((abs(x) <= half_x) & (abs(y) <= half_y))

    def height(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Height over each point, of the shape of x and y, in [m]."""
        return self.evaluate(x, y)[0]

    def point(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Surface points over x and y, shape (..., 3), in [m]."""
        z = self.height(x, y)
        return np.stack(np.broadcast_arrays(np.asarray(x, float), y, z), axis=-1)

    def normal(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Unit normals that point up, away from the mold, shape (..., 3)."""
        _, zx, zy = self.evaluate(x, y)
        return upward_normal(zx, zy)

    def gap(self, points: ArrayLike) -> Array:
        r"""Signed distances to first order, :math:`(z - f) / \sqrt{1 + |\nabla f|^2}`.

        The distance itself is curvature times gap squared away from it, so what
        touches is known exactly.

        Args:
            points: Points in the mold frame, shape (..., 3), in [m].

        Returns:
            Distances, shape (...), positive above the mold, in [m].
        """
        points = np.asarray(points, float)
        z, zx, zy = self.evaluate(points[..., 0], points[..., 1])
        return (points[..., 2] - z) / np.sqrt(1 + zx**2 + zy**2)


def upward_normal(zx: Array, zy: Array) -> Array:
    """Unit normals of a height field with slopes zx and zy, shape (..., 3)."""
    n = np.stack([-zx, -zy, np.ones_like(zx)], axis=-1)
    return n / np.sqrt(1 + zx**2 + zy**2)[..., None]


@dataclass(frozen=True)
class Plane(AbstractSurface):
    """Flat mold, z = 0."""

    def evaluate(self, x: ArrayLike, y: ArrayLike) -> Field:
        """Height and slopes, all zero."""
        zero = 0.0 * (np.asarray(x, float) + np.asarray(y, float))
        return zero, zero.copy(), zero.copy()


@dataclass(frozen=True)
class Paraboloid(AbstractSurface):
    """Elliptic or hyperbolic paraboloid with its apex at the origin.

    Attributes:
        radius_x: Radius of curvature along x at the apex, negative where concave, [m].
        radius_y: The same along y, [m].
    """

    radius_x: float
    radius_y: float

    def evaluate(self, x: ArrayLike, y: ArrayLike) -> Field:
        """Height and slopes of -x^2 / (2 Rx) - y^2 / (2 Ry)."""
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        zx, zy = -x / self.radius_x, -y / self.radius_y
        return (x * zx + y * zy) / 2, zx, zy


def round_profile(r: Array, radius: float) -> tuple[Array, Array]:
    """Circular arc through the origin that goes on as its tangent beyond the rim.

    Args:
        r: Distances from the axis, any shape, in [m].
        radius: Radius of the arc, negative where concave, in [m].

    Returns:
        Height in [m] and its derivative divided by r in [1/m], of the shape of r.
    """
    rim = RIM * abs(radius)
    clamped = np.minimum(abs(r), rim)
    drop = np.sqrt(radius**2 - clamped**2)
    steepness = -clamped / drop
    z = drop - abs(radius) + steepness * (abs(r) - clamped)
    per_r = -1 / np.where(abs(r) > rim, drop * abs(r) / rim, drop)
    return np.sign(radius) * z, np.sign(radius) * per_r


@dataclass(frozen=True)
class Sphere(AbstractSurface):
    """Spherical cap with its pole at the origin.

    Attributes:
        radius: Radius, negative where concave, [m].
    """

    radius: float

    @property
    def extent(self) -> tuple[float, float]:
        """Half sizes of the hemisphere's shadow, in [m]."""
        return RIM * abs(self.radius), RIM * abs(self.radius)

    def inside(self, x: ArrayLike, y: ArrayLike) -> Mask:
        """Whether points lie over the hemisphere, short of its vertical rim."""
        return np.asarray(np.hypot(x, y) <= RIM * abs(self.radius))

    def evaluate(self, x: ArrayLike, y: ArrayLike) -> Field:
        """Height and slopes; beyond the rim those of the tangent cone."""
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        z, per_r = round_profile(np.hypot(x, y), self.radius)
        return z, per_r * x, per_r * y


@dataclass(frozen=True)
class Cylinder(AbstractSurface):
    """Cylinder along y with its crest at the origin.

    Attributes:
        radius: Radius, negative where concave, [m].
    """

    radius: float

    @property
    def extent(self) -> tuple[float, float]:
        """Half width of the cylinder's shadow in [m], and no bound along y."""
        return RIM * abs(self.radius), np.inf

    def evaluate(self, x: ArrayLike, y: ArrayLike) -> Field:
        """Height and slopes; beyond the rim those of the tangent plane."""
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        z, per_r = round_profile(x, self.radius)
        return z, per_r * x, np.zeros_like(x)


@dataclass(frozen=True)
class Ridge(AbstractSurface):
    """Gaussian ridge that runs along y on a flat mold.

    Attributes:
        crest: Height of the ridge, [m].
        sigma: Standard deviation of its profile along x, [m].
        offset: Where along x it stands, [m].
    """

    crest: float = 0.015
    sigma: float = 0.100
    offset: float = 0.110

    def evaluate(self, x: ArrayLike, y: ArrayLike) -> Field:
        """Height and slopes."""
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        u = (x - self.offset) / self.sigma
        z = self.crest * np.exp(-(u**2) / 2)
        return z, -u / self.sigma * z, np.zeros_like(z)


@dataclass(frozen=True)
class Step(AbstractSurface):
    """Smooth step along x, between two flats.

    Attributes:
        rise: Height of the step, [m].
        width: Length over which its logistic profile grows by a factor e, [m].
        offset: Where along x the middle of the step stands, [m].
    """

    rise: float = 0.030
    width: float = 0.040
    offset: float = 0.110

    def evaluate(self, x: ArrayLike, y: ArrayLike) -> Field:
        """Height and slopes; tanh keeps them finite for any x."""
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        u = np.tanh((x - self.offset) / (2 * self.width))
        slope = self.rise / (4 * self.width) * (1 - u**2)
        return self.rise / 2 * (1 + u), slope, np.zeros_like(u)


@dataclass(frozen=True)
class KinDrape(AbstractSurface):
    """Generic double-curved mold of KinDrape, centered on the mold's origin.

    Attributes:
        relief: Factor on the height; 1 is the published mold.
        size: Edge that the published square [0, 0.5]^2 m maps to, [m].
    """

    relief: float = 1.0
    size: float = 0.5

    @property
    def extent(self) -> tuple[float, float]:
        """Half sizes of the square, in [m]."""
        return self.size / 2, self.size / 2

    def evaluate(self, x: ArrayLike, y: ArrayLike) -> Field:
        """Height and slopes of the published polynomial, zero height at the middle."""
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        scale = self.size / 0.5
        z, zx, zy = _published(x / scale + 0.25, y / scale + 0.25)
        middle = _published(np.array(0.25), np.array(0.25))[0]
        k = self.relief
        return k * scale * (z - middle), k * zx, k * zy


def _published(u: Array, v: Array) -> Field:
    """Published polynomial over [0, 0.5]^2 m and its derivatives."""
    z = 1.004 * u + 1.089 * v - 3.667 * u**2 - 4.4 * u * v - 3.75 * v**2
    z = z + 3.086 * u**3 + 8.889 * u**2 * v + 4.321 * v**3
    zu = 1.004 - 7.334 * u - 4.4 * v + 9.258 * u**2 + 17.778 * u * v
    zv = 1.089 - 4.4 * u - 7.5 * v + 8.889 * u**2 + 12.963 * v**2
    return z, zu, zv


@dataclass(frozen=True)
class Trimmed(AbstractSurface):
    """A surface cut to a turned rectangle.

    Attributes:
        surface: What is cut.
        center: Middle of the rectangle, [m].
        half_sizes: Its half sizes along its own axes, [m].
        angle: Direction of its first axis, [rad].
    """

    surface: AbstractSurface
    center: tuple[float, float]
    half_sizes: tuple[float, float]
    angle: float = 0.0

    @property
    def extent(self) -> tuple[float, float]:
        """Half sizes about the origin of a box that holds the rectangle, in [m]."""
        cos, sin = abs(np.cos(self.angle)), abs(np.sin(self.angle))
        a, b = self.half_sizes
        x, y = (abs(value) for value in self.center)
        return float(x + cos * a + sin * b), float(y + sin * a + cos * b)

    def inside(self, x: ArrayLike, y: ArrayLike) -> Mask:
        """Whether points lie over the surface and in the rectangle."""
        dx, dy = np.asarray(x, float) - self.center[0], np.asarray(y) - self.center[1]
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        along, across = cos * dx + sin * dy, cos * dy - sin * dx
        a, b = self.half_sizes
        return (abs(along) <= a) & (abs(across) <= b) & self.surface.inside(x, y)

    def evaluate(self, x: ArrayLike, y: ArrayLike) -> Field:
        """Height and slopes of the surface, which goes on beyond the cut."""
        return self.surface.evaluate(x, y)
