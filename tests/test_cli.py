"""The program from outside: exit codes, one clear line, whole files or none."""

import copy
import json
import os
import shutil
import subprocess
import sys
import time

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose

from drapeplan import cli
from drapeplan.files import write_text
from drapeplan.plan import document_hash
from tests.plans import BOWL, EXAMPLES, PARABOLOID, panel
from tests.settled import small_panel, tool_section

HELP_SECONDS = 1.0  # [s] of the processor; the aim is 0.4
PLAN_SECONDS = 30.0  # [s] of the processor, kernels compiled on the way; the aim is 15
PLAN_BYTES = 1e9  # [B] peak memory of a plan, which no load changes
ANCHORED = 1e-3  # [m] landed cup from its placement: nets drift along the wave
HEAVY = {"numpy", "scipy", "numba", "pinocchio", "pydantic", "yaml", "trimesh"}
HEAVY |= {"meshcat", "matplotlib", "qpsolvers", "osqp", "rich.progress", "viewer"}

pytestmark = pytest.mark.filterwarnings("error")  # a warning is a stray line
together = pytest.mark.xdist_group("panel")  # tests that share one plan


def unreadable(key, value, *words):
    """A case with one section, its code 2 and words of its line."""
    return pytest.param({key: value}, 2, words, id=f"{key} {words[0]}")


def surface(code, *words, **section):
    """A case with one mold surface."""
    return pytest.param(
        {"mold": {"surface": section}},
        code,
        words,
        id=" ".join(map(str, section.values())),
    )


LEANS = {"family": "rectangle_blend"}
FAR = {"surface": PARABOLOID, "position_m": [3.0, 0.0, 0.2]}
CASES = [
    unreadable("sequence", {"start": [8, 0]}, "sequence.start", "[8, 0]", "8 rows"),
    unreadable("sequence", {"start": [0, 6]}, "sequence.start", "columns 0-5"),
    unreadable("sequence", {"steps": [[[3, 2]]]}, "sequence.steps", "never placed"),
    unreadable("path", LEANS | {"toe_up_steps": [[99, 5]]}, "no step 99", "7 is last"),
    unreadable("path", LEANS | {"toe_up_steps": [[1, 5], [1, 6]]}, "twice"),
    unreadable("placement", {"cup": [8, 6]}, "placement.cup", "outside the tool"),
    unreadable("tool", {"name": "hand"}, "tool.name", "hand", "drape_tool_6x8"),
    unreadable("tool", {"urdf": "no.urdf"}, "no.urdf", "cannot be read"),
    unreadable("robot", {"name": "r2d2"}, "robot.name", "r2d2", "ur10"),
    unreadable("robot", {"name": "ur10", "home_rad": [0, 0]}, "home_rad", "6 joints"),
    unreadable("robot", {"name": "ur10", "home_rad": [9] * 6}, "home_rad", "limits"),
    unreadable("ply", {"take_up_mm": -0.1}, "ply.take_up_mm", "at least 0", "-0.1"),
    unreadable("ply", {"sample_mm": 7}, "ply.sample_mm", "7 mm", "divide"),
    unreadable("ply", {"overhang_mm": 1e6}, "ply.overhang_mm", "at most"),
    unreadable("ply", {"sample_mm": 2, "overhang_mm": 500}, "sample_mm", "points"),
    unreadable("motion", {"step_time_s": 1e-300}, "motion.step_time_s", "at least"),
    unreadable("placement", {"mold_point_m": [1e6, 0]}, "mold_point_m", "at most"),
    unreadable("mold", {"mesh": {"path": "no.stl", "unit": "mm"}}, "no.stl", "no such"),
    unreadable("mold", {"mesh": {"path": "", "unit": "mm"}}, "mold.mesh.path"),
    unreadable("mold", {"mesh": {"path": ".", "unit": "mm"}}, "format"),
    surface(2, "radius_m", "finite", "inf", kind="sphere", radius_m=float("inf")),
    surface(2, "radius_m", "finite", "nan", kind="sphere", radius_m=float("nan")),
    surface(2, "radius_m", "0.01 to 1e6", kind="sphere", radius_m=1e-300),
    surface(2, "radius_m", "0.01 to 1e6", kind="cylinder", radius_m=-1e300),
    surface(2, "relief", "at most", kind="kindrape", relief=1e300),
    surface(1, "cup", kind="sphere", radius_m=0.2),
    surface(1, "cup", kind="cylinder", radius_m=0.2),
    surface(1, "cup", kind="sphere", radius_m=-0.2),
    pytest.param(
        {"mold": FAR}, 1, ["wave: the arm stays short", "mm"], id="mold out of reach"
    ),
    pytest.param(
        {"pick": {"position_m": [0.0, 5.0, 0.2]}},
        1,
        ["pick: the arm stays short"],
        id="far pick",
    ),
]


