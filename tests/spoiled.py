"""A small plan made good, and the same spoiled by hand: a far cup and the rim first."""

import copy
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

from drapeplan.plan import Plan, document_hash
from drapeplan.planner import make_plan
from tests.plans import scene
from tests.settled import DOME, tool_section

FAR_CUP = 11  # the corner across from the cups that come first
PRESSED = 1.5e-3  # [m] more stroke of the far cup than it needs, at first
BORDER = (0, 1, 2, 3, 5, 6, 8, 9, 10, 11)  # of 4 rows and 3 columns


@lru_cache
def good_plan() -> Plan:
    """A plan of the small tool on the dome."""
    with TemporaryDirectory() as folder:
        tool = tool_section(folder)
        read = scene(DOME, tool=tool, fidelity="kinematic")
        return make_plan(read, Path(folder), "test").plan


@lru_cache
def spoiled_plan() -> Plan:
    """The far cup comes down right after the start cup, the rim stands five poses on.

    Cups that are put down have the legs of the wave's last pose, as the tool stands
    still; the far cup is pressed further at first.
    """
    made = copy.deepcopy(good_plan().document)
    waypoints = made["waypoints"]
    wave = [k for k, point in enumerate(waypoints) if point["phase"] == "wave"]
    last = waypoints[wave[-1]]
    for k in wave[1:]:
        far = k < wave[6]
        letters = list(waypoints[k]["cups"])
        for cup in (FAR_CUP,) if far else BORDER:
            legs = copy.copy(last["legs"][cup])
            legs[2] += PRESSED * far
            waypoints[k]["legs"][cup], waypoints[k]["strokes_m"][cup] = legs, legs[2]
            letters[cup] = "l" if far else "p"
        waypoints[k]["cups"] = "".join(letters)
    made["verdict"] = Plan(made).judged[0]
    made["hash"] = document_hash(made)
    return Plan(made)
