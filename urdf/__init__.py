"""The drape tool as URDF and sidecar, their generator, and how both are read."""

from importlib.resources import files
from pathlib import Path

from drapeplan.errors import InputError

__all__ = ["read_tool", "tool_names"]


def tool_names() -> list[str]:
    """Names of the tools that come with the package, sorted."""
    shipped = files("urdf").iterdir()
    return sorted(f.name[:-5] for f in shipped if f.name.endswith(".urdf"))


def read_tool(name_or_path: str | Path) -> tuple[str, str]:
    """Read the texts of a tool: its URDF and the sidecar YAML beside it.

    Args:
        name_or_path: A name from tool_names(), or the path of a URDF. Anything with a
            folder or the suffix .urdf in it is a path.

    Returns:
        Text of the URDF and text of the sidecar.

    Raises:
        InputError: The name is unknown, or one of the two files cannot be read.
    """
    path = Path(name_or_path)
    if path.suffix == ".urdf" or len(path.parts) > 1:
        return _read_file(path), _read_file(path.with_suffix(".yaml"))
    if str(name_or_path) not in tool_names():
        known = ", ".join(tool_names())
        problem = f"no tool is called {str(name_or_path)!r}"
        raise InputError("tool", "name", problem, f"use {known}, or the path of a URDF")
    shipped = files("urdf")
    texts = [shipped.joinpath(f"{path}{end}").read_text("utf-8") for end in ENDINGS]
    return texts[0], texts[1]


ENDINGS = (".urdf", ".yaml")


def _read_file(path: Path) -> str:
    """Text of a file, or an InputError that names it."""
    try:
        return path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        remedy = (
            "a tool is NAME.urdf with NAME.yaml beside it; drapeplan tool writes both"
        )
        raise InputError(str(path), "", f"cannot be read: {reason}", remedy) from error
