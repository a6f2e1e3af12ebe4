"""Sequence: the start cup and the wave steps that lay the ply outward from it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from drapeplan.errors import InputError
from drapeplan.orders import SequenceSection

Cup = tuple[int, int]
Step = tuple[Cup, ...]
DIGITS = 9  # decimals of a distance in pitches: ties land together
SIDES = ("left", "right", "down", "up")  # -s, +s, -t, +t of the start cup


@dataclass(frozen=True)
class Rectangle:
    """Placed cups of a pattern: rows and columns, both ends included."""

    first_row: int
    last_row: int
    first_column: int
    last_column: int

    def cups(self) -> list[Cup]:
        """Cups inside, row by row."""
        return [
            (i, j)
            for i in range(self.first_row, self.last_row + 1)
            for j in range(self.first_column, self.last_column + 1)
        ]

    def advanced(self, sides: tuple[str, ...]) -> Rectangle:
        """The rectangle after one more row or column on each of the sides."""
        return Rectangle(
            self.first_row - ("down" in sides),
            self.last_row + ("up" in sides),
            self.first_column - ("left" in sides),
            self.last_column + ("right" in sides),
        )


@dataclass(frozen=True)
class Sequence:
    """Start cup and ordered wave steps.

    Attributes:
        rows: Rows of the tool.
        columns: Columns of the tool.
        start_cup: First cup placed, (row, column).
        pattern: Name of the pattern, or "steps" if given freely.
        steps: Cups that each wave step places, the start cup not among them.
        rectangles: Placed rectangle before the first step and after each step;
            empty where the steps grow no rectangle.
    """

    rows: int
    columns: int
    start_cup: Cup
    pattern: str
    steps: tuple[tuple[Cup, ...], ...]
    rectangles: tuple[Rectangle, ...]

    def index(self, cup: Cup) -> int:
        """Row-major index of a cup."""
        return cup[0] * self.columns + cup[1]

    def placed_after(self, step: int) -> np.ndarray:
        """Mask of the cups placed after `step` steps, shape (n_cups,).

        After 0 steps the start cup is placed; before that, at -1, none is.
        """
        mask = np.zeros(self.rows * self.columns, bool)
        if step < 0:
            return mask
        mask[self.index(self.start_cup)] = True
        for cups in self.steps[:step]:
            mask[[self.index(cup) for cup in cups]] = True
        return mask


def make_sequence(
    section: SequenceSection | Literal["auto"], rows: int, columns: int, source: str
) -> Sequence:
    """Sequence asked for by a scene.

    Args:
        section: The scene's `sequence`.
        rows: Rows of the tool.
        columns: Columns of the tool.
        source: Names the scene in error messages.

    Raises:
        InputError: If a cup is not on the tool, is placed twice or is left out, or if
            the sequence is still to be searched.
    """
    if section == "auto":
        problem = "auto is searched by plan and rank alone"
        raise InputError(source, "sequence", problem, "name a start and a pattern")
    if section.steps is not None:
        return _free_steps(section.steps, rows, columns, source)
    if section.start == "auto":
        start: Cup = ((rows - 1) // 2, (columns - 1) // 2)
    else:
        start = section.start
    _on_tool(start, rows, columns, source, "sequence.start")
    if section.pattern == "radial":
        rings = tuple(_rings(start, rows, columns, section.ring_pitches))
        return Sequence(rows, columns, start, "radial", rings, ())
    pattern = "alternate_sides" if section.pattern == "auto" else section.pattern
    rectangle = Rectangle(start[0], start[0], start[1], start[1])
    rectangles = [rectangle]
    for sides in _advances(pattern, start, rows, columns):
        rectangle = rectangle.advanced(sides)
        rectangles.append(rectangle)
    steps = tuple(
        tuple(cup for cup in new.cups() if cup not in set(old.cups()))
        for old, new in pairwise(rectangles)
    )
    return Sequence(rows, columns, start, pattern, steps, tuple(rectangles))


def _rings(start: Cup, rows: int, columns: int, width: float) -> Iterator[Step]:
    """Cups in the order of their distance; those within a width land together."""
    cups = [(i, j) for i in range(rows) for j in range(columns) if (i, j) != start]
    distance = {cup: round(math.dist(cup, start), DIGITS) for cup in cups}
    cups.sort(key=lambda cup: (distance[cup], cup))
    while cups:
        ring = [cup for cup in cups if distance[cup] <= distance[cups[0]] + width]
        yield tuple(sorted(ring))
        cups = cups[len(ring) :]


def _advances(
    pattern: str, start: Cup, rows: int, columns: int
) -> list[tuple[str, ...]]:
    """Sides that advance by one pitch in each step."""
    left = {
        "left": start[1],
        "right": columns - 1 - start[1],
        "down": start[0],
        "up": rows - 1 - start[0],
    }

    def rounds(sides: tuple[str, ...]) -> list[tuple[str, ...]]:
        longest = max(left[side] for side in sides)
        return [tuple(s for s in sides if left[s] > k) for k in range(longest)]

    along_s, along_t = rounds(("left", "right")), rounds(("down", "up"))
    if pattern == "all_sides":
        return rounds(SIDES)
    if pattern == "spine_s":
        return along_s + along_t
    if pattern == "spine_t":
        return along_t + along_s
    longest = max(len(along_s), len(along_t))
    pairs = [(along_s[k : k + 1], along_t[k : k + 1]) for k in range(longest)]
    return [sides for pair in pairs for part in pair for sides in part]


def _free_steps(
    steps: tuple[tuple[Cup, ...], ...], rows: int, columns: int, source: str
) -> Sequence:
    """Sequence from freely given steps, the first of which is the start cup."""
    seen: set[Cup] = set()
    for k, cups in enumerate(steps):
        for cup in cups:
            _on_tool(cup, rows, columns, source, f"sequence.steps.{k}")
            if cup in seen:
                problem = f"cup {list(cup)} is placed twice"
                raise InputError(source, f"sequence.steps.{k}", problem, "remove one")
            seen.add(cup)
    if not steps or len(steps[0]) != 1:
        problem = "the first step must hold the start cup alone"
        raise InputError(source, "sequence.steps.0", problem, "give it one cup")
    missing = [(i, j) for i in range(rows) for j in range(columns)]
    missing = [cup for cup in missing if cup not in seen]
    if missing:
        problem = f"cup {list(missing[0])} is never placed"
        if len(missing) > 1:
            problem += f" (nor are {len(missing) - 1} others)"
        raise InputError(source, "sequence.steps", problem, "add it to a step")
    rest = tuple(cups for cups in steps[1:] if cups)
    return Sequence(rows, columns, steps[0][0], "steps", rest, ())


def _on_tool(cup: Cup, rows: int, columns: int, source: str, key: str) -> None:
    if cup[0] >= rows or cup[1] >= columns:
        problem = (
            f"cup {list(cup)} is outside the tool's {rows} rows x {columns} columns"
        )
        remedy = f"use rows 0-{rows - 1} and columns 0-{columns - 1}"
        raise InputError(source, key, problem, remedy)
