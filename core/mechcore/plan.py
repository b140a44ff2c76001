"""The analysis plan: which stages a mechanism's effects and loads call for, which are left out, and why."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from .spec import ANSWERS, EFFECTS, Mechanism

__all__ = ["OUTPUTS", "Plan", "Step", "make_plan"]

OUTPUTS = ("positions", "velocities", "accelerations", "forces", "energy", "health")
"""What can be asked for; a recording asks for everything that the scene calls for."""


@dataclass(frozen=True)
class Step:
    """One stage or effect and the reason why it is computed or left out."""

    name: str
    why: str


@dataclass(frozen=True)
class Plan:
    """``computed`` and ``skipped`` stages and effects, in working order. ``effects``: those computed, by name."""

    computed: tuple[Step, ...]
    skipped: tuple[Step, ...]
    effects: tuple[str, ...]

    def has(self, name: str) -> bool:
        return any(s.name == name for s in self.computed)


def make_plan(mechanism: Mechanism, outputs: Iterable[str] = OUTPUTS) -> Plan:
    """What has to be computed for the requested outputs."""
    wanted = set(outputs)
    asked = tuple(mechanism.effects)
    loads = tuple(load.name for load in mechanism.loads)
    forces = bool(asked or loads)
    computed: list[Step] = [Step("positions", "always")]
    skipped: list[Step] = []

    def step(name: str, needed: bool, why: str, why_not: str) -> None:
        (computed if needed else skipped).append(Step(name, why if needed else why_not))

    do_forces = forces and bool(wanted & {"forces", "energy"})
    inertia = do_forces and "inertia" in asked
    step(
        "velocities",
        bool(wanted & {"velocities", "accelerations", "health"}) or do_forces,
        "asked for" if "velocities" in wanted else "accelerations and powers need them",
        "only positions are asked for",
    )
    step(
        "accelerations",
        "accelerations" in wanted or inertia or "health" in wanted,
        "inertia needs them" if inertia and "accelerations" not in wanted else "asked for",
        "nothing asks for them",
    )
    for name, what in EFFECTS.items():
        step(f"effect {name}", do_forces and name in asked, what, "the scene does not list it in effects")
    for name in loads:
        step(f"load {name}", do_forces, "the scene lists it in loads", "forces are not asked for")
    none = "the scene lists no effects and no loads: pure kinematics"
    step("reactions and drive efforts", do_forces, "frictionless kinetostatics under the effects and loads above", none)
    step("energy and power balance", do_forces and bool(wanted & {"energy", "health"}), "check of the forces", none)
    step("friction", False, "", "no friction is named")
    step("closure and condition", "health" in wanted, "health of every frame", "health is not asked for")
    for name in mechanism.answers:
        step(f"answer {name}", "velocities" in wanted, ANSWERS[name], "velocities are not asked for")
    effects = (*asked, *(f"load {n}" for n in loads)) if do_forces else ()
    return Plan(computed=tuple(computed), skipped=tuple(skipped), effects=effects)
