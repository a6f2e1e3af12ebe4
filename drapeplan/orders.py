"""Orders: the scene's sequence, as it is given or left to a search."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from drapeplan.section import CupIndex, Section

Pattern = Literal[
    "auto", "all_sides", "alternate_sides", "spine_s", "spine_t", "radial"
]
SEARCHED = "auto: the best of the candidates that drapeplan rank shows"
RING = "radial: cups whose distances differ by no more land together"


class SequenceSection(Section):
    """Start cup and wave steps."""

    start: CupIndex | Literal["auto"] = "auto"
    pattern: Pattern = "auto"
    ring_pitches: Annotated[float, Field(ge=0, le=100, description=RING)] = 0.5
    steps: tuple[tuple[CupIndex, ...], ...] | None = None


SequenceChoice = Annotated[
    Annotated[SequenceSection, Tag("keys")] | Annotated[Literal["auto"], Tag("word")],
    Discriminator(lambda given: "word" if isinstance(given, str) else "keys"),
    Field(description=SEARCHED),
]
