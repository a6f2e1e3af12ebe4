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
VIRIDIS = (
    (68, 1, 84),
    (72, 24, 106),
    (71, 45, 123),
    (66, 64, 134),
    (59, 82, 139),
    (51, 99, 141),
    (44, 114, 142),
    (38, 130, 142),
    (33, 145, 140),
    (31, 160, 136),
    (40, 174, 128),
    (63, 188, 115),
    (94, 201, 98),
    (132, 212, 75),
    (173, 220, 48),
    (216, 226, 25),
    (253, 231, 37),
)  # likewise [van der Walt and Smith, 2015]
MAPS = {"Cividis": CIVIDIS, "Viridis": VIRIDIS}  # both rise evenly in lightness
PENETRATION = (255, 0, 255)  # magenta: far from both maps for every kind of sight


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


def gap_colors(name: str = "Cividis") -> Array:
    """Table that turns a packed gap (see packing.pack_gap) into a color.

    Args:
        name: One of MAPS.

    Returns:
        Red, green and blue, shape (256, 3), dtype uint8: entry 0 marks penetration,
        entries 1 to 255 run from contact to the largest gap that the legend shows.
    """
    anchors = np.array(MAPS[name], float)
    place = np.linspace(0, len(anchors) - 1, 255)
    channels = [np.interp(place, np.arange(len(anchors)), c) for c in anchors.T]
    scale = np.rint(np.stack(channels, axis=-1)).astype(np.uint8)
    return np.vstack([np.array([PENETRATION], np.uint8), scale])
