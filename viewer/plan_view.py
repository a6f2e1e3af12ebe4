"""What the preview shows, as plain arrays: the only thing the page is made from."""

from dataclasses import dataclass, field, fields
from typing import NamedTuple

import numpy as np

from drapeplan.errors import InputError

Array = np.ndarray

TOUCH = 0.5e-3  # [m] gap below which the ply counts as touching, as in the front check
PENETRATION = 1.0e-3  # [m] depth from which penetration is marked: tolerance of a pad
BESIDE = 1.0  # [m] gap from which a sample hangs beside the mold, over nothing
GAP_SHOWN = 30e-3  # [m] end of the color scale: the front's neighborhood decides


class Mesh(NamedTuple):
    """A rigid body of the arm in its own frame.

    Attributes:
        name: What it is.
        vertices: Shape (V, 3), in [m].
        faces: Vertex indices, shape (F, 3).
        colors: Red, green and blue from 0 to 1, shape (V, 3).
    """

    name: str
    vertices: Array
    faces: Array
    colors: Array


@dataclass(frozen=True)
class PlanView:
    """A drape, pose by pose. K poses, n cups, all coordinates in the world, in [m].

    Attributes:
        title: First line of the page, any text.
        subtitle: Second line, any text.
        verdict: Sentences that say whether the drape is good, and why.
        good: True where the verdict is good.
        mold_vertices: Shape (V, 3).
        mold_faces: Vertex indices, shape (F, 3).
        ply_points: Samples of the ply, rows along t, shape (K, nt, ns, 3).
        gap: Signed distance from the mold, positive when free, shape (K, nt, ns);
            BESIDE or more where there is no mold below.
        labels: One sentence for each pose, K of them.
        phases: Name of each pose's phase, K of them.
        cup_positions: Centers of the suction faces, shape (K, n, 3).
        cup_rotations: Columns s, t and n; n points from the mold to the tool,
            shape (K, n, 3, 3).
        cup_states: Index into colors.CUP_STATES, shape (K, n).
        cup_names: Name of each cup, such as "3,2", n of them.
        universals: Upper ends of the legs, shape (K, n, 3).
        balls: Lower ends of the legs, shape (K, n, 3).
        interlinks: Cups joined by each interlink, shape (m, 2).
        half_width: Half side of the square that a cup holds.
        tool_placement: T_world_tool of tool0, z along the approach, shape (K, 4, 4).
        platform_size: Size of the tool's platform along its x and y.
        arm_meshes: Bodies of the arm.
        arm_placements: T_world_body of each body, shape (K, len(arm_meshes), 4, 4).
        mold_placement: T_world_mold, directions of the mold's grid lines, shape (4, 4).
        table: Two opposite corners of the table the ply is picked from, shape (2, 3),
            or None.
    """

    title: str
    subtitle: str
    verdict: list[str]
    good: bool
    mold_vertices: Array
    mold_faces: Array
    ply_points: Array
    gap: Array
    labels: list[str]
    phases: list[str]
    cup_positions: Array
    cup_rotations: Array
    cup_states: Array
    cup_names: list[str]
    universals: Array
    balls: Array
    interlinks: Array
    half_width: float
    tool_placement: Array
    platform_size: tuple[float, float]
    arm_meshes: list[Mesh] = field(default_factory=list)
    arm_placements: Array = field(default_factory=lambda: np.zeros((0, 0, 4, 4)))
    mold_placement: Array = field(default_factory=lambda: np.eye(4))
    table: Array | None = None

    def __post_init__(self) -> None:
        """Check shapes and values once, then make the arrays read-only.

        Raises:
            InputError: If shapes disagree, a number is not finite, a state is unknown.
        """
        if not self.arm_meshes:
            object.__setattr__(self, "arm_placements", np.zeros((self.poses, 0, 4, 4)))
        for name, shape in self._shapes().items():
            if np.shape(getattr(self, name)) != shape:
                found = np.shape(getattr(self, name))
                raise InputError("preview", name, f"has shape {found}, needs {shape}")
        if np.max(self.cup_states, initial=0) > 3:
            raise InputError("preview", "cup_states", "has a state beyond 3")
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                self._freeze(item.name, value)

    def _freeze(self, name: str, value: Array) -> None:
        if not np.all(np.isfinite(value)):
            raise InputError("preview", name, "has a number that is not finite")
        value = value.view()
        value.flags.writeable = False
        object.__setattr__(self, name, value)

    def _shapes(self) -> dict[str, tuple[int, ...]]:
        """Shapes that all arrays must have, given the ply and the names of the cups."""
        k, n = self.poses, len(self.cup_names)
        return {
            "mold_vertices": (len(self.mold_vertices), 3),
            "mold_faces": (len(self.mold_faces), 3),
            "ply_points": (*np.shape(self.gap), 3),
            "gap": (k, *np.shape(self.gap)[1:3]),
            "labels": (k,),
            "phases": (k,),
            "cup_positions": (k, n, 3),
            "cup_rotations": (k, n, 3, 3),
            "cup_states": (k, n),
            "universals": (k, n, 3),
            "balls": (k, n, 3),
            "interlinks": (len(self.interlinks), 2),
            "tool_placement": (k, 4, 4),
            "arm_placements": (k, len(self.arm_meshes), 4, 4),
            "mold_placement": (4, 4),
        }

    @property
    def poses(self) -> int:
        """Number of poses K."""
        return len(self.gap)

    def contact_share(self) -> Array:
        """Share of the ply's samples that touch the mold at each pose, shape (K,)."""
        return np.mean(self.gap <= TOUCH, axis=(1, 2))

    def largest_gap(self) -> Array:
        """Largest gap over the mold by pose, shape (K,), in [m]; BESIDE if none."""
        over = self.gap < BESIDE
        largest = np.max(self.gap, axis=(1, 2), where=over, initial=-BESIDE)
        return np.where(over.any(axis=(1, 2)), largest, BESIDE)
