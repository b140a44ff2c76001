"""A page that plays a mechanism: one HTML file that needs nothing else, neither a server nor a network."""

from __future__ import annotations

from html import escape
from importlib.resources import files

from mechviz.outputs.page.frames import MOST_FRAMES, Frames, Progress, quiet
from mechviz.outputs.page.show import show_text
from mechviz.outputs.presentation import Presentation

SCRIPTS = ("decode.js", "camera.js", "stage.js", "export.js", "plots.js", "drawings.js", "player.js")


def make_page(
    shown: Presentation, *, most: int = MOST_FRAMES, keep: float | None = None, plots: bool = True, progress: Progress = quiet
) -> tuple[str, Frames]:
    """The HTML of a page with at most ``most`` frames of a run, that at the time ``keep`` [s] among them; and the frames."""
    text, frames = show_text(shown, most=most, keep=keep, plots=plots, progress=progress)
    pieces = {
        "title": escape(shown.title),
        "style": _read("style.css"),
        "script": "\n".join(_read(name) for name in SCRIPTS),
        "data": text,
    }
    page = ""
    rest = _read("page.html")
    while "{{" in rest:  # in order, so that braces in what is put in are left alone
        before, _, after = rest.partition("{{")
        name, _, rest = after.partition("}}")
        page += before + pieces[name]
    return page + rest, frames


def _read(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")
