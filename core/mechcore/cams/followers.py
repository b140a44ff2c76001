"""Followers of plane cams: how they are guided and the face that touches the cam; all plane vectors are complex numbers.

The cam's centre O is the origin (of a wedge: the zero of its own length). A translating follower moves along the line x = offset,
upwards positive; its coordinate is the height h of its reference point. An oscillating one turns about a fixed pivot; its
coordinate is the angle psi between the line from the pivot to O and its arm (theory: T = (d - l cos psi, l sin psi) for the
pivot (d, 0), side = 1). Reference points: the knife's tip, the roller's centre, the centre of a mushroom's arc, the
point of a flat face on the follower's line (translating) or at the end of its arm (oscillating).
"""

from __future__ import annotations

from typing import cast

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.errors import Fault, MechanismError
from mechcore.numerics import jets
from mechcore.numerics.frames import imaginary
from mechcore.records import dataclass
from mechcore.texts import as_length


@dataclass(frozen=True)
class Translating:
    """Moves along the vertical line x = ``offset`` [m] (0: central)."""

    offset: float = 0.0

    def reference(self, q: Real) -> Complex:
        """Coordinate and its derivatives (k, n) -> the reference point and its derivatives (k, n), ground axes."""
        t = cast(Complex, imaginary(q))
        t[0] += self.offset
        return t

    def turning(self, q: Real) -> Real:
        """Angle of the follower and its derivatives (k, n): it does not turn."""
        return np.zeros_like(q)

    def away(self, point: Complex) -> Complex:
        """Unit direction in which a point (n) of the follower moves when the coordinate grows."""
        return np.full(np.shape(point), 1j)


@dataclass(frozen=True)
class Oscillating:
    """Turns about ``pivot`` (complex, [m]) with an ``arm`` [m]; ``side`` 1: growing psi turns the arm clockwise from the
    line to O."""

    pivot: complex
    arm: float
    side: int = 1

    def __post_init__(self) -> None:
        if not abs(self.pivot) > 0.0:
            raise MechanismError(Fault("follower.pivot", "it lies on the cam's centre.", "Move it away from there."))
        if not self.arm > 0.0:
            raise MechanismError(Fault("follower.arm", f"{as_length(self.arm)} is no length.", "Give a positive one."))
        if self.side not in (1, -1):
            raise MechanismError(Fault("follower.side", f"{self.side}", "Give 1 or -1."))

    @property
    def home(self) -> complex:
        """Unit direction from the pivot to O."""
        return -self.pivot / abs(self.pivot)

    def reference(self, q: Real, shift: float = 0.0) -> Complex:
        f = -1j * self.side * q
        if len(q) > 5:
            t = (self.arm + 1j * self.side * shift) * self.home * jets.exponential(f)
            t[0] += self.pivot
            return t
        e = (self.arm + 1j * self.side * shift) * self.home * np.exp(f[0])
        t = np.empty_like(q, complex)
        t[0] = self.pivot + e
        if len(q) > 1:
            t[1] = f[1] * e
        if len(q) > 2:
            t[2] = (f[2] + f[1] ** 2) * e
        if len(q) > 3:
            t[3] = (f[3] + 3.0 * f[1] * f[2] + f[1] ** 3) * e
        if len(q) > 4:
            t[4] = (f[4] + 4.0 * f[1] * f[3] + 3.0 * f[2] ** 2 + 6.0 * f[1] ** 2 * f[2] + f[1] ** 4) * e
        return t

    def turning(self, q: Real) -> Real:
        return -self.side * q

    def away(self, point: Complex) -> Complex:
        r = -1j * self.side * (point - self.pivot)
        return r / np.abs(r)


FollowerGuide = Translating | Oscillating


@dataclass(frozen=True)
class Knife:
    """A knife edge: reproduces any law, and wears."""

    @property
    def radius(self) -> float:
        return 0.0


@dataclass(frozen=True)
class Roller:
    """A roller of ``radius`` [m] about the reference point."""

    radius: float

    def __post_init__(self) -> None:
        if not self.radius > 0.0:
            why = f"a roller of {as_length(self.radius)}."
            raise MechanismError(Fault("follower.radius", why, "Give a positive radius, or a knife."))


