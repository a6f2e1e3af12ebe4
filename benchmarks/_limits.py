"""Table of docs/limits.md, from what `benchmarks robustness` keeps."""

import json
import sys
from pathlib import Path

from benchmarks.robustness import ACCEPTED, NOISE, RESULTS, SCENES, TOOLS

SHORT = dict(zip(TOOLS, ("rigid", "resilient"), strict=True))


def table(result: dict) -> list[str]:
    """Lines of the table in Markdown.

    Args:
        result: What the benchmark measured.
    """
    first, second, third = NOISE
    lines = [
        f"| scene | tool | {first} | {second} | {third} | pressed mm | met |",
        "|---|---|---|---|---|---|---|",
    ]
    for name in SCENES:
        row = result.get(name)
        if row is None:
            continue
        better = row["better"]
        if better is None:
            lines.append(f"| {name} | - | refused | refused | refused | - | no |")
            continue
        found = row[better]
        shares = " | ".join(_share(found[noise]) for noise in NOISE)
        press = "{:.2f} / {:.2f}".format(*found[first]["press_mm"])
        met = "yes" if found[first]["high"] <= ACCEPTED else "no"
        tools = f"{SHORT[better]} ({_other(row, better)})"
        lines.append(f"| {name} | {tools} | {shares} | {press} | {met} |")
    return lines


def _share(figures: dict) -> str:
    return f"{figures['P']:.3f} ({figures['low']:.3f}-{figures['high']:.3f})"


def _other(row: dict, better: str) -> str:
    """P with the other tool."""
    other = next(tool for tool in TOOLS if tool != better)
    found = row.get(other, {})
    if "refused" in found:
        return f"{SHORT[other]}: refused"
    return f"{SHORT[other]}: {found[next(iter(NOISE))]['P']:.3f}"


if __name__ == "__main__":
    source = Path(sys.argv[1]) if len(sys.argv) > 1 else RESULTS
    found = json.loads(source.read_text(encoding="utf-8"))
    print(*table(found), sep="\n")
