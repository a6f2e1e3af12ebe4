"""What a scene needs: what its plan leaves out, why it may, and what that changes.

Each plan estimates what a cause would change and models it past the scene's tolerance.
Here every cause is put in, or taken out, by force: estimates against what they stand
for. `python -m benchmarks.charts.needs` turns the table into docs/needs.md.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from benchmarks.charts._drapes import cell_of, drape, example, swapped
from benchmarks.charts.drawing import GRAY, WIDTH, legend, log_log, scatter
from benchmarks.charts.results import Results, made_with, read
from drapeplan import refine
from drapeplan.cell import Cell, build_cell
from drapeplan.contact import Contact, judge_contact
from drapeplan.frames import inverse, moved
from drapeplan.hanging import kinematic_lag
from drapeplan.held_ply import CUBIC, PlyModel, held_fibers, held_points
from drapeplan.legs import Array
from drapeplan.path import CupState
from drapeplan.planner import make_track
from drapeplan.ply_choice import PlyChoice
from drapeplan.ply_coupling import coupled_cells, coupling_estimate
from drapeplan.sequence import Sequence
from drapeplan.settling import settle_path
from ply.measures import measures

SOFT = {"bending_stiffness_Nm": 0.001, "overhang_mm": 35}
SCENES = {
    "panel": ("panel", {}),
    "saddle": ("saddle", {}),
    "kindrape": ("kindrape", {}),
    "panel, soft ply": ("panel", {"ply": SOFT}),
}
EVERYTHING = 1e-6  # [mm] a tolerance that leaves nothing out
FINE = 5.0  # [mm] between samples of the ply; a plan has 10
VERIFIED = 3  # [-] patches that are solved
CAUSES = {
    "take_up": "fibers beyond the take-up bulge",
    "gravity": "the ply sags between cups",
    "droop": "the overhang droops",
    "coupling": "strips hold each other (rms of the worst patch)",
    "rest": "weight and ply move hovering cups",
}
WHOLE = {
    "everything": "bulges, sag and droop all modeled",
    "rest taken out": "cups where strokes alone would have them",
    "waypoints alone": "nothing looked at between waypoints",
    "twice as fine": "the ply looked at every 5 mm",
}
LEAST = 1e-4  # [mm] changes below are drawn there
SHOWN = 3e-3  # [m] margins beyond are all alike
HEAD = """# What a scene needs

