"""Who may import whom: the architecture, held by reading the imports."""

import ast
import re
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest

import ply

ROOT = Path(__file__).parent.parent
OURS = ("drapeplan", "ply", "urdf", "viewer")
LONGEST = 350  # [lines] of a module; past it a second idea hides inside
ANYWHERE = {"numpy", "scipy", "numba"}  # below the planner
HOMES = {
    "pinocchio": {"drapeplan.robot", "drapeplan.visuals"},  # kinematics; arm's meshes
    "coal": {"drapeplan.solids", "drapeplan.body_pairs"},  # convex bodies; distances
    "qpsolvers": {"drapeplan.qp"},
    "osqp": {"drapeplan.qp"},
    "trimesh": {
        *("drapeplan.mesh", "drapeplan.visuals"),  # mold meshes; arm's meshes
        "drapeplan.scan",  # PLY scans
    },
    "pydantic": {
        *(
            "drapeplan.section",
            "drapeplan.families",
            "drapeplan.orders",
        ),  # parts of the scene
        *("drapeplan.scene", "drapeplan.plan_file", "drapeplan.cups_file"),  # formats
        *("drapeplan.reading", "drapeplan.plan"),  # pydantic's findings in one line
        "drapeplan.identify_file",  # measurements
    },
    "yaml": {
        *("drapeplan.reading", "urdf.sidecar", "urdf.generate"),
        *("drapeplan.identify_scene", "drapeplan.scene_text"),  # brought up to date
    },
    "meshcat": {"viewer.page"},  # its script, by package metadata
    "umsgpack": {"viewer.objects"},  # meshcat's message format
    "typer": {"drapeplan.cli", "drapeplan.cli_options", "drapeplan.cli_learning"},
    "rich": {"drapeplan.console", "drapeplan.ranking_words"},
    "matplotlib": {
        *("drapeplan.report", "drapeplan.report_validate"),
        *("drapeplan.report_robustness", "drapeplan.report_identify"),
        *("drapeplan.report_ranking", "drapeplan.figure_file"),
    },
    "loky": {"drapeplan.engine"},
    "cloudpickle": {"drapeplan.engine"},
    "distributed": {"drapeplan.engine"},  # where a cluster is asked for
    "cma": {"drapeplan.tune"},
    "pyarrow": {"drapeplan.rollout_file"},
    "sklearn": {"drapeplan.surrogate"},  # where a surrogate is asked for
}
BY_NAME = {  # dependencies that no import shows
    "example-robot-data": "urdf.arm",  # data, found through package metadata
    "osqp": "drapeplan.qp",  # a solver of qpsolvers
    "embreex": "drapeplan.mesh",  # the ray tracer of trimesh
    "meshcat": "viewer.page",  # its script
    "pycollada": "drapeplan.visuals",  # how trimesh reads the arm's meshes
}
IMPORTED_AS = {"pin": "pinocchio", "pyyaml": "yaml", "scikit-learn": "sklearn"}
EXTRAS = ("cluster", "learn")  # imported where asked for; installed by who asks
BROUGHT = {"umsgpack", "coal"}  # by meshcat; by pin
GEOMETRY = (
    *("mold", "mesh", "surfaces", "links", "geodesic", "net", "shear"),
    *("orient", "distance_grid", "overhang"),
)
MACHINE = ("robot", "legs", "closures", "inverse", "track")


def name_of(path):
    """Dotted name of a module."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {
    name_of(path): path
    for folder in OURS
    for path in sorted((ROOT / folder).glob("*.py"))
}


def imports_in(tree):
    """Modules that a syntax tree imports, `from a import b` as both a and a.b."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports hide who imports whom"
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def for_types_alone(node):
    """Whether a statement is `if TYPE_CHECKING:`."""
    return isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"


@cache
def imports(name, at_start=False):
    """Imports of a module; at_start: those alone that run when it is imported."""
    tree = ast.parse(MODULES[name].read_text(encoding="utf-8"))
    if at_start:
        functions = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
        body = [n for n in tree.body if not isinstance(n, functions)]
        tree = ast.Module([n for n in body if not for_types_alone(n)], [])
    found = set(imports_in(tree))
    return frozenset(f for f in found if "." not in f or f in MODULES or not ours(f))


def ours(name):
    """Whether a dotted name lies in one of our packages."""
    return name.split(".")[0] in OURS


def foreign(name):
    """Foreign packages that a module imports."""
    tops = {found.split(".")[0] for found in imports(name)}
    return tops - set(OURS) - set(sys.stdlib_module_names)


