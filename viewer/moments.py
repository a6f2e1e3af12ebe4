"""One time line for several drapes: aligned by phase, wave step and progress."""

from collections.abc import Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from viewer.plan_view import PlanView

Array = np.ndarray


class Moment(NamedTuple):
    """A place on the time line.

    Attributes:
        phase: Name of its phase.
        step: Wave step, 0 the start cup's, -1 for none.
        tau: Progress within the step or phase.
        poses: Pose that each drape shows.
    """

    phase: str
    step: int
    tau: float
    poses: tuple[int, ...]


class _Run(NamedTuple):
    """A phase and wave step, and the poses there of each drape that has it."""

    phase: str
    step: int
    poses: dict[int, Array]


def moments(views: Sequence[PlanView]) -> list[Moment]:
    """The time line that drapes share.

    Runs of poses of the same phase and wave step stand side by side. Within a run the
    drape with the most poses sets the moments, and the others show the pose whose
    progress is nearest. A drape that lacks a run waits in its pose before. With one
    drape the moments are its poses.

    Args:
        views: The drapes, at least one.
    """
    shown = [0] * len(views)
    line = []
    for phase, step, poses in _merged(views):
        taus = {i: views[i].tau[own] for i, own in poses.items()}
        lead = max(taus, key=lambda i: (len(taus[i]), -i))
        for k, tau in enumerate(taus[lead].tolist()):
            for i, own in poses.items():
                near = k if i == lead else np.argmin(abs(taus[i] - tau))
                shown[i] = int(own[near])
            line.append(Moment(phase, step, tau, tuple(shown)))
    return line


def _merged(views: Sequence[PlanView]) -> list[_Run]:
    """Runs of all drapes, each order kept: what one lacks comes by its step."""
    line: list[_Run] = []
    for i, view in enumerate(views):
        keys = list(zip(view.phases, view.wave_step.tolist(), strict=True))
        at = 0
        for key, poses in groupby(range(view.poses), key=keys.__getitem__):
            same = (k for k in range(at, len(line)) if line[k][:2] == key)
            place = next(same, None)
            if place is None:
                place = at
                while place < len(line) and _before(line[place], *key):
                    place += 1
                line.insert(place, _Run(*key, {}))
            line[place].poses[i] = np.array(list(poses))
            at = place + 1
    return line


def _before(run: _Run, phase: str, step: int) -> bool:
    """Whether a run belongs before a step of a phase."""
    return run.phase == phase and run.step < step
