"""An identification in words and as plain data, units in the keys."""

from __future__ import annotations

from typing import Any

import numpy as np

from drapeplan.cups_file import EARTH
from drapeplan.identify import Identified, Look
from drapeplan.likelihood import Estimate
from ply.gravity import clamped_sag

MM, DEG = 1e3, float(np.degrees(1.0))  # from meters, from radians
FLAT = float(np.cos(np.radians(4)))  # [-] between normals of strips held flat
DIGITS = 4  # [-] of a number in a scene
MORE = "scan a shape that asks its fibers for more, 0.2 mm at a time"


def rows(found: Identified) -> list[dict[str, Any]]:
    """Estimates as plain data, one for each quantity that was seen."""
    looks = found.looks
    out = sum(int((one.strips.out != 0).sum()) for one in looks)
    cups = sum(int(one.cups.seen.sum()) for one in looks)
    listed = [("take-up", "mm", found.take_up, MM, f"{out} strips out of the band")]
    for name, values in found.strips.items():
        source = f"{len(values)} strips over an edge"
        estimate = found.stiffness[name]
        listed.append((f"bending stiffness, {name}", "N m", estimate, 1.0, source))
    if found.stiffness:
        names = " and ".join(found.strips)
        estimate = found.stiffness["both"]
        listed.append(("bending stiffness", "N m", estimate, 1.0, f"mean of {names}"))
    source = f"{cups} cups in {len(looks)} scans"
    listed += [
        ("pose noise, position", "mm", found.position, MM, source),
        ("pose noise, tilt", "deg", found.angle, DEG, source),
    ]
    return [
        {"quantity": name, "unit": unit, **_scaled(estimate, scale), "from": source}
        for name, unit, estimate, scale, source in listed
        if estimate
    ]


def _scaled(estimate: Estimate, scale: float) -> dict[str, float]:
    return {name: _short(scale * x) for name, x in estimate._asdict().items()}


def _short(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def table(found: Identified) -> list[str]:
    """The estimates in lines of text; what was not seen stands in `notes`."""
    lines = [f"{'':<26}{'estimate':>9}{'95 % interval':>20}  unit  from"]
    for row in rows(found):
        interval = f"{row['low']:.3g} to {row['high']:.3g}"
        lines.append(
            f"{row['quantity']:<26}{row['value']:>9.3g}{interval:>20}"
            f"  {row['unit']:<4}  {row['from']}"
        )
    return lines


def blocks(found: Identified) -> dict[str, dict[str, float]]:
    """The scene's sections `ply` and `uncertainty`: what was seen, nothing else."""
    ply: dict[str, float] = {}
    uncertainty: dict[str, float] = {}
    if found.take_up:
        ply["take_up_mm"] = MM * found.take_up.value
        uncertainty["take_up_share"] = found.take_up_share
    if found.areal_mass is not None:
        ply["areal_mass_kg_m2"] = found.areal_mass
        ply["bending_stiffness_Nm"] = found.stiffness["both"].value
        uncertainty["stiffness_log"] = min(found.stiffness_log, 1.0)
    if found.position:
        uncertainty["position_mm"] = MM * found.position.value
    if found.angle:
        uncertainty["angle_deg"] = DEG * found.angle.value
    sections = {"ply": ply, "uncertainty": uncertainty}
    return {
        name: {key: _short(value) for key, value in section.items()}
        for name, section in sections.items()
    }


def notes(found: Identified) -> list[str]:
    """What was not seen and what would show it; what was left out; the sag."""
    lines = []
    if not found.stiffness:
        remedy = "hang strips over an edge and add cantilever"
        lines.append(f"bending stiffness: not seen: {remedy}")
    if not found.looks:
        lines.append(f"take-up and pose noise: not seen: add scans; {MORE}")
        return lines
    if found.position is None or found.angle is None:
        remedy = "scan more cups: what all have in common counts as registration"
        lines.append(f"pose noise: not seen: {remedy}")
    if found.take_up is None:
        lines.append(_no_take_up(found.looks))
    for n, look in enumerate(found.looks):
        lines += _left_out(f"scans.{n}", look)
    return lines + _sag(found)


def _no_take_up(looks: tuple[Look, ...]) -> str:
    out = sum(int((one.strips.out != 0).sum()) for one in looks)
    if out:
        problem = f"{out} strips left the band, too few for the noise of the poses"
        remedy = "add scans or interlinks, and mind the cups files' pitch and lengths"
        return f"take-up: not seen: {problem}; {remedy}"
    asked = [one.strips.asked - one.strips.rest for one in looks]
    asked = [x for x in asked if len(x)]
    if not asked:
        return "take-up: not seen: no scan covers a strip between two cups"
    low, high = MM * min(x.min() for x in asked), MM * max(x.max() for x in asked)
    problem = f"the cups asked for {low:+.2f} to {high:+.2f} mm, and the weave gave it"
    return f"take-up: not seen: {problem}; {MORE}"


def _left_out(name: str, look: Look) -> list[str]:
    """Cups and strips of a scan that do not count."""
    lines, cups = [], look.cups
    missing, pulled = int((~cups.seen).sum()), int(look.strips.pulled.sum())
    if missing:
        lines.append(f"{name}: {missing} of {len(cups.seen)} cups are not in the scan")
    if pulled:
        remedy = "bend the cups less against each other"
        lines.append(
            f"{name}: {pulled} strips, pulled straight, do not count; {remedy}"
        )
    return lines


def _sag(found: Identified) -> list[str]:
    """Sag of strips held flat against that of the stiffness: a check, no estimate.

    Curved neighbors lift strips by more than their weight bends them.
    """
    if not found.stiffness or found.areal_mass is None:
        return []
    D, weight = found.stiffness["both"].value, EARTH * found.areal_mass
    rises, expected = [], []
    for look in found.looks:
        strips, cups = look.strips, look.cups.cups
        free = (strips.out == 0) & ~strips.pulled
        normals = cups.rotations[strips.pairs[free], :, 2].mean(axis=1)
        if (normals @ normals.T).min(initial=1.0) < FLAT:
            continue
        n = normals @ cups.up
        rises.append(strips.rise[free])
        expected.append(-clamped_sag(weight * n, strips.rest[free], D))
    if sum(map(len, rises)) < 2:
        return []
    rise, load = np.concatenate(rises), np.concatenate(expected)
    if not load.any():
        return []
    share = (rise @ load) / (load @ load)
    left = rise - share * load
    sigma = np.sqrt((left @ left) / (len(rise) - 1) / (load @ load))
    middle = MM * abs(load).max()
    return [
        f"sag of {len(rise)} strips held flat: {share * middle:.3f} +- "
        f"{2 * sigma * middle:.3f} mm seen, {middle:.3f} mm by that stiffness"
    ]