@pytest.mark.parametrize(("sections", "code", "words"), CASES)
def test_bad_scene_gets_one_clear_line(drapeplan, write_scene, sections, code, words):
    refused(drapeplan, write_scene(**sections), code, words)


def test_short_fibers_get_one_clear_line(drapeplan, write_scene, tmp_path_factory):
    tight = {"kind": "paraboloid", "radius_x_m": 0.2, "radius_y_m": 0.2}
    tool = tool_section(tmp_path_factory.mktemp("tool"))
    scene = write_scene(mold={"surface": tight}, tool=tool)
    refused(drapeplan, scene, 1, ["a fiber between cup (", "too short"])


def refused(drapeplan, scene, code, words):
    """A scene alone in its folder ends in one line, and nothing is written."""
    folder = scene.parent
    ended = drapeplan("plan", scene, "-o", folder / "out" / "plan.json")
    assert ended.code == code, ended.err
    assert ended.line.startswith("not drapable: " if code == 1 else "error: ")
    assert all(word in ended.line for word in words), ended.line
    assert "Traceback" not in ended.err
    if code == 2:
        assert len(ended.err.splitlines()) == 1
        assert str(folder) in ended.line  # names the file
    assert ended.out == ""
    assert sorted(folder.iterdir()) == [scene]  # nothing left over


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["holds no keys"]),
        ("hello", ["holds no keys"]),
        ("a: [1", ["line"]),
        ("\x00\x01", ["not YAML"]),
        ("seed: 1\nseed: 2", ["line 2", "'seed'", "twice"]),
        ("mold: {surface: {kind: sphere, radius_m: yes}}", ["radius_m", "'yes'"]),
        ("mold: &m {surface: *m}", ["mold.surface", "kind"]),
        ("? [1, 2]\n: 3", ["line", "unhashable"]),
    ],
)
def test_text_that_is_no_scene(drapeplan, tmp_path, text, words):
    scene, output = tmp_path / "scene.yaml", tmp_path / "plan.json"
    header = "format: drapeplan-scene/1\n" if text.startswith("mold") else ""
    scene.write_text(header + text, encoding="utf-8")
    ended = drapeplan("plan", scene, "-o", output)
    assert (ended.code, ended.out, ended.err.count("\n")) == (2, "", 1), ended.err
    assert all(word in ended.err for word in [str(scene), *words]), ended.err
    assert not output.exists()


@pytest.mark.parametrize(
    ("factor", "unit", "remedy"), [(1e-3, "mm", "m"), (1, "m", "mm")]
)
def test_mesh_in_another_unit(drapeplan, write_scene, tmp_path, factor, unit, remedy):
    """A mesh in meters read as mm, and one in mm read as m."""
    mesh = trimesh.load_mesh(EXAMPLES / "molds" / "panel.stl")
    mesh.apply_scale(factor)
    mesh.export(tmp_path / "mold.stl")
    scene = write_scene(mold={"mesh": {"path": "mold.stl", "unit": unit}})
    ended = drapeplan("plan", scene, "-o", tmp_path / "plan.json")
    assert (ended.code, ended.err.count("\n")) == (2, 1)
    assert f"set mold.mesh.unit: {remedy}\n" in ended.err
    assert not (tmp_path / "plan.json").exists()


