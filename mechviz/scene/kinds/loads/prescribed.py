"""Prescribed loads: forces, torques and actuators, and the factors of time or motion that multiply them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Discriminator, Tag

from mechcore.errors import Fault
from mechcore.laws.timed import Table as Interpolation
from mechcore.spec.loads import Actuator, Factor, Force, Load, Polynomial, Torque
from mechviz.scene.convert import LARGEST_VALUE, probable_coordinate
from mechviz.scene.faults import listing
from mechviz.scene.fields import DocumentTable, ForceVector, Text, value_or_list
from mechviz.scene.fields import Torque as TorqueValue
from mechviz.scene.kinds.kind import LoadKind, LoadMaker, different_links
from mechviz.scene.kinds.signals import SIGNALS, FactorPolynomial, FactorTable, signal_of
from mechviz.scene.names import (
    LinkName,
    Reference,
    TwoPoints,
    known_drive,
    known_joint,
    known_place,
    known_point,
    point_names,
    split_point,
)

if TYPE_CHECKING:
    from mechviz.scene.kinds.loads.document import LoadDocument
    from mechviz.scene.reading.recovery import Reading

SlidingJoint = Annotated[Text, Reference("joint", ("prismatic", "pin_slot", "cylinder"), "sliding joint")]
PushedAlong = Annotated[Annotated[SlidingJoint, Tag("<value>")] | Annotated[TwoPoints, Tag("<list>")], Discriminator(value_or_list)]


FACTORS = ("table", "polynomial", *SIGNALS)
"""Keys by which a load is multiplied by a factor: one of them at most."""


class PrescribedKeys(DocumentTable):
    """The keywords of these loads, and the keys that only they have."""

    force: ForceVector | None = None
    """Components [x, y] of a force."""
    torque: TorqueValue | None = None
    """A free moment, counter-clockwise positive."""
    actuator: PushedAlong | None = None
    """The two points that an actuator of constant force pushes apart, or the sliding joint along which it pushes."""
    on: LinkName | None = None
    """Force, torque: the link that it acts on."""
    at: Text | None = None
    """Force: the point of that link where it acts; may be left out where the link has one point only."""
    axes: Literal["world", "link"] = "world"
    """Force: whether the components are fixed in the world or turn with the link."""
    against: LinkName | None = None
    """Force, torque: the link on which the opposite acts at the same point."""


def _force(m: LoadMaker) -> Load | None:
    load = m.load
    assert load.force is not None
    factor = stated_factor(m)
    vector = m.convert.vector(load.force, "force", f"{m.path}.force")
    point = load.at
    if load.on is None:  # noted where the load was read
        return None
    if point is None:
        link = m.document.links.get(load.on)
        point = next(iter(link.points), "") if link is not None else ""
    return Force(**m.common, link=load.on, point=point, vector=vector, axes=load.axes, factor=factor, against=load.against)


def _torque(m: LoadMaker) -> Load | None:
    factor, moment = stated_factor(m), m.si("torque", "torque")
    if m.load.on is None:  # noted where the load was read
        return None
    return Torque(**m.common, link=m.load.on, moment=moment, factor=factor, against=m.load.against)


def _actuator(m: LoadMaker) -> Load | None:
    on = m.load.actuator
    assert on is not None
    place: dict[str, Any] | None = {"joint": on} if isinstance(on, str) else m.ends(on)
    factor, force = stated_factor(m), m.si("thrust", "force")
    return None if place is None else Actuator(**m.common, **place, force=force, factor=factor)


# -- factors ----------------------------------------------------------------------------------------------------------
_ARGUMENT_KINDS = {
    "time": "time",
    "x": "length",
    "y": "length",
    "vx": "linear speed",
    "vy": "linear speed",
    "speed": "linear speed",
}
_RATES = {"angle": "angular speed", "length": "linear speed"}


def stated_factor(m: LoadMaker) -> Factor | None:
    """The factor of a load, None where there is none or a fault was noted."""
    for key in SIGNALS:
        if (signal := getattr(m.load, key)) is not None:
            signal_function = signal_of(key, signal, m.convert, f"{m.path}.{key}")
            return None if signal_function is None else Factor(function=signal_function, of="time")
    given: FactorTable | FactorPolynomial | None = m.load.table or m.load.polynomial
    if given is None:
        return None
    joint = given.joint or given.drive
    point = None if given.point is None else split_point(m.reading, given.point)
    kind = _argument_kind(m, given.of, joint) or _likely_kind(given)
    if isinstance(given, FactorTable):
        function: Interpolation | Polynomial | None = _table(m, given, kind)
    else:
        path = f"{m.path}.polynomial"
        per = m.convert.si(1.0 if given.per is None else given.per, kind, f"{path}.per")
        function = (
            Polynomial(tuple(given.coefficients), per=per) if _moderate(m, given.coefficients, f"{path}.coefficients") else None
        )
    if function is None or (given.point is not None and point is None):
        return None
    return Factor(function=function, of=given.of, joint=joint, point=point)  # type: ignore[arg-type] # one of ARGUMENTS


def _argument_kind(m: LoadMaker, of: str, joint: str | None) -> str | None:
    """The kind of quantity that a factor depends on; None where its joint does not exist or is faulty."""
    if of in _ARGUMENT_KINDS:
        return _ARGUMENT_KINDS[of]
    first = m.leader or next((name for name, p in m.document.joints.items() if p.driven), None)
    known = m.document.joints.get(joint or first or "")
    if known is None or len(known.kinds) > 1:
        return None
    coordinate_kind = known.coordinate
    return coordinate_kind if of == "position" else _RATES[coordinate_kind]


def _likely_kind(given: FactorTable | FactorPolynomial) -> str:
    """The probable kind of the argument where the joint is not known, from the units of the values."""
    coordinate_kind = probable_coordinate(given)
    return coordinate_kind if given.of == "position" else _RATES.get(coordinate_kind, "time")


def _moderate(m: LoadMaker, values: list[float], path: str) -> bool:
    """Whether no number is beyond `LARGEST_VALUE`; the first that is gives a fault."""
    for k, value in enumerate(values):
        if abs(value) > LARGEST_VALUE:
            m.convert.note(f"{path}[{k}]", f"{value:g} is beyond {LARGEST_VALUE:g}.", "Check the number.")
            return False
    return True


def _table(m: LoadMaker, given: FactorTable, kind: str) -> Interpolation | None:
    convert, path = m.convert, f"{m.path}.table"
    x, y = convert.row(getattr(given, given.of) or (), kind, f"{path}.{given.of}"), tuple(given.factor)
    moderate, increasing = _moderate(m, given.factor, f"{path}.factor"), convert.increasing(x, f"{path}.{given.of}")
    period = None if given.period is None else convert.si(given.period, kind, f"{path}.period")
    if not increasing or not given.has_valid(given.of) or not x:
        return None
    span = x[-1] - x[0]
    if period is not None and span > period * (1.0 + 1e-12) and convert.has_known_unit(kind):
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
    return m.spline(x, y, f"{path}.{given.of}", period, given.smooth)


def check_factor(reading: Reading, load: LoadDocument, path: str) -> Iterator[Fault]:
    """Faults of the names that a load's factor refers to."""
    for key in ("table", "polynomial"):
        given = getattr(load, key)
        if given is not None:
            yield from known_drive(reading, f"{path}.{key}.drive", given.drive)
            yield from known_joint(reading, f"{path}.{key}.joint", given.joint)
            if given.point is not None:
                yield from known_place(reading, f"{path}.{key}.point", given.point)


