"""Frozen descriptions of mechanisms in SI units and radians, names instead of indices.

A link is a rigid body with named points in its own frame. A joint joins one point of a first link to one point of a second.
A drive prescribes the relative coordinate of a joint. A load acts on a link. Nothing here computes anything.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import field
from functools import cached_property
from typing import TYPE_CHECKING, Literal

from mechcore.arrays import Vec2
from mechcore.laws.curve import MotionCurve
from mechcore.laws.timed import Law, moves
from mechcore.records import dataclass
from mechcore.spec.loads import Load
from mechcore.spec.studies import Studies

if TYPE_CHECKING:
    from mechcore.cams.contour import Contour
    from mechcore.cams.followers import Face


EFFECTS: Mapping[str, str] = {
    "inertia": "inertia forces -m a_S and moments -J_S alpha of the links that have a mass",
    "gravity": "weight m g of the links that have a mass",
    "friction": "dry friction in the joints that have a coefficient, solved together with the reactions",
}
"""Effects that a scene can name, in addition to its loads."""

METRICS: Mapping[str, str] = {
    "transmission_angle": "angle between the two links of every RRR group, at their common pin",
    "velocity_ratio": "rate of every joint's coordinate per unit rate of the first drive",
    "mechanical_advantage": "output effort per input effort of the ideal mechanism, at every joint on the frame",
    "instant_centre": "point of equal velocity of every two links",
    "curvature": "curvature of the paths of the traced points",
}
"""Metrics that a scene can request; see `mechcore.motion.metrics`."""


@dataclass(frozen=True, kw_only=True)
class Link:
    """A rigid link. Its points and its centre of mass are given in the link's own frame."""

    name: str
    points: Mapping[str, Vec2]  # pin centres, guide points and traced points [m]
    mass: float = 0.0  # [kg]
    centre: Vec2 = (0.0, 0.0)  # centre of mass S [m]
    inertia: float = 0.0  # J_S, about the centre of mass [kg m^2]
    gravity: Vec2 | None = None  # acceleration of gravity for this link alone [m/s^2]; None: the mechanism's
    plane: float = 0.0  # least distance in front of the other links at which it is drawn, along the joint axes [m]
    outline: tuple[Vec2, ...] = ()  # corners of a figure that is drawn with it [m]
    colour: tuple[int, int, int] | None = None  # red, green, blue of the drawing, each from 0 to 255; None: chosen automatically


@dataclass(frozen=True, kw_only=True)
class Friction:
    """Dry (Coulomb) friction in a joint, always against its relative motion; used only if the effect "friction" is named.

    Revolute: moment ``coefficient * radius * |R|``, R the total reaction; ``exact``: with the exact radius of the friction circle
    ``radius * sin(atan(coefficient))`` instead.

    Prismatic: force ``coefficient * (|N1| + |N2|)`` along the guide, N1 and N2 the forces at the two ends of a bearing of
    ``length``; no length: ``coefficient * |N|``. The middle of the bearing lies ``offset`` along the guide from the point of the
    link that carries the bearing: the sliding link, or, with ``bearing`` "guide", the link with the guide. ``height``: distance
    between the two faces of the guide on which the friction acts, for a part that slides between them.

    Pin in a slot: ``coefficient * |N|``, and with a ``radius`` the moment ``coefficient * radius * |N|`` against the pin's
    rotation. Rolling, gear, rack: couple ``lever * |N|`` against the relative rotation, N the force across the contact. Cylinder:
    ``coefficient * |F|`` along it, F the force that drives it (its mechanical losses), and ``brake``, the friction of its seals.
    Screw: ``coefficient * |N|`` along the thread, N the force across its flanks at the mean ``radius``.

    With a ``stribeck`` speed vs the coefficient of revolute, prismatic and slot joints at a sliding speed v of the surfaces is
    ``coefficient + (static - coefficient) exp(-(v / vs)^2)``.
    """

    coefficient: float = 0.0
    radius: float = 0.0  # of the pin [m]
    length: float = 0.0  # of the bearing [m]
    offset: float = 0.0  # [m]
    height: float = 0.0  # [m]
    bearing: Literal["slider", "guide"] = "slider"
    lever: float = 0.0  # [m]
    exact: bool = False
    brake: float = 0.0  # revolute, prismatic, cylinder: friction independent of the reaction [N m or N], as of a brake
    static: float = 0.0  # coefficient of sticking, in forward dynamics; 0: the same as that of sliding
    stribeck: float = 0.0  # speed at which their difference has dropped to 1/e [m/s]; 0: none once it slides


@dataclass(frozen=True, kw_only=True)
class Revolute:
    """A revolute joint: a pin through ``points[0]`` of ``links[0]`` and ``points[1]`` of ``links[1]``.

    Its coordinate is the angle of the second link's frame minus that of the first's [rad].
    """

    name: str
    links: tuple[str, str]
    points: tuple[str, str]
    friction: Friction | None = None


