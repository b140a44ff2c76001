"""How dampers, gas springs and torsion springs look: lines that deform with the motion. Shared by all pictures.

Springs between two points are solids, see `coils`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Integers, Real
from mechcore.spec.loads import Actuator, Bushing, Damper, GasSpring, Spring, TorsionSpring
from mechcore.spec.mechanism import Mechanism
from mechviz.picture.proportions import POT, TURNS, pot_length, spiral_radius

if TYPE_CHECKING:
    from mechviz.runs import Run


SPIRAL_POINTS = 72
RING_POINTS = 37
BUSHING = 0.03  # radius of a bushing's ring, in sizes of the mechanism


@dataclass(frozen=True)
class Strut:
    """A load that is drawn as a pot with a rod between two points, each (link, point)."""

    name: str
    kind: str  # "damper", "gas spring", "actuator"
    ends: tuple[tuple[str, str], tuple[str, str]]


def find_struts(mechanism: Mechanism) -> Iterator[Strut]:
    """Dampers, gas springs and actuators between two points."""
    for load in mechanism.loads:
        if isinstance(load, Damper | GasSpring | Actuator) and load.points:
            kind = "damper" if isinstance(load, Damper) else "gas spring" if isinstance(load, GasSpring) else "actuator"
            first, second = zip(load.links, load.points, strict=True)
            yield Strut(load.name, kind, (first, second))


@dataclass(frozen=True, eq=False)
class StrutGlyph:
    """A load that is drawn as lines: ``strips(frames)`` gives polylines (n, points, 2) [m], as many arrays as it has lines."""

    name: str
    kind: str  # "damper", "gas spring", "actuator", "bushing", "torsion spring"
    strips: Callable[[Integers], tuple[Real, ...]]


def find_strut_glyphs(run: Run, size: float) -> Iterator[StrutGlyph]:
    """The linkers of a run in which forces are computed; ``size`` [m] is the mechanism's."""
    if run.forces is None:
        return
    motion = run.motion
    for strut in find_struts(motion.mechanism):
        a, b = (motion.point(*end) for end in strut.ends)
        yield StrutGlyph(strut.name, strut.kind, _between(a, b, strut.kind, size))
    yield from _bushings(run, size)
    for load in motion.mechanism.loads:
        if isinstance(load, TorsionSpring):
            pin = next((p for p in motion.mechanism.joints if set(p.links) == set(load.links) and hasattr(p, "points")), None)
            if pin is not None:
                centre = motion.joint_position(pin.name)
                angles = [motion.pose(link)[:, 2] for link in load.links]
                yield StrutGlyph(load.name, "torsion spring", _around(centre, angles[0], angles[1], size))


def _bushings(run: Run, size: float) -> Iterator[StrutGlyph]:
    """A ring about the first point of each bushing, and a cross on the second link at the second point."""
    for load in run.motion.mechanism.loads:
        if isinstance(load, Bushing):
            (first, a), (second, b) = zip(load.links, load.points, strict=True)
            centre, place, angle = run.motion.point(first, a), run.motion.point(second, b), run.motion.pose(second)[:, 2]
            yield StrutGlyph(load.name, "bushing", partial(bushing_strips, centre, place, angle, BUSHING * size))


def bushing_strips(centre: Real, place: Real, angle: Real, radius: float, frames: Integers) -> tuple[Real, Real, Real]:
    """A ring of a ``radius`` [m] about ``centre`` and the two bars of a cross at ``place`` (F, 2), turned by ``angle`` (F,)."""
    around = radius * np.exp(1j * np.linspace(0.0, 2.0 * np.pi, RING_POINTS))
    arms = radius * np.exp(1j * angle[frames])[:, None] * np.array([-1.0, 1.0])
    middle = place[frames] @ [1.0, 1.0j]
    lines = ((centre[frames] @ [1.0, 1.0j])[:, None] + around, middle[:, None] + arms, middle[:, None] + 1j * arms)
    ring, bar, other = (np.stack([z.real, z.imag], axis=-1) for z in lines)
    return ring, bar, other


def strut_ends(run: Run) -> list[Real]:
    """Where springs, dampers, gas springs and actuators between two points end, (F, 2) [m] each."""
    if run.forces is None:
        return []
    mechanism = run.motion.mechanism
    ends = [end for load in mechanism.loads if isinstance(load, Spring) for end in zip(load.links, load.points, strict=True)]
    ends += [end for strut in find_struts(mechanism) for end in strut.ends]
    return [run.motion.point(*end) for end in ends]


