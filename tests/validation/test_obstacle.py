"""Partly touching ply: its free shape, clipped at the mold, against a beam."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from drapeplan.contact import clipped
from drapeplan.mold import HeightGrid
from drapeplan.surfaces import Paraboloid
from ply.grid import CupGrid
from ply.sampling import PlySampling
from ply.shape import ply_fibers
from tests.obstacle_beam import obstacle_beam

MM = 1e-3
BEAM = 0.1e-6  # [m] of the reference's grid of 0.5 mm
BETTER = 0.9  # [-] most of the free shape's error that clipping leaves
CLIPPED = 0.3e-3  # [m] what is left of 0.1 to 0.65 mm; 0.28 measured
STEEP = 0.03e-3  # [m] slopes squared, which a beam of small slopes leaves out
TWO = CupGrid(rows=1, columns=2, pitch=0.11, half_width=0.02)
HALF, LENGTH = TWO.half_width, TWO.span
LIFTS = [(2 * MM, 0.12), (2 * MM, 0.18), (1 * MM, 0.10), (5 * MM, 0.30)]
FLAT = 1e6  # [m] radius of a mold that is flat


@pytest.mark.parametrize(("height", "slope"), LIFTS)
def test_the_beam_lifts_off_where_it_must(height, slope):
    """Over a plane it lies flat, then rises as a cube from the place it lifts off."""
    x, w = obstacle_beam((0, height), (0, slope), lambda x: 0 * x, LENGTH)
    start = LENGTH - 3 * height / slope
    rise = height * np.clip((x - start) / (LENGTH - start), 0, None) ** 3
    assert 0 < start < LENGTH
    assert_allclose(w, rise, atol=BEAM)


@pytest.mark.parametrize("radius", [FLAT, 1.0, -2.0])
@pytest.mark.parametrize(("height", "slope"), LIFTS)
def test_clipping_brings_the_ply_nearer_to_the_beam(height, slope, radius):
    """One cup lies on the mold, its neighbor is lifted and leans back."""
    mold = HeightGrid.from_surface(Paraboloid(radius, FLAT), 0.2, 0.2)
    x0, x1 = -LENGTH / 2, LENGTH / 2
    z, zx, _ = mold.evaluate(np.array([x0, x1]), np.zeros(2))
    lift = np.array([0.0, height])
    slopes = zx + np.array([0.0, slope])
    turns = Rotation.from_rotvec(np.outer(-np.arctan(slopes), [0, 1, 0])).as_matrix()
    edges = np.stack([[x0, x1], [0, 0], z + lift], axis=-1)
    positions = edges + turns @ [HALF, 0, 0] * np.array([[-1.0], [1.0]])
    fibers = ply_fibers(TWO, positions, turns, model="cubic", take_up=5 * MM)
    lines = HALF + np.linspace(0, LENGTH, 141)[1:-1]
    sampling = PlySampling(TWO, lines, np.array([0.0]))
    points = sampling.points(fibers, positions, turns)[0]
    on, gap = clipped(mold, points, mold.gap(points))
    x, w = obstacle_beam(z + lift, slopes, lambda x: mold.height(x + x0, 0 * x), LENGTH)
    free, put = (
        abs(p[:, 2] - np.interp(p[:, 0] - x0, x, w)).max() for p in (points, on)
    )
    assert gap.min() == 0.0
    assert_allclose(mold.gap(on), gap, atol=1e-6)  # [m] a depth squared over a radius
    assert put < CLIPPED + STEEP
    assert put < BETTER * free + STEEP
    assert free > 0.1 * MM - STEEP