def reached(name):
    """Our modules that come with a module when it is imported."""
    seen, todo = set(), [name]
    while todo:
        found = {f for f in imports(todo.pop(), at_start=True) if f in MODULES}
        todo += found - seen
        seen |= found
    return seen


def test_reader_sees_the_imports():
    """The tests below say nothing if the reading fails."""
    assert {"drapeplan.robot", "numpy"} <= imports("drapeplan.closures")
    assert "viewer.page" in imports("drapeplan.commands_preview")
    assert "viewer.page" not in imports("drapeplan.commands_preview", at_start=True)
    assert "drapeplan.surfaces" in reached("drapeplan.net")
    assert len(MODULES) > 40


def test_ply_needs_numpy_alone():
    for name in (n for n in MODULES if n.split(".")[0] == "ply"):
        assert foreign(name) <= {"numpy"}, name
        tops = {found.split(".")[0] for found in imports(name) if ours(found)}
        assert tops <= {"ply"}, name


def test_ply_is_ours():
    """Python Lex-Yacc is called ply too."""
    assert Path(ply.__file__).parent == ROOT / "ply"


@pytest.mark.parametrize("name", GEOMETRY)
def test_mold_and_net_know_no_robot_and_no_ply(name):
    found = reached(f"drapeplan.{name}")
    assert not found & {f"drapeplan.{other}" for other in MACHINE}
    assert not any(module.split(".")[0] in ("ply", "urdf") for module in found)


@pytest.mark.parametrize("name", ["robot", "legs", "closures", "inverse"])
def test_robot_knows_no_mold_and_no_ply(name):
    found = reached(f"drapeplan.{name}")
    assert not found & {f"drapeplan.{other}" for other in GEOMETRY}
    assert not any(module.split(".")[0] == "ply" for module in found)


def test_viewer_is_for_the_command_line_alone_and_late():
    users = {"drapeplan.commands_preview", "drapeplan.commands_live"}
    for name in (n for n in MODULES if n.split(".")[0] != "viewer"):
        used = {found for found in imports(name) if found.split(".")[0] == "viewer"}
        assert not used or name in users, name
        assert not used & imports(name, at_start=True), name


def test_planner_is_for_the_command_line_and_the_check():
    users = {"drapeplan.commands_plan", "drapeplan.commands_live"}
    users |= {"drapeplan.console", "drapeplan.check"}
    users |= {"drapeplan.commands_tune", "drapeplan.trial"}  # plans many paths
    users |= {"drapeplan.ranking"}  # plans many sequences
    for name in MODULES:
        assert name in users or "drapeplan.planner" not in imports(name), name
        if name != "drapeplan.__main__":
            assert "drapeplan.cli" not in imports(name), name


def test_foreign_packages_stay_in_their_homes():
    for name in MODULES:
        for package in foreign(name) - ANYWHERE:
            assert package in HOMES, f"{package} has no home yet: name one, and say why"
            assert name in HOMES[package], f"{package} belongs in {HOMES[package]}"


def test_homes_are_lived_in():
    """A home that is left is struck from the list."""
    for package, homes in HOMES.items():
        for name in homes:
            if package not in foreign(name):
                text = MODULES[name].read_text(encoding="utf-8")
                assert package in text, f"{name} does not use {package}"


def test_every_dependency_is_used():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    needed = [re.split(r"[<>=~]", d)[0] for d in project["project"]["dependencies"]]
    used = set().union(*(foreign(name) for name in MODULES))
    for package in needed:
        if package not in BY_NAME:
            assert IMPORTED_AS.get(package, package) in used, f"nothing uses {package}"
    assert set(BY_NAME) <= set(needed)
    optional = project["project"]["optional-dependencies"]
    needed += [re.split(r"[<>=~]", d)[0] for extra in EXTRAS for d in optional[extra]]
    for package in used - BROUGHT:
        names = {package, *(k for k, v in IMPORTED_AS.items() if v == package)}
        assert names & set(needed), f"{package} is imported and not declared"


def test_nothing_imports_tests_or_benchmarks():
    for name in MODULES:
        tops = {found.split(".")[0] for found in imports(name)}
        assert not tops & {"tests", "benchmarks"}, name


def test_modules_stay_short():
    lines = {n: f.read_text(encoding="utf-8").count("\n") for n, f in MODULES.items()}
    assert {name for name, count in lines.items() if count > LONGEST} == set()


def test_no_module_comes_back_to_itself():
    """No cycles, wherever an import stands; packages' own __init__ aside."""
    for name in MODULES:
        seen, todo = set(), [name]
        while todo:
            found = {f for f in imports(todo.pop()) if f in MODULES and f not in OURS}
            todo += found - seen
            seen |= found
        assert name not in seen, name
