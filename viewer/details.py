"""What the panels of the page need of a plan, beside what every page shows."""

from typing import Any

import numpy as np

from drapeplan.robustness_words import NAMES
from drapeplan.rolling import CAP
from viewer import packing
from viewer.plan_view import MARGIN_SHOWN, PlanView, readable

Array = np.ndarray

GAP_STEP = 10e-6  # [m] of the gaps that the panels show: rounding stays below 5 um
GAP_LOWEST = -50e-3  # [m] gaps below are shown as this one
GAP_HIGHEST = 200e-3  # [m] gaps beyond are all the same, as to the front check


def details(view: PlanView, payload: packing.Payload) -> dict[str, object]:
    """Entries of a drape's header, found by the page under `drape.plan.details`.

    Args:
        view: The drape.
        payload: Takes up arrays; the header refers to them by their indices.

    Returns:
        material: s and t of the samples in [m], the cups around each sample as uint16,
            the cup that holds it as int16; or None.
        gaps: Exact gaps: folded uint16 (1, K, nt, ns), `lowest + step * value` in [m],
            none beyond `highest`.
        margins: `premature` and `air` by pose, in [m], and `most`, where they end.
        steps, taus: Wave step, -1 for none, and progress of each pose.
        events: As plan_view.Event; samples is a blob of uint32.
        long_fibers: As plan_view.LongFiber; samples and poses are blobs of uint32.
        rungs: Names, and a blob of uint8 (K, m) in the order of cups.interlinks.
        statements, facts: As in the view.
        robustness: The plan's block with `most_mm`, where margins end; or None.
    """
    around, pads = view.cups_around, view.pads
    return {
        "material": {
            "s": np.round(view.s, 6).tolist(),
            "t": np.round(view.t, 6).tolist(),
            "around": None if around is None else payload.add(around, "<u2"),
            "pads": None if pads is None else payload.add(pads, "<i2"),
        },
        "gaps": {
            "step": GAP_STEP,
            "lowest": GAP_LOWEST,
            "highest": GAP_HIGHEST,
            "blob": payload.add_folded(_whole_steps(view.gap)[None]),
        },
        "margins": {
            "premature": np.round(view.margins[:, 0], 6).tolist(),
            "air": np.round(view.margins[:, 1], 6).tolist(),
            "most": MARGIN_SHOWN,
        },
        "steps": view.wave_step.tolist(),
        "taus": np.round(view.tau, 6).tolist(),
        "events": [
            {**event._asdict(), "samples": payload.add(event.samples, "<u4")}
            for event in view.events
        ],
        "long_fibers": [
            {
                **fiber._asdict(),
                "samples": payload.add(fiber.samples, "<u4"),
                "poses": payload.add(fiber.poses, "<u4"),
            }
            for fiber in view.long_fibers
        ],
        "rungs": {"names": view.rungs, "strips": payload.add(view.strip_rungs, "u1")},
        "statements": [told._asdict() for told in view.statements],
        "facts": view.facts,
        "robustness": _labeled(view.robustness),
    }


def _labeled(found: dict[str, Any] | None) -> dict[str, Any] | None:
    """The block on uncertainty with names of parameters, and where margins end."""
    if found is None:
        return None
    rows = [
        {**row, "label": NAMES.get(row["parameter"], readable(row["parameter"]))}
        for row in found["parameters"]
    ]
    return {**found, "parameters": rows, "most_mm": 1e3 * CAP}


def _whole_steps(gap: Array) -> Array:
    """Gaps as whole steps above the lowest, dtype uint16, same shape."""
    shown = np.clip(gap, GAP_LOWEST, GAP_HIGHEST)
    return np.rint((shown - GAP_LOWEST) / GAP_STEP).astype(np.uint16)
