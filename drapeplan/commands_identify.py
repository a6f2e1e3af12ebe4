"""What `drapeplan identify` does."""

import json
from pathlib import Path

from drapeplan.errors import InputError
from drapeplan.files import check_outputs
from drapeplan.identify import identify
from drapeplan.identify_file import read_measurements
from drapeplan.identify_scene import write_scene
from drapeplan.identify_words import blocks, notes, rows, table
from drapeplan.scene import read_scene


def identify_command(
    measurements: Path,
    output: Path | None,
    scene: Path | None,
    figure: Path | None,
    as_json: bool,
) -> int:
    """Say what measurements show, and write it into a scene.

    Args:
        measurements: Measurements file.
        output: Scene to write, or None.
        scene: Scene to take everything else from, or None.
        figure: Picture of measured against fitted to write, or None.
        as_json: One JSON document instead of lines.

    Returns:
        The exit code: 1 where the measurements show nothing at all.

    Raises:
        InputError: A file or an option is not right.
    """
    if scene and not output:
        problem = "is read for a scene to write"
        raise InputError("--scene", "", problem, "add -o NEW_SCENE.yaml")
    written = [path for path in (output, figure) if path]
    measured = read_measurements(measurements)
    check_outputs(written, [*measured.files, *([scene] if scene else [])])
    if scene:
        read_scene(scene)
    found = identify(measured)
    values, listed, remarks = blocks(found), rows(found), notes(found)
    if output:
        write_scene(output, values, scene, measurements.name)
        if scene:
            remarks.append(f"comments of {scene} are not in {output}")
        else:
            remarks.append(f"{output} has these keys alone: --scene SCENE adds a scene")
    if figure:
        from drapeplan.report_identify import identify_figure

        identify_figure(figure, found, measured, measurements.stem)
    if as_json:
        files = [str(path) for path in written]
        facts = {"good": bool(listed), "written": files, "estimates": listed}
        print(json.dumps({**facts, "notes": remarks, **values}))
    else:
        print(*table(found), *(f"  {line}" for line in remarks), sep="\n")
        print(*(f"wrote {path}\n" for path in written), sep="", end="")
    return 0 if listed else 1
