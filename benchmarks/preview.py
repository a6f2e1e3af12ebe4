"""Size and speed of the preview of a real plan, and of its page in a browser."""

import tempfile
import time
from pathlib import Path

from drapeplan.errors import InputError
from drapeplan.planner import make_plan
from drapeplan.scene import read_scene
from viewer.chromium import Chromium
from viewer.page import export
from viewer.plan_view import PlanView
from viewer.scene import view_of

EXAMPLES = Path(__file__).parent.parent / "examples"
SCENES = ("panel", "kindrape")
RUNS = 3  # of each export and each page; the fastest counts
WINDOW = (1280, 720)  # [px]
READY = """new Promise((done) => {
  const look = () => document.body?.dataset.ready ? done(performance.now()) : setTimeout(look, 10);
  look();
})"""  # noqa: E501
STEPS = """(() => {
  const times = app.book.moments.map((_, k) => {
    const start = performance.now();
    app.show(k);
    return performance.now() - start;
  }).sort((a, b) => a - b);
  return [times[times.length >> 1], times[Math.floor(0.95 * times.length)]];
})()"""  # what a change of pose asks of the script; drawing comes later


def run(quick: bool = False) -> dict[str, object]:
    """Preview plans, each alone, then both side by side.

    Args:
        quick: The first plan alone, once.

    Returns:
        For each preview its poses, seconds from the plan to its arrays and from these
        to the file, megabytes, and what `page_figures` says.
    """
    runs, results, views = 1 if quick else RUNS, {}, {}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "preview.html"
        for name in SCENES[:1] if quick else SCENES:
            path = EXAMPLES / f"{name}.yaml"
            plan = make_plan(read_scene(path), EXAMPLES, str(path)).plan
            start = time.perf_counter()
            views[name] = view_of(plan)
            arrays = {"arrays_s": time.perf_counter() - start}
            results[name] = arrays | _figures([views[name]], file, runs)
        if not quick:
            results["side_by_side"] = _figures(list(views.values()), file, runs)
    return results


def _figures(views: list[PlanView], file: Path, runs: int) -> dict[str, object]:
    seconds = []
    for _ in range(runs):
        start = time.perf_counter()
        figures = export(views, file)
        seconds.append(time.perf_counter() - start)
    made: dict[str, object] = {"poses": str(figures["poses"]), "export_s": min(seconds)}
    made["megabytes"] = file.stat().st_size / 1e6
    try:
        return made | page_figures(file, runs)
    except InputError as error:
        return made | {"page": str(error)}


def page_figures(file: Path, runs: int) -> dict[str, object]:
    """Speed of a page in an installed Chromium that draws by software.

    Args:
        file: The preview.
        runs: How often it is opened; the fastest counts.

    Returns:
        Seconds from asking for the page to its first picture, and milliseconds of
        script for a change of pose: the median over the time line, and its 95 % point.

    Raises:
        InputError: If no browser is installed.
    """
    opened, changed = [], []
    for _ in range(runs):
        with Chromium(WINDOW) as browser:
            browser.ask("Page.navigate", url=file.as_uri())
            opened.append(browser.run(READY) / 1e3)
            changed.append(browser.run(STEPS))
    names = ("first_picture_s", "step_ms", "step_95_ms")
    return dict(zip(names, (min(opened), *min(changed)), strict=True))
