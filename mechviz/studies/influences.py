"""Influence of each effect and load of a scene on the results, and its cost: each is left out, or added, and the scene is computed
again."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.arrays import Real
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.records import dataclass
from mechcore.spec.mechanism import EFFECTS
from mechviz.quantities.items import joint_unit, joints_of
from mechviz.runs import run_scene
from mechviz.scene.faults import in_scene_words
from mechviz.studies.cost import WallTime, time_alternately

if TYPE_CHECKING:
    from mechviz.scene.annotations import Place
    from mechviz.scene.scene import Scene


@dataclass(frozen=True)
class KeyFigures:
    """Key results of a run: the largest effort of its drives by unit, the largest reaction [N], and of a motion under forces the
    fluctuation of the speed of the first free coordinate (largest minus smallest over the mean) in the second half of the run. NaN
    where there is no value. ``curves`` (F,): efforts by (unit, drive), magnitudes of reactions by ("reaction", joint)."""

    efforts: dict[str, float]
    reaction: float
    fluctuation: float
    curves: dict[tuple[str, str], Real]


@dataclass(frozen=True)
class Influence:
    """An effect or load: whether the scene has it (``named``), how much it changes the results, and how much computing time it
    costs.

    ``effort``, ``reaction``: relative change of the peak; ``fluctuation``: change of the fluctuation; ``curve``: largest change at
    any frame, relative to the peak of all curves of the same unit; ``cost``: relative change of the time; ``spread``: spread of the
    cost. ``problem``: why there are no numbers.
    """

    name: str
    kind: str
    named: bool
    effort: float = float("nan")
    reaction: float = float("nan")
    fluctuation: float = float("nan")
    curve: float = float("nan")
    cost: float = float("nan")
    spread: float = 0.0
    problem: str = ""

    def exceeds(self, accuracy: float) -> bool:
        """Whether the effect changes a curve or the fluctuation by more than the accuracy (relative)."""
        return bool(np.nanmax([self.curve, self.fluctuation, 0.0]) > accuracy)


def key_figures_of(scene: Scene) -> KeyFigures:
    """The key figures of a scene, which is solved for them."""
    motion, forces, simulation = _compute(scene)
    curves: dict[tuple[str, str], Real] = {}
    efforts: dict[str, float] = {}
    reaction, fluctuation = float("nan"), float("nan")
    if forces is not None:
        for joint in joints_of(motion):
            curves["reaction", joint.name] = np.hypot(*forces.reaction(joint.name)[:, :2].T)
        reaction = max((float(np.nanmax(c)) for c in curves.values()), default=float("nan"))
        for drive in motion.mechanism.drives:
            unit = "N" if joint_unit(motion, drive.joint) == "m" else "N m"
            curves[unit, drive.joint] = values = forces.effort(drive.joint)
            efforts[unit] = float(np.fmax(efforts.get(unit, np.nan), np.nanmax(np.abs(values))))
    if simulation is not None:
        t = np.linspace(0.5 * simulation.duration, simulation.duration, 400)
        speed = np.abs(simulation(t)[1][:, 0]) if simulation([0.0])[1].shape[1] else np.zeros(1)
        fluctuation = float(np.ptp(speed) / max(float(speed.mean()), 1e-300))
    return KeyFigures(efforts, reaction, fluctuation, curves)


@in_scene_words
def _compute(scene: Scene) -> tuple[Any, Any, Any]:
    if scene.simulation is not None:
        run = run_scene(scene, outputs=("accelerations", "forces"))
        return run.motion, run.forces, run.simulation
    compiled = compile_mechanism(scene.mechanism)
    motion = solve_motion(compiled, default_times(scene.mechanism, scene.frames, scene.cycles))
    _ = motion.origin_velocities, motion.origin_accelerations
    wanted = bool(scene.mechanism.effects or scene.mechanism.loads)
    return motion, solve_forces(motion) if wanted else None, None


def _variants(scene: Scene) -> Iterator[tuple[str, str, bool, dict[Place, Any]]]:
    """Name and kind of each effect and load, whether the scene has it, and the change of the scene that removes or adds it."""
    named = list(scene.effects)
    for effect in EFFECTS:
        others = [e for e in named if e != effect] if effect in named else [*named, effect]
        yield effect, "effect", effect in named, {("effects",): others}
    for load in scene.document.loads:
        yield load, "load", True, {("loads", load): None}


def influences(
    scene: Scene, advance: Callable[[int, int], None] = lambda *_: None, budget: float = 0.2
) -> tuple[KeyFigures, list[Influence]]:
    """The key figures of a scene, and the influence of each of its effects and loads and of each effect that it could have.

    ``advance`` gets the number of variants that are done and their total; ``budget``: time for repeats of each variant [s].
    """
    base = key_figures_of(scene)
    variants = list(_variants(scene))
    every = []
    for k, (name, kind, named, change) in enumerate(variants):
        advance(k, len(variants))
        try:
            changed = scene.changed(change)
            other = key_figures_of(changed)
        except MechanismError as e:
            every.append(Influence(name, kind, named, problem=e.faults[0].message))
            continue
        works = [partial(_compute, s) for s in ((scene, changed) if named else (changed, scene))]
        times = time_alternately(works[0], works[1], budget, least=1 if scene.simulation is not None else 5)
        every.append(_compared(name, kind, named, (base, other) if named else (other, base), times))
    advance(len(variants), len(variants))
    return base, every


def _compared(
    name: str, kind: str, named: bool, figures: tuple[KeyFigures, KeyFigures], times: tuple[WallTime, WallTime]
) -> Influence:
    """Influence from the key figures and the times (with the effect, without it)."""
    whole, less = figures

    def change(a: float, b: float) -> float:
        b = 0.0 if np.isnan(b) else b
        return float("nan") if np.isnan(a) else abs(a - b) / max(abs(a), 1e-300)

    peak: dict[str, float] = {}
    for (family, _), values in whole.curves.items():
        peak[family] = max(peak.get(family, 0.0), float(np.nanmax(np.abs(values), initial=0.0)))
    curve = 0.0
    for key, values in whole.curves.items():
        before, size = less.curves.get(key, np.zeros_like(values)), peak[key[0]]
        if len(before) == len(values) and size > 0.0:
            curve = max(curve, float(np.nanmax(np.abs(values - before), initial=0.0)) / size)
    fluctuation = abs(whole.fluctuation - less.fluctuation)
    with_it, without = times
    return Influence(
        name,
        kind,
        named,
        float(np.fmax.reduce([change(peak, less.efforts.get(unit, 0.0)) for unit, peak in whole.efforts.items()], initial=np.nan)),
        change(whole.reaction, less.reaction),
        fluctuation,
        curve,
        with_it.seconds / without.seconds - 1.0,
        (with_it.spread + without.spread) / without.seconds,
    )


def influence_lines(base: KeyFigures, every: list[Influence], accuracy: float) -> list[str]:
    """Table of the influences, and which effects are worth having at an accuracy, as lines of text."""
    width = max(len(i.name) for i in every) if every else 6
    head = (
        f"{'':<{width}}  {'kind':<6} {'in the scene':<12} {'peak effort':>11} {'peak reaction':>13} {'any frame':>10} {'time':>16}"
    )
    simulated = not np.isnan(base.fluctuation)
    lines = [head + (f" {'fluctuation':>12}" if simulated else "")]

    def percent(value: float, digits: int = 3) -> str:
        if np.isnan(value):
            return "-"
        return f"{100.0 * value:.0f} %" if abs(value) >= 10.0 ** (digits - 2) else f"{100.0 * value:.{digits}g} %"

    for i in every:
        row = f"{i.name:<{width}}  {i.kind:<6} {'yes' if i.named else 'no':<12} "
        if i.problem:
            lines.append(row + i.problem)
            continue
        time = f"{percent(i.cost, 2)} ± {percent(i.spread, 2).removesuffix(' %')} %" if abs(i.cost) > i.spread else "in the noise"
        row += f"{percent(i.effort):>11} {percent(i.reaction):>13} {percent(i.curve):>10} {time:>16}"
        lines.append(row + (f" {percent(i.fluctuation):>12}" if simulated else ""))
    lines += ["", f"worth having at an accuracy of {accuracy:g} (nothing is changed by itself):"]
    for i in sorted((i for i in every if not i.problem), key=lambda i: -np.nan_to_num(i.curve)):
        verb = "changes" if i.named else "would change"
        what = "the peak effort" if not np.isnan(i.effort) else "the largest reaction"
        value = i.effort if not np.isnan(i.effort) else i.reaction
        words = f"{i.name} {verb} {what} by {percent(value)}, some frame by {percent(i.curve)}, and {_price(i)}"
        if i.exceeds(accuracy):
            lines.append(f"  {'keep' if i.named else 'add'}: {words}")
        else:
            lines.append(f"  {'could be left out' if i.named else 'not needed'}: {words}")
    return lines


def _price(i: Influence) -> str:
    """Cost of an effect, in words; without a number where it is below the spread of the times."""
    if abs(i.cost) <= max(i.spread, 0.01):
        return "its price is lost in the noise of the times"
    share = f"{abs(100.0 * i.cost):.0f}" if abs(i.cost) >= 0.1 else f"{abs(100.0 * i.cost):.2g}"
    return f"costs {share} % more time" if i.cost > 0.0 else f"saves {share} % of the time"
