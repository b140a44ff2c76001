"""What a recording holds, by family: a new family of entities is one entry here, with its streams, statics and views.

A family that a scene does not call for yields nothing, and costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from mechviz.outputs.rerun.blueprint import BACKGROUND
from mechviz.outputs.rerun.diagrams import Diagram, diagram_shapes, diagram_streams
from mechviz.outputs.rerun.legend import legend_shapes
from mechviz.outputs.rerun.marks import lane_styles
from mechviz.outputs.rerun.nodes import picture_statics, picture_streams
from mechviz.outputs.rerun.plots import plot_streams, plot_styles
from mechviz.outputs.rerun.polygons import polygon_shapes, polygon_streams, polygon_views
from mechviz.outputs.rerun.streams import Static, Stream, link_streams, magnification, table_streams, view_statics
from mechviz.picture.constructions import Drawing
from mechviz.picture.nodes import Picture
from mechviz.picture.overlays import overlay_box
from mechviz.quantities.items import Table

if TYPE_CHECKING:
    from mechviz.meshes.solids import Solids
    from mechviz.runs import Run


@dataclass(frozen=True, eq=False)
class Content:
    """What the families make their entities from."""

    run: Run
    solids: Solids
    tables: list[Table]
    picture: Picture
    drawings: dict[str, Drawing]  # graphical constructions
    every: int  # pictures are drawn at every so many frames
    diagrams: Sequence[Diagram] = ()  # of one quantity against another


def _nothing(_: Content) -> Iterable[Any]:
    return ()


@dataclass(frozen=True)
class Family:
    """Entities that belong together: rows over the frames, static archetypes, and views of the blueprint beside the plots."""

    name: str
    streams: Callable[[Content], Iterable[Stream]] = _nothing
    statics: Callable[[Content], Iterable[Static]] = _nothing
    views: Callable[[Content], Iterable[Any]] = _nothing


FAMILIES: tuple[Family, ...] = (
    Family("links", streams=lambda c: link_streams(c.run), statics=lambda c: view_statics(c.picture.size)),
    Family("data", streams=lambda c: table_streams(c.tables, c.run.kept.numbers)),
    Family("picture", streams=lambda c: picture_streams(c.picture, c.every), statics=lambda c: picture_statics(c.picture)),
    Family("lanes", statics=lambda c: lane_styles(c.run)),
    Family("legend", statics=lambda c: legend_shapes(c.picture, overlay_box(c.run, c.solids))),
    Family("plots", streams=lambda c: plot_streams(c.run, c.every), statics=lambda c: plot_styles(c.run, c.tables)),
    Family("diagrams", streams=lambda c: diagram_streams(c.diagrams, c.every), statics=lambda c: diagram_shapes(c.diagrams)),
    Family(
        "polygons",
        streams=lambda c: polygon_streams(c.drawings, c.every),
        statics=lambda c: polygon_shapes(c.drawings, c.picture.size),
        views=lambda c: polygon_views(c.drawings, magnification(c.solids.size), BACKGROUND),
    ),
)
"""In the order in which they are written."""


def find_streams(content: Content) -> list[Stream]:
    """The streams of all families."""
    return [stream for family in FAMILIES for stream in family.streams(content)]


def find_statics(content: Content) -> list[Static]:
    """The static archetypes of all families."""
    return [static for family in FAMILIES for static in family.statics(content)]


def find_views(content: Content) -> list[Any]:
    """The views of all families that have some."""
    return [view for family in FAMILIES for view in family.views(content)]