@dataclass(frozen=True, kw_only=True)
class Prismatic:
    """A prismatic joint: the point of one link slides along a straight guide on the other, without turning.

    ``guide`` (0 or 1): which of ``links`` carries the guide line. The line passes through that link's point in the
    direction ``along`` (in the frame of the guide's link; its length does not matter). The coordinate is the signed
    distance along the guide from the guide's point to the other link's point [m]. ``angle`` is the constant angle of the
    second link's frame minus that of the first's [rad]. ``ends`` are as those of a `PinSlot`.
    """

    name: str
    links: tuple[str, str]
    points: tuple[str, str]
    along: Vec2 = (1.0, 0.0)
    guide: Literal[0, 1] = 0
    angle: float = 0.0
    ends: Vec2 | None = None  # [m]
    friction: Friction | None = None


@dataclass(frozen=True, kw_only=True)
class Weld:
    """A rigid joint: the points coincide and the second link's frame keeps ``angle`` to the first's [rad]."""

    name: str
    links: tuple[str, str]
    points: tuple[str, str]
    angle: float = 0.0


@dataclass(frozen=True, kw_only=True)
class PinSlot:
    """A pin in a straight slot: the pin's point slides along the slot and its link turns freely. ``guide`` carries the slot.

    Its coordinate is the signed distance along the slot from the slot's point to the pin [m]. ``ends`` are the least and greatest
    coordinates that the slot allows: prescribed motion beyond them is an error, in free motion they are end stops. None: no ends.
    """

    name: str
    links: tuple[str, str]
    points: tuple[str, str]
    along: Vec2 = (1.0, 0.0)
    guide: Literal[0, 1] = 0
    ends: Vec2 | None = None  # [m]
    friction: Friction | None = None


@dataclass(frozen=True, kw_only=True)
class Rolling:
    """A wheel that rolls without slip on a straight edge.

    ``links``: (link with the edge, wheel). ``points``: (a point on the path of the wheel's centre, the line parallel to the edge;
    the wheel's centre). ``along``: the edge's direction in its link's frame; the wheel lies on the stated ``side`` of it. The
    coordinate is the displacement of the wheel's centre along the edge from that point [m].
    """

    name: str
    links: tuple[str, str]
    points: tuple[str, str]
    radius: float  # [m]
    along: Vec2 = (1.0, 0.0)
    side: Literal["left", "right"] = "left"
    friction: Friction | None = None


@dataclass(frozen=True, kw_only=True)
class Gear:
    """A gear pair between two links pinned to the same ``carrier``. ``sizes``: teeth or radii; only their ratio matters.

    ``internal``: the second is a ring gear. The coordinate is the angle of the second link minus that of the first [rad].
    ``pressure_angle`` [rad] determines the direction of the force, which acts at the pitch point.
    """

    name: str
    links: tuple[str, str]
    carrier: str
    sizes: tuple[float, float]
    internal: bool = False
    pressure_angle: float = 0.3490658503988659  # 20 degrees
    friction: Friction | None = None


@dataclass(frozen=True, kw_only=True)
class Belt:
    """A belt or chain over two pulleys of ``radii`` [m] pinned to the same ``carrier``; a crossed belt reverses the rotation.

    It does not slip; the tight span carries the force. The coordinate is as for `Gear`.
    """

    name: str
    links: tuple[str, str]
    carrier: str
    radii: tuple[float, float]
    crossed: bool = False


@dataclass(frozen=True, kw_only=True)
class Rack:
    """A pinion and a rack: ``links`` are (pinion, rack); ``slider`` names the prismatic joint that guides the rack on the link to
    which the pinion is pinned. The pinion lies on the stated ``side`` of the direction of that guide."""

    name: str
    links: tuple[str, str]
    slider: str
    radius: float  # [m]
    side: Literal["left", "right"] = "left"
    pressure_angle: float = 0.3490658503988659
    friction: Friction | None = None


@dataclass(frozen=True, kw_only=True)
class Cylinder:
    """A cylinder (hydraulic, electric ...), pinned at its ends to a point of the first link and a point of the second.

    Compiled to two links without mass, ``<name>.barrel`` and ``<name>.rod``, with pins ``<name>.base`` and ``<name>.eye`` and a
    prismatic joint ``<name>``, whose coordinate is the distance of the two points [m]. ``ends``: its least and greatest length.
    """

    name: str
    links: tuple[str, str]
    points: tuple[str, str]
    ends: Vec2 | None = None  # [m]
    friction: Friction | None = None


