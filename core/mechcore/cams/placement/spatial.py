"""Spatial cams in their mechanisms: rollers in grooves and on ribs, their laws, places and rolling."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Complex, Flags, Plane, Real, Values, unit_vectors
from mechcore.cams.followers import Roller
from mechcore.cams.placement.inverse import PlacedInverse, PlacedRoller
from mechcore.cams.placement.plane import ContactRows, PlacedCam
from mechcore.cams.spatial import LAYERS, Flank, Globoid, SpatialCam, SpatialLimits, spatial_limits
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass
from mechcore.texts import as_angle, as_length

if TYPE_CHECKING:
    from mechcore.motion.motion import Motion
    from mechcore.spec.mechanism import SpatialBlank

RIB_WIDTH = 0.05  # least width of a rib, over the distance of the two rollers beside it


def room_of_rollers(blank: SpatialBlank, arm: float, inner: float) -> float:
    """The radius [m] of a turret's rollers from which on there is no room for a rib between two; infinite for a single roller.

    ``arm``: distance of the rollers' middles from the pivot, ``inner``: that of the inner ends of a globoid's rollers [m].
    """
    if not blank.rollers:
        return np.inf
    return (1.0 - RIB_WIDTH) * (inner if blank.kind == "globoid" else arm) * float(np.sin(np.pi / blank.rollers))


@dataclass(frozen=True, eq=False)
class FlankSliding:
    """One direction of sliding of the roller on its flank over the frames (F). Unit friction in it on the follower is the force
    ``along`` in the plane at ``place``, the opposite on the cam there, and the couple ``twist`` [m] on the cam against the carrier.

    ``rate``: of sliding, follower against cam [m/s].
    """

    place: Plane
    along: Plane
    twist: Real
    rate: Values


@dataclass(frozen=True, eq=False)
class _Touch:
    """The contact of roller and flank in the theory's ground axes (F, 3): ``axis`` point in the middle of the roller, ``normal``
    from the cam to the roller on the lifting flank, direction ``a`` of the roller's axis; ``lift``: velocity of the follower there
    for a unit rate of its coordinate, over the arm."""

    axis: Real
    normal: Real
    a: Real
    lift: Real


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacedSpatial(PlacedRoller):
    """A spatial cam in its mechanism. A point w = y + i z (barrel) or x + i z (globoid) of the theory's ground axes is
    ``centre + axes w`` in the plane, so that the cam's axis has the direction ``1j axes``; ``centre`` is the cam's pin on the
    carrier, ``mount_origin`` on the cam's link.
    """

    cam: SpatialCam
    blank: SpatialBlank
    pivot: complex | None  # of an arm, on the carrier
    arm: float

    @property
    def scale(self) -> float:
        """Metres per unit of the follower's coordinate: 1, or the arm."""
        return self.arm or 1.0

    @cached_property
    def zero(self) -> float:
        """The follower's coordinate at the start of its law."""
        return float(self.cam.law.pieces[0].at(0.0, 0)[0])

    @property
    def middle(self) -> float:
        """The middle of the roller along its axis [m]."""
        return 0.5 * (self.cam.inner + self.cam.outer)

    @property
    def mean_slope(self) -> float:
        """Mean rotation of a turret per angle of the cam; 0 for a follower that returns."""
        return self.cam.law.advance / self.cam.law.length if self.blank.rollers else 0.0

    def argument(self, motion: Motion) -> Real:
        """The law's argument (F) [rad], within one turn; of a turret within the turn in which the first of its rollers passes."""
        x, law = super().argument(motion), self.cam.law
        return np.mod(x - law.start, law.length) + law.start if self.blank.rollers else x

    def limits(self, count: int = 720, layers: int = LAYERS) -> list[SpatialLimits]:
        """Extremes over the flanks of the roller; for a turret then those over the flanks of the rollers before and after it, on
        the far sides of the ribs beside the middle."""
        cams = [(self.cam, (1, -1) if self.form_closed else (1,))]
        if self.blank.rollers:
            step = 2.0 * np.pi / self.blank.rollers
            cams += [(replace(self.cam, law=self.cam.law.raised(side * step)), (side,)) for side in (1, -1)]
        return [spatial_limits(cam, sides, count, layers) for cam, sides in cams]

    def greatest_roller(self, limits: list[SpatialLimits]) -> float:
        """The radius [m] from which on rollers undercut a flank, or leave no room for a rib between two rollers of a turret."""
        room = room_of_rollers(self.blank, self.arm, self.cam.inner)
        return min(room, *(each.greatest_roller.value for each in limits))

    def check(self) -> None:
        """Raises where the flanks cannot be cut by the roller."""
        reached = self.limits(count=360, layers=5)
        limits = min(reached, key=lambda each: each.sharpness.value)
        if not limits.undercut:
            return
        most = self.greatest_roller(reached)
        raise MechanismError(
            Fault(
                "cam.radius",
                f"a roller of {as_length(self.cam.radius)} undercuts the flank at {as_angle(limits.sharpness.angle)}.",
                f"Give at most {as_length(most)}, a larger cam, or longer segments.",
            )
        )

    # -- in space -----------------------------------------------------------------------------------------------------

    def _flank(self, motion: Motion, side: int = 1) -> Flank:
        return self.cam.flank(self.known_arguments(self.argument(motion))[0], [self.middle], side)

    def _touch(self, motion: Motion) -> _Touch:
        flank = self._flank(motion)
        lost = np.where(np.isfinite(self.argument(motion)), 1.0, np.nan)[:, None]
        axis, a = (flank._axis[k][:, 0] for k in (0, 2))
        return _Touch(axis * lost, flank._normals[0][:, 0] * lost, a, self.cam.mount.carried(axis) / self.scale)

    def _shadow(self, x: Real) -> Complex:
        """Projections (F) of vectors (F, 3) on the plane."""
        first = x[:, 0] if isinstance(self.cam.mount, Globoid) else x[:, 1]
        return np.asarray(first + 1j * x[:, 2])

    def _point(self, t: _Touch, pulls: Flags) -> Real:
        """Where the roller touches (F, 3): on the lifting flank, or on the other one where it pulls."""
        sign = np.where(pulls, -1.0, 1.0)[:, None]
        point = t.axis - sign * self.cam.radius * t.normal
        if self.blank.kind == "rib":  # one roller on either side
            point = point + sign * (0.5 * self.blank.thickness + self.cam.radius) * np.array([0.0, 0.0, 1.0])
        return np.asarray(point)

    # -- in the plane -------------------------------------------------------------------------------------------------

    def contact(self, motion: Motion, multiplier: Values) -> tuple[Plane, Plane]:
        """Where the roller touches, and the force there on the follower per multiplier, which is its component along the lift."""
        t = self._touch(motion)
        pulls = np.asarray(multiplier).real < 0.0 if self.form_closed else np.zeros(motion.frames, bool)
        at = self._shadow(self._point(t, np.broadcast_to(pulls, (motion.frames,))))
        force = self._shadow(t.normal) / np.einsum("fi,fi->f", t.normal, t.lift)
        return self.to_world(motion, at), force * self.world(motion)

    def couple(self, motion: Motion, place: Plane, force: Plane) -> Values:
        """Couple [N m] on the cam that its bearings carry, under a force along the normal on the follower: the moment in the plane
        about the cam's pin less that about the cam's axis."""
        t = self._touch(motion)
        n = self._shadow(t.normal) * self.world(motion)
        size = np.real(np.conj(n) * force) / np.abs(n) ** 2
        turning = t.axis[:, 0] * t.normal[:, 1] - t.axis[:, 1] * t.normal[:, 0]
        couple: Values = np.imag(np.conj(place - self.to_world(motion, 0.0)) * force) - size * turning
        return couple

    def _twist(self, at: Real, direction: Real) -> Real:
        w, f = self._shadow(at), self._shadow(direction)
        turning = at[:, 0] * direction[:, 1] - at[:, 1] * direction[:, 0]
        return np.asarray(np.imag(np.conj(w) * f) - turning)

    def sliding(self, motion: Motion, flank: Values) -> tuple[FlankSliding, FlankSliding, Real]:
        """The sliding of roller and flank across the roller's axis, where it becomes rolling, and along the axis; and
        `in_plane_share` (F). ``flank``: negative where the other flank of a groove is pressed.

        A roller slides along its axis because the contact does not lie on the axis: at a pressure angle alpha the cam's surface
        there has the speed omega r sin(alpha) along a radial roller.
        """
        t = self._touch(motion)
        pulls = (
            np.broadcast_to(np.asarray(flank).real < 0.0, (motion.frames,)) if self.form_closed else np.zeros(motion.frames, bool)
        )
        point = self._point(t, pulls)
        speed, rotation_class = motion.speeds.angular, motion.model.angles.rotation_class
        turning = speed[rotation_class[motion.model.index[self.links[0]]]] - speed[rotation_class[motion.model.index[self.carrier]]]
        rise = self.sense * self.law(self.argument(motion))[1][:, None]  # of the follower's coordinate, by the cam's angle
        slip = rise * self.cam.mount.carried(point) - np.cross([0.0, 0.0, 1.0], point)
        directions = [
            FlankSliding(
                place=self.to_world(motion, self._shadow(point)),
                along=self._shadow(d) * self.world(motion),
                twist=self._twist(point, d),
                rate=turning * np.einsum("fi,fi->f", d, slip),
            )
            for d in (np.cross(t.a, t.normal), t.a)
        ]
        return directions[0], directions[1], self.in_plane_share(motion)

    def in_plane_share(self, motion: Motion) -> Real:
        """Share of the normal force that lies in the plane (F)."""
        return np.abs(self._shadow(self._touch(motion).normal))

    def pressing(self, motion: Motion, reaction: Complex) -> Real:
        """Force along the normal in space (F) [N] from the frictionless reaction on the follower; positive: the lifting flank."""
        return motion.over_parts(self._pressing, reaction)

    def _pressing(self, motion: Motion, reaction: Complex) -> Real:
        n = self._shadow(self._touch(motion).normal) * self.world(motion)
        return np.asarray(np.real(reaction * np.conj(n)) / np.abs(n) ** 2)

    def pressure_angles(self, motion: Motion) -> dict[str, Real]:
        """The largest pressure angle (F) [rad] over the roller's length, as `spatial_limits` has it; the same on both flanks."""
        angle = self.argument(motion)
        steep = np.abs(self.cam.flank(self.known_arguments(angle)[0], self.cam.places(LAYERS)).pressure_angle).max(axis=1)
        return {" over the roller's length": np.where(np.isfinite(angle), steep, np.nan)}

    def rows(self, motion: Motion, multiplier: Values = 1.0) -> ContactRows:
        """The contact in the middle of the roller over a motion; ``place`` is that of the roller's axis, projected on the plane."""
        return motion.over_parts(self._rows, np.broadcast_to(multiplier, (motion.frames,)))

    def curvature_sum(self, motion: Motion, multiplier: Values) -> Real:
        """Sum of the principal curvatures of the flank that carries (F) [1/m] in the middle of the roller."""

        def own(part: Motion, sign: Values) -> Real:
            return self._carrying(part, sign, lambda flank: flank.curvature_sum)

        return motion.over_parts(own, np.broadcast_to(multiplier, (motion.frames,)))

    def _carrying(self, motion: Motion, multiplier: Values, values: Callable[[Flank], Real]) -> Real:
        """Values (F) in the middle of the roller on the flank that carries."""
        own = values(self._flank(motion))[:, 0]
        if not self.form_closed:
            return own
        return np.where(np.asarray(multiplier).real < 0.0, values(self._flank(motion, -1))[:, 0], own)

    def _rows(self, motion: Motion, multiplier: Values) -> ContactRows:
        angle = self.argument(motion)
        s, flank = self.law(angle), self._flank(motion)
        lost = ~np.isfinite(angle)
        across = self._carrying(motion, multiplier, lambda each: each.curvature_across)
        with np.errstate(divide="ignore"):
            radius = 1.0 / across
        t = self._touch(motion)
        normal = self._shadow(t.normal) * self.world(motion)
        return ContactRows(
            angle=angle,
            place=np.asarray(self.to_world(motion, self._shadow(t.axis))),
            normal=unit_vectors(normal),
            pressure_angle=np.where(lost, np.nan, flank.pressure_angle[:, 0]),
            radius=np.where(lost, np.nan, radius),
            eccentricity=np.full(angle.shape, np.nan),
            coordinate=s[0],
            lift=s[0] - self.zero,
        )


