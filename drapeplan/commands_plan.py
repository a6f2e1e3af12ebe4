"""What `drapeplan plan` does."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from drapeplan.console import draw_first_touch, show_progress, show_verdict
from drapeplan.errors import InfeasibleError, InputError
from drapeplan.files import check_outputs
from drapeplan.path_choice import PathChoice, choice_line
from drapeplan.plan import Plan
from drapeplan.planner import Outcome, Progress, Watch, make_plan
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
    with show_progress(as_json) as progress:
        made, result, lines = planned(read, scene, output, progress)
    robust = None
    if samples is not None:
        robust = robustness(result, samples)
        result = result.doubted(document(robust))
    result.write(output)
    if figure:
        draw_first_touch(figure, made.plan, made.contact, scene.stem)
    show_verdict(result.verdict, lines, as_json, robust, written)
    return 0 if result.verdict["good"] else 1


def planned(
    read: Scene,
    scene: Path,
    output: Path | None,
    progress: Progress | None,
    watch: Watch | None = None,
) -> tuple[Outcome, Plan, list[str]]:
    """Search where a scene asks for it, plan, and put the verdict in words.

    Args:
        read: The scene.
        scene: Its file.
        output: Plan file that will be written; one that is there is named if not.
        progress: Called with the stage and its share done, 0 to 1.
        watch: Shown what is known so far.

    Returns:
        What was planned, the plan with what it was chosen from, and its summary.

    Raises:
        InputError: The scene names what does not exist or does not fit.
        InfeasibleError: There is no plan.
    """
    place, ranking = (scene.parent, str(scene)), None
    try:
        with naming(scene):
            read, ranking = searched(read, *place, progress)
            made = make_plan(read, *place, progress, watch)
    except InfeasibleError:
        if ranking:
            count = len(ranking.ranked)
            print(
                f"none of {count} candidates can be laid; the first:", file=sys.stderr
            )
        say_nothing_written(output)
        raise
    plan, block = made.plan, ranking.block() if ranking else None
    lag = plan.document["kinematic_lag"]
    lines = summary(plan.verdict, made.contact.front, plan.track, lag)
    if choice := plan.document.get("path_choice"):
        lines.append(choice_line(PathChoice(**choice)))
    lines += tuned_lines(read)
    if block:
        plan = plan.chosen(block.model_dump(mode="json"))
        lines.append(taken(block))
    return made, plan, lines


def say_nothing_written(output: Path | None) -> None:
    """A line on stderr where a plan of an earlier run could be taken for this one's.

    Args:
        output: Plan file that was asked for, if any.
    """
    if output and output.exists():
        print(f"nothing written: {output} is of an earlier run", file=sys.stderr)


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
