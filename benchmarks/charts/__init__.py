"""Charts of speed against accuracy: measured, written as tables, drawn.

Each chart is a module here with two functions: `measure(quick) -> Results`, and
`draw(results) -> Figure`, which needs nothing but the table. So a chart can be drawn
anew from what was measured elsewhere.
"""

import argparse
import importlib
import sys
import time
import traceback
from dataclasses import replace
from pathlib import Path

from benchmarks.charts import drawing
from benchmarks.charts._compare import compare
from benchmarks.charts.results import read

# modules here, in the order of docs/charts.md
CHARTS = ("ply", "tool", "qp", "verdict", "scale", "maps", "needs", "engine")
ROOT = Path(__file__).parents[2]
RELEASED = ROOT / "benchmarks" / "results"  # what the documentation shows
TRIED = ROOT / "build" / "charts"  # where quick figures go: they replace nothing


def main(arguments: list[str] | None = None) -> int:
    """Measure and draw charts; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks charts")
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(CHARTS))
    effort = parser.add_mutually_exclusive_group()
    effort.add_argument("--quick", action="store_true", help="few cases and repeats")
    effort.add_argument("--full", action="store_true", help="all of them: the default")
    effort.add_argument("--redraw", action="store_true", help="from the last figures")
    both = {"nargs": 2, "type": Path, "metavar": ("OLD", "NEW")}
    text = "two folders of results: 1 if a ratio of times moved by more than 30 %%"
    effort.add_argument("--compare", **both, help=text)
    parser.add_argument("-o", "--output", type=Path, metavar="FOLDER")
    options = parser.parse_args(arguments)
    if unknown := set(options.names) - set(CHARTS):
        parser.error(f"no chart is called {', '.join(unknown)}: {', '.join(CHARTS)}")
    if options.compare:
        return compare(*options.compare, options.names or CHARTS)
    folder = options.output or (TRIED if options.quick else RELEASED)
    names, failed = options.names or CHARTS, []
    for name in names:
        print(f"chart {name}{_lasted(folder / f'chart-{name}')}", file=sys.stderr)
        try:
            files = make(name, folder, options.quick, options.redraw)
        except Exception:
            if len(names) == 1:
                raise
            traceback.print_exc()  # the others are worth drawing
            failed.append(name)
        else:
            print(*files, sep="\n")
    for name in failed:
        print(f"failed: chart {name}", file=sys.stderr)
    return 1 if failed else 0


def make(name: str, folder: Path, quick: bool, redraw: bool = False) -> list[Path]:
    """Measure a chart, or read what was measured, write its table and draw it."""
    chart = importlib.import_module(f"benchmarks.charts.{name}")
    stem = folder / f"chart-{name}"
    files = []
    if not redraw:
        start = time.perf_counter()
        found = chart.measure(quick)
        took = round(time.perf_counter() - start)
        files = replace(found, made=found.made | {"took_s": took}).write(stem)
    return files + drawing.save(chart.draw, read(stem), stem)


def _lasted(stem: Path) -> str:
    """How long a chart took the last time, where that is known."""
    known = stem.with_suffix(".json").exists() and read(stem).made.get("took_s")
    return f", {known} s the last time" if known else ""
