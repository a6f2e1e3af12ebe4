"""What is known of a drape while it is planned, as the live page asks for it."""

from __future__ import annotations

import base64
import html
import threading
from dataclasses import replace
from typing import Any

import numpy as np

from drapeplan.cell import Cell, Sources, build_cell
from drapeplan.contact import clipped, ply_over_mold
from drapeplan.frames import inverse, moved
from drapeplan.path import Path
from drapeplan.plan import Plan
from drapeplan.scene import Scene
from drapeplan.track import Track
from drapeplan.visuals import arm_visuals
from drapeplan.words import describe
from viewer import packing
from viewer.findings import wave_steps
from viewer.moments import moments
from viewer.page import moving, render
from viewer.plan_view import PlanView
from viewer.scene import drape_of, in_world, size_of, view_of

Array = np.ndarray

MOST = 24  # poses in one answer: half a second of work for the page
STAGES = {"strokes": "Strokes by QP", "rest": "Tool at rest", "front": "Verdict"}
WAITING = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">{again}<title>drapeplan</title>
<meta http-equiv="Content-Security-Policy"
 content="default-src 'none'; style-src 'unsafe-inline'">
<style>body {{ font: 15px/1.5 system-ui, "DejaVu Sans", sans-serif; margin: 4em; }}
</style></head><body><h1>drapeplan</h1><p role="status">{text}</p></body></html>
"""
AGAIN = '<meta http-equiv="refresh" content="1">'


class News:
    """A drape in the making. Told by one thread, asked by others."""

    def __init__(self) -> None:
        """Start with nothing known."""
        self._lock = threading.Lock()
        self._text, self._ended, self._page = "Planning begins", "", ""
        self._log: list[int] = []  # waypoints in the order in which they were solved
        self._joints: dict[int, Array] = {}  # the latest of each
        self._making: _Making | None = None

    def stage(self, name: str, share: float) -> None:
        """A stage of planning, and its share done, 0 to 1."""
        words = STAGES.get(name, name.capitalize())
        self._text = f"{words}, {100 * share:.0f} %" if share else words

    def path(self, scene: Scene, sources: Sources, path: Path) -> None:
        """What is asked for."""
        self._making = _Making(build_cell(scene, sources), path)

    def waypoint(self, k: int, q: Array) -> None:
        """Joint positions of a waypoint."""
        self._joints[k] = q
        self._log.append(k)

    def plan(self, document: dict[str, Any]) -> None:
        """The plan: from now on its preview is shown."""
        self._page = render(view_of(Plan(document)))
        self._ended = "plan"

    def failed(self, text: str) -> None:
        """Why there is no plan."""
        self._text, self._ended = text, "failed"

    def page(self) -> str:
        """The page as it is now: waiting, growing, or the preview of the plan."""
        if self._page:
            return self._page
        since = len(self._log)
        if self._making is None or not since:
            again = "" if self._ended else AGAIN
            return WAITING.format(again=again, text=html.escape(self._text))
        with self._lock:
            places = sorted(set(self._log[:since]))
            return render(self._making.view(places, self._joints), since)

    def after(self, since: int) -> dict[str, Any]:
        """What came after the first so many solved waypoints.

        Args:
            since: Waypoints that the page knows of, in the order of solving.

        Returns:
            text: What is being done; ended: "", "plan" or "failed"; since: what the
            page knows then; payload: poses as unpack.js reads them, or None.
        """
        ended, log = self._ended, self._log[since : since + MOST]
        known = since + len(log)
        answer = {"text": self._text, "since": known, "payload": None, "ended": ended}
        if known < len(self._log):
            answer["ended"] = ""  # the rest first
        if not log or self._making is None:
            return answer
        with self._lock:
            places = sorted(set(log))
            view = self._making.view(places, self._joints)
        payload = packing.Payload()
        head = {
            "places": places,
            "moments": [moment._asdict() for moment in moments([view])],
            "drape": moving(view, payload),
        }
        answer["payload"] = base64.b64encode(payload.to_bytes(head)).decode()
        return answer


class _Making:
    """Views of some waypoints of a path, from their joints alone."""

    def __init__(self, cell: Cell, path: Path) -> None:
        self.cell, self.visuals = cell, arm_visuals(cell.sources.arm_urdf)
        legs = np.zeros((*path.states.shape, 6))
        arm = np.zeros((len(path.tau), len(cell.robot.arm_columns)))
        when = path.phase, path.step, path.tau, np.zeros_like(path.tau)
        self.whole = Track(cell.robot, *when, arm, legs, path.states)
        self.labels, self.steps = describe(self.whole), wave_steps(self.whole)
        self.last = self.whole.held.stop - 1  # afterwards the ply stays as it was laid

    def view(self, places: list[int], joints: dict[int, Array]) -> PlanView:
        """View of some waypoints whose joint positions are known."""
        track = self._track(places, joints)
        held = self._track([min(k, self.last) for k in places], joints)
        poses = moved(inverse(self.cell.world_mold), *held.poses)
        points, gap = ply_over_mold(self.cell, *poses)
        return PlanView(
            subtitle=f"Planning; {size_of(self.cell)}",
            verdict=["Not judged yet."],
            good=True,
            labels=[self.labels[k] for k in places],
            wave_step=self.steps[places],
            **drape_of(
                self.cell,
                track,
                in_world(self.cell, clipped(self.cell.mold, points, gap)[0], gap),
                self.visuals,
            ),
        )

    def _track(self, places: list[int], joints: dict[int, Array]) -> Track:
        robot, whole = self.cell.robot, self.whole
        q = np.stack([joints[k] for k in places])
        return replace(
            whole,
            phase=tuple(whole.phase[k] for k in places),
            step=whole.step[places],
            tau=whole.tau[places],
            time=whole.time[places],
            arm=q[:, robot.arm_columns],
            legs=q[:, robot.leg_columns],
            states=whole.states[places],
        )
