"""Events of the cams of a mechanism over a run: contact lost and regained, infinite jerk, pressure angles beyond a limit."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np

from mechcore.arrays import Flags, Real
from mechcore.cams.followers import Flat
from mechcore.cams.placement.plane import KNOT_DISTANCE, PlacedCam, argument_rate_of
from mechcore.forces.cam_rating import PULL_ROUNDING, AnyCam, contact_force, contact_stress, drawn_lift, joint_of, placed_cams
from mechcore.forces.kinetostatics import Forces
from mechcore.forces.load_events import load_exceedances
from mechcore.laws.factors import VELOCITY_JUMP, jumps
from mechcore.motion.between_frames import Exceedance, exceedances, zeros
from mechcore.motion.events import Event, at_drive
from mechcore.motion.motion import Motion
from mechcore.spec.mechanism import CamDrawn, CamRating, Revolute
from mechcore.texts import as_angle, as_coordinate, as_force, as_length, as_pressure

ON_PLACE = 1e-9  # part of a law's length: a frame so near to a place of the law is there


def cam_events(motion: Motion, forces: Forces | None, touches: Mapping[str, Flags] | None = None) -> list[Event]:
    """Events of all cams of a run, in order of time. ``touches``: at which frames (F,) followers that may leave their cams touch
    them."""
    events: list[Event] = []
    for cam in placed_cams(motion):
        if not motion.frames:
            continue
        on = (touches or {}).get(cam.name)
        met = [*_shocks(motion, cam), *_leaps(motion, cam)]
        events += met if on is None else [e for e in met if on[np.searchsorted(motion.time, e.time, side="right") - 1]]
        events += _beyond(motion, cam)
        events += limit_events(motion, cam, on)
        if forces is not None and not cam.form_closed and on is None:  # a follower that may leave its cam has its own events
            events += _lost(forces, cam)
        joint = joint_of(motion, cam)
        if forces is not None and joint.rating is not None:
            events += _rated(forces, cam, joint.rating, np.ones(motion.frames, bool) if on is None else on)
        if joint.drawn is not None:
            events.append(_drawn(motion, cam, joint.drawn))
    return sorted(events, key=lambda e: e.time)


def _rated(forces: Forces, cam: AnyCam, rating: CamRating, touches: Flags) -> Iterator[Event]:
    """Hertz pressure beyond its limit, and contact force below its margin, where the follower ``touches`` its cam (F)."""
    motion = forces.motion
    if rating.width is not None and rating.limit is not None:
        for high in load_exceedances(forces, lambda f: contact_stress(f, cam, rating).pressure, rating.limit, touches):
            words = as_pressure(high.value, 4) if np.isfinite(high.value) else "infinity: an edge touches"
            remedy = f"It needs a width of {as_length(rating.width * (high.value / rating.limit) ** 2, 4)}"
            text = (
                f"Hertz pressure up to {words} (limit {as_pressure(rating.limit, 4)}) {_range(motion, cam, high)}, "
                f"the most at {_where_at(motion, cam, high.at)}. {remedy if np.isfinite(high.value) else 'Round it'}"
            )
            yield Event(high.start, "WARN", cam.name, text, high.value)
    if rating.margin is not None and not cam.form_closed:
        pull = PULL_ROUNDING * float(np.nanmax(np.abs(contact_force(forces, cam)), initial=0.0))
        for low in load_exceedances(forces, lambda f: -contact_force(f, cam), -rating.margin, touches):
            if low.value > pull:
                continue  # contact is lost, which is an event of its own
            text = (
                f"contact force down to {as_force(max(-low.value, 0.0), 4)} (margin {as_force(rating.margin, 4)}) "
                f"{_range(motion, cam, low)}, the least at {_where_at(motion, cam, low.at)}"
            )
            yield Event(low.start, "WARN", cam.name, text, -low.value)


def _drawn(motion: Motion, cam: AnyCam, drawn: CamDrawn) -> Event:
    """Event with the error of the graphical method."""
    s, v, a = 100.0 * drawn_lift(cam, drawn).largest
    text = (
        f"drawn every {as_angle(drawn.step, 4)} and differentiated by {drawn.lines}s, the lift is off by {s:.3g} %, the "
        f"velocity by {v:.3g} %, the acceleration by {a:.3g} % of their largest values"
    )
    return Event(float(motion.time[0]), "INFO", cam.name, text)


def _where(cam: AnyCam, argument: float) -> str:
    """A place of the law in words."""
    rotary = cam.bed is None
    return f"{as_coordinate(argument % (2.0 * np.pi) if rotary else argument, rotary=rotary, digits=4)} of the cam"


def _drives_at(motion: Motion, t: float) -> str:
    """Positions of the drives at a time in words, after a comma; empty where there are none."""
    places = at_drive(motion, t)
    return f", {places}" if places else ""


def _where_at(motion: Motion, cam: AnyCam, t: float) -> str:
    """The place of the law that the cam passes at a time, in words."""
    return _where(cam, _at(motion, cam.argument, t))


def _range(motion: Motion, cam: AnyCam, span: Exceedance) -> str:
    """The places of the law over an interval of time in words."""
    first, last = np.interp([span.start, span.end], motion.time, _arguments(motion, cam))
    if cam.bed is None and abs(last - first) >= 2.0 * np.pi * (1.0 - KNOT_DISTANCE):
        return "over the whole turn"
    return f"from {_where_at(motion, cam, span.start)} to {_where_at(motion, cam, span.end)}"


def _at(motion: Motion, values: Callable[[Motion], Real], t: float) -> float:
    """A quantity at one time."""
    return float(values(motion.at_times(np.array([t])))[0] if motion.at_times else np.interp(t, motion.time, values(motion)))


def _arguments(motion: Motion, cam: AnyCam) -> Real:
    x = cam.argument(motion)
    return x if cam.bed is not None else np.unwrap(x)


def _lost(forces: Forces, cam: AnyCam) -> Iterator[Event]:
    """Loss and return of contact: where a force-closed cam would have to pull its follower."""
    motion = forces.motion
    n, time = contact_force(forces, cam), forces.motion.time
    largest = float(np.nanmax(np.abs(n), initial=0.0))
    for pull in load_exceedances(forces, lambda f: -contact_force(f, cam), PULL_ROUNDING * largest):
        t = pull.start
        text = (
            f"contact lost at {_where_at(motion, cam, t)}{_drives_at(motion, t)}{_turning(motion, t)}: the cam would have to pull "
            f"with up to {as_force(pull.value, 4)}. Press harder by {as_force(_lacking(forces, cam, pull), 4)} along the "
            "follower's path, or turn slower"
        )
        yield Event(t, "WARN", cam.name, text, -pull.value)
        behind = int(np.searchsorted(time, pull.end, side="right"))
        if behind < len(time) and not np.isnan(n[behind]):  # neither does the run end there, nor does it jam
            t = pull.end
            yield Event(t, "INFO", cam.name, f"contact regained at {_where_at(motion, cam, t)}{_drives_at(motion, t)}")


def _turning(motion: Motion, t: float) -> str:
    """Speed of the first drive in words; empty where it slides."""
    drives = motion.mechanism.drives
    if not drives or not any(p.name == drives[0].joint and isinstance(p, Revolute) for p in motion.mechanism.joints):
        return ""
    return f" at {abs(_at(motion, lambda m: m.coordinate(drives[0].joint)[:, 1], t)) * 30.0 / np.pi:.5g} rpm"


def _lacking(forces: Forces, cam: AnyCam, pull: Exceedance) -> float:
    """The force along the follower's motion [N] that would just keep it on its cam while this has to pull; where the pressure angle
    is unknown (a base circle that is a point), an upper bound."""

    def along(f: Forces) -> Real:
        return -contact_force(f, cam) * np.cos(np.nan_to_num(cam.rows(f.motion).pressure_angle))

    time = forces.motion.time
    largest = along(forces)[(time >= pull.start) & (time <= pull.end)]
    if forces.motion.at_times is not None:
        largest = np.append(largest, along(forces.at_times(np.array([pull.at]))))
    return float(np.max(largest))


def _shocks(motion: Motion, cam: AnyCam) -> Iterator[Event]:
    """Steps of the law's velocity and acceleration, each time the cam passes them."""
    law = cam.cam.law
    steps = [*jumps(law, (1,), VELOCITY_JUMP, law.repeats), *jumps(law, (2,), ends=law.repeats)]
    if not steps:
        return
    leaps = [b.angle for b in cam.bridges]
    named: list[float] = []
    for step in steps:
        if any(abs(step.angle - a) < 1e-9 * law.length for a in (*named, *leaps)):
            continue  # where the velocity jumps, a jump of the acceleration is not reported
        named.append(step.angle)
        what = "the velocity jumps: a knock" if step.order == 1 else "the acceleration jumps: infinite jerk"
        for t in _passes(motion, cam, step.angle):
            text = f"{what} at {_where(cam, step.angle * cam.law_scale)}{_drives_at(motion, t)}"
            yield Event(t, "WARN" if step.order == 1 else "INFO", cam.name, text)


