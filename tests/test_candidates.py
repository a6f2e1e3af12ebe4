import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drapeplan.candidates import MOST, Candidate, Relief, candidates
from drapeplan.errors import InputError
from drapeplan.net import Net
from drapeplan.orders import SequenceSection
from drapeplan.sequence import make_sequence
from tests.plans import scene

PITCH = 0.11  # [m]
CLOSE = 0.02  # [-] curvature over three cups against that at a point


def net_over(height, rows=8, columns=6):
    """A net that is even in plan view, over a height and its gradient."""
    i, j = np.divmod(np.arange(rows * columns), columns)
    x, y = PITCH * (j - (columns - 1) / 2), PITCH * (i - (rows - 1) / 2)
    z, zx, zy = (np.broadcast_to(part, x.shape) for part in height(x, y))
    xy = np.stack([x, y], axis=1)
    normals = np.stack([-zx, -zy, np.ones(x.shape)], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    frames = np.tile(np.eye(3), (len(x), 1, 1))
    positions = np.column_stack([xy, z])
    return Net(rows, columns, xy, positions, normals, frames, 0.0, True, 0.0)


def paraboloid(a, b, x0=0.0, y0=0.0):
    """Height and gradient of a paraboloid of curvatures a and b, its top at a point."""

    def height(x, y):
        x, y = x - x0, y - y0
        return -(a * x**2 + b * y**2) / 2, -a * x, -b * y

    return height


def keys(height, rows=8, columns=6, **sections):
    """Start and pattern of each candidate."""
    sections = {"sequence": "auto"} | sections
    found = candidates(scene(**sections), net_over(height, rows, columns), PITCH)
    return [(one.sequence.start, one.sequence.pattern) for one in found]


@pytest.mark.parametrize(("a", "b", "along"), [(1.0, 0.4, "t"), (0.4, 1.0, "s")])
@pytest.mark.parametrize("sign", [1, -1])
def test_the_spine_along_the_straighter_way_comes_first(a, b, along, sign):
    found = keys(paraboloid(sign * a, sign * b))
    spines = [pattern for start, pattern in found if pattern.startswith("spine")]
    assert spines[0] == f"spine_{along}"
    edge = {"t": (3, 0), "s": (0, 2)}[along]
    assert (edge, f"spine_{along}") in found
    assert ((0, 0), f"spine_{along}") in found


def test_curvatures_are_those_of_the_mold():
    relief = Relief.of(net_over(paraboloid(0.5, -0.2)), PITCH)
    assert relief.curvatures["s"] == pytest.approx(0.5, rel=CLOSE)
    assert relief.curvatures["t"] == pytest.approx(0.2, rel=CLOSE)
    assert relief.radius("s") == "radius 2 m"
    assert Relief.of(net_over(paraboloid(0.0, 0.0)), PITCH).radius("t") == "straight"


def test_a_mold_that_is_its_own_mirror_image_needs_one_of_two_edges():
    found = keys(paraboloid(1.0, 0.5))
    assert ((3, 0), "spine_t") in found
    assert ((3, 5), "spine_t") not in found
    lopsided = keys(lambda x, y: (-(x**3), -3 * x**2, 0.0))
    assert {((3, 0), "spine_t"), ((3, 5), "spine_t")} <= set(lopsided)


@pytest.mark.parametrize(("sign", "name"), [(1, "highest"), (-1, "lowest")])
def test_top_and_bottom_are_starts(sign, name):
    net = net_over(paraboloid(sign, sign, 0.5 * PITCH, -1.5 * PITCH))
    found = candidates(scene(sequence="auto"), net, PITCH)
    assert found[4].sequence.start == (2, 3)
    assert found[4].why == f"from the {name} region, sides in turn"


def test_what_the_scene_names_is_among_them():
    height = paraboloid(1.0, 0.5)
    usual = keys(height)
    own = keys(height, sequence={"start": [5, 1], "pattern": "spine_s"})
    assert set(own) - set(usual) == {((5, 1), "spine_s")}
    assert len(keys(height, sequence={})) == len(usual)  # the middle, sides in turn
    steps = [[[0, 0]], [[0, 1], [1, 0], [1, 1]]]
    found = candidates(scene(sequence={"steps": steps}), net_over(height, 2, 2), PITCH)
    assert all(one.sequence.steps is None for one in found)  # as all sides at once
    steps = [[[0, 0]], [[1, 1]], [[0, 1], [1, 0]]]
    found = candidates(scene(sequence={"steps": steps}), net_over(height, 2, 2), PITCH)
    assert found[-1].why == "as the scene has it"


def test_steps_that_lean_by_themselves_stay_with_their_order():
    """Also where the scene names no order, and the first way is the same."""
    leans = {"family": "rectangle_blend", "toe_up_steps": [[1, 4.0]]}
    read = scene(path=leans)
    found = candidates(read, net_over(paraboloid(1.0, 0.5)), PITCH)
    assert found[0].why == "as the scene has it"
    assert found[0].applied(read).path.toe_up_steps == ((1, 4.0),)
    assert all(not one.applied(read).path.toe_up_steps for one in found[1:])
    with pytest.raises(InputError, match="toe_up_steps"):
        scene(path=leans, sequence="auto")


def test_rings_have_starts_alone_to_choose():
    found = keys(paraboloid(1.0, 0.5), path={"family": "radial"})
    assert {pattern for _, pattern in found} == {"radial"}
    assert [start for start, _ in found] == [(3, 2), (3, 0), (0, 2), (0, 0)]


@settings(max_examples=15)
@given(
    rows=st.integers(2, 8),
    columns=st.integers(2, 8),
    a=st.floats(-1, 1),
    b=st.floats(-1, 1),
    top=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)),
)
def test_candidates_are_few_and_lay_every_cup_in_different_orders(
    rows, columns, a, b, top
):
    read = scene(sequence="auto")
    found = candidates(read, net_over(paraboloid(a, b, *top), rows, columns), PITCH)
    assert 2 <= len(found) <= MOST
    if min(rows, columns) > 3:
        assert len(found) >= 5
    orders = set()
    for one in found:
        order = make_sequence(one.applied(read).sequence, rows, columns, "test")
        assert order.placed_after(len(order.steps)).all()
        orders.add((order.start_cup, tuple(map(frozenset, order.steps))))
    assert len(orders) == len(found)


def test_steps_of_another_order_lean_as_all_do():
    own = SequenceSection(start=(3, 2), pattern="all_sides")
    path = {"family": "rectangle_blend", "toe_up_steps": [[2, 4.0]]}
    read = scene(path=path, sequence=own.model_dump(exclude_none=True))
    kept, other = (Candidate(one, "").applied(read) for one in (own, SequenceSection()))
    assert kept.path.toe_up_steps == ((2, 4.0),)
    assert other.path.toe_up_steps == ()
