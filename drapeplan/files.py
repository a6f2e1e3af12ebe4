"""Files are written whole or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from drapeplan.errors import InputError


def write_bytes(path: Path, content: bytes) -> None:
    """Write to a temporary file beside `path`, then rename it.

    A link is followed, so what it points to changes; a device or pipe is written as it
    stands.

    Raises:
        InputError: If the folder cannot be made or written to.
    """
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            path.write_bytes(content)
            return
        path = path.resolve()
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=".new.", dir=path.parent)
    except OSError as error:
        raise unwritable(path, error) from error
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        os.chmod(name, 0o644)
        os.replace(name, path)
    except OSError as error:
        os.unlink(name)
        raise unwritable(path, error) from error


def write_text(path: Path, content: str) -> None:
    """Write text in UTF-8, whole or not at all."""
    write_bytes(path, content.encode("utf-8"))


def read_text(source: str, remedy: str) -> str:
    """Text of a file in UTF-8, with or without a byte order mark.

    Args:
        source: The file.
        remedy: What to do where it is no text.

    Raises:
        InputError: There is no such file, it cannot be read, or it is no text.
    """
    try:
        return Path(source).read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(source, "", "no such file", "check the path") from None
    except OSError as error:
        problem = f"cannot be read ({error.strerror})"
        raise InputError(source, "", problem, "check the path") from None
    except UnicodeDecodeError:
        raise InputError(source, "", "is no text", remedy) from None


def check_outputs(outputs: list[Path], inputs: list[Path]) -> None:
    """Refuse, before any work, outputs that cannot be written or would do harm.

    Args:
        outputs: Files to write.
        inputs: Files that the work reads, which no output may replace.

    Raises:
        InputError: If an output is a folder, lies below a file or in a folder that
            takes none, or is an input or another output.
    """
    taken = {path.resolve() for path in inputs}
    for path in outputs:
        try:
            if path.is_dir():
                raise IsADirectoryError(21, "it is a folder")
            _check_folder(path.parent)
            plain = path.is_file() or not path.exists()
        except OSError as error:
            raise unwritable(path, error) from error
        if plain and path.resolve() in taken:
            problem = "would replace a file of the same command"
            raise InputError(str(path), "", problem, "choose another name")
        taken.add(path.resolve())


def _check_folder(folder: Path) -> None:
    """See that files can be made in a folder, or in the nearest that exists above."""
    folder = folder.absolute()
    while not folder.exists():
        folder = folder.parent
    if not folder.is_dir():
        raise NotADirectoryError(20, f"{folder} is no folder")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(13, f"no permission in {folder}")


def unwritable(path: Path, error: OSError) -> InputError:
    """The one line of a file that cannot be written."""
    problem = f"cannot write it ({error.strerror})"
    return InputError(str(path), "", problem, "choose another place")