Estimates are those of the plan itself; where one stays within the scene's tolerance the
plan leaves the cause out. *Measured* is what changes when it is put in by force, or for
*weight and ply move hovering cups* taken out: the largest distance over the whole path.
Figures of the verdict are the margins to a premature contact and to an air pocket, up
to 3 mm, and the depths by which spans and pads are pressed in; the largest change
counts.
*Strips hold each other* is no part of a plan's model: its worst patches are solved and
told. Not in the table, as nothing here models them: friction, play, inertia.
Printed by `python -m benchmarks.charts.needs` from `chart-needs.json` of
`benchmarks/results/`.
"""


def measure(quick: bool) -> Results:
    """All scenes; a single one when quick."""
    rows = []
    for name in list(SCENES)[: 1 if quick else None]:
        rows += list(_rows(name, quick))
    return Results("needs", rows, made_with(quick=quick))


def draw(results: Results) -> Figure:
    """Estimates against what they stand for, and the tolerance that decides."""
    figure = Figure(figsize=(WIDTH, 3.8), layout="constrained")
    first, second = figure.subplots(1, 2)
    log_log(first, "each cause by itself", "estimated [mm]", "measured [mm]")
    for k, (cause, text) in enumerate(CAUSES.items()):
        rows = results.where(cause=cause)
        x, y = (
            [max(row[key] or 0.0, LEAST) for row in rows]
            for key in ("estimated_mm", "measured_mm")
        )
        scatter(first, x, y, text, k)
    ends = [LEAST, 10.0]
    first.plot(ends, ends, color=GRAY, linewidth=1)
    limit = results.rows[0]["tolerance_mm"]
    first.axvline(limit, color=GRAY, linestyle=":", linewidth=1.2)
    note = {"fontsize": 6.5, "color": GRAY, "rotation": 90, "ha": "right"}
    first.text(limit, 2 * LEAST, "tolerance", va="bottom", **note)
    second.set(
        title="the verdict without or with it", xlabel="largest change of a figure [mm]"
    )
    second.set_yticks(range(len(WHOLE)), WHOLE)
    second.invert_yaxis()
    second.set_xscale("log")
    for k, scene in enumerate(SCENES):
        rows = [row for row in results.where(scene=scene) if row["cause"] in WHOLE]
        x = [max(row["change_mm"] or 0.0, LEAST) for row in rows]
        y = [list(WHOLE).index(row["cause"]) + 0.12 * (k - 1.5) for row in rows]
        scatter(second, x, y, scene, len(CAUSES) + k)
    legend(figure, columns=3)
    return figure


def page(results: Results) -> str:
    """The table as a page of the documentation."""
    lines = [HEAD]
    for scene in dict.fromkeys(row["scene"] for row in results.rows):
        rows = results.where(scene=scene)
        lines += [f"## {scene}, tolerance {rows[0]['tolerance_mm']:g} mm", ""]
        lines += [
            "| cause | estimated mm | the plan | measured mm |",
            "|---|---|---|---|",
        ]
        for row in (row for row in rows if row["cause"] in CAUSES):
            plan = "models it" if row["modeled"] else "leaves it out"
            cells = (_figure(row[k]) for k in ("estimated_mm", "measured_mm"))
            estimate, found = cells
            lines.append(f"| {CAUSES[row['cause']]} | {estimate} | {plan} | {found} |")
        lines += [
            "",
            "| the verdict with | figures change by mm | order |",
            "|---|---|---|",
        ]
        for row in (row for row in rows if row["cause"] in WHOLE):
            change = _figure(row["change_mm"])
            order = "changes" if row["order_changes"] else "stays"
            lines.append(f"| {WHOLE[row['cause']]} | {change} | {order} |")
        lines.append("")
    return "\n".join(lines)


def _figure(value: float | None) -> str:
    return "no stable shape" if value is None else f"{value:.2g}"


def _rows(name: str, quick: bool) -> Iterator[dict]:
    """Causes by themselves, then what all of a kind does to the verdict."""
    example_name, changes = SCENES[name]
    size = (4, 3) if quick else None
    made = drape(cell_of(example(example_name, **changes), size))
    cell, path = made.cell, made.path
    settled = settle_path(cell, path, made.motion).motion
    track = make_track(cell, path, settled)
    held = track.held
    states = path.states[held]
    down = states == CupState.PLACED, states == CupState.LANDING
    to_mold = inverse(cell.world_mold)
    rest = moved(to_mold, *(pose[held] for pose in track.poses))
    asked = moved(to_mold, path.positions[held], path.rotations[held])
    plan = judge_contact(cell, made.sequence, rest, *down)
    limit = cell.scene.tolerance.shape_mm
    label = {"scene": name, "tolerance_mm": limit}
    for cause, estimate, modeled, measured in _causes(cell, rest, plan.choice):
        yield {
            **label,
            "cause": cause,
            "estimated_mm": 1e3 * estimate,
            "modeled": modeled,
            "measured_mm": None if measured is None else 1e3 * measured,
        }
    arm = settled.q[:, cell.robot.arm_columns]
    free = made.hovering[held]
    hung = settle_path(cell, path, made.motion, lead=False).motion
    hangs = moved(to_mold, *(pose[held] for pose in make_track(cell, path, hung).poses))
    fall = np.linalg.norm(hangs[0] - asked[0], axis=-1)
    wave = np.array(path.phase)[held] == "wave"
    yield {
        **label,
        "cause": "rest",
        "estimated_mm": 1e3 * kinematic_lag(cell, path, arm)[0],
        "modeled": True,
        "measured_mm": 1e3 * float(fall[wave][free[wave]].max()),
    }
    for cause, other in _wholes(cell, made.sequence, rest, asked, down):
        change = np.abs(_figures(other) - _figures(plan)).max()
        turned = other.front.in_order != plan.front.in_order
        yield {
            **label,
            "cause": cause,
            "change_mm": 1e3 * float(change),
            "order_changes": bool(turned),
        }


def _causes(
    cell: Cell, poses: tuple[Array, Array], choice: PlyChoice
) -> Iterator[tuple[str, float, bool, float | None]]:
    """Cause, estimate, whether the plan models it, and what it changes, [m]."""
    bulge, heavy = PlyModel("modal"), PlyModel("modal", gravity=True)
    pairs = {
        "take_up": (CUBIC, bulge),
        "gravity": (bulge, heavy),
        "droop": (CUBIC, PlyModel(droop=True)),
    }
    for effect in choice.effects:
        if effect.cause == "coupling":
            yield "coupling", effect.size, False, _coupling(cell, poses, choice)
            continue
        shapes = [
            held_points(cell, held_fibers(cell, *poses, model), *poses, model)
            for model in pairs[effect.cause]
        ]
        away = float(np.linalg.norm(shapes[1] - shapes[0], axis=-1).max())
        yield effect.cause, effect.size, effect.modeled, away


def _coupling(
    cell: Cell, poses: tuple[Array, Array], choice: PlyChoice
) -> float | None:
    """Rms distance of the worst coupled patch from the plan's model, [m]."""
    found = choice.coupled
    if not found:
        fibers = held_fibers(cell, *poses, choice.model)
        ply, grid = cell.scene.ply, cell.sampling.grid
        load = ply.bending_stiffness_Nm, ply.areal_mass_kg_m2
        shear = measures(grid, *poses, *load).shear_effect
        estimate = coupling_estimate(grid, fibers, poses[1], shear)
        found = coupled_cells(cell, *poses, fibers, estimate, VERIFIED)
    known = [one.rms for one in found if one.rms is not None]
    return max(known, default=None)


