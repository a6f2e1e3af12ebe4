"""Command line; every heavy import waits until its command runs."""

from __future__ import annotations

import json
import os
import sys
import traceback
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from drapeplan.cli_learning import rank, tune
from drapeplan.cli_options import Figure, Json, PlanFile, SceneFile
from drapeplan.console import say_error
from drapeplan.errors import DrapeplanError, InputError
from drapeplan.files import check_outputs, unwritable

# One BLAS thread: sums in one order, so the same bytes every time.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"

BUG = 70  # exit code of what should never happen
LEFT = 141  # exit code where the reader of stdout left early, as `head` does
MODELS = {  # of the file formats: module and class
    "scene": ("drapeplan.scene", "Scene"),
    "plan": ("drapeplan.plan_file", "Document"),
    "cups": ("drapeplan.cups_file", "CupsFile"),
    "measurements": ("drapeplan.identify_file", "MeasurementsFile"),
}

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Plans the robotic draping of a prepreg ply, end to end. "
    "Exit codes: 0 done and good; 1 done, and the answer is no; 2 bad input.",
)

app.command()(rank)
app.command()(tune)


def main() -> None:
    """Run the command line and turn errors into one line and an exit code."""
    as_json = "--json" in sys.argv
    try:
        code = app(standalone_mode=False)
        sys.stdout.flush()
    except DrapeplanError as error:
        code = error.exit_code
        say_error(error, as_json)
    except typer.Exit as stop:
        code = stop.exit_code
    except (KeyboardInterrupt, typer.Abort):
        code = 130
    except SystemExit as stop:  # typer's own answer to a broken pipe is 1
        code = LEFT if isinstance(stop.__context__, BrokenPipeError) else stop.code
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = LEFT
    except Exception as error:
        code = _unforeseen(error, as_json)
    sys.exit(code if isinstance(code, int) else 0)


def _unforeseen(error: Exception, as_json: bool) -> int:
    """Exit code of a usage error, 2, or of a bug: neither 0, 1 nor 2."""
    code, text = BUG, f"{type(error).__name__}: {error}"
    if hasattr(error, "format_message"):  # a usage error of the command line
        code, text = 2, error.format_message()
        error.show()  # type: ignore[attr-defined]
    else:
        traceback.print_exception(error)
    if as_json:
        print(json.dumps({"good": False, "error": text, "exit_code": code}))
    return code


@app.command()
def plan(
    scene: SceneFile,
    output: Annotated[Path, typer.Option("-o", "--output", help="Plan file to write.")],
    figure: Figure = None,
    seed: Annotated[
        int | None, typer.Option(help="Overrides the scene's seed.")
    ] = None,
    robustness: Annotated[
        int | None, typer.Option(help="Samples under uncertainty, kept in the plan.")
    ] = None,
    as_json: Json = False,
) -> int:
    """Plan the drape of one ply and say whether it meets the mold outward."""
    from drapeplan.commands_plan import plan_command

    return plan_command(scene, output, figure, seed, robustness, as_json)


@app.command()
def check(
    plan_file: PlanFile,
    figure: Annotated[
        Path | None,
        typer.Option("--figure", help="First touch, or with --robustness the tornado."),
    ] = None,
    robustness: Annotated[
        int | None, typer.Option(help="Samples under the scene's uncertainty.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Of the samples.")] = None,
    workers: Annotated[int | None, typer.Option(help="Processes for them.")] = None,
    depth: Annotated[
        str | None,
        typer.Option(help="poses (default): errors on cup poses; tool: settled anew."),
    ] = None,
    as_json: Json = False,
) -> int:
    """Recompute a plan from its file alone and say what does not hold."""
    from drapeplan.commands_check import Doubt, check_command

    doubt = None
    if robustness is not None:
        doubt = Doubt(robustness, seed, workers, depth or "poses")
    elif (seed, workers, depth) != (None, None, None):
        problem = "--seed, --workers and --depth say nothing without it"
        raise InputError("--robustness", "", problem, "add --robustness N")
    return check_command(plan_file, figure, doubt, as_json)


@app.command()
def preview(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="PLAN [PLAN]", help="Plan, or two; a scene if --live."),
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="HTML file (PNG, or live the plan)."),
    ] = None,
    show: Annotated[
        bool | None,
        typer.Option("--open/--no-open", help="Open it in a browser; live: yes."),
    ] = None,
    png: Annotated[
        str | None,
        typer.Option(
            metavar="STEP,...",
            help="Write a picture of these wave steps (or pose=K) instead.",
        ),
    ] = None,
    view: Annotated[
        str | None, typer.Option(help="Of a picture: Iso, Top, Front, Side, ...")
    ] = None,
    size: Annotated[str | None, typer.Option(help="Of a picture: 1280x720.")] = None,
    live: Annotated[
        bool, typer.Option("--live", help="Plan the scene and show it as it happens.")
    ] = False,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="Of the live view.")
    ] = None,
    as_json: Json = False,
) -> int:
    """Write the preview of a plan: one HTML file that works offline."""
    from drapeplan.commands_preview import Wanted, preview_command

    wanted = Wanted(output, show, png, view, size, live, port, as_json)
    return preview_command(files, wanted)


