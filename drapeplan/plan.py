"""Plan: a drape as a file that is complete in itself and can prove itself."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from drapeplan.cell import Cell, Sources, build_cell
from drapeplan.errors import InputError
from drapeplan.files import write_text
from drapeplan.judge import Contact, judge
from drapeplan.plan_file import Document
from drapeplan.scene import Scene, scene_from
from drapeplan.sequence import Sequence, make_sequence
from drapeplan.track import Track

Array = NDArray[np.float64]
FORMAT = "drapeplan-plan/1"
DIGITS = 12  # decimals of poses: far finer than what a check tells apart
PACKAGES = ("drapeplan", "pin", "qpsolvers", "osqp", "numpy", "scipy")


def _no_number(name: str) -> None:
    raise ValueError(f"{name} is no number")


CUP_LETTERS = "hlpr"  # holding, landing, placed, released: CupState by position


@dataclass(frozen=True)
class Plan:
    """A drape with everything that it was made from.

    Attributes:
        document: Content of the file, plain data.
    """

    document: dict[str, Any]

    @classmethod
    def read(cls, path: Path) -> Plan:
        """Plan from a file.

        Raises:
            InputError: If the file is missing or is no plan.
        """
        try:
            text = path.read_text(encoding="utf-8")
            data = json.loads(text, parse_constant=_no_number)
        except OSError as error:
            raise InputError(
                str(path), "", f"cannot read it ({error.strerror})"
            ) from None
        except (ValueError, RecursionError) as error:
            problem = "is not JSON"
            raise InputError(str(path), "", problem, "make it anew") from error
        try:
            Document.model_validate(data)
        except ValidationError as error:
            first = error.errors()[0]
            key = ".".join(map(str, first["loc"]))
            problem = first["msg"][0].lower() + first["msg"][1:]
            raise InputError(
                str(path), key, problem, f"is this a {FORMAT} file?"
            ) from error
        return cls(data)

    def write(self, path: Path) -> None:
        """Write the file, whole or not at all."""
        write_text(path, canonical(self.document) + "\n")

    @cached_property
    def scene(self) -> Scene:
        """The scene as read, defaults filled in."""
        return scene_from(self.document["scene"], "scene of the plan")

    @cached_property
    def cell(self) -> Cell:
        """Robot, mold and ply."""
        tool = self.document["tool"]
        sources = Sources(
            self.document["arm"]["urdf"],
            tool["urdf"],
            tool["sidecar"],
            self.document["mold"],
        )
        return build_cell(self.scene, sources)

    @cached_property
    def sequence(self) -> Sequence:
        """Start cup and wave steps, from the scene."""
        grid = self.cell.grid
        return make_sequence(self.scene.sequence, grid.rows, grid.columns, "scene")

    @cached_property
    def track(self) -> Track:
        """Waypoints as arrays."""
        waypoints = self.document["waypoints"]

        def column(key: str) -> Array:
            return np.array([w[key] for w in waypoints], float)

        letters = [[CUP_LETTERS.index(c) for c in w["cups"]] for w in waypoints]
        return Track(
            self.cell.robot,
            tuple(w["phase"] for w in waypoints),
            column("step").astype(int),
            column("tau"),
            column("time_s"),
            column("arm_rad"),
            column("legs"),
            np.array(letters, np.uint8),
        )

    @cached_property
    def targets(self) -> tuple[Array, Array]:
        """Landing poses in the mold frame, (n, 3) in [m] and (n, 3, 3)."""
        targets = self.document["targets"]
        return np.array(targets["position_m"]), np.array(targets["rotation"])

    @cached_property
    def judged(self) -> tuple[dict[str, Any], Contact]:
        """The verdict recomputed, and the ply that it rests on."""
        return judge(self.cell, self.sequence, self.targets, self.track)

    @property
    def verdict(self) -> dict[str, Any]:
        """The verdict as the file has it."""
        return dict(self.document["verdict"])

    def known(self, cell: Cell, judged: tuple[dict[str, Any], Contact]) -> Plan:
        """The same plan, which does not recompute what its maker has at hand.

        Args:
            cell: Robot, mold and ply.
            judged: The verdict, and the ply that it rests on.
        """
        plan = Plan(self.document)
        vars(plan).update(cell=cell, judged=judged)
        return plan

    def chosen(self, candidates: dict[str, Any]) -> Plan:
        """The same plan with what it was chosen from.

        Args:
            candidates: As in `plan_file.CandidatesBlock`.
        """
        return self._with("candidates", candidates)

    def doubted(self, robustness: dict[str, Any]) -> Plan:
        """The same plan with what becomes of it under uncertainty.

        Args:
            robustness: As in `plan_file.RobustnessBlock`.
        """
        return self._with("robustness", robustness)

    def rolled(self, path_choice: dict[str, Any]) -> Plan:
        """The same plan with what its path was chosen by.

        Args:
            path_choice: As in `plan_file.PathChoiceBlock`.
        """
        return self._with("path_choice", path_choice)

    def _with(self, key: str, block: dict[str, Any]) -> Plan:
        document = {**self.document, key: block}
        return Plan({**document, "hash": document_hash(document)})


def make_document(
    cell: Cell,
    sequence: Sequence,
    targets: tuple[Array, Array],
    made: dict[str, Any],
    track: Track,
    verdict: dict[str, Any],
) -> dict[str, Any]:
    """Content of a plan file, hash included.

    Args:
        cell: Robot, mold and ply.
        sequence: Start cup and steps.
        targets: Landing poses in the mold frame.
        made: What was found on the way: `net`, `kinematic_lag`, `tool_shift_m`.
        track: The drape.
        verdict: The verdict.
    """
    sources = cell.sources
    document: dict[str, Any] = {
        "format": FORMAT,
        "versions": {name: importlib.metadata.version(name) for name in PACKAGES},
        "scene": cell.scene.model_dump(mode="json"),
        "arm": {
            "urdf": sources.arm_urdf,
            "joint_names": list(cell.robot.arm_names),
        },
        "tool": {
            "urdf": sources.tool_urdf,
            "sidecar": sources.tool_sidecar,
            "leg_joint_names": [list(names) for names in cell.robot.leg_names],
        },
        "mold": sources.mold,
        "sequence": {
            "start_cup": list(sequence.start_cup),
            "pattern": sequence.pattern,
            "steps": [[list(cup) for cup in cups] for cups in sequence.steps],
        },
        **made,
        "targets": {
            "position_m": _plain(targets[0]),
            "rotation": _plain(targets[1]),
        },
        "waypoints": list(_waypoints(track)),
        "verdict": verdict,
    }
    document["sources_sha256"] = source_hashes(document)
    return {**document, "hash": document_hash(document)}


def _waypoints(track: Track) -> Iterator[dict[str, Any]]:
    positions, rotations = track.poses
    for k, phase in enumerate(track.phase):
        yield {
            "phase": phase,
            "step": int(track.step[k]),
            "tau": float(track.tau[k]),
            "time_s": float(track.time[k]),
            "arm_rad": track.arm[k].tolist(),
            "legs": track.legs[k].tolist(),
            "strokes_m": track.legs[k, :, 2].tolist(),
            "position_m": _plain(positions[k]),
            "rotation": _plain(rotations[k]),
            "cups": "".join(CUP_LETTERS[state] for state in track.states[k]),
        }


def _plain(array: Array) -> Any:
    """Nested lists, rounded, without negative zeros."""
    return (np.round(array, DIGITS) + 0.0).tolist()


def canonical(data: Any) -> str:
    """JSON with sorted keys and no spaces: the same data, the same bytes."""
    return json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)


def document_hash(document: dict[str, Any]) -> str:
    """SHA-256 over all of a plan but its hash."""
    rest = {key: value for key, value in document.items() if key != "hash"}
    return "sha256:" + _sha256(canonical(rest))


def source_hashes(document: dict[str, Any]) -> dict[str, str]:
    """SHA-256 of each embedded source."""
    texts = {
        "arm.urdf": document["arm"]["urdf"],
        "tool.urdf": document["tool"]["urdf"],
        "tool.sidecar": document["tool"]["sidecar"],
        "mold": canonical(document["mold"]),
    }
    return {key: _sha256(text) for key, text in texts.items()}


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