def test_hover_too_low_over_a_bowl_penetrates(drapeplan, write_scene, tmp_path):
    scene = write_scene(
        mold={"surface": BOWL},
        tool=tool_section(tmp_path),
        path={"family": "hover", "height_mm": 5.0},
        fidelity="kinematic",
    )
    output = tmp_path / "plan.json"
    ended = drapeplan("plan", scene, "-o", output)
    assert (ended.code, ended.err) == (1, "")
    assert ended.out.startswith("not good")
    assert "into the mold near cup (" in ended.out
    assert json.loads(output.read_text())["verdict"]["good"] is False
    assert drapeplan("check", output).code == 1


@pytest.mark.parametrize(
    ("command", "output", "words"),
    [
        (["plan", EXAMPLES / "panel.yaml", "-o"], "folder", ["folder"]),
        (["plan", EXAMPLES / "panel.yaml", "-o"], "file/plan.json", ["is no folder"]),
        (["plan", EXAMPLES / "panel.yaml", "-o"], "a" * 300, ["too long"]),
        (
            ["plan", EXAMPLES / "panel.yaml", "-o", "x", "--figure"],
            "folder",
            ["folder"],
        ),
        (["preview", "file", "-o"], "folder", ["folder"]),
        (["preview", "file", "-o"], "file", ["replace"]),
        (["shape", "file", "-o"], "file", ["replace"]),
        (["tool", "-o"], "file", ["cannot write it"]),
    ],
)
def test_output_that_cannot_be_is_refused_before_the_work(
    drapeplan, tmp_path, monkeypatch, command, output, words
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("kept")
    start = time.perf_counter()
    ended = drapeplan(*command, output)
    assert time.perf_counter() - start < PLAN_SECONDS / 10
    assert (ended.code, ended.out, ended.err.count("\n")) == (2, "", 1), ended.err
    assert all(word in ended.err for word in words), ended.err
    assert (tmp_path / "file").read_text() == "kept"
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["file", "folder"]


def test_scene_is_not_overwritten_by_its_plan(drapeplan, write_scene):
    scene = write_scene()
    before = scene.read_text()
    ended = drapeplan("plan", scene, "-o", scene)
    assert ended.code == 2
    assert "would replace" in ended.err
    assert scene.read_text() == before


def test_links_are_followed_and_pipes_written_as_they_stand(tmp_path):
    target, link = tmp_path / "there" / "a.txt", tmp_path / "b.txt"
    target.parent.mkdir()
    link.symlink_to(target)
    write_text(link, "new")
    assert link.is_symlink()
    assert target.read_text() == "new"
    reader, writer = os.pipe()
    write_text(tmp_path.__class__(f"/dev/fd/{writer}"), "piped")
    os.close(writer)
    with os.fdopen(reader) as pipe:
        assert pipe.read() == "piped"
    assert [path.name for path in target.parent.iterdir()] == ["a.txt"]


@pytest.mark.parametrize("command", ["check", "preview"])
@pytest.mark.parametrize(
    "text", ["", "[]", "null", "{}", '{"format": "drapeplan-plan/2"}', "\udcff"]
)
def test_file_that_is_no_plan(drapeplan, tmp_path, command, text):
    path, output = tmp_path / "plan.json", tmp_path / "page.html"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    ended = drapeplan(command, path, *(["-o", output] * (command == "preview")))
    assert (ended.code, ended.out, ended.err.count("\n")) == (2, "", 1), ended.err
    assert str(path) in ended.err
    assert not output.exists()


FLAT = {
    "format": "drapeplan-cups/1",
    "grid": {"rows": 1, "columns": 2, "pitch_mm": 110.0, "half_width_mm": 20.0},
    "cups": [
        {
            "row": 0,
            "column": j,
            "position_mm": [109.0 * j, 0.0, 0.0],
            "rotation": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        }
        for j in (0, 1)
    ],
}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"cups": FLAT["cups"][:1]}, ["1 of 2 cups", "column 1"]),
        ({"cups": FLAT["cups"][:1] * 2}, ["stands in cups[0] already"]),
        ({"format": "drapeplan-cups/9"}, ["format"]),
        ({"grid": {**FLAT["grid"], "half_width_mm": 60.0}}, ["grid.half_width_mm"]),
        ({"grid": {**FLAT["grid"], "rows": -1}}, ["grid.rows"]),
    ],
)
def test_cups_file_with_a_mistake(drapeplan, tmp_path, change, words):
    path, output = tmp_path / "cups.json", tmp_path / "shape.csv"
    path.write_text(json.dumps({**FLAT, **change}))
    ended = drapeplan("shape", path, "-o", output)
    assert (ended.code, ended.out, ended.err.count("\n")) == (2, "", 1), ended.err
    assert all(word in ended.err for word in [str(path), *words]), ended.err
    assert not output.exists()


