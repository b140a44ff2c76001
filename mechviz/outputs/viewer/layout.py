"""The layout of the page: the timeline as a strip below the picture, a drawer on phones."""

from __future__ import annotations

import json
from importlib.resources import files

import viser

from mechviz.outputs.viewer.viser_adapter import run_script

SCRIPT = """{ let own = document.getElementById("mechviz-layout");
  if (!own) { own = document.createElement("style"); own.id = "mechviz-layout"; document.head.append(own); }
  own.textContent = STYLE; }"""


def lay_out(server: viser.ViserServer) -> None:
    """Give the page of every browser, now and later, the layout of ``layout.css``."""
    style = files(__package__).joinpath("layout.css").read_text(encoding="utf-8")
    run_script(server, SCRIPT.replace("STYLE", json.dumps(style)), "layout")
