"""A spatial cam in a plane mechanism: a barrel, end or globoidal cam whose axis lies in the plane of the linkage.

The cam's link has one revolute pair, whose angle is that of the cam about its own axis, counter-clockwise seen from the axis' tip.
The follower moves in the plane by the law, exactly. Of the forces in space the plane mechanism knows what does work: that along
the follower's motion and the torque on the cam's shaft. It is recorded as the force of the equivalent plane mechanism, through the
relative instant centre of cam and follower, so that power and all plane balances are exact; the contact itself, its pressure
angle and the force along the normal are those in space.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import Fault, MechanismError
from .followers import Roller
from .placed import ContactRows, on_knots
from .spatial import SpatialCam, spatial_limits

if TYPE_CHECKING:
    from ..motion import Motion
    from ..spec import SpatialBlank

__all__ = ["PlacedSpatial"]

Array = Any
Real = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacedSpatial:
    """``centre``: the cam's pin on the carrier; a place y + i z (barrel) or x + i z (globoid) of the theory's ground axes in the
    plane lies at ``centre + axes w``, so that the cam's axis has the direction ``1j axes``. ``own``: the pin on the cam's link.
    """

    name: str
    links: tuple[str, str]
    carrier: str
    guide: str
    cam: SpatialCam
    blank: SpatialBlank
    centre: complex
    axes: complex
    own: complex
    pivot: complex | None  # of an arm, on the carrier
    arm: float
    base: float
    form: bool
    sense: int
    phase: float
    pressure_limit: float | None
    bed: str | None = None
    ahead: float = 1.0
    bridges: tuple[Any, ...] = ()
    lost: tuple[Any, ...] = ()
    intended: None = None
    mate: None = None

    @property
    def scale(self) -> float:
        """Metres per unit of the follower's coordinate: 1, or the arm."""
        return self.arm or 1.0

    @property
    def side(self) -> int:
        return 1

    @property
    def face(self) -> Roller:
        return Roller(self.cam.radius)

    @property
    def knots(self) -> Real:
        return np.asarray(self.cam.law.knots)

    @property
    def middle(self) -> float:
        """Of the roller, along its axis [m]."""
        return 0.5 * (self.cam.inner + self.cam.outer)

    def law(self, argument: Array) -> Array:
        """The follower's coordinate and its first two derivatives with respect to the cam's angle, (3, ...)."""
        x = on_knots(self.cam.law, np.asarray(argument, float))
        known = np.isfinite(x)
        return np.where(known, self.cam.law(np.where(known, x, self.cam.law.start), 2), np.nan)

    def check(self) -> None:
        """Raises where the flanks cannot be cut by the roller."""
        limits = spatial_limits(self.cam, (1, -1) if self.form else (1,), count=360, layers=5)
        if not limits.undercut:
            return
        at = np.degrees(limits.sharpness.angle)
        most = limits.greatest_roller.value
        raise MechanismError(
            Fault(
                "cam.radius",
                f"a roller of {1e3 * self.cam.radius:.6g} mm undercuts the flank at {at:.6g} deg.",
                f"Give at most {1e3 * most:.6g} mm, a larger cam, or longer segments.",
            )
        )

    def argument(self, motion: Motion) -> Real:
        """The law's argument (F) [rad], within one turn."""
        turn = motion.rotation(motion.model.index[self.links[0]]) * np.conj(motion.rotation(motion.model.index[self.carrier]))
        x = self.sense * np.angle(turn) + self.phase
        return np.array(np.broadcast_to(np.asarray(x, float), (motion.frames,)))

    def place(self, motion: Motion, w: Array) -> Array:
        """Places of the theory's ground axes in the plane in the world."""
        return motion.of_point(motion.model.index[self.carrier], 0j) + motion.rotation(motion.model.index[self.carrier]) * (
            self.centre + self.axes * w
        )

    def contact(self, motion: Motion, multiplier: Array) -> tuple[Array, Array]:
        """The relative instant centre, and the force there on the follower per multiplier."""
        s = self.law(self.argument(motion))
        rate = self.sense * s[1]
        world = self.axes * motion.rotation(motion.model.index[self.carrier])
        if self.pivot is None:
            return self.place(motion, rate + 1j * s[0]), 1j * world
        p = (self.pivot - self.centre) / self.axes
        share = rate / (1.0 + rate)  # of the way from the cam's pin to the pivot
        return self.place(motion, share * p), self._across(p, share) * world

    def _across(self, p: complex, share: Real) -> Complex:
        """Force on an arm per multiplier: across the line to the pivot, its moment about the pivot clockwise."""
        return np.asarray(1j * p / abs(p) * (self.arm / ((1.0 - share) * abs(p))), complex)

    def pressing(self, motion: Motion, reaction: Complex) -> Real:
        """Force along the normal in space (F) [N] from the reaction of the plane mechanism; positive: the lifting flank."""
        s = self.law(self.argument(motion))
        world = self.axes * motion.rotation(motion.model.index[self.carrier])
        if self.pivot is None:
            along = np.real(reaction * np.conj(1j * world))
        else:
            p = (self.pivot - self.centre) / self.axes
            unit = self._across(p, self.sense * s[1] / (1.0 + self.sense * s[1])) * world
            along = np.real(reaction * np.conj(unit)) / np.abs(unit) ** 2
        return np.asarray(along / np.cos(self._flank(motion).pressure_angle[:, 0]))

    def _flank(self, motion: Motion) -> Any:
        x = on_knots(self.cam.law, self.argument(motion))
        return self.cam.flank(np.where(np.isfinite(x), x, 0.0), [self.middle])

    def rows(self, motion: Motion, multiplier: Array = 1.0) -> ContactRows:
        """The contact in the middle of the roller over a motion, its place as the plane sees it."""
        angle = self.argument(motion)
        s, flank = self.law(angle), self._flank(motion)
        lost = ~np.isfinite(angle)
        if self.pivot is None:
            w = 1j * s[0]
        else:
            along = -np.exp(-1j * s[0])
            w = (self.pivot - self.centre) / self.axes + (self.arm if self.blank.kind != "globoid" else self.middle) * along
        world = self.axes * motion.rotation(motion.model.index[self.carrier])
        with np.errstate(divide="ignore"):
            radius = 1.0 / flank.principal_curvatures[0][:, 0]
        nothing = np.full(angle.shape, np.nan)
        zero = float(self.cam.law.pieces[0].at(0.0, 0)[0])
        return ContactRows(
            angle=angle,
            place=np.array(np.broadcast_to(self.place(motion, w), angle.shape)),
            normal=np.array(np.broadcast_to(1j * world, angle.shape)),
            pressure_angle=np.where(lost, np.nan, flank.pressure_angle[:, 0]),
            radius=np.where(lost, np.nan, radius),
            eccentricity=nothing,
            coordinate=s[0],
            lift=s[0] - zero,
        )
