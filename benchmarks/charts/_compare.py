"""Whether two runs of the charts tell the same, on machines of whatever speed.

Each time is divided by the geometric mean of its group, the rows of one set: what is
left are ratios, in which the speed of the machine cancels. Rates count as times.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.charts.results import Results, read

LARGEST = 0.3  # [-] share by which a ratio may move from run to run
TIMES, RATES = ("_ms", "_s"), "_per_s"  # how the names of columns end
SETTINGS = ("tolerance", "count")  # numbers that say which row it is; texts all do


@dataclass(frozen=True)
class Move:
    """How much a ratio of times moved.

    Attributes:
        group: Set of its row.
        name: What tells its row from others, and the column.
        factor: New ratio over the old one.
    """

    group: str
    name: str
    factor: float

    @property
    def size(self) -> float:
        """By how much, whichever run is taken as the first."""
        return max(self.factor, 1 / self.factor) - 1


def moves(old: Results, new: Results) -> list[Move]:
    """Ratios of times of two runs that both have, the largest move first.

    Args:
        old: A chart.
        new: The same chart of another run.
    """
    before, after = dict(_times(old)), dict(_times(new))
    groups: dict[str, list[tuple[str, float]]] = {}
    for place, seconds in before.items():
        if place in after:
            group, name = place
            log = math.log(after[place] / seconds)
            groups.setdefault(group, []).append((name, log))
    found = []
    for group, named in groups.items():
        mean = sum(log for _, log in named) / len(named)
        found += [Move(group, name, math.exp(log - mean)) for name, log in named]
    return sorted(found, key=lambda move: -move.size)


def compare(old: Path, new: Path, charts: tuple[str, ...]) -> int:
    """Print the moves of all charts that two folders have; 1 if any is too large.

    Args:
        old: Folder of results.
        new: Folder of results of another run.
        charts: Names of the charts.
    """
    moved = False
    for name in charts:
        stems = [folder / f"chart-{name}" for folder in (old, new)]
        lacking = [str(s.parent) for s in stems if not s.with_suffix(".json").exists()]
        if lacking:
            print(f"{name}: not in {' and '.join(lacking)}")
            continue
        first, second = map(read, stems)
        found = moves(first, second)
        if not found:
            print(f"{name}: no times")
            continue
        alone = len({*dict(_times(first))} ^ {*dict(_times(second))})
        print(f"{name}: {len(found)} ratios, largest move {_told(found[0])}")
        if alone:
            print(f"  {alone} times stand in one of the two alone")
        for move in found:
            if move.size > LARGEST:
                print(f"  beyond {LARGEST:.0%}: {_told(move)}")
                moved = True
    return int(moved)


def _told(move: Move) -> str:
    return f"{move.factor - 1:+.0%} ({move.group}: {move.name})"


def _times(results: Results) -> Iterator[tuple[tuple[str, str], float]]:
    """Group and name of each time, and the time; a rate is one over a time."""
    for row in results.rows:
        group = str(row.get("set") or row.get("map") or "")
        texts = [
            str(value)
            for key, value in row.items()
            if key != "set" and value and (isinstance(value, str) or key in SETTINGS)
        ]
        for key, value in row.items():
            rate = f"_{key}".endswith(RATES)
            if f"_{key}".endswith(TIMES) and isinstance(value, float) and value > 0:
                name = ", ".join([*texts, key])
                yield (group, name), 1 / value if rate else value
