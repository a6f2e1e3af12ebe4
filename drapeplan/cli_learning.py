"""Commands that choose and learn; heavy imports wait until they run."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from drapeplan.cli_options import Json, SceneFile


def rank(
    scene: SceneFile,
    figure: Annotated[
        Path | None,
        typer.Option("--figure", help="Draw P(wrong order) against time (PNG)."),
    ] = None,
    samples: Annotated[
        int, typer.Option(help="Random samples of each that is looked at closely.")
    ] = 64,
    workers: Annotated[
        int | None, typer.Option(help="Processes; default: one a core.")
    ] = None,
    cluster: Annotated[
        str | None, typer.Option(help="Dask scheduler, as tcp://host:8786.")
    ] = None,
    as_json: Json = False,
) -> int:
    """Rank start cups and patterns that make sense on a scene's mold."""
    from drapeplan.commands_rank import rank_command

    workers = os.cpu_count() or 1 if workers is None else workers
    return rank_command(scene, figure, samples, workers, cluster, as_json)


def tune(
    scene: SceneFile,
    output: Annotated[Path, typer.Option("-o", "--output", help="Scene to write.")],
    rollouts: Annotated[
        Path, typer.Option(help="File of all simulations to write (Parquet).")
    ],
    budget: Annotated[int, typer.Option(help="Paths that the search tries.")] = 64,
    samples: Annotated[int, typer.Option(help="Random samples of each.")] = 32,
    held_out: Annotated[int, typer.Option(help="Samples that tell the gain.")] = 200,
    search: Annotated[
        str | None,
        typer.Option(help="Fidelity of the search: equilibrium or kinematic."),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Overrides the scene's seed.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes; default: one a core.")
    ] = None,
    cluster: Annotated[
        str | None, typer.Option(help="Dask scheduler, as tcp://host:8786.")
    ] = None,
    per_step: Annotated[
        bool,
        typer.Option("--per-step", help="A lean of their own where steps go wrong."),
    ] = False,
    surrogate: Annotated[
        bool, typer.Option("--surrogate", help="One learned proposal more.")
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on from the file of simulations.")
    ] = False,
    as_json: Json = False,
) -> int:
    """Better the path of a scene by many simulations under its uncertainty.

    Its shape is bettered, not its times: the drape is judged at rest. Where the scene
    leaves its sequence to a search, that is ranked first.
    """
    from drapeplan.commands_tune import Wanted, Workforce, tune_command
    from drapeplan.tune import AROUND, Effort

    effort = Effort(budget, samples, held_out, AROUND if per_step else 0)
    wanted = Wanted(output, rollouts, effort, seed, search, surrogate, resume)
    force = Workforce(os.cpu_count() or 1 if workers is None else workers, cluster)
    return tune_command(scene, wanted, force, as_json)
