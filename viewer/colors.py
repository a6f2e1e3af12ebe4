"""Colors of the preview, chosen to stay apart for color-blind readers."""

from typing import NamedTuple

import numpy as np

Array = np.ndarray

CIVIDIS = (
    (0, 34, 78),
    (0, 46, 106),
    (26, 56, 111),
    (50, 67, 109),
    (67, 78, 108),
    (83, 90, 109),
    (97, 101, 111),
    (111, 112, 115),
    (125, 124, 120),
    (140, 136, 120),
    (155, 148, 118),
    (171, 160, 114),
    (188, 174, 108),
    (205, 187, 99),
    (222, 201, 88),
    (240, 216, 70),
    (254, 232, 56),
)  # 17 anchors at equal distances along the map [Nunez2018]
PENETRATION = (204, 121, 167)  # Okabe-Ito reddish purple: not a color of Cividis


class CupState(NamedTuple):
    """How one state of a cup is shown: by color and, without color, by symbol."""

    name: str
    color: str
    symbol: str


CUP_STATES = (
    CupState("Holding, lifted", "#56B4E9", "○"),
    CupState("Landing", "#D55E00", "!"),
    CupState("Placed", "#009E73", "✓"),
    CupState("Released", "#8C8C8C", "–"),  # noqa: RUF001
)  # Okabe-Ito, in the order of the numbers in a plan


def cividis(count: int) -> Array:
    """Colors of the Cividis map at equal distances.

    Args:
        count: Number of colors, at least 2.

    Returns:
        Red, green and blue from 0 to 255, shape (count, 3), dtype uint8.
    """
    anchors = np.array(CIVIDIS, float)
    place = np.linspace(0, len(anchors) - 1, count)
    channels = [np.interp(place, np.arange(len(anchors)), c) for c in anchors.T]
    return np.rint(np.stack(channels, axis=-1)).astype(np.uint8)


def gap_colors() -> Array:
    """Table that turns a packed gap (see packing.pack_gap) into a color.

    Returns:
        Red, green and blue, shape (256, 3), dtype uint8: entry 0 marks penetration,
        entries 1 to 255 run from contact to the largest gap that the legend shows.
    """
    return np.vstack([np.array([PENETRATION], np.uint8), cividis(255)])
