"""The loads of a scene document: every kind with the keys that go with it.

To add a kind: its key in ``LoadDocument``, one line in ``KINDS``, how it becomes a load of the core in ``load_specs``, and the
names that it refers to in ``load_references``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, ConfigDict, Discriminator, Field, Tag, model_validator

from mechviz.scene.fields import (
    Angle,
    AngularSpeed,
    Coefficient,
    Coefficients,
    Coordinate,
    Extent,
    Force,
    ForceVector,
    IntegralGain,
    Length,
    Number,
    OneOrTwoNames,
    Power,
    Pressure,
    QuadraticCoefficient,
    Size,
    Stiffness,
    Stiffnesses,
    Table,
    Text,
    Torque,
    TorsionalGain,
    TwoNames,
    fault,
    one_of,
    refuse,
)
from mechviz.scene.kinds.drives import DriveDocument
from mechviz.scene.kinds.signals import (
    SIGNALS,
    ChirpDocument,
    FactorPolynomial,
    FactorTable,
    RampDocument,
    SineDocument,
    StepDocument,
)


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


def _value_or_table(value: Any) -> str:
    return "<table>" if isinstance(value, dict | DriveDocument) else "<value>"


Target = Annotated[Annotated[Coordinate, Tag("<value>")] | Annotated[DriveDocument, Tag("<table>")], Discriminator(_value_or_table)]


class CompressorDocument(Table):
    """The cycle of a compressor with clearance: compression, delivery, re-expansion, suction."""

    suction: Pressure
    """Absolute pressure of suction."""
    delivery: Pressure
    """Absolute pressure of delivery."""
    exponent: AtLeastOne = 1.3
    """Polytropic exponent of compression and re-expansion."""
    clearance: NotNegative = 0.05
    """Volume at top dead centre over the swept volume."""


class FourStrokeDocument(Table):
    """The cycle of a four-stroke engine over two turns of the drive."""

    ratio: Positive
    """Compression ratio: greatest over least volume."""
    intake: Pressure = "101325 Pa"
    """Absolute pressure during intake."""
    exhaust: Pressure = "101325 Pa"
    """Absolute pressure during exhaust."""
    exponent: AtLeastOne = 1.35
    """Polytropic exponent of compression."""
    expansion: AtLeastOne | None = None
    """Polytropic exponent of expansion. Default: that of compression."""
    rise: AtLeastOne = 1.0
    """Combustion at constant volume: pressure after over pressure before."""
    cutoff: AtLeastOne = 1.0
    """Combustion at constant pressure: volume after over volume before."""

    @model_validator(mode="after")
    def _makes_sense(self) -> FourStrokeDocument:
        if self.ratio <= self.cutoff:
            hint = "Give a ratio such as 9, or a smaller cutoff."
            refuse([("ratio", f"{self.ratio:g} is no greater than the cutoff, {self.cutoff:g}.", hint)])
        return self


class DiagramDocument(Table):
    """A measured indicator diagram: absolute pressures over the displacement from top dead centre."""

    displacement: Annotated[list[Length], Field(min_length=2)]
    """Increasing displacements, from 0 to the stroke."""
    outward: Annotated[list[Pressure], Field(min_length=2)] | None = None
    """Two strokes: pressures while the piston moves away from the head."""
    inward: Annotated[list[Pressure], Field(min_length=2)] | None = None
    """Two strokes: pressures while it moves towards the head."""
    power: Annotated[list[Pressure], Field(min_length=2)] | None = None
    """Four strokes: expansion."""
    exhaust: Annotated[list[Pressure], Field(min_length=2)] | None = None
    """Four strokes: exhaust."""
    intake: Annotated[list[Pressure], Field(min_length=2)] | None = None
    """Four strokes: intake."""
    compression: Annotated[list[Pressure], Field(min_length=2)] | None = None
    """Four strokes: compression."""

    @property
    def branches(self) -> tuple[str, ...]:
        """The branches that are given."""
        return tuple(k for k in ("outward", "inward", "power", "exhaust", "intake", "compression") if getattr(self, k) is not None)

    @model_validator(mode="after")
    def _whole(self) -> DiagramDocument:
        found = []
        if self.branches not in (("outward", "inward"), ("power", "exhaust", "intake", "compression")):
            hint = "Give outward and inward (two strokes), or power, exhaust, intake and compression (four strokes)."
            found.append(("", f"the diagram has {', '.join(self.branches) or 'no branch'}.", hint))
        n = len(self.displacement)
        for key in self.branches:
            if self.sound(key, "displacement") and len(getattr(self, key)) != n:
                found.append((key, f"{len(getattr(self, key))} pressures and {n} displacements.", "Give one pressure for each."))
        refuse(found)
        return self


@dataclass(frozen=True)
class Kind:
    """A kind of load: how it is called in a sentence, which keys go with it, and which of them have no default."""

    words: str
    keys: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    some: tuple[str, ...] = ()  # at least one of these


FACTORS = ("table", "polynomial", *SIGNALS)
"""Keys by which a load is multiplied by a factor: one of them at most."""

_CYCLES = ("compressor", "four_stroke", "diagram")

_DC = ("stall_torque", "no_load_speed")
_INDUCTION = ("breakdown_torque", "breakdown_slip", "synchronous_speed")

KINDS: Mapping[str, Kind] = {
    "force": Kind("a force", ("on", "at", "axes", "against", *FACTORS), ("on",)),
    "torque": Kind("a torque, which acts on the whole link", ("on", "against", *FACTORS), ("on",)),
    "spring": Kind("a spring", ("stiffness", "free_length", "preload", "solid_length"), ("stiffness", "free_length")),
    "damper": Kind("a damper", ("linear", "quadratic"), some=("linear", "quadratic")),
    "gas_spring": Kind("a gas spring", ("thrust", "extended", "gas_length", "exponent"), ("thrust", "extended", "gas_length")),
    "actuator": Kind("an actuator", ("thrust", *FACTORS), ("thrust",)),
    "torsion_spring": Kind("a torsion spring", ("stiffness", "free_angle"), ("stiffness",)),
    "torsion_damper": Kind("a torsion damper", ("linear",), ("linear",)),
    "bushing": Kind("a bushing", ("stiffness", "linear", "free_angle"), ("stiffness",)),
    "drag": Kind("drag", ("linear", "quadratic"), some=("linear", "quadratic")),
    "viscous": Kind("viscous friction", ("linear",), ("linear",)),
    "belt_tension": Kind("the tension of a belt", ("slack", "coefficient"), ("slack",)),
    "gas": Kind("gas pressure", ("bore", "top", "stroke", "head", "back", *_CYCLES, "fires", "drive"), ("bore", "top", "stroke")),
    "dc_motor": Kind("a DC motor", _DC, _DC),
    "induction_motor": Kind("an induction motor", _INDUCTION, _INDUCTION),
    "constant_power": Kind("a machine of constant power", ("power", "torque_limit"), ("power", "torque_limit")),
    "servo": Kind("a servo", ("target", "proportional", "derivative", "integral", *SIGNALS), ("target", "proportional")),
    "governor": Kind("a speed governor", ("set_speed", "gain", "limits"), ("set_speed", "gain", "limits")),
}
MACHINES = ("dc_motor", "induction_motor", "constant_power", "governor")
"""Loads that drive by a characteristic, and name the pair or link that they drive."""

_EXAMPLES = {
    "on": '"the link"',
    "stiffness": '"2 N/mm" (or "3 N m/rad" for a torsion spring)',
    "free_length": '"80 mm"',
    "thrust": '"400 N", with which it pushes',
    "extended": '"300 mm", the distance of its points when extended',
    "gas_length": '"250 mm", the volume of the gas when extended over the area of the rod',
    "linear": '"20 N s/m" (or "0.1 N m s/rad" for rotation)',
    "bore": '"80 mm"',
    "top": "the pair's coordinate at top dead centre",
    "stroke": '"80 mm"',
    "slack": '"200 N", what the slack span pulls',
    "stall_torque": '"20 N m", its torque at rest',
    "no_load_speed": '"1500 rpm"',
    "breakdown_torque": '"60 N m", the greatest one',
    "breakdown_slip": "0.2, the slip at the breakdown torque",
    "synchronous_speed": '"1500 rpm"',
    "target": '"30 deg", or the keys of a drive',
    "proportional": '"200 N m/rad" (or "5 N/mm" for a sliding pair)',
    "power": '"2 kW"',
    "torque_limit": '"50 N m"; its sign is the direction',
    "set_speed": '"300 rpm"',
    "gain": '"5 N m s/rad"',
    "limits": '["0 N m", "50 N m"], the least and the greatest torque',
}


class LoadDocument(Table):
    """A load: exactly one of the keys from force to governor, which name its kind, and what goes with that kind."""

    model_config = ConfigDict(json_schema_extra={"oneOf": [{"required": [key, *kind.needs]} for key, kind in KINDS.items()]})

    force: ForceVector | None = None
    """Components [x, y] of a force."""
    torque: Torque | None = None
    """A free moment, counter-clockwise positive."""
    actuator: OneOrTwoNames | None = None
    """The two points that an actuator of constant force pushes apart, or the sliding pair along which it pushes."""
    spring: TwoNames | None = None
    """The two points between which a spring pulls: ["link.point", "link.point"]."""
    damper: TwoNames | None = None
    """The two points between which a damper acts."""
    gas_spring: TwoNames | None = None
    """The two points that a gas spring pushes apart."""
    torsion_spring: TwoNames | None = None
    """The two links between which a torsion spring acts, by the angle from the first to the second."""
    torsion_damper: TwoNames | None = None
    """The two links between which a torsion damper acts."""
    bushing: TwoNames | None = None
    """The two points between which a bushing acts, by springs and dampers in x, y and angle: ["link.point", "link.point"]."""
    drag: Text | None = None
    """Resistance of a medium: "link.point" against the velocity of the point, "link" against the rotation of the link."""
    viscous: Text | None = None
    """The pair, of any kind that moves, in which viscous friction acts."""
    belt_tension: Text | None = None
    """The belt or chain that a tensioner keeps tight."""
    gas: Text | None = None
    """The sliding pair of the piston on which a gas presses, by an indicator diagram."""
    dc_motor: Text | None = None
    """The revolute pair or the link that a DC motor drives: a straight characteristic."""
    induction_motor: Text | None = None
    """The revolute pair or the link that an induction motor drives: slip curve of Kloss."""
    constant_power: Text | None = None
    """The revolute pair or the link that a machine of constant power drives."""
    governor: Text | None = None
    """The revolute pair or the link that a machine with a proportional speed governor drives."""
    servo: Text | None = None
    """The revolute or sliding pair whose coordinate a servo leads to a target, in a motion under forces."""
    on: Text | None = None
    """Force, torque: the link that it acts on."""
    at: Text | None = None
    """Force: the point of that link where it acts; may be left out where the link has one point only."""
    axes: Literal["world", "link"] = "world"
    """Force: whether the components are fixed in the world or turn with the link."""
    against: Text | None = None
    """Force, torque: the link on which the opposite acts at the same point."""
    table: FactorTable | None = None
    """Force, torque, actuator: the value is multiplied by this factor."""
    polynomial: FactorPolynomial | None = None
    """Force, torque, actuator: the value is multiplied by this polynomial."""
    sine: SineDocument | None = None
    """Force, torque, actuator: the value is multiplied by a sine of time."""
    step: StepDocument | None = None
    """Force, torque, actuator: the value is multiplied by a factor that jumps at a time."""
    ramp: RampDocument | None = None
    """Force, torque, actuator: the value is multiplied by a factor that changes evenly between two times."""
    chirp: ChirpDocument | None = None
    """Force, torque, actuator: the value is multiplied by a sine whose frequency changes with time."""
    stiffness: Stiffnesses | None = None
    """Spring: force per length. Torsion spring: moment per angle. Bushing: both, [x, y, angle], in the first link's axes."""
    free_length: Extent | None = None
    """Spring: length without load; 0 is a spring of no free length, used for balancing."""
    preload: Force | None = None
    """Spring: pull at the free length. Default 0."""
    solid_length: Size | None = None
    """Spring: length at which its coils touch. An event tells where it is squeezed below."""
    free_angle: Angle | None = None
    """Torsion spring, bushing: angle from the first link's frame to the second's without load. It starts nearest to it.
    Default 0."""
    linear: Coefficients | None = None
    """Damper, drag, viscous friction, torsion damper: force per speed, or moment per angular speed.
    Bushing: both, [x, y, angle]. Default 0."""
    quadratic: QuadraticCoefficient | None = None
    """Damper, drag: force per speed squared, or moment per angular speed squared."""
    thrust: Force | None = None
    """Actuator: force with which it pushes apart, or in the direction of its pair's coordinate. Gas spring: force when extended."""
    extended: Size | None = None
    """Gas spring: distance of its two points when extended."""
    gas_length: Size | None = None
    """Gas spring: volume of the gas when extended over the area of the rod."""
    exponent: AtLeastOne | None = None
    """Gas spring: polytropic exponent. Default 1 (slow); 1.4 where it moves fast."""
    slack: Force | None = None
    """Belt tension: what the slack span pulls."""
    coefficient: NotNegative | None = None
    """Belt tension: coefficient of friction between belt and pulleys; an event tells where it slips. Default: it cannot."""
    bore: Size | None = None
    """Gas: diameter of the piston."""
    top: Length | None = None
    """Gas: coordinate of the pair at top dead centre."""
    stroke: Size | None = None
    """Gas: distance of the dead centres."""
    head: Literal["ahead", "behind"] | None = None
    """Gas: the cylinder's head lies ahead of the piston in the direction of the pair (default), or behind it."""
    back: Pressure | None = None
    """Gas: absolute pressure on the other side of the piston. Default 101325 Pa."""
    compressor: CompressorDocument | None = None
    """Gas: the cycle of a compressor."""
    four_stroke: FourStrokeDocument | None = None
    """Gas: the cycle of a four-stroke engine."""
    diagram: DiagramDocument | None = None
    """Gas: a measured diagram."""
    fires: Coordinate | None = None
    """Gas, four strokes: position of the drive at the top dead centre of combustion. Default 0."""
    drive: Text | None = None
    """Gas, four strokes: the driven pair of the crank. Default: the first one."""
    stall_torque: Torque | None = None
    """DC motor: torque at rest; its sign is the direction."""
    no_load_speed: AngularSpeed | None = None
    """DC motor: speed without load, of the same sign."""
    breakdown_torque: Torque | None = None
    """Induction motor: greatest torque."""
    breakdown_slip: Positive | None = None
    """Induction motor: slip at the breakdown torque."""
    synchronous_speed: AngularSpeed | None = None
    """Induction motor: speed of the field; its sign is the direction."""
    power: Power | None = None
    """Constant power: the power."""
    torque_limit: Torque | None = None
    """Constant power: greatest torque, at low speeds; its sign is the direction."""
    set_speed: AngularSpeed | None = None
    """Governor: speed without load."""
    gain: TorsionalGain | None = None
    """Governor: torque per speed that is missing."""
    limits: Annotated[list[Torque], Field(min_length=2, max_length=2)] | None = None
    """Governor: least and greatest torque."""
    target: Target | None = None
    """Servo: the wanted coordinate, times a signal if one is given; or a law of motion, by the keys of a drive."""
    proportional: Stiffness | None = None
    """Servo: torque per angle, or force per length, that the pair is behind its target."""
    derivative: Coefficient | None = None
    """Servo: torque per angular speed, or force per speed, that it is slower than its target. Default 0."""
    integral: IntegralGain | None = None
    """Servo: torque per angle and time, or force per length and time: of what it was behind since the start. Default 0."""
    use: Literal["useful", "harmful"] | None = None
    """How a resisting load is classed. Default: process forces useful, friction and media harmful."""

    @property
    def kinds(self) -> list[str]:
        """The kinds that are given: one, in a load that is not faulty."""
        return [kind for kind in KINDS if getattr(self, kind) is not None]

    @property
    def kind(self) -> str:
        return self.kinds[0]

    @model_validator(mode="after")
    def _one_load(self) -> LoadDocument:
        refuse(one_of(self, tuple(KINDS), "the load"))
        kind = KINDS[self.kind]
        found: list[tuple[str, str, str]] = []
        for key in sorted(self.model_fields_set - {*KINDS, "use"}, key=list(LoadDocument.model_fields).index):
            if key not in kind.keys and getattr(self, key) is not None:
                found.append((key, f"{key} does not go with {kind.words}.", _instead(self.kind, key)))
        for key in kind.needs:
            if getattr(self, key) is None:
                example = '["200 N/mm", "80 N/mm", "3 N m/rad"]: in x, y and angle' if self.kind == "bushing" else _EXAMPLES[key]
                found.append(("", f"'{key}' is missing.", f"Add {key} = {example}."))
        if kind.some and all(getattr(self, key) is None for key in kind.some):
            found.append(
                ("", f"{kind.words} has neither {' nor '.join(kind.some)}.", f"Add {kind.some[0]} = {_EXAMPLES['linear']}.")
            )
        for key in ("stiffness", "linear"):
            value = getattr(self, key)
            if key in kind.keys and value is not None and isinstance(value, list) != (self.kind == "bushing"):
                why = f"{kind.words} has {f'one {key}' if isinstance(value, list) else f'a {key} in x, y and angle'}."
                remedy = "Give one value." if isinstance(value, list) else f"Write {key} = [x, y, angle]."
                found.append((key, why, remedy))
        if self.kind == "gas":
            found += one_of(self, _CYCLES, "the gas")
        factors = [key for key in FACTORS if getattr(self, key) is not None]
        if isinstance(self.target, DriveDocument) and factors:
            found.append(
                (factors[0], f"{factors[0]} beside a target that is a law of motion.", "Give one value as target, or leave it out.")
            )
        if len(factors) > 1:
            found.append((factors[1], f"{' and '.join(factors)} at once.", "Keep one of them."))
        between = ("spring", "damper", "gas_spring", "torsion_spring", "torsion_damper", "actuator", "bushing")
        for pair in (getattr(self, key) for key in between):
            if isinstance(pair, list) and pair[0] == pair[1]:
                found.append((self.kind, f"acts between '{pair[0]}' and itself.", "Name two different ones."))
        refuse(found)
        return self


def _instead(kind: str, key: str) -> str:
    """What to do about a key that does not go with a kind of load."""
    if key in ("linear", "quadratic") and kind in ("spring", "gas_spring", "torsion_spring"):
        return "Write a damper between the same points as a load of its own."
    if key == "coefficient" and "linear" in KINDS[kind].keys:
        return "Write linear = ..."
    return f"Leave out {key}."
