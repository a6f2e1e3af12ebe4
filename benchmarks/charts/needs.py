"""What a scene needs: what its plan leaves out, why it may, and what that changes.

Each plan estimates what a cause would change and models it past the scene's tolerance.
Here every cause is put in, or taken out, by force: estimates against what they stand
for. `python -m benchmarks.charts.needs` turns the table into docs/needs.md.
"""

import textwrap
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from benchmarks.charts._drapes import cell_of, example, order_of, swapped
from benchmarks.charts._held import Held, held_as_planned, held_as_requested
from benchmarks.charts.drawing import GRAY, WIDTH, legend, log_log, scatter
from benchmarks.charts.results import Results, made_with, read
from drapeplan import refine
from drapeplan.cell import Cell, build_cell
from drapeplan.contact import Contact, judge_contact
from drapeplan.held_ply import CUBIC, PlyModel, held_fibers, held_points
from drapeplan.legs import Array
from drapeplan.motion import StrokesError
from drapeplan.planner import make_request
from drapeplan.ply_choice import PlyChoice
from drapeplan.ply_coupling import coupled_cells, coupling_estimate
from drapeplan.sequence import Sequence
from drapeplan.settling import UnsettledError
from ply.measures import measures

SOFT = {"bending_stiffness_Nm": 0.001, "overhang_mm": 35}
GIVEN = {"start": [3, 2], "pattern": "alternate_sides"}  # in place of a search
SCENES = {
    "panel": ("panel", {}),
    "saddle": ("saddle", {}),
    "kindrape": ("kindrape", {}),
    "paraboloid": ("paraboloid", {}),
    "channel": ("channel", {"sequence": GIVEN}),
    "far_cup": ("far_cup", {}),
    "air_pocket": ("air_pocket", {}),
    "border_first": ("border_first", {}),
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
    "rest put in": "cups where weight and ply leave them",
    "waypoints alone": "nothing looked at between waypoints",
    "twice as fine": "the ply looked at every 5 mm",
}
PAGE = 88  # [-] characters of a line of the page
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
Scenes that are refused have no plan: what is told of them is that of the requested
poses, and how the tool would rest is not asked. The channel's start cup and order are
given here, not searched.
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
    figure = Figure(figsize=(WIDTH, 5.4), layout="constrained")
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
    texts = [textwrap.fill(text, 22) for text in WHOLE.values()]
    second.set_yticks(range(len(WHOLE)), texts, fontsize=8)
    second.invert_yaxis()
    second.set_xscale("log")
    apart = np.linspace(-0.36, 0.36, len(SCENES))
    for k, scene in enumerate(SCENES):
        rows = [row for row in results.where(scene=scene) if row["cause"] in WHOLE]
        x = [max(row["change_mm"] or 0.0, LEAST) for row in rows]
        y = [list(WHOLE).index(row["cause"]) + apart[k] for row in rows]
        scatter(second, x, y, scene, len(CAUSES) + k)
    legend(figure, columns=3)
    return figure


def page(results: Results) -> str:
    """The table as a page of the documentation."""
    lines = [HEAD]
    for scene in dict.fromkeys(row["scene"] for row in results.rows):
        rows = results.where(scene=scene)
        lines += [f"## {scene}, tolerance {rows[0]['tolerance_mm']:g} mm", ""]
        for row in results.where(scene=scene, cause="refused"):
            lines += [textwrap.fill(f"Refused: {row['text']}.", PAGE), ""]
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
    return "no rest or shape" if value is None else f"{value:.2g}"


def _rows(name: str, quick: bool) -> Iterator[dict]:
    """Causes by themselves, then what all of a kind does to the verdict."""
    example_name, changes = SCENES[name]
    cell = cell_of(example(example_name, **changes), (4, 3) if quick else None)
    label = {"scene": name, "tolerance_mm": cell.scene.tolerance.shape_mm}
    sequence = order_of(cell)
    request = make_request(cell, sequence)
    try:
        held = held_as_planned(cell, request)
    except (StrokesError, UnsettledError) as error:
        held = held_as_requested(cell, request)
        yield {**label, "cause": "refused", "text": str(error)}
    plan = judge_contact(cell, sequence, held.plan, *held.down)
    for cause, estimate, modeled, measured in _causes(cell, held.plan, plan.choice):
        yield {
            **label,
            "cause": cause,
            "estimated_mm": 1e3 * estimate,
            "modeled": modeled,
            "measured_mm": None if measured is None else 1e3 * measured,
        }
    if held.lag is not None:
        yield {
            **label,
            "cause": "rest",
            "estimated_mm": 1e3 * held.lag,
            "modeled": held.settled,
            "measured_mm": None if held.fall is None else 1e3 * held.fall,
        }
    for cause, other in _wholes(cell, sequence, held):
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
    cell: Cell, sequence: Sequence, held: Held
) -> Iterator[tuple[str, Contact]]:
    """The drape judged with more or less of what there is."""
    asked = held.plan, *held.down
    yield "everything", judge_contact(_exact(cell), sequence, *asked)
    if held.other:
        name = "rest taken out" if held.settled else "rest put in"
        yield name, judge_contact(cell, sequence, held.other, *held.down)
    with swapped(refine, ROUNDS=0):
        yield "waypoints alone", judge_contact(cell, sequence, *asked)
    ply = cell.scene.ply.model_copy(update={"sample_mm": FINE})
    fine = build_cell(cell.scene.model_copy(update={"ply": ply}), cell.sources)
    yield "twice as fine", judge_contact(fine, sequence, *asked)


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
