"""A run of which more and more is known: what is shown of it, and how far it has come."""

from __future__ import annotations

from dataclasses import replace
from html import escape
from typing import TYPE_CHECKING

import viser

from .show import Show
from .show_run import build, show_of_run

if TYPE_CHECKING:
    from ..run import Run

__all__ = ["Growth"]

NOTES = "This motion is still being computed. When it is complete, the scene can be edited and saved."
REBUILT = 4.0  # solids are made anew when the run is so many times as long as that for which they were made


class Growth:
    """What is shown of a growing run: ``show`` at first, then what `take` gives."""

    def __init__(self, server: viser.ViserServer, run: Run):
        self._built = build(run)
        self._for = run.motion.frames
        first = show_of_run(run, self._built)
        self.show = replace(first, opens_at=first.frames - 1, notes=NOTES)
        self.words = ""
        self._bar = server.gui.add_html("", order=-1.0)

    def take(self, run: Run, duration: float) -> tuple[Show, bool]:
        """What is shown of more frames, and whether the solids are new: slots are as long and layers as many as the run needs.
        ``duration`` of the whole run [s]."""
        reshaped = run.motion.frames >= REBUILT * self._for
        if reshaped:
            self._built, self._for = build(run), run.motion.frames
        self.show = replace(show_of_run(run, self._built, self.show), notes=NOTES)
        reached = float(run.motion.time[-1])
        self._say(f"Computing: {reached:.4g} s of {duration:.4g} s", reached / duration, "#225ca0")
        return self.show, reshaped

    def fail(self, error: Exception) -> None:
        """Say why there is no more."""
        self._say(f"It ends here: {error}", 1.0, "#d03030")

    def _say(self, text: str, part: float, color: str) -> None:
        self.words = text
        self._bar.content = (
            '<div style="padding:0.4em 0.9em 0.6em;font-size:0.85em" role="status">'
            f'<div class="mechviz-progress" style="padding-bottom:0.3em">{escape(text)}</div>'
            '<div style="height:6px;border-radius:3px;background:rgba(128,128,128,0.25)">'
            f'<div style="height:6px;border-radius:3px;background:{color};width:{100.0 * part:.1f}%"></div></div></div>'
        )
