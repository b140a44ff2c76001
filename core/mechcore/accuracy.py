"""Every dial of accuracy in one place: what each trades, its default, and the setting that follows from a single wanted error.

Errors are relative: lengths to the mechanism's size, angles to a radian, everything else to the peak of the quantity over the run.
The defaults are what the program does where nobody asks: positions to rounding, rates exactly, motion under forces to 1e-9.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, Literal

from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass

Differentiation = Literal["exact", "differences", "graphical"]
NumberFormat = Literal["float64", "float32"]

LOOSEST, TIGHTEST = 1e-1, 1e-13
"""Largest and smallest error that can be asked for: below, rounding times condition decides."""


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """All settings. ``target`` is the error that was asked for, None where the settings were set one by one or not at all."""

    target: float | None = None
    position: float = 2e-15  # residual at which Newton's method stops in groups without a closed form, in sizes of the mechanism
    frames: int | None = None  # a cycle of the first drive (or over the duration); None: what the scene says
    interpolation: Literal[0, 1, 3, 5] = 3  # between frames: last value, straight, cubic and quintic with the rates as slopes
    differentiation: Differentiation = "exact"  # rates by linear equations, by differences of frames, or drawn by chords
    differences: Literal[2, 4, 6] = 4  # order of the differences
    resolution: float = 5e-4  # graphical: what can be read off the drawing, of its size
    method: Literal["auto", "energy", "gauss", "radau"] | None = None  # motion under forces; None: what the scene says
    integrator: float | None = None  # its local error; None: what the scene says
    nodes: int | None = None  # of a window of collocation: its order is twice that; None: as many as digits are wanted
    window: float | None = None  # longest window [s]; None: as long as the error allows
    friction: float = 1e-13  # residual at which Newton's method for normal loads stops, of the largest load of the frame
    event: float = 1e-9  # times of events, in distances of two frames
    chord: float | None = None  # between round shapes and their facets [m]; None: 0.5 % of the radius, or by the target
    profile: int | None = None  # points of a cam's profile in meshes; None: 1080, or by the target
    numbers: NumberFormat | None = None  # digits that recorded data keep; None: float64, or by the target
    decimation: int = 1  # every so many frames are recorded
    pictures: int | None = None  # every so many of those arrows are drawn; None: up to 720 a cycle, or by the target

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
    """The setting for a wanted error; ``settings`` override single ones.

    Each iterative stage gets a tenth of the error, so that what they add up to stays below it. Settings that depend on the motion
    stay open and is found by measuring a run: ``frames``, and of what is kept and drawn ``chord``, ``profile``, ``numbers`` and
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
