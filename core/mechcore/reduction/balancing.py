"""Shaking force and moment on the frame; counterweights that balance the force of four-bars, and of slider-cranks in part.

Four-bar (R. S. Berkof and G. G. Lowen, 1969): with the loop closed, the sum of m r_S over the links is a constant plus one multiple
of the crank's vector and one of the rocker's; counterweights on these two links make both multiples zero, for any motion of the
crank. Slider-crank: a counterweight on the crank balances the rotating masses and a stated fraction of the reciprocating ones (the
rod's mass divided by its centre of mass between crank pin and gudgeon pin).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Plane, Real, Values
from mechcore.errors import Fault, MechanismError
from mechcore.kinematics.dyads import cross
from mechcore.motion.motion import Motion
from mechcore.numerics.tape import value_of
from mechcore.records import dataclass
from mechcore.reduction.bodies import RigidBody, combine
from mechcore.spec.mechanism import Link, Mechanism, Prismatic, Revolute
from mechcore.texts import as_length


@dataclass(frozen=True, eq=False)
class Shaking:
    """``force`` (F, 2) [N] and ``moment`` (F,) [N m] about ``about`` [m], on the frame.

    ``single``: the largest inertia force of a single link in the run [N], the reference for the residual of a balance.
    """

    force: Real
    moment: Real
    about: tuple[float, float]
    single: float = 0.0

    @property
    def magnitude(self) -> Real:
        """Amount of the shaking force (F,) [N]."""
        return np.hypot(self.force[:, 0], self.force[:, 1])

    @property
    def peak(self) -> float:
        """Largest shaking force [N]."""
        return float(np.nanmax(self.magnitude, initial=0.0))

    @property
    def rms(self) -> float:
        """Root mean square of the shaking force over the frames (the last, which closes a cycle, left out) [N]."""
        return _rms(self.magnitude)

    @property
    def peak_moment(self) -> float:
        return float(np.nanmax(np.abs(self.moment), initial=0.0))

    @property
    def rms_moment(self) -> float:
        return _rms(self.moment)


def _rms(values: Real) -> float:
    used = values[:-1] if len(values) > 1 else values
    return float(np.sqrt(np.nanmean(used**2)))


def shaking(motion: Motion, about: ArrayLike = (0.0, 0.0), masses: Sequence[tuple[float, complex, float]] | None = None) -> Shaking:
    """Shaking force -sum m a_S and shaking moment sum (r x (-m a_S) - J_S alpha) about a fixed point, over all moving links.

    ``masses``: (mass, centre, J_S) of every link, frame first, in place of the model's own. The result equals the load of all
    joints on the frame and of the drives on it under inertia alone. The moment of a link about a shaft in the plane is not about
    the plane's normal, and is left out.
    """
    model = motion.model
    o = complex(*np.asarray(about, float))
    force: Plane = np.zeros(motion.frames, complex)
    moment: Values = np.zeros(motion.frames)
    most = 0.0
    for k, (mass, centre, inertia) in enumerate(masses or model.masses):
        if k and (mass or inertia):
            single = -mass * motion.of_point(k, centre, 2)
            force = force + single
            most = max(most, float(np.nanmax(np.abs(value_of(single)), initial=0.0)))
            moment = moment + cross(motion.of_point(k, centre) - o, single)
            if k not in model.shafts:
                moment = moment - inertia * motion.accelerations.angular[model.angles.rotation_class[k]]
    rows = np.stack([force.real, force.imag], axis=-1)
    return Shaking(force=rows, moment=cast(Real, moment), about=(o.real, o.imag), single=most)


@dataclass(frozen=True)
class Counterweight:
    """A point mass [kg] to be fixed to a link at a place in the link's frame [m]."""

    link: str
    mass: float
    at: tuple[float, float]


@dataclass(frozen=True)
class FourBarLinks:
    """Links of a four-bar, and the points (link frame) of crank A B, coupler B C, rocker D C."""

    crank: Link
    coupler: Link
    rocker: Link
    points: dict[str, tuple[complex, complex]]


@dataclass(frozen=True)
class SliderCrankLinks:
    """Links of a slider-crank, and the points (link frame) of crank A B and rod B C."""

    crank: Link
    rod: Link
    slider: Link
    points: dict[str, tuple[complex, complex]]


