"""Samples of the ply where the front is judged: a tensor grid that knows its cups."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from drapeplan.errors import InputError
from drapeplan.flood import Bools, Floats, edge_mask
from drapeplan.verdict import Spot

Ints = NDArray[np.integer[Any]]
TIE = 1e-9  # [m] values this close are equal: far below any tolerance of the front


@dataclass(frozen=True)
class FrontGrid:
    """Samples of the ply: a tensor grid that knows its cups.

    Attributes:
        s: Material coordinates along s, shape (ns,), in [m], increasing.
        t: Material coordinates along t, shape (nt,), in [m], increasing.
        cup_index: Cup whose pad holds the sample, -1 off pads, shape (nt, ns).
        cups_around: Cups that the sample depends on, shape (nt, ns, 4); repeated where
            there are fewer than four. Not read on pads, which depend on their own cup.
        columns: Number of cups along s: cup index = row * columns + column.
        start_cup: Index of the cup placed first.
        off_mold: Samples that hang beside the mold in the laid state, shape (nt, ns):
            they meet nothing, and air leaves there. None for no such sample.
    """

    s: Floats
    t: Floats
    cup_index: Ints
    cups_around: Ints
    columns: int
    start_cup: int
    off_mold: Bools | None = None

    def __post_init__(self) -> None:
        """Refuse samples that cannot be a ply.

        Raises:
            InputError: Shapes disagree, coordinates fall, or a cup is missing.
        """
        shape, cups = (len(self.t), len(self.s)), int(np.max(self.cup_index)) + 1
        if self.cup_index.shape != shape or self.cups_around.shape != (*shape, 4):
            raise InputError("front grid", "cup_index", f"is not of shape {shape}")
        if not ((np.diff(self.s) > 0).all() and (np.diff(self.t) > 0).all()):
            raise InputError("front grid", "s, t", "coordinates do not increase")
        if not np.isin(np.arange(cups), self.cup_index).all():
            raise InputError("front grid", "cup_index", "a cup's pad has no samples")
        if (self.cup_index < -1).any():
            raise InputError("front grid", "cup_index", "off pads it is -1")
        if not ((self._dependence >= 0) & (self._dependence < cups)).all():
            raise InputError("front grid", "cups_around", "names a cup that has no pad")
        if not 0 <= self.start_cup < cups:
            raise InputError("front grid", "start_cup", f"there is no {self.start_cup}")

    @cached_property
    def beside(self) -> Bools:
        """Samples beside the mold in the laid state, shape (nt, ns)."""
        nowhere = np.zeros(self.cup_index.shape, dtype=bool)
        return nowhere if self.off_mold is None else self.off_mold

    @cached_property
    def vents(self) -> Bools:
        """Where air leaves: the ply's edge and what hangs beside the mold, (nt, ns)."""
        return edge_mask(self.cup_index.shape) | self.beside

    @cached_property
    def areas(self) -> Floats:
        """Cell area of each sample, shape (nt, ns), in [m^2]; they sum to the ply's."""
        widths_s = np.convolve(np.diff(self.s), [0.5, 0.5])
        widths_t = np.convolve(np.diff(self.t), [0.5, 0.5])
        return widths_t[:, None] * widths_s

    @cached_property
    def start_pad(self) -> Bools:
        """Samples on the start cup's pad, shape (nt, ns)."""
        return self.cup_index == self.start_cup

    @cached_property
    def cup_centers(self) -> Floats:
        """Middles (s, t) of the cups' pads, shape (n_cups, 2), in [m]."""
        boxes = ndimage.find_objects(self.cup_index + 1)
        ends = [(self.s[j][[0, -1]], self.t[i][[0, -1]]) for i, j in boxes]
        return np.mean(ends, axis=-1)

    @property
    def _dependence(self) -> Ints:
        """Cups that samples depend on, pads on their own alone, shape (nt, ns, 4)."""
        own = self.cup_index[..., None]
        return np.where(own >= 0, own, self.cups_around)

    @cached_property
    def _cup_sets(self) -> tuple[Ints, Ints]:
        """Distinct sets of cups, shape (n, 4), and the set of each sample, (nt, ns)."""
        cups = self._dependence.reshape(-1, 4)
        sets, inverse = np.unique(cups, axis=0, return_inverse=True)
        return sets, inverse.reshape(self.cup_index.shape)

    def laid(self, placed: Bools) -> Bools:
        """Samples whose cups are all placed.

        Args:
            placed: Cups that are placed, shape (..., n_cups).

        Returns:
            Laid samples, shape (..., nt, ns).
        """
        sets, inverse = self._cup_sets
        complete: Bools = np.all(placed[..., sets], axis=-1)
        return complete[..., inverse]

    def on_pads(self, cups: Bools) -> Bools:
        """Samples on the pads of the chosen cups.

        Args:
            cups: Chosen cups, shape (..., n_cups).

        Returns:
            Samples on their pads, shape (..., nt, ns).
        """
        nowhere = np.zeros((*cups.shape[:-1], 1), dtype=bool)  # what index -1 reads
        return np.concatenate([cups, nowhere], axis=-1)[..., self.cup_index]

    def cup_near(self, place_st: tuple[float, float]) -> tuple[int, int]:
        """Cup (row, column) whose middle is nearest to a place (s, t), in [m]."""
        distance = np.linalg.norm(self.cup_centers - place_st, axis=1)
        return self.cup_at(int(np.argmin(distance)))

    def cup_at(self, index: int) -> tuple[int, int]:
        """Cup (row, column) of a cup index."""
        return index // self.columns, index % self.columns

    def spot(self, values: Floats, mask: Bools, pose: int | None = None) -> Spot:
        """Largest of the masked values and where it stands.

        Of equal ones the nearest to their middle: a place inside a flat region rather
        than its first corner.

        Args:
            values: Values, shape (nt, ns), in [m].
            mask: Samples to choose from, shape (nt, ns), at least one.
            pose: Index of the pose, for the record.

        Returns:
            The value, its place and its nearest cup.
        """
        top = values[mask].max()
        i, j = np.nonzero(mask & (values >= top - TIE))
        s, t = self.s[j], self.t[i]
        n = np.argmin(np.hypot(s - s.mean(), t - t.mean()))
        place = float(s[n]), float(t[n])
        return Spot(float(top), place, self.cup_near(place), pose)