def _passes(motion: Motion, cam: AnyCam, place: float) -> list[float]:
    """Times at which the law's argument passes a place of the law, that at the end of the run included, that at its start not."""
    law = cam.cam.law
    x = _arguments(motion, cam) * cam.law_scale
    if not np.isfinite(x).all():
        return []
    period = law.length if law.repeats else 2.0 * np.pi if cam.bed is None else np.inf
    places: list[Real] = []
    laps = range(int(np.floor((x.min() - place) / law.length)), int(np.ceil((x.max() - place) / law.length)) + 1)
    for lap in laps if law.repeats else (0,):
        distance = x - (place + lap * law.length)
        side = np.where(np.abs(distance) <= ON_PLACE * law.length, 0.0, np.sign(distance))
        beside = np.append(np.flatnonzero(side), motion.frames if side[-1] == 0.0 else [])  # at the end it arrives
        for i, j in itertools.pairwise(beside.astype(int)):
            if j == motion.frames or side[i] != side[j]:
                k = min(i + 1, motion.frames - 1)
                share = distance[i] / (distance[i] - distance[k])
                found = motion.time[i] + share * (motion.time[k] - motion.time[i]) if side[k] else motion.time[k]
                places.append(np.array([motion.time[i], found, motion.time[k]]))

    def rows(m: Motion) -> Real:
        """Distance from the place, and its rate (F, 2)."""
        off = cam.argument(m) * cam.law_scale - place
        near = off if np.isinf(period) else off - period * np.rint(off / period)
        return np.stack([near, cam.law_scale * argument_rate_of(cam, m)], axis=-1)

    return sorted(map(float, zeros(motion, rows, np.array(places).reshape(-1, 3))))


