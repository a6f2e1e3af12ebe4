import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from ply.errors import PlyError
from ply.fiber import FiberStatus, LengthStatus, arc_length, cubic_fibers
from ply.grid import CupGrid, Region
from ply.shape import PlySampling, evaluate, ply_fibers

GRID = CupGrid(rows=3, columns=4, pitch=0.11, half_width=0.02)
UNEVEN = CupGrid(3, 2, 0.1, 0.015, s_length=0.0702, t_length=0.0699)
ROUNDING = 1e-14  # [m] float64 noise on a ply below 1 m
STEP = 1e-5  # [m] step that Eq. 46 leaves at patch edges within 2 mm of a corner
KINK = 1e-3  # [-] change of slope across an edge; curvature over 8 um adds 4e-4
X, Y, Z = np.eye(3)
SEEDS = st.integers(0, 10**6)


def rotations(vectors):
    """Rotation matrices of rotation vectors, shape (..., 3) to (..., 3, 3)."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    cross = np.zeros((*vectors.shape[:-1], 3, 3))
    for k, (i, j) in enumerate([(1, 2), (2, 0), (0, 1)]):
        cross[..., j, i], cross[..., i, j] = vectors[..., k], -vectors[..., k]
    safe = np.where(angle > 0, angle, 1)
    square = cross @ cross
    return (
        np.eye(3)
        + np.sin(angle) / safe * cross
        + (1 - np.cos(angle)) / safe**2 * square
    )


def poses(grid, seed, batch=(), play=5e-4, tilt=0.1):
    """Cups of a flat array, disturbed."""
    rng = np.random.default_rng(seed)
    positions = np.zeros((*batch, grid.n_cups, 3))
    positions[..., :2] = grid.centers
    positions += play * rng.normal(size=positions.shape)
    return positions, rotations(tilt * rng.normal(size=positions.shape))


def naive_point(grid, fibers, positions, frames, s, t):
    """One material point, read off the paper with scalars and loops."""
    d, span = grid.half_width, grid.pitch - 2 * grid.half_width
    j = max(k for k in range(grid.columns) if k == 0 or s >= k * grid.pitch - d - 1e-9)
    i = max(k for k in range(grid.rows) if k == 0 or t >= k * grid.pitch - d - 1e-9)
    x, y = s - j * grid.pitch, t - i * grid.pitch
    free_s = x > d + 1e-9 and j < grid.columns - 1
    free_t = y > d + 1e-9 and i < grid.rows - 1

    def curve(a, u):
        return sum(a[k] * u**k for k in range(5))

    def ruled(low, high, u, y):
        r1, r2 = curve(low, u), curve(high, u)
        return (r2 - r1) / (2 * d) * y + (r2 + r1) / 2

    def cubic(g0, g1, dg0, dg1, length, v):
        q = v * length
        c2 = (3 * (g1 - g0) - length * (2 * dg0 + dg1)) / length**2
        c3 = (-2 * (g1 - g0) + length * (dg0 + dg1)) / length**3
        return g0 + dg0 * q + c2 * q**2 + c3 * q**3

    def slope(pair, u):
        return (curve(pair[1], u) - curve(pair[0], u)) / (2 * d)

    if not free_s and not free_t:
        n = i * grid.columns + j
        return positions[n] + x * frames[n][:, 0] + y * frames[n][:, 1]
    u, v = (x - d) / span, (y - d) / span
    if not free_t:
        return ruled(*fibers.s[i, j], u, y)
    if not free_s:
        return ruled(*fibers.t[i, j], v, x)
    low, high = fibers.s[i, j], fibers.s[i + 1, j]
    left, right = fibers.t[i, j], fibers.t[i, j + 1]
    inner = curve(low[1], u), curve(high[0], u), slope(low, u), slope(high, u)
    gamma_s = cubic(*inner, grid.t_length, v)
    inner = curve(left[1], v), curve(right[0], v), slope(left, v), slope(right, v)
    gamma_t = cubic(*inner, grid.s_length, u)
    f, g = (u * (1 - u)) ** 2, (v * (1 - v)) ** 2
    w, h = ((np.exp(-1e4 * q**2) + np.exp(-1e4 * (1 - q) ** 2)) / 2 for q in (u, v))
    ws = (1e-12 + g * h + f * (1 - w)) / (1e-12 + g + f)
    wt = (1e-12 + g * (1 - h) + f * w) / (1e-12 + g + f)
    return (ws * gamma_s + wt * gamma_t) / (ws + wt)


@settings(max_examples=10, deadline=None)
@given(seed=SEEDS, grid=st.sampled_from([GRID, UNEVEN]))
def test_sampling_and_evaluate_agree_with_a_naive_loop(seed, grid):
    rng = np.random.default_rng(seed)
    s = np.sort(rng.uniform(-0.06, grid.columns * 0.11, 17))
    t = np.sort(rng.uniform(-0.06, grid.rows * 0.11, 13))
    positions, frames = poses(grid, seed)
    fibers = ply_fibers(grid, positions, frames)
    expected = [
        [naive_point(grid, fibers, positions, frames, a, b) for a in s] for b in t
    ]
    sampling = PlySampling(grid, s, t)
    points = sampling.points(fibers, positions, frames)
    assert_allclose(points, expected, rtol=0, atol=10 * ROUNDING)
    scattered = sampling.points_st.reshape(-1, 2)
    points = evaluate(grid, fibers, positions, frames, scattered)
    assert_allclose(points.reshape(13, 17, 3), expected, rtol=0, atol=10 * ROUNDING)


@pytest.mark.parametrize("grid", [GRID, UNEVEN])
def test_fibers_begin_and_end_on_the_facing_edges_of_the_cups(grid):
    """Eq. 1-4, for each fiber of both families."""
    positions, frames = poses(grid, 3)
    fibers = ply_fibers(grid, positions, frames)
    d = grid.half_width
    for coefficients, length, axis, step in (
        (fibers.s, grid.s_length, 0, 1),
        (fibers.t, grid.t_length, 1, grid.columns),
    ):
        for i, j, side in np.ndindex(*coefficients.shape[:3]):
            a, lateral = coefficients[i, j, side], (-d, d)[side]
            first = i * grid.columns + j
            for cup, local, point, tangent in (
                (first, d, a[0], a[1]),
                (first + step, -d, a.sum(0), np.arange(5) @ a),
            ):
                corner = np.array([local, lateral] if axis == 0 else [lateral, local])
                expected = positions[cup] + frames[cup][:, :2] @ corner
                assert_allclose(point, expected, rtol=0, atol=ROUNDING)
                along = frames[cup][:, axis]
                assert_allclose(tangent / length, along, rtol=0, atol=1e-12)


def test_flat_ply_keeps_its_material_coordinates():
    positions, frames = poses(GRID, 0, play=0, tilt=0)
    fibers = ply_fibers(GRID, positions, frames)
    assert (fibers.s_status == FiberStatus.MET).all()
    assert (fibers.t_status == FiberStatus.MET).all()
    sampling = PlySampling.regular(GRID, 0.01, 0.025)
    points = sampling.points(fibers, positions, frames)
    assert_allclose(points[..., :2], sampling.points_st, rtol=0, atol=ROUNDING)
    assert_allclose(points[..., 2], 0, rtol=0, atol=ROUNDING)


def edges(grid):
    """Points (s, t) on edges across s, and their distance to corners in spans."""
    edge = (np.arange(grid.columns)[:, None] * grid.pitch + [-0.02, 0.02]).ravel()[1:-1]
    u = np.array([0.002, 0.01, 0.02, 0.05, 0.1, 0.37, 0.5, 0.8, 0.95, 0.98, 0.999])
    on_cup = np.array([-0.019, 0.0, 0.013])
    along = np.concatenate([on_cup, 0.02 + 0.07 * u, 0.13 + 0.07 * u])
    corner = np.concatenate([0 * on_cup + 1, np.tile(np.minimum(u, 1 - u), 2)])
    s, t = (q.ravel() for q in np.meshgrid(edge, along))
    return s, t, np.repeat(corner, len(edge))


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS, mirrored=st.booleans())
def test_surface_is_continuous_and_smooth_across_edges(seed, mirrored):
    grid = CupGrid(3, 3, 0.11, 0.02)
    positions, frames = poses(grid, seed)
    fibers = ply_fibers(grid, positions, frames)
    s, t, corner = edges(grid)

    def surface(offset):
        points_st = np.stack([s + offset, t], axis=-1)
        points_st = points_st[:, ::-1] if mirrored else points_st
        return evaluate(grid, fibers, positions, frames, points_st)

    step = np.linalg.norm(surface(2e-9) - surface(-2e-9), axis=-1)  # [m] 4 nm apart
    assert step.max() < STEP
    assert step[corner > 0.04].max() < 5e-9
    h = 2e-6
    before = (surface(-h) - surface(-2 * h)) / h
    after = (surface(2 * h) - surface(h)) / h
    assert np.linalg.norm(after - before, axis=-1).max() < KINK


@settings(deadline=None)
@given(seed=SEEDS)
def test_rigid_motion_moves_the_ply(seed):
    positions, frames = poses(GRID, seed)
    turn = rotations(np.random.default_rng(seed).normal(size=3))
    shift = np.array([0.3, -0.2, 0.5])
    sampling = PlySampling.regular(GRID, 0.01, 0.02)
    points = sampling.points(ply_fibers(GRID, positions, frames), positions, frames)
    moved = positions @ turn.T + shift, turn @ frames
    expected = points @ turn.T + shift
    moved_points = sampling.points(ply_fibers(GRID, *moved), *moved)
    assert_allclose(moved_points, expected, rtol=0, atol=1e-11)


def test_batch_axes_come_first():
    positions, frames = poses(GRID, 5, batch=(2, 3))
    sampling = PlySampling.regular(GRID, 0.01, 0.02)
    fibers = ply_fibers(GRID, positions, frames)
    assert fibers.s.shape == (2, 3, 3, 3, 2, 5, 3)
    assert fibers.t_status.shape == (2, 3, 2, 4, 2)
    points = sampling.points(fibers, positions, frames)
    one = positions[1, 2], frames[1, 2]
    alone = sampling.points(ply_fibers(GRID, *one), *one)
    assert_allclose(points[1, 2], alone, rtol=0, atol=ROUNDING)
    some = sampling.points_st[::7, ::5].reshape(-1, 2)
    scattered = evaluate(GRID, fibers, positions, frames, some)
    expected = points[..., ::7, ::5, :].reshape(2, 3, -1, 3)
    assert_allclose(scattered, expected, rtol=0, atol=ROUNDING)


def test_dependence_on_cups_is_as_listed():
    """Moving one cup moves the samples that list it, and no others."""
    positions, frames = poses(GRID, 7)
    sampling = PlySampling.regular(GRID, 0.01, 0.02)
    before = sampling.points(ply_fibers(GRID, positions, frames), positions, frames)
    for cup in (0, 3, 5, 11):
        moved = positions.copy()
        moved[cup] += [1e-3, 2e-3, 3e-3]
        after = sampling.points(ply_fibers(GRID, moved, frames), moved, frames)
        changed = np.linalg.norm(after - before, axis=-1) > 1e-9
        listed = (sampling.cups_around == cup).any(axis=-1)
        assert not (changed & ~listed).any()
        assert (changed == listed).mean() > 0.98  # a blend may leave an edge alone


def test_cup_index_holds_the_cup_squares_alone():
    sampling = PlySampling.regular(GRID, 0.01, 0.025)
    regions = GRID.regions(sampling.points_st)
    assert_array_equal(sampling.cup_index >= 0, regions == Region.CUP)
    held = sampling.cup_index >= 0
    offset = sampling.points_st[held] - GRID.centers[sampling.cup_index[held]]
    assert abs(offset).max() < GRID.half_width + 1e-9
    assert held.sum() == GRID.n_cups * 25
    counts = [len(set(cups)) for cups in sampling.cups_around.reshape(-1, 4).tolist()]
    expected = np.array([1, 2, 2, 4])[regions[regions != Region.OVERHANG]]
    assert_array_equal(
        np.reshape(counts, regions.shape)[regions != Region.OVERHANG], expected
    )


def test_regular_lines_carry_the_edge_of_the_overhang():
    sampling = PlySampling.regular(GRID, 0.01, 0.025)
    assert_allclose(sampling.s[:4], [-0.045, -0.04, -0.03, -0.02], atol=ROUNDING)
    assert_allclose(sampling.s[-4:], [0.35, 0.36, 0.37, 0.375], atol=ROUNDING)
    assert_allclose(PlySampling.regular(GRID, 0.01, 0.02).t[[0, -1]], [-0.04, 0.26])
    assert_allclose(PlySampling.regular(GRID, 0.01).t[[0, -1]], [-0.02, 0.24])


def test_overhang_is_extended_linearly():
    positions, frames = poses(GRID, 11)
    fibers = ply_fibers(GRID, positions, frames)
    sampling = PlySampling.regular(GRID, 0.01, 0.02)
    p = sampling.points(fibers, positions, frames)
    second = p[0] - 2 * p[1] + p[2]  # lines -40, -30, -20 mm: straight across the edge
    assert_allclose(second, 0, atol=10 * ROUNDING)
    assert_allclose(p[:, -1] - 2 * p[:, -2] + p[:, -3], 0, atol=10 * ROUNDING)
    corner = positions[0] + frames[0] @ [-0.04, -0.04, 0]
    assert_allclose(p[0, 0], corner, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 4), (3, 1)])
def test_single_rows_and_columns(rows, columns):
    grid = CupGrid(rows, columns, 0.11, 0.02)
    positions, frames = poses(grid, 2)
    sampling = PlySampling.regular(grid, 0.01, 0.01)
    fibers = ply_fibers(grid, positions, frames)
    points = sampling.points(fibers, positions, frames)
    expected = evaluate(
        grid, fibers, positions, frames, sampling.points_st.reshape(-1, 2)
    )
    assert_allclose(points.reshape(-1, 3), expected, rtol=0, atol=ROUNDING)


def cups_apart(extra):
    """Two cups of a flat row, with a spacing that is off by extra."""
    grid = CupGrid(1, 2, 0.11, 0.02)
    return grid, np.stack([0 * X, (0.11 + extra) * X]), np.stack([np.eye(3)] * 2)


@pytest.mark.parametrize(
    ("extra", "band", "status", "used"),
    [
        (-0.3e-3, LengthStatus.IN_BAND, FiberStatus.MET, -0.3e-3),
        (0.3e-3, LengthStatus.IN_BAND, FiberStatus.MET, 0.3e-3),
        (-0.9e-3, LengthStatus.SLACK, FiberStatus.NOT_ASKED, -0.4e-3),
        (0.9e-3, LengthStatus.TOO_SHORT, FiberStatus.OVERSTRETCHED, 0.4e-3),
    ],
)
def test_take_up_is_a_band_around_the_length(extra, band, status, used):
    grid, positions, frames = cups_apart(extra)
    fibers = ply_fibers(grid, positions, frames, take_up=0.4e-3)
    assert (fibers.s_band == band).all()
    assert (fibers.s_status == status).all()
    assert_allclose(fibers.s_natural, 0.07 + extra, rtol=0, atol=ROUNDING)
    assert_allclose(fibers.s_used, 0.07 + used, rtol=0, atol=ROUNDING)
    assert_allclose(fibers.s[..., 1, 0], 0.07 + used, rtol=0, atol=ROUNDING)
    assert (fibers.s[..., 4, :] == 0).all()


def test_inside_the_band_the_length_is_the_natural_one():
    positions, frames = poses(GRID, 4, play=1e-4, tilt=0.02)
    fibers = ply_fibers(GRID, positions, frames, take_up=1e-3)
    assert (fibers.t_band == LengthStatus.IN_BAND).all()
    assert_allclose(arc_length(fibers.t), fibers.t_natural, rtol=1e-6)


def test_the_paper_has_one_length_and_the_cubic_corrects_none():
    positions, frames = poses(GRID, 4)
    quartic = ply_fibers(GRID, positions, frames)
    cubic = ply_fibers(GRID, positions, frames, model="cubic")
    assert_array_equal(quartic.s_used, GRID.s_length)
    failed = quartic.s_status >= FiberStatus.TOO_LONG
    assert 0 < failed.sum() < failed.size
    assert_allclose(quartic.s[failed], cubic.s[failed], rtol=0, atol=ROUNDING)
    assert abs(quartic.s[~failed] - cubic.s[~failed]).max() > 1e-5
    assert_array_equal(cubic.s_used, GRID.s_length)
    chord = cubic.s[..., 1:, :].sum(axis=-2)
    again = cubic_fibers(
        cubic.s[..., 0, :],
        cubic.s[..., 0, :] + chord,
        cubic.s[..., 1, :] / GRID.s_length,
        np.arange(5) @ cubic.s / GRID.s_length,
        GRID.s_length,
    )
    assert_allclose(cubic.s, again, rtol=0, atol=ROUNDING)


def bad_input():
    positions, frames = poses(GRID, 0)
    spoiled = positions.copy()
    spoiled[3, 1] = np.nan
    return [
        ("positions", lambda: ply_fibers(GRID, positions[:-1], frames)),
        ("positions", lambda: ply_fibers(GRID, spoiled, frames)),
        ("rotations", lambda: ply_fibers(GRID, positions, frames[..., :2])),
        ("model", lambda: ply_fibers(GRID, positions, frames, model="auto")),
        ("take_up", lambda: ply_fibers(GRID, positions, frames, take_up=-1e-3)),
        ("step", lambda: PlySampling.regular(GRID, 0.015)),
        ("step", lambda: PlySampling.regular(GRID, 0.0)),
        ("step", lambda: PlySampling.regular(GRID, np.nan)),
        ("overhang", lambda: PlySampling.regular(GRID, 0.01, -0.01)),
        ("s", lambda: PlySampling(GRID, np.array([0.0, np.inf]), np.zeros(1))),
        ("t", lambda: PlySampling(GRID, np.zeros(1), np.zeros((2, 2)))),
    ]


@pytest.mark.parametrize(("argument", "call"), bad_input())
def test_bad_input_is_refused_by_name(argument, call):
    with pytest.raises(PlyError) as caught:
        call()
    assert caught.value.argument == argument


@pytest.mark.parametrize("settings", [{}, {"across": 2}, {"modes": 2}])
def test_modal_surfaces_of_both_ways_agree(settings):
    positions, frames = poses(UNEVEN, 3, batch=(11,))
    fibers = ply_fibers(UNEVEN, positions, frames, model="modal", **settings)
    sampling = PlySampling(
        UNEVEN, np.linspace(-0.03, 0.13, 13), np.linspace(-0.03, 0.23, 17)
    )
    points = sampling.points(fibers, positions, frames)
    scattered = sampling.points_st.reshape(-1, 2)
    expected = evaluate(UNEVEN, fibers, positions, frames, scattered)
    assert_allclose(points.reshape(expected.shape), expected, rtol=0, atol=ROUNDING)


def test_three_fibers_keep_the_surface_smooth():
    grid = CupGrid(3, 3, 0.11, 0.02)
    positions, frames = poses(grid, 3)
    fibers = ply_fibers(grid, positions, frames, model="modal")
    s, t, corner = edges(grid)

    def surface(offset):
        points_st = np.stack([s + offset, t], axis=-1)
        return evaluate(grid, fibers, positions, frames, points_st)

    step = np.linalg.norm(surface(2e-9) - surface(-2e-9), axis=-1)
    assert step[corner > 0.04].max() < 5e-9
    h = 2e-6
    before = (surface(-h) - surface(-2 * h)) / h
    after = (surface(2 * h) - surface(h)) / h
    assert np.linalg.norm(after - before, axis=-1)[corner > 0.04].max() < KINK


def test_faulty_cups_are_named_with_a_number():
    positions, frames = poses(GRID, 1)
    frames[0] *= 1.01
    positions[2] = positions[1] + 0.04 * frames[1][:, 0]
    frames[2] = frames[1]
    frames[10] = frames[10] * [1, -1, -1]
    for model in ("modal", "quartic", "cubic"):
        fibers = ply_fibers(GRID, positions, frames, model=model)
        assert np.isfinite(fibers.s).all()
        assert np.isfinite(fibers.s_excess).all()
        assert (fibers.s_status[0, 0] == FiberStatus.SKEWED).all()
        assert_allclose(fibers.s_excess[0, 0], 0.0201, rtol=1e-3)
        assert (fibers.s_status[0, 1] == FiberStatus.COINCIDENT).all()
        assert (fibers.s_excess[0, 1] < 1e-9).all()
        assert (fibers.t_status[1, 2] == FiberStatus.INVERTED).all()
        assert (fibers.t_excess[1, 2] < 0).all()


@pytest.mark.parametrize(
    ("argument", "settings"),
    [
        ("stiffness", {"gravity": (0, 0, -3.0)}),
        ("stiffness", {"softness": 1e-6}),
        ("softness", {"softness": -1.0}),
        ("gravity", {"gravity": (0, -3.0), "stiffness": 5e-3}),
        ("across", {"across": 4}),
        ("modes", {"modes": 0}),
        ("sides", {"sides": (np.ones((2, 2)), np.ones((2, 4)))}),
    ],
)
def test_bad_settings_are_refused_by_name(argument, settings):
    positions, frames = poses(GRID, 0)
    with pytest.raises(PlyError) as caught:
        ply_fibers(GRID, positions, frames, model="modal", **settings)
    assert caught.value.argument == argument
