"""Supplied and absorbed power: forces classed as in lectures on the theory of machines, and their powers over a run.

By place (external, internal), by the sign of the power over the run (driving, resisting, alternating), by use (useful, harmful)
and by cause (gravity, elastic, viscous, medium, dry friction, inertia, process, drive). The powers of all forces, those of inertia
included, sum to zero at every instant (d'Alembert), and so do their works over a run.

The flywheel that evens out a machine's speed: a motor of constant torque drives a machine whose constant speed would need the
torque T(phi); the flywheel takes up the difference. J = (greatest - least excess work) / (delta omega^2), delta = (omega_max -
omega_min) / omega_mean, as in any text on the theory of machines (Wittenbauer's problem in its usual approximation, good for
small delta).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Literal

import numpy as np

from mechcore.arrays import Index, Real
from mechcore.effects.base import LOSSES, Wrench
from mechcore.effects.masses import link_energies
from mechcore.effects.prescribed import breaks_of
from mechcore.errors import Fault, MechanismError
from mechcore.forces.instants import Instants, instants
from mechcore.forces.kinetostatics import Forces
from mechcore.forces.recurrence import check_run_back
from mechcore.records import dataclass
from mechcore.spec.loads import GasPressure, Load, Prescribed

Role = Literal["driving", "resisting", "alternating", "idle", "unknown"]  # unknown: in a run that jams throughout
SMALL_POWER = 1e-9  # part of the largest power of a run, or of the largest work in an impact, that counts as zero
NO_IMPULSES = np.zeros(0)


@dataclass(frozen=True, eq=False)
class PowerItem:
    """A force, its classes, and its power (n,) [W] over the run; ``supplied`` and ``absorbed`` are works [J], both positive."""

    name: str
    kind: str
    cause: str
    place: Literal["external", "internal"]
    role: Role
    use: Literal["useful", "harmful", ""]
    power: Real
    impulses: Real  # works in impacts (k,) [J]
    mean: float  # [W]
    peak: float  # power of the largest magnitude, with its sign [W]; NaN, like the mean, where no power is known
    supplied: float  # where the power is known, and in impacts
    absorbed: float

    @property
    def label(self) -> str:
        return force_label(self.kind, self.name)


@dataclass(frozen=True, eq=False)
class PowerTable:
    """All forces of a run; ``time`` (n,) [s] of its frames and of both sides of jumps of the powers, ``frames``: which of them are
    frames. ``closure``: absolute sum of all works over the larger of the works supplied and absorbed."""

    items: tuple[PowerItem, ...]
    time: Real
    frames: Index

    @property
    def supplied(self) -> float:
        """Total work supplied [J]."""
        return sum(i.supplied for i in self.items)

    @property
    def absorbed(self) -> float:
        """Total work absorbed [J]."""
        return sum(i.absorbed for i in self.items)

    @property
    def closure(self) -> float:
        largest = max(self.supplied, self.absorbed)
        return abs(self.supplied - self.absorbed) / largest if largest > 0.0 else 0.0


def works(power: Real, time: Real) -> tuple[float, float]:
    """Work supplied and absorbed [J] by a power (n,) [W] that is linear between the times; exact, sign changes included."""
    a, b, dt = power[:-1], power[1:], np.diff(time)
    high, low = np.maximum(a, b), np.minimum(a, b)
    mixed = (high > 0.0) & (low < 0.0)
    span = np.where(mixed, high - low, 1.0)
    up = np.where(mixed, 0.5 * high**2 / span, np.where(low >= 0.0, 0.5 * (a + b), 0.0))
    down = np.where(mixed, 0.5 * low**2 / span, np.where(high <= 0.0, -0.5 * (a + b), 0.0))
    return float(np.nansum(up * dt)), float(np.nansum(down * dt))


def thinning_change(table: PowerTable) -> float:
    """Largest change of the works of an item if every second frame is left out, relative to all work supplied: about three times
    the error of the works, as that of linear interpolation falls with the square of the steps. Infinite for five frames or fewer,
    of which too few would be left."""
    if len(table.frames) <= 5:
        return np.inf
    kept = np.delete(np.arange(len(table.time)), table.frames[1:-1:2])
    changes = [np.subtract(works(i.power[kept], table.time[kept]), works(i.power, table.time)) for i in table.items]
    return float(np.max(np.abs(changes), initial=0.0)) / max(table.supplied, table.absorbed, 1e-300)


def force_label(kind: str, name: str) -> str:
    """The name of a force, preceded by its kind where the name is that of a joint."""
    return f"{kind} {name}" if kind in ("drive", "friction") else name


def power_labels(forces: Forces) -> tuple[str, ...]:
    """Labels of all items of the table of powers, without the table."""
    drives = [force_label("drive", d.joint) for d in forces.motion.mechanism.drives]
    rubbing = [] if forces.friction is None else [force_label("friction", joint) for joint in forces.friction.joints]
    return (*drives, *(force_label(w.kind, w.name) for w in forces.applied), *rubbing)


def power_table(forces: Forces) -> PowerTable:
    """Every force of a run with its classes, its mean and peak power, and the work that it supplies and absorbs.

    The energy lost in impacts is an item of its own. The work of prescribed drives in impacts belongs to the drive if there is only
    one, otherwise to an item of all drives together."""
    at = instants(forces)
    beside = [_power_rows(part) for part in at.parts[1:]]
    rows = [
        (name, kind, cause, place, at.together(power, *(own[k][-1] for own in beside)))
        for k, (name, kind, cause, place, power) in enumerate(_power_rows(forces))
    ]
    impulses = _impulses(forces, at)
    rows += [(*key, _PLACES[key[1]], np.zeros(len(at.time))) for key in impulses if key[1] in _PLACES]
    uses = {load.name: load.use for load in forces.motion.mechanism.loads}
    largest = max((float(np.nanmax(np.abs(row[-1]), initial=0.0)) for row in rows), default=0.0)
    return PowerTable(
        items=tuple(_power_item(row, impulses.get(row[:3], NO_IMPULSES), at.time, uses.get(row[0]) or "", largest) for row in rows),
        time=at.time,
        frames=at.frames,
    )


_PLACES: dict[str, Literal["external", "internal"]] = {"impulse": "external", "impact": "internal"}  # of rows of impacts alone


def _impulses(forces: Forces, at: Instants) -> dict[tuple[str, str, str], Real]:
    """Works (k,) [J] in the impacts of a run, by name, kind and cause: of inertia, of prescribed drives, and the energy lost."""
    impacts = np.array([row for row in forces.impacts if at.time[0] < row[0] < at.time[-1]])
    if not len(impacts) or len(at.parts) == 1:
        return {}
    struck = np.flatnonzero(np.isin(at.time[at.before], impacts[:, 0]))
    energies = at.parts[1].motion.over_parts(lambda m: np.stack([np.broadcast_to(e, m.shape) for e in link_energies(m)], axis=-1))
    gained = energies[2 * struck + 1] - energies[2 * struck]
    works = {(w.name, w.kind, w.cause): -gained[:, w.link] for w in forces.applied if w.kind == "inertia"}
    drives = [d.joint for d in forces.motion.mechanism.drives]
    if drives:
        works[(drives[0], "drive", "drive") if len(drives) == 1 else ("drives in impacts", "impulse", "drive")] = impacts[:, 2]
    works["impacts", "impact", "impact"] = -impacts[:, 1]
    least = SMALL_POWER * max(float(np.abs(w).max(initial=0.0)) for w in works.values())
    return {key: np.where(np.abs(w) > least, w, 0.0) for key, w in works.items()}


PowerRow = tuple[str, str, str, Literal["external", "internal"], Real]  # name, kind, cause, place, power (F,) [W]


def _power_rows(forces: Forces) -> list[PowerRow]:
    drives = forces.motion.mechanism.drives
    rows: list[PowerRow] = [(d.joint, "drive", "drive", "external", forces.power(d.joint)) for d in drives]
    rows += [(w.name, w.kind, w.cause, _place(w), power) for w, power in forces.powers()]
    if forces.friction is not None:
        rows += [
            (joint, "friction", "dry friction", "internal", -forces.friction.losses(joint)) for joint in forces.friction.joints
        ]
    return rows


def powers_by_label(forces: Forces) -> dict[str, Real]:
    """Power (F,) [W] of every force by its label, see `power_labels`."""
    return {force_label(kind, name): power for name, kind, _, _, power in _power_rows(forces)}


def _place(w: Wrench) -> Literal["external", "internal"]:
    """A force between two links of the mechanism, including the frame, is internal, as reactions are."""
    return "external" if w.other is None else "internal"


def _power_item(row: PowerRow, impulses: Real, time: Real, use: str, largest: float) -> PowerItem:
    name, kind, cause, place, power = row
    supplied, absorbed = np.add(works(power, time), (impulses[impulses > 0.0].sum(), -impulses[impulses < 0.0].sum()))
    known = power[np.isfinite(power)]
    low, high = (float(known.min()), float(known.max())) if known.size else (np.nan, np.nan)
    small = SMALL_POWER * largest
    drives, resists = high > small or bool((impulses > 0.0).any()), low < -small or bool((impulses < 0.0).any())
    role: Role = "unknown" if not known.size else "idle"
    if drives or resists:
        role = "alternating" if drives and resists else "driving" if drives else "resisting"
    span = float(time[-1] - time[0])
    if not use and cause in (*LOSSES, "impact"):
        use = "harmful"
    elif not use and cause == "process" and absorbed > supplied:
        use = "useful"  # on the whole it resists: the purpose of the machine
    return PowerItem(
        name=name,
        kind=kind,
        cause=cause,
        place=place,
        role=role,
        use=use,  # type: ignore[arg-type] # one of the three words
        power=power,
        impulses=impulses,
        mean=np.nan if not known.size else (supplied - absorbed) / span if len(time) > 1 else float(power[0]),
        peak=np.nan if kind in _PLACES else high if high >= -low else low,
        supplied=float(supplied),
        absorbed=float(absorbed),
    )


@dataclass(frozen=True, eq=False)
class DriveShare:
    """Work of a drive over a run: its power (n,) [W] at the times of the table, works [J], and the times [s] between which it
    delivers power."""

    joint: str
    power: Real
    supplied: float
    absorbed: float
    delivers: tuple[tuple[float, float], ...]


def drive_shares(table: PowerTable) -> tuple[DriveShare, ...]:
    """Shares of the drives: the power of each, and when it delivers power."""
    drives = [i for i in table.items if i.kind == "drive"]
    small = SMALL_POWER * max((float(np.nanmax(np.abs(i.power), initial=0.0)) for i in drives), default=0.0)
    return tuple(DriveShare(i.name, i.power, i.supplied, i.absorbed, _positive(i.power - small, table.time)) for i in drives)


def _positive(values: Real, time: Real) -> tuple[tuple[float, float], ...]:
    """Intervals where a function that is linear from frame to frame is positive, as far as it is known."""
    above = values > 0.0
    change = np.flatnonzero(above[1:] != above[:-1])
    with np.errstate(invalid="ignore"):
        cross = time[change] - values[change] * (time[change + 1] - time[change]) / (values[change + 1] - values[change])
    last, first = time[change], time[change + 1]
    cross = np.where(np.isnan(cross), np.where(np.isnan(values[change]), first, last), cross)
    edges = [float(time[0])] if above[0] else []
    edges += [float(c) for c in cross]
    edges += [float(time[-1])] if len(edges) % 2 else []
    return tuple(zip(edges[::2], edges[1::2], strict=True))


@dataclass(frozen=True)
class Flywheel:
    """``inertia`` [kg m^2] for the stated ``fluctuation``; ``mean`` torque [N m], ``excess`` work [J], and the drive's positions
    [rad] at which the machine then runs fastest and slowest."""

    inertia: float
    fluctuation: float
    mean: float
    excess: float
    fastest: float
    slowest: float


def flywheel(forces: Forces, fluctuation: float, drive: str | None = None, *, smooth: bool | None = None) -> Flywheel:
    """The flywheel on a drive (the first, if not named) that turns at constant speed over one or more whole cycles.

    ``smooth``: the torque is a cubic spline through the frames from jump to jump, else straight lines; None: straight lines where
    gas presses on a piston or a table is not smooth. Raises `MechanismError` where there is no drive, where it does not turn a
    shaft in the frame at constant speed, where the machine has not returned after the run, or where the fluctuation is not in (0,
    1].
    """
    motion = forces.motion
    joints = [d.joint for d in motion.mechanism.drives]
    if not joints:
        remedy = "Give its shaft a constant speed, or size the flywheel of its steady run: mechviz forces --steady TURNS."
        raise MechanismError(Fault("flywheel", "no drive turns the machine.", remedy))
    joint = joints[0] if drive is None else drive
    if joint not in joints:
        raise MechanismError(Fault("flywheel", f"joint '{joint}' has no drive.", f"Driven joints: {', '.join(joints)}."))
    driven = motion.model.joints[motion.model.joint_index[joint]]
    if motion.mechanism.frame not in driven.links:
        why = f"the drive of '{joint}' turns two moving links against each other."
        raise MechanismError(Fault("flywheel", why, "A flywheel sits on a shaft in the frame."))
    if driven.coordinate != "angle":
        raise MechanismError(Fault("flywheel", f"the drive of '{joint}' does not turn.", "A flywheel needs a shaft that turns."))
    speed = motion.drives[joints.index(joint)][1]
    omega = float(speed[0])
    if omega == 0.0 or np.ptp(speed) > 1e-9 * abs(omega):
        raise MechanismError(
            Fault("flywheel", f"the drive of '{joint}' does not run at constant speed.", "Give it a constant speed.")
        )
    check_run_back(forces)
    if smooth is None:
        smooth = not any(_jumps(load) for load in motion.mechanism.loads)
    at = instants(forces)
    position = at.together(*(part.motion.drives[joints.index(joint)][0] for part in at.parts))
    torque = at.together(*(part.effort(joint) for part in at.parts))
    if forces.impacts and len(joints) > 1:
        why = "the share of every drive in the work of impacts is not known."
        raise MechanismError(Fault("flywheel", why, "Let one drive turn the machine."))
    sudden = [sum(work for when, _, work in forces.impacts if when == t) for t in at.time[at.before]]
    return flywheel_of_torque(position, torque, omega, fluctuation, smooth=smooth, before=at.before, sudden=sudden)


def _jumps(load: Load) -> bool:
    """Whether a load may jump or have a kink."""
    factor = load.factor if isinstance(load, Prescribed) else None
    bent = factor is not None and not getattr(factor.function, "smooth", True)
    return isinstance(load, GasPressure) or bent or bool(breaks_of(factor))


def flywheel_of_torque(
    position: Real,
    torque: Real,
    omega: float,
    fluctuation: float,
    *,
    smooth: bool = True,
    before: Sequence[int] | Index = (),
    sudden: Sequence[float] = (),
) -> Flywheel:
    """The flywheel from positions (n,) [rad] over whole cycles and the torque (n,) [N m] that the machine needs there; ``before``:
    positions just before a jump, the next ones being just after it, between which a torque is smooth; ``sudden``: works [J] that
    the machine needs at these jumps, of impacts."""
    from scipy.interpolate import CubicSpline, PPoly

    if not 0.0 < fluctuation <= 1.0:  # beyond, the formula for small ones does not hold
        remedy = "Give one between 0 and 1, such as 0.02 for 2 %."
        raise MechanismError(Fault("flywheel", f"a coefficient of fluctuation of {fluctuation:g}.", remedy))
    curve: PPoly
    sense = 1.0 if omega > 0.0 else -1.0
    x, y = sense * np.asarray(position, float), sense * np.asarray(torque, float)
    if len(x) < 3:
        raise MechanismError(Fault("flywheel", f"a torque at {len(x)} positions.", "Compute more frames."))
    if smooth and len(before):
        ends = np.unique([0, *before, *np.add(before, 1), len(x) - 1])
        pieces = [CubicSpline(x[a : b + 1], y[a : b + 1]).c for a, b in pairwise(ends)]
        curve = PPoly(np.concatenate(pieces, axis=1), x)
    elif smooth:
        closed = abs(y[-1] - y[0]) <= 1e-6 * np.abs(y).max(initial=1e-300)
        if closed:
            y = np.append(y[:-1], y[0])
        curve = CubicSpline(x, y, bc_type="periodic" if closed else "not-a-knot")
    else:
        curve = PPoly(np.stack([np.diff(y) / np.diff(x), y[:-1]]), x)
    for k, step in zip(before, sudden, strict=False):
        curve.c[-1, k] += step / (x[k + 1] - x[k])
    work = curve.antiderivative()
    total = float(work(x[-1]) - work(x[0]))
    mean = total / (x[-1] - x[0])
    turning = curve.solve(mean, extrapolate=False)  # the excess is extreme where the torque is its mean
    places = np.concatenate([x, turning[np.isfinite(turning)]])  # the frames too: there the torque may jump past its mean
    excess = mean * (places - x[0]) - (work(places) - work(x[0]))  # energy supplied by the motor less energy taken
    span = float(np.ptp(excess))
    top, bottom = (int(np.argmax(sign * excess >= (sign * excess).max() - SMALL_POWER * span)) for sign in (1.0, -1.0))  # the first
    return Flywheel(
        inertia=span / (fluctuation * omega**2),
        fluctuation=fluctuation,
        mean=sense * mean if abs(mean) > SMALL_POWER * np.abs(y).max() else 0.0,
        excess=span,
        fastest=sense * float(places[top]),
        slowest=sense * float(places[bottom]),
    )