@dataclass(frozen=True, kw_only=True)
class Screw:
    """A slide that a screw moves: ``links``, ``points``, ``along``, ``guide`` and ``angle`` are those of a `Prismatic`.

    The spindle turns in the link with the guide, about a line through that link's point in the direction ``along``; the nut is the
    other link. The coordinate is the angle of the spindle [rad]. A turn moves the nut by ``lead`` [m] along the guide; at
    coordinate zero the two points coincide. The axis lies in the plane: the torque on the spindle loads no link of the plane.
    Compiled to a link without mass, ``<name>.spindle``, that turns with the coordinate, and a prismatic joint ``<name>.slide``;
    ``<name>.thread`` is the force at the thread. ``friction``: coefficient in the thread and its mean ``radius``.
    """

    name: str
    links: tuple[str, str]
    points: tuple[str, str]
    lead: float  # [m]
    along: Vec2 = (1.0, 0.0)
    guide: Literal[0, 1] = 0
    angle: float = 0.0
    friction: Friction | None = None

    @property
    def radius(self) -> float:
        """Travel of the nut per angle of the spindle [m/rad]."""
        return self.lead / (2.0 * math.pi)


@dataclass(frozen=True, kw_only=True)
class Planar:
    """A planar joint: the second link moves freely in the plane of the first; nothing is transmitted.

    Its coordinates ``<name>.x``, ``<name>.y`` [m] are the position of the second link's ``point`` (None: its frame's origin) in the
    first link's frame; ``<name>`` [rad] is the angle of the second link's frame minus that of the first's. Each needs a drive or is
    free. Compiled to two links without mass with the first two names, and three joints with all three names.
    """

    name: str
    links: tuple[str, str]
    point: str | None = None

    @property
    def points(self) -> tuple[None, str | None]:
        return None, self.point

    @property
    def made(self) -> tuple[str, str]:
        """Names of the massless links that it is compiled to."""
        return f"{self.name}.x", f"{self.name}.y"

    @property
    def coordinates(self) -> tuple[str, str, str]:
        return *self.made, self.name


@dataclass(frozen=True)
class SpatialBlank:
    """The blank of a spatial cam: ``radius`` of its cylinder (not used for a globoid); ``depth`` of the groove, height of the rib
    or width of the end face [m]. ``axis``: direction of the cam's axis in the carrier's frame, if the follower's guide does not
    determine it.
    """

    kind: Literal["barrel", "rib", "end", "globoid"]
    radius: float
    depth: float
    axis: Vec2 | None = None
    thickness: float = 0.0  # of a rib [m]
    rollers: int = 0  # of an indexing cam: evenly around the pivot of its turret, which advances by one of them per turn


@dataclass(frozen=True, kw_only=True)
class CamRating:
    """Criteria for the contact of a cam: Hertz pressure over a ``width`` [m] with Young's moduli [Pa] and Poisson's ratios of cam
    and follower, at most ``limit`` [Pa]; a contact force of at least ``margin`` [N]. None: not checked."""

    width: float | None = None
    modulus: tuple[float, float] = (2.1e11, 2.1e11)
    poisson: tuple[float, float] = (0.3, 0.3)
    limit: float | None = None
    margin: float | None = None


@dataclass(frozen=True, kw_only=True)
class CamDrawn:
    """The graphical method of the lecture: the lift is drawn every ``step`` [rad], read with a ``resolution`` [m or rad], and
    differentiated by chords or tangents."""

    step: float
    lines: Literal["chord", "tangent"] = "chord"
    resolution: float = 0.0