def test_shape_of_cups(drapeplan, tmp_path):
    """One mm of slack between level cups: written, and the open side is told."""
    path, output = tmp_path / "cups.json", tmp_path / "shape.csv"
    path.write_text(json.dumps(FLAT))
    ended = drapeplan("shape", path, "-o", output, "--step-mm", 10)
    assert (ended.code, ended.err) == (1, "")
    assert "1 mm of slack" in ended.out
    assert "{" not in ended.out
    table = output.read_text().splitlines()
    assert table[0] == "s_mm,t_mm,x_mm,y_mm,z_mm"
    assert len(table) == 1 + 16 * 5
    auto = ["--model", "auto", "--alternatives", 2]
    ended = drapeplan("shape", path, "-o", output, *auto)
    assert ended.code == 1
    assert "coupled: strip (0, 0): slack lets a strip bulge" in ended.out
    assert "gravity sag" in ended.out
    assert output.with_name("shape.alt1.csv").exists()
    ended = drapeplan("shape", path, "-o", output, "--model", "cubic", "--json")
    assert ended.document["good"] is (ended.code == 0)
    assert drapeplan("shape", path, "-o", output, "--model", "magic").code == 2
    ended = drapeplan("shape", path, "-o", output, "--step-mm", "1e-3")
    assert ended.code == 2
    assert "--step-mm" in ended.err


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["plan"], "SCENE"),
        (["plan", "a.yaml"], "output"),
        (["plan", "a.yaml", "-o", "b", "--seed", "x"], "--seed"),
        (["plan", "a.yaml", "-o", "b", "--nope"], "--nope"),
        (["fly"], "fly"),
        (["schema", "fly"], "fly"),
        (["tool", "-o", ".", "--rows", "1"], "rows"),
        (["tool", "-o", ".", "--pitch-mm", "1e300"], "--pitch-mm"),
        (["tool", "-o", ".", "--name", "../up"], "../up"),
    ],
)
def test_usage_errors(drapeplan, tmp_path, monkeypatch, arguments, word):
    monkeypatch.chdir(tmp_path)
    ended = drapeplan(*arguments)
    assert (ended.code, ended.out) == (2, "")
    assert word in ended.err.splitlines()[-1]
    assert "Traceback" not in ended.err
    assert list(tmp_path.iterdir()) == []


def test_negative_seed(drapeplan, write_scene, tmp_path):
    ended = drapeplan("plan", write_scene(), "-o", tmp_path / "p", "--seed", "-1")
    assert (ended.code, ended.err.count("\n")) == (2, 1)
    assert "--seed" in ended.err


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["plan", "no.yaml", "-o", "x.json"], 2),
        (["plan", "no.yaml", "--nope"], 2),
        (["check", "no.json"], 2),
        (["preview", "no.json", "-o", "x.html"], 2),
        (["shape", "no.json", "-o", "x.csv"], 2),
        (["tool", "-o", "x", "--rows", "0"], 2),
    ],
)
def test_json_is_one_document_for_errors_too(
    drapeplan, tmp_path, monkeypatch, arguments, code
):
    monkeypatch.chdir(tmp_path)
    ended = drapeplan(*arguments, "--json")
    assert ended.code == code
    assert ended.document["good"] is False
    assert ended.document["exit_code"] == code
    assert ended.document["error"] in ended.err