def _between(a: Real, b: Real, kind: str, size: float) -> Callable[[Integers], tuple[Real, ...]]:
    length = np.hypot(*(b - a).T)
    least, most = float(np.nanmin(length)), float(np.nanmax(length))
    return lambda frames: strut_strips(a[frames], b[frames], least, most, POT * size, closed=kind != "damper")


def _around(centre: Real, first: Real, second: Real, size: float) -> Callable[[Integers], tuple[Real, ...]]:
    return lambda frames: (spiral_strips(centre[frames], first[frames], second[frames], size),)


def _axes(a: Real, b: Real) -> tuple[Real, Real, Real]:
    """Distances (n,), unit vectors along (n, 2) and across (n, 2) from a to b; where the points meet, along x."""
    d = b - a
    length = np.hypot(d[:, 0], d[:, 1])
    along = np.where((length > 0.0)[:, None], d / np.where(length > 0.0, length, 1.0)[:, None], [1.0, 0.0])
    return length, along, np.column_stack([-along[:, 1], along[:, 0]])


def _placed(a: Real, along: Real, across: Real, u: Real, v: Real) -> Real:
    """Points (n, p, 2) at distances u along and v across [m], each (n, p), from points a (n, 2)."""
    return a[:, None] + u[..., None] * along[:, None] + v[..., None] * across[:, None]


def strut_strips(a: Real, b: Real, least: float, most: float, width: float, *, closed: bool) -> tuple[Real, Real]:
    """A damper (a pot with a piston in it) or a gas spring (a closed cylinder with its rod) between points (n, 2).

    Pot and rod keep their lengths while the points move between their ``least`` and ``most`` distance.
    """
    length, along, across = _axes(a, b)
    pot = pot_length(least, most)
    plate = np.clip(length - (most - 0.92 * pot), 0.05 * pot, 0.95 * pot)  # where the piston is in the pot
    ones = np.ones_like(length)
    start = 0.0 if closed else 0.12 * pot  # a damper's pot hangs on a short rod of its own
    outline = [(0.0, 0.0), (start, 0.0), (start, width), (pot, width), (pot, -width), (start, -width), (start, 0.0)]
    if not closed:  # open at the end where the rod enters
        outline = [(pot, width), (start, width), (start, 0.0), (0.0, 0.0), (start, 0.0), (start, -width), (pot, -width)]
    u, v = (np.outer(ones, column) for column in zip(*outline, strict=True))
    body = _placed(a, along, across, u, v)
    zero, w = np.zeros_like(length), 0.8 * width * ones
    u = np.column_stack([length, plate, plate, plate])
    v = np.column_stack([zero, zero, w, -w])
    return body, _placed(a, along, across, u, v)


def ends_of_strut(body: Real, rod: Real, *, closed: bool) -> tuple[Real, Real]:
    """The points (n, 2) between which `strut_strips` has drawn a ``body`` and its ``rod``."""
    return body[:, 0 if closed else 3], rod[:, 0]


def spiral_strips(centre: Real, first: Real, second: Real, size: float) -> Real:
    """A spiral spring about centres (n, 2) from a link at angle ``second`` (n,) inside to one at ``first`` outside, in a mechanism
    of a ``size`` [m]."""
    part = np.linspace(0.0, 1.0, SPIRAL_POINTS)
    angle = second[:, None] + (first - second + 2.0 * np.pi * TURNS)[:, None] * part
    r = spiral_radius(part, size)
    return centre[:, None] + r[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def axis_of_spiral(spiral: Real, size: float) -> tuple[Real, Real, Real]:
    """Centres (n, 2) [m] of spirals (n, points, 2) that `spiral_strips` has drawn in a mechanism of a ``size`` [m], the angles (n,)
    [rad] at which they begin inside, and those through which they are wound.

    ``|z - c|^2 = r^2`` at the known radii r is linear in the centre c and in |c|^2.
    """
    r = spiral_radius(np.linspace(0.0, 1.0, spiral.shape[1]), size)
    middle = spiral.mean(axis=1)
    z = (spiral - middle[:, None]) / size
    equations = np.concatenate([2.0 * z, np.ones((*z.shape[:2], 1))], axis=2)
    found = np.linalg.pinv(equations) @ ((z**2).sum(axis=2) - (r / size) ** 2)[..., None]
    from_centre = (z - found[:, None, :2, 0]) @ np.array([1.0, 1.0j])
    steps = np.angle(from_centre[:, 1:] / from_centre[:, :-1])
    return middle + size * found[:, :2, 0], np.unwrap(np.angle(from_centre[:, 0])), steps.sum(axis=1)
