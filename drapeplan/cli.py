"""Command line; every heavy import waits until its command runs."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drapeplan.errors import DrapeplanError, InputError

if TYPE_CHECKING:
    from drapeplan.planner import Progress

# One BLAS thread: sums in one order, so the same bytes every time.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Plans the robotic draping of a prepreg ply, end to end. "
    "Exit codes: 0 done and good; 1 done, and the answer is no; 2 bad input.",
)

Json = Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")]
PlanFile = Annotated[Path, typer.Argument(metavar="PLAN", help="Plan file (JSON).")]
Figure = Annotated[
    Path | None, typer.Option("--figure", help="Write the first-touch picture (PNG).")
]


def main() -> None:
    """Run the command line and turn errors into one line and an exit code."""
    as_json = "--json" in sys.argv
    try:
        code = app(standalone_mode=False)
    except DrapeplanError as error:
        _say_error(str(error), as_json, error.exit_code, getattr(error, "report", None))
        lines = getattr(error, "sentences", ())
        if lines:
            print("On the requested poses, whatever the tool says:", file=sys.stderr)
        for line in lines:
            print(f"  {line}", file=sys.stderr)
        code = error.exit_code
    except typer.Exit as stop:
        code = stop.exit_code
    except (KeyboardInterrupt, typer.Abort):
        code = 130
    except Exception as error:
        show = getattr(error, "show", None)  # a usage error of the command line
        if show is None:
            raise
        show()
        code = 2
    sys.exit(code if isinstance(code, int) else 0)


def _say_error(text: str, as_json: bool, code: int, report: Any) -> None:
    if as_json:
        document = {"good": False, "error": text, "exit_code": code}
        print(json.dumps({**document, **({"report": report} if report else {})}))
    name = "not drapable" if code == 1 else "error"
    print(f"{name}: {text}", file=sys.stderr)


@contextmanager
def _progress(quiet: bool) -> Iterator[Progress | None]:
    """Progress on stderr, only where somebody watches."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress as Bar

    with Bar(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda stage, share: bar.update(task, description=stage, completed=share)


@app.command()
def plan(
    scene: Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (YAML).")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Plan file to write.")],
    figure: Figure = None,
    seed: Annotated[
        int | None, typer.Option(help="Overrides the scene's seed.")
    ] = None,
    as_json: Json = False,
) -> int:
    """Plan the drape of one ply and say whether it meets the mold outward."""
    from drapeplan.planner import make_plan
    from drapeplan.scene import read_scene
    from drapeplan.words import summary

    read = read_scene(scene)
    if seed is not None:
        if seed < 0:
            raise InputError("--seed", "", f"must be at least 0 (found {seed})")
        read = read.model_copy(update={"seed": seed})
    with _progress(as_json) as progress:
        outcome = make_plan(read, scene.parent, str(scene), progress)
    result = outcome.plan
    written = [output]
    result.write(output)
    verdict = result.verdict
    lines = summary(verdict, outcome.contact.front, result.track)
    if figure:
        _draw_first_touch(figure, result, outcome.contact, scene.stem)
        written.append(figure)
    _show(verdict, lines, as_json, written=written)
    return 0 if verdict["good"] else 1


@app.command()
def check(plan_file: PlanFile, figure: Figure = None, as_json: Json = False) -> int:
    """Recompute a plan from its file alone and say what does not hold."""
    from drapeplan.check import check_plan
    from drapeplan.plan import Plan
    from drapeplan.words import summary

    result = Plan.read(plan_file)
    found = check_plan(result)
    lines = [
        *(f"broken: {line}" for line in found.broken),
        *(f"differs: {line}" for line in found.differing),
        *(f"violated: {line}" for line in found.violated),
    ]
    if found.verdict and figure:
        _draw_first_touch(figure, result, result.judged[1], plan_file.stem)
    if as_json:
        document = {"good": found.passed, "broken": found.broken}
        document |= {"differing": found.differing, "violated": found.violated}
        print(json.dumps({**document, "verdict": found.verdict}))
        return 0 if found.passed else 1
    print(*lines, sep="\n", end="\n" if lines else "")
    if found.passed:
        print(f"{plan_file}: holds; everything recomputed agrees.")
        facts = summary(found.verdict, result.judged[1].front, result.track)
        _show(found.verdict, facts, False)
    return 0 if found.passed else 1


@app.command()
def preview(
    plan_file: PlanFile,
    output: Annotated[Path, typer.Option("-o", "--output", help="HTML file to write.")],
    show: Annotated[bool, typer.Option("--open", help="Open it in a browser.")] = False,
    as_json: Json = False,
) -> int:
    """Write the preview of a plan: one HTML file that works offline."""
    from drapeplan.plan import Plan
    from viewer.page import export
    from viewer.scene import view_of

    result = Plan.read(plan_file)
    facts = export(view_of(result), output)
    if as_json:
        print(json.dumps({"good": True, "written": [str(output)], **facts}))
    else:
        print(f"wrote {output}")
    if show:
        import webbrowser

        webbrowser.open(output.resolve().as_uri())
    return 0


@app.command()
def shape(
    cups_file: Annotated[
        Path, typer.Argument(metavar="CUPS", help="Cups file (JSON).")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="CSV file to write.")],
    model: Annotated[
        str, typer.Option(help="quartic (the paper's) or cubic.")
    ] = "quartic",
    points: Annotated[
        Path | None, typer.Option(help="CSV of material points, header s_mm,t_mm.")
    ] = None,
    step_mm: Annotated[float, typer.Option(help="Grid step without --points.")] = 10.0,
    as_json: Json = False,
) -> int:
    """Shape of a free-hanging ply from the poses of the cups that hold it."""
    from drapeplan.cups import read_cups, shape_report, shape_table, write_csv

    cups = read_cups(cups_file)
    rows = shape_table(cups, model, points, step_mm * 1e-3)
    write_csv(output, rows)
    report = shape_report(cups, model)
    if as_json:
        print(json.dumps({"written": [str(output)], **report}))
    else:
        print(f"wrote {output}: {len(rows)} points, model {model}")
        for line in report["failing"]:
            print(f"  {line}")
    return 0 if not report["failing"] else 1


