"""Rollers and offsets that a mechanism asks to be the least: found from its cams' limits and contact forces, and put into it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mechcore.arrays import Real
from mechcore.cams.closures import rollers_for
from mechcore.cams.followers import Flat, Roller, Translating
from mechcore.cams.limits import find_limits
from mechcore.cams.placement.plane import PlacedCam
from mechcore.cams.sizing import best_offset
from mechcore.errors import Fault, MechanismError
from mechcore.forces.cam_rating import contact_force
from mechcore.forces.kinetostatics import solve_forces
from mechcore.joints.cam import required
from mechcore.motion.compiled import Compiled
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.mechanism import CamJoint, Joint, Mechanism, Prismatic
from mechcore.texts import as_length

FRAMES = 720  # of the cycle in which the frame that decides is looked for
FINER = 5  # ever finer grids about it
SETTLED = 1e-10  # relative change of a roller from one solution to the next
ROUNDS = 60


def with_least_sizes(mechanism: Mechanism) -> Mechanism:
    """The mechanism with the sizes of its cams that are to be the least beside the base circle; itself where there are none.

    ``offset``: the follower's guide is moved across itself to where the base circle is least. ``roller``: the least with which the
    Hertz pressure keeps to the limit of the rating at all positions of the cycle. The forces depend on the roller, so that they are
    solved again until it settles. What decides each is added to the joint's ``sized``. Raises `MechanismError`.
    """
    asked = {p.name: p.least for p in mechanism.joints if isinstance(p, CamJoint) and {"offset", "roller"} & set(p.least)}
    rollers = [name for name, least in asked.items() if "roller" in least]
    for _ in range(ROUNDS):
        for name in [name for name, least in asked.items() if "offset" in least]:
            mechanism = _with_best_offset(mechanism, name)
        before = mechanism
        if rollers:
            compiled = compile_mechanism(mechanism)
            found = {name: _least_roller(compiled, name) for name in rollers}
            mechanism = replace(mechanism, joints=tuple(_with_roller(p, found) for p in mechanism.joints))
        if all(_settled(p, q) for p, q in zip(before.joints, mechanism.joints, strict=True)):
            return mechanism
    why = "solution after solution of the forces asks for another roller."
    raise MechanismError([Fault(f"joints.{name}.face", why, "Give its radius.") for name in rollers])


def _with_roller(joint: Joint, found: dict[str, tuple[float, float]]) -> Joint:
    if not isinstance(joint, CamJoint) or joint.name not in found:
        return joint
    radius, angle = found[joint.name]
    pin = 0.0 if joint.friction is None else joint.friction.radius
    if radius <= pin:
        why = f"its pin of {as_length(pin)} is not thinner than the least roller of {as_length(radius)}."
        raise MechanismError(Fault(f"joints.{joint.name}.face", why, "Give the pin a smaller radius, or give the roller's."))
    told = tuple(entry for entry in joint.sized if entry[0] != "roller")
    return replace(joint, face=Roller(radius), sized=(*told, ("roller", angle)))


def _settled(before: Joint, after: Joint) -> bool:
    if before is after or not isinstance(before, CamJoint) or not isinstance(after, CamJoint):
        return True
    a, b = (p.face.radius for p in (before, after) if isinstance(p.face, Roller))
    return abs(a - b) <= SETTLED * b


def _placed(compiled: Compiled, name: str) -> PlacedCam:
    cam = next(r.geometry for r in compiled.model.relations if getattr(r.geometry, "name", "") == name)
    assert isinstance(cam, PlacedCam)  # of discs with a lift, which the scene checks
    return cam


def _with_best_offset(mechanism: Mechanism, name: str) -> Mechanism:
    """The mechanism with the guide's point on the carrier moved across the guide."""
    joint = next(p for p in mechanism.joints if p.name == name)
    guide = next(p for p in mechanism.joints if isinstance(joint, CamJoint) and p.name == joint.guide)
    path = f"joints.{name}.offset"
    if not isinstance(joint, CamJoint) or not isinstance(guide, Prismatic) or isinstance(joint.face, Flat) or joint.lift is None:
        raise MechanismError(
            Fault(path, "the offset of a roller, a knife or a mushroom in a straight guide is one.", "Leave it out.")
        )
    cam = _placed(compile_mechanism(mechanism), name)
    shared = guide.points[guide.links.index(cam.carrier)]
    users = [p.name for p in mechanism.joints if p is not guide and _uses(p, cam.carrier, shared)]
    if users:
        why = f"the guide's point '{shared}' is that of '{users[0]}' too, which would move with it."
        raise MechanismError(Fault(path, why, f"Give '{guide.name}' a point of its own on '{cam.carrier}'."))
    assert isinstance(cam.cam.follower.guide, Translating)
    best = best_offset(joint.lift, joint.face, required(joint), joint.sense, joint.hub)
    moved = cam.axes * (best.offset - cam.cam.follower.guide.offset)
    links = [
        replace(link, points={**link.points, shared: _shifted(link.points[shared], moved)}) if link.name == cam.carrier else link
        for link in mechanism.links
    ]
    told = tuple(entry for entry in joint.sized if entry[0] != "offset")
    sized = replace(joint, sized=(*told, ("offset", best.offset)))
    return replace(mechanism, links=tuple(links), joints=tuple(sized if p is joint else p for p in mechanism.joints))


