"""What every kind of load states of itself, and what it is given to become a load of the core."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator

from mechcore.errors import Fault
from mechcore.laws.timed import Smoothness, Table
from mechcore.spec.loads import Load
from mechviz.scene.convert import Converter
from mechviz.scene.fields import Number, fault
from mechviz.scene.kinds.kind import Kind
from mechviz.scene.names import known_joint, link_names, split_point

if TYPE_CHECKING:
    from mechviz.scene.document import SceneDocument
    from mechviz.scene.kinds.loads.document import LoadDocument
    from mechviz.scene.reading.recovery import Reading


def _positive(value: float) -> float:
    if value <= 0.0:
        raise fault(f"{value:g} is not positive.", "Give a number above zero.")
    return value


def _at_least_one(value: float) -> float:
    if value < 1.0:
        raise fault(f"{value:g} is less than 1.", "Give at least 1.")
    return value


def _not_negative(value: float) -> float:
    if value < 0.0:
        raise fault(f"{value:g} is negative.", "Give zero or more.")
    return value


Positive = Annotated[Number, AfterValidator(_positive)]
AtLeastOne = Annotated[Number, AfterValidator(_at_least_one)]
NotNegative = Annotated[Number, AfterValidator(_not_negative)]


@dataclass(frozen=True, kw_only=True)
class LoadKind(Kind):
    """A kind of load: all that is known of its keyword, from the words for it to the load of the core."""

    make: Callable[[LoadMaker], Load | tuple[Load, ...] | None]  # the core's; None where a name is not there or a part is faulty
    some: tuple[str, ...] = ()  # at least one of these
    between: bool = False  # its keyword names two points or links, which differ
    check: Callable[[Reading, str, Any], Iterator[Fault]] | None = None  # faults of what stands at the path of its keyword
    threefold: bool = False  # stiffness and damping in x, y and angle


LINEAR = '"20 N s/m" (or "0.1 N m s/rad" for rotation)'
"""Example of a coefficient of damping."""


class LoadMaker:
    """A load of a scene with what surrounds it, its values in SI units."""

    def __init__(self, name: str, load: LoadDocument, reading: Reading, convert: Converter, lead: str | None):
        self.name, self.load, self.reading, self.convert, self.lead = name, load, reading, convert, lead
        self.document: SceneDocument = reading.document
        self.path = f"loads.{name}"

    @property
    def common(self) -> dict[str, Any]:
        return {"name": self.name, "use": self.load.use}

    def si(self, key: str, kind: str, default: float = 0.0) -> float:
        """A value of the load in SI, or what holds where it is left out."""
        value = getattr(self.load, key)
        return default if value is None else self.convert.si(value, kind, f"{self.path}.{key}")

    def ends(self, texts: list[str]) -> dict[str, Any] | None:
        """Links and points of the two ends of a spring or damper."""
        first, second = (split_point(self.reading, text) for text in texts)
        if first is None or second is None:
            return None
        return {"links": (first[0], second[0]), "points": (first[1], second[1])}

    def not_nothing(self, values: dict[str, float]) -> None:
        """Notes that a load with coefficients does nothing."""
        given = self.load.linear is not None or self.load.quadratic is not None
        if given and all(value == 0.0 for value in values.values()):
            self.convert.note(
                self.path, "its coefficients are zero: it does nothing.", "Give one of them a value, or leave it out."
            )

    def spline(
        self, x: tuple[float, ...], y: tuple[float, ...], path: str, period: float | None = None, smooth: Smoothness = True
    ) -> Table | None:
        """A table as a function; None, and a fault, where its rows are so close that nothing smooth goes through them."""
        try:
            return Table(x=x, y=y, period=period, smooth=smooth)
        except ValueError:
            self.convert.note(path, "the rows are too close to each other.", "Leave out some of them.")
            return None


def different_links(reading: Reading, path: str, ends: str | list[str]) -> Iterator[Fault]:
    """The fault of two points, "link.point", between which a load acts, on one link."""
    if isinstance(ends, str):
        return
    found = [split_point(reading, text) for text in ends]
    if ends[0] != ends[1] and found[0] and found[1] and found[0][0] == found[1][0]:
        yield Fault(path, f"both points are on '{found[0][0]}'.", "Name points of two links.")


def known_shaft(reading: Reading, path: str, name: str) -> Iterator[Fault]:
    """Faults of what a machine drives: a revolute joint or a moving link."""
    if name == reading.document.frame and name not in reading.document.joints:
        yield Fault(path, f"'{name}' is the fixed link: it does not turn.", "Name a revolute joint or a moving link.")
    elif name not in link_names(reading):
        yield from known_joint(reading, path, name, ("revolute",), "revolute joint")
