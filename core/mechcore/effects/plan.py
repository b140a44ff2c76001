"""The analysis plan: which stages a mechanism's effects and loads call for, which are left out, and why.

It follows from what the effects declare that they need (`mechcore.effects.registry`) and from the outputs that are asked for.
"""

from __future__ import annotations

from collections.abc import Iterable

from mechcore.effects.registry import effects_of
from mechcore.laws.timed import Free
from mechcore.records import dataclass
from mechcore.spec.mechanism import EFFECTS, METRICS, Mechanism, braked

OUTPUTS = ("positions", "velocities", "accelerations", "forces", "energy", "health")
"""Outputs that can be asked for; a recording asks for everything that the scene calls for."""


@dataclass(frozen=True)
class PlannedStage:
    """One stage or effect and the reason why it is computed or left out."""

    name: str
    why: str


@dataclass(frozen=True)
class Plan:
    """``computed`` and ``skipped`` stages and effects, in working order. ``effects``: those computed, by name."""

    computed: tuple[PlannedStage, ...]
    skipped: tuple[PlannedStage, ...]
    effects: tuple[str, ...]

    def has(self, name: str) -> bool:
        return any(s.name == name for s in self.computed)


def make_plan(mechanism: Mechanism, outputs: Iterable[str] = OUTPUTS) -> Plan:
    """The stages that the requested outputs need."""
    wanted = set(outputs)
    effects = effects_of(mechanism)
    loads = effects[len(mechanism.effects) :]
    free = [d.joint for d in mechanism.drives if isinstance(d.law, Free)]
    do_forces = bool(effects) and bool(wanted & {"forces", "energy"})
    computed: list[PlannedStage] = [PlannedStage("positions", "always")]
    if free:
        why = f"forces decide the motion of {_listed(free)}: it is found before all else"
        computed.insert(0, PlannedStage("motion under forces", why))
    skipped: list[PlannedStage] = []

    def step(name: str, needed: bool, why: str, why_not: str) -> None:
        (computed if needed else skipped).append(PlannedStage(name, why if needed else why_not))

    def called_for(quantity: str) -> list[str]:
        return [e.name for e in effects if quantity in e.needs] if do_forces else []

    by, faster = called_for("velocities"), called_for("accelerations")
    asked = wanted & {"velocities", "accelerations", "energy", "health"}
    step(
        "velocities",
        bool(asked or by),
        "asked for" if "velocities" in asked else _needed(by) if by else "accelerations, powers and health need them",
        "nothing asks for them: no force depends on a velocity" if do_forces else "only positions are asked for",
    )
    step(
        "accelerations",
        bool(wanted & {"accelerations", "health"} or faster),
        _needed(faster) if faster and "accelerations" not in wanted else "asked for",
        "nothing asks for them",
    )
    named = {e.name: e for e in effects[: len(mechanism.effects)]}
    for name, what in EFFECTS.items():
        if name == "friction":
            continue  # below: it is solved together with the reactions
        why_not = "forces are not asked for" if name in named else "the scene does not list it in effects"
        step(f"effect {name}", do_forces and name in named, what, why_not)
    for load in loads:
        step(f"load {load.name}", do_forces, f"{load.cause}, from {_listed(sorted(load.needs))}", "forces are not asked for")
    none = "forces are not asked for" if effects else "the scene lists no effects and no loads: pure kinematics"
    rubbing = ", ".join(braked(mechanism.joints))
    do_friction = do_forces and "friction" in mechanism.effects and bool(rubbing)
    how = "kinetostatics under the effects and loads above, "
    how += "solved together with the friction in the joints" if do_friction else "frictionless"
    step("reactions and drive efforts", do_forces, how, none)
    step("energy and power balance", do_forces and bool(wanted & {"energy", "health"}), "check of the forces", none)
    if "friction" not in mechanism.effects or not rubbing:
        idle = (
            f"{rubbing} have coefficients, but the scene does not list it in effects" if rubbing else "no joint has a coefficient"
        )
    else:
        idle = "forces are not asked for"
    step("effect friction", do_friction, f"dry friction in {rubbing}: iterates until it fits the reactions", idle)
    step("closure and condition", "health" in wanted, "health of every frame", "health is not asked for")
    for name in mechanism.metrics:
        step(f"answer {name}", "velocities" in wanted, METRICS[name], "velocities are not asked for")
    for name, what in mechanism.studies.items():
        step(name, "velocities" in wanted, what, "velocities are not asked for")
    names = (*mechanism.effects, *(f"load {e.name}" for e in loads)) if do_forces else ()
    return Plan(computed=tuple(computed), skipped=tuple(skipped), effects=names)


def _needed(names: list[str]) -> str:
    return f"{_listed(names)} need{'s' if len(names) == 1 else ''} them"


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
