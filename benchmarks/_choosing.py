"""The page docs/choosing.md, from what `benchmarks ranking` has kept."""

from collections.abc import Iterator

from benchmarks import ranking
from benchmarks._kept import kept
from drapeplan.plan_file import CandidateRow, CandidatesBlock
from drapeplan.ranking_words import COLUMNS, UNITS, cells
from drapeplan.report_ranking import pareto

HEAD = """# Choosing the start and the pattern

`drapeplan rank SCENE` plans up to ten candidates and ranks them; `sequence: auto` in a
scene lets `plan` do the same and take the best. A candidate is a start cup (the middle,
the top or bottom of the mold, an edge, a corner) and a pattern: all sides at once,
sides in turn, or first along s or t (*spines*). On a mold that is its own mirror image
one of two mirror images is enough.

All are planned kinematically first. The best four are planned as the scene asks, at the
tool's equilibrium, and judged on 64 samples of its uncertainty; then the next four,
until one is good. Good ones come before others; then P(wrong order) decides, in steps
of 0.05, the margins, how deep the ply is pressed, strokes, shear, take-up, steps, time.

Rings (`path.family: radial`) are candidates only where the scene names that family:
all sides at once take two thirds of the time at the same or less risk, wherever they
are good:

| from the middle, 64 samples each | rings: time s, wrong | all sides: time s, wrong |
|---|---|---|
| panel | 29, 4 | 21, 0 |
| plane | 29, 4 | 21, 5 |
| paraboloid 1 and 2 m | 29, 5 | 21, 0 |
| saddle 1.8 and -1.5 m | 30, 25 | 22, 11 |
| sphere of 1 m | 30, 5 | not good: fibers and penetration |

On the sphere alone rings are the fastest that are good: sides in turn take 34 s, with
none wrong. Rings a pitch wide are as fast as all sides, with 38 wrong on the panel.

The rings were planned and sampled one by one on 2026-11-22, with samples at waypoints
alone. All that follows is printed by `python -m benchmarks._choosing` from
`benchmarks/results/ranking.json`; that is written by `python -m benchmarks ranking`, or
`... ranking panel ridge` for some.
"""
TABLES = """## The tables

Those alone that were looked at closely. *Margin*: 5 % of the samples have less;
*pressed*: the deepest place of the plan; *strokes*: from the shortest to the longest;
*take-up*: what is left of it. In bold: no other good one is both faster and safer.
"""
OVERVIEW = "scene", "taken", "P wrong (95 %)", "time s", "good", "ranked in s"


def page() -> str:
    """The whole page."""
    found = kept(ranking.RESULTS)
    return "\n".join([HEAD, *_overview(found), "", TABLES, *_tables(found)])


def _overview(found: dict[str, dict]) -> Iterator[str]:
    """What is taken on each scene."""
    yield from _head(OVERVIEW)
    for name, facts in found.items():
        took = f"{facts['wall_s']:.0f} (load {facts['load']:g})"
        if "refused" in facts:
            yield _line(name, f"none: {facts['refused']}", "", "", "", took)
            continue
        rows = CandidatesBlock(**facts["block"]).rows
        best, good = rows[0], sum(row.good for row in rows)
        taken = f"{list(best.start)} {best.pattern}"
        if not best.good:
            taken = f"none good; nearest {taken}: {_why_not(best)}"
        risk, seconds = cells(best)[3], cells(best)[-1]
        yield _line(name, taken, risk, seconds, f"{good} of {len(rows)}", took)


def _tables(found: dict[str, dict]) -> Iterator[str]:
    """The rows that were looked at closely, scene by scene."""
    names = zip(COLUMNS, UNITS, strict=True)
    columns = "", *(" ".join(filter(None, name)) for name in names)
    for name, facts in found.items():
        if "refused" in facts:
            continue
        rows = CandidatesBlock(**facts["block"]).rows
        front = pareto([row for row in rows if row.samples])
        yield from (f"### {name}", "", *_head(columns))
        for k, row in enumerate(rows):
            if row.samples:
                number = f"**{k + 1}**" if row in front else str(k + 1)
                start, pattern, good, *others = cells(row)
                good = good if row.good else f"no: {_why_not(row)}"
                yield _line(number, start, pattern, good, *others)
        yield ""


def _head(columns: tuple[str, ...]) -> tuple[str, str]:
    return _line(*columns), "|---" * len(columns) + "|"


def _line(*values: str) -> str:
    return f"| {' | '.join(values)} |"


def _why_not(row: CandidateRow) -> str:
    return row.refused or ", ".join(row.not_good)


if __name__ == "__main__":
    print(page(), end="")
