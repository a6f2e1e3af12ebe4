"""Where methods find what they look for, and where they fail, beside theory."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from benchmarks.charts import _maps
from benchmarks.charts._maps import OUTCOMES
from benchmarks.charts.drawing import WIDTH
from benchmarks.charts.results import Results, made_with

MAPS = {  # title, what x and y are
    "fiber": ("fiber, both cups tilted", "tilt [deg]", "chord shorter by [mm]"),
    "patch": (
        "coupled patch on a sphere",
        "chord shorter by [mm]",
        "radius [m]",
    ),
    "net": (
        "net of 6 x 8 cups on a sphere",
        "middle off the top by [mm]",
        "radius [m]",
    ),
    "motion": ("strokes, 3 x 4 cups on a sphere", "take-up [mm]", "radius [m]"),
    "equilibrium": (
        "6 x 8 cups at rest on a dome, in parts",
        "largest jump of a stroke [mm]",
        "radius [m]",
    ),
    "verdict": (
        "order kept, 3 x 4 cups on a saddle",
        "take-up [mm]",
        "errors [mm], with 0.5 deg for 0.3 mm",
    ),
}
COLORS = {  # Okabe and Ito; failures are dark, as in print without color
    "all": "#56B4E9",
    "side": "#CC79A7",
    "modal": "#009E73",
    "exact": "#E69F00",
    "none": "#d9d9d9",
    "solved": "#0072B2",
    "several": "#F0E442",
    "stretched": "#8c8c8c",
    "failed": "#000000",
}
Grid = tuple[list[float], list[float]]
LINES = ("-", "--", ":")


def measure(quick: bool) -> Results:
    """Every map."""
    rows = [row for name in MAPS for row in getattr(_maps, name)(quick)]
    return Results("maps", rows, made_with("osqp", "pin", quick=quick))


def draw(results: Results) -> Figure:
    """A panel a map: outcomes as colors, boundaries of theory as lines."""
    figure = Figure(figsize=(WIDTH, 8.6), layout="constrained")
    used: set[str] = set()
    for axes, (name, (title, x, y)) in zip(
        figure.subplots(3, 2).flat, MAPS.items(), strict=True
    ):
        axes.set(title=title, xlabel=x, ylabel=y)
        axes.grid(visible=False)
        cells = [row for row in results.where(map=name) if "boundary" not in row]
        shares = any(row.get("share") is not None for row in cells)
        if shares:
            _shares(axes, cells)
        else:
            used |= _outcomes(axes, cells)
        _boundaries(axes, results.where(map=name), shares and _grid(cells))
    patches = [Patch(color=COLORS[k], label=OUTCOMES[k]) for k in OUTCOMES if k in used]
    place = {"loc": "outside upper center", "ncols": 3, "frameon": False, "fontsize": 7}
    figure.legend(handles=patches, **place)
    return figure


def _grid(cells: list[dict]) -> Grid:
    return sorted({c["x"] for c in cells}), sorted({c["y"] for c in cells})


def _outcomes(axes: Axes, cells: list[dict]) -> set[str]:
    """Cells in the color of their outcome."""
    x, y = _grid(cells)
    keys = list(OUTCOMES)
    z = np.zeros((len(y), len(x)))
    for cell in cells:
        z[y.index(cell["y"]), x.index(cell["x"])] = keys.index(cell["outcome"])
    colors = ListedColormap([COLORS[key] for key in keys])
    axes.pcolormesh(
        *(_edges(a) for a in (x, y)),
        z,
        **{"cmap": colors, "vmin": -0.5, "vmax": len(keys) - 0.5, "rasterized": True},
    )
    return {cell["outcome"] for cell in cells}


def _shares(axes: Axes, cells: list[dict]) -> None:
    """Cells with the share of tries that were solved."""
    x, y = _grid(cells)
    z = np.zeros((len(y), len(x)))
    for cell in cells:
        z[y.index(cell["y"]), x.index(cell["x"])] = cell.get("share") or 0.0
    axes.imshow(z, vmin=0, vmax=1, cmap="cividis", aspect="auto", origin="lower")
    axes.set_xticks(range(len(x)), [f"{each:g}" for each in x])
    axes.set_yticks(range(len(y)), [f"{each:g}" for each in y])
    for cell in cells:
        share, at = cell.get("share"), (x.index(cell["x"]), y.index(cell["y"]))
        text = "failed" if share is None else f"{100 * share:.0f} %"
        color = "black" if (share or 0) > 0.5 else "white"
        axes.annotate(text, at, ha="center", va="center", fontsize=7, color=color)


def _edges(values: list[float]) -> np.ndarray:
    """Edges of cells around values."""
    a = np.array(values)
    if len(a) == 1:
        return np.array([0.5, 1.5]) * a
    middle = (a[1:] + a[:-1]) / 2
    first, last = (a[0] * 2 - middle[0], a[-1] * 2 - middle[-1])
    return np.concatenate([[first], middle, [last]])


def _boundaries(axes: Axes, rows: list[dict], places: Grid | bool) -> None:
    """Lines of theory; where cells stand at places, between these."""
    lines = dict.fromkeys(row["boundary"] for row in rows if "boundary" in row)
    limits = axes.get_xlim(), axes.get_ylim()
    for name, style in zip(lines, LINES, strict=False):
        x, y = np.array([(r["x"], r["y"]) for r in rows if r.get("boundary") == name]).T
        if places:
            ticks = [np.arange(len(each)) for each in places]
            each = zip((x, y), places, ticks, strict=True)
            x, y = (np.interp(values, at, tick) for values, at, tick in each)
            y = y - 0.5  # the lower edge of the cells
            axes.annotate(name, (1.5, y[0]), ha="center", va="bottom", fontsize=6.5)
        for color, width in (("white", 3.5), ("#D55E00", 1.8)):
            axes.plot(x, y, color=color, linewidth=width, linestyle=style, label=name)
    axes.set(xlim=limits[0], ylim=limits[1])
    if lines and not places:
        handles, labels = axes.get_legend_handles_labels()
        kept = dict(zip(labels, handles, strict=True))
        axes.legend(kept.values(), kept.keys(), fontsize=6.5, loc="upper right")
