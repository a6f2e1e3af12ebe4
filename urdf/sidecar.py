"""The sidecar of a tool: what its URDF cannot say, checked once where it is read."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
import yaml
from numpy.typing import NDArray

from drapeplan.errors import InputError
from urdf.spec import KINDS, MOST_CUPS_A_SIDE

FORMAT = "drape-tool/1"
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # ten times faster in C


@dataclass(frozen=True)
class Interlinks:
    """Links between neighboring cups.

    Attributes:
        kind: "rigid" with balls at its ends, or "resilient", clamped to the cups.
        height: Ends above the suction face, [m].
        length: Distance that a link holds between its ends, [m].
        length_range: How far the length may go from there, either way, [m].
        mass: One link, [kg].
        bending_stiffness: Equivalent, [N m]; 0 where rigid.
        pairs: Indices of both cups, shape (m, 2), read-only.
    """

    kind: str
    height: float
    length: float
    mass: float
    bending_stiffness: float
    pairs: NDArray[np.int64]
    length_range: float = 0.0

    @property
    def shortest(self) -> float:
        """Least distance between the ends, [m]."""
        return self.length - self.length_range

    @property
    def longest(self) -> float:
        """Largest distance between the ends, [m]."""
        return self.length + self.length_range


@dataclass(frozen=True)
class Sidecar:
    """What stands beside a tool's URDF, SI and radians.

    Attributes:
        name: The tool's name.
        rows: Cups along t.
        columns: Cups along s.
        pitch: Distance between neighboring cups of a flat ply, [m].
        half_width: Half side of the square that a cup holds, [m].
        leg_min: Universal joint to ball at stroke 0, [m].
        leg_max: Universal joint to ball at full stroke, [m].
        universal_depth: Universal joints below tool0, [m].
        ball_height: Ball center above the suction face, [m].
        leg_name: Pattern of a leg's joints, with {row} and {column}.
        cup_name: Pattern of a cup's joints.
        face_name: Pattern of a face frame.
        universal_stiffness: Spring of ux and of uy, [N m/rad].
        ball_stiffness: Spring of sx and of sy, [N m/rad].
        yaw_stiffness: Spring of sz, [N m/rad].
        interlinks: The links.
    """

    name: str
    rows: int
    columns: int
    pitch: float
    half_width: float
    leg_min: float
    leg_max: float
    universal_depth: float
    ball_height: float
    leg_name: str
    cup_name: str
    face_name: str
    universal_stiffness: float
    ball_stiffness: float
    yaw_stiffness: float
    interlinks: Interlinks


def neighbor_pairs(rows: int, columns: int) -> NDArray[np.int64]:
    """Indices of neighboring cups, first all pairs along s, then all along t.

    Args:
        rows: Cups along t.
        columns: Cups along s.

    Returns:
        Index row * columns + column of both cups of each pair, each family in
        row-major order, shape (rows * (columns - 1) + (rows - 1) * columns, 2).
    """
    cup = np.arange(rows * columns).reshape(rows, columns)
    along_s = np.stack([cup[:, :-1], cup[:, 1:]], axis=-1).reshape(-1, 2)
    along_t = np.stack([cup[:-1], cup[1:]], axis=-1).reshape(-1, 2)
    return np.concatenate([along_s, along_t])


def read_sidecar(content: str | Mapping[str, Any], source: str = "sidecar") -> Sidecar:
    """Check a sidecar and put it into SI.

    Args:
        content: Text of the YAML, or the plain data in it.
        source: What error messages call it, such as the name of the file.

    Returns:
        The sidecar.

    Raises:
        InputError: The YAML cannot be parsed, a key is missing or its value is none
            that a tool can have.
    """
    if isinstance(content, str):
        try:
            content = yaml.load(content, LOADER)
        except yaml.YAMLError as error:
            problem = " ".join(str(error).split())
            raise InputError(source, "", f"no valid YAML: {problem}") from error
    read = _Reader(source, content)
    if read("format") != FORMAT:
        read.refuse("format", f"must be {FORMAT}")
    rows = read.whole("grid.rows", 2, MOST_CUPS_A_SIDE)
    columns = read.whole("grid.columns", 2, MOST_CUPS_A_SIDE)
    pitch = read.number("grid.pitch_m", above=0)
    leg_min = read.number("leg.min_m", above=0)
    springs = [
        read.number(f"joint_stiffness.{joint}_Nm_per_rad", least=0)
        for joint in ("universal", "ball", "yaw")
    ]
    return Sidecar(
        read.text("name"),
        rows,
        columns,
        pitch,
        read.number("grid.half_width_m", above=0, below=pitch / 2),
        leg_min,
        read.number("leg.max_m", above=leg_min),
        read.number("leg.universal_depth_m"),
        read.number("leg.ball_height_m", above=0),
        *(read.pattern(f"names.{part}") for part in ("leg", "cup", "face")),
        *springs,
        _interlinks(read, rows, columns),
    )


class _Reader:
    """Values of a nested mapping by dotted key, each checked."""

    def __init__(self, source: str, data: Any) -> None:
        self.source, self.data = source, data

    def __call__(self, key: str) -> Any:
        """Value at a dotted key, which must exist."""
        value = self.data
        for part in key.split("."):
            if not isinstance(value, Mapping) or part not in value:
                raise InputError(self.source, key, "is missing")
            value = value[part]
        return value

    def refuse(self, key: str, wanted: str) -> NoReturn:
        """Raise the error of one key."""
        raise InputError(self.source, key, f"{self(key)!r:.60} {wanted}")

    def text(self, key: str) -> str:
        """A text that is not empty."""
        value = self(key)
        if not isinstance(value, str) or not value:
            self.refuse(key, "must be a text")
        return str(value)

    def pattern(self, key: str) -> str:
        """A name with {row} and {column} in it."""
        value = self.text(key)
        if "{row}" not in value or "{column}" not in value:
            self.refuse(key, "must contain {row} and {column}")
        return value

    def whole(self, key: str, least: int, most: int) -> int:
        """A whole number within bounds, both included."""
        value = self(key)
        whole = isinstance(value, int) and not isinstance(value, bool)
        if not whole or not least <= value <= most:
            self.refuse(key, f"must be a whole number from {least} to {most}")
        return int(value)

    def number(
        self,
        key: str,
        least: float = -math.inf,
        above: float = -math.inf,
        below: float = math.inf,
    ) -> float:
        """A finite number within bounds."""
        value = self(key)
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.refuse(key, "must be a number")
        if not (math.isfinite(value) and value >= least and above < value < below):
            bounds = {"at least": least, "above": above, "below": below}
            named = [f"{k} {v:.6g}" for k, v in bounds.items() if math.isfinite(v)]
            self.refuse(key, "must be " + " and ".join(named or ["finite"]))
        return float(value)

    def optional(self, key: str, default: float, least: float, below: float) -> float:
        """A number within bounds, or its default where the key is missing."""
        head, _, last = key.rpartition(".")
        group = self(head)
        if not isinstance(group, Mapping) or last not in group:
            return default
        return self.number(key, least=least, below=below)


def _interlinks(read: _Reader, rows: int, columns: int) -> Interlinks:
    """Read the links, which must join neighboring cups, each pair once."""
    kind = read("interlinks.kind")
    if kind not in KINDS:
        read.refuse("interlinks.kind", f"must be {' or '.join(KINDS)}")
    length = read.number("interlinks.length_m", above=0)
    return Interlinks(
        kind,
        read.number("interlinks.height_m"),
        length,
        read.number("interlinks.mass_kg", least=0),
        read.number("interlinks.bending_stiffness_Nm", least=0),
        _pairs(read, rows, columns),
        read.optional("interlinks.length_range_m", 0.0, least=0, below=length),
    )


def _pairs(read: _Reader, rows: int, columns: int) -> NDArray[np.int64]:
    """Cup indices of the links, shape (m, 2), read-only."""
    key = "interlinks.pairs"
    try:
        cups = np.asarray(read(key))
    except ValueError:
        cups = np.empty(0)
    if cups.ndim != 3 or cups.shape[1:] != (2, 2) or cups.dtype.kind != "i":
        read.refuse(key, "must be a list of [[row, column], [row, column]]")
    outside = (cups < 0) | (cups >= [rows, columns])
    strange = outside.any(axis=(1, 2)) | (abs(cups[:, 0] - cups[:, 1]).sum(axis=1) != 1)
    if strange.any():
        first = int(np.argmax(strange))
        problem = (
            f"{cups[first].tolist()} are no neighbors on a {columns} x {rows} grid"
        )
        raise InputError(read.source, f"{key}[{first}]", problem)
    pairs = cups @ [columns, 1]
    if len(np.unique(np.sort(pairs, axis=1), axis=0)) < len(pairs):
        raise InputError(read.source, key, "two links join the same cups")
    pairs.setflags(write=False)
    return pairs