def _leaps(motion: Motion, cam: AnyCam) -> Iterator[Event]:
    """Leaps of the contact from one place of a given profile to another, and undercut of an intended profile by the cutter."""
    if not isinstance(cam, PlacedCam):
        return
    for bridge in cam.bridges:
        before, after = bridge.velocity
        knock = ": the velocity jumps, a knock" if bridge.shock else ""
        point = cam.contour(np.array([bridge.leaves, bridge.lands]))[0]
        distance = abs(point[1] - point[0])
        what = (
            "the contact passes a corner"
            if distance < 1e-6 * cam.contour.size
            else f"the contact leaps {as_length(distance, 4)} over a hollow"
        )
        for t in _passes(motion, cam, bridge.angle):
            text = f"{what}{knock} at {_where(cam, bridge.angle)}{_drives_at(motion, t)}"
            yield Event(t, "WARN" if bridge.shock else "INFO", cam.name, text, after - before)
    for first, last, at, deviation in lost_ranges(cam):
        size = as_coordinate(abs(deviation), rotary=cam.arm != 0.0, digits=4)
        for t in _passes(motion, cam, first):
            text = (
                f"undercut from {_where(cam, first)} to {_where(cam, last)}: the cutter takes away what the law asks for, and the "
                f"follower misses it by up to {size} (at {_where(cam, at)})"
            )
            yield Event(t, "WARN", cam.name, text, deviation)


