import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from drapeplan.frames import (
    FLIP,
    around_base,
    inverse,
    moved,
    pose,
    rotation_vectors,
    rpy,
    translation,
    yaw,
)
from tests.tolerances import EXACT

vectors = st.tuples(*[st.floats(-1.7, 1.7)] * 3).map(np.array)


@given(a=vectors, b=vectors)
def test_inverse_undoes(a, b):
    T = pose(Rotation.from_rotvec(a).as_matrix(), b)
    assert_allclose(T @ inverse(T), np.eye(4), atol=EXACT)


@given(a=vectors, b=vectors)
def test_rotation_vectors_take_one_to_the_other(a, b):
    start, turn = Rotation.from_rotvec(a), Rotation.from_rotvec(b)
    end = turn * start
    found = rotation_vectors(start.as_matrix(), end.as_matrix())
    assert_allclose(found, turn.as_rotvec(), atol=1e-9)


def test_tiny_turns_are_not_lost():
    turn = Rotation.from_rotvec([0, 1e-11, 0]).as_matrix()
    assert_allclose(rotation_vectors(np.eye(3), turn), [0, 1e-11, 0], atol=1e-15)


@given(a=vectors, b=vectors)
def test_moved_takes_points_and_frames(a, b):
    T = pose(Rotation.from_rotvec(a).as_matrix(), b)
    p, R = np.array([[0.1, 0.2, 0.3]]), rpy((0.1, 0.2, 0.3))[None]
    positions, rotations = moved(T, p, R)
    assert_allclose(positions[0], (T @ [0.1, 0.2, 0.3, 1])[:3], atol=EXACT)
    assert_allclose(rotations[0], T[:3, :3] @ R[0], atol=EXACT)


def test_around_base_turns_the_short_way_and_stays_level():
    start = pose(FLIP, (0.0, 0.75, 0.6))
    end = translation(z=0.1) @ pose(yaw(0.3) @ FLIP, (0.75, 0.0, 0.6))
    T = around_base(start, end, np.linspace(0, 1, 7))
    assert_allclose(T[0], start, atol=EXACT)
    assert_allclose(T[-1], end, atol=EXACT)
    assert_allclose(np.hypot(T[:, 0, 3], T[:, 1, 3]), 0.75, atol=EXACT)
    assert (T[1:-1, :2, 3] > 0).all()
    assert_allclose(T[:, 2, 2], -1, atol=EXACT)
