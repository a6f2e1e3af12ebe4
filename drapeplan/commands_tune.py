"""What `drapeplan tune` does.

Where a scene leaves its sequence to a search, candidates are ranked first and the best
one's path is tuned: order first, path second, as the paper has it.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from drapeplan.cell import build_cell, read_sources
from drapeplan.commands_plan import inputs_of, naming
from drapeplan.console import show_progress
from drapeplan.engine import Engine
from drapeplan.errors import InputError
from drapeplan.files import check_outputs
from drapeplan.mold_features import mold_features
from drapeplan.plan import document_hash
from drapeplan.plan_file import MOST_SAMPLES, CandidatesBlock
from drapeplan.planner import cup_targets
from drapeplan.ranking import rank_scene
from drapeplan.ranking_words import taken
from drapeplan.rollout_file import RolloutFile
from drapeplan.scene import Scene, read_scene
from drapeplan.scene_text import write_scene_like
from drapeplan.surrogate import fit_surrogate, proposal
from drapeplan.trial import Row, Trials
from drapeplan.tune import Effort, Tuner, space_of
from drapeplan.tune_words import gain, tuning_document, tuning_lines
from drapeplan.tuning_space import Path as PathSection
from drapeplan.tuning_space import Space


@dataclass(frozen=True)
class Workforce:
    """Who simulates.

    Attributes:
        workers: Processes of this machine.
        cluster: Address of a Dask scheduler, whose workers are taken instead.
    """

    workers: int
    cluster: str | None


@dataclass(frozen=True)
class Wanted:
    """What is asked for.

    Attributes:
        output: Scene to write.
        rollouts: Parquet file of all simulations.
        effort: How much is simulated.
        seed: Of search and samples; the scene's if None.
        search: Fidelity of the search; the scene's if None.
        surrogate: Whether one proposes a finalist.
        resume: Whether to go on from the rollout file.
    """

    output: Path
    rollouts: Path
    effort: Effort
    seed: int | None
    search: str | None
    surrogate: bool
    resume: bool


def tune_command(
    scene: Path, wanted: Wanted, workforce: Workforce, as_json: bool
) -> int:
    """Tune the path of a scene, and write the scene that comes out.

    Args:
        scene: Scene file.
        wanted: What is asked for.
        workforce: Who simulates.
        as_json: One JSON document instead of lines.

    Returns:
        The exit code: 1 where the plan of the tuned scene is not good.

    Raises:
        InputError: A file or an option is not right.
        InfeasibleError: The mold has no room for the ply, whatever its path.
    """
    read = read_scene(scene)
    _check_options(read, scene, wanted, workforce)
    with naming(scene):
        sources = read_sources(read, scene.parent)
        read = build_cell(read, sources).scene  # its path known in all keys
    block = None
    if read.sequence == "auto":
        read, block = _ranked(read, scene, workforce, as_json)
    seed = read.seed if wanted.seed is None else wanted.seed
    searched = wanted.search or read.fidelity
    trials = Trials(read, sources, seed, searched)
    targets, grid = cup_targets(trials.cell), trials.cell.grid
    features = mold_features(targets, grid.rows, grid.columns, grid.pitch)
    space = space_of(read, searched)
    whole = read.model_dump(mode="json", exclude={"path", "tuned"})
    label = {
        "scene": document_hash({"scene": whole, "sources": asdict(sources)}),
        "version": version("drapeplan"),
    }
    made_from = {**label, "path": read.path.model_dump(mode="json"), "seed": seed}
    made_from |= {"search": searched, **asdict(wanted.effort)}
    file = RolloutFile(wanted.rollouts, made_from, [knob.name for knob in space.knobs])
    if wanted.resume:
        file.resume()
    learned: list[str] = []
    propose = _proposer(space, seed, learned) if wanted.surrogate else None
    engine = Engine(workforce.workers, workforce.cluster)
    with naming(scene), engine, show_progress(as_json) as progress:
        every = {**features, **label}
        tuner = Tuner(trials, engine, file, every, wanted.effort, progress)
        try:
            found = tuner.run(propose)
        except KeyboardInterrupt:
            told = f"stopped: --resume goes on from {wanted.rollouts}"
            print(told, file=sys.stderr)
            raise
    sections: dict[str, Any] = {}
    if found.changed:
        path = found.after.path
        plain = path.model_dump(mode="json", exclude_defaults=True)
        sections["path"] = {"family": path.family, **plain}
        sections["tuned"] = gain(found).model_dump()
    lines = tuning_lines(found, space, learned)
    if block:
        order = read.model_dump(mode="json", exclude_defaults=True)["sequence"]
        sections["sequence"] = order
        lines.insert(0, taken(block))
    kept = write_scene_like(wanted.output, scene, sections)
    if not kept:
        lines.append(f"comments of {scene} are not in {wanted.output}")
    written = [str(wanted.output), str(wanted.rollouts)]
    good = bool(found.after.plan["good"])
    if as_json:
        facts = {"good": good, "written": written, **tuning_document(found, space)}
        facts |= {"sequence": sections["sequence"]} if block else {}
        print(json.dumps(facts))
    else:
        print(*lines, *(f"wrote {name}" for name in written), sep="\n")
    return 0 if good else 1


def _check_options(
    read: Scene, scene: Path, wanted: Wanted, workforce: Workforce
) -> None:
    """Refuse options before the work."""
    check_outputs([wanted.output, wanted.rollouts], inputs_of(read, scene))
    effort = wanted.effort
    least = {"--budget": (effort.budget, 0), "--samples": (effort.samples, 1)}
    least |= {"--held-out": (effort.confirmed, 1), "--workers": (workforce.workers, 1)}
    for name, (value, limit) in least.items():
        if not limit <= value <= MOST_SAMPLES:
            problem = f"must be {limit} to {MOST_SAMPLES} (found {value})"
            raise InputError(name, "", problem)
    if wanted.seed is not None and wanted.seed < 0:
        raise InputError("--seed", "", f"must be at least 0 (found {wanted.seed})")
    if wanted.search not in (None, "equilibrium", "kinematic"):
        problem = f"no fidelity is called {wanted.search!r}"
        raise InputError("--search", "", problem, "equilibrium, kinematic")
    if effort.per_step and "kinematic" in (wanted.search, read.fidelity):
        problem = "how cups lean shows at equilibrium alone"
        raise InputError("--per-step", "", problem, "fidelity: equilibrium")
    given = read.sequence != "auto" and read.sequence.steps
    if given and read.path.family == "rectangle_blend":
        problem = "steps given freely are pressed down from a hover"
        raise InputError(str(scene), "path.family", problem, "say hover to tune it")
    if wanted.rollouts.exists() and not wanted.resume:
        problem = "is there already, with its simulations"
        remedy = "add --resume to go on from it, or name another file"
        raise InputError(str(wanted.rollouts), "", problem, remedy)


def _ranked(
    read: Scene, scene: Path, workforce: Workforce, as_json: bool
) -> tuple[Scene, CandidatesBlock]:
    """The scene with the best of the sequences that make sense, and all of them."""
    engine = Engine(workforce.workers, workforce.cluster)
    with naming(scene), show_progress(as_json) as progress:
        found = rank_scene(read, scene.parent, str(scene), engine, progress=progress)
    return found.best.applied(read), found.block()


def _proposer(
    space: Space, seed: int, learned: list[str]
) -> Callable[[list[Row]], PathSection | None]:
    """Asks a surrogate for a finalist, and notes how well it knows."""

    def propose(rows: list[Row]) -> PathSection | None:
        try:
            surrogate = fit_surrogate(rows)
        except InputError as error:
            learned.append(f"No surrogate: {error}.")
            return None
        learned.append(
            f"Surrogate: mean margin off by {surrogate.error:.3f} mm rms on trials "
            f"held out, {surrogate.naive:.3f} mm by the mean of the others."
        )
        return proposal(surrogate, rows, space, seed)

    return propose
