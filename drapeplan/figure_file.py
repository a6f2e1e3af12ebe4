"""Figure file: what all figures look like, and how one becomes a PNG."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drapeplan.files import write_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLAIN: dict[str, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same on every machine
    "axes.spines.top": False,
    "axes.spines.right": False,
}


def write_png(figure: Figure, path: Path) -> None:
    """Write the PNG, whole or not at all, without a date or a version inside.

    Args:
        figure: The figure; its style must still be in force.
        path: File to write.

    Raises:
        InputError: If the file cannot be written.
    """
    content = io.BytesIO()
    figure.savefig(content, format="png", metadata={"Software": None})
    write_bytes(path, content.getvalue())
