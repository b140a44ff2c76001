"""Forward dynamics: the motion of a mechanism under its forces, with its events.

A mechanism of one freedom that can make full turns is tabulated on its configuration curve; if all its forces depend on the
position alone, the energy integral gives the motion without time steps. Otherwise collocation in windows integrates the equations
of motion in a coordinate chart.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mechcore.arrays import Real
from mechcore.constants import MOST_TURNS, TURN
from mechcore.dynamics.active_chart import table_tolerance
from mechcore.dynamics.equations.charts import Chart, curve_around
from mechcore.dynamics.equations.contacts import contact_program, has_dry_friction
from mechcore.dynamics.equations.curve import CurveEquations
from mechcore.dynamics.equations.energy import by_energy
from mechcore.dynamics.equations.program import EquationsProgram
from mechcore.dynamics.equations.reduced import coordinate_scales, free_of, integrating, moving, reduce
from mechcore.dynamics.event_integrator import EventIntegrator, Method
from mechcore.dynamics.events import EndStop, EventKind, EventTrigger, SeparableCam, SimulationEvent, with_slot_ends
from mechcore.dynamics.integration.collocation import Window
from mechcore.dynamics.integration.windows import Solution
from mechcore.dynamics.rest.equilibrium import (
    MANY_PERIODS,
    FastestVibration,
    check_periods,
    difference_positions,
    fastest_vibration,
    vibrations,
)
from mechcore.dynamics.segments import MotionSegment
from mechcore.dynamics.simulation import Simulation
from mechcore.effects.registry import effects_of
from mechcore.errors import Fault, MechanismError
from mechcore.laws.course import early_end_faults, velocity_jump_faults
from mechcore.laws.curve import MotionCurve
from mechcore.laws.factors import VELOCITY_JUMP, jumps
from mechcore.laws.signals import Chirp, Sine
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled
from mechcore.motion.solve import compile_mechanism
from mechcore.spec.loads import Servo
from mechcore.spec.mechanism import Drive, Mechanism
from mechcore.texts import as_angle, as_length

FORCE_DISTANCE = 0.1  # displacement from the start, in coordinate scales, at which reference forces are evaluated
LEAST_PUSH = 1e-4  # part of the largest force in a table: a larger force is no table error
BALANCE_ROUNDING = 1e-13  # part of the reference forces: a smaller force in an equilibrium is rounding


TRIAL_WINDOWS = 100  # windows after which the number for the whole motion is predicted
QUIET_SECONDS = 5.0  # [s] of processor time without a warning
MANY_WINDOWS = 2_000  # predicted windows of a motion that call for a warning
MOST_WINDOWS = 1_000_000  # windows of a motion, at most: each takes about a kilobyte


def simulate(
    mechanism: Mechanism | Compiled,
    duration: float,
    *,
    tolerance: float = 1e-9,
    method: Method = "auto",
    stops: Sequence[EndStop] = (),
    triggers: Sequence[EventTrigger] = (),
    separable_cams: Sequence[SeparableCam] = (),
    progress: Callable[[float], None] | None = None,
    observe: Callable[[Simulation], None] | None = None,
    initial_guess: Simulation | None = None,
    warn: Callable[[str], None] | None = None,
) -> Simulation:
    """The motion for ``duration`` [s] from the start of the mechanism's free coordinates (drives with a `Free` law).

    ``tolerance``: local error of positions, relative to one radian or the mechanism's size. ``method`` "energy" needs one freedom
    and forces that depend on its position alone; "radau" is for stiff forces; "auto" chooses. Followers may leave
    ``separable_cams``; with these, all drives may be prescribed. The other settings of the integrator are those of the compiled
    mechanism's `Accuracy`. ``progress`` gets the time reached. ``observe`` gets every segment of the motion in order, as soon as it
    is known, with the events at its beginning; `Simulation.followed_by` joins them. ``initial_guess``: the same motion to another
    tolerance or by its energy, from which collocation starts (see `refine`). ``warn`` gets a message as soon as a long computation
    is predicted; with it, a motion of more windows than memory holds is refused. Raises `MechanismError`.
    """
    original = compiled = mechanism if isinstance(mechanism, Compiled) else compile_mechanism(mechanism)
    stops = with_slot_ends(compiled.mechanism, stops)
    _validate(compiled, duration, tolerance, separable_cams)
    start_pose = compiled.angles.start.with_stops((stop.joint, stop.side, stop.at) for stop in stops)
    compiled = replace(compiled, angles=compiled.angles.fresh(start_pose))
    drives = [d for d in compiled.mechanism.drives if isinstance(d.law, Free)]
    q = np.array([float(d.law(0.0)[0]) for d in drives])
    v = np.array([float(d.law(0.0)[1]) for d in drives])
    _refuse_knocks(compiled, q, v, separable_cams)
    system: Chart | CurveEquations = Chart(compiled)
    valid_range: tuple[float, float] | None = None
    alone = len(q) == len(compiled.mechanism.drives) == 1 and not separable_cams and not integrating(compiled)
    if alone and not has_dry_friction(compiled) and not _by_program(compiled, method, stops):
        system, valid_range = _curve(original, compiled, q[0], table_tolerance(tolerance), keep=not stops)
    around = _around(compiled, q, system)
    if len(q):
        _check_moved_mass(compiled, q, system, around)
    word = None if stops or separable_cams else _rest(compiled, q, v, system, around)
    if word is not None:
        still = Solution([Window(0.0, duration, q, v, np.zeros((2, len(q))))])
        rest = Simulation(compiled, (MotionSegment(0.0, duration, compiled, still, system),), (word,), "gauss", tolerance, 0)
        if observe is not None:
            observe(rest)
        return rest
    if warn is not None:
        progress = _counted(duration, warn, progress)
    if isinstance(system, CurveEquations) and system.conservative and not stops and not triggers and method in ("auto", "energy"):
        fine = min(max(1e-3 * tolerance, 1e-13), 1e-7)
        energy = by_energy(system, q[0], v[0], duration, tolerance=fine, progress=progress)
        if energy is not None:
            if energy.period is not None and duration > MOST_TURNS * energy.period:
                periods = duration / energy.period
                why = f"{duration:.6g} s are {periods:.6g} periods; motions are followed over {MOST_TURNS:,} at most."
                raise MechanismError(Fault("run.duration", why, f"Give at most {MOST_TURNS * energy.period:.3g} s."))
            whole = Simulation(compiled, (MotionSegment(0.0, duration, compiled, energy, system),), (), "energy", tolerance, 0)
            if observe is not None:
                observe(whole)
            return whole
    if method == "energy":
        raise MechanismError(
            Fault(
                "run.method",
                '"energy" cannot find this motion: it needs one freedom that turns fully, no change point close by, forces that '
                "depend on the position alone, no friction, no stops and no event triggers.",
                'Choose "auto", "gauss" or "radau".',
            )
        )
    skipped: FastestVibration | None = None
    fast = None if _calm(compiled, around, duration) else fastest_vibration(compiled, q, v)
    if fast is not None and method != "gauss" and _steps_over(compiled, fast, duration, tolerance, method):
        method, skipped = "radau", fast if fast.amplitude <= tolerance else None
    elif fast is not None:
        words = check_periods(fast, duration, tolerance)
        if words is not None and warn is not None:
            warn(words)
    swings = _check_signals(compiled.mechanism, duration)
    if swings is not None and warn is not None:
        warn(swings)
    integrator = EventIntegrator(
        compiled,
        (system, valid_range),
        duration,
        tolerance,
        method,
        stops,
        triggers,
        separable_cams,
        progress,
        observe,
        initial_guess,
    )
    run = integrator.run(q, v)
    if skipped is None:
        return run
    events = (SimulationEvent(0.0, EventKind.STIFF, skipped.load, skipped.stepped_over), *run.events)
    return replace(run, skipped_vibration=(skipped.amplitude, skipped.frequency), events=events)


def _check_signals(mechanism: Mechanism, duration: float) -> str | None:
    """Warning before a run over very many periods of a load; None where there are fewer. Raises `MechanismError` beyond
    `MOST_TURNS` periods."""
    factors = [(load.name, getattr(load, "factor", None)) for load in mechanism.loads]
    swung = [(name, x.function) for name, x in factors if x is not None and isinstance(x.function, Sine | Chirp)]
    most, name = max(((signal.periods(duration), name) for name, signal in swung), default=(0.0, ""))
    if most < MANY_PERIODS:
        return None
    words = f"load '{name}' swings through {most:,.0f} periods in {duration:.6g} s"
    if most <= MOST_TURNS:
        return f"{words}; following them takes a while."
    remedy = f"Lower its frequency, or run at most {duration * MOST_TURNS / most:.3g} s."
    raise MechanismError(Fault(f"loads.{name}", f"{words}; motions are followed over {MOST_TURNS:,} at most.", remedy))


def _by_program(compiled: Compiled, method: Method, stops: Sequence[EndStop]) -> bool:
    """Whether a C program integrates a mechanism of one freedom on its own, so that no table is needed."""
    contacts = contact_program(compiled, ()) if stops else None
    if contacts is not None and contacts.has_phases and all(stop.joint in contacts.stopped for stop in stops):
        return True
    program = None if method == "energy" else Chart(compiled).program()
    if program is None or not (program.alone and program.everywhere):
        return False
    return method != "auto" or any("velocities" in e.needs or "time" in e.needs for e in effects_of(compiled.mechanism))


def _curve(
    original: Compiled, compiled: Compiled, q: float, tolerance: float, *, keep: bool
) -> tuple[Chart | CurveEquations, tuple[float, float] | None]:
    """The mechanism on its configuration curve around its start, and the valid range of its coordinate. ``keep``: keep the table
    for further motions of the ``original``, which start at the same position."""
    kept = original.cached(_tables)
    if not keep or tolerance not in kept:
        system, valid_range = curve_around(compiled, q, tolerance)
        if not (keep and isinstance(system, CurveEquations)):
            return system, valid_range
        kept[tolerance] = system, valid_range
    curve, valid_range = kept[tolerance]
    return replace(curve, compiled=compiled), valid_range


def _tables(_: Compiled) -> dict[float, tuple[CurveEquations, tuple[float, float] | None]]:
    return {}


def _counted(duration: float, warn: Callable[[str], None], reported: Callable[[float], None] | None) -> Callable[[float], None]:
    """A progress callback that warns once: if the first `TRIAL_WINDOWS` windows predict very many in all, or if the work done and
    the work left are long. It raises `MechanismError` for a motion of more than `MOST_WINDOWS` windows."""
    counts, warned, begun, marked = 0, False, time.process_time(), (0.0, 0.0)

    def progress(until: float) -> None:
        nonlocal counts, warned, marked
        counts += 1
        if counts > MOST_WINDOWS:
            why = f"{MOST_WINDOWS:,} windows of the integration led to {until:.6g} s of {duration:.6g} s; no more are kept."
            raise MechanismError(Fault("run.duration", why, f"Give at most {until:.3g} s, or a larger tolerance."))
        share, spent = until / duration, time.process_time() - begun
        worked, gained = spent - marked[0], share - marked[1]
        if not warned and counts == TRIAL_WINDOWS and share * MANY_WINDOWS < TRIAL_WINDOWS:
            warned = True
            needed = TRIAL_WINDOWS / max(share, 1e-300)
            warn(f"{TRIAL_WINDOWS:,} windows led to {until:.3g} s of {duration:.6g} s: it takes about {needed:.2g} of them in all.")
        elif not warned and worked > QUIET_SECONDS:
            # The pace of the last seconds counts, as windows may have become short; the mean one if a time is run through again
            rate = gained / worked if gained > 0.0 else max(share, 1e-300) / spent
            marked, left = (spent, share), (1.0 - share) / rate
            warned = left > QUIET_SECONDS
            if warned:
                warn(f"{spent:.0f} s of work led to {until:.3g} s of {duration:.6g} s: it goes on for about {left:.3g} s.")
        if reported is not None:
            reported(until)

    return progress


def _steps_over(compiled: Compiled, fast: FastestVibration, duration: float, tolerance: float, method: Method) -> bool:
    """Whether the run steps over its fastest vibration by an L-stable rule: with ``method`` "radau", or if neither prescribed
    drives nor dry friction can excite the vibration."""
    alone = len(free_of(compiled)) == len(compiled.mechanism.drives) and "friction" not in compiled.mechanism.effects
    return (alone or method == "radau") and fast.steps_over(duration, tolerance)


def _validate(compiled: Compiled, duration: float, tolerance: float, separable_cams: Sequence[SeparableCam]) -> None:
    faults = []
    if not (np.isfinite(duration) and duration > 0):
        faults.append(Fault("run.duration", f"{duration!r} s is no duration.", "Give a time above zero."))
    if not 1e-15 <= tolerance <= 0.1:
        faults.append(Fault("run.tolerance", f"{tolerance!r} is out of range.", "Give a number from 1e-15 to 0.1."))
    mechanism = compiled.mechanism
    if compiled.accuracy.differentiation != "exact":
        why = "forces decide the motion: its rates are what is solved for."
        faults.append(Fault("accuracy.differentiation", why, 'Choose "exact", or prescribe a drive.'))
    if "inertia" not in mechanism.effects:
        faults.append(Fault("effects", "motion under forces needs masses, and inertia is not named.", 'Add "inertia" to effects.'))
    free = [d for d in mechanism.drives if isinstance(d.law, Free)]
    _check_turns(compiled, free, duration, faults)
    laws = {f"joints.{d.joint}.drive": d.law for d in mechanism.drives if not isinstance(d.law, Free)}
    targets = {f"loads.{x.name}.target": x.target for x in mechanism.loads if isinstance(x, Servo)}
    faults += [*early_end_faults({**laws, **targets}, duration), *velocity_jump_faults(laws, duration)]
    if not free and not separable_cams:
        faults.append(Fault("joints", "every drive is prescribed: no coordinate is free.", "Give a joint a free start."))
    if faults:
        raise MechanismError(faults)


def _check_turns(compiled: Compiled, free: Sequence[Drive], duration: float, faults: list[Fault]) -> None:
    """Add ``faults`` for starts so fast that the motion would make more than `MOST_TURNS` turns."""
    model = compiled.model
    for d in free:
        rotary = model.rotary(d.joint)
        speed = abs(float(d.law(0.0)[1])) / (TURN if rotary else TURN * model.length_scale)
        if speed * duration > MOST_TURNS:
            far = f"{speed * duration:.6g} " + ("turns" if rotary else "circumferences of a circle of the size of the mechanism")
            why = f"at this speed it would go {far} in {duration:.6g} s; motions are followed over {MOST_TURNS:,} at most."
            faults.append(Fault(f"joints.{d.joint}.free.speed", why, "Start slower, or run a shorter time."))


def _refuse_knocks(compiled: Compiled, q: Real, v: Real, separable_cams: Sequence[SeparableCam]) -> None:
    """Refuse cams whose law's velocity jumps, if free coordinates (f,) move them or followers may leave them: the impact is not
    computed."""
    laws = [(r, r.geometry.cam.law) for r in compiled.model.relations if r.kind == "cam"]
    abrupt = [(r, steps[0].angle) for r, law in laws if isinstance(law, MotionCurve) and (steps := jumps(law, (1,), VELOCITY_JUMP))]
    units = moving(compiled, q[None], v[None], np.zeros(1))[1] if abrupt and len(q) else []
    names = {each.joint for each in separable_cams}
    faults = []
    for r, angle in abrupt:
        turned = any(float(np.abs(unit.velocity(link)).max()) > 0.0 for unit in units for link in r.links)
        if turned or r.name in names:
            at = as_length(angle) if getattr(r.geometry, "bed", None) is not None else as_angle(angle)
            why = f"the velocity of its law jumps at {at}: the impact of its follower there is not computed."
            remedy = "Choose a law of continuous velocity, or prescribe a drive, without liftoff."
            faults.append(Fault(f"joints.{r.name}", why, remedy))
    if faults:
        raise MechanismError(faults)


def _around(compiled: Compiled, q: Real, system: Chart | CurveEquations) -> tuple[Real, Real] | None:
    """M (n, f, f) and Q - h (n, f) at rest, by a C program: at the start (f,), at its other `difference_positions`, then at
    `FORCE_DISTANCE` to either side. None where there is no program that covers all positions, or a table has all forces."""
    if not len(q) or (isinstance(system, CurveEquations) and not system.untabulated_effects):
        return None
    contacts = contact_program(compiled, ()) if has_dry_friction(compiled) else None
    program: EquationsProgram | None = system.program() if contacts is None else contacts if contacts.has_phases else None
    if program is None or not (program.everywhere or (program.followed and not program.partial)):
        return None
    away = FORCE_DISTANCE * compiled.cached(coordinate_scales)
    places = np.vstack([difference_positions(compiled, q), q - away, q + away])
    return program.reduced(places, np.zeros_like(places), np.zeros(len(places)))


def _check_moved_mass(compiled: Compiled, q: Real, system: Chart | CurveEquations, around: tuple[Real, Real] | None) -> None:
    """Refuse a start (f,) at which a free coordinate moves no mass."""
    if isinstance(system, CurveEquations):
        inertia = system.table(q)[:1, :1]
    elif around is not None:
        inertia = around[0][0]
    else:
        inertia = reduce(compiled, q[None], np.zeros_like(q)[None], np.zeros(1)).inertia[0]
    if not np.isfinite(inertia).all():
        values = np.array([-1.0])
    else:
        values = inertia[0] if len(inertia) == 1 else np.linalg.eigvalsh(inertia)
    if values[0] <= 1e-14 * values[-1]:
        raise MechanismError(
            Fault(
                "links",
                "a free coordinate moves no mass: its acceleration has no bound.",
                "Give a mass or a moment of inertia to the links that it moves.",
            )
        )


def _calm(compiled: Compiled, around: tuple[Real, Real] | None, duration: float) -> bool:
    """Whether values of a C program at the start already show that no vibration has enough periods for a warning."""
    if around is None:
        return False
    inertia, force = around
    squares = vibrations(compiled, force[None, :-2], inertia[0])
    return squares is None or not max(squares[0][-1], 0.0) * duration**2 >= (TURN * MANY_PERIODS) ** 2


def _rest(
    compiled: Compiled, q: Real, v: Real, system: Chart | CurveEquations, around: tuple[Real, Real] | None
) -> SimulationEvent | None:
    """The event of a start (f,) at rest in an equilibrium; None elsewhere, with dry friction, and with forces that depend on time.

    The mechanism stays there even if the equilibrium is unstable, as on a dead point: otherwise rounding would decide when, and in
    which direction, it leaves.
    """
    drives = compiled.mechanism.drives
    if v.any() or len(q) < len(drives) or "friction" in compiled.mechanism.effects:
        return None
    if any("time" in e.needs for e in effects_of(compiled.mechanism)):
        return None
    if isinstance(system, CurveEquations) and not system.untabulated_effects:
        largest = np.abs(system.table.coefficients[:, :, 1]).max()
        if abs(system.table(q)[0, 1]) > LEAST_PUSH * largest:
            return None
    scale = compiled.cached(coordinate_scales)
    if around is None:
        near = np.array([q, q - FORCE_DISTANCE * scale, q + FORCE_DISTANCE * scale])
        force = reduce(compiled, near, np.zeros_like(near), np.zeros(3)).force
    else:
        force = around[1][[0, -2, -1]]
    force = np.abs(force) * scale
    size = float(np.nanmax(force[1:], initial=0.0))
    if not float(force[0].max()) <= BALANCE_ROUNDING * size:
        return None
    names = ", ".join(d.joint for d in drives)
    why = "the forces have no arm or balance here, start a little beside it to see it move" if size else "no force acts on it"
    return SimulationEvent(0.0, EventKind.EQUILIBRIUM, drives[0].joint, f"{names}: at rest in an equilibrium, it stays: {why}")
