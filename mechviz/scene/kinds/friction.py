"""Dry friction in a scene: the table of a joint, the scene's defaults for all joints, and their conversion to the core."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import PlainValidator, WithJsonSchema

from mechcore.effects.resistance import loss_factor
from mechcore.errors import Fault
from mechcore.records import dataclass
from mechcore.spec.clearance import Clearance
from mechcore.spec.mechanism import Friction
from mechviz.scene.fields import DocumentTable, Effort, Flag, Length, QuantityMark, Size, Speed, describe, fault

if TYPE_CHECKING:
    from mechviz.scene.convert import Converter
    from mechviz.scene.document import SceneDocument
    from mechviz.scene.kinds.joints.document import JointDocument


LARGEST_COEFFICIENT = 1000.0
"""Largest coefficient of friction that is accepted, far beyond any real one."""


def _coefficient(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise fault(f"{describe(value)} where a coefficient of friction is wanted.", "Write a plain number such as 0.1.")
    if value < 0.0:
        raise fault(f"{describe(value)} is negative.", "Friction never pushes: give a coefficient of zero or more.")
    if not value <= LARGEST_COEFFICIENT:
        raise fault(f"{describe(value)} is no coefficient of friction.", "Dry steel on steel has 0.1 to 0.2.")
    return float(value)


StribeckSpeed = Annotated[float | str, QuantityMark(("linear speed",), "above zero")]
FrictionCoefficient = Annotated[float, PlainValidator(_coefficient), WithJsonSchema({"type": "number", "minimum": 0})]


class FrictionDocument(DocumentTable):
    """Dry friction in a joint. It acts only where `effects` names friction."""

    coefficient: FrictionCoefficient | None = None
    """Coefficient of friction. Default: the scene's. Cylinder: friction over the force that drives it, without a default."""
    static: FrictionCoefficient | None = None
    """Coefficient of sticking, where forces decide the motion: at least that of sliding. Default: the same."""
    stribeck: StribeckSpeed | None = None
    """Stribeck speed s: at a speed v of the sliding surfaces the coefficient is coefficient + (static - coefficient) exp(-(v/s)^2).
    Default: it is that of sliding as soon as it slides."""
    radius: Size | None = None
    """Revolute, pin in slot, roller of a cam: radius of the pin; screw: mean radius of its thread. Default of a revolute joint: the
    scene's."""
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
    """Revolute, prismatic, cylinder: friction moment or force that does not depend on what presses on the joint: a brake, seals."""
    lever: Size | None = None
    """Rolling, gear, rack: lever arm of the force across the contact, against the rolling."""


class FrictionDefaults(DocumentTable):
    """Default friction of all revolute, sliding and slot joints."""

    coefficient: FrictionCoefficient | None = None
    """Coefficient of friction of every revolute, prismatic and slot joint without its own."""
    radius: Size | None = None
    """Radius of the pin of every revolute joint without its own. Without any a revolute joint has no friction."""
    length: Size | None = None
    """Length of the bearing of every prismatic joint without its own."""
    exact: Flag = False
    """Whether revolute joints have the exact friction circle by default."""


@dataclass(frozen=True)
class FrictionKind:
    """Dry friction of a kind of joint: the keys of its table, their conversion to the core, and whether the scene's defaults apply
    to it."""

    keys: tuple[str, ...]
    make: Callable[[_Table], Friction | None]
    defaults: bool = True


