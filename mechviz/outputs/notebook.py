"""How results show themselves in a notebook: the shared page in a frame, and a drawing where there are no frames."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from mechviz.outputs.images.drawing import svg_of
from mechviz.outputs.page.page import make_page

if TYPE_CHECKING:
    from mechviz.outputs.rerun.reader import Recording


HEIGHT = 640  # [px] of the frame


def bundle_of(recording: Recording, text: str) -> dict[str, str]:
    """The page as HTML, a drawing as SVG, a line of text.

    A notebook shows the page; what cannot run it, such as a printed notebook, shows the drawing.
    """
    page, _ = make_page(recording)
    title = str(recording.properties.get("title", "")) or "Mechanism"
    frame = (
        f'<iframe srcdoc="{escape(page, quote=True)}" sandbox="allow-scripts" title="{escape(title, quote=True)}" '
        f'style="width: 100%; height: {HEIGHT}px; border: 0"></iframe>'
    )
    return {"text/html": frame, "image/svg+xml": svg_of(recording, width=800, height=500), "text/plain": text}
