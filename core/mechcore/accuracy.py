"""All accuracy settings: what each one controls, its default, and the settings that follow from one target error.

Errors are relative: lengths to the mechanism's size, angles to a radian, everything else to the peak of the quantity over the run.
With the defaults positions are found to rounding, rates exactly, motion under forces to 1e-9.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, Literal

from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass

Differentiation = Literal["exact", "differences", "graphical"]
NumberFormat = Literal["float64", "float32"]

LOOSEST, TIGHTEST = 1e-1, 1e-13
"""Largest and smallest target error: below the smallest, rounding times the condition number decides."""


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """All settings. ``target`` is the target error, None where the settings were chosen one by one or not at all."""

    target: float | None = None
    position: float = 2e-15  # residual at which Newton's method stops in groups without a closed form, relative to the size
    frames: int | None = None  # per cycle of the first drive, or over the duration; None: as in the scene
    interpolation: Literal[0, 1, 3, 5] = 3  # degree between frames: 0 the last value; 3 and 5 with the rates as slopes
    differentiation: Differentiation = "exact"  # rates by linear equations, by differences of frames, or drawn by chords
    differences: Literal[2, 4, 6] = 4  # order of the differences
    resolution: float = 5e-4  # graphical: smallest length that is read off the drawing, relative to its size
    method: Literal["auto", "energy", "gauss", "radau"] | None = None  # motion under forces; None: as in the scene
    integrator: float | None = None  # local error of the integrator; None: as in the scene
    nodes: int | None = None  # of a collocation window, whose order is twice that; None: about one per digit of the tolerance
    window: float | None = None  # longest window [s]; None: as long as the error allows
    friction: float = 1e-13  # residual, relative to a frame's largest load, at which Newton's method for normal loads stops
    event: float = 1e-9  # error of the times of events, in frame intervals
    chord: float | None = None  # deviation of facets from round shapes [m]; None: 0.5 % of the radius, or by the target
    profile: int | None = None  # points of a cam's profile in meshes; None: 1080, or by the target
    numbers: NumberFormat | None = None  # number format of recorded data; None: float64, or by the target
    decimation: int = 1  # k: every k-th frame is recorded
    pictures: int | None = None  # k: every k-th recorded frame has arrows; None: up to 720 per cycle, or by the target

    def __post_init__(self) -> None:
        faults = [fault for name in _BOUNDS for fault in self._check(name)]
        for name, allowed in _CHOICES.items():
            value = getattr(self, name)
            if value not in allowed:
                words = ", ".join(repr(a) for a in allowed if a is not None)
                faults.append(Fault(f"accuracy.{name}", f"{value!r} is not one of {words}.", "Choose one of them."))
        if faults:
            raise MechanismError(faults)

    def _check(self, name: str) -> list[Fault]:
        low, high, whole = _BOUNDS[name]
        value = getattr(self, name)
        if value is None and name in _OPTIONAL:
            return []
        number = isinstance(value, int) if whole else isinstance(value, int | float)
        if number and not isinstance(value, bool) and low <= value <= high:
            return []
        kind = "a whole number" if whole else "a number"
        return [Fault(f"accuracy.{name}", f"{value!r} is out of range.", f"Give {kind} from {low:g} to {high:g}.")]

    @property
    def changed(self) -> dict[str, Any]:
        """The settings that are not at their defaults, by name."""
        return {f.name: getattr(self, f.name) for f in fields(self) if getattr(self, f.name) != f.default}


_OPTIONAL = ("target", "frames", "integrator", "nodes", "window", "chord", "profile", "pictures")
_BOUNDS: dict[str, tuple[float, float, bool]] = {
    "target": (TIGHTEST, LOOSEST, False),
    "position": (1e-15, 1e-2, False),
    "frames": (4, 10_000_000, True),
    "resolution": (0.0, 0.1, False),
    "integrator": (1e-15, 0.1, False),
    "nodes": (2, 20, True),
    "window": (1e-12, 1e12, False),
    "friction": (1e-14, 1e-2, False),
    "event": (1e-14, 1.0, False),
    "chord": (1e-9, 1.0, False),
    "profile": (36, 100_000, True),
    "decimation": (1, 10_000, True),
    "pictures": (1, 10_000, True),
}
_CHOICES: dict[str, tuple[Any, ...]] = {
    "interpolation": (0, 1, 3, 5),
    "differentiation": ("exact", "differences", "graphical"),
    "differences": (2, 4, 6),
    "method": (None, "auto", "energy", "gauss", "radau"),
    "numbers": (None, "float64", "float32"),
}
SETTINGS: tuple[str, ...] = tuple(f.name for f in fields(Accuracy) if f.name != "target")
"""Names of all settings."""

DEFAULT = Accuracy()


def accuracy_for(target: float, **settings: Any) -> Accuracy:
    """The settings for a target error; ``settings`` override single ones.

    Each iterative stage gets a tenth of the error, so that their sum stays below it. Settings that depend on the motion stay open
    and are found by measuring a run: ``frames``, and for recording and drawing ``chord``, ``profile``, ``numbers`` and
    ``pictures``.
    """
    if isinstance(target, bool) or not isinstance(target, int | float) or not TIGHTEST <= target <= LOOSEST:
        remedy = f"Give the wanted relative error, a number from {TIGHTEST:g} to {LOOSEST:g}, such as 1e-6."
        raise MechanismError(Fault("accuracy", f"{target!r} is no accuracy.", remedy))
    accuracy = Accuracy(
        target=float(target),
        position=min(max(0.1 * target, 2e-15), 1e-6),
        interpolation=1 if target > 3e-4 else 3 if target > 3e-10 else 5,
        integrator=max(0.1 * target, 1e-14),
        friction=min(max(0.1 * target, 1e-13), 1e-2),
        event=min(max(target, 1e-12), 1e-2),
    )
    return replace(accuracy, **settings) if settings else accuracy
