"""Forces and torques that are told: on a link, or between two points by an actuator."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Discriminator, Tag

from mechcore.errors import Fault
from mechcore.spec.loads import Actuator, Force, Load, Torque
from mechviz.scene.faults import listing
from mechviz.scene.fields import ForceVector, Table, Text, value_or_list
from mechviz.scene.fields import Torque as TorqueValue
from mechviz.scene.kinds.loads.base import LoadKind, LoadMaker, different_links
from mechviz.scene.kinds.loads.factors import FACTORS, factor_of
from mechviz.scene.names import LinkName, Reference, TwoPoints, known_point, point_names

if TYPE_CHECKING:
    from mechviz.scene.kinds.loads.document import LoadDocument
    from mechviz.scene.reading.recovery import Reading


SlidingJoint = Annotated[Text, Reference("joint", ("prismatic", "pin_slot", "cylinder"), "sliding joint")]
PushedAlong = Annotated[Annotated[SlidingJoint, Tag("<value>")] | Annotated[TwoPoints, Tag("<list>")], Discriminator(value_or_list)]


class PrescribedKeys(Table):
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
    factor = factor_of(m)
    vector = m.convert.vector(load.force, "force", f"{m.path}.force")
    point = load.at
    if load.on is None:  # noted where the load was read
        return None
    if point is None:
        link = m.document.links.get(load.on)
        point = next(iter(link.points), "") if link is not None else ""
    return Force(**m.common, link=load.on, point=point, vector=vector, axes=load.axes, factor=factor, against=load.against)


def _torque(m: LoadMaker) -> Load | None:
    factor, moment = factor_of(m), m.si("torque", "torque")
    if m.load.on is None:  # noted where the load was read
        return None
    return Torque(**m.common, link=m.load.on, moment=moment, factor=factor, against=m.load.against)


def _actuator(m: LoadMaker) -> Load | None:
    on = m.load.actuator
    assert on is not None
    place: dict[str, Any] | None = {"joint": on} if isinstance(on, str) else m.ends(on)
    factor, force = factor_of(m), m.si("thrust", "force")
    return None if place is None else Actuator(**m.common, **place, force=force, factor=factor)


def check_prescribed(reading: Reading, load: LoadDocument, path: str) -> Iterator[Fault]:
    """Forces and torques: link, point and the link that they act against."""
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
"""The kinds of loads that are told."""