def check_prescribed(reading: Reading, load: LoadDocument, path: str) -> Iterator[Fault]:
    """Faults of the link, the point and the opposite link of forces and torques."""
    if load.on is None:
        return
    if load.on == reading.document.frame:
        yield Fault(f"{path}.on", f"'{load.on}' is the fixed link: a load on it moves nothing.", "Name a moving link.")
    elif load.at is not None:
        yield from known_point(reading, f"{path}.at", load.on, load.at)
    elif load.kinds == ["force"]:
        points = point_names(reading, load.on) or []
        if len(points) > 1:
            why = "'at' is missing: where on the link does the force act?"
            yield Fault(path, why, f"Points of '{load.on}': {listing(points)}.")
    if load.against is not None and load.against == load.on:
        yield Fault(f"{path}.against", f"'{load.on}' acts against itself.", "Name another link.")


PRESCRIBED = {
    "force": LoadKind(
        words="a force",
        example='{ force = [0, "-200 N"], on = "rocker", at = "C" }',
        make=_force,
        keys=("on", "at", "axes", "against", *FACTORS),
        needs={"on": '"the link"'},
    ),
    "torque": LoadKind(
        words="a torque, which acts on the whole link",
        example='{ torque = "-5 N m", on = "rocker" }',
        make=_torque,
        keys=("on", "against", *FACTORS),
        needs={"on": '"the link"'},
        synonyms=("moment",),
    ),
    "actuator": LoadKind(
        words="an actuator",
        example='{ actuator = ["frame.P", "boom.Q"], thrust = "400 N" }',
        make=_actuator,
        check=different_links,
        between=True,
        keys=("thrust", *FACTORS),
        needs={"thrust": '"400 N", with which it pushes'},
    ),
}
"""Kinds of prescribed loads."""
