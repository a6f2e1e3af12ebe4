"""What the preview shows, as plain arrays: the only thing the page is made from."""

import unicodedata
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np

from drapeplan.errors import InputError

Array = np.ndarray

TOUCH, PENETRATION = 0.5e-3, 1.0e-3  # [m] of a view that does not say
BESIDE = 1.0  # [m] gap from which a sample hangs beside the mold, over nothing
GAP_SHOWN = 30e-3  # [m] end of the color scale: the front's neighborhood decides
MARGIN_SHOWN = 5e-3  # [m] margins beyond threaten nothing: ten times what touches


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


class Event(NamedTuple):
    """Something that goes wrong at the front, at a pose or on the way to it.

    Attributes:
        kind: "premature_contact", "air_pocket", "penetration" or "pad_penetration".
        pose: Index of the pose.
        samples: What of the ply it takes in, as row * ns + column of each sample, rows
            along t; all of that kind at that pose, shape (m,), at least one.
        place: Its deepest sample, material coordinates (s, t), in [m].
        area: Of the largest such region on the ply, in [m^2].
        volume: Between that region and its laid state, in [m^3].
        depth: Largest height of a pocket, else largest depth, in [m].
        sentence: When, where, how much, and what to change.
        on_way: Whether it comes and goes on the way to the pose, and the place and the
            sizes are those of the nearest sight of it.
    """

    kind: str
    pose: int
    samples: Array
    place: tuple[float, float]
    area: float
    volume: float
    depth: float
    sentence: str
    on_way: bool = False


class LongFiber(NamedTuple):
    """A fiber between two cups that leaves the weave's take-up at some poses.

    Attributes:
        name: Such as "s fiber (0, 1)-(0, 2), -20 mm".
        poses: Poses at which it does, increasing, shape (p,), at least one.
        samples: Samples of the ply nearest to it, from the first cup to the second, as
            row * ns + column, shape (m,).
        cups: Indices of the cups that it joins.
        need: Most that its cups ask for beyond its length, in [m]; 0 where they do not.
        surplus: Most that it has and its cups do not ask for, in [m]; 0 likewise.
        bubble: Height to which what the take-up leaves of the surplus would bow it out,
            in [m].
    """

    name: str
    poses: Array
    samples: Array
    cups: tuple[int, int]
    need: float
    surplus: float
    bubble: float


class Statement(NamedTuple):
    """A sentence of the verdict, with the moment and the place it speaks of.

    Attributes:
        text: The sentence.
        wrong: Whether it says what makes the verdict bad.
        pose: Index of the pose it speaks of, or None.
        place: Material coordinates (s, t) of the place, in [m], or None.
        warns: Whether it speaks of what a good verdict does not vouch for.
        aside: Whether it can wait until somebody asks for more.
    """

    text: str
    wrong: bool = False
    pose: int | None = None
    place: tuple[float, float] | None = None
    warns: bool = False
    aside: bool = False


