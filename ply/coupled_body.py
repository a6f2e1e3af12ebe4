"""A patch or a strip, as a core with the strips that hang on it (D11)."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ply.coupled_basis import Piece
from ply.coupled_energy import (
    energy,
    forces,
    pulls,
    stiffness,
    strains,
    tangents,
)
from ply.fiber import Array


@dataclass(frozen=True, eq=False)
class Body:
    """A core and its strips; coefficients are ordered as the strips, then the rest.

    Attributes:
        core: Matrices of the core; its functions are the inner edges of the strips in
            turn, then its own.
        strips: Matrices of the strips, stacked on the first axis, maybe none; the first
            half of their functions belongs to the outer edge.
    """

    core: Piece
    strips: Piece

    @property
    def size(self) -> int:
        """Number of unknown functions."""
        count, functions = self._strip_shape
        return self.core.ds.shape[-1] + count * functions // 2

    @property
    def _strip_shape(self) -> tuple[int, int]:
        return self.strips.ds.shape[0], self.strips.ds.shape[-1]

    def split(self, q: Array) -> tuple[Array, Array]:
        """Unknowns (b, size, 3) as those of the core and of the strips."""
        count, functions = self._strip_shape
        strips = q[:, : count * functions].reshape(len(q), count, functions, 3)
        inner = strips[:, :, functions // 2 :].reshape(
            len(q), count * functions // 2, 3
        )
        return np.concatenate([inner, q[:, count * functions :]], axis=1), strips

    def join(self, core: Array, outer: Array) -> Array:
        """Core (b, n, 3) and outer edges (b, strips, functions, 3) as unknowns."""
        count, functions = self._strip_shape
        first = count * functions // 2
        inner = core[:, :first].reshape(outer.shape)
        strips = np.concatenate([outer, inner], axis=2)
        flat = strips.reshape(len(core), 2 * first, 3)
        return np.concatenate([flat, core[:, first:]], axis=1)

    def energy(self, q: Array, cups: Array) -> Array:
        """Energy of unknowns (b, size, 3), shape (b,), in [J]."""
        return self.energy_and_strain(q, cups)[0]

    def strains(self, q: Array, cups: Array) -> list[Array]:
        """Strains in the core, (b, 3, G), and in the strips, (b, strips, 3, G)."""
        core, strips = self.split(q)
        own = strains(*tangents(self.core, core, cups))
        return [own, strains(*tangents(self.strips, strips, cups[:, None]))]

    def energy_and_strain(self, q: Array, cups: Array) -> tuple[Array, Array]:
        """Energy, and largest stretch beyond the take-up at a Gauss point; (b,)."""
        own, others = self.strains(q, cups)
        core, strips = self.split(q)
        total = energy(self.core, core, cups, own)
        total += energy(self.strips, strips, cups[:, None], others).sum(-1)
        own, others = pulls(self.core, own), pulls(self.strips, others)
        most = abs(others[:, :, :2]).max((1, 2, 3), initial=0)
        return total, np.maximum(abs(own[:, :2]).max((1, 2)), most)


class Tangent(NamedTuple):
    """Forces and stiffness of bodies, strips with a core; arrays of length b."""

    core: Array  # (b, 3 n, 3 n)
    strips: Array  # (b, strips, 3 k, 3 k)
    core_force: Array  # (b, n, 3)
    strip_force: Array  # (b, strips, k, 3)


def tangent(
    body: Body,
    q: Array,
    cups: Array,
    foreseen: list[Array] | None = None,
    ends: list[tuple[Array, Array]] | None = None,
) -> Tangent:
    """Forces and stiffness of bodies, with stresses of the strains given or their own.

    Args:
        body: The body.
        q: Unknowns, shape (b, size, 3), in [m].
        cups: Position, s and t direction of the cups, shape (b, 12, 3).
        foreseen: Strains of core and strips for the stresses in the stiffness.
        ends: Derivatives of the surface along s and t in core and strips, if known.
    """
    parts = []
    pieces = ((body.core, cups), (body.strips, cups[:, None]))
    for k, ((piece, c), part) in enumerate(zip(pieces, body.split(q), strict=True)):
        rs, rt = tangents(piece, part, c) if ends is None else ends[k]
        strain = strains(rs, rt) if foreseen is None else foreseen[k]
        force = forces(piece, part, c, rs, rt, strain)
        parts.append((stiffness(piece, rs, rt, strain), force))
    (core, core_force), (strips, strip_force) = parts
    return Tangent(core, strips, core_force, strip_force)
