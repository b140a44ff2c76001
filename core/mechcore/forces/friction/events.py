"""Events of friction: changes of sign, jams with their edges found between frames, self-locking, and the losses over a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from mechcore.arrays import Real
from mechcore.forces.friction.elements import Element, relative_rate
from mechcore.forces.friction.losses import losses_of_run
from mechcore.forces.friction.solve import FrictionResult
from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.motion.between_frames import intervals, zeros
from mechcore.motion.events import Event, at_drive, turning_places
from mechcore.motion.motion import Motion
from mechcore.numerics.frames import runs
from mechcore.records import dataclass

INTERVAL_PARTS = 16  # into which an interval is divided at every round of the search for an edge
EVEN_PARTS = np.linspace(0.0, 1.0, INTERVAL_PARTS + 1)
BEYOND = np.array([0.5, 1.0])  # parts of an interval in the jam: they show how fast the reached proportion falls
SEARCH_ROUNDS = 7  # 16^7 = 3e8 places between two frames
NEAR_STABILITY = 0.7  # stability below which a minimum between frames is searched
MOST_CANDIDATES = 24


@dataclass(frozen=True)
class Jam:
    """An interval of time [s] in which the drives cannot move the mechanism, and the joints whose friction causes it."""

    start: float
    end: float
    joints: tuple[str, ...]
    movable_share: float  # smallest proportion of the coefficients with which it could still be moved


def sign_changes(forces: Forces) -> list[tuple[float, str]]:
    """Times [s], between frames too, at which the relative motion of a joint with friction reverses, and the joint."""
    friction = forces.friction
    if friction is None:
        return []
    motion = forces.motion
    changes = []
    for e in friction.elements:
        if not np.isfinite(e.rate).all() or not e.sign.any() or e.place is not None:  # cams: rates at frames only
            continue

        def rows(m: Motion, e: Element = e) -> Real:
            """Relative speed and acceleration (F, 2)."""
            return np.stack([relative_rate(m, of, e.what, e.index, e.links) for of in (m.speeds, m.accelerations)], axis=-1)

        places = turning_places(motion.time, np.where(e.sign == 0.0, 0.0, e.rate), rows(motion)[:, 1])
        changes += [(float(t), e.joint) for t in zeros(motion, rows, places)]
    return sorted(set(changes))


def find_jams(forces: Forces) -> list[Jam]:
    """All jams of a run. Their edges, and jams that begin and end between two frames, are located where the motion is available at
    other times."""
    friction = forces.friction
    if friction is None:
        return []
    time = forces.motion.time
    friction_at = _friction_at(forces)
    near = forces.motion.accuracy.event * float(np.max(np.diff(time), initial=0.0))
    jams = []
    for first, last in runs(friction.jammed):
        frame = first + int(np.argmin(friction.movable_share[first : last + 1]))
        start, end = float(time[first]), float(time[last])
        if friction_at is not None:
            inner = start, end
            start = _edge(friction_at, float(time[first - 1]), start, inner[1], near) if first else start
            end = _edge(friction_at, float(time[last + 1]), end, inner[0], near) if last + 1 < len(time) else end
        jams.append(Jam(start, end, friction.jammed_by(frame), float(friction.movable_share[frame])))
    if friction_at is not None:
        for jam in _hidden(friction_at, friction, time, near):  # two minima may lead to the same jam
            if not any(jam.start <= known.end and known.start <= jam.end for known in jams):
                jams.append(jam)
    return sorted(jams, key=lambda jam: jam.start)


def _friction_at(forces: Forces) -> Callable[[Real], FrictionResult] | None:
    """A function that gives the friction of the same motion at other times; None where it is not available."""
    motion_at = forces.motion.at_times
    if motion_at is None:
        return None

    def at(t: Real) -> FrictionResult:
        friction = solve_forces(motion_at(t)).friction
        assert friction is not None
        return friction

    return at


def _edge(friction_at: Callable[[Real], FrictionResult], free: float, jammed: float, within: float, near: float) -> float:
    """The time at which a jam begins or ends, to ``near`` [s], between a ``free`` and a ``jammed`` one; ``within``: a time up to
    which the jam lasts at least."""
    parts = EVEN_PARTS
    for _ in range(SEARCH_ROUNDS):
        width = jammed - free
        if abs(width) <= near:
            break
        beyond = min((within - jammed) / width, 1.0)
        rising = np.unique(free + np.concatenate([parts, 1.0 + beyond * BEYOND]) * width)
        friction = friction_at(rising)
        there = slice(None, None, 1 if width > 0.0 else -1)
        t, states, reached = rising[there], friction.jammed[there], friction.movable_share[there]
        k = int(np.argmax(states)) or int(np.argmin(np.abs(t - jammed)))
        if k == 0 or (t[k - 1], t[k]) == (free, jammed):  # no time lies between them
            break
        free, jammed = float(t[k - 1]), float(t[k])
        parts = _parts_about_edge((t[k : k + 3] - free) / (jammed - free), reached[k : k + 3])
    return jammed


def _parts_about_edge(places: Real, reached: Real) -> Real:
    """Next search places between 0, where it moves, and 1, where it jams. They are denser about the place where the proportion
    ``reached``, known at up to three places in the jam, would become one, the more the closer a line and a parabola through it
    agree."""
    short = 1.0 - reached
    if len(short) < 3 or not np.all(np.diff(short, prepend=0.0) > 0.0):
        return EVEN_PARTS
    line = places[0] - short[0] * (places[1] - places[0]) / (short[1] - short[0])
    edge = float(np.polynomial.Polynomial.fit(short, places, 2)(0.0))
    doubt = np.abs(edge - line) * 0.1 ** np.arange(INTERVAL_PARTS // 2)
    about = np.concatenate([edge - doubt, edge + doubt])
    return np.unique([0.0, *about[(about > 0.0) & (about < 1.0)], 1.0])


def _hidden(friction_at: Callable[[Real], FrictionResult], friction: FrictionResult, time: Real, near: float) -> Iterator[Jam]:
    """Jams between frames: where the stability has a low minimum at a frame, the neighbourhood of the frame is searched."""
    s = np.where(friction.jammed, np.nan, friction.stability)
    with np.errstate(invalid="ignore"):
        low = np.flatnonzero((s[1:-1] <= s[:-2]) & (s[1:-1] <= s[2:]) & (s[1:-1] < NEAR_STABILITY)) + 1
    for k in sorted(low[np.argsort(s[low])][:MOST_CANDIDATES]):
        left, right = float(time[k - 1]), float(time[k + 1])
        for _ in range(4):
            t = np.linspace(left, right, 4 * INTERVAL_PARTS + 1)
            if not np.all(np.diff(t) > 0.0):
                break
            fine = friction_at(t)
            if fine.jammed.any():
                first, last = runs(fine.jammed)[0]
                inner = float(t[first]), float(t[last])
                start = _edge(friction_at, float(t[first - 1]), *inner, near) if first else float(t[0])
                end = _edge(friction_at, float(t[last + 1]), *inner[::-1], near) if last + 1 < len(t) else float(t[-1])
                yield Jam(start, end, fine.jammed_by(first), float(fine.movable_share[first : last + 1].min()))
                break
            lowest = int(np.argmin(np.where(np.isfinite(fine.stability), fine.stability, np.inf)))
            left, right = float(t[max(lowest - 1, 0)]), float(t[min(lowest + 1, len(t) - 1)])


def friction_events(forces: Forces) -> list[Event]:
    """Sign changes, jams, self-locking and the efficiency of a run with friction, in order of time."""
    friction = forces.friction
    if friction is None or not forces.motion.frames:
        return []
    motion, time = forces.motion, forces.motion.time
    events = [
        Event(t, "INFO", joint, f"friction changes its sign: the relative motion reverses, {at_drive(motion, t)}")
        for t, joint in sign_changes(forces)
    ]
    for jam in find_jams(forces):
        names = ", ".join(jam.joints)
        until = "to the end of the run" if jam.end >= time[-1] else f"until {jam.end:.6g} s"
        text = (
            f"jams {until}: friction in {names} is too strong for any drive effort, {at_drive(motion, jam.start)} to "
            f"{at_drive(motion, jam.end)}; it could be moved with {100.0 * jam.movable_share:.4g} % of the coefficients"
        )
        events.append(Event(jam.start, "WARN", jam.joints[0] if jam.joints else "mechanism", text))
    friction_at = _friction_at(forces) or (lambda t: friction)

    for start, end in intervals(motion, friction.ambiguous, lambda t: np.where(friction_at(t).ambiguous, 1.0, -1.0)):
        text = (
            f"more than one state of friction is in equilibrium {_span(motion, start, end)}: the results are those of the state "
            "that is reached continuously from the frictionless one"
        )
        events.append(Event(start, "WARN", "mechanism", text))
    drives = ", ".join(d.joint for d in motion.mechanism.drives) or "mechanism"
    locked = friction.self_locking
    for start, end in intervals(motion, locked, lambda t: friction_at(t).back_driving_excess):
        where = "over the whole run" if locked.all() else _span(motion, start, end)
        events.append(Event(start, "INFO", drives, f"self-locking {where}: the loads cannot move the drive"))
    events += _cost(forces, friction)
    return sorted(events, key=lambda e: e.time)


def _span(motion: Motion, start: float, end: float) -> str:
    """An interval of time [s] in words: its times, and where the drives are."""
    if start == end:
        return f"at {start:.6g} s ({at_drive(motion, start)})"
    there, drives = at_drive(motion, end), motion.mechanism.drives
    if len(drives) == 1:  # the only drive need not be named twice
        there = there.removeprefix(f"drive {drives[0].joint} at ")
    return f"from {start:.6g} s to {end:.6g} s ({at_drive(motion, start)} to {there})"


def _cost(forces: Forces, friction: FrictionResult) -> Iterator[Event]:
    if friction.jammed.any() or not np.isfinite(friction.power).all():
        return
    losses = losses_of_run(forces)
    total = sum(losses.mean.values())
    if total > 0.0:
        parts = ", ".join(f"{p} {100.0 * w / total:.3g} %" for p, w in sorted(losses.mean.items(), key=lambda item: -item[1]))
        text = f"efficiency of the run {losses.efficiency:.4g}; friction takes {total:.4g} W on average: {parts}"
        yield Event(float(forces.motion.time[-1]), "INFO", "mechanism", text)


def friction_lanes(forces: Forces) -> dict[str, list[tuple[float, str]]]:
    """States of every joint with friction, as (time [s], state) from each change on, and the "mechanism" as a whole.

    Joints: "slips +", "slips -", "at rest", "jammed". Mechanism: "moves", "self-locking", "jammed".
    """
    friction = forces.friction
    if friction is None or not forces.motion.frames:
        return {}
    time = forces.motion.time
    turns: dict[str, list[float]] = {}
    for t, joint in sign_changes(forces):
        turns.setdefault(joint, []).append(t)
    lanes = {p: _lane(time, friction.state(p), turns.get(p, [])) for p in friction.joints}
    whole = np.where(friction.jammed, "jammed", np.where(friction.self_locking, "self-locking", "moves"))
    return {**lanes, "mechanism": _lane(time, list(whole), [])}


def _lane(time: Real, states: list[str], turns: list[float]) -> list[tuple[float, str]]:
    """Changes of a state: a reversal counts at its time between frames, and a single frame of rest within it does not count."""
    n = len(states)
    calm = [
        states[k + 1] if 0 < k < n - 1 and states[k] == "at rest" and "at rest" not in (states[k - 1], states[k + 1]) else states[k]
        for k in range(n)
    ]
    changes = [(float(time[0]), calm[0])]
    for k in range(1, n):
        if calm[k] != calm[k - 1]:
            between = [t for t in turns if time[k - 1] < t <= time[k]]
            changes.append((between[0] if between else float(time[k]), calm[k]))
    return changes
