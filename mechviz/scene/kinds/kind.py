"""Kinds of joints and loads: the properties that each kind declares, and the helpers that convert it to a joint or load of the
core."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import field
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator

from mechcore.arrays import Vec2
from mechcore.errors import Fault
from mechcore.laws.timed import Smoothness
from mechcore.laws.timed import Table as Interpolation
from mechcore.records import dataclass
from mechcore.spec.loads import Load
from mechcore.spec.mechanism import Friction, Joint
from mechviz.scene.convert import Converter
from mechviz.scene.fields import DocumentTable, Number, fault, one_of
from mechviz.scene.kinds.friction import FrictionKind, friction_spec
from mechviz.scene.names import known_joint, link_names, points_of_joint, split_point

if TYPE_CHECKING:
    from mechviz.scene.assembly.links import Placement
    from mechviz.scene.document import SceneDocument
    from mechviz.scene.kinds.joints.document import JointDocument
    from mechviz.scene.kinds.loads.document import LoadDocument
    from mechviz.scene.reading.recovery import Reading


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of joint or load: its name and its keys."""

    words: str  # its name in a sentence
    example: str  # an entry of the scene in TOML
    keys: tuple[str, ...] = ()  # keys that go with it
    needs: Mapping[str, str] = field(default_factory=dict)  # keys without a default, with an example of each
    one_of: tuple[str, ...] = ()  # exactly one of these keys
    synonyms: tuple[str, ...] = ()  # other terms for it
    remedies: Mapping[str, str] = field(default_factory=dict)  # key of another kind -> remedy: what was probably meant by it


class KindTable(DocumentTable):
    """A table with exactly one of the keywords of ``KINDS``, and the keys that go with that kind."""

    KINDS: ClassVar[Mapping[str, Kind]]
    EVERY: ClassVar[tuple[str, ...]] = ()  # keys that go with every kind

    @classmethod
    def keys_beside(cls, raw: Mapping[str, Any]) -> list[str]:
        """The keys that go with the kind of a table of plain data; all, the keywords first, where its kind is not clear."""
        kinds = [kind for kind in cls.KINDS if kind in raw]
        if len(kinds) == 1:
            return [kinds[0], *cls.KINDS[kinds[0]].keys, *cls.EVERY]
        return [*cls.KINDS, *(key for key in cls.model_fields if key not in cls.KINDS)]

    @cached_property
    def kinds(self) -> list[str]:
        """The kinds that are given: one in a valid table."""
        return [kind for kind in self.KINDS if getattr(self, kind) is not None]

    @property
    def kind(self) -> str:
        return self.kinds[0]

    def has_value(self, key: str) -> bool:
        """Whether a key has a value."""
        return getattr(self, key) is not None

    def remedy_for(self, key: str) -> str:
        """Remedy for a key that does not go with the kind."""
        return self.KINDS[self.kind].remedies.get(key, f"Leave out {key}.")

    def key_faults(self, what: str) -> list[tuple[str, str, str]]:
        """The faults of keys that do not go with the kind, and of those that it lacks; ``what``: the table in a sentence."""
        kind = self.KINDS[self.kind]
        foreign_keys = self.model_fields_set - {*self.KINDS, *self.EVERY, *kind.keys}
        order = list(type(self).model_fields).index if foreign_keys else None
        wrong = [
            (key, f"{key} does not go with {kind.words}.", self.remedy_for(key))
            for key in sorted(foreign_keys, key=order)
            if self.has_value(key)
        ]
        for key, example in kind.needs.items():
            if getattr(self, key) is None:
                wrong.append(("", f"'{key}' is missing.", f"Add {key} = {example}."))
        return wrong + (one_of(self, kind.one_of, what) if kind.one_of else [])


