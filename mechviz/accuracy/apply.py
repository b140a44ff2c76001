"""A measured setting put into a scene: what picking a point of a work-precision diagram does."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from mechcore.accuracy import DIALS
from mechviz.scene.annotations import Place
from mechviz.scene.document import SceneDocument, stated
from mechviz.scene.fields import Table
from mechviz.scene.kinds.accuracy import ORDERS

if TYPE_CHECKING:
    from mechviz.runs import Run


UNSET: dict[str, dict[str, Any]] = {"integrator": {"nodes": None}, "tessellation": {"chord": None}}
"""What the options of a dial mean where they do not say it."""

NAMES = {order: name for name, order in ORDERS.items()}


def setting_changes(document: SceneDocument, options: Mapping[str, Any]) -> dict[Place, Any]:
    """The changes of a scene that apply the options of a `Point`: frames, method and tolerance go to [run], the others to
    accuracy."""
    given = document.accuracy
    accuracy: dict[str, Any] = stated(given) if isinstance(given, Table) else {} if given is None else {"target": given}
    changes: dict[Place, Any] = {}
    for key, value in options.items():
        if key == "frames":
            changes["run", "frames"] = int(value)
        elif key == "method":
            changes["run", "method"] = value
        elif key == "integrator":
            changes["run", "tolerance"] = value
        elif key == "interpolation":
            accuracy[key] = NAMES[value]
        elif key == "chord":
            accuracy[key] = f"{float(value)!r} m"
        else:
            accuracy[key] = value
    return changes | {("accuracy",): accuracy or None}


def target_changes(target: float | None) -> dict[Place, Any]:
    """The changes of a scene that set a wanted error from which all dials follow, those that it states among them; None: none."""
    changes: dict[Place, Any] = {("accuracy",): target}
    return changes if target is None else changes | {("run", "frames"): None, ("run", "tolerance"): None}


def in_use(run: Run, dial: str, options: Mapping[str, Any]) -> bool:
    """Whether a run was made with the options of a `Point` of a dial."""
    options = {**UNSET.get(dial, {}), **options}
    dials, simulation = run.accuracy, run.simulation
    present: dict[str, Any] = {name: getattr(dials, name) for name in DIALS if name in options}
    present |= {"frames": run.scene.frames}
    if "profile" in options or "numbers" in options:  # these may have to be measured first
        present |= {"profile": run.kept.profile, "numbers": run.kept.numbers}
    if simulation is not None:
        present |= {"method": simulation.method, "integrator": simulation.tolerance}
    return all(present.get(name) == value for name, value in options.items())
