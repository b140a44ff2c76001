"""A sheet of lines, marks and words that becomes SVG or PNG: what work-precision diagrams need, and no more."""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape
from itertools import pairwise
from typing import Any, Literal

__all__ = ["Canvas"]

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
