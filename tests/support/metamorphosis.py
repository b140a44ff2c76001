"""The same mechanism otherwise described: turned, mirrored, in other units, renamed and reordered, run backwards.

`Change` makes the other case of a case (`random_mechanisms`) and says what its results have to be.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from random_mechanisms import FRAME, Case, stated, wrapped

from mechcore import spec as sp
from mechcore.cams.followers import Flat
from mechcore.dynamics.events import EndStop, EventTrigger
from mechcore.laws.curve import MotionCurve
from mechcore.laws.indicator import Compressor, IndicatorDiagram
from mechcore.laws.timed import ConstantSpeed, Free, Oscillation, Piecewise, Table

TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Through:
    """``rise f((x - shift) / gain)``."""

    function: Any
    gain: float
    shift: float = 0.0
    rise: float = 1.0

    def __call__(self, x: Any) -> Any:
        return self.rise * np.asarray(self.function((np.asarray(x, float) - self.shift) / self.gain), float)


@dataclass(frozen=True)
class Change:
    """Places times ``length``, mirrored at the x axis, then turned by ``turn``; masses, times and names likewise.

    ``back``: the motion runs backwards from the last time of the case. ``mixed``: seed of new names and orders, None keeps them.
    """

    case: Case
    turn: float = 0.0
    mirrored: bool = False
    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0
    mixed: int | None = None
    back: Any = None  # the motion that is run backwards

    def __post_init__(self) -> None:
        names = [k.name for k in self.case.mechanism.links] + [p.name for p in self.case.mechanism.joints]
        names += [x.name for x in self.case.mechanism.loads]
        new = {n: n for n in names}
        swapped: frozenset[str] = frozenset()
        if self.mixed is not None:
            rng = np.random.default_rng(self.mixed)
            new = {n: f"{'zkbqa'[int(rng.integers(5))]}{int(i)}" for n, i in zip(names, rng.permutation(len(names)), strict=True)}
            joints = (sp.Revolute, sp.Prismatic, sp.PinSlot, sp.Weld, sp.Belt, sp.Gear)
            able = [p.name for p in self.case.mechanism.joints if isinstance(p, joints) and not getattr(p, "internal", False)]
            swapped = frozenset(n for n in able if rng.integers(2))
        object.__setattr__(self, "names", new)
        object.__setattr__(self, "swapped", swapped)

    names: Any = None
    swapped: Any = None

    # -- how values change --------------------------------------------------------------------------------------------
    @property
    def sense(self) -> float:
        return -1.0 if self.mirrored else 1.0

    @property
    def pace(self) -> float:
        """What rates are divided by."""
        return -self.time if self.back is not None else self.time

    @property
    def force(self) -> float:
        return self.length * self.mass / self.time**2

    def vector(self, z: Any) -> Any:
        """A direction in the world."""
        z = np.conj(z) if self.mirrored else np.asarray(z)
        return z * np.exp(1j * self.turn)

    def local(self, link: str, z: tuple[float, float], scale: float | None = None) -> tuple[float, float]:
        w = complex(*z)
        w = (self.length if scale is None else scale) * (w.conjugate() if self.mirrored else w)
        w = w * complex(np.exp(1j * self.turn)) if link == FRAME else w
        return w.real, w.imag

    def shift(self, first: str, second: str) -> float:
        """What is added to the angle of two links: the fixed link's axes stay those of the world."""
        return self.turn * ((first == FRAME) - (second == FRAME))

    def angle(self, first: str, second: str, start: float | None = None) -> tuple[float, float]:
        """Gain and shift of the angle of two links; ``start``: where it starts before, so that it starts in (-pi, pi] after."""
        shift = self.shift(first, second)
        if start is not None:
            there = self.sense * start + shift
            shift += wrapped(there) - there
        return self.sense, shift

    def coordinate(self, joint: str) -> tuple[float, float]:
        """Gain and shift of a joint's coordinate."""
        p = next(p for p in self.case.mechanism.joints if p.name == joint)
        if isinstance(p, sp.Prismatic | sp.PinSlot | sp.Rolling | sp.Cylinder):
            return self.length, 0.0
        sign = -1.0 if joint in self.swapped else 1.0
        gain, shift = self.angle(*p.links)
        gain, shift = sign * gain, sign * shift
        if joint in self.case.start and not any(d.joint == joint for d in self.case.mechanism.drives):
            there = gain * self.begin(joint) + shift
            shift += wrapped(there) - there
        return gain, shift

    def begin(self, joint: str) -> float:
        return self.case.start[joint] if self.back is None else float(self.back.coordinate(joint)[-1, 0])

    def open_start(self, first: str, second: str) -> float | None:
        """Where the angle of two links starts, in (-pi, pi]; None where the drives state it."""
        m = self.case.mechanism
        rotary = {p.name for p in m.joints if isinstance(p, sp.Revolute)}
        starts = {d.joint: float(d.law(np.zeros(1))[0][0]) for d in m.drives if d.joint in rotary}
        return self.case.turned(first, second) if stated(m.joints, starts, first, second) is None else None

    @property
    def exact_turns(self) -> bool:
        """Whether only quarter turns can be said: a factor depends on x or y."""
        factors = [getattr(x, "factor", None) for x in self.case.mechanism.loads]
        return any(f is not None and f.of in ("x", "y", "vx", "vy") for f in factors)

    # -- the other case -----------------------------------------------------------------------------------------------
    def made(self) -> Case:
        c, m = self.case, self.case.mechanism
        poses = c.poses if self.back is None else {k.name: tuple(self.back.pose(k.name)[-1]) for k in m.links}
        sketch = {}
        for link, (x, y, angle) in poses.items():
            z = self.length * complex(self.vector(complex(x, y)))
            sketch[link] = (z.real, z.imag, wrapped(self.sense * angle + (0.0 if link == FRAME else self.turn)))
        links = [self.link(k) for k in m.links]
        joints = [self.joint(p) for p in m.joints]
        loads = [self.load(x) for x in m.loads]
        drives = [self.drive(d) for d in m.drives]
        if self.mixed is not None:
            rng = np.random.default_rng(self.mixed + 1)
            for items in (links, joints, loads, drives):
                rng.shuffle(items)  # type: ignore[arg-type]
        g = complex(self.vector(complex(*m.gravity))) * self.length / self.time**2
        made = replace(
            m,
            frame=self.names[FRAME],
            links=tuple(links),
            joints=tuple(joints),
            loads=tuple(loads),
            drives=tuple(drives),
            gravity=(g.real, g.imag),
            sketch={self.names[k]: v for k, v in sketch.items() if k != FRAME} if m.sketch or self.back is not None else {},
            # a motion may have passed dead points: where it ends, the poses say how it is put together
            modes={self.names[p]: self.mode(p, x) for p, x in m.modes.items()} if self.back is None else {},
        )
        time = self.time * (c.time if self.back is None else c.time[-1] - c.time[::-1])
        stops, triggers = tuple(map(self.stop, c.stops)), tuple(map(self.watch, c.triggers))
        return replace(c, mechanism=made, time=time, stops=stops, triggers=triggers)

    def mode(self, joint: str, mode: str) -> str:
        return {"left": "right", "right": "left"}.get(mode, mode) if self.mirrored != (joint in self.swapped) else mode

    def link(self, k: sp.Link) -> sp.Link:
        return replace(
            k,
            name=self.names[k.name],
            points={p: self.local(k.name, z) for p, z in k.points.items()},
            mass=self.mass * k.mass,
            centre=self.local(k.name, k.centre),
            inertia=self.mass * self.length**2 * k.inertia,
        )

    def other(self, side: str) -> str:
        return {"left": "right", "right": "left"}[side] if self.mirrored else side

    def joint(self, p: Any) -> Any:
        n, L = self.names, self.length
        more: dict[str, Any] = {"name": n[p.name], "links": tuple(n[k] for k in p.links)}
        f = getattr(p, "friction", None)
        if f is not None:
            more["friction"] = replace(f, radius=L * f.radius, length=L * f.length, lever=L * f.lever)
        if isinstance(p, sp.Prismatic | sp.PinSlot):
            more["along"] = self.local(p.links[p.guide], p.along, 1.0)
        if isinstance(p, sp.Rolling):
            more |= {"along": self.local(p.links[0], p.along, 1.0), "radius": L * p.radius, "side": self.other(p.side)}
        if isinstance(p, sp.Prismatic | sp.Weld):
            gain, shift = self.angle(*p.links)
            more["angle"] = gain * p.angle + shift
        if isinstance(p, sp.Gear | sp.Belt):
            more["carrier"] = n[p.carrier]
        if isinstance(p, sp.Belt):
            more["radii"] = (L * p.radii[0], L * p.radii[1])
        if isinstance(p, sp.Rack):
            more |= {"slider": n[p.slider], "radius": L * p.radius, "side": self.other(p.side)}
        if isinstance(p, sp.CamJoint):
            more |= self.cam(p)
        made = replace(p, **more)
        if p.name not in self.swapped:
            return made
        again: dict[str, Any] = {"links": made.links[::-1]}
        if hasattr(p, "points"):
            again["points"] = made.points[::-1]
        if hasattr(p, "guide"):
            again["guide"] = 1 - p.guide
        if hasattr(p, "angle"):
            again["angle"] = -made.angle
        if hasattr(p, "sizes"):
            again["sizes"] = made.sizes[::-1]
        if hasattr(p, "radii"):
            again["radii"] = made.radii[::-1]
        return replace(made, **again)

    def cam(self, p: sp.CamJoint) -> dict[str, Any]:
        L = self.length
        guide = next(x for x in self.case.mechanism.joints if x.name == p.guide)
        assert p.lift is not None
        rise = L if isinstance(guide, sp.Prismatic) else 1.0
        lift = MotionCurve(tuple(x.scaled(1.0, rise) for x in p.lift.pieces), p.lift.start, p.lift.repeats)
        face: Any = p.face if not hasattr(p.face, "radius") or not p.face.radius else replace(p.face, radius=L * p.face.radius)
        assert not isinstance(face, Flat) or face.left == face.right == np.inf
        sense = int(p.sense * self.sense)
        shift = self.shift(FRAME, p.links[0])
        more = {"guide": self.names[p.guide], "lift": lift, "face": face, "base": L * p.base, "side": self.other(p.side)}
        return more | {"sense": sense, "phase": p.phase - sense * shift}

    def law(self, law: Any, gain: float, shift: float) -> Any:
        back, s = self.back is not None, self.time
        end = float(self.case.time[-1])
        if isinstance(law, ConstantSpeed):
            start, speed = (law.start + law.speed * end, -law.speed) if back else (law.start, law.speed)
            travel = law.travel if abs(gain) == 1.0 else self.length * law.travel
            return ConstantSpeed(gain * start + shift, gain * speed / s, travel)
        if isinstance(law, Oscillation):
            phase = np.pi - TURN * law.frequency * end - law.phase if back else law.phase
            return Oscillation(gain * law.centre + shift, gain * law.amplitude, law.frequency / s, phase)
        assert isinstance(law, Piecewise)
        knots, rows = list(law.knots), [np.array(c) for c in law.coefficients]
        if back:
            u = [np.polynomial.Polynomial([b - a, -1.0]) for a, b in itertools.pairwise(knots)]
            rows = [np.polynomial.Polynomial(c)(x).coef for c, x in zip(rows, u, strict=True)][::-1]
            knots = [end - k for k in knots[::-1]]
        rows = [gain * c / s ** np.arange(len(c)) for c in rows]
        for c in rows:
            c[0] += shift
        advance = gain * law.advance * (-1.0 if back else 1.0)
        return Piecewise(tuple(s * k for k in knots), tuple(tuple(c) for c in rows), advance)

    def drive(self, d: sp.Drive) -> sp.Drive:
        gain, shift = self.coordinate(d.joint)
        if isinstance(d.law, Free):
            q, v = d.law.start, d.law.speed
            if self.back is not None:
                q, v = self.back.coordinate(d.joint)[-1, :2]
            return sp.Drive(joint=self.names[d.joint], law=Free(float(gain * q + shift), float(gain * v / self.pace)))
        return sp.Drive(joint=self.names[d.joint], law=self.law(d.law, gain, shift))

    def stop(self, s: EndStop) -> EndStop:
        gain, shift = self.coordinate(s.joint)
        side: Any = s.side if gain > 0.0 else {"upper": "lower", "lower": "upper"}[s.side]
        return replace(s, joint=self.names[s.joint], at=gain * s.at + shift, side=side)

    def watch(self, w: EventTrigger) -> EventTrigger:
        assert w.joint is not None
        gain, shift = self.coordinate(w.joint)
        return replace(w, joint=self.names[w.joint], at=gain * w.at + shift)

    def factor(self, f: sp.Factor | None) -> sp.Factor | None:
        if f is None:
            return None
        more: dict[str, Any] = {}
        gain, shift = 1.0, 0.0
        if f.of == "time":
            gain, shift = (self.time, 0.0) if self.back is None else (-self.time, self.time * float(self.case.time[-1]))
        elif f.of in ("position", "velocity"):
            assert f.joint is not None
            gain, shift = self.coordinate(f.joint)
            if f.of == "velocity":
                gain, shift = gain / self.pace, 0.0
            more["joint"] = self.names[f.joint]
        else:
            assert f.point is not None
            more["point"] = (self.names[f.point[0]], f.point[1])
            gain = self.length if f.of in "xy" else self.length / self.time
            if f.of != "speed":
                quarter = round(self.turn / (np.pi / 2)) % 4
                assert abs(wrapped(self.turn - quarter * np.pi / 2)) < 1e-12
                plain, across = f.of[-1], {"x": "y", "y": "x"}[f.of[-1]]
                signs = {"x": (1, 1, -1, -1), "y": (1, -1, -1, 1)}[plain]
                gain *= signs[quarter] * (self.sense if plain == "y" else 1.0)
                more["of"] = f.of[:-1] + (across if quarter % 2 else plain)
                if f.of[0] == "v" and self.back is not None:
                    gain = -gain
        if isinstance(f.function, Table):
            t = f.function
            rows = sorted(zip((gain * x + shift for x in t.x), t.y, strict=True))
            function: Any = Table(tuple(x for x, _ in rows), tuple(y for _, y in rows), t.period, t.smooth)
        else:
            function = Through(f.function, gain, shift)
        return replace(f, function=function, **more)

    def load(self, x: Any) -> Any:
        n, F, L, T = self.names, self.force, self.length, self.pace
        more: dict[str, Any] = {"name": n[x.name]}
        for key in ("link", "against"):
            if getattr(x, key, None) is not None:
                more[key] = n[getattr(x, key)]
        if hasattr(x, "links"):
            more["links"] = tuple(n[k] for k in x.links)
        if getattr(x, "joint", None) is not None:
            more["joint"] = n[x.joint]
        if hasattr(x, "factor"):
            more["factor"] = self.factor(x.factor)
        if isinstance(x, sp.Force):
            z = complex(*x.vector)
            local = z.conjugate() if self.mirrored else z
            z = F * (complex(self.vector(z)) if x.axes == "world" else local)
            return replace(x, **more, vector=(z.real, z.imag))
        if isinstance(x, sp.Torque):
            return replace(x, **more, moment=self.sense * F * L * x.moment)
        if isinstance(x, sp.Spring):
            return replace(x, **more, stiffness=F / L * x.stiffness, free_length=L * x.free_length, preload=F * x.preload)
        if isinstance(x, sp.TorsionSpring):
            gain, shift = self.angle(*x.links, start=self.open_start(*x.links) if self.back is None else None)
            return replace(x, **more, stiffness=F * L * x.stiffness, free_angle=gain * x.free_angle + shift)
        if isinstance(x, sp.Damper):
            return replace(x, **more, linear=F / L * abs(T) * x.linear, quadratic=F / L**2 * T**2 * x.quadratic)
        if isinstance(x, sp.TorsionDamper):
            return replace(x, **more, coefficient=F * L * abs(T) * x.coefficient)
        if isinstance(x, sp.Drag):
            arm = 1.0 if x.point is not None else L
            rate = L if x.point is not None else 1.0
            return replace(x, **more, linear=F * arm / rate * abs(T) * x.linear, quadratic=F * arm / rate**2 * T**2 * x.quadratic)
        if isinstance(x, sp.Viscous):
            p = next(p for p in self.case.mechanism.joints if p.name == x.joint)
            slides = isinstance(p, sp.Prismatic | sp.PinSlot | sp.Cylinder)
            return replace(x, **more, coefficient=F * abs(T) * (1.0 / L if slides else L) * x.coefficient)
        if isinstance(x, sp.GasSpring):
            return replace(x, **more, force=F * x.force, extended=L * x.extended, gas_length=L * x.gas_length)
        if isinstance(x, sp.DcMotor):
            gain, _ = self.coordinate(x.joint)  # type: ignore[arg-type]
            return replace(x, **more, stall_torque=gain * F * L * x.stall_torque, no_load_speed=gain / abs(T) * x.no_load_speed)
        assert isinstance(x, sp.GasPressure)
        p = F / L**2
        c: Any = x.cycle
        if isinstance(c, Compressor):
            c = replace(c, stroke=L * c.stroke, suction=p * c.suction, delivery=p * c.delivery)
        else:
            c = IndicatorDiagram(stroke=L * c.stroke, outward=Through(c.outward, L, 0.0, p), inward=Through(c.inward, L, 0.0, p))
        return replace(x, **more, area=L**2 * x.area, cycle=c, top=L * x.top, back=p * x.back)
