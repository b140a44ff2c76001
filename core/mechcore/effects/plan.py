"""The analysis plan: which stages a mechanism's effects and loads require, which are left out, and why.

It follows from the declared needs of the effects (`mechcore.effects.registry`) and from the requested outputs.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum

from mechcore.effects.registry import effects_of
from mechcore.laws.timed import Free
from mechcore.records import dataclass
from mechcore.spec.mechanism import EFFECTS, METRICS, Mechanism, joints_with_friction

OUTPUTS = ("positions", "velocities", "accelerations", "forces", "energy", "health")
"""Outputs that can be requested; a recording requests all that the scene requires."""


class StageKind(Enum):
    """Kinds of stages; the value is the displayed name."""

    SIMULATION = "motion under forces"
    POSITIONS = "positions"
    VELOCITIES = "velocities"
    ACCELERATIONS = "accelerations"
    EFFECT = "effect"
    LOAD = "load"
    FORCES = "reactions and drive efforts"
    ENERGY = "energy and power balance"
    HEALTH = "closure and condition"
    METRIC = "metric"
    STUDY = "study"


@dataclass(frozen=True)
class PlannedStage:
    """One stage and the reason ``why`` it is computed or left out. ``item``: the effect, load, metric or study, else ""."""

    kind: StageKind
    item: str
    why: str

    @property
    def name(self) -> str:
        """The displayed name, unique in a plan."""
        if self.kind in (StageKind.METRIC, StageKind.STUDY):
            return self.item.replace("_", " ")
        return f"{self.kind.value} {self.item}".rstrip()


@dataclass(frozen=True)
class Plan:
    """``computed`` and ``skipped`` stages, in working order. ``effects``: those computed, by name."""

    computed: tuple[PlannedStage, ...]
    skipped: tuple[PlannedStage, ...]
    effects: tuple[str, ...]

    def has(self, kind: StageKind, item: str = "") -> bool:
        """Whether a stage is computed."""
        return any(s.kind is kind and s.item == item for s in self.computed)


def make_plan(mechanism: Mechanism, outputs: Iterable[str] = OUTPUTS) -> Plan:
    """The stages that the requested outputs need."""
    wanted = set(outputs)
    effects = effects_of(mechanism)
    loads = effects[len(mechanism.effects) :]
    free = [d.joint for d in mechanism.drives if isinstance(d.law, Free)]
    do_forces = bool(effects) and bool(wanted & {"forces", "energy"})
    computed: list[PlannedStage] = [PlannedStage(StageKind.POSITIONS, "", "always")]
    if free:
        why = f"forces decide the motion of {_listed(free)}: it is found before all else"
        computed.insert(0, PlannedStage(StageKind.SIMULATION, "", why))
    skipped: list[PlannedStage] = []

    def step(kind: StageKind, needed: bool, why: str, why_not: str, item: str = "") -> None:
        (computed if needed else skipped).append(PlannedStage(kind, item, why if needed else why_not))

    def called_for(quantity: str) -> list[str]:
        return [e.name for e in effects if quantity in e.needs] if do_forces else []

    by, faster = called_for("velocities"), called_for("accelerations")
    asked = wanted & {"velocities", "accelerations", "energy", "health"}
    step(
        StageKind.VELOCITIES,
        bool(asked or by),
        "asked for" if "velocities" in asked else _needed(by) if by else "accelerations, powers and health need them",
        "nothing asks for them: no force depends on a velocity" if do_forces else "only positions are asked for",
    )
    step(
        StageKind.ACCELERATIONS,
        bool(wanted & {"accelerations", "health"} or faster),
        _needed(faster) if faster and "accelerations" not in wanted else "asked for",
        "nothing asks for them",
    )
    named = {e.name: e for e in effects[: len(mechanism.effects)]}
    for name, what in EFFECTS.items():
        if name == "friction":
            continue  # below: it is solved together with the reactions
        why_not = "forces are not asked for" if name in named else "the scene does not list it in effects"
        step(StageKind.EFFECT, do_forces and name in named, what, why_not, name)
    for load in loads:
        why = f"{load.cause}, from {_listed(sorted(load.needs))}"
        step(StageKind.LOAD, do_forces, why, "forces are not asked for", load.name)
    none = "forces are not asked for" if effects else "the scene lists no effects and no loads: pure kinematics"
    rubbing = ", ".join(joints_with_friction(mechanism.joints))
    do_friction = do_forces and "friction" in mechanism.effects and bool(rubbing)
    how = "kinetostatics under the effects and loads above, "
    how += "solved together with the friction in the joints" if do_friction else "frictionless"
    step(StageKind.FORCES, do_forces, how, none)
    step(StageKind.ENERGY, do_forces and bool(wanted & {"energy", "health"}), "check of the forces", none)
    if "friction" not in mechanism.effects or not rubbing:
        idle = (
            f"{rubbing} have coefficients, but the scene does not list it in effects" if rubbing else "no joint has a coefficient"
        )
    else:
        idle = "forces are not asked for"
    step(StageKind.EFFECT, do_friction, f"dry friction in {rubbing}: iterates until it fits the reactions", idle, "friction")
    step(StageKind.HEALTH, "health" in wanted, "health of every frame", "health is not asked for")
    for name in mechanism.metrics:
        step(StageKind.METRIC, "velocities" in wanted, METRICS[name], "velocities are not asked for", name)
    for name, what in mechanism.studies.items():
        step(StageKind.STUDY, "velocities" in wanted, what, "velocities are not asked for", name)
    names = (*mechanism.effects, *(f"load {e.name}" for e in loads)) if do_forces else ()
    return Plan(computed=tuple(computed), skipped=tuple(skipped), effects=names)


def _needed(names: list[str]) -> str:
    return f"{_listed(names)} need{'s' if len(names) == 1 else ''} them"


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