def _uses(joint: Joint, link: str, point: str) -> bool:
    """Whether a joint stands on this point of a link."""
    points = getattr(joint, "points", ())
    return any((at, name) == (link, point) for at, name in zip(joint.links, points, strict=False))


def _shifted(point: tuple[float, float], by: complex) -> tuple[float, float]:
    return point[0] + by.real, point[1] + by.imag


def _least_roller(compiled: Compiled, name: str) -> tuple[float, float]:
    """The least roller [m] on the pitch curve as it is, and the argument of the law where that is decided."""
    cam, path = _placed(compiled, name), f"joints.{name}.face"
    joint = next(p for p in compiled.mechanism.joints if p.name == name)
    assert isinstance(joint, CamJoint) and joint.rating is not None
    times = default_times(compiled.mechanism, FRAMES, 1)
    step = float(times[1] - times[0])
    least, greatest, where = 0.0, np.inf, 0.0
    for _ in range(1 + FINER):  # what decides may lie between the frames, and forces jump where the law does
        low, high, x = _rollers(compiled, cam, joint, times)
        k = int(np.argmax(low))
        if low[k] > least:
            least, where = float(low[k]), float(x[k])
        greatest = min(greatest, float(high.min()))
        times = times[k] + step * np.linspace(-1.0, 1.0, 33)
        step /= 12.0
    if least == 0.0:
        why = "no force presses this follower on its cam, so that any roller would do."
        raise MechanismError(Fault(path, why, "Give its radius, or a spring, loads and effects that press it."))
    sharp = find_limits(cam.cam).greatest_roller
    fits = np.inf if sharp is None else sharp.value - (joint.curvature_limit or 0.0)
    if least > min(greatest, fits):
        limit = f"{1e-6 * joint.rating.limit:.5g} MPa" if joint.rating.limit else ""
        why = f"no roller on this cam keeps to a Hertz pressure of {limit}."
        raise MechanismError(Fault(path, why, "Give a wider contact, a larger limit or a larger base circle."))
    return least, where


def _rollers(compiled: Compiled, cam: PlacedCam, joint: CamJoint, times: Real) -> tuple[Real, Real, Real]:
    """The least and the greatest roller [m] at instants (n), and the arguments of the law there."""
    rating = joint.rating
    assert rating is not None and rating.width is not None and rating.limit is not None
    motion = solve_motion(compiled, times)
    force, x = contact_force(solve_forces(motion), cam), cam.argument(motion)
    rho = cam.at(motion).pitch_radius
    low, high = rollers_for(np.nan_to_num(force), rho, rating.width, rating.limit, rating.modulus, rating.poisson)
    return low, high, x
