"""A measured setting put into a scene: what picking a point of a work-precision diagram does."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..scene.accuracies import ORDERS

__all__ = ["with_setting"]

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
