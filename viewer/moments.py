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
    """Poses of one phase and wave step: the how-manieth such run, and which."""

    phase: str
    step: int
    count: int
    poses: Array


def moments(views: Sequence[PlanView]) -> list[Moment]:
    """The time line that drapes share.

    Runs of poses of the same phase and wave step stand side by side. Within a run the
    drape with the most poses sets the moments, and the others show the pose whose
    progress is nearest. A drape that lacks a run waits in its pose before. With one
    drape the moments are its poses.

    Args:
        views: The drapes, at least one.
    """
    runs = [_runs(view) for view in views]
    shown = [0] * len(views)
    line = []
    for key in _merged([[run[:3] for run in own] for own in runs]):
        found = [next((r for r in own if r[:3] == key), None) for own in runs]
        taus = [
            None if run is None else view.tau[run.poses]
            for view, run in zip(views, found, strict=True)
        ]
        lead = max((t for t in taus if t is not None), key=len)
        for k, tau in enumerate(lead):
            for i, (run, own) in enumerate(zip(found, taus, strict=True)):
                if run is not None:
                    near = k if own is lead else int(np.argmin(abs(own - tau)))
                    shown[i] = int(run.poses[near])
            line.append(Moment(key[0], key[1], float(tau), tuple(shown)))
    return line


def _runs(view: PlanView) -> list[_Run]:
    """Runs of poses of the same phase and step, in their order."""
    runs: list[_Run] = []
    keys = list(zip(view.phases, view.wave_step.tolist(), strict=True))
    for (phase, step), poses in groupby(range(view.poses), key=keys.__getitem__):
        count = sum(run[:2] == (phase, step) for run in runs)
        runs.append(_Run(phase, step, count, np.array(list(poses))))
    return runs


def _merged(orders: list[list[tuple[str, int, int]]]) -> list[tuple[str, int, int]]:
    """All keys, each order kept: what one lacks is put behind its neighbor."""
    line = orders[0].copy()
    for order in orders[1:]:
        at = 0
        for key in order:
            if key in line[at:]:
                at = line.index(key, at) + 1
            else:
                line.insert(at, key)
                at += 1
    return line