@dataclass(frozen=True)
class PlanView:
    """A drape, pose by pose. K poses, n cups, all coordinates in the world, in [m].

    Attributes:
        title: First line of the page, any text; control characters are replaced.
        subtitle: Second line, likewise.
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
        s: Material coordinates of the samples along s, shape (ns,), in [m]; by default
            lengths along the ply's first row at the last pose.
        t: Material coordinates along t, shape (nt,), in [m]; by default lengths along
            its first column.
        cups_around: Indices of the cups each sample depends on, shape (nt, ns, 4),
            repeated where they are fewer; or None.
        pads: Index of the cup that holds each sample, -1 off pads, shape (nt, ns); or
            None.
        margins: What is left at each pose until a premature contact and until an air
            pocket, no more than MARGIN_SHOWN, at or below zero where one happens, shape
            (K, 2), in [m]; by default MARGIN_SHOWN.
        wave_step: 0 while the start cup lands, then the number of the wave step; -1
            elsewhere, the default; shape (K,).
        tau: Progress within the step or phase, shape (K,).
        events: What goes wrong at the front, by pose.
        long_fibers: Fibers that leave the take-up.
        rungs: Names of the ply models that strips stand on.
        strip_rungs: Index into rungs for the strip between the two cups of each
            interlink, shape (K, m).
        statements: The verdict's sentences with what they speak of; by default those of
            `verdict` without a moment.
        facts: What the plan was made from, as names and values, likewise.
        robustness: The plan's block on uncertainty as plain data, or None.
        touch: Gap up to which the ply counts as touching, in [m].
        penetration: Depth from which penetration is marked, in [m].
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
    s: Array | None = None
    t: Array | None = None
    cups_around: Array | None = None
    pads: Array | None = None
    margins: Array | None = None
    wave_step: Array | None = None
    tau: Array | None = None
    events: tuple[Event, ...] = ()
    long_fibers: tuple[LongFiber, ...] = ()
    rungs: tuple[str, ...] = ()
    strip_rungs: Array | None = None
    statements: tuple[Statement, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    robustness: dict[str, Any] | None = None
    touch: float = TOUCH
    penetration: float = PENETRATION

    def __post_init__(self) -> None:
        """Check shapes and values once, then make the arrays read-only.

        Raises:
            InputError: If shapes disagree, a number is not finite, a state is unknown.
        """
        if not self.arm_meshes:
            object.__setattr__(self, "arm_placements", np.zeros((self.poses, 0, 4, 4)))
        self._fill_in()
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

    def _fill_in(self) -> None:
        """Give a value to what a view may leave out."""
        last, k = self.ply_points[-1], self.poses
        defaults: dict[str, Any] = {
            "s": _lengths(last[0]),
            "t": _lengths(last[:, 0]),
            "margins": np.full((k, 2), MARGIN_SHOWN),
            "wave_step": np.full(k, -1),
            "tau": np.zeros(k),
            "strip_rungs": np.zeros((k, len(self.interlinks)), np.uint8),
        }
        for name, value in defaults.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, value)
        facts = tuple((readable(name), readable(value)) for name, value in self.facts)
        texts = {"title": readable(self.title), "subtitle": readable(self.subtitle)}
        for name, value in {**texts, "facts": facts}.items():
            object.__setattr__(self, name, value)
        if not self.statements:
            told = tuple(Statement(text, not self.good) for text in self.verdict)
            object.__setattr__(self, "statements", told)

    def _freeze(self, name: str, value: Array) -> None:
        if not np.all(np.isfinite(value)):
            raise InputError("preview", name, "has a number that is not finite")
        value = value.view()
        value.flags.writeable = False
        object.__setattr__(self, name, value)

    def _shapes(self) -> dict[str, tuple[int, ...]]:
        """Shapes that all arrays must have, given the ply and the names of the cups."""
        k, n = self.poses, len(self.cup_names)
        nt, ns = np.shape(self.gap)[1:3]
        some = {"cups_around": (nt, ns, 4), "pads": (nt, ns)}
        given = {n: x for n, x in some.items() if getattr(self, n) is not None}
        return given | {
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
            "s": (ns,),
            "t": (nt,),
            "margins": (k, 2),
            "wave_step": (k,),
            "tau": (k,),
            "strip_rungs": (k, len(self.interlinks)),
        }

    @property
    def poses(self) -> int:
        """Number of poses K."""
        return len(self.gap)

    def contact_share(self) -> Array:
        """Share of the ply's samples that touch the mold at each pose, shape (K,)."""
        return np.mean(self.gap <= self.touch, axis=(1, 2))

    def largest_gap(self) -> Array:
        """Largest gap over the mold by pose, shape (K,), in [m]; BESIDE if none."""
        over = self.gap < BESIDE
        largest = np.max(self.gap, axis=(1, 2), where=over, initial=-BESIDE)
        return np.where(over.any(axis=(1, 2)), largest, BESIDE)


def readable(text: str) -> str:
    """Text whose characters are seen: those that control or turn it are replaced."""
    hidden = ("Cc", "Cf")
    return "".join("\ufffd" if unicodedata.category(c) in hidden else c for c in text)


def _lengths(points: Array) -> Array:
    """Lengths along points of shape (m, 3) up to each of them, shape (m,), in [m]."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=-1)
    return np.concatenate([[0.0], np.cumsum(steps)])
