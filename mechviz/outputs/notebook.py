"""How results show themselves in a notebook: the shared page in a frame, and a drawing where there are no frames."""

from __future__ import annotations

from html import escape

from mechviz.outputs.images.drawing import svg_of
from mechviz.outputs.page.page import make_page
from mechviz.outputs.presentation import Presentation

HEIGHT = 640  # [px] of the frame


def bundle_of(shown: Presentation, text: str) -> dict[str, str]:
    """The page as HTML, a drawing as SVG, a line of text.

    A notebook shows the page; what cannot run it, such as a printed notebook, shows the drawing.
    """
    page, _ = make_page(shown)
    frame = (
        f'<iframe srcdoc="{escape(page, quote=True)}" sandbox="allow-scripts allow-downloads" '
        f'title="{escape(shown.title, quote=True)}" '
        f'style="width: 100%; height: {HEIGHT}px; border: 0"></iframe>'
    )
    return {"text/html": frame, "image/svg+xml": svg_of(shown, width=800, height=500), "text/plain": text}
