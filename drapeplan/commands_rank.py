"""What `drapeplan rank` does."""

from __future__ import annotations

import json
from pathlib import Path

from drapeplan.commands_plan import inputs_of, naming
from drapeplan.console import show_progress
from drapeplan.engine import Engine
from drapeplan.errors import InputError
from drapeplan.files import check_outputs
from drapeplan.ranking import rank_scene
from drapeplan.ranking_words import show
from drapeplan.report_ranking import pareto_figure
from drapeplan.robustness import check_samples
from drapeplan.scene import read_scene


def rank_command(
    scene: Path,
    figure: Path | None,
    samples: int,
    workers: int,
    cluster: str | None,
    as_json: bool,
) -> int:
    """Rank start cups and patterns for a scene, its own among them.

    Args:
        scene: Scene file; it is not changed.
        figure: Picture to write: P(wrong order) against time.
        samples: Of each candidate that is looked at closely.
        workers: Processes of this machine.
        cluster: Address of a Dask scheduler, whose workers are taken instead.
        as_json: One JSON document instead of a table.

    Returns:
        The exit code: 1 where no candidate is good.

    Raises:
        InputError: A file or an option is not right.
        InfeasibleError: The mold has no room for the ply, whatever its order.
    """
    read = read_scene(scene)
    check_samples(samples, "--samples")
    if workers < 1:
        raise InputError("--workers", "", f"must be at least 1 (found {workers})")
    written = [figure] if figure else []
    check_outputs(written, inputs_of(read, scene))
    with naming(scene), show_progress(as_json) as progress:
        engine = Engine(workers, cluster)
        found = rank_scene(
            read, scene.parent, str(scene), engine, samples, progress=progress
        )
    block = found.block()
    if figure:
        pareto_figure(figure, block, scene.stem)
    files = [str(path) for path in written]
    if as_json:
        facts = {"good": found.good, "written": files, **block.model_dump(mode="json")}
        print(json.dumps(facts))
    else:
        show(block)
        for name in files:
            print(f"wrote {name}")
    return 0 if found.good else 1
