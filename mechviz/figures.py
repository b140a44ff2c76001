"""Charts: figures of matplotlib in one style, written as SVG, PNG or PDF; the same chart gives the same file.

matplotlib is loaded when the first chart is made.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from html import escape
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Real
from mechviz.files import OutputError, replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = ("#1b6ca8", "#c8553d", "#3a7d44", "#7b4b94", "#b08900", "#2a9d8f", "#6c757d", "#d6336c")
PICTURE_SUFFIXES = (".svg", ".png", ".pdf")
DOTS_AN_INCH = 160.0  # of a PNG
DECADE_RATIO = 100.0  # of the greatest value to the median, above which an axis is logarithmic
STYLE = {
    "axes.prop_cycle": f"cycler('color', {list(COLOURS)})",
    "axes.axisbelow": True, "axes.edgecolor": "#9aa3ad", "axes.grid": True, "axes.labelsize": "medium",
    "axes.titlelocation": "left", "axes.titlesize": "medium", "figure.titlesize": "large", "font.size": 9.0,
    "grid.color": "#e3e6ea", "legend.fontsize": "small", "legend.frameon": False, "lines.linewidth": 1.5, "text.color": "#222222",
    "svg.fonttype": "none", "svg.hashsalt": "mechviz",  # text stays text; the same ids in every file
}  # fmt: skip


@contextmanager
def chart(width: float, height: float) -> Iterator[Figure]:
    """Context with an empty figure of a size [in] in the common style, to be filled within the ``with`` block. Its texts are shown
    as they are: names and titles with dollar signs are no formulas."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        yield figure
        _take_literally(figure)


def _take_literally(figure: Figure) -> None:
    """Let no text of a figure be read as a formula, except for the numbers at logarithmic axes, which are written as such."""
    from matplotlib.text import Text

    numbers: set[int] = set()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            if axis.get_scale() != "linear":
                ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
                numbers |= {id(label) for tick in ticks for label in (tick.label1, tick.label2)}
    for text in figure.findobj(Text):
        if isinstance(text, Text) and id(text) not in numbers:
            text.set_parse_math(False)


def over_decades(values: Real) -> bool:
    """Whether values (n,) need a logarithmic axis: all are positive, and the greatest is more than `DECADE_RATIO` times their
    median."""
    return bool(len(values)) and float(values.min()) > 0.0 and float(values.max()) > DECADE_RATIO * float(np.median(values))


def check_ending(path: Path) -> None:
    """Raise `OutputError` where no chart can be written to a file of this name."""
    if path.suffix.lower() not in PICTURE_SUFFIXES:
        raise OutputError(f"'{path}': charts are written as SVG, PNG or PDF.", "Give a name that ends in .svg, .png or .pdf.")


def save_chart(figure: Figure, path: Path, titles: Mapping[str, str] | None = None) -> None:
    """Write a figure; an existing file is replaced only when the new one is complete. ``titles`` as in `chart_svg`. Raises
    `OutputError`."""
    check_ending(path)
    ending = path.suffix.lower()
    with replacing(path) as temporary:
        if ending == ".svg":
            temporary.write_text(chart_svg(figure, titles), encoding="utf-8")
        else:
            figure.savefig(
                temporary, format=ending[1:], dpi=DOTS_AN_INCH, metadata={"CreationDate": None} if ending == ".pdf" else None
            )


def chart_svg(figure: Figure, titles: Mapping[str, str] | None = None) -> str:
    """A figure as SVG, without a date. ``titles``: text that appears when the pointer is on an artist, by the artist's gid."""
    import matplotlib

    stream = StringIO()
    with matplotlib.rc_context(STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph \d+", UserWarning)  # the texts are drawn by whatever shows the file
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    text = stream.getvalue().replace("*{", "#figure_1 *{", 1)  # so that the style does not apply to a page that contains it
    for gid, words in (titles or {}).items():
        text = text.replace(f'<g id="{gid}">', f'<g id="{gid}"><title>{escape(words)}</title>', 1)
    return text
