"""Arrays of a plan as few bytes, in the form that unpack.js reads.

Neighboring poses and neighboring samples differ by little. Numbers are rounded to
whole steps, differenced along the poses and along both axes of the grid (modulo their
range, so nothing is lost), folded to small unsigned numbers and split into bytes: gzip
does the rest.
"""

import gzip
import json
import struct

import numpy as np

Array = np.ndarray

LEVEL = 6  # of gzip: 9 takes twice as long and saves 1 %
STEP = 10e-6  # [m] finest step of a position: rounding stays below 5 um


def fold(values: Array) -> Array:
    """Small differences of either sign as small unsigned numbers.

    Args:
        values: Unsigned integers, shape (channels, K, rows, columns).

    Returns:
        Differences along the last three axes modulo the range, with the sign moved to
        the lowest bit; same shape and dtype.
    """
    for axis in (1, 2, 3):
        values = np.diff(values, axis=axis, prepend=values.dtype.type(0))
    signed = values.view(f"i{values.itemsize}")
    return ((signed << 1) ^ (signed >> (8 * values.itemsize - 1))).view(values.dtype)


def pack_gap(gap: Array, shown: float, penetration: float) -> Array:
    """Gaps as entries of the table colors.gap_colors.

    Args:
        gap: Signed distances, shape (K, nt, ns), in [m].
        shown: Gap at the end of the color scale, in [m].
        penetration: Depth from which a sample is marked as penetrating, in [m].

    Returns:
        0 for penetration, else 1 (contact) to 255 (shown or more), dtype uint8.
    """
    level = 1 + np.rint(254 * np.clip(gap / shown, 0, 1))
    return np.where(gap < -penetration, 0, level).astype(np.uint8)


class Payload:
    """Collects arrays and yields the bytes that unpack.js takes apart.

    The layout is: length of the header (uint32, little-endian), header (JSON), padding
    to a multiple of 8, then the arrays, each at a multiple of 8. Fields of the header
    refer to an array by its index in ``blobs``, which holds offsets and sizes in bytes.
    """

    def __init__(self) -> None:
        """Start without arrays."""
        self._blobs: list[bytes] = []
        self._places: list[tuple[int, int]] = []
        self._end = 0

    def add_bytes(self, data: bytes) -> int:
        """Append bytes, padded, and return their index."""
        self._places.append((self._end, len(data)))
        self._blobs.append(data + bytes(-len(data) % 8))
        self._end += len(self._blobs[-1])
        return len(self._blobs) - 1

    def add(self, values: Array, dtype: str) -> int:
        """Append an array in row-major order as ``dtype`` and return its index."""
        return self.add_bytes(np.ascontiguousarray(values, np.dtype(dtype)).tobytes())

    def add_folded(self, values: Array) -> int:
        """Append unsigned integers, shape (channels, K, rows, columns), folded.

        The low bytes of all numbers come first, then, for uint16, the high bytes.
        """
        folded = fold(values).reshape(-1, 1)
        parts = folded.astype(folded.dtype.newbyteorder("<")).view(np.uint8)
        return self.add_bytes(np.ascontiguousarray(parts.T).tobytes())

    def add_track(self, points: Array) -> dict[str, object]:
        """Append positions that change from pose to pose, rounded to whole steps.

        Args:
            points: Shape (K, rows, columns, 3), in [m].

        Returns:
            Header entry: shape, indices of the lowest corner of each pose (float64) and
            of the folded steps above it, and the step, in [m].
        """
        poses, rows, columns, _ = points.shape
        origin = points.min(axis=(1, 2))
        local = points - origin[:, None, None]
        step = max(STEP, float(local.max(initial=0)) / 65535)
        whole = np.rint(np.moveaxis(local, -1, 0) / step).astype(np.uint16)
        return {
            "poses": poses,
            "rows": rows,
            "columns": columns,
            "step": step,
            "origin": self.add(origin, "<f8"),
            "steps": self.add_folded(whole),
        }

    def to_bytes(self, header: dict[str, object]) -> bytes:
        """Header and arrays, compressed; the same input gives the same bytes."""
        text = json.dumps({**header, "blobs": self._places}, separators=(",", ":"))
        head = text.encode()
        start = struct.pack("<I", len(head)) + head
        start += bytes(-len(start) % 8)
        return gzip.compress(b"".join([start, *self._blobs]), LEVEL, mtime=0)