def _beyond(motion: Motion, cam: AnyCam) -> Iterator[Event]:
    """Motion beyond the ends of a law that does not repeat, of a wedge or an inverse cam: one event for either end."""
    law = cam.cam.law
    if law.repeats:
        return
    low, high = sorted(float(k) * cam.law_scale + 0.0 for k in law.knots[[1, -2]])  # between the level pieces that were added
    x = _arguments(motion, cam)
    for far in (low - x, x - high):
        out = np.flatnonzero(far > 1e-9 * (high - low))
        if not len(out):
            continue
        k = int(out[np.argmax(far[out])])
        ends = f"its law, which goes from {_where(cam, low)} to {_where(cam, high)}"
        if cam.bed is None and far[k] > np.pi - 0.5 * (high - low):
            text = f"the crank turns round: it leaves {ends}, and its slot, where nothing leads the follower. Let it swing"
            yield Event(float(motion.time[out[0]]), "WARN", cam.name, text, float(x[k]))
            return
        text = f"beyond {ends}, as far as {_where(cam, x[k])}: the follower rests there"
        yield Event(float(motion.time[out[0]]), "INFO", cam.name, text, float(x[k]))


def lost_ranges(cam: AnyCam) -> list[tuple[float, float, float, float]]:
    """Ranges of the law that are lost by undercut: start, end, position of the largest deviation of the follower, and this
    deviation."""
    ranges = []
    for first, last in cam.lost_ranges if cam.intended is not None else ():
        grid = np.linspace(first, last, 181)
        deviation = cam.cam.law(grid, 0)[0] - cam.intended.law(grid, 0)[0]  # type: ignore[union-attr]  # not None here
        k = int(np.argmax(np.abs(deviation)))
        ranges.append((first, last, float(grid[k]), float(deviation[k])))
    return ranges


def _pressure_angle(cam: AnyCam, what: str, m: Motion) -> Real:
    return np.abs(cam.pressure_angles(m)[what])


def _eccentricity(cam: AnyCam, side: float, m: Motion) -> Real:
    return np.asarray(side * cam.rows(m).eccentricity)


def limit_events(motion: Motion, cam: AnyCam, touches: Flags | None = None) -> Iterator[Event]:
    """Pressure angles beyond the limit, and contacts beyond the ends of a flat face, where the follower ``touches`` its cam (F)."""
    if cam.pressure_limit is not None:
        for what in cam.pressure_angles(motion):
            for steep in exceedances(motion, partial(_pressure_angle, cam, what), cam.pressure_limit, touches):
                text = (
                    f"pressure angle{what} up to {as_angle(steep.value, 4)} (limit {as_angle(cam.pressure_limit, 4)}) "
                    f"{_range(motion, cam, steep)}. Enlarge the base circle or move the follower"
                )
                yield Event(steep.start, "WARN", cam.name, text, steep.value)
    face = cam.face
    if not isinstance(face, Flat):
        return
    for side, end in ((-1.0, face.left), (1.0, face.right)):
        for off in exceedances(motion, partial(_eccentricity, cam, side), end, touches) if np.isfinite(end) else ():
            text = (
                f"the contact leaves the face at {_where_at(motion, cam, off.start)}: it reaches {as_length(side * off.value, 4)} "
                "from the follower's point. Motion and forces are those of a longer face"
            )
            yield Event(off.start, "WARN", cam.name, text, side * off.value)
