"""Makes the pictures of automata in the guides: as `mechviz shot` takes them, by headless Chromium.

python docs/make_shots.py [--to FOLDER] [NAME ...]
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping
from pathlib import Path

from typer.testing import CliRunner

import mechviz
from mechviz.commands.main import app
from mechviz.scene.scene import Scene

HERE = Path(__file__).parent / "images"
SIZE = (1000, 700)
ANGLES: Mapping[str, tuple[str, float]] = {  # [deg] of the drive, by picture and scene
    "word-writer": ("word-writer", 309.0),
    "draughtsman": ("draughtsman", 338.0),
    "writer-slides": ("", 352.0),
    "wave-machine": ("wave-machine", 45.0),
    "theatre": ("theatre", 100.0),
    "waving-figure": ("waving-figure", 60.0),
    "pecking-bird": ("pecking-bird", 150.0),
    "walking-toy": ("walking-toy-walks", 60.0),
}
FLOWER = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 140">
<path d="M50 22 C62 -8 80 6 62 32 C92 24 92 48 62 46 C80 72 62 84 50 54 C38 84 20 72 38 46 C8 48 8 24 38 32 C20 6 38 -8 50 22 Z"/>
<circle cx="50" cy="39" r="7"/>
<path d="M50 86 L50 134"/>
<path d="M50 126 C34 124 30 112 28 104 C40 104 48 112 50 126 C56 112 64 106 74 106 C72 116 66 124 50 126"/>
</svg>"""


def flower() -> Scene:
    """A machine of two crossed slides that draws a flower."""
    with tempfile.TemporaryDirectory() as folder:
        picture, scene = Path(folder) / "flower.svg", Path(folder) / "flower.toml"
        picture.write_text(FLOWER, encoding="utf-8")
        done = CliRunner().invoke(app, ["draw", str(picture), "-o", str(scene), "--slides"])
        if done.exit_code:
            raise SystemExit(done.output)
        return mechviz.load(scene)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(ANGLES)} [default: all]")
    parser.add_argument("--to", type=Path, default=HERE, metavar="FOLDER")
    chosen = parser.parse_args()
    chosen.to.mkdir(parents=True, exist_ok=True)
    for name in chosen.names or ANGLES:
        scene, angle = ANGLES[name]
        shown = mechviz.run(mechviz.load(scene) if scene else flower())
        print(shown.shot(chosen.to / f"{name}.png", angle=angle, size=SIZE), flush=True)


if __name__ == "__main__":
    main()
