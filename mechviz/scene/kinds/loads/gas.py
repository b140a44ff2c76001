"""Gas pressure on a piston: cycles of compressors and engines, and measured diagrams."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from mechcore.laws.indicator import Compressor, Cycle, FourStroke, FourStrokeDiagram, IndicatorDiagram
from mechcore.spec.loads import GasPressure, Load
from mechcore.texts import as_length
from mechviz.scene.fields import (
    Coordinate,
    DocumentTable,
    Length,
    Pressure,
    Size,
    Text,
    raise_faults,
)
from mechviz.scene.kinds.kind import AtLeastOne, LoadKind, LoadMaker, NotNegative, Positive
from mechviz.scene.names import Reference


class CompressorDocument(DocumentTable):
    """The cycle of a compressor with clearance: compression, delivery, re-expansion, suction."""

    suction: Pressure
    """Absolute pressure of suction."""
    delivery: Pressure
    """Absolute pressure of delivery."""
    exponent: AtLeastOne = 1.3
    """Polytropic exponent of compression and re-expansion."""
    clearance: NotNegative = 0.05
    """Volume at top dead centre over the swept volume."""


class FourStrokeDocument(DocumentTable):
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
            raise_faults([("ratio", f"{self.ratio:g} is no greater than the cutoff, {self.cutoff:g}.", hint)])
        return self


class DiagramDocument(DocumentTable):
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
        wrong = []
        if self.branches not in (("outward", "inward"), ("power", "exhaust", "intake", "compression")):
            hint = "Give outward and inward (two strokes), or power, exhaust, intake and compression (four strokes)."
            wrong.append(("", f"the diagram has {', '.join(self.branches) or 'no branch'}.", hint))
        n = len(self.displacement)
        for key in self.branches:
            if self.has_valid(key, "displacement") and len(getattr(self, key)) != n:
                wrong.append((key, f"{len(getattr(self, key))} pressures and {n} displacements.", "Give one pressure for each."))
        raise_faults(wrong)
        return self


PistonName = Annotated[Text, Reference("joint", ("prismatic", "cylinder"), "sliding joint")]


class GasKeys(DocumentTable):
    """The keyword of gas pressure, and the keys that only it has."""

    gas: PistonName | None = None
    """The sliding joint of the piston on which a gas presses, by an indicator diagram."""
    bore: Size | None = None
    """Gas: diameter of the piston."""
    top: Length | None = None
    """Gas: coordinate of the joint at top dead centre."""
    stroke: Size | None = None
    """Gas: distance of the dead centres."""
    head: Literal["ahead", "behind"] | None = None
    """Gas: the cylinder's head lies ahead of the piston in the direction of the joint (default), or behind it."""
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
    """Gas, four strokes: the driven joint of the crank. Default: the first one."""


def _gas(m: LoadMaker) -> Load | None:
    load = m.load
    assert load.gas is not None
    bore, stroke = m.si("bore", "length"), m.si("stroke", "length")
    cycle = _cycle(m, stroke)
    if cycle is None:
        return None
    return GasPressure(
        **m.common,
        joint=load.gas,
        area=0.25 * math.pi * bore**2,
        cycle=cycle,
        top=m.si("top", "length"),
        head=load.head or "ahead",
        back=m.si("back", "pressure", 101325.0),
        drive=load.drive,
        fires=m.si("fires", "angle"),
    )


def _pressure(m: LoadMaker, value: float | str, path: str) -> float:
    return m.convert.si(value, "pressure", f"{m.path}.{path}")


def _cycle(m: LoadMaker, stroke: float) -> Cycle | None:
    c, f = m.load.compressor, m.load.four_stroke
    if c is not None:
        suction, delivery = _pressure(m, c.suction, "compressor.suction"), _pressure(m, c.delivery, "compressor.delivery")
        made = Compressor(stroke=stroke, suction=suction, delivery=delivery, exponent=c.exponent, clearance=c.clearance)
        if delivery <= suction:
            m.convert.note(
                f"{m.path}.compressor.delivery",
                f"{delivery:g} Pa is no more than the suction pressure, {suction:g} Pa.",
                "Give absolute pressures, the delivery the higher one.",
            )
        elif c.clearance * (delivery / suction) ** (1.0 / c.exponent) >= 1.0 + c.clearance:
            why = f"{c.clearance:g} is so much that the re-expanding gas fills the cylinder: nothing is sucked in."
            m.convert.note(f"{m.path}.compressor.clearance", why, "Give less clearance, or a lower delivery pressure.")
        return made
    if f is not None:
        intake, exhaust = _pressure(m, f.intake, "four_stroke.intake"), _pressure(m, f.exhaust, "four_stroke.exhaust")
        exponents = {"exponent": f.exponent} if f.expansion is None else {"exponent": f.exponent, "expansion": f.expansion}
        for key, value in exponents.items():
            if value * math.log10(f.ratio) > 12.0:  # 1e12 times the intake's pressure: powers overflow from 1e308 on
                why = f"{value:g} lets the pressure rise more than 1e12 times over the compression ratio, {f.ratio:g}."
                hint = "Polytropic exponents of gases lie between 1 and 2, compression ratios below 30."
                m.convert.note(f"{m.path}.four_stroke.{key}", why, hint)
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
    return _diagram(m, stroke)


def _diagram(m: LoadMaker, stroke: float) -> Cycle | None:
    given = m.load.diagram
    assert given is not None
    convert, path = m.convert, f"{m.path}.diagram"
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
        branches[key] = None if not whole else m.spline(x, y, f"{path}.displacement", smooth=False)
    if any(branch is None for branch in branches.values()):
        return None
    return IndicatorDiagram(stroke=stroke, **branches) if "outward" in branches else FourStrokeDiagram(stroke=stroke, **branches)


_CYCLES = ("compressor", "four_stroke", "diagram")

GAS = {
    "gas": LoadKind(
        words="gas pressure",
        example='{ gas = "S", bore = "8 cm", top = 0.2, stroke = "80 mm", compressor = { suction = "1 bar", delivery = "6 bar" } }',
        make=_gas,
        keys=("bore", "top", "stroke", "head", "back", *_CYCLES, "fires", "drive"),
        needs={"bore": '"80 mm"', "top": "the joint's coordinate at top dead centre", "stroke": '"80 mm"'},
        one_of=_CYCLES,
        synonyms=("pressure",),
    ),
}
"""The kind of load of gases."""
