"""Charts are measured and drawn, quickly; the cloths of other programs are the ply."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks import _truth, charts
from benchmarks import qp as recorded
from benchmarks.charts import _relax, ply, qp
from benchmarks.charts._cloth import BENDING, SHEAR, STRETCH, cloth
from benchmarks.charts.results import read

SMALL = 1e-4  # [-] strains of which the energy is quadratic
ROUNDED = 1e-3  # [-] of an energy: strains of SMALL leave their square away
FIBER = 0.03  # [mm] rms of an exact fiber: finite elements stretch a little


@pytest.fixture(scope="module")
def case():
    return next(case for case in _truth.cases() if case.name == "B_saddle1000")


def spring_energy(mesh, vertices):
    pairs, stiffness = mesh.springs()
    lengths = [
        np.linalg.norm(x[pairs[:, 1]] - x[pairs[:, 0]], axis=1)
        for x in (mesh.flat, vertices)
    ]
    return float(stiffness @ (lengths[1] - lengths[0]) ** 2 / 2)


@pytest.mark.parametrize(("i", "j"), [(0, 0), (1, 1)])
def test_springs_stretch_as_the_fibers(case, i, j):
    mesh = cloth(case, 7)
    strain = np.zeros((3, 3))
    strain[i, j] = SMALL
    area = np.ptp(mesh.s) * np.ptp(mesh.t)
    along = spring_energy(mesh, mesh.flat + mesh.flat @ strain)
    # the weak diagonals add two thousandths
    assert_allclose(
        along, STRETCH * SMALL**2 * area / 2, rtol=2 * SHEAR / STRETCH + ROUNDED
    )


def test_springs_shear_as_the_weave(case):
    mesh = cloth(case, 7)
    strain = np.zeros((3, 3))
    strain[0, 1] = strain[1, 0] = SMALL / 2
    area = np.ptp(mesh.s) * np.ptp(mesh.t)
    energy = spring_energy(mesh, mesh.flat + mesh.flat @ strain)
    assert_allclose(energy, SHEAR * SMALL**2 * area / 2, rtol=ROUNDED)


@pytest.mark.parametrize("axis", [0, 1])
def test_hinges_bend_as_the_fibers(case, axis):
    """On a cylinder each hinge turns by the angle between two lines."""
    mesh, curvature = cloth(case, 7), 0.1
    angle = curvature * mesh.flat[:, axis]
    bent = mesh.flat.copy()
    bent[:, axis], bent[:, 2] = np.sin(angle), np.cos(angle) - 1
    bent[:, [axis, 2]] /= curvature
    i, j, k, m = (bent[each] for each in mesh.hinges.T)
    one, two = np.cross(k - i, m - i), np.cross(m - j, k - j)
    one, two = (n / np.linalg.norm(n, axis=1, keepdims=True) for n in (one, two))
    turned = np.linalg.norm(one - two, axis=1)
    inner = (np.ptp(mesh.s) - mesh.s[1] + mesh.s[0]) * np.ptp(mesh.t)
    energy = BENDING * float(turned @ turned) / 2
    assert_allclose(energy, BENDING * curvature**2 * inner / 2, rtol=ROUNDED)


def test_held_vertices_are_those_on_cups(case):
    mesh = cloth(case, 7)
    assert mesh.held.sum() == 4 * 5**2
    off = abs(mesh.flat[mesh.held, None, :2] - case.grid.centers).max(-1).min(-1)
    assert off.max() <= case.grid.half_width + 1e-12


@pytest.mark.parametrize("name", ["A_bend20_slack2", "A_asym_0_-20", "A_S_dz10"])
def test_elastica_is_a_strip_of_the_truth(name):
    own = next(case for case in _truth.cases() if case.name == name)
    assert ply._error(own, ply._elastica(own)) < FIBER


def test_coarser_finite_elements_err_more(case):
    """The recorded meshes converge, and count only where every case has them."""
    rows = ply._coarse_rows("one", [case])
    (coarse, finer) = (row["rms_mm"] for row in rows)
    assert 2 < coarse / finer < 8
    assert rows[0]["ms"] < rows[1]["ms"] < 1e3 * case.fe_seconds
    other = next(case for case in _truth.cases() if case.name not in ply.COMPARED)
    assert ply._coarse_rows("two", [case, other]) == []


def test_cloth_of_mujoco_comes_nearer():
    pytest.importorskip("mujoco")
    own = next(case for case in _truth.cases() if case.name == "A_bend20_slack2")
    mesh = cloth(own, 7)
    peer = _relax.MujocoFlex(mesh, softer=100.0)
    seen = _relax.relax(peer, (50, 600), mesh.start)
    assert_allclose(seen[-1][1][mesh.held], mesh.start[mesh.held], atol=1e-9)
    early, late = (ply._error(own, [mesh.points(v, own)]) for _, v in seen)
    assert late < 0.2 < early
    assert seen[1][0] > seen[0][0]


def test_ply_chart_names_the_programs_that_are_missing(tmp_path, monkeypatch):
    monkeypatch.setattr(_relax, "find_spec", lambda _: None)
    files = charts.make("ply", tmp_path, quick=True)
    assert [file.suffix for file in files] == [".csv", ".json", ".png", ".svg"]
    drawn, rows = files[-1].read_text(), read(tmp_path / "chart-ply").rows
    assert "MuJoCo flex: not installed" in drawn
    assert "as published" in drawn
    assert {"cubic", "modal", "coupled", "auto", "elastica"} <= {
        row["method"] for row in rows
    }
    assert all(row["ms"] > 0 for row in rows)


def test_qp_chart_counts_what_is_solved_and_what_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(recorded, "TAKE_UPS", recorded.TAKE_UPS[-1:])
    some = recorded.record_taut()[:1]
    monkeypatch.setattr(qp, "record", lambda _: (some, some))
    monkeypatch.setattr(qp, "record_taut", lambda: some)
    monkeypatch.setattr(qp, "SPARSE", ("piqp",))
    monkeypatch.setattr(qp, "DENSE", ())
    monkeypatch.setattr(qp, "TOLERANCES", (1e-3, 1e-7))
    charts.make("qp", tmp_path, quick=True)
    results = read(tmp_path / "chart-qp")
    assert {row["set"] for row in results.rows} == set(qp.SETS)
    for row in results.rows:
        if row["set"] == "contradictory":
            assert row["refused"] == 1
        else:
            assert row["solved"] == 1
            assert row["worst_violation_mm"] < max(10 * row["tolerance"], 1e-9)