@app.command()
def tool(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write to.")],
    name: Annotated[str, typer.Option(help="Name of the tool and its files.")] = "tool",
    rows: Annotated[int, typer.Option(help="Cups along t.")] = 8,
    columns: Annotated[int, typer.Option(help="Cups along s.")] = 6,
    pitch_mm: Annotated[float, typer.Option(help="Between neighboring cups.")] = 110.0,
    half_width_mm: Annotated[float, typer.Option(help="Half side of a cup.")] = 20.0,
    leg_min_mm: Annotated[float, typer.Option(help="Shortest leg.")] = 150.0,
    leg_max_mm: Annotated[float, typer.Option(help="Longest leg.")] = 450.0,
    ball_height_mm: Annotated[float, typer.Option(help="Ball above the face.")] = 5.0,
    interlink_height_mm: Annotated[
        float, typer.Option(help="Interlinks above the suction plane.")
    ] = 0.0,
    as_json: Json = False,
) -> int:
    """Write URDF and sidecar of a drape tool of another size."""
    from urdf.generate import write_tool
    from urdf.spec import ToolSpec

    try:
        spec = ToolSpec(
            name=name,
            rows=rows,
            columns=columns,
            pitch=pitch_mm * 1e-3,
            half_width=half_width_mm * 1e-3,
            leg_min=leg_min_mm * 1e-3,
            leg_max=leg_max_mm * 1e-3,
            ball_height=ball_height_mm * 1e-3,
            interlink_height=interlink_height_mm * 1e-3,
        )
    except ValueError as error:
        raise InputError("tool", "", str(error)) from error
    written = [str(path) for path in write_tool(spec, output)]
    print(json.dumps({"good": True, "written": written}) if as_json else "", end="")
    if not as_json:
        print(*(f"wrote {path}" for path in written), sep="\n")
    return 0


@app.command()
def schema(
    what: Annotated[str, typer.Argument(help="scene, plan or cups")] = "scene",
) -> int:
    """Print the JSON Schema of a file format."""
    if what == "scene":
        from drapeplan.scene import Scene as Model
    elif what == "plan":
        from drapeplan.plan import Document as Model  # type: ignore[assignment]
    elif what == "cups":
        from drapeplan.cups_file import CupsFile as Model  # type: ignore[assignment]
    else:
        raise InputError(
            "schema", "", f"no format is called {what!r}", "scene, plan, cups"
        )
    print(json.dumps(Model.model_json_schema(), indent=2))
    return 0


def _draw_first_touch(path: Path, result: Any, contact: Any, title: str) -> None:
    """The first-touch picture of a plan."""
    import numpy as np

    from drapeplan.report import first_touch_figure

    track, sampling = result.track, result.cell.sampling
    span = track.over_mold
    step = np.maximum.accumulate(np.maximum(track.step[span] + track.tau[span], 0.0))
    step = np.where(np.array(track.phase[span]) == "wave", step, 0.0)
    front = contact.front
    first_touch_figure(
        path,
        sampling.s,
        sampling.t,
        front.first_touch,
        step,
        sampling.grid.centers,
        result.sequence.index(result.sequence.start_cup),
        front.events,
        title,
        front.premature_region,
        front.pocket_region,
        sampling.grid.half_width,
    )


def _show(
    verdict: dict[str, Any],
    lines: list[str],
    as_json: bool,
    written: list[Path] | None = None,
) -> None:
    """Verdict with its margins, and the files written."""
    files = [str(path) for path in written or []]
    if as_json:
        good = verdict["good"]
        document = {"good": good, "sentences": lines, "written": files}
        print(json.dumps({**document, "verdict": verdict}))
        return
    print("good" if verdict["good"] else "not good")
    for line in lines:
        print(f"  {line}")
    links, landing = verdict["interlinks"], verdict["landing"]
    limits, fibers = verdict["limits"], verdict["fibers"]
    low, high = limits["stroke_range_mm"]
    print(
        f"  Interlinks within {links['worst_error_mm']:.1e} mm; placed cups within "
        f"{landing['worst_distance_mm']:.1e} mm and "
        f"{landing['worst_angle_deg']:.1e} deg of their targets."
    )
    print(
        f"  Strokes {low:.0f} to {high:.0f} mm; "
        f"{limits['least_joint_room_deg']:.1f} deg to the nearest joint limit."
    )
    print(
        f"  Fibers need {-fibers['largest_surplus_mm']:+.2f} to "
        f"{fibers['longest_need_mm']:+.2f} mm of a take-up of "
        f"{fibers['take_up_mm']:g} mm."
    )
    print("  step  cups  premature mm  air pocket mm  penetration mm")
    for row in verdict["steps"]:
        early, air = (
            "-" if row[key] is None else f"{row[key]:.2f}"
            for key in ("premature_margin_mm", "air_margin_mm")
        )
        depth = max(row["span_penetration_mm"], row["pad_penetration_mm"])
        count = len(row["cups"])
        print(f"  {row['step']:4d}  {count:4d}  {early:>12}  {air:>13}  {depth:14.3f}")
    for name in files:
        print(f"wrote {name}")