@dataclass(frozen=True)
class _Table:
    """The table of friction of a joint, with the scene's defaults."""

    path: str
    own: FrictionDocument
    default: FrictionDefaults
    stated: bool  # it has a table of its own
    convert: Converter

    def has_valid(self, *keys: str) -> bool:
        """Whether these keys could be read, of both tables."""
        return self.own.has_valid(*keys) and self.default.has_valid(*keys)

    def note(self, key: str, message: str, remedy: str) -> None:
        self.convert.note(f"{self.path}.{key}" if key else self.path, message, remedy)

    def si(self, key: str, kind: str = "length", fallback: float | str | None = None) -> float:
        """A value in SI, that of the scene's table where the joint has none; 0 where neither has."""
        value = getattr(self.own, key)
        if value is not None:
            return self.convert.si(value, kind, f"{self.path}.{key}")
        return 0.0 if fallback is None else self.convert.si(fallback, kind, f"friction.{key}")

    def sliding(self, brake: float, *, only_brake: bool = False) -> dict[str, Any] | None:
        """Coefficients and Stribeck speed of sliding surfaces; None where there is only a brake, or nothing."""
        own, coefficient = self.own, self.own.coefficient if self.own.coefficient is not None else self.default.coefficient
        if own.stribeck is not None and coefficient is None and self.has_valid("coefficient"):
            self.note("stribeck", "there is no coefficient of sliding to which the curve falls.", "Add coefficient = 0.1.")
        if brake and (coefficient is None or only_brake):
            return None
        if coefficient is None:
            if self.stated and self.has_valid("coefficient"):
                remedy = "Add coefficient = 0.1 here, or [friction] with a coefficient for all joints."
                self.note("", "'coefficient' is missing.", remedy)
            return None
        static = own.static or 0.0
        if static and static < coefficient and own.has_valid("static", "coefficient"):
            why = f"{static:g} is less than the coefficient of sliding, {coefficient:g}."
            self.note("static", why, "Give at least as much, or leave it out.")
        stribeck = self.si("stribeck", "linear speed")
        if own.stribeck is not None and not static > coefficient and own.has_valid("static", "coefficient", "stribeck"):
            why = f"the curve falls from static to {coefficient:g}, and static is {'no greater' if static else 'missing'}."
            self.note("stribeck", why, f"Add static = {1.5 * coefficient:g}, or leave stribeck out.")
        return {"coefficient": coefficient, "static": static, "stribeck": stribeck}


def _pin(t: _Table) -> Friction | None:
    brake = t.si("brake", "torque")
    values = t.sliding(brake, only_brake=t.own.radius is None and t.default.radius is None)
    if values is None:
        return Friction(brake=brake) if brake else None
    radius = t.si("radius", fallback=t.default.radius)
    if not radius:
        if t.stated and values["coefficient"] and t.has_valid("radius"):
            remedy = 'Add radius = "5 mm", the radius of the pin, here or in [friction].'
            t.note("", "'radius' is missing: friction in a pin acts at its radius.", remedy)
        return None
    exact = t.default.exact if t.own.exact is None else t.own.exact
    return Friction(**values, radius=radius, exact=exact, brake=brake)


def _pin_in_slot(t: _Table) -> Friction | None:
    values = t.sliding(0.0)
    return None if values is None else Friction(**values, radius=t.si("radius"))


def _slider(t: _Table) -> Friction | None:
    brake = t.si("brake", "force")
    values = t.sliding(brake)
    if values is None:
        return Friction(brake=brake) if brake else None
    bearing = t.si("length", fallback=t.default.length)
    for key in ("offset", "height", "bearing"):
        if not bearing and getattr(t.own, key) is not None and t.has_valid("length"):
            t.note(key, "without a length of the bearing it has no meaning.", 'Add length = "60 mm", the length of the bearing.')
    return Friction(
        **values,
        length=bearing,
        bearing=t.own.bearing or "slider",
        offset=t.si("offset"),
        height=t.si("height"),
        brake=brake,
    )


def _seals(t: _Table) -> Friction | None:
    if t.own.coefficient is None and t.own.brake is None and t.own.has_valid("coefficient", "brake"):
        remedy = 'Add brake = "80 N", the friction of the seals, or coefficient = 0.05 of the driving force.'
        t.note("", "neither 'coefficient' nor 'brake' is there.", remedy)
    return Friction(coefficient=t.own.coefficient or 0.0, brake=t.si("brake", "force"))


def _thread(t: _Table) -> Friction | None:
    values = t.sliding(0.0)
    if values is not None and t.own.radius is None and t.has_valid("radius"):
        t.note("", "'radius' is missing: friction acts at the mean radius of the thread.", 'Add radius = "9 mm".')
        return None
    return None if values is None else Friction(**values, radius=t.si("radius"))


def _roller(t: _Table) -> Friction | None:
    if t.own.coefficient is None:
        if t.own.has_valid("coefficient"):
            t.note("", "'coefficient' is missing.", "Add coefficient = 0.1.")
        return None
    return Friction(coefficient=t.own.coefficient, radius=t.si("radius"))


_SLIDING = ("coefficient", "static", "stribeck")
PIN = FrictionKind((*_SLIDING, "radius", "exact", "brake"), _pin)
PIN_IN_SLOT = FrictionKind((*_SLIDING, "radius"), _pin_in_slot)
SLIDER = FrictionKind((*_SLIDING, "length", "bearing", "offset", "height", "brake"), _slider)
THREAD = FrictionKind((*_SLIDING, "radius"), _thread, defaults=False)
SEALS = FrictionKind(("coefficient", "brake"), _seals, defaults=False)
ROLLER = FrictionKind(("coefficient", "radius"), _roller, defaults=False)
LEVER = FrictionKind(("lever",), lambda t: Friction(lever=t.si("lever")), defaults=False)


