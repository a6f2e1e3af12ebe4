"""What a laminator reads."""

import numpy as np

from drapeplan.front import check_front
from drapeplan.sentences import sentences
from tests.front_samples import MM, box, growing_disk, make_grid, no_cups

HIGH = 30 * MM  # [m] a ply far above the mold


def said(h, grid, final_gap=0.0, **cups):
    """All sentences on poses of free plies, joined by lines."""
    final_gap = final_gap + 0 * h[0]
    nothing = {name: no_cups(grid, len(h)) for name in ("placed", "landing")}
    verdict = check_front(h + final_gap, final_gap, grid, **{**nothing, **cups})
    return "\n".join(sentences(verdict, [f"Step {k}" for k in range(len(h))]))


def test_good_path():
    grid = make_grid()
    gap, placed, landing = growing_disk(grid)
    text = said(gap, grid, 0.2 * MM, placed=placed, landing=landing)
    assert text.startswith("In order: the ply touches the mold outward from cup (1, 1)")
    assert "Nothing comes near an air pocket." in text
    assert "bridges up to 0.20 mm" in text
    assert "sinks" not in text
    assert "starts in contact" not in text


def test_laid_state_inside_the_mold():
    grid = make_grid()
    h = np.full((1, *grid.areas.shape), HIGH)
    assert "and sinks up to 0.10 mm" in said(h, grid, -0.1 * MM)
    assert "sinks" not in said(h, grid, -0.001 * MM)


def test_air_pocket_names_where_when_how_much_and_what_to_change():
    grid = make_grid(start_cup=0)
    h = np.zeros((3, *grid.areas.shape))
    h[0] = HIGH
    h[1] = np.where(grid.start_pad, 0.0, HIGH)
    h[2, box(grid, (0.05, 0.09), (0.04, 0.06))] = 3.3 * MM
    text = said(h, grid)
    assert "Out of order" in text
    assert (
        "Step 2: an air pocket of 15.0 cm2 (5.0 cm3, 3.3 mm deep) closes near "
        "cup (0, 1) (s 70, t 50 mm): place the cups around it" in text
    )


def test_premature_contact_and_path_that_starts_in_contact():
    grid = make_grid(start_cup=0)
    h = np.where(grid.start_pad, 0.0, HIGH)[None]
    h[0, box(grid, (0.33, 0.33), (0.22, 0.22))] = 0.0
    text = said(h, grid)
    assert "Step 0: the ply touches 1.0 cm2 near cup (2, 3)" in text
    assert "apart from the contact around the start" in text
    assert "Nearest to a premature" not in text
    assert "starts in contact" in text


def test_penetration_of_spans_and_pads():
    grid = make_grid()
    h = np.where(grid.cup_index >= 0, -2.0 * MM, -0.35 * MM)[None]
    landing = ~no_cups(grid, 1)
    text = said(h, grid, landing=landing)
    assert "In order from cup (1, 1), but the ply is pushed into the mold." in text
    assert "between the cups is pushed 0.35 mm into the mold" in text
    assert "a landing cup is pressed 2.0 mm into the mold" in text


def test_margins_that_are_left():
    grid = make_grid()
    h = np.where(grid.start_pad, 0.0, HIGH)[None]
    h[0, box(grid, (0.3, 0.3), (0.2, 0.2))] = 1.3 * MM
    text = said(h, grid)
    assert (
        "Nearest to a premature contact: 0.80 mm left, Step 0, near cup (2, 3)" in text
    )


def test_placed_cups_off_their_laid_state_raise_a_doubt():
    grid = make_grid()
    h = np.full((2, *grid.areas.shape), HIGH)
    placed = no_cups(grid, 2)
    placed[1, grid.start_cup] = True
    text = said(h, grid, placed=placed)
    assert "Step 1: placed cups leave the ply 30.0 mm from its laid state" in text
    assert said(h, grid).count("laid state") == 0
