"""Where friction acts: one element for each relative motion that a joint with a coefficient brakes.

An element puts ``lambda`` times a unit wrench on the second link of its joint and the opposite on the first, with
``lambda = -sign(rate) factor * g``, where ``rate`` is the relative speed at which the wrench does work and ``g`` the normal load:
the length, or the larger component, of two numbers that are linear in what the joint transmits.

Pin: moment mu r |R| (the formula of lectures, R the whole reaction), exactly mu r / sqrt(1 + mu^2) |R| (friction circle).
Guide with a bearing of length b: the forces N1 and N2 at its ends have N1 + N2 = N and (N2 - N1) b / 2 = C, the couple about
its middle, hence |N1| + |N2| = max(|N|, 2 |C| / b): while |C| < |N| b / 2 both press on the same side and the couple does not
matter, whatever the pressure between them; beyond that they press on opposite sides.
Cam: mu |N| along the common tangent; a roller of radius R on a pin of radius r: mu r / R |N|, the drag of the pin. Where a roller
rolls and also slides along its axis, as on cams about an axis in the plane, the whole friction at the flank is mu |N| against the
whole sliding; the drag of the pin is its part across the axis, so that along the axis it is mu sqrt(1 - r^2 / R^2) |N|.
Screw: mu N along the thread, N across its flanks: with the mean radius r, the lead angle l, tan l = lead / (2 pi r), and
tan rho = mu the torque is F r tan(l + rho) against the load F, and F r tan(l - rho) with it.
Cylinder: mu |F| along it, F the force that drives it; a cylinder without a drive transmits none and has only its brake.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import reduce
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Plane, Real, Values, unit_vectors
from mechcore.constants import REST
from mechcore.errors import Fault, MechanismError
from mechcore.kinematics.dyads import cross
from mechcore.kinematics.model import Model
from mechcore.kinematics.rates import Rates
from mechcore.laws.timed import Free
from mechcore.motion.motion import Motion
from mechcore.numerics.tape import value_of
from mechcore.records import dataclass
from mechcore.spec.mechanism import (
    CamJoint,
    Cylinder,
    Friction,
    Joint,
    PinSlot,
    Prismatic,
    Revolute,
    Rolling,
    Screw,
    friction_of,
)

Movement = Literal["turn", "slide"]
ElementKind = Literal["pin", "guide", "normal", "contact", "brake", "drive"]

RESTING_SPEED = 1e-12  # part of the largest relative speed of the mechanism: slower joints are at rest


@dataclass(frozen=True, eq=False)
class Element:
    """One braked relative motion. ``rate`` (F,) and its ``sign`` (F,), 0 at rest."""

    joint: str
    what: Movement
    kind: ElementKind  # how the normal load follows from what the joint transmits
    friction: Friction
    factor: Values  # moment or force per normal load [m or 1] where it slides, a number or (F,)
    limit: Values  # the same at the limit of sticking
    coefficient: Values  # of sliding, a number or (F,)
    links: tuple[int, int]  # first and second
    index: int  # of the joint in the model; -1 for a relation
    along: Plane  # of a slide: unit vector of the force on the second link for lambda = 1
    rate: Real
    sign: Real
    place: Plane | None = None  # of a cam or thread: where they touch
    twist: Values | None = None  # of an axis in the plane: couple on the turning link, the opposite on the carrier [m]
    carrier: int = -1
    in_plane_share: Values = 1.0  # of the same: part of the normal force in the plane

    @property
    def unit(self) -> str:
        return "N" if self.what == "slide" else "N m"

    @property
    def euclidean(self) -> bool:
        """Whether the normal load is the Euclidean length of its two numbers; otherwise it is the larger of them."""
        return self.kind in ("pin", "contact")

    def load(self, motion: Motion, force: list[Plane], moment: list[Values], value: Values) -> None:
        """Add ``value`` times the unit wrench to the loads on the links (moments about their origins)."""
        for side, sign in ((0, -1.0), (1, 1.0)):
            k = self.links[side]
            if self.what == "turn":
                moment[k] = moment[k] + sign * value
            else:
                f = sign * value * self.along
                force[k] = force[k] + f
                at = motion.joint_point(self.index) if self.place is None else self.place
                moment[k] = moment[k] + cross(at - motion.origins[k], f)
        if self.twist is not None:
            for k, couple in ((self.links[0], value * self.twist), (self.carrier, -value * self.twist)):
                moment[k] = moment[k] + couple

    def normal(
        self, motion: Motion, transmitted: Sequence[tuple[Plane, Values]], contacts: dict[str, tuple[Plane, Plane]], sign: Values
    ) -> tuple[Values, Values]:
        """The two numbers whose norm is the normal load [N]; ``sign`` is the direction of sliding."""
        if self.kind == "brake":  # its factor is the whole friction: see `solve.system`
            return 1.0, 0.0
        if self.kind == "contact":
            force = contacts[self.joint][1] / self.in_plane_share
            return force.real, force.imag
        force, couple = transmitted[self.index]
        if self.kind == "pin":
            return force.real, force.imag
        u = motion.guide(self.index)
        if self.kind == "drive":
            return np.real(np.conj(u) * force), 0.0
        n = np.real(np.conj(1j * u) * force)
        f = self.friction
        if self.kind == "normal" or not f.length:
            return n, 0.0 * n
        middle = motion.state.slide[self.index] - f.offset if f.bearing == "guide" else -f.offset  # from it to the sliding point
        c = couple + middle * n + sign * self.coefficient * 0.5 * f.height * n
        return n, c * (2.0 / f.length)


def scales_of(model: Model, elements: Sequence[Element]) -> Real:
    """Scale of a large displacement of each element (e,): 1 rad, or the length scale of the mechanism [m]."""
    return np.array([1.0 if e.what == "turn" else model.length_scale for e in elements])


def elements_of(motion: Motion, flanks: Mapping[int, Values] | None = None, signs: Iterable[Values] | None = None) -> list[Element]:
    """All elements of a mechanism, in the order of its joints. ``flanks``: relation -> multiplier (F,) whose sign says on which of
    its two sides a cam presses; without it all press on the first side. ``signs`` of their rates, where these are known."""
    if signs is not None:
        given = iter(signs)
        return _elements(motion, lambda *_: next(given), flanks)
    peak = motion.peak or _peak
    turning = reduce(np.maximum, map(peak, motion.speeds.angular), 0.0)
    moving = reduce(np.maximum, map(peak, motion.speeds.slide.values()), turning * motion.model.length_scale)
    least: dict[Movement, float] = {"turn": RESTING_SPEED * turning, "slide": RESTING_SPEED * moving}
    return _elements(motion, lambda rate, what: _sign(rate, least[what], peak), flanks)


Sense = Callable[[Any, Movement], Any]  # a rate (F,) and the movement it belongs to -> its sign (F,)


def _elements(motion: Motion, sense: Sense, flanks: Mapping[int, Values] | None) -> list[Element]:
    return [
        _element(motion, joint, *parts, sense, flanks or {}, nth)
        for joint in motion.mechanism.joints
        for nth, parts in enumerate(_parts(joint))
    ]


def two_sided(motion: Motion) -> bool:
    """Whether friction acts on a cam that can press on either of two sides."""
    return any(isinstance(p, CamJoint) and p.closure == "form" and friction_of(p) is not None for p in motion.mechanism.joints)


def _parts(joint: Joint) -> list[tuple[Movement, ElementKind, float]]:
    """Movements that friction brakes in a joint, each with its kind of normal load and its arm [m or 1], or for a brake its effort
    [N m or N]."""
    f = friction_of(joint)
    if f is None:
        return []
    parts: list[tuple[Movement, ElementKind, float]] = []
    if isinstance(joint, Revolute | Prismatic | Cylinder):
        what: Movement = "turn" if isinstance(joint, Revolute) else "slide"
        kind: ElementKind = "pin" if what == "turn" else "guide" if isinstance(joint, Prismatic) else "drive"
        arm = f.radius if what == "turn" else 1.0
        parts = [(what, kind, arm)] if f.coefficient and arm else []
        return [*parts, (what, "brake", f.brake)] if f.brake else parts
    if isinstance(joint, CamJoint):
        roller = getattr(joint.face, "radius", 0.0) if f.radius else 0.0  # it rolls, with friction on its pin
        share = f.radius / roller if roller else 1.0
        parts = [("slide", "contact", share)]
        return parts if joint.spatial is None else [*parts, ("slide", "contact", np.sqrt(1.0 - share * share))]
    if isinstance(joint, PinSlot):
        parts = [("slide", "normal", 1.0), ("turn", "normal", f.radius)]
        return parts if f.radius else parts[:1]
    if isinstance(joint, Screw):
        return [("slide", "contact", f.radius)]
    return [("turn", "normal" if isinstance(joint, Rolling) else "contact", f.lever)]


def _factor(friction: Friction, kind: ElementKind, arm: float, coefficient: Values) -> Values:
    """Moment or force per normal load at a coefficient of friction."""
    if kind == "brake" or friction.lever:
        return arm
    return arm * (coefficient / np.sqrt(1.0 + coefficient * coefficient) if friction.exact else coefficient)


def _coefficient(friction: Friction, speed: Values) -> Values:
    """Coefficient of friction at speeds (F,) [m/s] at which the surfaces slide."""
    f = friction
    if not f.stribeck:
        return f.coefficient
    return f.coefficient + (f.static - f.coefficient) * np.exp(-((speed / f.stribeck) ** 2))


def _element(
    motion: Motion,
    joint: Joint,
    what: Movement,
    kind: ElementKind,
    arm: float,
    sense: Sense,
    flanks: Mapping[int, Values],
    nth: int,
) -> Element:
    model = motion.model
    friction = friction_of(joint)
    assert friction is not None
    j = model.joint_index.get(joint.name, -1)
    first, second = (model.index[k] for k in (joint.links if j < 0 else model.joints[j].links))  # of a cylinder: barrel and rod
    if isinstance(joint, CamJoint):
        return _of_cam(motion, joint, friction, arm, (first, second), sense, flanks, nth)
    if isinstance(joint, Screw):
        return _of_thread(motion, joint, friction, sense)
    rate = relative_rate(motion, motion.speeds, what, j, (first, second))
    along = 0j if what == "turn" else motion.guide(j) * (1.0 if model.joints[j].guide == 0 else -1.0)
    mu = _coefficient(friction, rate * friction.radius if what == "turn" else rate)
    factor, limit = (_factor(friction, kind, arm, c) for c in (mu, max(friction.static, friction.coefficient)))
    sign = sense(rate, what)
    return Element(joint.name, what, kind, friction, factor, limit, mu, (first, second), j, along, rate, sign)


def _of_thread(motion: Motion, joint: Screw, friction: Friction, sense: Sense) -> Element:
    """Sliding of the nut's thread on the spindle's, with the nut's travel as its rate: the force along the thread has a part along
    the axis and a circumferential part, a torque about the axis. Raises `MechanismError` for a self-locking thread without a
    drive."""
    model, r = motion.model, friction.radius
    lead_angle, most = np.arctan2(joint.radius, r), max(friction.static, friction.coefficient)
    driven = any(drive.joint == joint.name and not isinstance(drive.law, Free) for drive in motion.mechanism.drives)
    if not driven and most * r >= joint.radius:  # without inertia the spindle would turn as if it were unloaded
        why = f"the thread locks itself, as {most:g} is not below the tangent of its lead angle, {joint.radius / r:.4g}."
        remedy = "Drive the screw, whose spindle has no inertia here, or give a smaller coefficient or a larger lead."
        raise MechanismError(Fault(f"joints.{joint.name}.friction", why, remedy))
    j = model.joint_index[f"{joint.name}.slide"]
    owner, nut = (model.index[joint.links[k]] for k in (joint.guide, 1 - joint.guide))
    rate = relative_rate(motion, motion.speeds, "slide", j, (owner, nut))
    sine, cosine = np.sin(lead_angle), np.cos(lead_angle)
    mu = _coefficient(friction, rate / sine)
    return Element(
        joint=f"{joint.name}.thread",
        what="slide",
        kind="contact",
        friction=friction,
        factor=mu / sine,
        limit=most / sine,
        coefficient=mu,
        links=(model.index[f"{joint.name}.spindle"], nut),
        index=j,
        along=sine * sine * motion.guide(j),
        rate=rate,
        sign=sense(rate, "slide"),
        place=motion.joint_point(j),
        twist=r * sine * cosine,
        carrier=owner,
        in_plane_share=cosine,
    )


def _of_cam(
    motion: Motion,
    joint: CamJoint,
    friction: Friction,
    arm: float,
    links: tuple[int, int],
    sense: Sense,
    flanks: Mapping[int, Values],
    nth: int,
) -> Element:
    """Sliding of the follower on its cam: along the common tangent at the contact, at the difference of both surfaces' speeds.

    A roller counts as if it did not roll: the force that drags it along is the friction on its pin, taken at the same contact.
    """
    index, relation = next((i, r) for i, r in enumerate(motion.model.relations) if r.name == joint.name)
    geometry, flank = relation.geometry, np.asarray(flanks.get(index, np.ones(motion.shape)))
    mu = friction.coefficient
    factor: Values = mu * arm
    if relation.bearing is not None:
        *rubbing, seen = geometry.sliding(motion, flank)
        r, carrier = rubbing[nth], motion.model.index[relation.bearing.carrier]
        sign = sense(r.rate, "slide")
        return Element(
            joint.name, "slide", "contact", friction, factor, factor, mu, links, -1, r.along, r.rate, sign, r.place, r.twist,
            carrier, seen,
        )  # fmt: skip
    if joint.second is not None and friction.radius:  # the second roller of a conjugate pair turns on a pin of the same radius
        factor = factor * np.where(flank.real < 0.0, geometry.face.radius / joint.second[1], 1.0)
    place, direction = geometry.contact(motion, flank)
    along = 1j * unit_vectors(direction)
    rotation_class = motion.model.angles.rotation_class
    speed = [
        motion.origin_velocities[k] + 1j * motion.speeds.angular[rotation_class[k]] * (place - motion.origins[k]) for k in links
    ]
    rate = _over_frames(motion, np.real(np.conj(along) * (speed[1] - speed[0])))
    sign = sense(rate, "slide")
    return Element(joint.name, "slide", "contact", friction, factor, factor, mu, links, -1, along, rate, sign, place)


def _sign(rate: Real, least: float, peak: Callable[[ArrayLike], float]) -> Real:
    """Sign of a relative speed (F,); zero at rest, where friction is undetermined and counted as zero."""
    speed = value_of(rate)
    return np.where(np.abs(speed) <= np.maximum(REST * peak(speed), least), 0.0, np.sign(speed))


def relative_rate(motion: Motion, rates: Rates, what: Movement, j: int, links: tuple[int, int]) -> Real:
    """Rate (F,) at which an element's unit wrench does work; ``rates`` are the motion's speeds or accelerations."""
    if what == "turn":
        rotation_class = motion.model.angles.rotation_class
        value = rates.angular[rotation_class[links[1]]] - rates.angular[rotation_class[links[0]]]
    else:
        value = rates.slide[j]
    return _over_frames(motion, value)


def _over_frames(motion: Motion, value: object) -> Real:
    if not (motion.shape and isinstance(value, np.ndarray | float | int)):  # a substitute for an array
        return cast(Real, value)
    return np.array(np.broadcast_to(np.asarray(value, float), (motion.frames,)))


def _peak(values: ArrayLike) -> float:
    numbers = np.asarray(value_of(values))
    return float(np.max(np.abs(numbers), initial=0.0, where=np.isfinite(numbers)))