def test_bug_is_neither_a_no_nor_bad_input(drapeplan, monkeypatch, write_scene):
    """Exit codes 1 and 2 are answers; a traceback must not look like one."""

    def broken(path):
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr("drapeplan.commands_plan.read_scene", broken)
    ended = drapeplan("plan", write_scene(), "-o", "x.json", "--json")
    assert ended.code == cli.BUG
    assert ended.code not in (0, 1, 2)
    assert "Traceback" in ended.err
    assert ended.document["error"] == "ZeroDivisionError: a bug"


def test_tool_of_another_size_is_planned(drapeplan, write_scene, tmp_path):
    """A 3 x 4 tool, in a folder that the scene names relative to itself."""
    ended = drapeplan(
        *("tool", "-o", tmp_path / "tools", "--name", "small"),
        *("--rows", 4, "--columns", 3, "--json"),
    )
    assert ended.code == 0
    assert [path.split("/")[-1] for path in ended.document["written"]] == [
        "small.urdf",
        "small.yaml",
    ]
    folder = tmp_path / "Szenen ü"
    folder.mkdir()
    tool = {"urdf": "../tools/small.urdf"}
    scene = write_scene(folder, tool=tool, fidelity="kinematic")
    output, figure = tmp_path / "new" / "plan ü.json", tmp_path / "new" / "touch.png"
    ended = drapeplan("plan", scene, "-o", output, "--figure", figure, "--json")
    assert (ended.code, ended.err) == (0, "")
    assert ended.document["written"] == [str(output), str(figure)]
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert len(json.loads(output.read_text())["waypoints"][0]["cups"]) == 12
    shutil.rmtree(tmp_path / "tools")  # a plan is complete in itself
    assert drapeplan("check", output).code == 0
    page = tmp_path / "new" / "page.html"
    ended = drapeplan("preview", output, "-o", page, "--json")
    assert ended.document["written"] == [str(page)]
    assert "<html" in page.read_text(encoding="utf-8")[:500]
    left = sorted(path.name for path in (tmp_path / "new").iterdir())
    assert left == ["page.html", "plan ü.json", "touch.png"]


@pytest.mark.parametrize("warp_deg", [0.0, 120.0])
def test_ply_hung_from_its_corner_cup(drapeplan, write_scene, tmp_path, warp_deg):
    """An analytic mold reaches around the ply wherever a placement puts it."""
    turn = np.radians(warp_deg)
    corner = np.array([-1.0, -1.5]) * 0.11  # [m] of cup (0, 0) from the ply's middle
    x, y = (
        np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ corner
    )
    placement = {"cup": [0, 0], "mold_point_m": [float(x), float(y)]}
    placement["warp_deg"] = warp_deg
    tool = tool_section(tmp_path)
    scene = write_scene(placement=placement, tool=tool, fidelity="kinematic")
    output = tmp_path / "plan.json"
    ended = drapeplan("plan", scene, "-o", output)
    assert (ended.code, ended.err) == (0, "")
    landed = json.loads(output.read_text())["targets"]["position_m"][0]
    assert_allclose(landed[:2], [x, y], rtol=0, atol=ANCHORED)


@pytest.mark.xdist_group("small panel")  # tests that share that plan
@pytest.mark.parametrize("key", ["mold", "waypoints", "targets", "verdict"])
def test_preview_of_parts_that_do_not_fit(drapeplan, tmp_path, key):
    document = copy.deepcopy(small_panel().plan.document)
    if key == "waypoints":
        document[key] = document[key][:1]
    elif key == "targets":
        document[key]["position_m"].pop()
    else:
        document[key] = {}
    if key != "verdict":  # its hash is left as it was
        document["hash"] = document_hash(document)
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(document))
    ended = drapeplan("preview", path, "-o", tmp_path / "page.html")
    assert ("hash" in ended.err) == (key == "verdict")
    assert (ended.code, ended.err.count("\n")) == (2, 1), ended.err
    assert "drapeplan check" in ended.err
    assert not (tmp_path / "page.html").exists()
    assert drapeplan("check", path).code == 1