def roller_speed(motion: Motion, cam: PlacedCam | PlacedInverse | PlacedSpatial, force: Values = 1.0, above: int = 0) -> Real:
    """Angular velocity of the roller in the world (F) [rad/s]: its surface moves with the cam's where they touch.

    ``force``: along the normal (F); where it is negative the far flank of a groove carries, and the roller turns in the other
    sense. Of a conjugate pair: the first roller; that of its second cam is the roller of ``cam.mate``. Of an inverse cam: the
    roller on the crank. Of barrel, rib and end cams: about the axis towards the viewer, in the middle of the roller; ``above`` 1
    or -1: on which side of a rib the roller lies, along the cam's axis. Of a globoid: relative to the arm, about the direction
    from its pivot to the roller. Raises ``ValueError`` where the face is no roller.
    """
    if not isinstance(cam.face, Roller):
        raise ValueError(f"'{cam.name}' has no roller")
    if isinstance(cam, PlacedInverse):
        return _in_slot(motion, cam, force)
    if isinstance(cam, PlacedSpatial):
        return _in_space(motion, cam, force, above)
    radius = cam.face.radius
    s = cam.at(motion)
    world = cam.axes * motion.rotation(motion.model.index[cam.carrier])
    normal, centre = s.ground_normal * world, cam.to_world(motion, s.reference[0])
    flank = np.where(np.asarray(force) < 0.0, -1.0, 1.0) if cam.groove else 1.0
    place = centre - flank * radius * normal
    rotation_class = motion.model.angles.rotation_class
    k, f = (motion.model.index[name] for name in cam.links)

    def velocity(link: int, at: Plane) -> Plane:
        return motion.origin_velocities[link] + 1j * motion.speeds.angular[rotation_class[link]] * (at - motion.origins[link])

    tangent = 1j * normal
    slip = np.real(np.conj(tangent) * (velocity(f, centre) - velocity(k, place)))
    return np.array(np.broadcast_to(flank * slip / radius, (motion.frames,)))


