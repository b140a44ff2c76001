"""Work-precision diagrams: error against time, both logarithmic, a panel for each dial; as SVG, PNG, or a rerun recording."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from .canvas import Canvas
from .ladder import Point, cheapest, pareto

__all__ = ["diagram", "write_diagram", "write_rrd"]

COLOURS = ("#1b6ca8", "#c8553d", "#3a7d44", "#7b4b94", "#b08900", "#2a9d8f", "#6c757d", "#d6336c")
PANEL = (430.0, 320.0)
LEFT, TOP, RIGHT, BOTTOM = 62.0, 66.0, 14.0, 44.0


def dials_of(points: Sequence[Point]) -> list[str]:
    """The dials in order."""
    return list(dict.fromkeys(p.dial for p in points))


def diagram(points: Sequence[Point], title: str, foot: str, target: float | None = None) -> Canvas:
    """A sheet with a panel for each dial; the Pareto front is a line, the current setting a ring, the cheapest a larger one."""
    dials = dials_of(points)
    columns = min(2, len(dials))
    rows = math.ceil(len(dials) / columns)
    sheet = Canvas(columns * PANEL[0] + 16, 40 + rows * PANEL[1] + 28)
    sheet.text(14, 26, title, size=16)
    for k, dial in enumerate(dials):
        x, y = 8 + (k % columns) * PANEL[0], 36 + (k // columns) * PANEL[1]
        _panel(sheet, x, y, dial, [p for p in points if p.dial == dial and math.isfinite(p.error)], target)
    sheet.text(14, sheet.height - 10, foot, size=10, color="#666666")
    return sheet


def _panel(sheet: Canvas, x0: float, y0: float, dial: str, points: list[Point], target: float | None) -> None:
    if not points:
        return
    width, height = PANEL[0] - LEFT - RIGHT, PANEL[1] - TOP - BOTTOM
    times, errors = [p.seconds for p in points], [p.error for p in points]
    low_t, high_t = _decades(min(times), max(times))
    low_e, high_e = _decades(min(errors), max(errors))

    def place(t: float, e: float) -> tuple[float, float]:
        u = (math.log10(t) - low_t) / (high_t - low_t)
        v = (math.log10(e) - low_e) / (high_e - low_e)
        return x0 + LEFT + width * min(max(u, 0.0), 1.0), y0 + TOP + height * (1.0 - min(max(v, 0.0), 1.0))

    sheet.text(x0 + LEFT, y0 + 14, dial, size=13)
    for decade in range(low_t, high_t + 1):
        x, _ = place(10.0**decade, 10.0**low_e)
        sheet.line([(x, y0 + TOP), (x, y0 + TOP + height)], "#e3e6ea")
        sheet.text(x, y0 + TOP + height + 15, _seconds(decade), size=10, anchor="middle")
    step = max(1, math.ceil((high_e - low_e) / 6))
    for decade in range(low_e, high_e + 1, step):
        _, y = place(10.0**low_t, 10.0**decade)
        sheet.line([(x0 + LEFT, y), (x0 + LEFT + width, y)], "#e3e6ea")
        sheet.text(x0 + LEFT - 6, y + 4, f"1e{decade}", size=10, anchor="end")
    sheet.text(x0 + LEFT + width / 2, y0 + PANEL[1] - 12, "time", size=11, anchor="middle")
    sheet.text(x0 + LEFT - 6, y0 + TOP - 6, "error", size=11, anchor="end")
    if target is not None and low_e < math.log10(target) < high_e:
        _, y = place(10.0**low_t, target)
        sheet.line([(x0 + LEFT, y), (x0 + LEFT + width, y)], "#222222", dash=True)
        sheet.text(x0 + LEFT + width - 4, y - 4, f"wanted {target:g}", size=10, anchor="end")
    front = pareto(points)
    sheet.line([place(p.seconds, p.error) for p in front], "#c9ced6", width=7.0)
    methods = list(dict.fromkeys(p.method for p in points))
    at, row = x0 + LEFT, y0 + 30
    for k, method in enumerate(methods):
        color = COLOURS[k % len(COLOURS)]
        own = [p for p in points if p.method == method]
        sheet.line([place(p.seconds, p.error) for p in own], color, width=1.3)
        for p in own:
            sheet.dot(*place(p.seconds, p.error), 3.2, color)
        if at + 16 + 5.2 * len(method) > x0 + PANEL[0] - 4:
            at, row = x0 + LEFT, row + 15
        sheet.dot(at + 4, row - 4, 3.5, color)
        sheet.text(at + 11, row, method, size=9.5)
        at += 22 + 5.2 * len(method)
    for p in points:
        if p.current:
            sheet.dot(*place(p.seconds, p.error), 7.0, "#111111", filled=False)
    best = cheapest(points, target) if target is not None else None
    if best is not None:
        sheet.dot(*place(best.seconds, best.error), 10.0, "#d6336c", filled=False)


def _decades(low: float, high: float) -> tuple[int, int]:
    a, b = math.floor(math.log10(low)), math.ceil(math.log10(high))
    return a, max(b, a + 1)


def _seconds(decade: int) -> str:
    """A power of ten of a second in words."""
    for power, unit in ((0, "s"), (-3, "ms"), (-6, "us")):
        if decade >= power:
            return f"{10 ** (decade - power):g} {unit}"
    return f"1e{decade} s"


def write_diagram(sheet: Canvas, path: Path) -> None:
    """Write a sheet as .svg or .png, replaced as a whole."""
    temporary = path.with_name(f"{path.name}.part")
    if path.suffix.lower() == ".png":
        sheet.png().save(temporary, format="PNG")
    else:
        temporary.write_text(sheet.svg(), encoding="utf-8")
    temporary.replace(path)


def write_rrd(points: Sequence[Point], path: Path, title: str, markdown: str) -> None:
    """The diagrams as a rerun recording: points and lines of every dial and method in log10 of seconds and error, and the table."""
    import rerun as rr
    import rerun.blueprint as rrb

    stream = rr.RecordingStream("mechviz", recording_id=f"accuracy-{path.stem}")
    temporary = path.with_name(f"{path.name}.part")
    views = []
    for dial in dials_of(points):
        own = [p for p in points if p.dial == dial and math.isfinite(p.error)]
        for k, method in enumerate(dict.fromkeys(p.method for p in own)):
            some = [p for p in own if p.method == method]
            places = [(math.log10(p.seconds), -math.log10(p.error)) for p in some]
            code = COLOURS[k % len(COLOURS)]
            color = tuple(int(code[i : i + 2], 16) for i in (1, 3, 5))
            entity = f"accuracy/{dial}/{method}".replace(" ", "_")
            labels = [f"{p.value}: {p.error:.1e} in {1e3 * p.seconds:.3g} ms" for p in some]
            look = {"colors": [color], "radii": [0.06 if p.current else 0.03 for p in some]}
            stream.log(entity, rr.Points2D(places, labels=labels, show_labels=False, **look), static=True)
            stream.log(f"{entity}/line", rr.LineStrips2D([places], colors=[color], radii=[0.008]), static=True)
            stream.log(f"{entity}/error", rr.Scalars([p.error for p in some]), static=True)
            stream.log(f"{entity}/seconds", rr.Scalars([p.seconds for p in some]), static=True)
        front = [(math.log10(p.seconds), -math.log10(p.error)) for p in pareto(own)]
        root = f"accuracy/{dial}".replace(" ", "_")
        stream.log(f"{root}/pareto", rr.LineStrips2D([front], colors=[(201, 206, 214)], radii=[0.03]), static=True)
        views.append(rrb.Spatial2DView(origin=root, name=f"{dial}: digits up, log10 of seconds to the right"))
    stream.log("table", rr.TextDocument(f"# {title}\n\n{markdown}", media_type=rr.MediaType.MARKDOWN), static=True)
    stream.save(temporary, default_blueprint=rrb.Blueprint(rrb.Horizontal(rrb.Grid(*views), rrb.TextDocumentView(origin="table"))))
    stream.flush()
    stream.disconnect()
    temporary.replace(path)
