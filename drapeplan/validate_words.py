"""A validation in words and as plain data, beside Table 1 of [Nielsen2018]."""

from typing import Any

from drapeplan.compare import FAR, Place
from drapeplan.cups_file import MM
from drapeplan.validate import Validation

PAPER_RMS, PAPER_MAX, PAPER_SECONDS = 1.6e-3, 4.6e-3, 1.0  # Table 1, in [m] and [s]


def document(validation: Validation) -> dict[str, Any]:
    """The validation as plain data, units in the keys."""
    v = validation
    scores = {"z": v.z, "world_z": v.world_z, "normal": v.normal}
    errors: dict[str, float | None] = {}
    for name, score in scores.items():
        errors[f"rms_{name}_mm"] = score.rms / MM if score else None
        errors[f"max_{name}_mm"] = score.max / MM if score else None
    lengths: dict[str, Any] = {}
    used = (v.grid.s_length, v.grid.t_length)
    for name, length, estimate in zip("st", used, v.lengths, strict=True):
        lengths[f"{name}_length_mm"] = length / MM
        if estimate:
            spread = {"spread_mm": estimate.spread / MM, "fibers": estimate.fibers}
            lengths[f"{name}_length_estimate"] = spread
    worst = {
        "s_mm": v.worst.s / MM,
        "t_mm": v.worst.t / MM,
        "error_mm": v.worst.error / MM,
    }
    return {
        "model": v.model,
        **errors,
        "noise_mm": v.noise / MM,
        "rms_without_noise_mm": v.rms_without_noise / MM,
        "worst": worst,
        "points": {kind.name.lower(): count for kind, count in v.points.items()},
        **lengths,
        "seconds": v.seconds,
        "fibers": v.report,
    }


def table(validation: Validation) -> list[str]:
    """The validation in lines of text, beside Table 1 of the paper."""
    v, mm = validation, 1 / MM
    rows = [
        ("", v.model, "paper, Table 1"),
        ("RMS error, z", f"{v.z.rms * mm:.2f} mm", f"{PAPER_RMS * mm:g} mm"),
        ("max error, z", f"{v.z.max * mm:.2f} mm", f"{PAPER_MAX * mm:g} mm"),
        ("calculation time", f"{v.seconds:.3f} s", f"< {PAPER_SECONDS:g} s"),
        ("RMS error, normal", f"{v.normal.rms * mm:.2f} mm", ""),
        ("max error, normal", f"{v.normal.max * mm:.2f} mm", ""),
    ]
    if v.world_z:
        both = f"{v.world_z.rms * mm:.2f}, {v.world_z.max * mm:.2f} mm"
        rows.append(("RMS, max, world z", both, ""))
    rows += [
        ("scan noise", f"{v.noise * mm:.2f} mm", "1 mm (camera)"),
        ("RMS, normal, without noise", f"{v.rms_without_noise * mm:.2f} mm", ""),
    ]
    lines = [f"{name:<28}{here:>16}{paper:>18}".rstrip() for name, here, paper in rows]
    worst = f"{v.worst.error * mm:+.2f} mm at s {v.worst.s * mm:.0f}, "
    lines.append(f"largest smooth error {worst}t {v.worst.t * mm:.0f} mm")
    used = (v.grid.s_length, v.grid.t_length)
    for name, length, estimate in zip("st", used, v.lengths, strict=True):
        source = "as the cups file has it"
        if estimate:
            source = f"+- {estimate.spread * mm:.2f} mm from fiber to fiber, "
            source += f"estimated from the scan over {estimate.fibers} fibers"
        lines.append(f"L_{name} {length * mm:.2f} mm, {source}")
    counts = v.points
    left_out = (
        f"{counts[Place.ON_CUP]} on cups, {counts[Place.BEYOND]} beyond the outer "
    )
    left_out += f"cups, {counts[Place.FAR]} further than {FAR * mm:g} mm off"
    lines.append(f"{counts[Place.FREE]} points compared; left out: {left_out}")
    failing = v.report["failing"]
    lines.append(f"{len(failing)} of {v.report['fibers']} fibers miss their length")
    return lines + v.report["words"]