def find_linkage(m: Mechanism) -> FourBarLinks | SliderCrankLinks:
    """The four-bar or slider-crank that a mechanism is; `MechanismError` where it is neither."""
    links = {k.name: k for k in m.links}
    wanted = Fault("balance", "the mechanism is neither a four-bar nor a slider-crank.", "Balance other mechanisms link by link.")
    turning = [p for p in m.joints if isinstance(p, Revolute)]
    sliding = [p for p in m.joints if isinstance(p, Prismatic)]
    if len(m.links) != 4 or len(m.joints) != 4 or len(m.drives) != 1 or len(turning) + len(sliding) != 4 or len(sliding) > 1:
        raise MechanismError(wanted)

    def between(a: str, b: str) -> Revolute:
        for p in turning:
            if set(p.links) == {a, b}:
                return p
        raise MechanismError(wanted)

    def at(joint: Revolute, link: str) -> complex:
        return complex(*links[link].points[joint.points[joint.links.index(link)]])

    def mate(link: str, *known: str) -> str:
        near = {k for p in m.joints if link in p.links for k in p.links} - {link, *known}
        if len(near) != 1:
            raise MechanismError(wanted)
        return near.pop()

    ground = m.frame
    at_ground = [k for p in m.joints if ground in p.links for k in p.links if k != ground]
    if len(set(at_ground)) != 2:
        raise MechanismError(wanted)
    if sliding:
        if ground not in sliding[0].links:
            raise MechanismError(wanted)
        slider = next(k for k in sliding[0].links if k != ground)
        crank = next(k for k in at_ground if k != slider)
    else:
        driven = next((p for p in turning if p.name == m.drives[0].joint), turning[0])
        crank = next((k for k in driven.links if k in at_ground), at_ground[0])
        slider = next(k for k in at_ground if k != crank)
    rod = mate(crank, ground)
    a, b, c = between(ground, crank), between(crank, rod), between(rod, slider)
    points = {crank: (at(a, crank), at(b, crank)), rod: (at(b, rod), at(c, rod))}
    if sliding:
        return SliderCrankLinks(links[crank], links[rod], links[slider], points)
    points[slider] = (at(between(ground, slider), slider), at(c, slider))
    return FourBarLinks(links[crank], links[rod], links[slider], points)


def _share(link: Link, points: dict[str, tuple[complex, complex]]) -> complex:
    """Position of a link's centre of mass, as a complex multiple of the vector between its two points."""
    start, end = points[link.name]
    return (complex(*link.centre) - start) / (end - start)


def counterweights(
    linkage: FourBarLinks | SliderCrankLinks, radius: float | tuple[float, float], *, fraction: float = 1.0
) -> tuple[Counterweight, ...]:
    """Counterweights at a radius [m] from the fixed pivots (of crank and rocker, where two are given).

    Four-bar: they make the shaking force zero; a ``fraction`` below 1 leaves a part of it. Slider-crank: one on the crank, for the
    rotating masses and a ``fraction`` of the reciprocating ones. A counterweight of zero is left out.
    """
    radii = radius if isinstance(radius, tuple) else (radius, radius)
    if min(radii) <= 0.0:
        raise MechanismError(Fault("balance.radius", f"{as_length(min(radii))} is no radius.", "Give a positive radius."))
    crank = linkage.crank
    if isinstance(linkage, FourBarLinks):
        coupler, rocker = linkage.coupler, linkage.rocker
        s = _share(coupler, linkage.points)
        on_crank = fraction * (crank.mass * _share(crank, linkage.points) + coupler.mass * (1.0 - s))
        on_rocker = fraction * (rocker.mass * _share(rocker, linkage.points) + coupler.mass * s)
        wanted = [(crank, on_crank, radii[0]), (rocker, on_rocker, radii[1])]
    else:
        s = _share(linkage.rod, linkage.points)
        turning = crank.mass * _share(crank, linkage.points) + linkage.rod.mass * (1.0 - s)
        to_and_fro = linkage.rod.mass * s + linkage.slider.mass
        wanted = [(crank, turning + fraction * to_and_fro, radii[0])]
    out = []
    for link, multiple, r in wanted:
        start, end = linkage.points[link.name]
        moment = -multiple * (end - start)  # first moment about the fixed pivot to be added [kg m]
        if abs(moment) > 0.0:
            place = start + r * moment / abs(moment)
            out.append(Counterweight(link.name, abs(moment) / r, (place.real, place.imag)))
    return tuple(out)


def with_counterweights(m: Mechanism, weights: tuple[Counterweight, ...]) -> Mechanism:
    """The mechanism with point masses fixed to its links: their masses, centres and moments of inertia follow."""
    links = []
    for link in m.links:
        parts = [
            RigidBody(link.mass, link.centre, link.inertia),
            *(RigidBody(w.mass, w.at) for w in weights if w.link == link.name),
        ]
        body = combine(parts) if len(parts) > 1 else parts[0]
        links.append(replace(link, mass=body.mass, centre=body.centre, inertia=body.inertia))
    return replace(m, links=tuple(links))


def balance(
    m: Mechanism, radius: float | tuple[float, float], *, fraction: float = 1.0
) -> tuple[Mechanism, tuple[Counterweight, ...]]:
    """A four-bar or slider-crank with its counterweights, and these."""
    weights = counterweights(find_linkage(m), radius, fraction=fraction)
    return with_counterweights(m, weights), weights
