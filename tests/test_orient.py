import numpy as np
import pytest
from numpy.testing import assert_allclose

from drapeplan.orient import is_closed, oriented, outward_normals
from tests.mold_meshes import box, cap, channel, torus

CRACK = 1e-8  # [m] rounding of files that hold corners once for each face


def mixed(faces, seed=0):
    """Faces of which a random half is turned round."""
    turned = np.random.default_rng(seed).random(len(faces)) < 0.5
    return np.where(turned[:, None], faces[:, ::-1], faces)


def crosses(vertices, faces):
    """Normals of twice the area, shape (f, 3)."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


@pytest.mark.parametrize("make", [box, torus], ids=["box", "torus"])
@pytest.mark.parametrize("wind", [mixed, lambda f: f, lambda f: f[:, ::-1]])
def test_a_closed_mesh_looks_out_however_it_is_wound(make, wind):
    vertices, faces = make()
    _, found = oriented(vertices, wind(faces), np.zeros(len(faces), bool))
    assert is_closed(found)
    assert_allclose(crosses(vertices, found), crosses(vertices, faces), atol=1e-15)


@pytest.mark.parametrize("wind", [mixed, lambda f: f[:, ::-1]])
def test_an_open_mesh_looks_up_where_it_is_seen(wind):
    vertices, faces = channel()
    up = crosses(vertices, faces)[:, 2]
    flat = np.isclose(vertices[faces][..., 2].min(axis=1), 0)
    _, found = oriented(vertices, wind(faces), flat)
    assert not is_closed(found)
    assert (up < -1e-6).any(), "walls that lean back look down"
    assert_allclose(crosses(vertices, found)[:, 2], up, atol=1e-15)


def test_cracks_are_closed():
    vertices, faces = box()
    shaken = vertices[faces].reshape(-1, 3)
    shaken = shaken + np.random.default_rng(1).uniform(-CRACK, CRACK, shaken.shape)
    loose = np.arange(len(shaken)).reshape(-1, 3)
    assert not is_closed(loose)
    assert is_closed(oriented(shaken, mixed(loose), np.zeros(len(faces), bool))[1])


def test_normals_of_edges_and_corners_lie_between_their_faces():
    vertices, faces = box()
    normals = outward_normals(vertices, faces)
    assert_allclose(normals[:, 0], np.rint(normals[:, 0]), atol=1e-12)
    ways = vertices[faces] / np.abs(vertices[faces])
    corner = normals[:, 4:] / np.linalg.norm(normals[:, 4:], axis=2, keepdims=True)
    assert_allclose(corner, ways / np.sqrt(3), atol=1e-12)  # whatever the diagonals
    count = (np.abs(normals[:, 1:4]) > 0.5).sum(axis=2)
    assert set(count.ravel()) == {1, 2}, "diagonals of sides, and edges of the box"


def test_the_border_of_an_open_mesh_looks_as_its_face():
    vertices, faces = cap(half=0.004)
    normals = outward_normals(vertices, faces)
    assert (np.einsum("fk,fnk->fn", normals[:, 0], normals) > 0).all()
