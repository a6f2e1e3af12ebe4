import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drapeplan.errors import InputError
from drapeplan.scene import SequenceSection
from drapeplan.sequence import make_sequence

PATTERNS = ("auto", "all_sides", "alternate_sides", "spine_s", "spine_t")


@given(
    rows=st.integers(2, 9),
    columns=st.integers(2, 9),
    pattern=st.sampled_from(PATTERNS),
    data=st.data(),
)
def test_every_cup_is_placed_once_beside_placed_ones(rows, columns, pattern, data):
    start = (
        data.draw(st.integers(0, rows - 1)),
        data.draw(st.integers(0, columns - 1)),
    )
    section = SequenceSection(start=start, pattern=pattern)
    sequence = make_sequence(section, rows, columns, "test")
    placed = {start}
    for cups in sequence.steps:
        assert cups
        for i, j in cups:
            assert (i, j) not in placed
        # each new cup has a placed neighbor, over an edge or a corner
        near = {
            (i + a, j + b) for i, j in placed for a in (-1, 0, 1) for b in (-1, 0, 1)
        }
        assert set(cups) <= near
        placed |= set(cups)
    assert len(placed) == rows * columns
    assert sequence.placed_after(len(sequence.steps)).all()


@given(pattern=st.sampled_from(PATTERNS), step=st.integers(-1, 7))
def test_placed_cups_fill_the_rectangle(pattern, step):
    sequence = make_sequence(SequenceSection(pattern=pattern), 8, 6, "test")
    step = min(step, len(sequence.steps))
    mask = sequence.placed_after(step)
    if step < 0:
        assert not mask.any()
        return
    cups = [sequence.index(cup) for cup in sequence.rectangles[step].cups()]
    assert sorted(cups) == mask.nonzero()[0].tolist()


def test_alternate_sides_of_the_default_tool():
    sequence = make_sequence(SequenceSection(), 8, 6, "test")
    assert sequence.start_cup == (3, 2)
    assert sequence.pattern == "alternate_sides"
    assert [len(cups) for cups in sequence.steps] == [2, 6, 6, 10, 5, 12, 6]


def test_spines_grow_one_direction_first():
    s = make_sequence(SequenceSection(pattern="spine_s"), 8, 6, "test")
    assert {i for cups in s.steps[:3] for i, _ in cups} == {3}
    t = make_sequence(SequenceSection(pattern="spine_t"), 8, 6, "test")
    assert {j for cups in t.steps[:4] for _, j in cups} == {2}


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ({"start": (8, 0)}, ["sequence.start", "outside", "rows 0-7"]),
        ({"start": (0, 6)}, ["sequence.start", "outside", "columns 0-5"]),
        ({"steps": (((0, 0),), ((0, 0),))}, ["sequence.steps.1", "twice"]),
        ({"steps": (((0, 0),),)}, ["sequence.steps", "never placed", "46 others"]),
        ({"steps": (((0, 0), (0, 1)),)}, ["sequence.steps.0", "alone"]),
        ({"steps": (((9, 9),),)}, ["sequence.steps.0", "outside"]),
        ({"steps": ()}, ["sequence.steps.0", "alone"]),
    ],
)
def test_impossible_sequences_name_key_and_remedy(section, words):
    with pytest.raises(InputError) as caught:
        make_sequence(SequenceSection(**section), 8, 6, "scene.yaml")
    assert all(word in str(caught.value) for word in words), caught.value


@given(
    rows=st.integers(2, 9),
    columns=st.integers(2, 9),
    width=st.floats(0, 3),
    data=st.data(),
)
def test_rings_come_in_the_order_of_distance(rows, columns, width, data):
    start = (
        data.draw(st.integers(0, rows - 1)),
        data.draw(st.integers(0, columns - 1)),
    )
    section = SequenceSection(start=start, pattern="radial", ring_pitches=width)
    steps = make_sequence(section, rows, columns, "test").steps
    cups = [start, *(cup for ring in steps for cup in ring)]
    assert sorted(cups) == [(i, j) for i in range(rows) for j in range(columns)]
    reach = [[math.dist(cup, start) for cup in ring] for ring in steps]
    for inner, outer in pairwise(reach):
        assert min(inner) + width < min(outer) + 1e-9
        assert max(inner) < min(outer)
    assert all(max(ring) - min(ring) <= width + 1e-9 for ring in reach)


def test_ties_land_together():
    steps = make_sequence(
        SequenceSection(pattern="radial", ring_pitches=0), 8, 6, "test"
    ).steps
    assert steps[0] == ((2, 2), (3, 1), (3, 3), (4, 2))
    assert steps[-1] == ((7, 5),)


def test_free_steps_keep_their_order():
    steps = (((0, 0),), ((0, 1), (1, 0)), (), ((1, 1),))
    sequence = make_sequence(SequenceSection(steps=steps), 2, 2, "test")
    assert sequence.steps == (((0, 1), (1, 0)), ((1, 1),))
    assert sequence.rectangles == ()
