"""Dry friction in a scene: the table of a pair, the scene's own for all pairs, and what becomes of them in the core."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import PlainValidator, WithJsonSchema

from mechcore.effects.journal import loss_factor
from mechcore.errors import Fault
from mechcore.spec.clearance import Clearance
from mechcore.spec.mechanism import Friction
from mechviz.scene.fields import Effort, Flag, Length, Quantity, Size, Speed, Table, describe, fault

if TYPE_CHECKING:
    from mechviz.scene.convert import Converter
    from mechviz.scene.document import SceneDocument
    from mechviz.scene.kinds.joints import PairDocument


MOST = 1000.0
"""Largest coefficient of friction: beyond anything that is meant seriously."""


def _coefficient(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise fault(f"{describe(value)} where a coefficient of friction is wanted.", "Write a plain number such as 0.1.")
    if value < 0.0:
        raise fault(f"{describe(value)} is negative.", "Friction never pushes: give a coefficient of zero or more.")
    if not value <= MOST:
        raise fault(f"{describe(value)} is no coefficient of friction.", "Dry steel on steel has 0.1 to 0.2.")
    return float(value)


StribeckSpeed = Annotated[float | str, Quantity(("linear speed",), "above zero")]
Coefficient = Annotated[float, PlainValidator(_coefficient), WithJsonSchema({"type": "number", "minimum": 0})]


class FrictionDocument(Table):
    """Dry friction in a pair. It acts only where `effects` names friction."""

    coefficient: Coefficient | None = None
    """Coefficient of friction. Default: the scene's. Cylinder: friction over the force that drives it, without a default."""
    static: Coefficient | None = None
    """Coefficient of sticking, where forces decide the motion: at least that of sliding. Default: the same."""
    stribeck: StribeckSpeed | None = None
    """Stribeck speed s: at a speed v of the sliding surfaces the coefficient is coefficient + (static - coefficient) exp(-(v/s)^2).
    Default: it is that of sliding as soon as it slides."""
    radius: Size | None = None
    """Revolute, pin in slot, roller of a cam: radius of the pin. Default of a revolute pair: the scene's."""
    exact: Flag | None = None
    """Revolute: friction circle of the radius r sin(atan(coefficient)) instead of the usual r times coefficient."""
    length: Size | None = None
    """Prismatic: length of the bearing, whose two ends press on the guide. Default: the scene's, or only the force counts."""
    bearing: Literal["slider", "guide"] | None = None
    """Prismatic: which link carries the bearing, the one that slides (default) or the one with the guide."""
    offset: Length | None = None
    """Prismatic: how far along the guide the bearing's middle lies from the point of the link that carries it. Default 0."""
    height: Size | None = None
    """Prismatic: distance of the two faces of the guide that the friction acts on. Default 0: on the line of the guide."""
    brake: Effort | None = None
    """Revolute, prismatic, cylinder: friction moment or force that does not depend on what presses on the pair: a brake, seals."""
    lever: Size | None = None
    """Rolling, gear, rack: lever arm of the force across the contact, against the rolling."""


class FrictionDefaults(Table):
    """Friction of all revolute, sliding and slot pairs that do not say otherwise."""

    coefficient: Coefficient | None = None
    """Coefficient of friction of every revolute, prismatic and slot pair without its own."""
    radius: Size | None = None
    """Radius of the pin of every revolute pair without its own. Without any a revolute pair has no friction."""
    length: Size | None = None
    """Length of the bearing of every prismatic pair without its own."""
    exact: Flag = False
    """Whether revolute pairs that do not say otherwise have the exact friction circle."""


FRICTION_KEYS: Mapping[str, tuple[str, ...]] = {
    "revolute": ("coefficient", "static", "stribeck", "radius", "exact", "brake"),
    "prismatic": ("coefficient", "static", "stribeck", "length", "bearing", "offset", "height", "brake"),
    "pin_slot": ("coefficient", "static", "stribeck", "radius"),
    "cylinder": ("coefficient", "brake"),
    "cam": ("coefficient", "radius"),
    "rolling": ("lever",),
    "gear": ("lever",),
    "rack": ("lever",),
}
"""The keys of a pair's table of friction that go with each kind of pair."""

