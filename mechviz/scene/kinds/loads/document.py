"""A load of a scene document: one of the kinds with the keys that go with it, and its conversion to the core.

To add a kind, define its keyword and keys, its conversion to the core and its entry in a module of this folder.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, ClassVar, Literal

from pydantic import ConfigDict, model_validator

from mechcore.errors import Fault
from mechcore.spec.loads import Load
from mechviz.scene.convert import Converter
from mechviz.scene.fields import Coefficients, Force, QuadraticCoefficient, one_of, raise_faults
from mechviz.scene.kinds.drives import DriveDocument
from mechviz.scene.kinds.kind import LINEAR, KindTable, LoadKind, LoadMaker
from mechviz.scene.kinds.loads.gas import GAS, GasKeys
from mechviz.scene.kinds.loads.machines import MACHINES, MachineKeys
from mechviz.scene.kinds.loads.prescribed import FACTORS, PRESCRIBED, PrescribedKeys, check_factor, check_prescribed
from mechviz.scene.kinds.loads.springs import SPRINGS, SpringKeys
from mechviz.scene.kinds.signals import ChirpDocument, FactorPolynomial, FactorTable, RampDocument, SineDocument, StepDocument
from mechviz.scene.names import known_drive

if TYPE_CHECKING:
    from mechviz.scene.reading.recovery import Reading


LOAD_KINDS: Mapping[str, LoadKind] = {**PRESCRIBED, **SPRINGS, **GAS, **MACHINES}
"""The kinds of loads by their keywords."""


class LoadKeys(KindTable):
    """The keys of loads of several kinds."""

    thrust: Force | None = None
    """Actuator: force with which it pushes apart, or in the direction of its joint's coordinate. Gas spring: force when
    extended."""
    linear: Coefficients | None = None
    """Damper, drag, viscous friction, torsion damper: force per speed, or moment per angular speed.
    Bushing: both, [x, y, angle]. Default 0."""
    quadratic: QuadraticCoefficient | None = None
    """Damper, drag: force per speed squared, or moment per angular speed squared."""
    table: FactorTable | None = None
    """Force, torque, actuator: the value is multiplied by this factor."""
    polynomial: FactorPolynomial | None = None
    """Force, torque, actuator: the value is multiplied by this polynomial."""
    sine: SineDocument | None = None
    """Force, torque, actuator: the value is multiplied by a sine of time."""
    step: StepDocument | None = None
    """Force, torque, actuator: the value is multiplied by a factor that jumps at a time."""
    ramp: RampDocument | None = None
    """Force, torque, actuator: the value is multiplied by a factor that changes linearly between two times."""
    chirp: ChirpDocument | None = None
    """Force, torque, actuator: the value is multiplied by a sine whose frequency changes with time."""
    use: Literal["useful", "harmful"] | None = None
    """How a resisting load is classed. Default: process forces useful, friction and media harmful."""


class LoadDocument(LoadKeys, MachineKeys, GasKeys, SpringKeys, PrescribedKeys):
    """A load: exactly one of the keys from force to governor, which name its kind, and what goes with that kind."""

    KINDS: ClassVar[Mapping[str, LoadKind]] = LOAD_KINDS
    EVERY = ("use",)

    model_config = ConfigDict(json_schema_extra={"oneOf": [{"required": [key, *kind.needs]} for key, kind in LOAD_KINDS.items()]})

    @property
    def traits(self) -> LoadKind:
        """Its kind."""
        return LOAD_KINDS[self.kind]

    @model_validator(mode="after")
    def _one_load(self) -> LoadDocument:
        raise_faults(one_of(self, tuple(LOAD_KINDS), "the load"))
        kind = self.traits
        wrong = self.key_faults(f"the {self.kind}")
        if kind.any_of and all(getattr(self, key) is None for key in kind.any_of):
            wrong.append(("", f"{kind.words} has neither {' nor '.join(kind.any_of)}.", f"Add {kind.any_of[0]} = {LINEAR}."))
        for key in ("stiffness", "linear"):
            value = getattr(self, key)
            if key in kind.keys and value is not None and isinstance(value, list) != kind.threefold:
                why = f"{kind.words} has {f'one {key}' if isinstance(value, list) else f'a {key} in x, y and angle'}."
                remedy = "Give one value." if isinstance(value, list) else f"Write {key} = [x, y, angle]."
                wrong.append((key, why, remedy))
        factors = [key for key in FACTORS if getattr(self, key) is not None]
        if isinstance(self.target, DriveDocument) and factors:
            wrong.append(
                (factors[0], f"{factors[0]} beside a target that is a law of motion.", "Give one value as target, or leave it out.")
            )
        if len(factors) > 1:
            wrong.append((factors[1], f"{' and '.join(factors)} at once.", "Keep one of them."))
        ends = getattr(self, self.kind)
        if kind.between and isinstance(ends, list) and ends[0] == ends[1]:
            wrong.append((self.kind, f"acts between '{ends[0]}' and itself.", "Name two different ones."))
        raise_faults(wrong)
        return self

    def remedy_for(self, key: str) -> str:
        """Remedy for a key that does not go with the kind."""
        return "Write linear = ..." if key == "coefficient" and "linear" in self.traits.keys else super().remedy_for(key)


def check_loads(reading: Reading) -> Iterator[Fault]:
    """Every fault of references in the loads that could be read."""
    for name, load in reading.document.loads.items():
        path = f"loads.{name}"
        yield from check_prescribed(reading, load, path)
        for kind in load.kinds:
            if (check := LOAD_KINDS[kind].check) is not None:
                yield from check(reading, f"{path}.{kind}", getattr(load, kind))
        yield from known_drive(reading, f"{path}.drive", load.drive)
        yield from check_factor(reading, load, path)


def load_specs(name: str, load: LoadDocument, reading: Reading, convert: Converter, leader: str | None = None) -> tuple[Load, ...]:
    """The core's load, or the loads of which it consists; none where a name that it refers to does not exist (which `check_loads`
    reports), or a part of it is faulty. ``leader``: the first joint whose drive moves, if known; factors that name no joint depend
    on it."""
    made: list[tuple[Load, ...]] = []
    for kind in load.kinds:
        try:
            spec = LOAD_KINDS[kind].make(LoadMaker(name, load, reading, convert, leader))
            made.append(spec if isinstance(spec, tuple) else () if spec is None else (spec,))
        except (AssertionError, ArithmeticError, IndexError, TypeError, ValueError):
            if not reading.faults:
                raise
            return ()  # caused by a part that could not be read, whose fault is noted already
    return made[0] if len(made) == 1 else ()