# -- joints -------------------------------------------------------------------------------------------------------------
@dataclass(frozen=True, kw_only=True)
class JointKind(Kind):
    """A kind of joint with all properties of its keyword, from its name to the joint of the core."""

    make: Callable[[JointMaker], Joint | None]  # the core's joint; None where too much of it is missing
    modes: tuple[str, ...] = ()  # keys that select an assembly mode
    driven: Literal["angle", "length", ""] = ""  # what a drive on it prescribes
    undriven: str = ""  # what to drive instead, where a drive makes no sense
    viscous: Literal["damping", "torsional damping", ""] = ""  # kind of its viscous coefficient; empty where it does not move
    friction: FrictionKind | None = None  # its dry friction
    joins_points: bool = True  # it holds points of its links together; the others couple motions of links that joints hold
    places_link: bool = True  # it places one of its links relative to the other
    coincide: bool = False  # the two points are one place
    parallel: bool = False  # the two links keep a constant angle
    is_planar: bool = False  # free, it has x, y and angle instead of one coordinate
    own_mode: bool = False  # its drive does not decide the assembly mode
    higher: bool = False  # there is an equivalent linkage of lower pairs
    parts: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # section -> links and joints that it generates
    check: Callable[[Reading, str, JointDocument], Iterator[Fault]] | None = None  # faults of the names at a path that it refers to
    core_path: Callable[[JointDocument, str], str] | None = None  # path inside the core's joint -> path inside the scene's


class JointMaker:
    """A joint of a scene in its context; its properties are in SI units."""

    def __init__(self, name: str, joint: JointDocument, document: SceneDocument, placement: Placement, convert: Converter):
        self.name, self.joint, self.document, self.placement, self.convert = name, joint, document, placement, convert
        self.path = f"joints.{name}"

    @property
    def points(self) -> tuple[str, str]:
        return points_of_joint(self.name, self.joint)

    @property
    def guide(self) -> Literal[0, 1]:
        return 1 if self.joint.guide == self.joint.links[1] else 0

    @property
    def along(self) -> Vec2:
        """Direction of the guide in the frame of its link."""
        if self.joint.along is None:
            return (1.0, 0.0)
        a, b = self.joint.along
        if not (isinstance(a, str) and isinstance(b, str)):
            return (float(a), float(b))
        places = self.placement.points.get(self.joint.links[self.guide], {})
        pa, pb = places.get(a, (0.0, 0.0)), places.get(b, (1.0, 0.0))
        if a not in places or b not in places:
            return (1.0, 0.0)
        if pa == pb:
            self.convert.note(
                f"{self.path}.along",
                f"'{a}' and '{b}' are at the same place.",
                "Name two different points, or write a direction such as [1, 0].",
            )
        return (pb[0] - pa[0], pb[1] - pa[1])

    @property
    def angle(self) -> float:
        """Constant angle from the first link's frame to the second's: stated, as drawn, or zero [rad]."""
        if self.joint.angle is not None:
            return self.convert.si(self.joint.angle, "angle", f"{self.path}.angle")
        return drawn_angle(self.joint, self.placement)

    @property
    def ends(self) -> Vec2 | None:
        """Least and greatest coordinate [m]; None where none are stated."""
        given, path = self.joint.length, f"{self.path}.length"
        if given is None:
            return None
        if not isinstance(given, list):
            return 0.0, self.convert.si(given, "length", path)
        low, high = self.convert.row(given, "length", path)
        if low >= high and self.convert.has_known_unit("length"):
            self.convert.note(path, "it ends where it begins, or before.", "Write [from, to], the greater coordinate last.")
        return low, high

    @property
    def radius(self) -> float:
        if self.joint.radius is None:  # noted where the joint was read
            return math.nan
        return self.convert.si(self.joint.radius, "length", f"{self.path}.radius")

    @property
    def side(self) -> Literal["left", "right"]:
        return self.joint.side or "left"

    @property
    def friction(self) -> Friction | None:
        kind = self.joint.traits.friction
        return None if kind is None else friction_spec(kind, self.path, self.joint.friction, self.document.friction, self.convert)


