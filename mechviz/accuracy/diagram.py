"""Work-precision diagrams: error against time, both logarithmic, a panel for each dial, as SVG or PNG."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

from mechviz.accuracy.ladder import Point, cheapest, pareto
from mechviz.files import replacing

Anchor = Literal["start", "middle", "end"]


@dataclass
class Canvas:
    """Lengths are in pixels, y downwards; what is drawn later lies above."""

    width: float
    height: float
    shapes: list[tuple[str, dict[str, Any]]] = field(default_factory=list)

    def line(self, points: list[tuple[float, float]], color: str, width: float = 1.0, dash: bool = False) -> None:
        """A polyline."""
        self.shapes.append(("line", {"points": points, "color": color, "width": width, "dash": dash}))

    def dot(self, x: float, y: float, radius: float, color: str, *, filled: bool = True, title: str = "") -> None:
        """A disc, or a ring. ``title``: what SVG viewers say where the pointer is on it or next to it."""
        self.shapes.append(("dot", {"x": x, "y": y, "radius": radius, "color": color, "filled": filled, "title": title}))

    def text(self, x: float, y: float, words: str, *, size: float = 12.0, anchor: Anchor = "start", color: str = "#222222") -> None:
        """Words with their base line at y."""
        self.shapes.append(("text", {"x": x, "y": y, "words": words, "size": size, "anchor": anchor, "color": color}))

    def svg(self) -> str:
        """The sheet as SVG."""
        parts = []
        for kind, s in self.shapes:
            if kind == "line":
                points = " ".join(f"{x:.1f},{y:.1f}" for x, y in s["points"])
                dash = ' stroke-dasharray="5 3"' if s["dash"] else ""
                parts.append(f'<polyline points="{points}" fill="none" stroke="{s["color"]}" stroke-width="{s["width"]}"{dash}/>')
            elif kind == "dot":
                look = f'fill="{s["color"]}"' if s["filled"] else f'fill="none" stroke="{s["color"]}" stroke-width="2"'
                circle = f'<circle cx="{s["x"]:.1f}" cy="{s["y"]:.1f}" r="{s["radius"]}" {look}'
                if s["title"]:  # an edge that is not seen: a pointer need not meet the dot itself
                    parts.append(f'{circle} stroke="#000" stroke-opacity="0" stroke-width="9" pointer-events="all">')
                    parts.append(f"<title>{escape(s['title'])}</title></circle>")
                else:
                    parts.append(f"{circle}/>")
            else:
                place = f'x="{s["x"]:.1f}" y="{s["y"]:.1f}" font-size="{s["size"]}" text-anchor="{s["anchor"]}" fill="{s["color"]}"'
                parts.append(f"<text {place}>{escape(s['words'])}</text>")
        body = "\n".join(parts)
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{self.width:.0f}" height="{self.height:.0f}" '
            f'font-family="sans-serif">\n'
            f'<rect width="100%" height="100%" fill="#ffffff"/>\n{body}\n</svg>\n'
        )

    def png(self, scale: float = 2.0) -> Any:
        """The sheet as a Pillow image, ``scale`` dots a pixel."""
        from PIL import Image, ImageDraw, ImageFont

        image = Image.new("RGB", (round(scale * self.width), round(scale * self.height)), "#ffffff")
        draw = ImageDraw.Draw(image)
        for kind, s in self.shapes:
            if kind == "line":
                points = [(scale * x, scale * y) for x, y in s["points"]]
                for a, b in pairwise(points):
                    for piece in _dashes(a, b, 6.0 * scale) if s["dash"] else [(a, b)]:
                        draw.line([*piece], fill=s["color"], width=max(1, round(scale * s["width"])))
            elif kind == "dot":
                r = scale * s["radius"]
                box = [scale * s["x"] - r, scale * s["y"] - r, scale * s["x"] + r, scale * s["y"] + r]
                if s["filled"]:
                    draw.ellipse(box, fill=s["color"])
                else:
                    draw.ellipse(box, outline=s["color"], width=round(2 * scale))
            else:
                font = ImageFont.load_default(size=scale * s["size"])
                anchor = {"start": "ls", "middle": "ms", "end": "rs"}[s["anchor"]]
                draw.text((scale * s["x"], scale * s["y"]), s["words"], fill=s["color"], font=font, anchor=anchor)
        return image


def _dashes(a: tuple[float, float], b: tuple[float, float], step: float) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """A line cut into dashes."""
    length = ((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2) ** 0.5
    count = max(1, int(length / (2.0 * step)))
    out = []
    for k in range(count):
        ends = [(k + share) / count for share in (0.0, 0.6)]
        first, last = ((a[0] + u * (b[0] - a[0]), a[1] + u * (b[1] - a[1])) for u in ends)
        out.append((first, last))
    return out


COLOURS = ("#1b6ca8", "#c8553d", "#3a7d44", "#7b4b94", "#b08900", "#2a9d8f", "#6c757d", "#d6336c")
PANEL = (430.0, 320.0)
LEFT, TOP, RIGHT, BOTTOM = 62.0, 51.0, 14.0, 44.0
ROW = 15.0  # from one row of names of methods to the next
GRID, FRONT, NOW, BEST = "#e3e6ea", "#c9ced6", "#111111", "#d6336c"

Place = Callable[[float, float], tuple[float, float]]
"""Where a time [s] and an error lie on the sheet."""


def setting_words(point: Point, front: bool) -> str:
    """A setting in a line; ``front``: nothing is quicker and more exact."""
    words = f"{point.dial}: {point.method}, {point.value}: {point.error:.0e} in {1e3 * point.seconds:.3g} ms"
    return f"{words} *" if front else words


def draw_panel(
    sheet: Canvas,
    x0: float,
    y0: float,
    dial: str,
    points: list[Point],
    target: float | None,
    size: tuple[float, float] = PANEL,
) -> Place:
    """Draw the finite points of a dial with its upper left corner at (x0, y0); where a time and an error lie."""
    rows = _names(sheet, x0, y0 + 30.0, size[0], list(dict.fromkeys(p.method for p in points)))
    top = TOP + ROW * rows
    width, height = size[0] - LEFT - RIGHT, size[1] - top - BOTTOM
    ticks = time_ticks([p.seconds for p in points], max(2, int(width / 50.0)))
    low_e, high_e = decades([p.error for p in points])

    def place(t: float, e: float) -> tuple[float, float]:
        u = math.log(t / ticks[0]) / math.log(ticks[-1] / ticks[0])
        v = (math.log10(e) - low_e) / (high_e - low_e)
        return x0 + LEFT + width * min(max(u, 0.0), 1.0), y0 + top + height * (1.0 - min(max(v, 0.0), 1.0))

    sheet.text(x0 + LEFT, y0 + 14, dial, size=13)
    for tick in ticks:
        x, _ = place(tick, 10.0**low_e)
        sheet.line([(x, y0 + top), (x, y0 + top + height)], GRID)
        sheet.text(x, y0 + top + height + 15, seconds_words(tick), size=10, anchor="middle")
    for decade in range(low_e, high_e + 1, max(1, math.ceil((high_e - low_e) / 6))):
        _, y = place(ticks[0], 10.0**decade)
        sheet.line([(x0 + LEFT, y), (x0 + LEFT + width, y)], GRID)
        sheet.text(x0 + LEFT - 6, y + 4, f"1e{decade}", size=10, anchor="end")
    sheet.text(x0 + LEFT + width / 2, y0 + size[1] - 12, "time, median", size=11, anchor="middle")
    sheet.text(x0 + 4, y0 + top - 8, "relative error", size=11)
    front = pareto(points)
    sheet.line([place(p.seconds, p.error) for p in front], FRONT, width=7.0)
    _curves(sheet, points, {id(p) for p in front}, place)
    for p in points:
        if p.current:
            sheet.dot(*place(p.seconds, p.error), 7.0, NOW, filled=False)
    best = cheapest(points, target) if target is not None else None
    if best is not None:
        sheet.dot(*place(best.seconds, best.error), 10.0, BEST, filled=False)
    if target is not None and low_e < math.log10(target) < high_e:
        _wanted(sheet, x0 + LEFT, width, place(ticks[0], target)[1], target, [place(p.seconds, p.error) for p in points])
    return place


def draw_key(sheet: Canvas, x0: float, y0: float, target: float | None) -> None:
    """What the band and the rings mean, in as many rows as `key_rows` says, the first with its base line at y0."""
    at, row = x0, y0
    for kind, words, wide in _key(target):
        if at + wide > sheet.width and at > x0:
            at, row = x0, row + 18
        if kind == FRONT:
            sheet.line([(at, row - 4), (at + 16, row - 4)], FRONT, width=7.0)
        else:
            sheet.dot(at + 8, row - 4, 6.0, kind, filled=False)
        sheet.text(at + 22, row, words, size=10)
        at += wide


def key_rows(width: float, target: float | None) -> int:
    """Rows of the key on a sheet of some width."""
    rows, at = 1, 14.0
    for _, _, wide in _key(target):
        if at + wide > width and at > 14.0:
            rows, at = rows + 1, 14.0
        at += wide
    return rows


def _key(target: float | None) -> list[tuple[str, str, float]]:
    """Colour, words and width of the marks."""
    marks = [(FRONT, "Pareto front: nothing is quicker and more exact"), (NOW, "the setting in use")]
    marks += [(BEST, f"the cheapest that reaches {target:g}")] if target is not None else []
    return [(color, words, 40 + 4.9 * len(words)) for color, words in marks]


def _names(sheet: Canvas, x0: float, y0: float, width: float, methods: list[str]) -> int:
    """The methods with their colours, in as many rows as they need: how many."""
    at, row = x0 + LEFT, 0
    for k, method in enumerate(methods):
        wide = 22 + 5.2 * len(method)
        if at + wide - 6 > x0 + width - 4 and at > x0 + LEFT:
            at, row = x0 + LEFT, row + 1
        sheet.dot(at + 4, y0 + ROW * row - 4, 3.5, COLOURS[k % len(COLOURS)])
        sheet.text(at + 11, y0 + ROW * row, method, size=9.5)
        at += wide
    return row + 1


def _curves(sheet: Canvas, points: list[Point], front: set[int], place: Place) -> None:
    """The settings of each method, joined in the order of the ladder; fitted ones stand by themselves."""
    for k, method in enumerate(dict.fromkeys(p.method for p in points)):
        color = COLOURS[k % len(COLOURS)]
        own = [p for p in points if p.method == method]
        joined = [p for p in own if not p.note.startswith("fitted") and p.value != "as it is"]
        sheet.line([place(p.seconds, p.error) for p in joined], color, width=1.3)
        for p in own:
            sheet.dot(*place(p.seconds, p.error), 3.2, color, title=setting_words(p, id(p) in front))


def _wanted(sheet: Canvas, left: float, width: float, y: float, target: float, taken: list[tuple[float, float]]) -> None:
    """The wanted error as a line across, with its name at the end where there is more room."""
    sheet.line([(left, y), (left + width, y)], "#222222", dash=True)
    words = f"wanted {target:g}"
    half = 2.7 * len(words)
    rooms = [
        (min((math.hypot(u - x, v - y + 8.0) for u, v in taken), default=0.0), x) for x in (left + 4 + half, left + width - half)
    ]
    sheet.text(max(rooms)[1], y - 4, words, size=10, anchor="middle")


def decades(errors: list[float]) -> tuple[int, int]:
    """Powers of ten around some errors."""
    a, b = math.floor(math.log10(min(errors))), math.ceil(math.log10(max(errors)))
    return a, max(b, a + 1)


def time_ticks(times: list[float], most: int = 7) -> list[float]:
    """At most so many round times around some: of the series 1, 2, 5, or over more than two decades powers of ten."""
    first, last = math.floor(math.log10(min(times))) - 1, math.ceil(math.log10(max(times))) + 1
    for steps in ((1, 2, 5), (1,)):
        series = [step * 10.0**decade for decade in range(first, last + 1) for step in steps]
        below = max(k for k, t in enumerate(series) if t <= min(times) * 1.0001)
        above = min(k for k, t in enumerate(series) if t >= max(times) * 0.9999)
        found = series[below : max(above, below + 1) + 1]
        if len(found) <= most:
            return found
    step = math.ceil(len(found) / most)
    return [*found[:-1:step], found[-1]] if (len(found) - 1) % step else found[::step]


def seconds_words(time: float) -> str:
    """A round time in words."""
    for factor, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "us"), (1e-9, "ns")):
        if time >= 0.999 * factor:
            return f"{time / factor:.4g} {unit}"
    return f"{time:g} s"


def dials_of(points: Sequence[Point]) -> list[str]:
    """The dials in order."""
    return list(dict.fromkeys(p.dial for p in points))


def diagram(
    points: Sequence[Point],
    title: str,
    foot: str,
    target: float | None = None,
    columns: int = 2,
    size: tuple[float, float] = PANEL,
) -> Canvas:
    """A sheet with a panel for each dial; the Pareto front is a band, the current setting a ring, the cheapest a larger one."""
    dials = dials_of(points)
    columns = min(columns, len(dials))
    rows = math.ceil(len(dials) / columns)
    wide = columns * size[0] + 16
    key = key_rows(wide, target)
    sheet = Canvas(wide, 36 + rows * size[1] + 18 * key + 26)
    sheet.text(14, 26, title, size=16 if columns > 1 else 12)
    for k, dial in enumerate(dials):
        x, y = 8 + (k % columns) * size[0], 36 + (k // columns) * size[1]
        own = [p for p in points if p.dial == dial and math.isfinite(p.error)]
        if own:
            draw_panel(sheet, x, y, dial, own, target, size)
        else:
            sheet.text(x + 14, y + 14, f"{dial}: no setting gives numbers", size=13)
    draw_key(sheet, 14, sheet.height - 10 - 18 * key, target)
    sheet.text(14, sheet.height - 10, foot, size=10, color="#666666")
    return sheet


def write_diagram(sheet: Canvas, path: Path) -> None:
    """Write a sheet as .svg or .png, replaced as a whole. Raises `OutputError`."""
    with replacing(path) as temporary:
        if path.suffix.lower() == ".png":
            sheet.png().save(temporary, format="PNG")
        else:
            temporary.write_text(sheet.svg(), encoding="utf-8")
