"""Files are written whole or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from drapeplan.errors import InputError


def write_bytes(path: Path, content: bytes) -> None:
    """Write to a temporary file beside `path`, then rename it.

    Raises:
        InputError: If the folder cannot be made or written to.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    except OSError as error:
        raise InputError(
            str(path), "", f"cannot write it ({error.strerror})", "choose another place"
        ) from error
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        os.chmod(name, 0o644)
        os.replace(name, path)
    except OSError as error:
        os.unlink(name)
        raise InputError(
            str(path), "", f"cannot write it ({error.strerror})", "choose another place"
        ) from error


def write_text(path: Path, content: str) -> None:
    """Write text in UTF-8, whole or not at all."""
    write_bytes(path, content.encode("utf-8"))
