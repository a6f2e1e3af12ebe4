"""What `drapeplan plan` does."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from drapeplan.console import draw_first_touch, show_progress, show_verdict
from drapeplan.errors import InfeasibleError, InputError
from drapeplan.files import check_outputs
from drapeplan.planner import make_plan
from drapeplan.ranking import searched
from drapeplan.ranking_words import taken
from drapeplan.robustness import check_samples, robustness
from drapeplan.robustness_words import document
from drapeplan.scene import Scene, read_scene
from drapeplan.tuned import tuned_lines
from drapeplan.words import summary


def plan_command(
    scene: Path,
    output: Path,
    figure: Path | None,
    seed: int | None,
    samples: int | None,
    as_json: bool,
) -> int:
    """Plan a drape, write it and say what it is worth.

    Args:
        scene: Scene file.
        output: Plan file to write.
        figure: Picture of the first touch to write.
        seed: In place of the scene's.
        samples: Under the scene's uncertainty, to be kept in the plan; None for none.
        as_json: One JSON document instead of lines.

    Returns:
        The exit code: 1 where the verdict is not good. P(wrong order) is told, and left
        to the reader.

    Raises:
        InputError: A file or an option is not right.
        InfeasibleError: There is no plan.
    """
    read = read_scene(scene)
    if seed is not None:
        if seed < 0:
            raise InputError("--seed", "", f"must be at least 0 (found {seed})")
        read = read.model_copy(update={"seed": seed})
    if samples is not None:
        check_samples(samples)
    written = [output, figure] if figure else [output]
    check_outputs(written, inputs_of(read, scene))
    ranking = None
    try:
        with naming(scene), show_progress(as_json) as progress:
            place = scene.parent, str(scene)
            read, ranking = searched(read, *place, progress)
            outcome = make_plan(read, *place, progress)
    except InfeasibleError:
        if ranking:
            count = len(ranking.ranked)
            print(
                f"none of {count} candidates can be laid; the first:", file=sys.stderr
            )
        if output.exists():
            print(f"nothing written: {output} is of an earlier run", file=sys.stderr)
        raise
    result, robust = outcome.plan, None
    block = ranking.block() if ranking else None
    if block:
        result = result.chosen(block.model_dump(mode="json"))
    if samples is not None:
        robust = robustness(result, samples)
        result = result.doubted(document(robust))
    result.write(output)
    verdict = result.verdict
    front, lag = outcome.contact.front, result.document["kinematic_lag"]
    lines = summary(verdict, front, outcome.plan.track, lag) + tuned_lines(read)
    lines += [taken(block)] if block else []
    if figure:
        draw_first_touch(figure, outcome.plan, outcome.contact, scene.stem)
    show_verdict(verdict, lines, as_json, robust, written)
    return 0 if verdict["good"] else 1


@contextmanager
def naming(scene: Path) -> Iterator[None]:
    """Errors that know a key of the scene, yet not its file, get the file."""
    try:
        yield
    except InputError as error:
        section = error.source.split(".")[0]
        if section not in ("scene", "robot", "tool", "mold"):
            raise
        parts = [error.source.removeprefix("scene"), error.key]
        key = ".".join(part for part in parts if part)
        raise InputError(str(scene), key, error.problem, error.remedy) from error


def inputs_of(read: Scene, scene: Path) -> list[Path]:
    """Files that a scene is read from."""
    mesh, urdfs = read.mold.mesh, (read.robot.urdf, read.tool.urdf)
    named = [mesh.path if mesh else None, *urdfs]
    return [scene, *(scene.parent / name for name in named if name)]
