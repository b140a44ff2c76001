"""Springs, dampers and bushings; drag of a medium on points and links, viscous friction in joints; tension of belts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated, Any

from mechcore.errors import Fault
from mechcore.spec.loads import (
    BeltTension,
    Bushing,
    BushingDamper,
    Damper,
    Drag,
    GasSpring,
    Load,
    Spring,
    TorsionDamper,
    TorsionSpring,
    Viscous,
)
from mechcore.texts import as_force
from mechviz.scene.fields import (
    Angle,
    DocumentTable,
    Extent,
    Size,
    Stiffnesses,
    Text,
)
from mechviz.scene.fields import Force as ForceValue
from mechviz.scene.kinds.kind import LINEAR, AtLeastOne, LoadKind, LoadMaker, NotNegative, different_links
from mechviz.scene.names import Reference, TwoLinks, TwoPoints, known_place, link_names, split_point

if TYPE_CHECKING:
    from mechviz.scene.reading.recovery import Reading


MovingJoint = Annotated[Text, Reference("joint", what="joint that moves", fits=lambda joint: bool(joint.traits.viscous))]
BeltName = Annotated[Text, Reference("joint", ("belt", "chain"), "belt or chain")]


class SpringKeys(DocumentTable):
    """The keywords of these loads, and the keys that only they have."""

    spring: TwoPoints | None = None
    """The two points between which a spring pulls: ["link.point", "link.point"]."""
    damper: TwoPoints | None = None
    """The two points between which a damper acts."""
    gas_spring: TwoPoints | None = None
    """The two points that a gas spring pushes apart."""
    torsion_spring: TwoLinks | None = None
    """The two links between which a torsion spring acts, by the angle from the first to the second."""
    torsion_damper: TwoLinks | None = None
    """The two links between which a torsion damper acts."""
    bushing: TwoPoints | None = None
    """The two points between which a bushing acts, by springs and dampers in x, y and angle: ["link.point", "link.point"]."""
    stiffness: Stiffnesses | None = None
    """Spring: force per length. Torsion spring: moment per angle. Bushing: both, [x, y, angle], in the first link's axes."""
    free_length: Extent | None = None
    """Spring: length without load; 0 is a spring of no free length, used for balancing."""
    preload: ForceValue | None = None
    """Spring: pull at the free length. Default 0."""
    solid_length: Size | None = None
    """Spring: length at which its coils touch. A shorter spring is an event."""
    free_angle: Angle | None = None
    """Torsion spring, bushing: angle from the first link's frame to the second's without load. At the start the angle counts as the
    one nearest to it. Default 0."""
    extended: Size | None = None
    """Gas spring: distance of its two points when extended."""
    gas_length: Size | None = None
    """Gas spring: volume of the gas when extended over the area of the rod."""
    exponent: AtLeastOne | None = None
    """Gas spring: polytropic exponent. Default 1 (slow); 1.4 where it moves fast."""
    drag: Text | None = None
    """Resistance of a medium: "link.point" against the velocity of the point, "link" against the rotation of the link."""
    viscous: MovingJoint | None = None
    """The joint, of any kind that moves, in which viscous friction acts."""
    belt_tension: BeltName | None = None
    """The belt or chain that a tensioner keeps tight."""
    slack: ForceValue | None = None
    """Belt tension: tension of the slack span."""
    coefficient: NotNegative | None = None
    """Belt tension: coefficient of friction between belt and pulleys; slip is an event. Default: it cannot slip."""


def _between(m: LoadMaker, kind: Callable[..., Load], ends: list[str] | None, values: dict[str, Any]) -> Load | None:
    """A load between two points; None where one of them is not there."""
    assert ends is not None
    places = m.ends(ends)
    return None if places is None else kind(**m.common, **places, **values)


def _spring(m: LoadMaker) -> Load | None:
    values = {
        "stiffness": m.si("stiffness", "stiffness"),
        "free_length": m.si("free_length", "length"),
        "preload": m.si("preload", "force"),
        "solid_length": None if m.load.solid_length is None else m.si("solid_length", "length"),
    }
    return _between(m, Spring, m.load.spring, values)


def _damper(m: LoadMaker) -> Load | None:
    values = {"linear": m.si("linear", "damping"), "quadratic": m.si("quadratic", "quadratic damping")}
    m.not_nothing(values)
    return _between(m, Damper, m.load.damper, values)


MOST_EXPONENT = 10.0  # of a gas spring: far larger powers overflow


def _gas_spring(m: LoadMaker) -> Load | None:
    if m.load.exponent is not None and m.load.exponent > MOST_EXPONENT:
        why = f"{m.load.exponent:g} is no polytropic exponent of a gas."
        m.convert.note(f"{m.path}.exponent", why, "They lie between 1 and 2.")
        return None
    values = {
        "force": m.si("thrust", "force"),
        "extended": m.si("extended", "length"),
        "gas_length": m.si("gas_length", "length"),
        "exponent": 1.0 if m.load.exponent is None else m.load.exponent,
    }
    return _between(m, GasSpring, m.load.gas_spring, values)


def _torsion_spring(m: LoadMaker) -> Load | None:
    assert m.load.torsion_spring is not None
    first, second = m.load.torsion_spring
    stiffness, free = m.si("stiffness", "torsional stiffness"), m.si("free_angle", "angle")
    return TorsionSpring(**m.common, links=(first, second), stiffness=stiffness, free_angle=free)


