"""Makes the pictures of docs/preview.md: `make pictures`, with a Chromium installed."""

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).parent.parent
COLORS = 256  # of a palette: a third of the bytes, and no difference to be seen
SIZE = "1200x675"
SHOWN = {  # scene: camera preset and moments
    "panel": ("Iso", ("1", "3", "6")),
    "far_cup": ("Iso", ("0", "1", "pose=64")),
    "air_pocket": ("Top", ("2", "pose=52", "3")),
}


def drapeplan(*arguments: object) -> None:
    """Run the command line; a plan that is not good is one as well."""
    ended = subprocess.run([sys.executable, "-m", "drapeplan", *map(str, arguments)])
    if ended.returncode not in (0, 1):
        sys.exit(ended.returncode)


def main() -> None:
    """Plan each scene, take its pictures, and write them with fewer colors."""
    folder = ROOT / "docs" / "pictures"
    folder.mkdir(exist_ok=True)
    for old in folder.glob("*.png"):
        old.unlink()
    with tempfile.TemporaryDirectory() as build:
        for scene, (camera, moments) in SHOWN.items():
            plan, picture = (Path(build) / f"{scene}{end}" for end in (".json", ".png"))
            drapeplan("plan", ROOT / "examples" / f"{scene}.yaml", "-o", plan)
            asked = "--png", ",".join(moments), "--view", camera, "--size", SIZE
            drapeplan("preview", plan, "-o", picture, *asked)
        for file in sorted(Path(build).glob("*.png")):
            image = Image.open(file).convert("RGB")
            image = image.quantize(COLORS, Image.Quantize.FASTOCTREE)
            image.save(folder / file.name, optimize=True)


if __name__ == "__main__":
    main()
