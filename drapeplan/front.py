"""Does the ply touch the mold outward from the start cup?

The order is judged on the height above the laid state, h = gap - final gap: what the
ply still has to fall, free of the bias that flat pads on a curved mold bring to the
gap. A sample is laid when the cups that it depends on are placed. Nothing moves it any
more, so its height is zero by definition; what a pose really leaves there is reported
as the laid deviation. Three things go wrong: a *premature contact*, apart from the one
that grows from the start; an *air pocket*, a hollow that the ply's edge no longer
vents; and *penetration*, which connectedness cannot see: a flat ply pushed through a
bowl is in order all the way.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy import ndimage

from drapeplan.errors import InputError
from drapeplan.flood import (
    Bools,
    Floats,
    air_margins,
    edge_mask,
    least_margins,
    premature_margins,
)
from drapeplan.front_grid import TIE, FrontGrid, Ints
from drapeplan.verdict import EventKind, FrontEvent, FrontVerdict, Spot, Tolerance

CORNERS = np.ones((3, 3), dtype=int)  # neighbors over corners, for ndimage.label
EQUAL = 1e-9  # [-] sums that differ by less are as large, in whatever order added


def heights(gap: Floats, final_gap: Floats, laid: Bools) -> Floats:
    """Heights above the laid state, zero where the ply is laid.

    Args:
        gap: Signed ply-mold distances, shape (..., nt, ns), in [m].
        final_gap: The same with all cups placed, shape (nt, ns), in [m].
        laid: Samples whose cups are all placed, shape (..., nt, ns).

    Returns:
        Heights, shape (..., nt, ns), in [m]; negative is penetration.
    """
    return np.where(laid, 0.0, gap - final_gap)


def premature_regions(h: Floats, start_pad: Bools, tolerance: Tolerance) -> Ints:
    """Contacts apart from the one that grows from the start.

    Samples up to touch + barrier hang together over sides and corners; what touches
    there and does not hang together with the start pad is premature. Before the start
    cup comes down there is nothing to hang together with, so any contact is.

    Args:
        h: Heights above the laid state, shape (nt, ns), in [m].
        start_pad: Samples on the start cup's pad, shape (nt, ns).
        tolerance: Tolerances of the check.

    Returns:
        A positive label on the touching samples of each such contact, else zero, shape
        (nt, ns).
    """
    labels, count = ndimage.label(h <= tolerance.touch + tolerance.barrier, CORNERS)
    apart = np.ones(count + 1, dtype=bool)
    apart[labels[start_pad]] = False
    return np.where(apart[labels] & (h <= tolerance.touch), labels, 0)


def air_pockets(h: Floats, tolerance: Tolerance, vents: Bools | None = None) -> Ints:
    """Hollows that contact encloses.

    Free samples hang together over sides; a part that neither reaches the ply's edge
    nor stays below touch + barrier is a pocket. None lies within laid patches, whose
    heights are zero.

    Args:
        h: Heights above the laid state, shape (nt, ns), in [m].
        tolerance: Tolerances of the check.
        vents: Where air leaves, shape (nt, ns); by default the ply's edge.

    Returns:
        A positive label on the samples of each pocket, else zero, shape (nt, ns).
    """
    labels, count = ndimage.label(h > tolerance.touch)
    closed, deep = np.ones(count + 1, dtype=bool), np.zeros(count + 1, dtype=bool)
    closed[labels[edge_mask(h.shape) if vents is None else vents]] = False
    deep[labels[h > tolerance.touch + tolerance.barrier]] = True
    return np.where((closed & deep)[labels], labels, 0)


def first_touch(h: Floats, touch: float) -> Floats:
    """When each sample first touches.

    Args:
        h: Heights above the laid state, shape (K, nt, ns), in [m].
        touch: Height up to which a sample touches, in [m].

    Returns:
        Pose of the first touch, interpolated linearly since the pose before, so that a
        sample touches by pose k exactly if its value is <= k; shape (nt, ns), infinite
        where it never does.
    """
    touching = h <= touch
    pose = touching.argmax(axis=0)
    now = np.take_along_axis(h, pose[None], axis=0)[0]
    before = np.take_along_axis(h, np.maximum(pose - 1, 0)[None], axis=0)[0]
    fall = np.where(pose > 0, before - now, 1.0)
    time = pose - np.where(pose > 0, (touch - now) / fall, 0.0)
    time = np.maximum(time, np.where(pose > 0, np.nextafter(pose - 1.0, pose), 0.0))
    return np.where(touching.any(axis=0), time, np.inf)


def check_front(
    gap: Floats,
    final_gap: Floats,
    grid: FrontGrid,
    placed: Bools,
    landing: Bools,
    tolerance: Tolerance | None = None,
    measures: Floats | None = None,
) -> FrontVerdict:
    """Judge a path, pose by pose, from the gaps between ply and mold.

    Args:
        gap: Signed ply-mold distances, shape (K, nt, ns), in [m].
        final_gap: The same model with all cups placed, shape (nt, ns), in [m].
        grid: The ply's samples and their cups.
        placed: Cups that are placed in each pose, shape (K, n_cups).
        landing: Cups on their way down in each pose, shape (K, n_cups).
        tolerance: Tolerances of the check, or None for the defaults.
        measures: What `pose_measures` says of the same, where a caller has it.

    Returns:
        The verdict, with margins and measures of each pose.

    Raises:
        InputError: Shapes disagree, or a gap is not finite.
    """
    tolerance = tolerance or Tolerance()
    _check_inputs(gap, final_gap, grid, placed, landing)
    if measures is None:
        measures = pose_measures(gap, final_gap, grid, placed, landing, tolerance)
    premature, air, span_depth, pad_depth, contact = measures
    laid = grid.laid(placed)
    stuck = laid & ~grid.beside
    h = heights(gap, final_gap, laid)
    pads = grid.on_pads(landing)
    bad = (np.minimum(premature, air) <= 0) | (span_depth > tolerance.penetration)
    bad |= pad_depth > tolerance.pad_penetration
    early, pockets = np.zeros((2, *final_gap.shape), dtype=bool)
    events: list[FrontEvent] = []
    for k in map(int, np.nonzero(bad)[0]):
        early_now = premature_regions(h[k], grid.start_pad, tolerance)
        pockets_now = air_pockets(h[k], tolerance, grid.vents)
        early, pockets = early | (early_now > 0), pockets | (pockets_now > 0)
        events += _order_events(k, h[k], early_now, pockets_now, grid)
        events += _depth_events(k, h[k], laid[k], pads[k], grid, tolerance)
    everywhere = np.ones(final_gap.shape, dtype=bool)
    lowest = grid.spot(-final_gap, everywhere)
    return FrontVerdict(
        tolerance=tolerance,
        start_cup=grid.cup_at(grid.start_cup),
        premature_margin=premature,
        air_margin=air,
        span_penetration=span_depth,
        pad_penetration=pad_depth,
        contact_area=contact,
        laid_deviation=np.abs(gap - final_gap).max((1, 2), where=stuck, initial=0.0),
        worst_premature=_worst(premature, h, grid, tolerance, EventKind.PREMATURE),
        worst_air=_worst(air, h, grid, tolerance, EventKind.AIR_POCKET),
        highest=grid.spot(final_gap, everywhere),
        lowest=replace(lowest, value=-lowest.value),
        events=_first_and_worst(events),
        starts_free=bool((h[0] > tolerance.touch).all()),
        first_touch=first_touch(h, tolerance.touch),
        premature_region=early,
        pocket_region=pockets,
    )


def pose_measures(
    gap: Floats,
    final_gap: Floats,
    grid: FrontGrid,
    placed: Bools,
    landing: Bools,
    tolerance: Tolerance,
) -> Floats:
    """Both margins, both depths and the contact area of each pose.

    Args:
        gap: Signed ply-mold distances, shape (K, nt, ns), in [m].
        final_gap: The same with all cups placed, shape (nt, ns), in [m].
        grid: The ply's samples and their cups.
        placed: Cups that are placed in each pose, shape (K, n_cups).
        landing: Cups on their way down in each pose, shape (K, n_cups).
        tolerance: Tolerances of the check.

    Returns:
        Premature margin, air margin, depth of spans and of landing pads, all in [m],
        and the touching share of the ply, shape (5, K).
    """
    laid, pads = grid.laid(placed), grid.on_pads(landing)
    h = heights(gap, final_gap, laid)
    touch, barrier = tolerance.touch, tolerance.barrier
    margins = least_margins(h, grid.start_pad, grid.vents, touch, barrier)
    rows = [_sizes(*pose, grid, touch) for pose in zip(h, laid, pads, strict=True)]
    return np.concatenate([margins, np.array(rows).reshape(-1, 3).T])


def _sizes(
    h: Floats, laid: Bools, pads: Bools, grid: FrontGrid, touch: float
) -> tuple[float, ...]:
    """Both depths and the contact area of one pose."""
    return (
        max(0.0, -h.min(where=~laid & ~pads, initial=0.0)),
        max(0.0, -h.min(where=~laid & pads, initial=0.0)),
        grid.areas[h <= touch].sum() / grid.areas.sum(),
    )


def _order_events(
    pose: int, h: Floats, early: Ints, pockets: Ints, grid: FrontGrid
) -> Iterator[FrontEvent]:
    """The largest premature contact and the largest air pocket of one pose."""
    if early.any():
        region = _largest(early, grid.areas, -h)
        yield _event(EventKind.PREMATURE, pose, -h, region, grid)
    if pockets.any():
        region = _largest(pockets, grid.areas * h, h)
        yield _event(EventKind.AIR_POCKET, pose, h, region, grid)


def _depth_events(
    pose: int,
    h: Floats,
    laid: Bools,
    pads: Bools,
    grid: FrontGrid,
    tolerance: Tolerance,
) -> Iterator[FrontEvent]:
    """Free samples of one pose that sink too deep, spans and landing pads apart."""
    spans_sunk = ~laid & ~pads & (-h > tolerance.penetration)
    pads_sunk = ~laid & pads & (-h > tolerance.pad_penetration)
    if spans_sunk.any():
        yield _event(EventKind.PENETRATION, pose, -h, spans_sunk, grid)
    if pads_sunk.any():
        yield _event(EventKind.PAD_PENETRATION, pose, -h, pads_sunk, grid)


def _largest(labels: Ints, weights: Floats, depth: Floats) -> Bools:
    """Region with the largest sum of weights; of equally large ones the deepest."""
    sums = np.bincount(labels.ravel(), weights.ravel())
    sums[0] = -np.inf
    deepest = np.full(len(sums), -np.inf)
    np.maximum.at(deepest, labels.ravel(), depth.ravel())
    deepest[sums < sums.max() * (1 - EQUAL)] = -np.inf
    return labels == np.argmax(deepest)


def _event(
    kind: EventKind, pose: int, depth: Floats, region: Bools, grid: FrontGrid
) -> FrontEvent:
    """Event on a region, with its sizes: `depth` counts toward its bad side."""
    spot, areas = grid.spot(depth, region), grid.areas[region]
    volume = float(areas @ np.maximum(depth[region], 0.0))
    area, deepest = float(areas.sum()), max(spot.value, 0.0)
    return FrontEvent(kind, pose, spot.place_st, spot.cup, area, volume, deepest)


def _first_and_worst(events: list[FrontEvent]) -> tuple[FrontEvent, ...]:
    """Per kind the first event and, if it is another one, the worst."""
    kept: list[FrontEvent] = []
    for kind in EventKind:
        same = [event for event in events if event.kind is kind]
        if same:
            worst = max(same, key=lambda event: event.severity)
            kept += same[:1] if worst is same[0] else [same[0], worst]
    return tuple(kept)


def _worst(
    margins: Floats,
    h: Floats,
    grid: FrontGrid,
    tolerance: Tolerance,
    kind: EventKind,
) -> Spot | None:
    """Where the least margin of all poses stands, or None if nothing threatens."""
    if not np.isfinite(margins).any():
        return None
    k, touch, barrier = int(np.argmin(margins)), tolerance.touch, tolerance.barrier
    if kind is EventKind.PREMATURE:
        depth, field = -h[k], premature_margins(h[k], grid.start_pad, touch, barrier)
    else:
        depth, field = h[k], air_margins(h[k], touch, barrier, grid.vents)
    spot = grid.spot(depth, field <= field.min() + TIE, pose=k)
    return replace(spot, value=float(margins[k]))


def _check_inputs(
    gap: Floats, final_gap: Floats, grid: FrontGrid, placed: Bools, landing: Bools
) -> None:
    """Refuse arrays that do not belong together, and gaps that are no numbers."""
    shape, n_cups = grid.cup_index.shape, len(grid.cup_centers)
    if final_gap.shape != shape or gap.shape != (len(gap), *shape) or not len(gap):
        raise InputError("front", "gap", f"is not of shape (K, {shape[0]}, {shape[1]})")
    if placed.shape != (len(gap), n_cups) or landing.shape != placed.shape:
        raise InputError("front", "placed", f"is not of shape ({len(gap)}, {n_cups})")
    if not (np.isfinite(gap).all() and np.isfinite(final_gap).all()):
        pose = int(np.argmin(np.isfinite(gap).all(axis=(1, 2))))
        remedy = "the ply may reach beyond the mold: enlarge the mold or move the ply"
        raise InputError("front", "gap", f"is not finite, pose {pose} first", remedy)
