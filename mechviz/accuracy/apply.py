"""A measured setting put into a scene: what picking a point of a work-precision diagram does."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from mechcore.accuracy import DIALS

from ..scene.accuracies import ORDERS

if TYPE_CHECKING:
    from ..run import Run

__all__ = ["in_use", "with_setting", "with_target"]

UNSET: dict[str, dict[str, Any]] = {"integrator": {"nodes": None}, "tessellation": {"chord": None}}
"""What the options of a dial mean where they do not say it."""

NAMES = {order: name for name, order in ORDERS.items()}


def with_setting(document: Mapping[str, Any], options: Mapping[str, Any]) -> dict[str, Any]:
    """A scene's plain data with the options of a `Point`: frames, method and tolerance go to [run], the others to accuracy."""
    run = dict(document.get("run", {}))
    stated = document.get("accuracy")
    accuracy = dict(stated) if isinstance(stated, Mapping) else {} if stated is None else {"target": stated}
    for key, value in options.items():
        if key == "frames":
            run["frames"] = int(value)
        elif key == "method":
            run["method"] = value
        elif key == "integrator":
            run["tolerance"] = value
        elif key == "interpolation":
            accuracy[key] = NAMES[value]
        elif key == "chord":
            accuracy[key] = f"{float(value)!r} m"
        else:
            accuracy[key] = value
    out = {k: v for k, v in document.items() if k not in ("run", "accuracy")}
    return {**out, **({"run": run} if run else {}), **({"accuracy": accuracy} if accuracy else {})}


def with_target(document: Mapping[str, Any], target: float | None) -> dict[str, Any]:
    """A scene's plain data with a wanted error from which all dials follow, those that it states among them; with None without."""
    run = {k: v for k, v in document.get("run", {}).items() if target is None or k not in ("frames", "tolerance")}
    out = {k: v for k, v in document.items() if k not in ("run", "accuracy")}
    return {**out, **({"run": run} if run else {}), **({"accuracy": target} if target is not None else {})}


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
