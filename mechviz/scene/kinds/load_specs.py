"""Loads of a scene document -> loads of the core, in SI units and radians."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from mechcore.laws.indicator import Compressor, Cycle, Diagram, FourStroke, FourStrokeDiagram
from mechcore.laws.signals import SignalPosition
from mechcore.laws.timed import ConstantSpeed, Law, Smoothness, Table
from mechcore.spec.loads import (
    Actuator,
    BeltTension,
    Bushing,
    BushingDamper,
    ConstantPower,
    Damper,
    DcMotor,
    Drag,
    Factor,
    Force,
    GasPressure,
    GasSpring,
    Governor,
    InductionMotor,
    Load,
    Polynomial,
    Servo,
    Spring,
    Torque,
    TorsionDamper,
    TorsionSpring,
    Viscous,
)
from mechcore.texts import as_force, as_length, as_torque
from mechviz.scene.convert import LARGEST, Converter
from mechviz.scene.document import SceneDocument
from mechviz.scene.kinds.drive_laws import law_of
from mechviz.scene.kinds.drives import DriveDocument
from mechviz.scene.kinds.loads import LoadDocument
from mechviz.scene.kinds.signals import SIGNALS, FactorPolynomial, FactorTable, signal_of
from mechviz.scene.recovery import Reading
from mechviz.scene.references import split_point
from mechviz.scene.spelling import likely_sort

_ARGUMENT_KINDS = {
    "time": "time",
    "x": "length",
    "y": "length",
    "vx": "linear speed",
    "vy": "linear speed",
    "speed": "linear speed",
}
_RATES = {"angle": "angular speed", "length": "linear speed"}


def load_specs(name: str, load: LoadDocument, reading: Reading, convert: Converter, lead: str | None = None) -> tuple[Load, ...]:
    """The load, or the loads that it is made of; none where a name that it refers to is not there (which `check_loads` says), or a
    part of it is faulty. ``lead``: the first pair whose drive moves, if it is known; factors depend on it that name none."""
    made: list[tuple[Load, ...]] = []
    for kind in load.kinds:
        try:
            found = _MAKERS[kind](_Maker(name, load, reading, convert, lead))
            made.append(found if isinstance(found, tuple) else () if found is None else (found,))
        except (AssertionError, ArithmeticError, IndexError, TypeError, ValueError):
            if not reading.faults:
                raise
            return ()  # what fails here fails by a part that could not be read, which is noted already
    return made[0] if len(made) == 1 else ()


class _Maker:
    """What every kind needs to become a load of the core."""

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

    # -- forces and torques -------------------------------------------------------------------------------------------
    def force(self) -> Load | None:
        load = self.load
        assert load.force is not None
        factor = self.factor()
        vector = self.convert.vector(load.force, "force", f"{self.path}.force")
        point = load.at
        if load.on is None:  # noted where the load was read
            return None
        if point is None:
            link = self.document.links.get(load.on)
            point = next(iter(link.points), "") if link is not None else ""
        return Force(**self.common, link=load.on, point=point, vector=vector, axes=load.axes, factor=factor, against=load.against)

    def torque(self) -> Load | None:
        factor, moment = self.factor(), self.si("torque", "torque")
        if self.load.on is None:  # noted where the load was read
            return None
        return Torque(**self.common, link=self.load.on, moment=moment, factor=factor, against=self.load.against)

    def actuator(self) -> Load | None:
        on = self.load.actuator
        assert on is not None
        place: dict[str, Any] | None = {"pair": on} if isinstance(on, str) else self.ends(on)
        factor, force = self.factor(), self.si("thrust", "force")
        return None if place is None else Actuator(**self.common, **place, force=force, factor=factor)

    def factor(self) -> Factor | None:
        """The factor of a load, None where there is none or a fault was noted."""
        for key in SIGNALS:
            if (signal := getattr(self.load, key)) is not None:
                found = signal_of(key, signal, self.convert, f"{self.path}.{key}")
                return None if found is None else Factor(function=found, of="time")
        given: FactorTable | FactorPolynomial | None = self.load.table or self.load.polynomial
        if given is None:
            return None
        pair = given.pair or given.drive
        point = None if given.point is None else split_point(self.reading, given.point)
        kind = self.argument_kind(given.of, pair) or self.likely_kind(given)
        if isinstance(given, FactorTable):
            function: Table | Polynomial | None = self.table(given, kind)
        else:
            path = f"{self.path}.polynomial"
            per = self.convert.si(1.0 if given.per is None else given.per, kind, f"{path}.per")
            function = (
                Polynomial(tuple(given.coefficients), per=per)
                if self.moderate(given.coefficients, f"{path}.coefficients")
                else None
            )
        if function is None or (given.point is not None and point is None):
            return None
        return Factor(function=function, of=given.of, pair=pair, point=point)  # type: ignore[arg-type] # one of ARGUMENTS

    def argument_kind(self, of: str, pair: str | None) -> str | None:
        """The kind of quantity that a factor depends on; None where its pair is not there."""
        if of in _ARGUMENT_KINDS:
            return _ARGUMENT_KINDS[of]
        first = self.lead or next((name for name, p in self.document.joints.items() if p.led), None)
        found = self.document.joints.get(pair or first or "")
        if found is None or len(found.kinds) > 1:
            return None
        sort = "length" if found.kind in ("prismatic", "pin_slot", "rolling", "cylinder") else "angle"
        return sort if of == "position" else _RATES[sort]

    def likely_kind(self, given: FactorTable | FactorPolynomial) -> str:
        """The kind where the pair is not known: that of the values as they are written."""
        sort = likely_sort(given)
        return sort if given.of == "position" else _RATES.get(sort, "time")

    def moderate(self, values: list[float], path: str) -> bool:
        """Notes the first number that is beyond all measure."""
        for k, value in enumerate(values):
            if abs(value) > LARGEST:
                self.convert.note(f"{path}[{k}]", f"{value:g} is beyond {LARGEST:g}.", "Check the number.")
                return False
        return True

    def table(self, given: FactorTable, kind: str) -> Table | None:
        convert, path = self.convert, f"{self.path}.table"
        x, y = convert.row(getattr(given, given.of) or (), kind, f"{path}.{given.of}"), tuple(given.factor)
        moderate, increasing = self.moderate(given.factor, f"{path}.factor"), convert.increasing(x, f"{path}.{given.of}")
        period = None if given.period is None else convert.si(given.period, kind, f"{path}.period")
        if not increasing or not given.sound(given.of) or not x:
            return None
        span = x[-1] - x[0]
        if period is not None and span > period * (1.0 + 1e-12) and convert.certain(kind):
            why = f"is shorter than the range of the {given.of}s."
            convert.note(f"{path}.period", why, "Give a longer period, or fewer rows.")
            return None
        if not moderate or len(x) != len(y) or any(map(math.isnan, (*y, period or 0.0))):
            return None
        if period is not None and math.isclose(span, period, rel_tol=1e-12):  # the closing row is a repetition of the first one
            if y[-1] != y[0]:
                convert.note(
                    f"{path}.factor[{len(y) - 1}]",
                    f"differs from the first factor, {y[0]:g}, one period before.",
                    "Give both the same factor, or leave out the last row.",
                )
                return None
            x, y = x[:-1], y[:-1]
        return self.spline(x, y, f"{path}.{given.of}", period, given.smooth)

    def spline(
        self, x: tuple[float, ...], y: tuple[float, ...], path: str, period: float | None = None, smooth: Smoothness = True
    ) -> Table | None:
        """A table as a function; None, and a fault, where its rows are so close that nothing smooth goes through them."""
        try:
            return Table(x=x, y=y, period=period, smooth=smooth)
        except ValueError:
            self.convert.note(path, "the rows are too close to each other.", "Leave out some of them.")
            return None

    # -- between two points -------------------------------------------------------------------------------------------
    def spring(self) -> Load | None:
        assert self.load.spring is not None
        ends = self.ends(self.load.spring)
        values: dict[str, Any] = {
            "stiffness": self.si("stiffness", "stiffness"),
            "free_length": self.si("free_length", "length"),
            "preload": self.si("preload", "force"),
            "solid_length": None if self.load.solid_length is None else self.si("solid_length", "length"),
        }
        return None if ends is None else Spring(**self.common, **ends, **values)

    def damper(self) -> Load | None:
        assert self.load.damper is not None
        ends = self.ends(self.load.damper)
        values: dict[str, Any] = {"linear": self.si("linear", "damping"), "quadratic": self.si("quadratic", "quadratic damping")}
        self.not_nothing(values)
        return None if ends is None else Damper(**self.common, **ends, **values)

    def gas_spring(self) -> Load | None:
        assert self.load.gas_spring is not None
        ends = self.ends(self.load.gas_spring)
        values: dict[str, Any] = {
            "force": self.si("thrust", "force"),
            "extended": self.si("extended", "length"),
            "gas_length": self.si("gas_length", "length"),
            "exponent": 1.0 if self.load.exponent is None else self.load.exponent,
        }
        return None if ends is None else GasSpring(**self.common, **ends, **values)

    # -- by angles and velocities -------------------------------------------------------------------------------------
    def torsion_spring(self) -> Load | None:
        assert self.load.torsion_spring is not None
        first, second = self.load.torsion_spring
        stiffness, free = self.si("stiffness", "torsional stiffness"), self.si("free_angle", "angle")
        return TorsionSpring(**self.common, links=(first, second), stiffness=stiffness, free_angle=free)

    def torsion_damper(self) -> Load | None:
        assert self.load.torsion_damper is not None
        first, second = self.load.torsion_damper
        return TorsionDamper(**self.common, links=(first, second), coefficient=self.si("linear", "torsional damping"))

    def three(self, key: str, kind: str = "stiffness") -> tuple[float, float, float] | None:
        """Values of the load in x, y and angle, zero where they are left out; None where one value is given for all."""
        given = getattr(self.load, key)
        if given is not None and not isinstance(given, list):
            return None
        kinds = (kind, kind, f"torsional {kind}")
        x, y, angle = (
            self.convert.si(value, of, f"{self.path}.{key}[{k}]")
            for k, (value, of) in enumerate(zip(given or [0.0] * 3, kinds, strict=True))
        )
        return x, y, angle

    def bushing(self) -> tuple[Load, ...]:
        load = self.load
        assert load.bushing is not None
        ends, free = self.ends(load.bushing), self.si("free_angle", "angle")
        stiffness, damping = self.three("stiffness"), self.three("linear", "damping")
        if ends is None or stiffness is None or damping is None:
            return ()
        if not any((*stiffness, *damping)):
            self.convert.note(f"{self.path}.stiffness", "all values are zero: it does nothing.", "Give one of them a value.")
        springs = Bushing(**self.common, **ends, stiffness=stiffness, free_angle=free)
        if not any(damping):
            return (springs,)
        return springs, BushingDamper(**self.common | {"name": f"{self.name} damping"}, **ends, damping=damping)

    def drag(self) -> Load | None:
        assert self.load.drag is not None
        point = split_point(self.reading, self.load.drag)
        turning = self.load.drag in self.document.links
        if point is None and not turning:
            return None
        sort = "torsional damping" if turning else "damping"
        values: dict[str, Any] = {"linear": self.si("linear", sort), "quadratic": self.si("quadratic", f"quadratic {sort}")}
        self.not_nothing(values)
        if turning:
            return Drag(**self.common, link=self.load.drag, **values)
        assert point is not None
        return Drag(**self.common, link=point[0], point=point[1], **values)

    def viscous(self) -> Load | None:
        assert self.load.viscous is not None
        pair = self.document.joints.get(self.load.viscous)
        if pair is None:
            return None
        sort = "torsional damping" if pair.kind in ("revolute", "rolling", "gear", "rack") else "damping"
        return Viscous(**self.common, pair=self.load.viscous, coefficient=self.si("linear", sort))

    def belt_tension(self) -> Load | None:
        assert self.load.belt_tension is not None
        slack, coefficient = self.si("slack", "force"), self.load.coefficient or 0.0
        if slack < 0.0:
            self.convert.note(f"{self.path}.slack", f"{as_force(slack)} is negative: belts only pull.", "Give a positive force.")
        pair = self.document.joints.get(self.load.belt_tension)
        if coefficient and pair is not None and pair.kind == "chain":
            self.convert.note(f"{self.path}.coefficient", "a chain does not slip on its sprockets.", "Leave it out.")
        return BeltTension(**self.common, pair=self.load.belt_tension, slack=slack, coefficient=coefficient)

    def not_nothing(self, values: dict[str, float]) -> None:
        given = self.load.linear is not None or self.load.quadratic is not None
        if given and all(value == 0.0 for value in values.values()):
            self.convert.note(
                self.path, "its coefficients are zero: it does nothing.", "Give one of them a value, or leave it out."
            )

    # -- machines by their characteristic -----------------------------------------------------------------------------
    def driven(self, name: str) -> dict[str, Any]:
        """The pair or the link that a machine drives."""
        return {"pair": name} if name in self.document.joints else {"link": name}

    def not_zero(self, **values: float) -> None:
        for key, value in values.items():
            if value == 0.0:
                self.convert.note(f"{self.path}.{key}", "is zero.", "Give a value; its sign is the direction.")

    def dc_motor(self) -> Load | None:
        assert self.load.dc_motor is not None
        stall, speed = self.si("stall_torque", "torque"), self.si("no_load_speed", "angular speed")
        if self.load.stall_torque is not None and self.load.no_load_speed is not None:
            self.not_zero(stall_torque=stall, no_load_speed=speed)
            if stall * speed < 0.0:
                why = "stall torque and no-load speed point in opposite directions."
                self.convert.note(f"{self.path}.no_load_speed", why, "Give both the same sign.")
        return DcMotor(**self.common, **self.driven(self.load.dc_motor), stall_torque=stall, no_load_speed=speed)

    def induction_motor(self) -> Load | None:
        assert self.load.induction_motor is not None
        torque, speed = self.si("breakdown_torque", "torque"), self.si("synchronous_speed", "angular speed")
        if self.load.breakdown_torque is not None and torque <= 0.0:
            why = f"{as_torque(torque)} is not positive."
            self.convert.note(f"{self.path}.breakdown_torque", why, "The sign of the synchronous speed is the direction.")
        if self.load.synchronous_speed is not None:
            self.not_zero(synchronous_speed=speed)
        return InductionMotor(
            **self.common,
            **self.driven(self.load.induction_motor),
            breakdown_torque=torque,
            breakdown_slip=self.load.breakdown_slip or math.nan,
            synchronous_speed=speed,
        )

    def constant_power(self) -> Load | None:
        assert self.load.constant_power is not None
        power, limit = self.si("power", "power"), self.si("torque_limit", "torque")
        if self.load.torque_limit is not None:
            self.not_zero(torque_limit=limit)
        return ConstantPower(**self.common, **self.driven(self.load.constant_power), power=power, torque_limit=limit)

    def governor(self) -> Load | None:
        assert self.load.governor is not None
        least, most = self.convert.row(self.load.limits or (math.nan, math.nan), "torque", f"{self.path}.limits")
        if least >= most:
            why = f"{as_torque(least)} is no less than {as_torque(most)}."
            self.convert.note(f"{self.path}.limits", why, "Write [least, greatest].")
        return Governor(
            **self.common,
            **self.driven(self.load.governor),
            set_speed=self.si("set_speed", "angular speed"),
            gain=self.si("gain", "torsional damping"),
            least=least,
            most=most,
        )

    def servo(self) -> Load | None:
        load = self.load
        assert load.servo is not None
        pair = self.document.joints.get(load.servo)
        if pair is None or len(pair.kinds) > 1:
            return None
        torsional = "torsional " if pair.coordinate == "angle" else ""
        gains: dict[str, Any] = {
            "proportional": self.si("proportional", f"{torsional}stiffness"),
            "derivative": self.si("derivative", f"{torsional}damping"),
            "integral": self.si("integral", f"{torsional}integral gain"),
        }
        if load.proportional is not None and not any(gains.values()):
            self.convert.note(f"{self.path}.proportional", "all gains are zero: it does nothing.", "Give one of them a value.")
        target = self.target(pair.coordinate)
        return None if target is None else Servo(**self.common, pair=load.servo, target=target, **gains)

    def target(self, sort: str) -> Law | None:
        """The law that a servo follows, None where a fault was noted."""
        given, path = self.load.target, f"{self.path}.target"
        if given is None or isinstance(given, DriveDocument):
            return None if given is None else law_of(given, sort, self.convert, path)
        value = self.convert.si(given, sort, path)
        key = next((key for key in SIGNALS if getattr(self.load, key) is not None), None)
        if key is None:
            return ConstantSpeed(start=value, speed=0.0)
        signal = signal_of(key, getattr(self.load, key), self.convert, f"{self.path}.{key}")
        return None if signal is None else SignalPosition(value, signal)

    # -- gas ----------------------------------------------------------------------------------------------------------
    def gas(self) -> Load | None:
        load = self.load
        assert load.gas is not None
        bore, stroke = self.si("bore", "length"), self.si("stroke", "length")
        cycle = self.cycle(stroke)
        if cycle is None:
            return None
        return GasPressure(
            **self.common,
            pair=load.gas,
            area=0.25 * math.pi * bore**2,
            cycle=cycle,
            top=self.si("top", "length"),
            head=load.head or "ahead",
            back=self.si("back", "pressure", 101325.0),
            drive=load.drive,
            fires=self.si("fires", "angle"),
        )

    def pressure(self, value: float | str, path: str) -> float:
        return self.convert.si(value, "pressure", f"{self.path}.{path}")

    def cycle(self, stroke: float) -> Cycle | None:
        c, f = self.load.compressor, self.load.four_stroke
        if c is not None:
            suction, delivery = self.pressure(c.suction, "compressor.suction"), self.pressure(c.delivery, "compressor.delivery")
            made = Compressor(stroke=stroke, suction=suction, delivery=delivery, exponent=c.exponent, clearance=c.clearance)
            if delivery <= suction:
                self.convert.note(
                    f"{self.path}.compressor.delivery",
                    f"{delivery:g} Pa is no more than the suction pressure, {suction:g} Pa.",
                    "Give absolute pressures, the delivery the higher one.",
                )
            elif c.clearance * (delivery / suction) ** (1.0 / c.exponent) >= 1.0 + c.clearance:
                why = f"{c.clearance:g} is so much that the re-expanding gas fills the cylinder: nothing is sucked in."
                self.convert.note(f"{self.path}.compressor.clearance", why, "Give less clearance, or a lower delivery pressure.")
            return made
        if f is not None:
            intake, exhaust = self.pressure(f.intake, "four_stroke.intake"), self.pressure(f.exhaust, "four_stroke.exhaust")
            exponents = {"exponent": f.exponent} if f.expansion is None else {"exponent": f.exponent, "expansion": f.expansion}
            for key, value in exponents.items():
                if value * math.log10(f.ratio) > 12.0:  # 1e12 times the intake's pressure: powers overflow from 1e308 on
                    why = f"{value:g} lets the pressure rise more than 1e12 times over the compression ratio, {f.ratio:g}."
                    hint = "Polytropic exponents of gases lie between 1 and 2, compression ratios below 30."
                    self.convert.note(f"{self.path}.four_stroke.{key}", why, hint)
                    return None
            return FourStroke(
                stroke=stroke,
                intake=intake,
                exhaust=exhaust,
                ratio=f.ratio,
                exponent=f.exponent,
                expansion=f.expansion,
                rise=f.rise,
                cutoff=f.cutoff,
            )
        return self.diagram(stroke)

    def diagram(self, stroke: float) -> Cycle | None:
        given = self.load.diagram
        assert given is not None
        convert, path = self.convert, f"{self.path}.diagram"
        x = convert.row(given.displacement, "length", f"{path}.displacement")
        if not convert.increasing(x, f"{path}.displacement"):
            return None
        if abs(x[0]) > 1e-9 * stroke or abs(x[-1] - stroke) > 1e-6 * stroke:
            why = f"runs from {as_length(x[0])} to {as_length(x[-1])}; the stroke is {as_length(stroke)}."
            convert.note(f"{path}.displacement", why, "Let it run from 0 (top dead centre) to the stroke.")
            return None
        branches: dict[str, Any] = {}
        for key in given.branches:
            y = convert.row(getattr(given, key), "pressure", f"{path}.{key}")
            whole = len(y) == len(x) and not any(map(math.isnan, y))
            branches[key] = None if not whole else self.spline(x, y, f"{path}.displacement", smooth=False)
        if any(branch is None for branch in branches.values()):
            return None
        return Diagram(stroke=stroke, **branches) if "outward" in branches else FourStrokeDiagram(stroke=stroke, **branches)


_MAKERS: dict[str, Callable[[_Maker], Load | tuple[Load, ...] | None]] = {
    "force": _Maker.force,
    "torque": _Maker.torque,
    "actuator": _Maker.actuator,
    "spring": _Maker.spring,
    "damper": _Maker.damper,
    "gas_spring": _Maker.gas_spring,
    "torsion_spring": _Maker.torsion_spring,
    "torsion_damper": _Maker.torsion_damper,
    "bushing": _Maker.bushing,
    "drag": _Maker.drag,
    "viscous": _Maker.viscous,
    "belt_tension": _Maker.belt_tension,
    "gas": _Maker.gas,
    "dc_motor": _Maker.dc_motor,
    "induction_motor": _Maker.induction_motor,
    "constant_power": _Maker.constant_power,
    "governor": _Maker.governor,
    "servo": _Maker.servo,
}