@together
def test_panel_in_time_and_memory(panel_run):
    assert panel_run.code == 0, panel_run.err
    assert panel_run.err == ""
    assert panel_run.out.startswith("good\n")
    assert panel_run.out.endswith(f"wrote {panel_run.file}\n")
    assert panel_run.seconds < PLAN_SECONDS
    assert panel_run.peak_bytes < PLAN_BYTES


@together
def test_same_bytes_twice(panel_run, tmp_path):
    """In a process of its own and in this one, whose hashes have another seed."""
    panel().plan.write(tmp_path / "plan.json")
    assert (tmp_path / "plan.json").read_bytes() == panel_run.file.read_bytes()


@together
def test_check_and_preview_of_the_panel(drapeplan, panel_run, tmp_path):
    """The picture is made from the plan alone, and the plan is left as it is."""
    before, figure = panel_run.file.read_bytes(), tmp_path / "new" / "touch.png"
    ended = drapeplan("check", panel_run.file, "--figure", figure, "--json")
    assert (ended.code, ended.err) == (0, "")
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert panel_run.file.read_bytes() == before
    found = ended.document
    assert found["good"]
    assert found["broken"] == found["differing"] == found["violated"] == []
    page = tmp_path / "page.html"
    ended = drapeplan("preview", panel_run.file, "-o", page)
    assert (ended.code, ended.out, ended.err) == (0, f"wrote {page}\n", "")
    assert page.stat().st_size > 100_000


@pytest.mark.parametrize("what", ["scene", "plan", "cups", "measurements"])
def test_schema(drapeplan, what):
    ended = drapeplan("schema", what)
    assert ended.code == 0
    assert ended.document["properties"]["format"]["const"] == f"drapeplan-{what}/1"


def test_help_loads_nothing_heavy_and_is_quick():
    script = (
        "import sys; sys.argv = ['drapeplan', '--help']\n"
        "from drapeplan.cli import main\n"
        "try:\n    main()\n"
        "except SystemExit as stop:\n    assert stop.code == 0\n"
        "print(*sys.modules, file=sys.stderr)"
    )
    command = [sys.executable, "-c", script]
    before = sum(os.times()[2:4])
    ended = subprocess.run(command, capture_output=True, text=True, check=True)
    assert sum(os.times()[2:4]) - before < HELP_SECONDS
    assert "preview" in ended.stdout
    assert not HEAVY & set(ended.stderr.split())


def test_reader_that_leaves_early():
    """As with `| head`: no traceback, no complaint at exit."""
    command = [sys.executable, "-m", "drapeplan", "schema"]
    reader, writer = os.pipe()
    os.close(reader)
    ended = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True)
    os.close(writer)
    assert (ended.returncode, ended.stderr) == (141, "")


def test_freely_given_steps_plan_with_the_default_path(
    drapeplan, write_scene, tmp_path
):
    """They hover and are pressed down: the start cup by its own stroke."""
    start = np.array([1, 1])
    cups = np.stack(np.divmod(np.arange(12), 3), axis=1)
    ring = np.abs(cups - start).max(axis=1)
    steps = [cups[ring == k].tolist() for k in range(ring.max() + 1)]
    tool = tool_section(tmp_path)
    scene = write_scene(sequence={"steps": steps}, tool=tool, fidelity="kinematic")
    ended = drapeplan("plan", scene, "-o", tmp_path / "plan.json")
    assert (ended.code, ended.err) == (0, "")
    waypoints = json.loads((tmp_path / "plan.json").read_text())["waypoints"]
    phases = [waypoint["phase"] for waypoint in waypoints]
    assert phases.index("approach") < phases.index("preshape")  # it arrives flat


def test_options_of_the_samples_ask_for_samples(drapeplan, tmp_path):
    ended = drapeplan("check", tmp_path / "plan.json", "--seed", "3")
    assert ended.code == 2
    assert "add --robustness N" in ended.err
