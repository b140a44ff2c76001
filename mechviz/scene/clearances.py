"""Clearance of revolute pairs in a scene: the table of a pair, and what becomes of it in the core."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import PlainValidator, WithJsonSchema

from mechcore.errors import Fault

from .fields import Quantity, Size, Speed, describe, fault
from .frictions import Coefficient
from .tables import Table

if TYPE_CHECKING:
    from mechcore.clearance import Clearance

    from .convert import Converter
    from .document import SceneDocument

__all__ = ["ClearanceDocument", "clearance_faults", "clearances_of"]

LineStiffness = Annotated[float | str, Quantity(("stiffness",), "above zero")]
LEAST_RESTITUTION = 0.05
"""Below this the losses that Hunt and Crossley's law needs are beyond any contact."""


def _restitution(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not LEAST_RESTITUTION <= value <= 1.0:
        remedy = f"Give a number from {LEAST_RESTITUTION:g} (nearly all is lost) to 1 (nothing is)."
        raise fault(f"{describe(value)} is no coefficient of restitution of a bearing.", remedy)
    return float(value)


def _exponent(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 1.0 <= value <= 4.0:
        raise fault(f"{describe(value)} is no exponent of a contact.", "Give 1 (a line presses) to 1.5 (a point, after Hertz).")
    return float(value)


class ClearanceDocument(Table):
    """Clearance of a revolute pair: its journal moves freely in its bearing until they touch."""

    radial: Size
    """Radius of the bearing less that of the journal."""
    stiffness: LineStiffness
    """Stiffness of the contact, force over indentation; where the exponent is not 1, at an indentation of the clearance."""
    exponent: Annotated[float, PlainValidator(_exponent), WithJsonSchema({"type": "number", "minimum": 1, "maximum": 4})] = 1.0
    """The force grows with this power of the indentation. Default 1."""
    restitution: Annotated[
        float, PlainValidator(_restitution), WithJsonSchema({"type": "number", "minimum": LEAST_RESTITUTION, "maximum": 1})
    ] = 1.0
    """Coefficient of restitution of an impact at ``speed``; slower impacts lose less. Default 1: nothing is lost."""
    speed: Speed | None = None
    """Speed of the impact for which the restitution holds."""
    radius: Size | None = None
    """Radius of the journal, which friction needs."""
    friction: Coefficient = 0.0
    """Coefficient of friction between journal and bearing."""


def clearance_faults(document: SceneDocument) -> Iterator[Fault]:
    """What does not fit together about clearances, in what could be read."""
    for name, pair in document.pairs.items():
        c, path = pair.clearance, f"pairs.{name}.clearance"
        if c is None or pair.kinds != ["revolute"]:
            continue
        if c.restitution < 1.0 and c.speed is None and c.sound("speed"):
            yield Fault(path, "a restitution at which speed? Slower impacts lose less.", 'Add speed = "0.5 m/s".')
        if c.friction and c.radius is None and c.sound("radius"):
            yield Fault(path, "friction without the radius of the journal.", 'Add radius = "10 mm".')
        if pair.friction is not None:
            why = "friction of a pair with clearance is that between its journal and its bearing."
            yield Fault(f"pairs.{name}.friction", why, "Give friction and radius in the table of the clearance.")
        if pair.stops:
            yield Fault(f"pairs.{name}.stops", "stops in a pair with clearance.", "Leave out one of them.")
        for made in (f"{name}.across", f"{name}.journal"):
            if made in document.links or made in document.pairs:
                yield Fault(path, f"its journal needs the name '{made}', which is taken.", "Give that another name.")


def clearances_of(document: SceneDocument, convert: Converter) -> dict[str, Clearance]:
    """The core's clearances by pair, in SI units; faults of their values are noted."""
    given = {name: pair.clearance for name, pair in document.pairs.items() if pair.clearance is not None}
    if not given:
        return {}
    from mechcore.clearance import Clearance
    from mechcore.effects.journal import loss_factor

    out = {}
    for name, c in given.items():
        path = f"pairs.{name}.clearance"
        speed = math.nan if c.speed is None else abs(convert.si(c.speed, "linear speed", f"{path}.speed"))
        if speed == 0.0:
            convert.note(f"{path}.speed", "an impact at no speed.", 'Give a speed such as "0.5 m/s".')
        out[name] = Clearance(
            radial=convert.si(c.radial, "length", f"{path}.radial"),
            stiffness=convert.si(c.stiffness, "stiffness", f"{path}.stiffness"),
            exponent=c.exponent,
            loss=loss_factor(c.restitution, speed) if c.restitution < 1.0 and speed > 0.0 else 0.0,
            radius=0.0 if c.radius is None else convert.si(c.radius, "length", f"{path}.radius"),
            friction=c.friction,
        )
    return out
