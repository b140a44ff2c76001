"""An inverse cam in its mechanism: the roller sits on the driving crank or slide, the groove on the driven link."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import Fault, MechanismError
from ..texts import as_coordinate, as_length
from .closures import InverseCam
from .placed import ContactRows, rows_by_parts
from .placed_roller import PlacedRoller

if TYPE_CHECKING:
    from ..motion import Motion

__all__ = ["PlacedInverse"]

Array = Any
Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

STEEPEST = np.radians(89.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacedInverse(PlacedRoller):
    """``links`` are (crank or slide, driven link). A point z of the driven link's theory is ``own + mount z`` in its own axes;
    ``tip`` is the roller's centre on the driving link."""

    cam: InverseCam
    way: tuple[float, float]  # of the driving link over which the law is given; beyond it the driven link rests
    mount: complex
    tip: complex
    form: bool = True

    @property
    def scale(self) -> float:
        """Metres per unit of the driven link's coordinate: 1, or the theory's arm."""
        return self.cam.crank if self.cam.turns else 1.0

    @property
    def arm(self) -> float:
        return self.cam.crank if self.cam.turns else 0.0

    def check(self) -> None:
        """Raises where the roller jams in its groove, or undercuts a flank."""
        theta = np.linspace(*self.way, 721)
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
                bend = np.abs(d[1]) ** 3 / np.imag(np.conj(d[1]) * d[2]) * side
            sharp = (bend > 0.0) & (bend < self.cam.radius)
            if sharp.any():
                k = int(np.argmax(sharp))
                raise MechanismError(
                    Fault(
                        "cam.radius",
                        f"a roller of {as_length(self.cam.radius)} undercuts the groove at {self._where(theta[k])}.",
                        f"Give less than {as_length(float(bend[bend > 0.0].min()))}.",
                    )
                )

    def argument(self, motion: Motion) -> Real:
        """The law's argument (F): of a crank [rad] within half a turn of the middle of its way, of a slide [m]."""
        return self._near(super().argument(motion))

    def known(self, argument: Array) -> tuple[Array, Array]:
        return super().known(self._near(argument))

    def _near(self, x: Array) -> Real:
        """Angles of a crank in the turn in which the law is given, however far the crank has turned."""
        x = np.asarray(x, float)
        middle = 0.5 * (self.way[0] + self.way[1])
        return x if self.bed is not None else x - 2.0 * np.pi * np.rint((x - middle) / (2.0 * np.pi))

    def _where(self, x: float) -> str:
        return f"{as_coordinate(x, rotary=self.bed is None)} of the {'crank' if self.bed is None else 'slide'}"

    def _at(self, motion: Motion) -> tuple[Complex, Complex, Complex]:
        """Roller's centre, normal of the groove, and how fast a point there moves with the coordinate; the theory's ground axes."""
        theta, known = self.known(self.argument(motion))
        pin, q = self.cam.pin(theta, 0)[0], self.cam.law(theta, 0)[0]
        turned = np.exp(1j * q) if self.cam.turns else 1.0
        lost = np.where(known, 1.0, np.nan)
        return pin * lost, turned * self.cam.normal(theta), 1j * pin if self.cam.turns else np.full(theta.shape, 1j)

    def contact(self, motion: Motion, multiplier: Array) -> tuple[Array, Array]:
        """Where the roller presses on its flank, and the force on the driven link per multiplier."""
        pin, n, away = self._at(motion)
        with np.errstate(divide="ignore", invalid="ignore"):
            direction = self.scale * n / np.real(np.conj(n) * away)
        push = direction / np.abs(direction) * np.where(np.real(multiplier) >= 0.0, 1.0, -1.0)
        world = self.world(motion)
        return self.place(motion, pin + self.cam.radius * push), direction * world

    def pressing(self, motion: Motion, reaction: Complex) -> Real:
        """Force along the normal (F) [N], positive where it drives the link the way its coordinate grows."""
        return np.asarray(np.real(reaction * np.conj(self.rows(motion).normal)))

    def rows(self, motion: Motion, multiplier: Array = 1.0) -> ContactRows:
        """The contact over a motion; the sign of ``multiplier`` says which flank carries."""
        if hasattr(motion, "parts"):
            return rows_by_parts(self, motion, multiplier)
        angle, s = self.argument(motion), self.law(self.argument(motion))
        _, n, away = self._at(motion)
        n = n * np.sign(np.real(np.conj(n) * away))
        world = self.world(motion)
        known = np.where(np.isfinite(angle), angle, self.cam.law.start)
        flank = self.cam.flank_radius(known, 1)
        return ContactRows(
            angle=angle,
            place=np.array(np.broadcast_to(self.contact(motion, multiplier)[0], angle.shape)),
            normal=np.array(np.broadcast_to(n * world, angle.shape)),
            pressure_angle=self.cam.pressure_angle(known) * np.where(np.isfinite(angle), 1.0, np.nan),
            radius=flank,
            eccentricity=np.full(angle.shape, np.nan),
            coordinate=s[0],
            lift=s[0] - float(self.cam.law(self.way[0], 0)[0]),
        )