def _wholes(
    cell: Cell,
    sequence: Sequence,
    rest: tuple[Array, Array],
    asked: tuple[Array, Array],
    down: tuple[Array, Array],
) -> Iterator[tuple[str, Contact]]:
    """The drape judged with more or less of what there is."""
    yield "everything", judge_contact(_exact(cell), sequence, rest, *down)
    yield "rest taken out", judge_contact(cell, sequence, asked, *down)
    with swapped(refine, ROUNDS=0):
        yield "waypoints alone", judge_contact(cell, sequence, rest, *down)
    ply = cell.scene.ply.model_copy(update={"sample_mm": FINE})
    fine = build_cell(cell.scene.model_copy(update={"ply": ply}), cell.sources)
    yield "twice as fine", judge_contact(fine, sequence, rest, *down)


def _exact(cell: Cell) -> Cell:
    """The cell with a tolerance that leaves nothing out."""
    limits = cell.scene.tolerance.model_copy(update={"shape_mm": EVERYTHING})
    return replace(cell, scene=cell.scene.model_copy(update={"tolerance": limits}))


def _figures(contact: Contact) -> Array:
    """Least margins, up to what is shown, and largest depths of the verdict, [m]."""
    front = contact.front
    margins = front.premature_margin.min(), front.air_margin.min()
    depths = front.span_penetration.max(), front.pad_penetration.max()
    return np.array([*np.clip(margins, -SHOWN, SHOWN), *depths])


if __name__ == "__main__":
    from benchmarks.charts import RELEASED

    print(page(read(RELEASED / "chart-needs")))