_LEVERS = ("rolling", "gear", "rack")
_OF_ITS_OWN = (*_LEVERS, "cylinder", "cam")  # the scene's defaults do not hold for these


def friction_faults(kind: str, words: str, table: FrictionDocument) -> list[tuple[str, str, str]]:
    """What does not fit in the table of a pair, each (key, message, remedy)."""
    known = FRICTION_KEYS.get(kind, ())
    if not known:
        return []  # the pair itself refuses the table
    found = []
    for key in table.model_fields_set:
        if key not in known and getattr(table, key) is not None:
            remedy = f"Known here: {', '.join(known)}."
            found.append(("friction", f"{key} does not go with the friction of {words}.", remedy))
    if kind in _LEVERS and table.lever is None and table.sound("lever") and not found:
        found.append(("friction", "'lever' is missing.", 'Add lever = "0.5 mm": the arm of the force across the contact.'))
    return found


def friction_spec(
    path: str, kind: str, table: FrictionDocument | None, defaults: FrictionDefaults | None, convert: Converter
) -> Friction | None:
    """The core's friction of a pair, what its own table leaves out taken from the scene's; None where there is none."""
    if kind not in FRICTION_KEYS or (table is None and (defaults is None or kind in _OF_ITS_OWN)):
        return None
    own, default = table or FrictionDocument(), defaults or FrictionDefaults()

    def length(key: str, fallback: float | str | None = None, at: str = f"{path}.friction") -> float:
        value = getattr(own, key)
        if value is not None:
            return convert.si(value, "length", f"{at}.{key}")
        return 0.0 if fallback is None else convert.si(fallback, "length", f"friction.{key}")

    if kind in _LEVERS:
        return Friction(lever=length("lever"))
    if kind == "cam":
        if own.coefficient is None:
            if own.sound("coefficient"):
                convert.note(f"{path}.friction", "'coefficient' is missing.", "Add coefficient = 0.1.")
            return None
        return Friction(coefficient=own.coefficient, radius=length("radius"))
    if kind == "cylinder":
        seals = 0.0 if own.brake is None else convert.si(own.brake, "force", f"{path}.friction.brake")
        if own.coefficient is None and own.brake is None and own.sound("coefficient", "brake"):
            remedy = 'Add brake = "80 N", the friction of the seals, or coefficient = 0.05 of the driving force.'
            convert.note(f"{path}.friction", "neither 'coefficient' nor 'brake' is there.", remedy)
        return Friction(coefficient=own.coefficient or 0.0, brake=seals)
    coefficient = own.coefficient if own.coefficient is not None else default.coefficient
    effort = "torque" if kind == "revolute" else "force"
    brake = 0.0 if own.brake is None else convert.si(own.brake, effort, f"{path}.friction.brake")
    if own.stribeck is not None and coefficient is None and own.sound("coefficient") and default.sound("coefficient"):
        convert.note(
            f"{path}.friction.stribeck", "there is no coefficient of sliding to which the curve falls.", "Add coefficient = 0.1."
        )
    if brake and (coefficient is None or (kind == "revolute" and own.radius is None and default.radius is None)):
        return Friction(brake=brake)
    if coefficient is None:
        if table is not None and own.sound("coefficient") and default.sound("coefficient"):
            remedy = "Add coefficient = 0.1 here, or [friction] with a coefficient for all joints."
            convert.note(f"{path}.friction", "'coefficient' is missing.", remedy)
        return None
    static = own.static or 0.0
    if static and static < coefficient and own.sound("static", "coefficient"):
        why = f"{static:g} is less than the coefficient of sliding, {coefficient:g}."
        convert.note(f"{path}.friction.static", why, "Give at least as much, or leave it out.")
    stribeck = 0.0 if own.stribeck is None else convert.si(own.stribeck, "linear speed", f"{path}.friction.stribeck")
    if own.stribeck is not None and not static > coefficient and own.sound("static", "coefficient", "stribeck"):
        why = f"the curve falls from static to {coefficient:g}, and static is {'no greater' if static else 'missing'}."
        convert.note(f"{path}.friction.stribeck", why, f"Add static = {1.5 * coefficient:g}, or leave stribeck out.")
    common: dict[str, Any] = {"coefficient": coefficient, "static": static, "stribeck": stribeck}
    if kind == "revolute":
        radius = length("radius", default.radius)
        if not radius:
            if table is not None and coefficient and own.sound("radius") and default.sound("radius"):
                remedy = 'Add radius = "5 mm", the radius of the pin, here or in [friction].'
                convert.note(f"{path}.friction", "'radius' is missing: friction in a pin acts at its radius.", remedy)
            return None
        exact = default.exact if own.exact is None else own.exact
        return Friction(**common, radius=radius, exact=exact, brake=brake)
    if kind == "pin_slot":
        return Friction(**common, radius=length("radius"))
    bearing = length("length", default.length)
    for key in ("offset", "height", "bearing"):
        if not bearing and getattr(own, key) is not None and own.sound("length") and default.sound("length"):
            remedy = 'Add length = "60 mm", the length of the bearing.'
            convert.note(f"{path}.friction.{key}", "without a length of the bearing it has no meaning.", remedy)
    return Friction(
        **common,
        length=bearing,
        bearing=own.bearing or "slider",
        offset=length("offset"),
        height=length("height"),
        brake=brake,
    )


