"""A plane cam in its mechanism: its geometry in the axes of the carrier, the follower and the cam's link, over a motion."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Complex, Flags, Plane, Real, Values
from mechcore.cams.analysis import Bridge
from mechcore.cams.closures import SecondRoller, breadth
from mechcore.cams.contour import Contour, cam_contour
from mechcore.cams.followers import Face, Flat, Oscillating, Translating
from mechcore.cams.limits import CamLimits, Requirement, find_limits
from mechcore.cams.sizing import axis_distance, greatest, least_base, outer_flank
from mechcore.cams.synthesis import Cam, Synthesis, cam_on_base
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass
from mechcore.texts import as_angle, as_coordinate, as_length

if TYPE_CHECKING:
    from mechcore.laws.curve import MotionCurve
    from mechcore.motion.motion import Motion

LEAST_PART, RADIUS_HALVINGS = 0.01, 20  # smallest roller that is proposed, over the pitch curve's radius; bisections for it
KNOT_DISTANCE = 1e-12  # distance from a knot, relative to the law's length, below which an argument is on it


def on_knots(law: MotionCurve, x: Real) -> Real:
    """The arguments, moved onto a knot of the law where they differ from it by rounding only.

    Otherwise kinematics and contact could take different sides of a knot at which the law's derivatives jump.
    """
    knots = np.asarray(law.knots)
    local = np.mod(x - law.start, law.length) + law.start if law.repeats else x
    k = np.clip(np.searchsorted(knots, local, side="right"), 1, len(knots) - 1)
    below, above = (knots[i] if isinstance(i, np.ndarray | np.integer) else i.among(knots) for i in (k - 1, k))  # or of a symbol
    near = np.where(local - below < above - local, below, above)
    close = np.abs(near - local) < KNOT_DISTANCE * law.length
    if law.repeats:
        near = np.where(near >= knots[-1], knots[0], near)
    return np.where(close, near, x)


def argument_of(cam: object, motion: Motion) -> Real:
    """The argument of a placed cam's law (F): [rad] within one turn of ``links[0]`` on the ``carrier``, or [m] on its ``bed``."""
    return motion.over_parts(partial(_argument, cam))


def _argument(cam: Any, motion: Motion) -> Real:
    if cam.bed is not None:
        x = cam.sense * motion.state.slide[motion.model.joint_index[cam.bed]] + cam.phase
    else:
        turn = motion.rotation(motion.model.index[cam.links[0]]) * np.conj(motion.rotation(motion.model.index[cam.carrier]))
        x = cam.sense * np.angle(turn) + cam.phase
    return np.broadcast_to(x, motion.shape) + 0.0


def argument_rate_of(cam: Any, motion: Motion) -> Real:
    """The rate of the argument of a placed cam's law (F) [rad/s or m/s]."""
    if cam.bed is not None:
        return np.asarray(cam.sense * motion.coordinate(cam.bed)[:, 1])
    return np.asarray(cam.sense * (motion.velocity(cam.links[0])[:, 2] - motion.velocity(cam.carrier)[:, 2]))


def segment_of(cam: Any, motion: Motion, knots: Real | None = None) -> Real:
    """Number of the segment of the law in which a placed cam is, by frame (F); ``knots``: ends of segments, if not all knots."""
    law = cam.cam.law
    x = cam.argument(motion) * cam.law_scale
    local = np.mod(x - law.start, law.length) + law.start if law.repeats else x
    number: Real = np.multiply(np.searchsorted(cam.knots if knots is None else knots, local, side="right"), 1.0)
    return number


