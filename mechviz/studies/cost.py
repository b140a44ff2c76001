"""What each stage and effect of a scene costs: measured, with warm-up and repeats, the median counts."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from mechcore.effects.base import sum_up
from mechcore.effects.plan import Plan, make_plan
from mechcore.effects.registry import effects_of, wrenches
from mechcore.forces.friction.solve import solve_friction
from mechcore.forces.kinetostatics import solve_forces
from mechcore.motion.compiled import Compiled
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechviz.runs import run_scene
from mechviz.scene.faults import in_scene_words

if TYPE_CHECKING:
    from mechviz.scene.scene import Scene


HEALTH = ("closure", "velocity_closure", "acceleration_closure", "condition")


@dataclass(frozen=True)
class Cost:
    """A stage or effect of the plan and the median of its wall times [s]."""

    name: str
    seconds: float


@in_scene_words
def measure(scene: Scene, *, repeats: int = 7, outputs: Any = None) -> list[Cost]:
    """Wall times of all that the plan of a scene computes. Each repeat starts from a motion of which nothing is known yet."""
    mechanism = scene.mechanism
    plan: Plan = make_plan(mechanism) if outputs is None else make_plan(mechanism, outputs)
    frames = None if scene.simulation is not None else default_times(mechanism, scene.frames, scene.cycles)
    found: dict[str, list[float]] = {}

    def timed(name: str, work: Callable[[], Any]) -> Any:
        start = time.perf_counter()
        result = work()
        found.setdefault(name, []).append(time.perf_counter() - start)
        return result

    effects = effects_of(mechanism)
    named = len(mechanism.effects)
    for _ in range(repeats + 1):
        if scene.simulation is not None:
            for spent in run_scene(scene).stages:
                found.setdefault(spent.name, []).append(spent.seconds)
            continue
        compiled = timed("compile", partial(compile_mechanism, mechanism))
        motion = timed("positions", partial(_positions, compiled, frames))
        for stage in ("velocities", "accelerations"):
            if plan.has(stage):
                timed(stage, partial(getattr, motion, f"origin_{stage}"))
        if plan.has("reactions and drive efforts"):
            for k, effect in enumerate(effects):
                if "reactions" not in effect.needs:
                    timed(f"{'effect' if k < named else 'load'} {effect.name}", partial(effect.wrenches, motion))
            if plan.has("effect friction"):
                timed("effect friction", partial(_friction, motion))
            forces = timed("reactions and drive efforts", partial(solve_forces, motion))
            if plan.has("energy and power balance"):
                timed("energy and power balance", partial(_read, forces, ("energy", "power_balance")))
        if plan.has("closure and condition"):
            timed("closure and condition", partial(_read, motion, HEALTH))
    return [Cost(name, statistics.median(times[1:])) for name, times in found.items()]  # the first one warms up


def _positions(compiled: Compiled, frames: Any) -> Motion:
    motion = solve_motion(compiled, frames)
    _ = motion.origins
    return motion


def _friction(motion: Motion) -> None:
    """Dry friction and the reactions that it depends on."""
    applied = wrenches(motion)
    solve_friction(motion, applied, *sum_up(applied, len(motion.model.links)))


def _read(result: Any, names: tuple[str, ...]) -> None:
    """Work out what is worked out when first asked for."""
    for name in names:
        getattr(result, name)


def cost_lines(costs: list[Cost], frames: int) -> list[str]:
    """The costs as a table: milliseconds, microseconds a frame, share."""
    total = sum(c.seconds for c in costs if not c.name.startswith(("effect ", "load ")))  # those are part of the reactions
    width = max(len(c.name) for c in costs)
    lines = [f"cost (median, {frames} frames; effects and loads are part of the reactions' time)"]
    lines.append(f"  {'':<{width}}  {'ms':>9}  {'us/frame':>9}  {'share':>6}")
    lines += [
        f"  {c.name:<{width}}  {1e3 * c.seconds:>9.3f}  {1e6 * c.seconds / frames:>9.3f}  {100 * c.seconds / total:>5.1f}%"
        for c in costs
    ]
    return [*lines, f"  {'in all':<{width}}  {1e3 * total:>9.3f}  {1e6 * total / frames:>9.3f}"]