@dataclass(frozen=True, kw_only=True)
class CamJoint:
    """A plane cam and its follower: ``links`` are (cam, follower), both guided on one link, the carrier.

    ``guide`` names the joint that guides the follower on the carrier: prismatic (the follower lifts in the direction of the guide,
    which points away from the cam) or revolute. ``point`` of the follower is the knife's tip, the centre of the roller or of
    the mushroom's arc, a point of the flat face. A disc cam turns about a pin on the carrier; with ``bed``, the prismatic joint
    that guides it, the cam is a wedge.

    ``lift``: the displacement of the follower over the cam's angle [rad] or travel [m], in metres for a translating follower, in
    radians for an oscillating one. It is measured from the follower's position on the base circle of radius ``base`` [m] (wedge: at
    this height above the line on which the cam's point moves). Or ``contour`` is the cam's given profile in the axes of its link
    [m], without ``lift`` and ``base``. ``sense``: of the cam's rotation over which the law is defined (1 counter-clockwise);
    ``phase``: the argument of the law at the cam's coordinate zero.

    ``side``: an oscillating follower has its point on this side of the line from its pivot to the cam's axis. ``closure``: "force"
    only presses; "form" pulls too: a groove with a knife or roller, a yoke with flat faces. ``second``: point and radius of a
    second roller on a second cam of the same shaft, which pulls (a conjugate pair).

    ``pressure_limit`` [rad]: a larger pressure angle is an event; ``curvature_limit`` [m]: least radius of the convex profile.
    ``undercut``: a profile with undercut is an error ("refuse"), or is made as the cutter leaves it ("cut"). ``least``: sizes to be
    determined. The "base" circle is then the smallest one that keeps both limits, has no undercut and is not smaller than the
    ``hub`` [m]; ``base`` is ignored. For "offset" and "roller", and for ``sized``, see `with_least_sizes` of
    `mechcore.forces.cam_rating`.
    """

    name: str
    links: tuple[str, str]
    guide: str
    point: str
    lift: MotionCurve | None
    face: Face
    base: float  # [m]
    contour: Contour | None = None
    undercut: Literal["refuse", "cut"] = "refuse"
    bed: str | None = None
    sense: Literal[1, -1] = 1
    phase: float = 0.0  # [rad or m]
    side: Literal["left", "right"] = "left"
    closure: Literal["force", "form"] = "force"
    second: tuple[str, float] | None = None  # of form closure
    friction: Friction | None = None  # coefficient of the contact; of a roller also the radius of its pin
    inverse: bool = False  # the roller's centre is a point of the first link, the groove is in the second; closure is "form"
    spatial: SpatialBlank | None = None  # the cam's axis lies in the plane: base is the roller's position along it at zero lift
    pressure_limit: float | None = None  # [rad]
    curvature_limit: float | None = None  # [m]
    least: tuple[Literal["base", "offset", "roller"], ...] = ()
    sized: tuple[tuple[Literal["offset", "roller"], float], ...] = ()  # offset [m]; cam angle that determines the roller [rad]
    hub: float = 0.0  # [m]
    rating: CamRating | None = None
    drawn: CamDrawn | None = None


Joint = Revolute | Prismatic | Weld | PinSlot | Rolling | Gear | Belt | Rack | Cylinder | Screw | Planar | CamJoint


def coordinates_of(joint: Joint) -> tuple[str, ...]:
    """The names of a joint's coordinates for drives: its own name; three for a planar joint."""
    return joint.coordinates if isinstance(joint, Planar) else (joint.name,)


def friction_of(joint: Joint) -> Friction | None:
    """The friction of a joint; None if it can have none or states none."""
    f: Friction | None = getattr(joint, "friction", None)
    return f if f is not None and (f.lever if isinstance(joint, Rolling | Gear | Rack) else f.coefficient or f.brake) else None


def joints_with_friction(joints: Sequence[Joint]) -> tuple[str, ...]:
    """Names under which the friction of joints is reported, whether or not the effect is named: those of the joints, for a screw
    that of its thread."""
    return tuple(f"{p.name}.thread" if isinstance(p, Screw) else p.name for p in joints if friction_of(p) is not None)


@dataclass(frozen=True, kw_only=True)
class Drive:
    """A drive: prescribes the coordinate of a joint as a function of time, angle [rad] or displacement [m]."""

    joint: str
    law: Law


@dataclass(frozen=True, kw_only=True)
class Mechanism:
    """A whole mechanism. ``frame`` names the fixed link, whose frame is the world frame.

    ``standstill``: duration of a run if no drive moves, or if there is none [s]; 0: one instant.
    """

    name: str
    frame: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    drives: tuple[Drive, ...] = ()
    loads: tuple[Load, ...] = ()
    effects: tuple[str, ...] = ()  # names from EFFECTS; others are not computed
    gravity: Vec2 = (0.0, -9.81)  # [m/s^2], used only if the effect "gravity" is named
    modes: Mapping[str, str] = field(default_factory=dict)  # joint -> "left" | "right" | "ahead" | "behind" | "open" | "crossed"
    sketch: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)  # link -> rough x, y, angle at the start
    traced: tuple[tuple[str, str], ...] = ()  # (link, point) whose paths are traced
    metrics: tuple[str, ...] = ()  # names from METRICS
    studies: Studies = field(default_factory=Studies)
    standstill: float = 0.0

    @cached_property
    def moving(self) -> bool:
        """Whether a drive moves it."""
        return any(moves(drive.law) for drive in self.drives)

    @cached_property
    def ends(self) -> Mapping[str, tuple[float, float]]:
        """Least and greatest coordinates [m] that slots, guides and cylinders with ends allow, by joint."""
        guided = (joint for joint in self.joints if isinstance(joint, PinSlot | Prismatic | Cylinder))
        return {joint.name: joint.ends for joint in guided if joint.ends is not None}

    @property
    def cycle(self) -> float:
        """Duration of one cycle [s]: that of the first moving drive; if none moves, `standstill`."""
        return next((float(drive.law.duration) for drive in self.drives if moves(drive.law)), self.standstill)