def _moved(motion: Motion, link: str, at: Plane) -> Plane:
    """Velocity [m/s] of a link's material at a place of the world."""
    k = motion.model.index[link]
    return motion.origin_velocities[k] + 1j * motion.speeds.angular[motion.model.angles.rotation_class[k]] * (
        at - motion.origins[k]
    )


def _in_slot(motion: Motion, cam: PlacedInverse, force: Values) -> Real:
    crank, driven = cam.links
    k = motion.model.index[crank]
    centre = motion.origins[k] + motion.rotation(k) * cam.tip
    place = cam.contact(motion, np.broadcast_to(np.asarray(force, float), (motion.frames,)))[0]
    slip = _moved(motion, driven, place) - _moved(motion, crank, centre)
    out = (place - centre) / cam.face.radius
    return np.array(np.broadcast_to(np.real(np.conj(1j * out) * slip) / cam.face.radius, (motion.frames,)))


def _in_space(motion: Motion, cam: PlacedSpatial, force: Values, above: int) -> Real:
    """`roller_speed` of a spatial cam: sliding across the axis becomes rolling; an arm beside a barrel adds its own rotation."""
    flank = np.broadcast_to(np.asarray(above or force, float), (motion.frames,))
    across, _, _ = cam.sliding(motion, flank)
    side = np.where(flank < 0.0, -1.0, 1.0) if cam.form_closed else 1.0
    arm = (
        0.0
        if cam.blank.kind == "globoid"
        else motion.speeds.angular[motion.model.angles.rotation_class[motion.model.index[cam.links[1]]]]
    )
    return np.array(np.broadcast_to(side * across.rate / cam.face.radius + arm, (motion.frames,)))


def roller_angle(motion: Motion, cam: PlacedCam | PlacedInverse | PlacedSpatial, force: Values = 1.0, above: int = 0) -> Real:
    """Angle (F) [rad] by which the roller has turned against its link since the first frame, by the trapezoidal rule."""
    link = cam.links[0] if isinstance(cam, PlacedInverse) else cam.links[1]
    own = np.broadcast_to(np.asarray(motion.velocity(link)[:, 2], float), (motion.frames,))
    if isinstance(cam, PlacedSpatial) and cam.blank.kind == "globoid":
        own = np.zeros(motion.frames)  # the arm turns about another axis
    rate = roller_speed(motion, cam, force, above) - own
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(motion.time)
    return np.concatenate([[0.0], np.cumsum(steps)])
