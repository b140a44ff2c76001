"""True errors: results against references that are good to more digits, by other methods; for tests and benchmarks.

- Positions: the loops closed in extended precision (64-bit mantissa), by Newton's method with residuals in that precision.
- Velocities and accelerations: the rates' equations solved on those positions, in the same precision where all groups are dyads.
- Reactions: all joints of the mechanism in one system of equations, instead of group by group.
- Motion under forces: scipy's DOP853 on the equations of motion, or collocation at its tightest where events end the pieces.
- Between frames: the motion itself, at random times.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.arrays import Real
from mechcore.dynamics.equations.charts import Chart
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.kinematics.columns import rates
from mechcore.kinematics.state import value
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechviz.accuracy.estimate import pose_difference
from mechviz.accuracy.fit import quantity_function
from mechviz.accuracy.quantities import measured_interpolation_errors, quantities

if TYPE_CHECKING:
    from mechcore.dynamics.simulation import Simulation
    from mechviz.runs import Run
    from mechviz.scene.scene import Scene


LONG = np.longdouble


def extended(motion: Motion) -> Motion | None:
    """The motion with positions in extended precision; None where relations (gears, cams) or singular frames are in it."""
    model = motion.model
    if model.relations or motion.interpolants or any(b.redundant for b in model.blocks):
        return None
    drives = [np.asarray(d[0], LONG) for d in motion.drives]
    deltas: list[Any] = [np.ones((), np.clongdouble)] * len(model.angles.class_group)
    for rotation_class, terms in model.program.driven_rotations:
        total: Any = np.ones((), np.clongdouble)
        for d, sign in terms:
            total = total * (np.cos(drives[d]) + 1j * sign * np.sin(drives[d]))
        deltas[rotation_class] = total
    groups: dict[int, Any] = {}
    state = motion.state.copy()
    for g, classes in enumerate(model.angles.classes_of):
        if g and classes:
            e = np.asarray(motion.state.rot[classes[0]], np.clongdouble) * np.conj(deltas[classes[0]])
            groups[g] = e / np.abs(e)
    state.slide = {j: np.asarray(s, LONG) for j, s in state.slide.items()}
    for j, d in model.program.driven_slides:
        state.slide[j] = drives[d]

    def turn() -> None:
        state.rot = [
            deltas[s] if g == 0 else groups[g] * deltas[s] if g in groups else motion.state.rot[s]
            for s, g in enumerate(model.angles.class_group)
        ]

    turn()
    columns = motion.columns
    for _ in range(3):
        for block, cols in zip(model.blocks, columns, strict=True):
            if block.kind == "check":
                continue
            drift = [np.asarray(value(model.loop_sums[c], state.rot, state.slide), complex) for c in block.loops]
            steps = rates(block, cols, drift)
            for i, g in enumerate(block.angles):
                step = np.asarray(steps[i], LONG)
                groups[g] = groups[g] * (np.cos(step) + 1j * np.sin(step))
            for i, j in enumerate(block.slides, len(block.angles)):
                state.slide[j] = state.slide[j] + np.asarray(steps[i], LONG)
            turn()
    return Motion(model, motion.time, motion.drives, state, motion.angles)


def position_errors(motion: Motion) -> dict[str, Real]:
    """True relative errors (F,) of positions, and of velocities and accelerations where the extended motion has them."""
    exact = extended(motion)
    if exact is None:
        return {}
    size, moving = motion.model.length_scale, range(1, len(motion.model.links))
    worst = np.zeros(motion.frames)
    for k in moving:
        place = np.abs(np.asarray(exact.origin(k) - np.asarray(motion.origin(k), np.clongdouble))) / size
        angle = np.abs(exact.rotation(k) - np.asarray(motion.rotation(k), np.clongdouble))
        worst = np.maximum(worst, np.maximum(place, angle).astype(float))
    errors = {"position": worst}
    if all(b.dyad for b in motion.model.blocks):
        for name, derivative in (("velocity", 1), ("acceleration", 2)):
            places = [(exact.origin(k, derivative), motion.origin(k, derivative)) for k in moving]
            own, other = ((m.speeds if derivative == 1 else m.accelerations).angular for m in (exact, motion))
            errors[name] = np.maximum(_apart(places, motion.frames), _apart(list(zip(own, other, strict=True)), motion.frames))
    return errors


def _apart(pairs: list[tuple[Any, Any]], frames: int) -> Real:
    """Largest distance (F,) of two results, relative to the peak of all of them."""
    peak = max((float(np.max(np.abs(b))) for _, b in pairs), default=0.0)
    each = [np.broadcast_to(np.abs(np.asarray(a) - np.asarray(b)), (frames,)).astype(float) for a, b in pairs]
    return np.asarray(np.max(each, axis=0)) / peak if peak else np.zeros(frames)


def reaction_error(scene: Scene, frames: int) -> Real | None:
    """Relative difference (F,) of the reactions between the block-wise solution and all joints in one system; None without forces,
    with friction, or where they are one system anyway."""
    mechanism = scene.mechanism
    if not (mechanism.effects or mechanism.loads) or "friction" in mechanism.effects:
        return None
    compiled = compile_mechanism(mechanism)
    if compiled.model.needs_global_solve:
        return None
    whole = replace(compiled, model=replace(compiled.model, solves_globally=True))
    t = default_times(mechanism, frames, scene.cycles)
    one, other = (quantities(m, solve_forces(m)) for m in (solve_motion(c, t) for c in (compiled, whole)))
    named = {q.name: q for q in other}
    pairs = [(a, named[a.name]) for a in one if a.kind == "reaction" and a.name in named]
    return np.asarray(np.max([np.max(np.abs(a.values - b.values), axis=1) / a.scale for a, b in pairs], axis=0)) if pairs else None


def between_error(run: Run, each: int = 4, seed: int = 1) -> float:
    """The largest true error between the frames of a run, at random times in every interval, jumps included."""
    time = run.motion.time
    at = quantity_function(run.scene, run.accuracy, run.simulation)
    rng = np.random.default_rng(seed)
    share = np.concatenate([rng.uniform(0.02, 0.98, (each - 1, len(time) - 1)), np.full((1, len(time) - 1), 0.5)])
    t = np.sort((time[:-1] + share * np.diff(time)).ravel())
    errors = measured_interpolation_errors(quantities(run.motion, run.forces), time, at(t), t, run.accuracy.interpolation)
    return float(np.nanmax([np.nanmax(e) for e in errors.values() if np.isfinite(e).any()]))


def integration_truth(simulation: Simulation, simulate: Callable[..., Simulation], t: Real) -> tuple[Real, float] | None:
    """True errors (n,) of a motion under forces at times: of one free coordinate found by its energy against DOP853, else of all
    links against collocation with the least tolerance; None where that does not come through.

    With them the error of the reference: how far apart DOP853 is with a tolerance ten times as large, at singular positions and
    where neighbours part. What is below that nobody can tell.
    """
    from scipy.integrate import solve_ivp

    q = simulation(t)[0]
    if len(simulation.segments) == 1 and not simulation.joints_with_friction and q.shape[1] == 1 and simulation.method == "energy":
        chart = Chart(simulation.compiled)
        first, speed, _ = simulation([0.0])

        def rhs(time: float, y: Real) -> Real:
            return np.concatenate([y[1:], chart(y[None, :1], y[None, 1:], np.array([time]))[0]])

        start = np.concatenate([first[0], speed[0]])
        small = 1e-14 * np.abs(start).max() + 1e-16
        solutions = [
            solve_ivp(rhs, (0.0, float(t[-1])), start, "DOP853", t_eval=t, rtol=part * 1e-13, atol=part * small)
            for part in (1.0, 10.0)
        ]
        if all(other.success for other in solutions):
            best, next_to_it = (other.y[0] for other in solutions)
            return np.abs(q[:, 0] - best), float(np.abs(best - next_to_it).max())
    try:
        return pose_difference(simulation.view(t), simulate(1e-14, None if simulation.method == "radau" else "gauss").view(t)), 0.0
    except MechanismError:
        return None
