"""Inverse cams in their mechanisms, and the base of all placed rollers that run in grooves or on ribs."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Complex, Flags, Plane, Real, Values, unit_vectors
from mechcore.cams.followers import Roller
from mechcore.cams.placement.plane import ContactRows, argument_of, on_knots, segment_of
from mechcore.cams.spatial import InverseCam, SpatialCam
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass
from mechcore.texts import as_coordinate, as_length

if TYPE_CHECKING:
    from mechcore.motion.motion import Motion


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacedRoller:
    """A roller in a groove or on a rib, in its mechanism. ``links`` are those of the joint. A point w of the theory's ground axes
    in the plane is ``centre + axes w`` on the ``carrier``; ``guide`` is the joint that guides the driven link, ``bed`` the one on
    which a driving link slides.

    ``mount_origin``: where the theory's origin lies in the axes of the link that carries the groove.
    """

    name: str
    links: tuple[str, str]
    carrier: str
    guide: str
    cam: InverseCam | SpatialCam  # the theory: its ``law`` [m or rad] of the driving coordinate, and the roller's ``radius`` [m]
    centre: complex
    axes: complex
    mount_origin: complex
    sense: int
    pressure_limit: float | None
    form_closed: bool
    base: float = 0.0
    phase: float = 0.0
    bed: str | None = None
    law_scale: float = 1.0
    bridges: tuple[Any, ...] = ()
    lost_ranges: tuple[Any, ...] = ()
    intended: None = None
    mate: None = None

    @property
    def mean_slope(self) -> float:
        """Mean travel of the driven coordinate per unit of the law's argument; 0 where it returns."""
        return 0.0

    @property
    def side(self) -> int:
        return 1

    @property
    def face(self) -> Roller:
        return Roller(self.cam.radius)

    @property
    def knots(self) -> Real:
        return np.asarray(self.cam.law.knots)

    def law(self, argument: ArrayLike) -> Real:
        """The driven coordinate and its first two derivatives with respect to the law's argument, (3, ...)."""
        x, known = self.known_arguments(argument)
        values, law = self.cam.law(x, 2), self.cam.law
        if law.repeats and law.advance != 0.0:  # arguments on a knot are those of the first cycle
            values[0] += law.advance * np.rint((np.where(known, argument, x) - x) / law.length)
        return np.where(known, values, np.nan)

    def known_arguments(self, argument: ArrayLike) -> tuple[Real, Flags]:
        """Arguments by `on_knots`, with the law's start in place of NaN; and which of them are not NaN."""
        x = on_knots(self.cam.law, np.multiply(argument, 1.0))
        known = np.isfinite(x)
        return np.where(known, x, self.cam.law.start), known

    def argument(self, motion: Motion) -> Real:
        """The law's argument (F): [rad] within one turn, or [m] of a driving link that slides."""
        return argument_of(self, motion)

    def segment(self, motion: Motion) -> Real:
        """Number of the segment of the law in which the cam is, by frame (F)."""
        return segment_of(self, motion)

    def world(self, motion: Motion) -> Plane:
        """Direction of the theory's first axis in the world (F), complex."""
        return self.axes * motion.rotation(motion.model.index[self.carrier])

    def to_world(self, motion: Motion, w: Plane) -> Plane:
        """Places of the theory's ground axes in the world."""
        k = motion.model.index[self.carrier]
        return motion.of_point(k, 0j) + motion.rotation(k) * (self.centre + self.axes * w)