@app.command()
def shape(
    cups_file: Annotated[
        Path, typer.Argument(metavar="CUPS", help="Cups file (JSON).")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="CSV file to write.")],
    model: Annotated[
        str, typer.Option(help="auto, cubic, quartic (the paper's), modal or coupled.")
    ] = "quartic",
    points: Annotated[
        Path | None, typer.Option(help="CSV of material points, header s_mm,t_mm.")
    ] = None,
    step_mm: Annotated[
        float, typer.Option(min=0.5, help="Grid step without --points.")
    ] = 10.0,
    alternatives: Annotated[
        int, typer.Option(min=0, max=16, help="Most further shapes, OUT.alt1.csv, ...")
    ] = 0,
    tolerance_mm: Annotated[
        float, typer.Option(min=0.001, help="What auto may lose, rms over a patch.")
    ] = 0.1,
    as_json: Json = False,
) -> int:
    """Shape of a free-hanging ply from the poses of the cups that hold it."""
    from drapeplan.commands_shape import shape_command

    lengths = step_mm * 1e-3, alternatives, tolerance_mm * 1e-3
    return shape_command(cups_file, output, model, points, *lengths, as_json)


@app.command()
def validate(
    cups_file: Annotated[
        Path, typer.Argument(metavar="CUPS", help="Cups file (JSON).")
    ],
    scan_file: Annotated[
        Path, typer.Argument(metavar="SCAN", help="Point cloud (CSV, XYZ or PLY).")
    ],
    model: Annotated[str, typer.Option(help="As in shape.")] = "quartic",
    unit: Annotated[
        str | None, typer.Option(help="Of XYZ and PLY files: mm (default) or m.")
    ] = None,
    figure: Annotated[
        Path | None, typer.Option("--figure", help="Draw scan, model, error (PNG).")
    ] = None,
    rms_mm: Annotated[
        float, typer.Option(min=0.0, help="Largest good RMS error in z.")
    ] = 1.6,
    max_mm: Annotated[
        float, typer.Option(min=0.0, help="Largest good error in z.")
    ] = 4.6,
    as_json: Json = False,
) -> int:
    """Score a ply model against a scan of a held ply; limits are the paper's errors."""
    from drapeplan.cups import read_cups
    from drapeplan.report_validate import validation_figure
    from drapeplan.scan import read_scan
    from drapeplan.validate import validate as score
    from drapeplan.validate_words import document, table

    if figure:
        check_outputs([figure], [cups_file, scan_file])
    found = score(read_cups(cups_file), read_scan(scan_file, unit), model)
    good = found.within(rms_mm * 1e-3, max_mm * 1e-3)
    if figure:
        validation_figure(figure, found, scan_file.stem)
    if as_json:
        written = [str(figure)] if figure else []
        facts = {"good": good, "written": written, **document(found)}
        print(json.dumps(facts))
        return 0 if good else 1
    print(*table(found), sep="\n")
    if not good:
        print(f"not good: the limits in z are {rms_mm:g} mm RMS, {max_mm:g} mm")
    return 0 if good else 1


@app.command()
def identify(
    measurements: Annotated[
        Path, typer.Argument(metavar="MEASUREMENTS", help="Measurements file (YAML).")
    ],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Scene to write, a new file.")
    ] = None,
    scene: Annotated[
        Path | None, typer.Option(help="Scene that its other keys come from.")
    ] = None,
    figure: Annotated[
        Path | None, typer.Option(help="Draw measured against fitted (PNG).")
    ] = None,
    as_json: Json = False,
) -> int:
    """Fit take-up, bending stiffness and pose noise to what a shop measures."""
    from drapeplan.commands_identify import identify_command

    return identify_command(measurements, output, scene, figure, as_json)


@app.command()
def tool(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write to.")],
    name: Annotated[str, typer.Option(help="Name of the tool and its files.")] = "tool",
    rows: Annotated[int, typer.Option(help="Cups along t.")] = 8,
    columns: Annotated[int, typer.Option(help="Cups along s.")] = 6,
    pitch_mm: Annotated[
        float, typer.Option(max=10000, help="Between neighboring cups.")
    ] = 110.0,
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
    try:
        output.mkdir(parents=True, exist_ok=True)
        written = [str(path) for path in write_tool(spec, output)]
    except OSError as error:
        raise unwritable(output, error) from error
    print(json.dumps({"good": True, "written": written}) if as_json else "", end="")
    if not as_json:
        print(*(f"wrote {path}" for path in written), sep="\n")
    return 0


@app.command()
def schema(
    what: Annotated[str, typer.Argument(help=f"One of {', '.join(MODELS)}.")] = "scene",
) -> int:
    """Print the JSON Schema of a file format."""
    if what not in MODELS:
        problem = f"no format is called {what!r}"
        raise InputError("schema", "", problem, ", ".join(MODELS))
    module, name = MODELS[what]
    model = getattr(import_module(module), name)
    print(json.dumps(model.model_json_schema(), indent=2))
    return 0
