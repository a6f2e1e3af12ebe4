import re
import shlex
from pathlib import Path

import pytest
import yaml

from drapeplan.cli import app

README = (Path(__file__).parent.parent / "README.md").read_text()
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", README, re.DOTALL)


def blocks(language):
    return [text for name, text in BLOCKS if name == language]


@pytest.mark.filterwarnings("error")
def test_the_first_plan_of_the_readme(tmp_path, monkeypatch):
    """Its scene and its commands, as they stand there."""
    monkeypatch.chdir(tmp_path)
    scene = blocks("yaml")[0]
    assert len(scene.splitlines()) <= 10
    assert yaml.safe_load(scene)
    Path("scene.yaml").write_text(scene)
    commands = [line for line in blocks("sh")[1].splitlines() if line]
    assert len(commands) == 3
    for command in commands:
        program, *arguments = shlex.split(command)
        assert program == "drapeplan"
        assert app(arguments, standalone_mode=False) == 0
    assert Path("first-touch.png").stat().st_size > 10_000
    assert Path("preview.html").stat().st_size > 1_000_000


def test_the_two_commands_are_targets_of_the_makefile():
    makefile = (Path(__file__).parent.parent / "Makefile").read_text()
    for line in blocks("sh")[0].splitlines():
        target = line.split()[1]
        assert re.search(rf"^{target}:", makefile, re.MULTILINE)


@pytest.mark.parametrize("command", re.findall(r"^\| `drapeplan (\w+)", README, re.M))
def test_commands_of_the_table_exist(command, capsys):
    app([command, "--help"], standalone_mode=False)
    assert "Usage" in capsys.readouterr().out


def test_pictures_exist():
    folder = Path(__file__).parent.parent
    for picture in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", README):
        assert (folder / picture).exists(), picture


def test_examples_of_the_table_exist():
    folder = Path(__file__).parent.parent / "examples"
    listed = set(re.findall(r"^\| `(\w+\.yaml)`", README, re.MULTILINE))
    assert listed == {path.name for path in folder.glob("*.yaml")}


def test_no_place_is_left_to_fill():
    assert not re.search(r"@[A-Z]+@", README)