def friction_faults(kind: FrictionKind, words: str, table: FrictionDocument) -> list[tuple[str, str, str]]:
    """Faults in the friction of a joint, each (key, message, remedy); ``words``: what the joint is called."""
    faults = []
    for key in table.model_fields_set:
        if key not in kind.keys and getattr(table, key) is not None:
            remedy = f"Known here: {', '.join(kind.keys)}."
            faults.append(("friction", f"{key} does not go with the friction of {words}.", remedy))
    if kind is LEVER and table.lever is None and table.has_valid("lever") and not faults:
        faults.append(("friction", "'lever' is missing.", 'Add lever = "0.5 mm": the arm of the force across the contact.'))
    return faults


def friction_spec(
    kind: FrictionKind, path: str, table: FrictionDocument | None, defaults: FrictionDefaults | None, convert: Converter
) -> Friction | None:
    """The core's friction of a joint, what its own table leaves out taken from the scene's; None where there is none."""
    if table is None and (defaults is None or not kind.defaults):
        return None
    own, default = table or FrictionDocument(), defaults or FrictionDefaults()
    return kind.make(_Table(f"{path}.friction", own, default, table is not None, convert))


def idle_effect(effects: list[Any], joints: Mapping[str, JointDocument], each: list[Friction | None], convert: Converter) -> None:
    """Note a fault where friction is named and no joint has any."""
    if "friction" in effects and joints and not any(f is not None for f in each):
        rubbing = [f"joints.{name}" for name, joint in joints.items() if joint.friction is not None]
        if any(f.path == at or f.path.startswith((f"{at}.", f"{at}[")) for f in convert.faults for at in rubbing):
            return  # a joint with friction is faulty itself
        first = next((name for name, joint in joints.items() if joint.traits.friction is not None), "")
        where = f"joints.{first}" if first else "a joint"
        remedy = f'Write friction = {{ coefficient = 0.1, radius = "5 mm" }} at {where}, or leave friction out of the effects.'
        convert.note("effects", "no joint has any friction that could act.", remedy)


LineStiffness = Annotated[float | str, QuantityMark(("stiffness",), "above zero")]
LEAST_RESTITUTION = 0.05
"""Least coefficient of restitution: below it, Hunt and Crossley's law needs losses beyond those of any contact."""


def _restitution(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not LEAST_RESTITUTION <= value <= 1.0:
        remedy = f"Give a number from {LEAST_RESTITUTION:g} (nearly all is lost) to 1 (nothing is)."
        raise fault(f"{describe(value)} is no coefficient of restitution of a bearing.", remedy)
    return float(value)


def _exponent(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 1.0 <= value <= 4.0:
        raise fault(f"{describe(value)} is no exponent of a contact.", "Give 1 (a line presses) to 1.5 (a point, after Hertz).")
    return float(value)


class ClearanceDocument(DocumentTable):
    """Clearance of a revolute joint: its journal moves freely in its bearing until they touch."""

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
    friction: FrictionCoefficient = 0.0
    """Coefficient of friction between journal and bearing."""


def clearance_faults(document: SceneDocument) -> Iterator[Fault]:
    """Faults of clearances, in what could be read."""
    for name, joint in document.joints.items():
        c, path = joint.clearance, f"joints.{name}.clearance"
        if c is None or joint.kinds != ["revolute"]:
            continue
        if c.restitution < 1.0 and c.speed is None and c.has_valid("speed"):
            yield Fault(path, "a restitution at which speed? Slower impacts lose less.", 'Add speed = "0.5 m/s".')
        if c.friction and c.radius is None and c.has_valid("radius"):
            yield Fault(path, "friction without the radius of the journal.", 'Add radius = "10 mm".')
        if joint.friction is not None:
            why = "friction of a joint with clearance is that between its journal and its bearing."
            yield Fault(f"joints.{name}.friction", why, "Give friction and radius in the table of the clearance.")
        if joint.stops:
            yield Fault(f"joints.{name}.stops", "stops in a joint with clearance.", "Leave out one of them.")
        for made in (f"{name}.across", f"{name}.journal"):
            if made in document.links or made in document.joints:
                yield Fault(path, f"its journal needs the name '{made}', which is taken.", "Give that another name.")


def clearances_of(document: SceneDocument, convert: Converter) -> dict[str, Clearance]:
    """The core's clearances by joint, in SI units; faults of their values are noted."""
    given = {name: joint.clearance for name, joint in document.joints.items() if joint.clearance is not None}
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
