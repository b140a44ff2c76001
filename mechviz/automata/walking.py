"""A walk on level ground of a mechanism whose frame is the body of an animal or a toy: the lowest foot stands still.

The body keeps its attitude. At every time the foot that is lowest in the body's axes stands on the ground: the body moves opposite
to that foot's motion in these axes. Where another foot takes over, the speed of the body may jump. Feet that touch the ground
without being the lowest slip.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mechcore.arrays import Complex, Index, Real
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass
from mechviz.runs import run_scene
from mechviz.scene.scene import Scene

GROUND, CART, LAWN = "ground", "cart", "lawn"
SLIDES = ("along", "up")
_GREEN = "#7aa35a"
_BEYOND = 2.6  # of the body's height: how far the lawn extends beyond its path
_FEWEST = 8  # rows of a table
_SHORTEST = 1e-9  # of a cycle: shorter stances are left out
_TABLE = 240  # rows of a cycle, beside the places where another foot takes over


@dataclass(frozen=True, eq=False)
class Walk:
    """A walk over one cycle at ``time`` (F,) [s]: ``body`` (F,) the place of the body's axes in the world [m], the first at x = 0;
    ``rate`` its velocity (F,) [m/s], ``foot`` (F,) the index of the foot that stands. A time at which another foot takes over is in
    ``time`` twice, with the velocities before and after.

    ``advance`` [m] in the cycle; ``bounce`` [m]: range of the body's height; ``shares`` of the cycle in which each foot stands;
    ``slips`` [m]: distance that each foot slips in the cycle, while it is not higher than ``touch`` above the ground and another
    one stands.
    """

    feet: tuple[str, ...]
    time: Real
    body: Complex
    rate: Complex
    foot: Index
    advance: float
    bounce: float
    shares: tuple[float, ...]
    slips: tuple[float, ...]
    touch: float


def walk_of(scene: Scene, feet: Sequence[tuple[str, str]], touch: float) -> Walk:
    """The walk of a scene whose fixed link is the body, on its ``feet``: links and their points. ``touch`` [m], see `Walk`.

    Raises `MechanismError` where there are fewer than two feet, or where the motion does not repeat.
    """
    names = tuple(f"{link}.{point}" for link, point in feet)
    if len({*feet}) < len(feet) or len(feet) < 2:
        count = "a foot is named twice" if len({*feet}) < len(feet) else f"{len(feet)} feet"
        raise MechanismError(Fault("feet", f"{count}: at least two take turns.", "Name another one."))
    motion = run_scene(scene.changed({("run", "frames"): _TABLE, ("run", "cycles"): 1})).motion
    place, rate = (np.stack([motion.point(*foot, k) @ np.array([1.0, 1.0j]) for foot in feet]) for k in (0, 1))
    distance = float(np.abs(place[:, -1] - place[:, 0]).max())
    if distance > 1e-6 * float(np.abs(place).max()):
        raise MechanismError(Fault("feet", "their paths do not close in a cycle of the drive.", "Let the drive turn once."))
    t, z, v, foot = _with_changes(motion.time, place, rate)
    step, frames = np.diff(t), np.arange(len(t))
    speed = -v[foot, frames]
    back = -np.diff(z.real, axis=1)[foot[1:], frames[1:] - 1]  # the body moves opposite to the foot that stands
    x = np.concatenate([[0.0], np.cumsum(np.where(step > 0.0, back, 0.0))])
    body = x - 1j * z[foot, frames].imag
    above = z.imag - z.imag.min(axis=0) - touch
    slips = [_distance_while(np.abs((v[k] + speed).real), above[k], step) for k in range(len(feet))]
    stands = [float(np.sum(step[(foot[1:] == k) & (foot[:-1] == k)]) / (t[-1] - t[0])) for k in range(len(feet))]
    bounce = float(np.ptp(body.imag))
    return Walk(names, t, body, speed, foot, float(x[-1]), bounce, tuple(stands), tuple(slips), touch)


def _distance_while(speed: Real, above: Real, step: Real) -> float:
    """The distance [m] covered at speeds (F,) [m/s] while a height (F,) is not above zero; both are linear between frames, ``step``
    (F - 1,) [s] apart."""
    a, b = above[:-1], above[1:]
    on = (a <= 0.0) | (b <= 0.0)
    change = np.where((a <= 0.0) == (b <= 0.0), 0.0, a / np.where(a == b, 1.0, a - b))
    start, end = np.where(a <= 0.0, 0.0, change), np.where(b <= 0.0, 1.0, change)
    mean = speed[:-1] + 0.5 * (start + end) * np.diff(speed)
    return float(np.sum(np.where(on, mean * (end - start) * step, 0.0)))


def _with_changes(time: Real, place: Complex, rate: Complex) -> tuple[Real, Complex, Complex, Index]:
    """Times, places and velocities of all feet, and the foot that stands. The times at which that changes are inserted, each
    twice."""
    lowest = np.argmin(place.imag, axis=0)
    times, places, rates, feet = [time[:1]], [place[:, :1]], [rate[:, :1]], [lowest[:1]]
    for k in range(len(time) - 1):
        a, b = lowest[k], lowest[k + 1]
        if a != b:
            h = time[k + 1] - time[k]
            d0, d1 = (place[a, j].imag - place[b, j].imag for j in (k, k + 1))
            u = d0 / (d0 - d1)
            for which in (a, b):
                times.append(np.array([time[k] + u * h]))
                places.append(_between(place[:, k], place[:, k + 1], rate[:, k], rate[:, k + 1], u, h)[:, None])
                rates.append(((1.0 - u) * rate[:, k] + u * rate[:, k + 1])[:, None])
                feet.append(np.array([which]))
        times.append(time[k + 1 : k + 2])
        places.append(place[:, k + 1 : k + 2])
        rates.append(rate[:, k + 1 : k + 2])
        feet.append(lowest[k + 1 : k + 2])
    return np.concatenate(times), np.concatenate(places, axis=1), np.concatenate(rates, axis=1), np.concatenate(feet)


def _between(a: Complex, b: Complex, da: Complex, db: Complex, u: float, h: float) -> Complex:
    """Cubic Hermite interpolation at the part ``u`` of a step ``h``, from places and rates at its ends."""
    w = 1.0 - u
    return a * w * w * (1.0 + 2.0 * u) + b * u * u * (1.0 + 2.0 * w) + h * (da * u * w * w - db * u * u * w)


def walking_scene(scene: Scene, walk: Walk, name: str) -> Scene:
    """The scene with the ground as its fixed link: two slides lead the body along it as in the walk; the feet are traced."""
    document = scene.document
    data = document.to_data()
    taken = [key for key in (GROUND, CART, LAWN) if key in document.links] + [
        key for key in (*SLIDES, LAWN) if key in document.joints
    ]
    if taken:
        raise MechanismError(Fault("links", f"a part is called '{taken[0]}' already.", "Rename it."))
    low = float(walk.body.imag.min())
    data["frame"] = GROUND
    body = dict(data["links"][document.frame])
    px, py = next(iter({link.name: link for link in scene.mechanism.links}[document.frame].points.values()))
    body["points"] = {**body["points"], CART: [f"{1e3 * px:.9g} mm", f"{1e3 * py:.9g} mm"]}
    data["links"] = {
        GROUND: {"points": {GROUND: ["0 mm", "0 mm"]}, "looks": "nothing"},
        CART: {"points": {GROUND: ["0 mm", "0 mm"], CART: ["0 mm", f"{0.5e3 * low:.9g} mm"]}, "looks": "nothing"},
        LAWN: {"points": {GROUND: ["0 mm", "0 mm"]}, "outline": _lawn(walk), "colour": _GREEN},
        **{link: body if link == document.frame else table for link, table in data["links"].items()},
    }
    changes = np.flatnonzero(np.diff(walk.time) == 0.0) + 1
    shortest = _SHORTEST * float(walk.time[-1] - walk.time[0])  # feet that touch the ground together take over at one instant
    stances = [
        (t, z) for t, z in zip(np.split(walk.time, changes), np.split(walk.body, changes), strict=True) if t[-1] - t[0] > shortest
    ]
    guides = {"along": ([GROUND, CART], GROUND, [1, 0]), "up": ([CART, document.frame], CART, [0, 1])}
    for key, (links, point, along) in guides.items():
        samples = [(t, z.real + px if key == "along" else z.imag + py - 0.5 * low) for t, z in stances]
        drive = {
            "start": f"{1e3 * samples[0][1][0]:.9g} mm",
            "segments": [_stance(t, values) for t, values in samples],
        }
        data["joints"][key] = {"prismatic": links, "at": point, "along": along, "drive": drive}
    data["joints"][LAWN] = {"weld": [GROUND, LAWN], "at": GROUND}
    data["trace"] = list(dict.fromkeys([*data.get("trace", []), *walk.feet]))
    data["title"] = f"{scene.title}, walking"
    return Scene.build(name=name, folder=scene.folder, **data)


def _lawn(walk: Walk) -> list[list[str]]:
    """Corners of a strip of ground under the whole path."""
    height = float(walk.body.imag.max())
    left, right = walk.body.real.min() - _BEYOND * height, walk.body.real.max() + _BEYOND * height
    return [
        [f"{1e3 * x:.4g} mm", f"{1e3 * y:.4g} mm"]
        for y, ends in ((-0.2 * height, (left, right)), (0.0, (right, left)))
        for x in ends
    ]


def _stance(time: Real, values: Real) -> dict[str, Any]:
    """The segment of a drive for the positions of a slide while one foot stands."""
    after = time - time[0]
    if len(time) < _FEWEST:
        after, values = (
            np.linspace(0.0, after[-1], _FEWEST),
            np.interp(np.linspace(0.0, after[-1], _FEWEST), after, values),
        )
    table = {"at": [f"{t:.9g} s" for t in after], "values": [f"{1e3 * x:.9g} mm" for x in values]}
    return {"duration": f"{after[-1]:.9g} s", "law": {"position": table}}
