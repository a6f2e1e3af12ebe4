"""What the page says of a plan in words: its verdict, and what it was made from."""

import re

import numpy as np

from drapeplan.plan import Plan
from drapeplan.remarks import remarks
from drapeplan.sentences import NEAR, sentences
from drapeplan.verdict import FrontVerdict
from drapeplan.words import failures, labels, summary
from viewer.plan_view import LongFiber, Statement

CUP = re.compile(r"\bcups? [([](\d+), (\d+)[)\]]", re.IGNORECASE)
WAYPOINT = re.compile(r"\bwaypoints? (\d+)")

Moment = tuple[int | None, tuple[float, float] | None]


def statements(plan: Plan, fibers: tuple[LongFiber, ...]) -> tuple[Statement, ...]:
    """Sentences of the verdict, each with the moment and the place it speaks of.

    Args:
        plan: The plan.
        fibers: Its fibers that leave the take-up.

    Returns:
        The summary, then what else the command line says; its warnings follow what is
        wrong.
    """
    front, track = plan.judged[1].front, plan.track
    lines = summary(plan.verdict, front, track, plan.document["kinematic_lag"])
    wrong = set(failures(plan.verdict, front, track))
    spoken = _front_moments(front, labels(track))
    found = []
    for line in lines:
        moment = spoken.get(line) or _moment(plan, fibers, line)
        found.append(Statement(line, line in wrong, *moment))
    found += [
        Statement(text, False, pose, None, warns, aside=not warns)
        for text, warns, pose in remarks(plan.verdict)
    ]
    headline, *others = found
    others.sort(key=lambda one: (not one.wrong, not one.warns))
    return headline, *others


def _front_moments(front: FrontVerdict, names: list[str]) -> dict[str, Moment]:
    """Moments of the sentences on the order of contact, by sentence."""
    lines = sentences(front, names)
    spots: dict[str, Moment] = {lines[0]: (None, None)}  # of the whole drape
    spots |= {
        line: (event.pose, event.place_st)
        for event, line in zip(front.events, lines[1:], strict=False)
    }
    margins = {
        "Nearest to a premature contact": front.worst_premature,
        "Nearest to an air pocket": front.worst_air,
    }
    for line in lines:
        for start, spot in margins.items():
            if spot is not None and spot.value <= NEAR and line.startswith(start):
                spots[line] = spot.pose, spot.place_st
    return spots


def _moment(plan: Plan, fibers: tuple[LongFiber, ...], line: str) -> Moment:
    """What another sentence speaks of, by the fiber, cup, waypoint or step it names."""
    if line.startswith("Laid, "):
        return plan.track.held.stop - 1, plan.judged[1].front.highest.place_st
    for fiber in fibers:
        if fiber.name in line:
            st = [_cup_place(plan, cup) for cup in fiber.cups]
            middle = np.mean(st, axis=0).tolist()
            return int(fiber.poses[0]), (middle[0], middle[1])
    cup, waypoint = CUP.search(line), WAYPOINT.search(line)
    index = plan.cell.grid.columns * int(cup[1]) + int(cup[2]) if cup else None
    pose = int(waypoint[1]) - 1 if waypoint else None
    if pose is None:
        begun = [k for k, name in enumerate(labels(plan.track)) if _begins(line, name)]
        pose = begun[0] if begun else None
    if pose is None and index is not None and plan.track.placed[:, index].any():
        pose = int(plan.track.placed[:, index].argmax())  # when it stands
    return pose, None if index is None else _cup_place(plan, index)


def _begins(line: str, label: str) -> bool:
    return line.startswith(f"{label}: ")


def _cup_place(plan: Plan, cup: int) -> tuple[float, float]:
    """Material coordinates (s, t) of a cup's middle, in [m]."""
    i, j = divmod(cup, plan.cell.grid.columns)
    return j * plan.cell.grid.pitch, i * plan.cell.grid.pitch


def facts(plan: Plan, mold: str) -> tuple[tuple[str, str], ...]:
    """What a plan was made from, as names and values.

    Args:
        plan: The plan.
        mold: What its mold is called.
    """
    scene, grid, made = plan.scene, plan.cell.grid, plan.document
    order, versions = made["sequence"], dict(made["versions"])
    own = versions.pop("drapeplan")
    ply = plan.verdict["ply_model"]
    extras = [name for name in ("gravity", "droop") if ply[name]]
    return (
        ("Mold", f"{mold}; gaps by {plan.verdict['mold']}"),
        (
            "Tool",
            f"{grid.columns} x {grid.rows} cups, {1e3 * grid.pitch:g} mm apart",
        ),
        ("Arm", scene.robot.name or str(scene.robot.urdf)),
        (
            "Ply",
            f"take-up {scene.ply.take_up_mm:g} mm, {scene.ply.areal_mass_kg_m2:g} "
            f"kg/m2, {scene.ply.bending_stiffness_Nm:g} N m",
        ),
        (
            "Ply model",
            " with ".join([ply["model"], " and ".join(extras)][: 1 + bool(extras)]),
        ),
        ("Start cup", str(tuple(order["start_cup"]))),
        ("Order", f"{order['pattern']}, {len(order['steps'])} steps"),
        ("Path", scene.path.family),
        ("Fidelity", plan.verdict["fidelity"]),
        ("Waypoints", f"{len(plan.track.time)}, {plan.track.time[-1]:.0f} s"),
        ("Least margins", _least(plan.judged[1].front)),
        ("drapeplan", own),
        ("With", ", ".join(f"{name} {number}" for name, number in versions.items())),
        ("Plan", made["hash"].removeprefix("sha256:")[:16]),
    )


def _least(front: FrontVerdict) -> str:
    """Least margins of the path in words."""
    least = {
        "premature contact": front.premature_margin.min(),
        "air pocket": front.air_margin.min(),
    }
    return ", ".join(
        f"{name} {1e3 * value:.2f} mm" if value <= NEAR else f"{name}: none near"
        for name, value in least.items()
    )