STEEPEST = np.radians(89.0)  # pressure angle from which on a groove cannot drive


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacedInverse(PlacedRoller):
    """``links`` are (crank or slide, driven link). A point z of the driven link's theory is ``mount_origin + mount z`` in its own
    axes; ``tip`` is the roller's centre on the driving link."""

    cam: InverseCam
    travel: tuple[float, float]  # of the driving link over which the law is given; beyond it the driven link rests
    mount: complex
    tip: complex
    form_closed: bool = True

    @property
    def scale(self) -> float:
        """Metres per unit of the driven link's coordinate: 1, or the theory's arm."""
        return self.cam.crank if self.cam.turns else 1.0

    @property
    def arm(self) -> float:
        return self.cam.crank if self.cam.turns else 0.0

    @cached_property
    def zero(self) -> float:
        """The driven coordinate at the start of its law."""
        return float(self.cam.law(self.travel[0], 0)[0])

    def check(self) -> None:
        """Raises where the roller reaches the driven link's pivot, jams in its groove, or undercuts a flank."""
        theta = np.linspace(*self.travel, 721)
        if self.cam.turns:
            pin = self.cam.pin(theta, 0)[0]
            step = np.diff(pin)
            way = np.clip(-np.real(pin[:-1] * np.conj(step)) / np.abs(step) ** 2, 0.0, 1.0)
            far = np.abs(pin[:-1] + way * step)
            k = int(np.argmin(far))
            if far[k] <= max(self.cam.radius, 1e-9 * self.cam.crank):
                raise MechanismError(
                    Fault(
                        "cam.radius",
                        f"at {self._where(theta[k])} the roller of {as_length(self.cam.radius)} reaches the driven link's pivot,"
                        f" {as_length(far[k])} from its centre: a groove there could not turn the link.",
                        "Move the driven link's pivot off the roller's way, or give a smaller range.",
                    )
                )
        steep = self.cam.pressure_angle(theta)
        k = int(np.argmax(steep))
        if not steep[k] < STEEPEST:
            raise MechanismError(
                Fault(
                    "cam.lift", f"at {self._where(theta[k])} the groove lies along the motion: no drive.",
                    "Move the driven link's pivot or guide off the roller's way, or give a smaller range.",
                )
            )  # fmt: skip
        for side in (1, -1):
            d = self.cam.pitch(theta, 2)
            with np.errstate(divide="ignore"):  # a straight slot
                radius = np.abs(d[1]) ** 3 / np.imag(np.conj(d[1]) * d[2]) * side
            sharp = (radius > 0.0) & (radius < self.cam.radius)
            if sharp.any():
                k = int(np.argmax(sharp))
                raise MechanismError(
                    Fault(
                        "cam.radius",
                        f"a roller of {as_length(self.cam.radius)} undercuts the groove at {self._where(theta[k])}.",
                        f"Give less than {as_length(float(radius[radius > 0.0].min()))}.",
                    )
                )

    def argument(self, motion: Motion) -> Real:
        """The law's argument (F): of a crank [rad] within half a turn of the middle of its travel, of a slide [m]."""
        return self._near(super().argument(motion))

    def known_arguments(self, argument: ArrayLike) -> tuple[Real, Flags]:
        return super().known_arguments(self._near(cast(Real, argument)))

    def _near(self, x: Real) -> Real:
        """Angles of a crank reduced to the turn about the middle of its travel, however far the crank has turned."""
        middle = 0.5 * (self.travel[0] + self.travel[1])
        return x if self.bed is not None else x - 2.0 * np.pi * np.rint((x - middle) / (2.0 * np.pi))

    def _where(self, x: float) -> str:
        return f"{as_coordinate(x, rotary=self.bed is None)} of the {'crank' if self.bed is None else 'slide'}"

    def _at(self, motion: Motion) -> tuple[Complex, Complex, Plane]:
        """Roller's centre, normal of the groove, and velocity of a driven point there per unit rate of its coordinate, in the
        theory's ground axes."""
        theta, known = self.known_arguments(self.argument(motion))
        pin, q = self.cam.pin(theta, 0)[0], self.cam.law(theta, 0)[0]
        turned = np.exp(1j * q) if self.cam.turns else 1.0
        lost = np.where(known, 1.0, np.nan)
        return pin * lost, turned * self.cam.normal(theta), 1j * pin if self.cam.turns else 1j

    def contact(self, motion: Motion, multiplier: Values) -> tuple[Plane, Plane]:
        """Where the roller presses on its flank, and the force on the driven link per multiplier."""
        pin, n, away = self._at(motion)
        with np.errstate(divide="ignore", invalid="ignore"):
            direction = self.scale * n / np.real(np.conj(n) * away)
        push = unit_vectors(direction) * np.where(cast(Real, np.real(multiplier)) >= 0.0, 1.0, -1.0)
        world = self.world(motion)
        return self.to_world(motion, pin + self.cam.radius * push), direction * world

    def pressing(self, motion: Motion, reaction: Complex) -> Real:
        """Force along the normal (F) [N], positive where it drives the link towards larger coordinates."""
        return np.asarray(np.real(reaction * np.conj(self.rows(motion).normal)))

    def pressure_angles(self, motion: Motion) -> dict[str, Real]:
        """The pressure angle (F) [rad], the same on both flanks."""
        return {"": self.rows(motion).pressure_angle}

    def rows(self, motion: Motion, multiplier: Values = 1.0) -> ContactRows:
        """The contact over a motion; the sign of ``multiplier`` gives the flank that carries."""
        return motion.over_parts(self._rows, np.broadcast_to(multiplier, (motion.frames,)))

    def _rows(self, motion: Motion, multiplier: Values) -> ContactRows:
        angle, s = self.argument(motion), self.law(self.argument(motion))
        _, n, away = self._at(motion)
        ahead = np.sign(np.real(np.conj(n) * away))
        left = ahead * np.where(cast(Real, np.real(multiplier)) >= 0.0, 1.0, -1.0) > 0.0
        n = n * ahead
        world = self.world(motion)
        known = np.where(np.isfinite(angle), angle, self.cam.law.start)
        return ContactRows(
            angle=angle,
            place=np.array(np.broadcast_to(self.contact(motion, multiplier)[0], angle.shape)),
            normal=np.array(np.broadcast_to(n * world, angle.shape)),
            pressure_angle=self.cam.pressure_angle(known) * np.where(np.isfinite(angle), 1.0, np.nan),
            radius=np.where(left, self.cam.flank_radius(known, 1), self.cam.flank_radius(known, -1)),
            eccentricity=np.full(angle.shape, np.nan),
            coordinate=s[0],
            lift=s[0] - self.zero,
        )
