import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from ply.elastica import ElasticaStatus, elastica
from ply.fiber import FiberStatus, arc_length, cubic_fibers, powers
from ply.modal import modal_fibers

L = 0.07  # [m] free length between neighboring cups [Nielsen2018, Section 2]
SPECTRAL = 1e-9  # [m] error of the order used, at bows of 45 deg
U = np.linspace(0, 1, 71)
X = np.array([1.0, 0.0, 0.0])


def arc(angle):
    return np.array([L * np.sin(angle) / angle, 0.0])


def test_arcs_are_found_exactly():
    for angle in np.deg2rad([5, 20, 45]):
        found = elastica(arc(angle), angle, -angle, L)
        assert found.status == ElasticaStatus.STABLE
        assert found.energy == pytest.approx(2 * angle**2 / L, rel=1e-9)
        turned = angle * (1 - 2 * U)
        radius = L / (2 * angle)
        x = radius * (np.sin(angle) - np.sin(turned))
        z = radius * (np.cos(turned) - np.cos(angle))
        assert_allclose(found.points(U), np.stack([x, z], -1), rtol=0, atol=SPECTRAL)


def test_force_balance_holds_along_the_curve():
    """Theta'' = P sin(theta) - Q cos(theta): the elastica's own equation, by fit."""
    found = elastica(np.array([0.066, 0.004]), 0.3, -0.5, L)
    v = np.linspace(-0.95, 0.95, 41)
    series = np.polynomial.legendre.Legendre(found.angles)
    theta, second = series(v), series.deriv(2)(v)
    basis = np.stack([np.sin(theta), np.cos(theta)], axis=-1)
    force = np.linalg.lstsq(basis, second, rcond=None)[0]
    assert abs(second - basis @ force).max() < 1e-6 * abs(second).max()


def test_ends_and_length_are_met():
    rng = np.random.default_rng(0)
    angles = rng.uniform(-0.4, 0.4, (2, 50))
    chord = np.stack([rng.uniform(0.06, 0.066, 50), rng.uniform(-0.01, 0.01, 50)], -1)
    found = elastica(chord, *angles, L, 0.1)
    good = found.status == ElasticaStatus.STABLE
    assert good.mean() > 0.9
    path = found.points(np.linspace(0, 1, 2001))
    assert_allclose(path[good, -1], chord[good], rtol=0, atol=SPECTRAL)
    steps = np.linalg.norm(np.diff(path, axis=1), axis=-1)
    assert_allclose(steps[good].sum(-1), L, rtol=1e-6)
    start = path[:, 1] / steps[:, :1]
    assert_allclose(start[good, 1], np.sin(angles[0, good]), rtol=0, atol=1e-2)


def test_slack_between_parallel_ends_bows_to_either_side():
    chord = np.array([0.99 * L, 0.0])
    up, down = (elastica(chord, 0.0, 0.0, L, bow) for bow in (0.06, -0.06))
    middle = up.points(np.array([0.5]))[0, 1]
    assert middle == pytest.approx(2 / np.pi * np.sqrt(0.01) * L, rel=0.01)
    assert_allclose(down.points(U), up.points(U) * [1, -1], rtol=0, atol=SPECTRAL)
    straight = elastica(chord, 0.0, 0.0, L, 0.0)
    assert straight.status != ElasticaStatus.STABLE


def test_overstretched_fibers_say_so_and_are_finite():
    chord = np.array([[1.02 * L, 0.0], [0.98 * L, 0.0]])
    found = elastica(chord, np.full(2, 0.1), np.full(2, -0.1), L)
    expected = [ElasticaStatus.NOT_CONVERGED, ElasticaStatus.STABLE]
    assert_array_equal(found.status, expected)
    assert np.isfinite(found.angles).all()


def distance(found, chord, angle0, angle1, modes, side):
    """Largest normal distance of a modal fiber from the elastica, in [mm], if it is."""
    ends = [np.zeros(3), np.array([chord[0], 0, chord[1]])]
    ends += [np.array([np.cos(one), 0, np.sin(one)]) for one in (angle0, angle1)]
    up = np.array([0.0, 0.0, 1.0])
    fiber = modal_fibers(*ends, L, up, modes=modes, side=side, ribbon=False)
    if fiber.status not in (FiberStatus.MET, FiberStatus.WEAK_DIRECTION):
        return 0.0
    path = powers(np.linspace(0, 1, 2801), modes + 4) @ fiber.coefficients
    apart = found.points(U)[:, None] - path[:, [0, 2]]
    return 1e3 * np.linalg.norm(apart, axis=-1).min(axis=1).max()


def worst_arcs(modes):
    """Bends of 5 to 45 deg, chord 4 mm short of the arc's to 2 mm longer, feasible."""
    worst = 0.0
    for angle in np.deg2rad([5, 10, 20, 30, 45]):
        for change in (-4e-3, -2e-3, -1e-3, 0, 1e-3, 2e-3):
            chord = arc(angle) + np.array([change, 0])
            found = elastica(chord, angle, -angle, L, 0.05 * (change < 0))
            if found.status == ElasticaStatus.STABLE:
                error = distance(found, chord, angle, -angle, modes, 1)
                worst = max(worst, error)
    return worst


@pytest.mark.parametrize(("modes", "bound"), [(1, 0.94), (2, 0.66), (3, 0.32)])
def test_bends_are_as_near_as_published(modes, bound):
    """Largest normal distances measured before the model was written."""
    assert worst_arcs(modes) <= bound


def shifted(offset, slack):
    """Parallel cups, offset, with some slack against the natural curve."""
    chords = np.linspace(0.06, 0.0705, 2001)
    ends = np.stack([chords, 0 * chords, np.full(2001, offset)], axis=-1)
    tangents = np.broadcast_to(X, ends.shape)
    length = arc_length(cubic_fibers(0 * ends, ends, tangents, tangents, L))
    return np.array([np.interp(L, length, chords) - slack, offset])


@pytest.mark.parametrize(
    ("offset", "slack", "bounds"),
    [(0.01, 0.5e-3, (1.41, 0.21, 0.07)), (0.02, 1e-3, (4.21, 0.66, 0.61))],
)
def test_s_shapes_need_the_second_mode(offset, slack, bounds):
    chord = shifted(offset, slack)
    found = elastica(chord, 0.0, 1e-3, L, -0.1)
    assert found.status == ElasticaStatus.STABLE
    errors = [distance(found, chord, 0.0, 1e-3, m, -1) for m in (1, 2, 3)]
    assert (np.array(errors) <= bounds).all()
    assert errors[0] > 6 * errors[2]
