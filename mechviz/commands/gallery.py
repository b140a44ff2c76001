"""``mechviz scenes``: the gallery, listed without numpy and what reads scenes."""

from __future__ import annotations

from typing import Annotated

import typer

from mechviz.commands.common import orderly
from mechviz.scene.folder import gallery


def scenes(names: Annotated[bool, typer.Option("--names", help="bare names only, one a line, for scripts")] = False) -> None:
    """List the gallery: one line a scene with what it teaches."""
    entries = gallery()
    width = max(len(e.name) for e in entries)
    with orderly():
        for e in entries:
            print(e.name if names else f"{e.name:<{width}}  {e.teaches}")
