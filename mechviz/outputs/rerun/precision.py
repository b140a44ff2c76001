"""Work-precision diagrams as a recording: a view for each setting, in which every value of the setting is a point."""

from __future__ import annotations

import math
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

from mechviz.figures import COLOURS, DOTS_AN_INCH, chart
from mechviz.files import replacing
from mechviz.outputs.rerun.entities import APPLICATION_ID
from mechviz.outputs.rerun.rerun_adapter import send_blueprint
from mechviz.outputs.rerun.stream_file import forget_streams
from mechviz.studies.precision import PrecisionPoint
from mechviz.studies.precision_diagram import PANEL, draw_panel, settings_of


def write_rrd(points: Sequence[PrecisionPoint], path: Path, title: str, markdown: str, target: float | None = None) -> None:
    """Write a recording with a view for each setting: the panel with its axes as an image, and over it a point for each value, with
    a tooltip; errors and times are scalars of the same entity. The table ``markdown`` stands beside the views. Raises
    `OutputError`."""
    import rerun as rr
    import rerun.blueprint as rrb

    stream = rr.RecordingStream(APPLICATION_ID, recording_id=f"accuracy-{path.stem}")
    binary = stream.binary_stream()  # a file written by rerun itself may be cut off without an error
    views = []
    for setting in settings_of(points):
        own = [p for p in points if p.setting == setting and math.isfinite(p.error)]
        if not own:
            continue
        root = f"accuracy/{setting}".replace(" ", "_")
        with chart(*PANEL) as figure:
            axes = figure.add_subplot()
            draw_panel(axes, setting, own, target)
            picture = BytesIO()
            figure.savefig(picture, format="png", dpi=DOTS_AN_INCH)
            figure.dpi = DOTS_AN_INCH
        stream.log(
            f"{root}/axes", rr.EncodedImage(contents=picture.getvalue(), media_type="image/png", draw_order=-1.0), static=True
        )
        for k, method in enumerate(dict.fromkeys(p.method for p in own)):
            some = [p for p in own if p.method == method]
            entity = f"{root}/{method}".replace(" ", "_")
            look = rr.Points2D(
                [[x, DOTS_AN_INCH * PANEL[1] - y] for x, y in axes.transData.transform([(p.seconds, p.error) for p in some])],
                colors=[_rgb(COLOURS[k % len(COLOURS)])] * len(some),
                radii=[rr.Radius.ui_points(6.0 if p.current else 4.0) for p in some],
                labels=[f"{method}, {p.value}: {p.error:.1e} in {p.time_text}" for p in some],
                show_labels=False,
            )
            stream.log(entity, look, static=True)
            stream.log(f"{entity}/error", rr.Scalars([p.error for p in some]), static=True)
            stream.log(f"{entity}/seconds", rr.Scalars([p.seconds for p in some]), static=True)
        views.append(rrb.Spatial2DView(origin=root, name=setting, background=[255, 255, 255]))
    stream.log("table", rr.TextDocument(f"# {title}\n\n{markdown}", media_type=rr.MediaType.MARKDOWN), static=True)
    layout = rrb.Horizontal(rrb.Grid(*views), rrb.TextDocumentView(origin="table", name="table"), column_shares=[3, 2])
    send_blueprint(stream, rrb.Blueprint(layout, collapse_panels=True))
    data = binary.read()
    stream.disconnect()
    del stream, binary
    forget_streams()
    with replacing(path) as temporary:
        temporary.write_bytes(data or b"")


def _rgb(code: str) -> tuple[int, int, int]:
    """A colour such as #1b6ca8 as numbers from 0 to 255."""
    red, green, blue = (int(code[i : i + 2], 16) for i in (1, 3, 5))
    return red, green, blue
