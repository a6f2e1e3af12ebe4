"""Runs benchmarks by name; each module here has `run(quick) -> dict`.

`all` are the short ones, `studies` those that take hours together and keep what they
find in results/. A study whose `run` has `names` can be asked for some of its scenes.
`charts` is a package with a command line of its own: `python -m benchmarks charts -h`.
"""

import argparse
import importlib
import inspect
import json
import os
import sys
import time
import traceback
from pathlib import Path

from drapeplan.files import write_text

SHORT = (  # those whose figures the README has, and what they stand on
    *("coupled", "front", "jacobian", "lead", "mold", "plan", "ply", "preview", "qp"),
    "tool",
)
STUDIES = ("identify", "paths", "ranking", "robustness", "tune")
GROUPS = {"all": SHORT, "studies": STUDIES}
CHARTS = "charts"
TOOK = Path(__file__).parent / "results" / "took.json"  # [s] of each, the last time


def main(arguments: list[str] | None = None) -> int:
    """Run a benchmark, a group of them, or the charts; returns the exit code."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments[:1] == [CHARTS]:
        return importlib.import_module("benchmarks.charts").main(arguments[1:])
    took = json.loads(TOOK.read_text(encoding="utf-8"))
    known = ", ".join(f"{name} {seconds} s" for name, seconds in took.items())
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", epilog=f"The last time they took: {known}."
    )
    names = (*SHORT, *STUDIES, *GROUPS, CHARTS)
    parser.add_argument("name", choices=names, metavar="NAME", help=", ".join(names))
    parser.add_argument("scenes", nargs="*", help="some scenes of a study alone")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    options = parser.parse_args(arguments)
    results, failed = {}, []
    for name in GROUPS.get(options.name, (options.name,)):
        run = importlib.import_module(f"benchmarks.{name}").run
        some = _some(parser, name, run, options.scenes) if options.scenes else {}
        lasted = f", {took[name]} s the last time" if name in took else ""
        print(f"running {name}{lasted}", file=sys.stderr)
        start = time.perf_counter()
        try:
            results[name] = run(options.quick, **some)
        except Exception:
            if options.name == name:
                raise
            traceback.print_exc()  # the others are worth running
            failed.append(name)
        else:
            took[name] = round(time.perf_counter() - start)
            if not (options.quick or some):
                write_text(TOOK, json.dumps(took, indent=1, sort_keys=True) + "\n")
    if options.json:
        print(json.dumps(results, indent=2))
    else:
        for name, result in results.items():
            print(name, *table(result), sep="\n")
    for name in failed:
        print(f"failed: {name}", file=sys.stderr)
    return 1 if failed else 0


def _some(parser: argparse.ArgumentParser, name: str, run: object, asked: list) -> dict:
    """Arguments that ask a study for some of its scenes."""
    known = inspect.signature(run).parameters.get("names")
    if known is None:
        parser.error(f"{name} has no scenes to choose from")
    if unknown := [one for one in asked if one not in known.default]:
        parser.error(f"no scene is called {unknown[0]}: {', '.join(known.default)}")
    return {"names": tuple(asked)}


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
