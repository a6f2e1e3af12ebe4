"""What a plan's check points at on the ply: events, long fibers, rungs, margins."""

from collections.abc import Iterator

import numpy as np

from drapeplan.contact import HIGH, front_grid, front_tolerance
from drapeplan.front import check_front
from drapeplan.front_grid import FrontGrid
from drapeplan.plan import Plan
from drapeplan.sentences import sentences
from drapeplan.track import Track
from drapeplan.verdict import EventKind, FrontEvent, FrontVerdict
from drapeplan.words import labels
from ply.fiber import LengthStatus, bubble_height
from urdf.sidecar import neighbor_pairs
from viewer.plan_view import MARGIN_SHOWN, Event, LongFiber

Array = np.ndarray

SIDES = (0, -1)  # fibers on a strip's two sides, which the verdict judges by length


def held_throughout(plan: Plan, values: Array) -> Array:
    """Values of the held poses, the last one kept until the end, shape (K, ...)."""
    after = len(plan.track.phase) - len(values)
    return np.concatenate([values, np.repeat(values[-1:], after, axis=0)])


def margins(plan: Plan) -> Array:
    """What is left until a premature contact and an air pocket, shape (K, 2), in [m].

    No more than MARGIN_SHOWN; MARGIN_SHOWN once all cups are released.
    """
    front = plan.judged[1].front
    least = np.stack([front.premature_margin, front.air_margin], axis=-1)
    out = np.full((len(plan.track.phase), 2), MARGIN_SHOWN)
    out[: len(least)] = np.minimum(least, MARGIN_SHOWN)
    return out


def wave_steps(track: Track) -> Array:
    """Number of the wave step at each pose: 0 the start cup's, -1 for none, (K,)."""
    wave = np.array(track.phase) == "wave"
    start = track.landing.any(axis=1) | track.placed.any(axis=1)
    return np.where(wave, track.step + 1, np.where(start, 0, -1))


def events(plan: Plan) -> tuple[Event, ...]:
    """What goes wrong at the front, by pose and kind.

    Args:
        plan: The plan.

    Returns:
        For each kind and each waypoint at which it is seen all that it takes in; the
        verdict's own events, which may happen on the way to their waypoint; and at
        other waypoints whose way shows a kind the nearest such event of their step,
        else what was free before and is ever taken in by that kind.
    """
    cell, contact, track = plan.cell, plan.judged[1], plan.track
    front, names = contact.front, labels(track)
    grid = front_grid(cell, plan.sequence.index(front.start_cup), contact.beside)
    seen = {(e.kind, e.pose): e for e in _at_waypoints(plan, grid, names)}
    found, told = [], set()
    lines = sentences(front, names)[1:]
    for event, line in zip(front.events, lines, strict=False):
        same = seen.get((event.kind, event.pose))
        samples = _near(event, front, grid) if same is None else same.samples
        made = _told(event, event.pose, samples, line)
        found.append(made._replace(on_way=same is None))
        told.add((event.kind, event.pose))
    found += [event for key, event in seen.items() if key not in told]
    laid = grid.laid(track.placed)
    found += _on_the_way(front, found, wave_steps(track), names, (grid, laid))
    return tuple(sorted(found, key=lambda event: (event.pose, event.kind)))


