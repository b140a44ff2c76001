"""How the page draws where there is no graphics card: lightly while something moves, as well as it can at rest.

Browsers then draw by software, and of a picture of our scenes most of the time goes into the four samples of each pixel that smooth
the edges. So while something moves the page draws with one sample a pixel, with fewer pixels where the window is so large that
this is what takes long, and scenes of many bodies with fewer triangles; a moment after the last change it draws the picture once
more as ever. The grid is drawn as lines. With a graphics card, and where a hook of viser's page is missing, nothing changes.
"""

from __future__ import annotations

from pathlib import Path

__all__ = ["SCRIPT"]

NAMES = ("drawing.js", "gridlines.js", "coarse.js")
SCRIPT = "".join(Path(__file__).with_name(name).read_text(encoding="utf-8") for name in NAMES)
