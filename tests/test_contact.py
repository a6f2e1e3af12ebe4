"""Contact: the ply is judged by its free shape, and drawn as it lies."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from tests.courses import wave_plan

ON_MOLD = 2e-6  # [m] a depth of a millimeter squared, over the radius of the mold


def test_the_ply_is_drawn_on_the_mold_and_judged_below():
    plan = wave_plan("steep", 0.1)
    contact, mold = plan.judged[1], plan.cell.mold
    points, gap = contact.drawn
    below = contact.gap < 0
    assert contact.gap.min() < -1e-4
    assert_array_equal(points[~below], contact.points[~below])
    assert_array_equal(gap, np.maximum(contact.gap, 0.0))
    assert_allclose(mold.gap(points[below]), 0.0, atol=ON_MOLD)
    moved = np.linalg.norm(points - contact.points, axis=-1)
    assert_allclose(moved, np.maximum(-contact.gap, 0.0), atol=1e-12)
