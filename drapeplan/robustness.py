"""Robustness: how likely a plan touches in the wrong order, and what it depends on.

Samples share their random numbers (see `noise`), so the same sample under one parameter
alone shows what that parameter does: the tornado. They run on as many processes as
wanted, and each is one batch of its own: the result is the same to the last bit.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drapeplan.contact import FAR, Lid, under_lid
from drapeplan.engine import Engine
from drapeplan.errors import InputError
from drapeplan.frames import inverse, moved
from drapeplan.front_grid import FrontGrid
from drapeplan.intervals import share_interval
from drapeplan.noise import PARAMETERS, LinkKeeper, Spread, draw
from drapeplan.plan import Plan
from drapeplan.plan_file import MOST_SAMPLES
from drapeplan.resettle import NODES, Rests, StiffnessTable
from drapeplan.rolling import CAP, Course, Rollout, roll, top_height
from drapeplan.scene import UncertaintySection
from ply.sampling import PlySampling

Array = NDArray[np.float64]
Depth = Literal["poses", "tool"]

NEAR = 0.02  # [m] ply that is higher is out of reach of errors of common size
SPREADS = 6  # [-] as far off as errors of any size are thought to come
SHARES = np.array([0.25, 0.5, 0.75])  # [-] of the way on which cups come to stand
ALONE = 32  # [-] most samples for what one parameter does alone
WORTH = 400  # [-] samples from which more processes repay their start


@dataclass(frozen=True)
class Effect:
    """What one parameter does alone.

    Attributes:
        parameter: One of PARAMETERS.
        rollouts: Its samples.
    """

    parameter: str
    rollouts: tuple[Rollout, ...]

    @property
    def wrong_share(self) -> float:
        """Share of samples in the wrong order."""
        return float(np.mean([one.wrong for one in self.rollouts]))

    @property
    def margins(self) -> Array:
        """Least margin of each sample, CAP where nothing threatens, in [m]."""
        return np.minimum([one.margin for one in self.rollouts], CAP)

    @property
    def press(self) -> Array:
        """Press depth of each sample, in [m]."""
        return np.array([max(one.span_press, one.pad_press) for one in self.rollouts])

    @property
    def rank(self) -> tuple[float, float, float]:
        """What hurts more ranks higher: wrong order, then margin, then depth."""
        return self.wrong_share, -float(self.margins.mean()), float(self.press.mean())


@dataclass(frozen=True)
class Robustness:
    """A plan under uncertainty.

    Attributes:
        stated: The uncertainties.
        seed: Seed of all samples.
        depth: "poses" or "tool": whether each sample's tool is settled anew.
        steps: Cups of each step.
        planned: The plan itself, without errors.
        rollouts: Samples with all errors at once.
        effects: Each parameter alone, the one that hurts most first.
    """

    stated: UncertaintySection
    seed: int
    depth: Depth
    steps: tuple[tuple[tuple[int, int], ...], ...]
    planned: Rollout
    rollouts: tuple[Rollout, ...]
    effects: tuple[Effect, ...]

    @property
    def wrong(self) -> int:
        """Samples in the wrong order."""
        return sum(one.wrong for one in self.rollouts)

    @property
    def interval(self) -> tuple[float, float]:
        """Interval of P(wrong order), 95 %."""
        return share_interval(self.wrong, len(self.rollouts))

    @property
    def worst_step(self) -> int | None:
        """Step that goes wrong most often, else the tightest; None if none is near."""
        margins = np.array([np.minimum(r.premature, r.air) for r in self.rollouts])
        wrong = (margins <= 0).sum(axis=0)
        tightest = np.minimum(margins, CAP).mean(axis=0)
        if not wrong.any() and (tightest >= CAP).all():
            return None
        order = np.lexsort((tightest, -wrong))
        return int(order[0])


def robustness(
    plan: Plan,
    samples: int,
    *,
    seed: int | None = None,
    workers: int | None = None,
    depth: Depth = "poses",
    stated: UncertaintySection | None = None,
    tornado: bool = True,
    keep_links: bool = True,
) -> Robustness:
    """Judge a plan under uncertainty.

    Args:
        plan: The plan.
        samples: Number of samples.
        seed: Seed of the samples; the scene's if None.
        workers: Processes; if None as many as there are cores, one for little work.
        depth: "poses" puts errors on the plan's cup poses and reads the effect of
            the bending stiffness from a table; "tool" settles the tool of each sample.
        stated: The uncertainties; the scene's if None.
        tornado: Whether each parameter is looked at alone as well.
        keep_links: Whether cup errors keep the links' lengths, as they must.

    Returns:
        What became of the samples.

    Raises:
        InputError: There are no samples, or too many.
    """
    check_samples(samples)
    stated = stated or plan.scene.uncertainty
    seed = plan.scene.seed if seed is None else seed
    spread = Spread.of(stated)
    alone = [name for name in PARAMETERS if tornado and spread.has(name)]
    few = min(samples, ALONE)
    if workers is None:
        much = depth == "tool" or samples + few * len(alone) >= WORTH
        workers = (os.cpu_count() or 1) if much else 1
    course = make_course(plan, spread, depth, workers, keep_links)
    runs = [(k, spread) for k in range(samples)]
    runs += [(k, spread.only(name)) for name in alone for k in range(few)]
    with Engine(workers) as engine:
        done = engine.map(lambda run: _sample(course, seed, *run), runs)
    parts = [done[samples + k * few :][:few] for k in range(len(alone))]
    effects = [
        Effect(name, tuple(part)) for name, part in zip(alone, parts, strict=True)
    ]
    return Robustness(
        stated,
        seed,
        depth,
        ((plan.sequence.start_cup,), *map(tuple, plan.sequence.steps)),
        _sample(course, seed, 0, Spread()),
        tuple(done[:samples]),
        tuple(sorted(effects, key=lambda one: one.rank, reverse=True)),
    )


def check_samples(samples: int, option: str = "--robustness") -> None:
    """Refuse a number of samples, before the work.

    Args:
        samples: The number.
        option: Where it was given.

    Raises:
        InputError: There are no samples, or too many.
    """
    if not 1 <= samples <= MOST_SAMPLES:
        problem = f"must be 1 to {MOST_SAMPLES} (found {samples})"
        raise InputError(option, "", problem, "64 give a first idea")


def make_course(
    plan: Plan,
    spread: Spread,
    depth: Depth = "poses",
    workers: int = 1,
    keep_links: bool = True,
) -> Course:
    """What all samples of a plan share.

    Args:
        plan: The plan.
        spread: Size of the errors.
        depth: "poses" or "tool".
        workers: Processes that settle the tool at other stiffnesses.
        keep_links: Whether cup errors keep the links' lengths.
    """
    contact, track, cell = plan.judged[1], plan.track, plan.cell
    grid = _front_grid(plan)
    laid = grid.laid(track.placed[track.held])
    final_gap = np.where(grid.beside, 0.0, contact.gap[-1])
    height = under_lid(contact.gap - final_gap, contact.lid)
    low = (height <= _reach(spread, cell.sampling)) & ~grid.beside
    near = np.asarray((low & ~laid).any(axis=(1, 2)) | laid.any(axis=(1, 2)))
    rests = _rests(plan, near)
    front, fixed, low, laid = contact.front, rests.fixed, low[near], laid[near]
    lands = np.flatnonzero((fixed[1:] & ~fixed[:-1]).any(axis=1))
    landings = np.ravel(lands[:, None] + SHARES)
    down = track.landing[track.held][near]
    after = np.repeat(lands, len(SHARES))
    pose = np.append(np.arange(len(low)), after)  # of which each has cups and laid ply
    low = np.concatenate([low, low[after] | low[after + 1]])
    down = np.concatenate([down, down[after] | (fixed[after + 1] & ~fixed[after])])
    laid = laid[pose]
    live = low & ~laid
    wave = np.array(track.phase)[track.held][near] == "wave"
    step = np.where(wave, track.step[track.held][near] + 1, 0)[pose]
    equilibrium = plan.scene.fidelity == "equilibrium"
    table = None
    if equilibrium and depth == "poses" and spread.stiffness:
        factors = np.exp(spread.stiffness * NODES).tolist()
        with Engine(min(workers, len(factors))) as engine:
            found = engine.map(rests.settle, factors)
        table = StiffnessTable.of(rests.poses, found)
    sides = contact.fibers.sides
    links = cell.robot.tool.interlinks
    return Course(
        rests,
        landings,
        step,
        len(plan.sequence.steps) + 1,
        LinkKeeper(links, *rests.poses, ~fixed) if keep_links else None,
        grid,
        live,
        live & grid.on_pads(down),
        np.where(laid, 0.0, top_height(front.tolerance)),
        under_lid(final_gap, contact.lid),
        _moved(contact.lid),
        front.tolerance,
        contact.choice.model,
        plan.scene.ply.model != "cubic",
        type(sides)(sides.s[near][pose], sides.t[near][pose]),
        _far(front.premature_margin, front.air_margin, near),
        table,
        equilibrium and depth == "tool",
    )


def _moved(lid: Lid) -> NDArray[np.int_] | None:
    """Flat indices of what stands for each sample; None where each is itself."""
    return None if lid is None else np.ravel_multi_index(lid, lid[0].shape).ravel()


def _sample(course: Course, seed: int, index: int, spread: Spread) -> Rollout:
    """One sample by its index."""
    poses, cups = course.rests.fixed.shape
    return roll(course, draw(seed, index, cups, poses, spread.redrawn), spread)


def _front_grid(plan: Plan) -> FrontGrid:
    """Samples of the ply, as the plan's own verdict has them."""
    sampling, sequence = plan.cell.sampling, plan.sequence
    return FrontGrid(
        sampling.s,
        sampling.t,
        sampling.cup_index,
        sampling.cups_around,
        plan.cell.grid.columns,
        sequence.index(sequence.start_cup),
        plan.judged[1].gap[-1] >= FAR,
    )