def idle_effect(effects: list[Any], pairs: Mapping[str, PairDocument], found: list[Friction | None], convert: Converter) -> None:
    """Note a fault where friction is named and no pair has any."""
    if "friction" in effects and pairs and not any(f is not None for f in found):
        rubbing = [f"joints.{name}" for name, pair in pairs.items() if pair.friction is not None]
        if any(f.path == at or f.path.startswith((f"{at}.", f"{at}[")) for f in convert.faults for at in rubbing):
            return  # a pair with friction is faulty itself
        first = next((name for name, pair in pairs.items() if pair.kind in FRICTION_KEYS), "")
        where = f"joints.{first}" if first else "a pair"
        remedy = f'Write friction = {{ coefficient = 0.1, radius = "5 mm" }} at {where}, or leave friction out.'
        convert.note("effects", "friction is named, but no pair has any.", remedy)


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
    for name, pair in document.joints.items():
        c, path = pair.clearance, f"joints.{name}.clearance"
        if c is None or pair.kinds != ["revolute"]:
            continue
        if c.restitution < 1.0 and c.speed is None and c.sound("speed"):
            yield Fault(path, "a restitution at which speed? Slower impacts lose less.", 'Add speed = "0.5 m/s".')
        if c.friction and c.radius is None and c.sound("radius"):
            yield Fault(path, "friction without the radius of the journal.", 'Add radius = "10 mm".')
        if pair.friction is not None:
            why = "friction of a pair with clearance is that between its journal and its bearing."
            yield Fault(f"joints.{name}.friction", why, "Give friction and radius in the table of the clearance.")
        if pair.stops:
            yield Fault(f"joints.{name}.stops", "stops in a pair with clearance.", "Leave out one of them.")
        for made in (f"{name}.across", f"{name}.journal"):
            if made in document.links or made in document.joints:
                yield Fault(path, f"its journal needs the name '{made}', which is taken.", "Give that another name.")


def clearances_of(document: SceneDocument, convert: Converter) -> dict[str, Clearance]:
    """The core's clearances by pair, in SI units; faults of their values are noted."""
    given = {name: pair.clearance for name, pair in document.joints.items() if pair.clearance is not None}
    if not given:
        return {}
    out = {}
    for name, c in given.items():
        path = f"joints.{name}.clearance"
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
