"""Noise: how far a drape may be from its plan, drawn so that samples can be compared.

Every number that a sample needs comes from a stream of its own, named by the seed, the
sample's index and the parameter. So sample i is the same however many are drawn, on
however many processes, and whatever other parameters are switched on: differences
between two runs with the same seed are effects, not luck.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from drapeplan.scene import UncertaintySection
from urdf.sidecar import Interlinks

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

PARAMETERS = ("position", "angle", "tilt", "take_up", "stiffness", "registration")
REDRAWN = 1  # name of the stream of what is drawn anew for each pose
YAW = 0.25  # [-] of the tilt's spread: links on four sides hold a cup's yaw
CLOSED = 1e-9  # [m] links that are this close are left alone
ROUNDS = 12  # most corrections of links; each leaves about a twentieth of the error
FLAT = 1e-8  # [-] of the largest singular value: rows below depend on the others


@dataclass(frozen=True)
class Spread:
    """Standard deviations of what is not known, in SI units and radians.

    Attributes:
        position: Of each coordinate of a cup, in [m].
        angle: Of a cup's tilt about s and about t, in [rad]; its yaw has less.
        redrawn: Share of the variance of both that is drawn anew for each pose.
        tilt: Tilt that all cups have in common, about x and about y, in [rad].
        take_up: Of the weave's take-up, relative.
        stiffness: Of the logarithm of the ply's bending stiffness.
        mold_xy: Where the mold stands, along x and along y, in [m].
        mold_z: How high it stands, in [m].
        mold_yaw: How it is turned about z, in [rad].
    """

    position: float = 0.0
    angle: float = 0.0
    redrawn: float = 0.0
    tilt: float = 0.0
    take_up: float = 0.0
    stiffness: float = 0.0
    mold_xy: float = 0.0
    mold_z: float = 0.0
    mold_yaw: float = 0.0

    @classmethod
    def of(cls, stated: UncertaintySection) -> Spread:
        """The spreads that a scene states."""
        return cls(
            stated.position_mm * 1e-3,
            float(np.radians(stated.angle_deg)),
            stated.redrawn_share,
            float(np.radians(stated.tilt_deg)),
            stated.take_up_share,
            stated.stiffness_log,
            stated.mold_xy_mm * 1e-3,
            stated.mold_z_mm * 1e-3,
            float(np.radians(stated.mold_yaw_deg)),
        )

    def only(self, parameter: str) -> Spread:
        """The same with all but one parameter of PARAMETERS known exactly."""
        kept = [f.name for f in fields(self) if f.name.startswith(parameter)]
        if parameter == "registration":
            kept = ["mold_xy", "mold_z", "mold_yaw"]
        kept.append("redrawn")
        return replace(Spread(), **{name: getattr(self, name) for name in kept})

    def has(self, parameter: str) -> bool:
        """Whether a parameter of PARAMETERS is uncertain at all."""
        return replace(self.only(parameter), redrawn=0.0) != Spread()


@dataclass(frozen=True)
class Draw:
    """One sample, in multiples of the spreads: independent normal numbers.

    Attributes:
        position: Of the cups, shape (n, 3), or (K, n, 3) where drawn for each pose.
        angle: The same, about s, t and n.
        tilt: About x and y, shape (2,).
        take_up: Of the take-up.
        stiffness: Of its logarithm.
        registration: Of the mold: x, y, z, yaw, shape (4,).
    """

    position: Array
    angle: Array
    tilt: Array
    take_up: float
    stiffness: float
    registration: Array


def draw(seed: int, index: int, cups: int, poses: int, redrawn: float = 0.0) -> Draw:
    """Numbers of one sample.

    Args:
        seed: Seed of all samples.
        index: Which sample.
        cups: Number of cups n.
        poses: Number of poses K.
        redrawn: Share of the cups' variance that is drawn anew for each pose.
    """

    def normal(name: str, shape: tuple[int, ...], *more: int) -> Array:
        key = (index, PARAMETERS.index(name), *more)
        source = np.random.SeedSequence(seed, spawn_key=key)
        return np.random.default_rng(source).normal(size=shape)

    def of_cups(name: str) -> Array:
        stays = normal(name, (cups, 3))
        if redrawn == 0:
            return stays
        anew = normal(name, (poses, cups, 3), REDRAWN)
        return np.sqrt(1 - redrawn) * stays + np.sqrt(redrawn) * anew

    return Draw(
        of_cups("position"),
        of_cups("angle"),
        normal("tilt", (2,)),
        float(normal("take_up", ())),
        float(normal("stiffness", ())),
        normal("registration", (4,)),
    )


class LinkKeeper:
    """Brings cups to where their links have their lengths, along the shortest way.

    To first order that is the projection of their errors on the null space of the
    links' Jacobian, taken at the plan's poses; repeated, it is exact.
    """

    def __init__(
        self, links: Interlinks, positions: Array, rotations: Array, free: Bools
    ) -> None:
        """Prepare for errors about given poses.

        Args:
            links: The tool's interlinks.
            positions: Cup positions, shape (K, n, 3), in [m].
            rotations: Cup rotations, shape (K, n, 3, 3).
            free: Cups that may move, shape (K, n).
        """
        self.links, self.free = links, free
        self.live = free[:, links.pairs].any(axis=-1)
        d = self._between(positions, rotations)
        e = d / np.linalg.norm(d, axis=-1, keepdims=True)
        count, rows = self.live.shape
        J = np.zeros((count, rows, free.shape[1], 3))
        row = np.arange(rows)
        for cup, sign in ((links.pairs[:, 0], -1.0), (links.pairs[:, 1], 1.0)):
            J[:, row, cup] = sign * e * free[:, cup, None]
        flat = J.reshape(count, rows, -1)
        back = flat.swapaxes(1, 2)
        self._back = back @ np.linalg.pinv(flat @ back, FLAT, hermitian=True)

    def keep(self, positions: Array, rotations: Array) -> tuple[Array, float]:
        """Move free cups until their links are as long as they are.

        Args:
            positions: Cup positions with errors, shape (K, n, 3), in [m].
            rotations: Cup rotations with errors, shape (K, n, 3, 3).

        Returns:
            Positions, shape (K, n, 3), and the largest error of a link that is left,
            both in [m].
        """
        error = self.errors(positions, rotations)
        for _ in range(ROUNDS):
            if np.abs(error).max(initial=0.0) <= CLOSED:
                break
            step = (self._back @ error[..., None])[..., 0]
            positions = positions - step.reshape(positions.shape)
            error = self.errors(positions, rotations)
        return positions, float(np.abs(error).max(initial=0.0))

    def errors(self, positions: Array, rotations: Array) -> Array:
        """How far links of free cups are beyond their range, shape (K, m), in [m]."""
        d = self._between(positions, rotations)
        length = np.sqrt(np.sum(d * d, axis=-1))
        within = np.clip(length, self.links.shortest, self.links.longest)
        return np.where(self.live, length - within, 0.0)

    def _between(self, positions: Array, rotations: Array) -> Array:
        """Vectors between the ends of the links, shape (K, m, 3), in [m]."""
        ends = positions + self.links.height * rotations[..., 2]
        i, j = self.links.pairs.T
        return np.asarray(ends[:, j] - ends[:, i])


def turned(rotations: Array, free: Bools, sample: Draw, spread: Spread) -> Array:
    """Rotations of the cups with their errors.

    Args:
        rotations: As planned, shape (K, n, 3, 3).
        free: Cups that are not placed, shape (K, n); placed ones are pressed flat.
        sample: The sample.
        spread: Size of the errors.

    Returns:
        Rotations, shape (K, n, 3, 3).
    """
    if spread.angle == 0 and spread.tilt == 0:
        return rotations
    own = spread.angle * sample.angle * (1.0, 1.0, YAW)
    own = np.broadcast_to(own, (*rotations.shape[:2], 3)) * free[..., None]
    E = Rotation.from_rotvec(own.reshape(-1, 3)).as_matrix().reshape(rotations.shape)
    all_alike = Rotation.from_rotvec([*(spread.tilt * sample.tilt), 0.0]).as_matrix()
    common = np.where(free[..., None, None], all_alike, np.eye(3))
    return np.asarray(common @ rotations @ E)


def registered(points: Array, sample: Draw, spread: Spread) -> Array:
    """Points as seen from the mold where it really stands.

    Args:
        points: In the frame of the mold as planned, shape (..., 3), in [m].
        sample: The sample.
        spread: Size of the errors.

    Returns:
        Points in the frame of the mold as it stands, shape (..., 3), in [m].
    """
    if not spread.has("registration"):
        return points
    shift, turn = _registration(sample, spread)
    return np.asarray((points - shift) @ turn)  # rows times R: the inverse turn


def as_registered(
    poses: tuple[Array, Array], sample: Draw, spread: Spread
) -> tuple[Array, Array]:
    """Cup poses as seen from the mold where it really stands; a ply goes along.

    Args:
        poses: In the frame of the mold as planned, (..., 3) in [m] and (..., 3, 3).
        sample: The sample.
        spread: Size of the errors.
    """
    if not spread.has("registration"):
        return poses
    turn = _registration(sample, spread)[1]
    return registered(poses[0], sample, spread), np.asarray(turn.T @ poses[1])


def _registration(sample: Draw, spread: Spread) -> tuple[Array, Array]:
    """Where the mold stands, shape (3,), in [m], and its turn, shape (3, 3)."""
    sizes = spread.mold_xy, spread.mold_xy, spread.mold_z, spread.mold_yaw
    *shift, angle = sample.registration * sizes
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return np.array(shift), turn
