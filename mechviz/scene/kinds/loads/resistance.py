"""Resistance: of a medium against points and links, of oil in joints; and what keeps belts tight."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

from mechcore.errors import Fault
from mechcore.spec.loads import BeltTension, Drag, Load, Viscous
from mechcore.texts import as_force
from mechviz.scene.fields import Force as ForceValue
from mechviz.scene.fields import (
    Table,
    Text,
)
from mechviz.scene.kinds.loads.base import LINEAR, LoadKind, LoadMaker, NotNegative
from mechviz.scene.names import Reference, known_place, link_names, split_point

if TYPE_CHECKING:
    from mechviz.scene.reading.recovery import Reading


MovingJoint = Annotated[Text, Reference("joint", what="joint that moves", fits=lambda joint: bool(joint.traits.viscous))]
BeltName = Annotated[Text, Reference("joint", ("belt", "chain"), "belt or chain")]


class ResistanceKeys(Table):
    """The keywords of these loads, and the keys that only they have."""

    drag: Text | None = None
    """Resistance of a medium: "link.point" against the velocity of the point, "link" against the rotation of the link."""
    viscous: MovingJoint | None = None
    """The joint, of any kind that moves, in which viscous friction acts."""
    belt_tension: BeltName | None = None
    """The belt or chain that a tensioner keeps tight."""
    slack: ForceValue | None = None
    """Belt tension: what the slack span pulls."""
    coefficient: NotNegative | None = None
    """Belt tension: coefficient of friction between belt and pulleys; an event tells where it slips. Default: it cannot."""


def _drag(m: LoadMaker) -> Load | None:
    assert m.load.drag is not None
    point = split_point(m.reading, m.load.drag)
    turning = m.load.drag in m.document.links
    if point is None and not turning:
        return None
    sort = "torsional damping" if turning else "damping"
    values: dict[str, Any] = {"linear": m.si("linear", sort), "quadratic": m.si("quadratic", f"quadratic {sort}")}
    m.not_nothing(values)
    if turning:
        return Drag(**m.common, link=m.load.drag, **values)
    assert point is not None
    return Drag(**m.common, link=point[0], point=point[1], **values)


def _viscous(m: LoadMaker) -> Load | None:
    assert m.load.viscous is not None
    joint = m.document.joints.get(m.load.viscous)
    if joint is None:
        return None
    sort = "torsional damping" if joint.kind in ("revolute", "rolling", "gear", "rack") else "damping"
    return Viscous(**m.common, joint=m.load.viscous, coefficient=m.si("linear", sort))


def _belt_tension(m: LoadMaker) -> Load | None:
    assert m.load.belt_tension is not None
    slack, coefficient = m.si("slack", "force"), m.load.coefficient or 0.0
    if slack < 0.0:
        m.convert.note(f"{m.path}.slack", f"{as_force(slack)} is negative: belts only pull.", "Give a positive force.")
    joint = m.document.joints.get(m.load.belt_tension)
    if coefficient and joint is not None and joint.kind == "chain":
        m.convert.note(f"{m.path}.coefficient", "a chain does not slip on its sprockets.", "Leave it out.")
    return BeltTension(**m.common, joint=m.load.belt_tension, slack=slack, coefficient=coefficient)


def _check_drag(reading: Reading, path: str, name: str) -> Iterator[Fault]:
    if name not in link_names(reading):
        yield from known_place(reading, path, name, links=True)
    if name == reading.document.frame:
        yield Fault(path, f"'{name}' is the fixed link: it does not move.", "Name a moving link.")


RESISTANCES = {
    "drag": LoadKind(
        words="drag",
        example='{ drag = "pendulum.P", quadratic = "0.02 N s^2/m^2" }',
        make=_drag,
        check=_check_drag,
        keys=("linear", "quadratic"),
        some=("linear", "quadratic"),
        synonyms=("air",),
    ),
    "viscous": LoadKind(
        words="viscous friction",
        example='{ viscous = "A", linear = "0.1 N m s/rad" }',
        make=_viscous,
        keys=("linear",),
        needs={"linear": LINEAR},
        synonyms=("friction",),
    ),
    "belt_tension": LoadKind(
        words="the tension of a belt",
        example='{ belt_tension = "B", slack = "200 N", coefficient = 0.3 }',
        make=_belt_tension,
        keys=("slack", "coefficient"),
        needs={"slack": '"200 N", what the slack span pulls'},
        synonyms=("tension",),
    ),
}
"""The kinds of loads that resist, and the tension of belts."""