def _torsion_damper(m: LoadMaker) -> Load | None:
    assert m.load.torsion_damper is not None
    first, second = m.load.torsion_damper
    return TorsionDamper(**m.common, links=(first, second), coefficient=m.si("linear", "torsional damping"))


def _three(m: LoadMaker, key: str, kind: str = "stiffness") -> tuple[float, float, float] | None:
    """Values of the load in x, y and angle, zero where they are left out; None where one value is given for all."""
    given = getattr(m.load, key)
    if given is not None and not isinstance(given, list):
        return None
    kinds = (kind, kind, f"torsional {kind}")
    x, y, angle = (
        m.convert.si(value, of, f"{m.path}.{key}[{k}]") for k, (value, of) in enumerate(zip(given or [0.0] * 3, kinds, strict=True))
    )
    return x, y, angle


def _bushing(m: LoadMaker) -> tuple[Load, ...]:
    load = m.load
    assert load.bushing is not None
    ends, free = m.ends(load.bushing), m.si("free_angle", "angle")
    stiffness, damping = _three(m, "stiffness"), _three(m, "linear", "damping")
    if ends is None or stiffness is None or damping is None:
        return ()
    if not any((*stiffness, *damping)):
        m.convert.note(f"{m.path}.stiffness", "all values are zero: it does nothing.", "Give one of them a value.")
    springs = Bushing(**m.common, **ends, stiffness=stiffness, free_angle=free)
    if not any(damping):
        return (springs,)
    return springs, BushingDamper(**m.common | {"name": f"{m.name} damping"}, **ends, damping=damping)


def _drag(m: LoadMaker) -> Load | None:
    assert m.load.drag is not None
    point = split_point(m.reading, m.load.drag)
    turning = m.load.drag in m.document.links
    if point is None and not turning:
        return None
    kind = "torsional damping" if turning else "damping"
    values: dict[str, Any] = {"linear": m.si("linear", kind), "quadratic": m.si("quadratic", f"quadratic {kind}")}
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
    return Viscous(**m.common, joint=m.load.viscous, coefficient=m.si("linear", joint.traits.viscous or "damping"))


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


_STIFFNESS = {"stiffness": '"2 N/mm" (or "3 N m/rad" for a torsion spring)'}
_DAMPER = "Write a damper between the same points as a load of its own."
_NO_DAMPER = {"linear": _DAMPER, "quadratic": _DAMPER}

SPRINGS = {
    "spring": LoadKind(
        words="a spring",
        example='{ spring = ["frame.P", "boom.Q"], stiffness = "2 N/mm", free_length = "80 mm" }',
        make=_spring,
        check=different_links,
        between=True,
        keys=("stiffness", "free_length", "preload", "solid_length"),
        needs={**_STIFFNESS, "free_length": '"80 mm"'},
        remedies=_NO_DAMPER,
    ),
    "damper": LoadKind(
        words="a damper",
        example='{ damper = ["frame.P", "boom.Q"], linear = "20 N s/m" }',
        make=_damper,
        check=different_links,
        between=True,
        keys=("linear", "quadratic"),
        any_of=("linear", "quadratic"),
        synonyms=("dashpot",),
    ),
    "gas_spring": LoadKind(
        words="a gas spring",
        example='{ gas_spring = ["frame.P", "lid.Q"], thrust = "400 N", extended = "300 mm", gas_length = "250 mm" }',
        make=_gas_spring,
        check=different_links,
        between=True,
        keys=("thrust", "extended", "gas_length", "exponent"),
        needs={
            "thrust": '"400 N", with which it pushes',
            "extended": '"300 mm", the distance of its points when extended',
            "gas_length": '"250 mm", the volume of the gas when extended over the area of the rod',
        },
        remedies=_NO_DAMPER,
    ),
    "torsion_spring": LoadKind(
        words="a torsion spring",
        example='{ torsion_spring = ["frame", "pointer"], stiffness = "3 N m/rad" }',
        make=_torsion_spring,
        between=True,
        keys=("stiffness", "free_angle"),
        needs=_STIFFNESS,
        remedies=_NO_DAMPER,
    ),
    "torsion_damper": LoadKind(
        words="a torsion damper",
        example='{ torsion_damper = ["frame", "pointer"], linear = "0.1 N m s/rad" }',
        make=_torsion_damper,
        between=True,
        keys=("linear",),
        needs={"linear": LINEAR},
    ),
    "bushing": LoadKind(
        words="a bushing",
        example='{ bushing = ["frame.A", "arm.A"], stiffness = ["200 N/mm", "80 N/mm", "3 N m/rad"] }',
        make=_bushing,
        check=different_links,
        between=True,
        keys=("stiffness", "linear", "free_angle"),
        needs={"stiffness": '["200 N/mm", "80 N/mm", "3 N m/rad"]: in x, y and angle'},
        threefold=True,
    ),
    "drag": LoadKind(
        words="drag",
        example='{ drag = "pendulum.P", quadratic = "0.02 N s^2/m^2" }',
        make=_drag,
        check=_check_drag,
        keys=("linear", "quadratic"),
        any_of=("linear", "quadratic"),
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
"""The kinds of loads that springs, dampers and resistance make, and the tension of belts."""
