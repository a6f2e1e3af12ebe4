"""Point clouds as people have them, and one clear line for each that is none."""

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose

from drapeplan.errors import InputError
from drapeplan.scan import read_scan

POINTS = np.random.default_rng(0).uniform(-100, 300, (80, 3)).round(3)  # [mm]
HEADER = "x_mm,y_mm,z_mm\n"


def csv_text(points=POINTS):
    return HEADER + "".join(f"{x},{y},{z}\n" for x, y, z in points)


def written(folder, name, content):
    path = folder / name
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        path.write_text(content)
    return path


def test_csv(tmp_path):
    scan = read_scan(written(tmp_path, "a.csv", csv_text()))
    assert_allclose(scan.points, 1e-3 * POINTS)


def test_csv_with_columns_in_another_order_and_more(tmp_path):
    lines = ["red, z_mm, x_mm, y_mm"] + [f"7,{z},{x},{y}" for x, y, z in POINTS]
    scan = read_scan(written(tmp_path, "a.csv", "\ufeff" + "\n".join(lines) + "\n\n"))
    assert_allclose(scan.points, 1e-3 * POINTS)


@pytest.mark.parametrize("separator", [" ", "\t", ", ", ";"])
def test_xyz(tmp_path, separator):
    lines = ["# a camera wrote this", ""]
    lines += [separator.join(f"{x:g}" for x in (*p, 255)) for p in POINTS]
    path = written(tmp_path, "a.xyz", "\n".join(lines))
    assert_allclose(read_scan(path).points, 1e-3 * POINTS)
    assert_allclose(read_scan(path, "m").points, POINTS)


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_ply_of_points_and_of_a_mesh(tmp_path, encoding):
    cloud = trimesh.PointCloud(POINTS).export(file_type="ply", encoding=encoding)
    path = written(tmp_path, "a.ply", cloud)
    assert_allclose(read_scan(path).points, 1e-3 * POINTS, rtol=1e-6)
    mesh = trimesh.creation.icosphere(radius=0.1)
    path = written(tmp_path, "b.ply", mesh.export(file_type="ply", encoding=encoding))
    points = read_scan(path, "m").points
    assert len(points) == len(mesh.vertices)
    assert_allclose(np.linalg.norm(points, axis=1), 0.1, rtol=1e-6)


BAD = np.vstack([POINTS, [1.0, np.nan, 2.0]])


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.csv", "", ["no column x_mm"]),
        ("a.csv", "x,y,z\n1,2,3\n", ["no column x_mm", "x_mm,y_mm,z_mm"]),
        ("a.csv", HEADER, ["no points"]),
        ("a.csv", HEADER + "1,2,3\n1,2\n", ["line 3", "three numbers"]),
        ("a.csv", HEADER + "1,2,three\n", ["line 2", "three numbers"]),
        ("a.csv", csv_text(BAD), ["1 of 81", "NaN", "point 81"]),
        ("a.csv", csv_text(POINTS[:7]), ["7 points are too few"]),
        ("a.csv", b"\xff\xfe\x00", ["is no text"]),
        ("a.xyz", "# nothing\n", ["no points"]),
        ("a.xyz", "1 2 3\n1 2\n", ["line 2", "three numbers"]),
        ("a.ply", b"ply\nnonsense", ["cannot be read as PLY"]),
        ("a.ply", b"", ["cannot be read as PLY"]),
        ("a.pcd", "", ["unknown point cloud format '.pcd'", "CSV, XYZ or PLY"]),
    ],
)
def test_one_clear_line(tmp_path, name, content, words):
    path = written(tmp_path, name, content)
    with pytest.raises(InputError) as caught:
        read_scan(path)
    assert str(path) in str(caught.value)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("name", ["no.csv", "no.xyz", "no.ply"])
def test_missing_file(tmp_path, name):
    with pytest.raises(InputError, match="no such file"):
        read_scan(tmp_path / name)


def test_units_that_do_not_fit(tmp_path):
    path = written(tmp_path, "a.csv", csv_text())
    with pytest.raises(InputError, match="--unit: the header of a CSV file says mm"):
        read_scan(path, "m")
    with pytest.raises(InputError, match="--unit: there is no unit 'furlong'"):
        read_scan(path, "furlong")