@dataclass(frozen=True)
class Arc:
    """A mushroom: a convex arc of ``radius`` [m] about the reference point, ``half_angle`` to either side of its middle [rad].

    Geometrically a roller that does not turn; the middle of a translating one points down (against the lift), that of an
    oscillating one across its arm towards the cam.
    """

    radius: float
    half_angle: float = np.pi

    def __post_init__(self) -> None:
        if not self.radius > 0.0:
            raise MechanismError(Fault("follower.radius", f"an arc of {as_length(self.radius)}.", "Give a positive radius."))


@dataclass(frozen=True)
class Flat:
    """A flat face through the reference point: across the line of a translating follower, along the arm of an oscillating one.

    ``tilt`` [rad] turns it counter-clockwise; ``shift`` [m] moves the face of an oscillating follower from the arm's line
    towards the cam. ``left``, ``right`` [m]: how far the face reaches from the reference point along its direction. They only serve
    to judge a contact: the follower moves as if the face were infinite.
    """

    tilt: float = 0.0
    shift: float = 0.0
    left: float = np.inf
    right: float = np.inf


Face = Knife | Roller | Arc | Flat


@dataclass(frozen=True)
class Follower:
    """A guide and a face."""

    guide: FollowerGuide
    face: Face

    @property
    def radius(self) -> float:
        """Distance of the working curve from the pitch curve [m]: roller or arc radius, 0 for knife and flat face."""
        return 0.0 if isinstance(self.face, Flat) else self.face.radius

    def reference(self, q: Real) -> Complex:
        """Coordinate with derivatives (k, n) -> reference point with derivatives (k, n), ground axes."""
        if isinstance(self.face, Flat) and isinstance(self.guide, Oscillating):
            return self.guide.reference(q, self.face.shift)
        return self.guide.reference(q)

    def face_direction(self, q0: Real) -> Complex:
        """Unit direction of a flat face (n); i times it points from the cam to the follower."""
        assert isinstance(self.face, Flat)
        tilt = np.exp(1j * self.face.tilt)
        if isinstance(self.guide, Translating):
            return np.full(np.shape(q0), tilt, complex)
        return cast(Complex, -self.guide.side * tilt * self.guide.home * np.exp(-1j * self.guide.side * q0))

    def base_coordinate(self, base: float) -> float:
        """The coordinate at which the follower touches a base circle of radius ``base`` about O [m or rad].

        Raises where it cannot reach that circle.
        """
        guide, face = self.guide, self.face
        if isinstance(guide, Translating):
            if isinstance(face, Flat):
                return float((base + guide.offset * np.sin(face.tilt)) / np.cos(face.tilt))
            reach = (base + self.radius) ** 2 - guide.offset**2
            if reach < 0.0:
                raise MechanismError(
                    Fault(
                        "cam.base",
                        f"a base circle of {as_length(base)} with a roller of {as_length(self.radius)} does not reach the offset "
                        f"{as_length(guide.offset)}.",
                        "Enlarge the base circle or lessen the offset.",
                    )
                )
            return float(np.sqrt(reach))
        d = abs(guide.pivot)
        if isinstance(face, Flat):  # distance of O from the face's line: d sin(psi - tilt) + arm sin(tilt) - shift cos(tilt)
            lever = base - guide.arm * np.sin(guide.side * face.tilt) + face.shift * np.cos(face.tilt)
            if abs(lever) > d:
                why = f"the face cannot touch a base circle of {as_length(base)}."
                raise MechanismError(Fault("cam.base", why, "Lessen it or the face's shift."))
            return float(np.arcsin(lever / d) + guide.side * face.tilt)
        r = base + self.radius
        c = (d**2 + guide.arm**2 - r**2) / (2.0 * d * guide.arm)
        if not -1.0 <= c <= 1.0:
            least = max(abs(d - guide.arm) - self.radius, 0.0)
            raise MechanismError(
                Fault(
                    "cam.base",
                    f"the arm of {as_length(guide.arm)} at {as_length(d)} does not reach a base circle of {as_length(base)}.",
                    f"Give between {as_length(least)} and {as_length(d + guide.arm - self.radius)}.",
                )
            )
        return float(2.0 * np.arcsin(np.sqrt(0.5 * (1.0 - c))))
