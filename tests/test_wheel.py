"""A wheel built from the checkout works where there is no checkout."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("drapeplan", "ply", "urdf", "viewer")
SCENE = """\
format: drapeplan-scene/1
mold: {surface: {kind: paraboloid, radius_x_m: 1.2, radius_y_m: 2.5}}
tool: {urdf: small.urdf}
fidelity: kinematic
"""
PLACES = """\
import drapeplan.planner, ply, urdf, viewer.page
for module in (drapeplan, ply, urdf, viewer):
    print(module.__file__)
texts = urdf.read_tool("drape_tool_6x8")
assert texts[0].startswith("<?xml") or "<robot" in texts[0]
assert urdf.tool_names() == ["drape_tool_6x8", "drape_tool_6x8_resilient"]
"""
COMMANDS = """\
from drapeplan.cli import app
for command in (
    "tool -o . --name small --rows 4 --columns 3",
    "plan scene.yaml -o plan.json --figure touch.png",
    "check plan.json",
    "preview plan.json -o page.html",
):
    assert app(command.split(), standalone_mode=False) == 0, command
"""

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("wheel")]


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The wheel, unpacked."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation"]
    subprocess.run(
        [*command, "--outdir", str(folder), str(ROOT)], check=True, capture_output=True
    )
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


@pytest.fixture
def python(installed, tmp_path):
    """Run Python in another folder, with the wheel and without the checkout.

    -S leaves out the .pth files, one of which leads to the checkout; what the others
    lead to is taken from this process's path.
    """
    others = [p for p in sys.path if "site-packages" in p and Path(p).is_dir()]
    path = os.pathsep.join([str(installed), *others])
    kept = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}

    def run(*arguments):
        return subprocess.run(
            [sys.executable, "-S", "-P", *map(str, arguments)],
            env={**kept, "PYTHONPATH": path},
            cwd=tmp_path,
            capture_output=True,
            text=True,
        )

    return run


def test_wheel_holds_what_is_needed_and_no_more(installed):
    shipped = {path.name for path in installed.iterdir()}
    assert {name for name in shipped if "dist-info" not in name} == set(PACKAGES)
    for package in PACKAGES:
        for path in (ROOT / package).iterdir():
            if path.is_file():
                assert (installed / package / path.name).is_file(), path


def test_modules_come_from_the_wheel(python, installed):
    ended = python("-c", PLACES)
    assert ended.returncode == 0, ended.stderr
    for line in ended.stdout.splitlines():
        assert Path(line).is_relative_to(installed)


def test_plan_check_and_preview_away_from_the_checkout(python, tmp_path):
    (tmp_path / "scene.yaml").write_text(SCENE)
    ended = python("-c", COMMANDS)
    assert (ended.returncode, ended.stderr) == (0, "")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "<html" in page[:500]
    assert str(ROOT) not in page
    assert str(ROOT) not in (tmp_path / "plan.json").read_text()