def _reach(spread: Spread, sampling: PlySampling) -> float:
    """Height above the laid state from which errors bring no ply near the mold, [m]."""
    size = np.hypot(np.ptp(sampling.s), np.ptp(sampling.t)) / 2
    moves = spread.position + spread.mold_xy + spread.mold_z
    moves += spread.angle * sampling.grid.pitch
    return float(max(NEAR, SPREADS * (moves + size * (spread.tilt + spread.mold_yaw))))


def _rests(plan: Plan, near: NDArray[np.bool_]) -> Rests:
    """The waypoints near the mold."""
    track, cell = plan.track, plan.cell
    chosen = np.flatnonzero(near)  # of the waypoints up to the end of the wave
    to_mold = inverse(cell.world_mold)
    poses = moved(to_mold, *(pose[chosen] for pose in track.poses))
    fixed = track.placed[chosen]
    return Rests(cell, track.q[chosen], track.tool[chosen], fixed, poses)


def _far(premature: Array, air: Array, near: NDArray[np.bool_]) -> tuple[float, float]:
    """Least margins of the waypoints that are left out, infinite beyond CAP."""
    least = [float(m.min(where=~near, initial=np.inf)) for m in (premature, air)]
    early, pocket = (x if x < CAP else np.inf for x in least)
    return early, pocket