@dataclass(frozen=True, eq=False)
class ContactRows:
    """The contact of cam and follower over the frames (F); NaN where it is not defined.

    With two flanks (groove, yoke, conjugate pair) the values are those of the flank that carries. ``place``: in the world;
    ``normal``: from the cam to the follower. ``angle``: argument of the law; ``pressure_angle`` [rad]; ``radius`` of curvature of
    the profile [m]; ``eccentricity`` on a flat face [m]; ``coordinate``: of the follower, base included; ``lift``: above the base
    circle.
    """

    angle: Real
    place: Complex
    normal: Complex
    pressure_angle: Real
    radius: Real
    eccentricity: Real
    coordinate: Real
    lift: Real


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacedCam:
    """A plane cam in its mechanism. A point z of the theory's ground axes (origin O, translating followers move up) is
    ``centre + axes z`` on the carrier.

    A point z of the theory's axes of the cam is ``mount_origin + mount z`` in the axes of its link. A yoke touches on two opposite
    sides.
    """

    name: str
    links: tuple[str, str]
    carrier: str
    guide: str
    cam: Cam
    base: float
    centre: complex
    axes: complex
    mount_origin: complex
    mount: complex
    arm: float
    form_closed: bool
    bed: str | None
    sense: int
    phase: float
    pressure_limit: float | None
    curvature_limit: float | None = None  # least radius of the convex profile [m]
    decides: str | None = None  # the limit that decides, where the base circle is the least for its limits
    law_scale: float = 1.0  # of a wedge: the law's x over the argument
    mate: PlacedCam | None = None  # the second cam of a conjugate pair, which touches where the first would have to pull
    second: SecondRoller | None = None  # the roller that follows that cam
    given: Contour | None = None  # the profile in the theory's axes, where it is not that of the law
    bridges: tuple[Bridge, ...] = ()  # where the contact leaps on a given profile
    intended: Cam | None = None  # the cam as designed, where the cutter leaves another profile
    lost_ranges: tuple[tuple[float, float], ...] = ()  # ranges of the law's angle that the cutter removes
    knot_angles: tuple[float, ...] | None = None  # of a given profile: angles at which the law's derivatives may jump

    @property
    def scale(self) -> float:
        """Metres per unit of the follower's coordinate: 1, or the arm."""
        return self.arm or 1.0

    @property
    def mean_slope(self) -> float:
        """Mean travel of the follower per unit of the law's argument: zero, as it returns."""
        return 0.0

    @property
    def side(self) -> int:
        guide = self.cam.follower.guide
        return guide.side if isinstance(guide, Oscillating) else 0

    @property
    def face(self) -> Face:
        return self.cam.follower.face

    @property
    def offset(self) -> float:
        """Of a translating follower [m]; 0 of an oscillating one."""
        guide = self.cam.follower.guide
        return guide.offset if isinstance(guide, Translating) else 0.0

    @cached_property
    def zero(self) -> float:
        """The follower's coordinate at zero lift: at the law's start; for a given profile, the least coordinate."""
        law = self.cam.law
        if self.given is None or self.intended is not None:
            return float((law if self.intended is None else self.intended.law).pieces[0].at(0.0, 0)[0])
        return -greatest(law, lambda s: -s[0])[0]

    @property
    def yoke(self) -> bool:
        """Whether the cam runs between two parallel faces."""
        return self.form_closed and isinstance(self.cam.follower.face, Flat)

    @property
    def groove(self) -> bool:
        """Whether the knife or roller runs in a groove."""
        return self.form_closed and not self.yoke and self.mate is None

    def other_profiles(self, cam: Cam) -> tuple[Cam, ...]:
        """The other profiles of the joint beside ``cam``: the outer flank of a groove, the second cam of a conjugate pair, or
        none."""
        if self.second is not None:
            return (self.second.cam(cam),)
        return outer_flank(cam) if self.groove else ()

    @property
    def profiles(self) -> tuple[Cam, ...]:
        """All profiles that the follower touches, the first one first; the other face of a yoke touches the same profile."""
        return (self.cam, *self.other_profiles(self.cam))

    def limits(self, profile: Cam, count: int = 3600) -> CamLimits:
        """Extremes of one of the `profiles`, each at the law's argument."""
        limits = find_limits(profile, count=count)
        return limits.mirrored() if self.law_scale < 0.0 else limits

    @cached_property
    def contour(self) -> Contour:
        """The profile in the theory's axes of the cam; of a groove, its inner flank."""
        return cam_contour(self.cam) if self.given is None else self.given

    @property
    def knots(self) -> Real:
        """Arguments within the law's range between which all its derivatives are continuous."""
        return np.asarray(self.cam.law.knots if self.knot_angles is None else self.knot_angles)

    # -- the law ------------------------------------------------------------------------------------------------------

    def law(self, argument: ArrayLike) -> Real:
        """The follower's coordinate and its first two derivatives with respect to the cam's coordinate, (3, ...)."""
        x, known = self.known_arguments(argument)
        s = self.cam.law(x, 2)
        s[1] *= self.law_scale
        return np.where(known, s, np.nan)

    def known_arguments(self, argument: ArrayLike) -> tuple[Real, Flags]:
        """The law's x at arguments, by `on_knots`, with the law's start in place of NaN; and which of them are not NaN."""
        x = on_knots(self.cam.law, np.multiply(argument, self.law_scale))
        known = np.isfinite(x)
        return np.where(known, x, self.cam.law.start), known

    def check(self, *, second: bool = False) -> None:
        """Raises where the cam cannot be cut, or where a yoke does not fit; ``second``: it is the second cam of a conjugate pair,
        whose base circle follows from the first."""
        cam, face, guide = self.cam, self.cam.follower.face, self.cam.follower.guide
        if cam.law.extended:  # moved for derivatives: pieces that do not join are no corners
            return
        if self.yoke:
            if isinstance(guide, Oscillating) or abs(face.tilt) > 0.0:  # type: ignore[union-attr]  # flat here
                raise MechanismError(Fault("cam", "a yoke of flat faces slides, its faces across.", "Give closure = 'force'."))
            b = breadth(cam.law)
            if not b.constant(1e-7):
                raise MechanismError(
                    Fault(
                        "cam",
                        f"the breadth of the cam varies by {as_length(2.0 * b.deviation)} (at {as_angle(b.angle)}): "
                        "a yoke would jam or rattle.",
                        "Make the sum of the lifts half a turn apart constant, or give closure = 'force'.",
                    )
                )
        if self.given is not None:
            return
        if self.mate is not None:
            self.mate.check(second=True)
        if not (second or cam.wedge or isinstance(face, Flat)) and axis_distance(cam) <= 0.0:
            why = f"on a base circle of {as_length(self.base)} the profile comes to the cam's axis, or its follower beyond it."
            raise MechanismError(Fault("cam.base", why, f"{self._remedy()}. Leave room for the shaft."))
        for profile in self.profiles if self.groove and cam.follower.radius else (cam,):
            limits = self.limits(profile, 720)
            if not limits.undercut:
                continue
            if limits.sharpness.value == -math.inf and not second:
                raise MechanismError(self._corner(limits.sharpness.angle))
            where = f"at {as_coordinate(limits.sharpness.angle, rotary=not cam.wedge)}"
            greatest = limits.greatest_roller
            if isinstance(face, Flat) or greatest is None:
                why = f"the profile of a base circle of {as_length(self.base)} is undercut {where}."
                raise MechanismError(Fault("cam.base", why, f"{self._remedy()}."))
            most, larger = greatest.value if second else self._largest_radius(greatest.value, profile.outer), self._remedy()
            smaller = [] if most is None else [f"Give at most {as_length(most)}"]
            remedy = ", or ".join(smaller if second else [*smaller, larger[0].lower() + larger[1:] if smaller else larger])
            raise MechanismError(
                Fault(
                    "cam.second" if second else "cam.radius",
                    f"the profile is undercut {where}: a radius of {as_length(cam.follower.radius)} on a pitch curve of radius "
                    f"{as_length(greatest.value)}.",
                    f"{remedy}.",
                )
            )

    def _corner(self, angle: float) -> Fault:
        """The fault of a law whose velocity jumps down, so that the profile folds at any size."""
        left, right = self.cam.law(angle, 1, "left")[1], self.cam.law(angle, 1)[1]
        rotary = isinstance(self.cam.follower.guide, Oscillating)
        before, after = (as_coordinate(float(v), rotary=rotary, digits=4) for v in (left, right))
        size = "" if self.cam.wedge else f" from {before} to {after} per radian"
        at = as_coordinate(angle, rotary=not self.cam.wedge)
        return Fault(
            "cam.lift",
            f"its velocity falls at {at}{size}: a corner on a cam of any size.",
            "Let both sides meet there with one velocity, or let a knife follow it.",
        )

    def _largest_radius(self, most: float, outer: bool) -> float | None:
        """The largest roller radius [m] up to ``most`` that follows the law on the same base circle, on which a smaller roller has
        a smaller pitch curve; None where none does."""
        cam = self.cam
        if cam.wedge:
            return most
        lift = cam.law.raised(-cam.follower.base_coordinate(self.base))

        def follows(radius: float) -> bool:
            follower = replace(cam.follower, face=replace(self.face, radius=radius))  # type: ignore[arg-type]  # round here
            try:
                made = cam_on_base(lift, follower, self.base, cam.turn, outer)
            except MechanismError:
                return False
            return axis_distance(made) > 0.0 and not find_limits(made, count=360).undercut

        low, high = LEAST_PART * most, most
        if not follows(low):
            return None
        for _ in range(RADIUS_HALVINGS):
            middle = math.sqrt(low * high)
            low, high = (middle, high) if follows(middle) else (low, middle)
        return low

    def _remedy(self) -> str:
        """A remedy that gives the least base circle without undercut, in words without a full stop."""
        if self.cam.wedge:
            return "Stretch the segments"
        try:
            zero = self.cam.follower.base_coordinate(self.base)
            fits = least_base(
                self.cam.law.raised(-zero), self.cam.follower, Requirement(), self.cam.turn, beside=self.other_profiles
            )
        except MechanismError:
            return "Take a smoother law or longer segments"
        return f"Give a base circle of at least {as_length(fits.base)}"

    # -- over a motion ------------------------------------------------------------------------------------------------

    def argument(self, motion: Motion) -> Real:
        """The law's argument (F): [rad] within one turn, or [m]."""
        return argument_of(self, motion)

    def segment(self, motion: Motion) -> Real:
        """Number of the segment of the law in which the cam is, by frame (F)."""
        return segment_of(self, motion)

    def at(self, motion: Motion) -> Synthesis:
        """The cam at every frame."""
        x, known = self.known_arguments(self.argument(motion))
        synthesis = self.cam.at(x)
        return synthesis if np.all(known) else replace(synthesis, motion=np.where(known, synthesis.motion, np.nan))

    def to_world(self, motion: Motion, z: Plane) -> Plane:
        """Points of the theory's ground axes in the world."""
        return motion.of_point(motion.model.index[self.carrier], 0j) + motion.rotation(motion.model.index[self.carrier]) * (
            self.centre + self.axes * z
        )

    def contact(self, motion: Motion, multiplier: Values) -> tuple[Plane, Plane]:
        """Where the force acts, and the force on the follower per unit of the multiplier, which is its component along the lift
        (or its moment over the arm)."""
        s = self.at(motion)
        n, touch = s.ground_normal, s.contact
        guide, carried = self.cam.follower.guide, cast(Real, np.real(multiplier))
        away = -1j * self.side * (touch - guide.pivot) if isinstance(guide, Oscillating) else 1j
        with np.errstate(divide="ignore", invalid="ignore"):
            direction = self.scale * n / np.real(np.conj(n) * away)
        if self.form_closed:
            pressed = carried >= 0.0
            other, flip = self._other(motion, s)
            far = flip * other.contact
            if self.mate is not None:
                normal = flip * other.ground_normal
                if isinstance(guide, Oscillating):
                    away = -1j * self.side * (far - guide.pivot)
                with np.errstate(divide="ignore", invalid="ignore"):
                    pulls = self.scale * normal / np.real(np.conj(normal) * away)
                direction = np.where(pressed, direction, pulls)
            touch = np.where(pressed, touch, far)
        world = self.axes * motion.rotation(motion.model.index[self.carrier])
        return self.to_world(motion, touch), direction * world

    def pressing(self, motion: Motion, reaction: Complex) -> Real:
        """Force along the common normal (F) [N] from the reaction on the follower, positive where the cam presses on it."""
        along = np.real(reaction * np.conj(self.rows(motion).normal))
        if self.mate is None:
            return along
        # either roller is pressed along the normal of its own cam, and the two may be less than a right angle apart
        other = np.real(reaction * np.conj(self.rows(motion, -1.0).normal))
        return np.where(other > along, -1.0, 1.0) * np.abs(reaction)

    def _other(self, motion: Motion, s: Synthesis) -> tuple[Synthesis, complex]:
        """The other flank of a groove, face of a yoke or cam of a pair, and the number that turns its ground axes into these."""
        if self.mate is not None:
            return self.mate.at(motion), self.mate.axes / self.axes
        if self.yoke:
            return self.cam.at(s.angle + math.pi), -1.0
        return replace(s, cam=replace(self.cam, outer=True)), 1.0

    def pressure_angles(self, motion: Motion) -> dict[str, Real]:
        """Pressure angles (F) [rad] to which a limit applies, by words that name the cam: of a conjugate pair those of both cams,
        whichever carries."""
        own = self.at(motion).pressure_angle
        return {"": own} if self.mate is None else {"": own, " of the second cam": self.mate.at(motion).pressure_angle}

    def rows(self, motion: Motion, multiplier: Values = 1.0) -> ContactRows:
        """The contact over a motion; the sign of ``multiplier`` gives the flank that carries."""
        return motion.over_parts(self._rows, np.broadcast_to(multiplier, (motion.frames,)))

    def _rows(self, motion: Motion, multiplier: Values) -> ContactRows:
        s = self.at(motion)
        place = self.contact(motion, multiplier)[0]
        world = self.axes * motion.rotation(motion.model.index[self.carrier])
        normal, pressure_angle, radius = s.ground_normal, s.pressure_angle, s.radius
        if self.form_closed:
            pressed = cast(Real, np.real(multiplier)) >= 0.0
            other, flip = self._other(motion, s)
            normal = np.where(pressed, normal, other.cam.flank * flip * other.ground_normal)
            pressure_angle = np.where(pressed, pressure_angle, other.pressure_angle)
            radius = np.where(pressed, radius, other.radius)
        return ContactRows(
            angle=self.argument(motion),
            place=np.array(np.broadcast_to(place, (motion.frames,))),
            normal=np.array(np.broadcast_to(normal * world, (motion.frames,))),
            pressure_angle=pressure_angle,
            radius=radius,
            eccentricity=s.distance,
            coordinate=s.motion[0],
            lift=s.motion[0] - self.zero,
        )
