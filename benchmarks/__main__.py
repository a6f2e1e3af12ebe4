"""Runs benchmarks by name; each module here has `run(quick) -> dict`.

`charts` is a package with a command line of its own: `python -m benchmarks charts -h`.
"""

import argparse
import importlib
import json
import os
import pkgutil
import sys
from pathlib import Path

ALL = "all"
CHARTS = "charts"


def names() -> list[str]:
    """Names of the benchmarks, in alphabetical order."""
    modules = pkgutil.iter_modules([str(Path(__file__).parent)])
    return sorted(m.name for m in modules if not (m.ispkg or m.name.startswith("_")))


def main(arguments: list[str] | None = None) -> int:
    """Run one benchmark, all of them, or the charts; returns the exit code."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments[:1] == [CHARTS]:
        return importlib.import_module("benchmarks.charts").main(arguments[1:])
    parser = argparse.ArgumentParser(prog="python -m benchmarks")
    parser.add_argument("name", choices=[*names(), ALL, CHARTS])
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    options = parser.parse_args(arguments)
    chosen = names() if options.name == ALL else [options.name]
    results = {}
    for name in chosen:
        print(f"running {name}", file=sys.stderr)
        results[name] = importlib.import_module(f"benchmarks.{name}").run(options.quick)
    if options.json:
        print(json.dumps(results, indent=2))
    else:
        for name, result in results.items():
            print(name, *table(result), sep="\n")
    return 0


def table(result: dict, indent: str = "  ") -> list[str]:
    """Lines of a result, one figure each; what is nested comes after, further in."""
    figures = {k: v for k, v in result.items() if not isinstance(v, (dict, list))}
    width = max(map(len, figures), default=0)
    lines = [f"{indent}{k:<{width}}  {_figure(v)}" for k, v in figures.items()]
    for key, value in result.items():
        if isinstance(value, dict):
            lines += [f"{indent}{key}", *table(value, indent + "  ")]
        elif isinstance(value, list):
            lines += [f"{indent}{line}" for line in value]
    return lines


def _figure(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    # One BLAS thread, as in a plan; must be set before numpy is imported.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(main())
