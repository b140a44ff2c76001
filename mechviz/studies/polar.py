"""Polar plots of shaking force and shaking moment over a cycle, before and after balancing, as SVG."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from mechcore.motion.motion import Motion
from mechcore.reduction.shaking import Shaking, shaking
from mechviz.files import OutputError, replacing

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mechviz.runs import Run


Real = NDArray[np.float64]

PANEL = 420  # width and height of a plot [px]
RADIUS = 168  # of its outermost circle
HEAD = 64
STEP = 30.0  # degrees of the drive between two dots of the force's curve
COLOURS = ("#c8553d", "#3a7d44", "#1b6ca8")


def shaken(run: Run) -> Shaking:
    """Shaking force and moment of a run, about the point that its scene names. Raises `OutputError` where nothing shakes."""
    asked = run.motion.mechanism.studies.shaking
    found = shaking(run.motion, (0.0, 0.0) if asked is None else asked.about)
    if found.single == 0.0 and found.peak_moment == 0.0:
        why = f"{run.scene.name}: nothing shakes the frame: no link with a mass is accelerated."
        raise OutputError(why, "Give links a mass beside their axis.")
    return found


def write_polar(path: Path, title: str, motion: Motion, shakings: Mapping[str, Shaking]) -> None:
    """Write the plots to an SVG file. Raises `OutputError` where that cannot be."""
    if path.suffix.lower() != ".svg":
        raise OutputError(f"{path}: polar plots are written as SVG. Give a name that ends in .svg.")
    with replacing(path) as part:
        part.write_text(polar_svg(title, motion, shakings), encoding="utf-8")


def polar_svg(title: str, motion: Motion, shakings: Mapping[str, Shaking]) -> str:
    """Two plots in one scale each: tip of the force [N] (dots every 30 degrees of the drive), and the moment [N m] over the drive's
    angle, outwards of the zero circle where it is positive. ``shakings``: what is drawn, by its name in the legend."""
    angle = _angle(motion)
    most = max((s.peak for s in shakings.values()), default=0.0)
    least = max((s.single for s in shakings.values()), default=0.0)
    force = _round(most if most > 1e-9 * least else least)
    size = _round(max((s.peak_moment for s in shakings.values()), default=0.0))
    parts = [f'<text x="{PANEL}" y="24" text-anchor="middle" font-size="16">{escape(title)}</text>']
    for k, (name, s) in enumerate(shakings.items()):
        x = PANEL + (k - 0.5 * len(shakings)) * 190.0
        note = f"{name}: {s.peak:.4g} N" if s.peak > 1e-9 * least else f"{name}: 0 N"
        parts.append(f'<line x1="{x:.1f}" y1="46" x2="{x + 22:.1f}" y2="46" stroke="{COLOURS[k % 3]}" stroke-width="2"/>')
        parts.append(f'<text x="{x + 28:.1f}" y="50">{escape(note)}</text>')
    left, right = complex(0.5 * PANEL, HEAD + 0.5 * PANEL), complex(1.5 * PANEL, HEAD + 0.5 * PANEL)
    parts += _web(left, [(RADIUS * i / 4.0, f"{force * i / 4.0:g} N") for i in range(1, 5)], "shaking force", ("x", "y"))
    rings = [(RADIUS * (0.5 + i / 4.0), f"{size * i / 2.0:g} N m") for i in (-1, 0, 1, 2)] if size else [(0.5 * RADIUS, "0 N m")]
    parts += _web(right, rings, "shaking moment over the drive", ("0°", "90°"), zero=0.5 * RADIUS)
    for k, s in enumerate(shakings.values()):
        colour = COLOURS[k % 3]
        tip = (s.force @ np.array([1.0, -1.0j])) * (RADIUS / force if force else 0.0)
        parts.append(_curve(left + tip, colour))
        parts += _dots(left + tip, angle, colour)
        radius = RADIUS * (0.5 + (0.5 * s.moment / size if size else 0.0 * s.moment))
        parts.append(_curve(right + radius * np.exp(-1j * angle), colour))
    body = "\n".join(parts)
    look = f'width="{2 * PANEL}" height="{HEAD + PANEL}" font-family="sans-serif" font-size="12"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {look}>\n<rect width="100%" height="100%" fill="#ffffff"/>\n{body}\n</svg>\n'


def _angle(motion: Motion) -> Real:
    """Angle of the first drive (F,) [rad]; of one that slides, the part of the run as an angle."""
    drive = motion.mechanism.drives[0].pair
    if motion.model.joints[motion.model.joint_index[drive]].coordinate == "angle":
        return np.asarray(motion.coordinate(drive)[:, 0], float)
    span = float(np.ptp(motion.time)) or 1.0
    return np.asarray(2.0 * np.pi * (motion.time - motion.time[0]) / span, float)


def _round(value: float) -> float:
    """The next number above that quarters well, such as 200, 240, 300; 0 of nothing."""
    if not value > 0.0:
        return 0.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(
        (m * power for m in (1.0, 1.2, 1.6, 2.0, 2.4, 3.2, 4.0, 6.0, 8.0) if value <= m * power * (1.0 + 1e-9)), 10.0 * power
    )


def _web(centre: complex, rings: list[tuple[float, str]], label: str, axes: tuple[str, str], zero: float = 0.0) -> Iterator[str]:
    """Circles with their values along a ray to the lower right, axes with names, and what it is."""
    x, y = centre.real, centre.imag
    for radius, text in rings:
        strong = ' stroke-width="1.6"' if radius == zero else ""
        yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="none" stroke="#c9ced4"{strong}/>'
        at = centre + radius * complex(math.cos(math.radians(52.0)), math.sin(math.radians(52.0)))
        yield f'<text x="{at.real + 3:.1f}" y="{at.imag + 4:.1f}" font-size="10" fill="#7a838c">{text}</text>'
    reach = RADIUS + 10.0
    cross = f"M{x - reach:.1f} {y:.1f}H{x + reach:.1f}M{x:.1f} {y - reach:.1f}V{y + reach:.1f}"
    yield f'<path d="{cross}" stroke="#c9ced4" fill="none"/>'
    yield f'<text x="{x + reach + 4:.1f}" y="{y + 4:.1f}">{axes[0]}</text>'
    yield f'<text x="{x + 6:.1f}" y="{y - reach + 4:.1f}">{axes[1]}</text>'
    yield f'<text x="{x:.1f}" y="{HEAD + PANEL - 8}" text-anchor="middle">{label}</text>'


def _curve(z: NDArray[np.complex128], colour: str) -> str:
    """A line that is broken where the numbers are not finite."""
    steps, drawn = [], False
    for p in z:
        finite = np.isfinite(p)
        if finite:
            steps.append(f"{'L' if drawn else 'M'}{p.real:.2f} {p.imag:.2f}")
        drawn = bool(finite)
    return f'<path d="{"".join(steps)}" fill="none" stroke="{colour}" stroke-width="1.8" stroke-linejoin="round"/>'


def _dots(z: NDArray[np.complex128], angle: Real, colour: str) -> Iterator[str]:
    """Dots every 30 degrees of the drive over its first turn, every third with its angle."""
    if not np.isfinite(z).all():
        return
    if float(np.ptp(z.real) + np.ptp(z.imag)) < 2.0:  # balanced
        yield f'<circle cx="{z[0].real:.2f}" cy="{z[0].imag:.2f}" r="3.5" fill="{colour}"/>'
        return
    degrees = np.degrees(angle)
    way = 1.0 if degrees[-1] >= degrees[0] else -1.0
    first = math.ceil(way * degrees[0] / STEP - 1e-9)
    for k in range(first, first + round(360.0 / STEP)):
        if not np.all(np.diff(way * degrees) > 0.0) or k * STEP > way * degrees[-1] + 1e-9:
            return
        p = complex(*(np.interp(k * STEP, way * degrees, part) for part in (z.real, z.imag)))
        yield f'<circle cx="{p.real:.2f}" cy="{p.imag:.2f}" r="2.4" fill="{colour}"/>'
        if k % 3 == 0:
            words = f"{way * k * STEP % 360.0:g}°"
            yield f'<text x="{p.real + 5:.1f}" y="{p.imag - 5:.1f}" font-size="10" fill="{colour}">{words}</text>'
