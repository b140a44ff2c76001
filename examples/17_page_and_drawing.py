"""A page that plays in any browser without a network, and a drawing to scale; both from a run or from a recording."""

import sys
import tempfile
from pathlib import Path

import mechviz as mv

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())

run = mv.run("slider-crank-engine", frames=90)
page = run.share(folder / "engine.html")
drawing = run.shot(folder / "engine.svg", angle=60)  # .png shows the solids; that needs Chromium
print(f"{page.name}: {page.stat().st_size / 1e6:.2f} MB, {drawing.name}: {drawing.stat().st_size / 1e3:.0f} kB")

# run.view() shows the same in the browser, to look at and to edit, until Ctrl-C