def drawn_angle(joint: JointDocument, placement: Placement) -> float:
    """The angle from the first link's frame to the second's as they are drawn [rad]; 0 where they are not."""
    if not placement.drawn.issuperset(joint.links):
        return 0.0
    first, second = (placement.poses[link][2] for link in joint.links)
    return math.remainder(second - first, 2.0 * math.pi)


# -- loads --------------------------------------------------------------------------------------------------------------
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


@dataclass(frozen=True, kw_only=True)
class LoadKind(Kind):
    """A kind of load with all properties of its keyword, from its name to the load of the core."""

    make: Callable[[LoadMaker], Load | tuple[Load, ...] | None]  # the core's; None where a name or part is faulty
    any_of: tuple[str, ...] = ()  # at least one of these keys
    between: bool = False  # its keyword names two points or links, which differ
    check: Callable[[Reading, str, Any], Iterator[Fault]] | None = None  # faults of what stands at the path of its keyword
    threefold: bool = False  # stiffness and damping in x, y and angle


LINEAR = '"20 N s/m" (or "0.1 N m s/rad" for rotation)'
"""Example of a coefficient of damping."""


class LoadMaker:
    """A load of a scene in its context, with its values in SI units."""

    def __init__(self, name: str, load: LoadDocument, reading: Reading, convert: Converter, leader: str | None):
        self.name, self.load, self.reading, self.convert, self.leader = name, load, reading, convert, leader
        self.document: SceneDocument = reading.document
        self.path = f"loads.{name}"

    @property
    def common(self) -> dict[str, Any]:
        return {"name": self.name, "use": self.load.use}

    def si(self, key: str, kind: str, default: float = 0.0) -> float:
        """A value of the load in SI units; ``default`` where it is left out."""
        value = getattr(self.load, key)
        return default if value is None else self.convert.si(value, kind, f"{self.path}.{key}")

    def ends(self, texts: list[str]) -> dict[str, Any] | None:
        """Links and points of the two ends of a spring or damper."""
        first, second = (split_point(self.reading, text) for text in texts)
        if first is None or second is None:
            return None
        return {"links": (first[0], second[0]), "points": (first[1], second[1])}

    def not_nothing(self, values: dict[str, float]) -> None:
        """Note a load whose coefficients are all zero: it does nothing."""
        given = self.load.linear is not None or self.load.quadratic is not None
        if given and all(value == 0.0 for value in values.values()):
            self.convert.note(
                self.path, "its coefficients are zero: it does nothing.", "Give one of them a value, or leave it out."
            )

    def spline(
        self, x: tuple[float, ...], y: tuple[float, ...], path: str, period: float | None = None, smooth: Smoothness = True
    ) -> Interpolation | None:
        """A table as a function; None, and a fault, where its rows are so close that nothing smooth goes through them."""
        try:
            return Interpolation(x=x, y=y, period=period, smooth=smooth)
        except ValueError:
            self.convert.note(path, "the rows are too close to each other.", "Leave out some of them.")
            return None


def different_links(reading: Reading, path: str, ends: str | list[str]) -> Iterator[Fault]:
    """The fault of a load between two points, "link.point", that are on one link."""
    if isinstance(ends, str):
        return
    places = [split_point(reading, text) for text in ends]
    if ends[0] != ends[1] and places[0] and places[1] and places[0][0] == places[1][0]:
        yield Fault(path, f"both points are on '{places[0][0]}'.", "Name points of two links.")


def known_shaft(reading: Reading, path: str, name: str) -> Iterator[Fault]:
    """Faults of what a machine drives: a revolute joint or a moving link."""
    if name == reading.document.frame and name not in reading.document.joints:
        yield Fault(path, f"'{name}' is the fixed link: it does not turn.", "Name a revolute joint or a moving link.")
    elif name not in link_names(reading):
        yield from known_joint(reading, path, name, ("revolute",), "revolute joint")
