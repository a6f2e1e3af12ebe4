import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal

from drapeplan.errors import InputError
from drapeplan.mesh import UNITS, check_size, look_down, read_mesh

SINGLE = 1e-7  # [m] binary files hold single precision
TEXT = 1e-7  # [m] text files hold eight decimals of a mm or less
EXACT = 1e-12  # [m] float64 noise at a meter


def bowl(n=9, size=1.0):
    """Open mesh of a paraboloid over a square, vertices in [m]."""
    line = np.linspace(-size / 2, size / 2, n)
    x, y = np.meshgrid(line, line, indexing="ij")
    vertices = np.stack([x, y, 0.3 * x**2 + 0.1 * y], axis=-1).reshape(-1, 3)
    k = np.arange(n * n).reshape(n, n)
    a, b, c, d = (v.ravel() for v in (k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return trimesh.Trimesh(vertices, faces, process=False)


def write(mesh, folder, name="mold.stl", **how):
    """Path of the mesh exported into the folder."""
    path = folder / name
    mesh.export(path, **how)
    return path


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize(
    ("name", "how"),
    [
        ("mold.stl", {}),
        ("mold.STL", {"file_type": "stl_ascii"}),
        ("mold.obj", {}),
        ("mold.ply", {}),
        ("mold.ply", {"encoding": "ascii"}),
    ],
)
def test_every_format_and_unit_reads_the_same_surface(tmp_path, name, how, unit):
    mesh = bowl()
    scaled = mesh.copy()
    scaled.vertices = mesh.vertices / UNITS[unit]
    vertices, faces = read_mesh(write(scaled, tmp_path, name, **how), unit)
    assert len(vertices) == len(mesh.vertices)
    assert len(faces) == len(mesh.faces)
    found, expected = vertices[faces].mean(axis=1), mesh.triangles_center
    order = [np.lexsort(np.round(c, 6).T) for c in (found, expected)]
    assert_allclose(found[order[0]], expected[order[1]], atol=SINGLE + TEXT)


def refusal(path, unit="mm"):
    """The message that reading the mesh fails with."""
    with pytest.raises(InputError) as failure:
        read_mesh(path, unit)
    message = str(failure.value)
    assert "\n" not in message
    assert str(path) in message
    assert failure.value.exit_code == 2
    return message


def test_a_missing_file_is_named(tmp_path):
    assert "no such mesh file" in refusal(tmp_path / "nowhere.stl")
    (tmp_path / "folder.stl").mkdir()
    assert "no such mesh file" in refusal(tmp_path / "folder.stl")


def test_an_unknown_format_says_what_to_use(tmp_path):
    (tmp_path / "mold.step").write_text("ISO-10303-21;")
    assert "use STL, OBJ or PLY" in refusal(tmp_path / "mold.step")


def test_an_unknown_unit_lists_the_known(tmp_path):
    assert "mm, cm, m, inch" in refusal(write(bowl(), tmp_path), "furlong")


@pytest.mark.parametrize("name", ["a.stl", "a.ply", "a.obj"])
@pytest.mark.parametrize("content", [b"", b"not a mesh at all", b"\x00\xff" * 300])
def test_an_unreadable_file_gives_one_line(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    message = refusal(tmp_path / name)
    assert any(
        word in message for word in ("cannot be read", "no faces", "degenerate", "NaN")
    )


def test_a_truncated_file_is_refused(tmp_path):
    path = write(bowl(), tmp_path)
    path.write_bytes(path.read_bytes()[:-300])
    assert "cannot be read as STL" in refusal(path)


def test_points_without_faces_are_refused(tmp_path):
    text = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n"
    text += "property float y\nproperty float z\nend_header\n0 0 0\n"
    (tmp_path / "cloud.ply").write_text(text)
    assert "no faces" in refusal(tmp_path / "cloud.ply")


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_vertices_that_are_not_finite_are_counted(tmp_path, bad):
    mesh = bowl()
    vertices = mesh.vertices.copy()
    vertices[40, 2] = bad
    broken = trimesh.Trimesh(vertices, mesh.faces, process=False)
    with np.errstate(invalid="ignore"):  # the writer's own normals
        path = write(broken, tmp_path)
    assert "not finite" in refusal(path)


def test_a_mesh_without_area_is_refused_and_few_slivers_are_dropped(tmp_path):
    mesh = bowl()
    flat = trimesh.Trimesh(mesh.vertices * [1, 0, 0], mesh.faces, process=False)
    assert "no face has an area" in refusal(write(flat, tmp_path))
    point = trimesh.Trimesh(mesh.vertices * 0, mesh.faces, process=False)
    assert "no face has an area" in refusal(write(point, tmp_path))
    faces = np.vstack([mesh.faces, [[0, 1, 1], [5, 5, 5], [0, 1, 2]]])
    slivers = trimesh.Trimesh(mesh.vertices, faces, process=False)
    kept = read_mesh(write(slivers, tmp_path), "m")[1]
    assert len(kept) == len(mesh.faces) + 1  # (0, 1, 2) lies on an arc: it has an area


def test_several_bodies_are_counted(tmp_path):
    parts = [bowl(), bowl(), bowl()]
    for k, part in enumerate(parts):
        part.apply_translation([2.0 * k, 0, 0])
    message = refusal(write(trimesh.util.concatenate(parts), tmp_path), "m")
    assert "3 separate bodies" in message
    assert "export the one surface" in message


def test_seams_of_nearly_equal_vertices_hold_together(tmp_path):
    left, right = bowl(), bowl()
    right.vertices = right.vertices * [-1, 1, 1] + [1 + 2e-7, 0, 0]  # [m] below 1 um
    mesh = trimesh.util.concatenate([left, right])
    assert len(read_mesh(write(mesh, tmp_path), "m")[1]) == 2 * len(left.faces)


@pytest.mark.parametrize(
    ("extent", "unit", "words"),
    [
        ((0.8e-3, 1e-3), "mm", "the mold is 0.8 x 1.0 mm, the ply 630 x 850 mm"),
        ((0.8e-3, 1e-3), "mm", "is the mesh in meters? set mold.mesh.unit: m"),
        ((0.08, 0.1), "mm", "set mold.mesh.unit: cm"),
        ((0.032, 0.04), "mm", "set mold.mesh.unit: inch"),
        ((800.0, 1000.0), "m", "the mold is 800 x 1000 m"),
        ((800.0, 1000.0), "m", "is the mesh in millimeters? set mold.mesh.unit: mm"),
        ((1e-9, 1e-9), "mm", "check the mesh"),
    ],
)
def test_sizes_betray_a_wrong_unit(extent, unit, words):
    with pytest.raises(InputError, match=r"mold\.mesh\.unit") as failure:
        check_size(extent, 0.63, 0.85, "panel.stl", unit)
    assert words in str(failure.value)


def test_fitting_sizes_pass():
    for extent in ((0.8, 1.0), (0.3, 0.3), (15, 2)):
        check_size(extent, 0.63, 0.85, "panel.stl")


def test_rays_find_the_planes_of_the_faces():
    mesh = bowl(5)
    inner = np.random.default_rng(0).uniform(-0.49, 0.49, (500, 2))
    z, hit = look_down(mesh.vertices, mesh.faces, *inner.T)
    assert hit.all()
    barycentric = trimesh.triangles.points_to_barycentric
    flat = mesh.triangles * [1, 1, 0]
    for point, height in zip(inner[:50], z[:50], strict=True):  # by brute force
        at = np.tile([*point, 0.0], (len(flat), 1))
        weights = barycentric(flat, at)
        face = np.argmax(weights.min(axis=1))
        assert_allclose(height, weights[face] @ mesh.triangles[face, :, 2], atol=1e-9)


def test_rays_hit_edges_vertices_and_outlines():
    mesh = bowl(5)
    x, y = mesh.vertices[:, :2].T * (1 - 1e-6)
    z, hit = look_down(mesh.vertices, mesh.faces, x, y)
    assert hit.all()
    assert_allclose(z, mesh.vertices[:, 2], atol=2e-6)  # [m] slope times inset
    missed, hit = look_down(mesh.vertices, mesh.faces, np.array([0.6]), np.array([0.0]))
    assert not hit.any()
    assert_array_equal(missed, 0)


def test_the_highest_face_counts_and_walls_do_not():
    box = trimesh.creation.box(extents=(1, 1, 0.4))
    line = np.linspace(-0.4999, 0.4999, 40)
    x, y = (v.ravel() for v in np.meshgrid(line, line))
    z, hit = look_down(np.asarray(box.vertices), np.asarray(box.faces), x, y)
    assert hit.all()
    assert_allclose(z, 0.2, atol=EXACT)
    walls = abs(box.face_normals[:, 2]) < 0.5
    assert not look_down(np.asarray(box.vertices), box.faces[walls], x, y)[1].any()
