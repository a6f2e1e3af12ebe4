"""Options that several commands of the command line have."""

from pathlib import Path
from typing import Annotated

import typer

Json = Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")]
PlanFile = Annotated[Path, typer.Argument(metavar="PLAN", help="Plan file (JSON).")]
SceneFile = Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (YAML).")]
Figure = Annotated[
    Path | None, typer.Option("--figure", help="Write the first-touch picture (PNG).")
]