def _on_the_way(
    front: FrontVerdict,
    found: list[Event],
    steps: Array,
    names: list[str],
    ply: tuple[FrontGrid, Array],
) -> Iterator[Event]:
    """Stand-ins at the waypoints whose way shows a kind that nothing tells of."""
    grid, laid = ply
    ever = {
        EventKind.PREMATURE: front.premature_region,
        EventKind.AIR_POCKET: front.pocket_region,
    }
    for kind, bad in _bad(front).items():
        same = [event for event in found if event.kind == kind]
        poses = np.array([event.pose for event in same])
        for k in np.setdiff1d(np.flatnonzero(bad), poses).tolist() if same else ():
            far = np.lexsort((np.abs(poses - k), steps[poses] != steps[k]))
            near = same[far[0]]
            line = f"{names[k]}: on the way here, as at waypoint {near.pose + 1}."
            if kind in ever and steps[near.pose] != steps[k]:
                free = np.flatnonzero(ever[kind] & ~laid[max(k - 1, 0)])
                line = f"{names[k]}: on the way here."
                if free.size:
                    i, j = divmod(int(free[len(free) // 2]), len(grid.s))
                    place = float(grid.s[j]), float(grid.t[i])
                    near = near._replace(samples=free, place=place)
            yield near._replace(pose=k, sentence=line, on_way=True)


def _bad(front: FrontVerdict) -> dict[EventKind, Array]:
    """Waypoints whose way shows what a kind names, shape (K,) each."""
    most = front.tolerance
    return {
        EventKind.PREMATURE: front.premature_margin <= 0,
        EventKind.AIR_POCKET: front.air_margin <= 0,
        EventKind.PENETRATION: front.span_penetration > most.penetration,
        EventKind.PAD_PENETRATION: front.pad_penetration > most.pad_penetration,
    }


def _at_waypoints(plan: Plan, grid: FrontGrid, names: list[str]) -> Iterator[Event]:
    """Events at the waypoints themselves."""
    contact, tolerance = plan.judged[1], front_tolerance(plan.cell)
    front = contact.front
    gap = np.where(contact.beside, HIGH, np.minimum(contact.gap, HIGH))
    final = np.where(contact.beside, 0.0, contact.gap[-1])
    for k in map(int, np.flatnonzero(np.any([*_bad(front).values()], axis=0))):
        cups = plan.track.placed[k], plan.track.landing[k]
        laid, pads = grid.laid(cups[0]), grid.on_pads(cups[1])
        one = slice(k, k + 1)
        seen = check_front(
            gap[one], final, grid, cups[0][None], cups[1][None], tolerance
        )
        depth = np.where(laid, 0.0, final - gap[k])
        regions = {
            EventKind.PREMATURE: seen.premature_region,
            EventKind.AIR_POCKET: seen.pocket_region,
            EventKind.PENETRATION: ~pads & (depth > tolerance.penetration),
            EventKind.PAD_PENETRATION: pads & (depth > tolerance.pad_penetration),
        }
        lines = sentences(seen, names[one])[1:]
        for event, line in zip(seen.events, lines, strict=False):
            yield _told(event, k, np.flatnonzero(regions[event.kind]), line)


def _near(event: FrontEvent, front: FrontVerdict, grid: FrontGrid) -> Array:
    """Samples around an event that no waypoint shows: the nearest, up to its area."""
    regions = {
        EventKind.PREMATURE: front.premature_region,
        EventKind.AIR_POCKET: front.pocket_region,
    }
    s, t = event.place_st
    away = np.hypot(grid.s - s, (grid.t - t)[:, None])
    if event.kind in regions:
        away = np.where(regions[event.kind], away, np.inf)
    order = np.argsort(away, axis=None, kind="stable")
    covered = np.cumsum(grid.areas.ravel()[order])
    count = max(1, int(np.searchsorted(covered, event.area * (1 + 1e-9))))
    return order[:count][np.isfinite(away.ravel()[order[:count]])]


def _told(event: FrontEvent, pose: int, samples: Array, sentence: str) -> Event:
    sizes = event.area, event.volume, event.depth
    return Event(
        event.kind.value, pose, np.sort(samples), event.place_st, *sizes, sentence
    )


def long_fibers(plan: Plan) -> tuple[LongFiber, ...]:
    """Fibers that leave the take-up, in the order of the interlinks."""
    cell, fibers = plan.cell, plan.judged[1].fibers
    grid, L = cell.grid, cell.sampling.grid.span
    take_up = cell.scene.ply.take_up_mm * 1e-3
    pairs = np.array(neighbor_pairs(grid.rows, grid.columns))
    band = _by_pair(fibers.s_band, fibers.t_band)
    change = _by_pair(fibers.s_natural, fibers.t_natural) - L
    outside = band != LengthStatus.IN_BAND  # (K, pairs, 2)
    found = []
    for pair, side in np.argwhere(outside.any(axis=0)):
        asked = change[:, pair, side]
        surplus = max(0.0, float(-asked.min()))
        a, b = (int(cup) for cup in pairs[pair])
        offset = grid.half_width * (2 * int(side) - 1)
        first, second = (divmod(cup, grid.columns) for cup in (a, b))
        family = "s" if first[0] == second[0] else "t"
        found.append(
            LongFiber(
                f"{family} fiber {first}-{second}, {1e3 * offset:+g} mm",
                np.flatnonzero(outside[:, pair, side]),
                _along(plan, a, b, offset),
                (a, b),
                max(0.0, float(asked.max())),
                surplus,
                float(bubble_height(max(0.0, surplus - take_up), L)),
            )
        )
    return tuple(found)


def _by_pair(s: Array, t: Array) -> Array:
    """Outer fibers of all strips in the order of the interlinks, (K, pairs, 2)."""
    outer = [family[..., SIDES].reshape(len(family), -1, 2) for family in (s, t)]
    return np.concatenate(outer, axis=1)


def _along(plan: Plan, a: int, b: int, offset: float) -> Array:
    """Samples nearest to a fiber between two cups, an offset across, shape (m,)."""
    grid, sampling = plan.cell.grid, plan.cell.sampling
    (i, j), (k, m) = divmod(a, grid.columns), divmod(b, grid.columns)
    shift = np.array([[i == k], [j == m]]) * offset  # along t, along s
    middles = grid.pitch * np.array([[i, k], [j, m]]) + shift
    rows, columns = (
        np.abs(lines[:, None] - ends).argmin(axis=0)
        for lines, ends in zip((sampling.t, sampling.s), middles, strict=True)
    )
    i, j = np.meshgrid(
        np.arange(rows[0], rows[1] + 1),
        np.arange(columns[0], columns[1] + 1),
        indexing="ij",
    )
    return (i * len(sampling.s) + j).ravel()


def rungs(plan: Plan) -> tuple[tuple[str, ...], Array]:
    """Ply models that strips stand on.

    Returns:
        Their names, and the index of the one below each strip at each pose, in the
        order of the interlinks, shape (K, m).
    """
    contact = plan.judged[1]
    model, fibers = contact.choice.model, contact.fibers
    outside = _by_pair(fibers.s_band, fibers.t_band) != LengthStatus.IN_BAND
    strips = outside.any(axis=-1)
    if model.name == "cubic":
        names, index = ("cubic",), np.zeros(strips.shape, bool)
    elif model.gravity:
        names, index = ("modal under weight",), np.zeros(strips.shape, bool)
    else:
        names, index = ("cubic", "modal"), strips
    return names, held_throughout(plan, index.astype(np.uint8))
