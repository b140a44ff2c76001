"""Rating of cams in their mechanisms: Hertz pressure, the least spring that keeps contact, the drawn lift beside the exact one; and
least rollers and offsets, found from the limits and contact forces of cams and set in the mechanism."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mechcore.arrays import Real
from mechcore.cams.closures import HertzContact, hertz, rollers_for
from mechcore.cams.followers import Arc, Flat, Roller, Translating
from mechcore.cams.limits import find_limits
from mechcore.cams.placement.inverse import PlacedInverse
from mechcore.cams.placement.plane import PlacedCam
from mechcore.cams.placement.spatial import PlacedSpatial
from mechcore.cams.real_profiles import Graphical, graphical
from mechcore.cams.sizing import best_offset, outer_flank
from mechcore.errors import Fault, MechanismError
from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.joints.cam import required
from mechcore.kinematics.model import Model
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.records import dataclass
from mechcore.spec.loads import Spring
from mechcore.spec.mechanism import CamDrawn, CamJoint, CamRating, Joint, Mechanism, Prismatic, joints_with_friction
from mechcore.texts import as_length, as_pressure

PULL_ROUNDING = 1e-9  # pull below this part of the largest force is rounding
AnyCam = PlacedCam | PlacedSpatial | PlacedInverse


def placed_cams(motion: Motion) -> list[AnyCam]:
    """The cams of a mechanism, in the order of its joints."""
    return [r.geometry for r in motion.model.relations if isinstance(r.geometry, AnyCam)]


def joint_of(motion: Motion, cam: AnyCam) -> CamJoint:
    """The joint of a cam, with its stated rating."""
    return next(p for p in motion.mechanism.joints if p.name == cam.name and isinstance(p, CamJoint))


def contact_force(forces: Forces, cam: AnyCam) -> Real:
    """Force along the common normal (F) [N], positive where the cam presses on the follower."""
    reaction = forces.normal_reaction(cam.name)
    return cam.pressing(forces.motion, reaction[:, 0] + 1j * reaction[:, 1])


def carrying(force: Real) -> Real:
    """The one of two flanks that carries (F): 1 the first, also where the force is unknown or rounding; -1 the other."""
    return np.where(force < -PULL_ROUNDING * np.nanmax(np.abs(force), initial=0.0), -1.0, 1.0)


# -- stress ---------------------------------------------------------------------------------------------------------------


def contact_stress(forces: Forces, cam: AnyCam, rating: CamRating) -> HertzContact:
    """Hertz pressure [Pa] and half width [m] where cam and follower touch (F); NaN where no line contact is possible.

    Of two flanks (groove, yoke, conjugate pair) the one that carries at the instant counts, with its own curvature.
    """
    if rating.width is None:
        raise MechanismError(Fault("rating.width", "it is not known how wide the contact is.", "Give it a width."))
    force = contact_force(forces, cam)
    radius, roller = _radii(forces.motion, cam, force)
    size = np.abs(force) if cam.form_closed else force
    stresses = [
        hertz(size[mask], radius[mask], float(r), rating.width, rating.modulus, rating.poisson)
        for r in np.unique(roller)
        for mask in [roller == r]
    ]
    pressure, half = np.empty(len(size)), np.empty(len(size))
    for r, part in zip(np.unique(roller), stresses, strict=True):
        pressure[roller == r], half[roller == r] = part.pressure, part.half_width
    return HertzContact(pressure, half)


def contact_curvature(motion: Motion, cam: AnyCam, force: Real) -> Real:
    """Sum of the curvatures (F) [1/m] of the flank that carries by the signs of ``force`` (F) and of the follower's face; NaN where
    the cam's hollow is tighter than the follower's face."""
    radius, roller = _radii(motion, cam, force)
    with np.errstate(divide="ignore"):
        total = 1.0 / radius + 1.0 / roller
    return np.where(total > 0.0, total, np.nan)


def _radii(motion: Motion, cam: AnyCam, force: Real) -> tuple[Real, Real]:
    """Radii of curvature [m] (F) of the flank that carries, negative where it is hollow, and of the follower's face; for a spatial
    cam the flank is replaced by a cylinder of the same relative curvature."""
    side, face = carrying(force), cam.face
    if isinstance(cam, PlacedSpatial):
        with np.errstate(divide="ignore"):
            return 1.0 / cam.curvature_sum(motion, side), np.full(len(force), cam.face.radius)
    radius = np.asarray(cam.rows(motion, side).radius, float)
    roller = np.full(len(force), face.radius if isinstance(face, Roller | Arc) else np.inf if isinstance(face, Flat) else 0.0)
    if cam.mate is not None:
        assert isinstance(cam.mate.face, Roller)
        roller[side < 0.0] = cam.mate.face.radius
    return radius, roller


# -- springs --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class LeastSpring:
    """The least spring that keeps a margin [N] of contact force: ``stiffness`` [N/m] at the same free length, or ``free_length``
    [m] at the same stiffness; None where there is no such spring. ``force`` [N]: the present least contact force.

    ``frames``: the decisive ones of each.
    """

    spring: str
    margin: float
    force: float
    stiffness: float | None
    free_length: float | None
    frames: tuple[int, int]


def least_springs(forces: Forces, cam: AnyCam, margin: float) -> list[LeastSpring]:
    """For every spring that presses a cam's follower, the least one that keeps the contact force at or above ``margin`` [N].

    Without friction and for a prescribed motion, the contact force is linear in the spring's pull ``P = preload + k (L - L0)``:
    ``N = N_other + P b``, with b from one more solution of the forces. Each frame then bounds k and L0. Raises `MechanismError`
    where there is friction.
    """
    motion = forces.motion
    mechanism = motion.mechanism
    if "friction" in mechanism.effects and joints_with_friction(mechanism.joints):
        raise MechanismError(
            Fault(
                "effects",
                "no least spring is computed with friction: the contact force is not linear in the spring's.",
                "Leave friction out to size a spring.",
            )
        )
    now = contact_force(forces, cam)
    springs = []
    for load in mechanism.loads:
        if not isinstance(load, Spring) or cam.form_closed:
            continue
        a, b = (motion.point(*end) for end in zip(load.links, load.points, strict=True))
        length = np.hypot(*(b - a).T)
        pull = load.preload + load.stiffness * (length - load.free_length)
        step = float(np.abs(pull).max(initial=0.0)) or max(float(np.abs(now).max(initial=0.0)), margin) or 1.0
        harder = replace(mechanism, loads=tuple(replace(x, preload=x.preload + step) if x is load else x for x in mechanism.loads))
        other = contact_force(solve_forces(solve_motion(compile_mechanism(harder), motion.time)), cam)
        gain = (other - now) / step
        if np.abs(gain).max(initial=0.0) < 1e-9:
            continue  # it does not press this follower
        rest = now - pull * gain
        stiff, first = _least(gain * (length - load.free_length), margin - rest - load.preload * gain)
        by_length = -load.stiffness * gain
        sense = -1.0 if by_length.max(initial=-np.inf) <= 0.0 else 1.0  # one that pulls it onto the cam is the tighter, the shorter
        slack, second = _least(sense * by_length, margin - rest - (load.preload + load.stiffness * length) * gain)
        if load.stiffness == 0.0 or (slack is not None and sense < 0.0 < slack):
            slack = None
        rate, free = (None if x is None else max(x, 0.0) for x in (stiff, None if slack is None else sense * slack))
        springs.append(LeastSpring(load.name, margin, float(now.min()), rate, free, (first, second)))
    return springs


def _least(gain: Real, need: Real) -> tuple[float | None, int]:
    """The least x with ``gain x >= need`` at all frames, None where there is none; and the decisive frame."""
    with np.errstate(divide="ignore", invalid="ignore"):
        bound = need / gain
    lower = np.where(gain > 0.0, bound, np.where((gain == 0.0) & (need > 0.0), np.inf, -np.inf))
    upper = np.where(gain < 0.0, bound, np.inf)
    k = int(np.argmax(lower))
    x = float(lower[k])
    tolerance = 1e-9 * max(abs(x), 1e-300)
    return (x if np.isfinite(x) and x <= float(upper.min()) + tolerance else None), k


# -- the drawn lift -------------------------------------------------------------------------------------------------------


def drawn_lift(cam: AnyCam, drawn: CamDrawn) -> Graphical:
    """The graphical method of lectures for a disc cam: the lift point by point over a turn, with its error."""
    if not isinstance(cam, PlacedCam) or cam.bed is not None:
        raise MechanismError(
            Fault(f"joints.{cam.name}.graphical", "the method turns a plane disc cam step by step.", "Leave it out for other cams.")
        )
    divisions = round(2.0 * np.pi / drawn.step)
    construction = graphical(cam.contour, cam.cam.follower, divisions, drawn.lines, drawn.resolution, cam.cam.turn)
    shift = np.array([[cam.zero], [0.0], [0.0]])
    sign = np.array([[1.0], [cam.law_scale], [1.0]])
    return Graphical(construction.angle, (construction.drawn - shift) * sign, (construction.exact - shift) * sign)


def drawn_rows(motion: Motion, cam: PlacedCam, construction: Graphical) -> Real:
    """Drawn values at every frame, by straight lines between the drawing's points, and their errors (F, 6): lift, first and second
    derivative by the cam's angle, each drawn, then each drawn less exact."""
    x = cam.argument(motion) * cam.law_scale
    angle = np.append(construction.angle, 2.0 * np.pi)
    at = np.mod(x, 2.0 * np.pi)
    values = [np.interp(at, angle, np.append(row, row[0])) for row in construction.drawn]
    exact = cam.law(cam.argument(motion)) - np.array([[cam.zero], [0.0], [0.0]])
    return np.column_stack([*values, *(v - e for v, e in zip(values, exact, strict=True))])


RATING_FRAMES = 720  # of the cycle in which the decisive frame is searched for
FINER_GRIDS = 5  # successively finer grids about it
SETTLED_CHANGE = 1e-10  # relative change of a roller from one solution to the next
MOST_ROUNDS = 60


@dataclass(frozen=True, eq=False)
class Solved:
    """Forces (n instants) at any times of a run that ends at ``duration`` [s], and their relative error."""

    duration: float
    forces: Callable[[Real], Forces]
    error: float = 0.0


def prescribed(mechanism: Mechanism) -> Solved:
    """One cycle of a mechanism whose motion is prescribed by its drives."""
    compiled = compile_mechanism(mechanism)
    duration = float(default_times(mechanism, 1, 1)[-1])
    return Solved(duration, lambda times: solve_forces(solve_motion(compiled, times)))


def with_least_sizes(mechanism: Mechanism, solved: Callable[[Mechanism], Solved] = prescribed) -> Mechanism:
    """The mechanism with least offsets and rollers for cams that require them; the mechanism itself where there are none.

    ``offset``: the follower's guide is moved across itself to where the base circle is least. ``roller``: the least one with which
    the Hertz pressure keeps to the limit of the rating during the whole run. The forces, and a motion under forces, depend on the
    roller, so that they are ``solved`` again until it settles. The decisive value of each is added to the joint's ``sized``.
    Raises `MechanismError`.
    """
    asked = {p.name: p.least for p in mechanism.joints if isinstance(p, CamJoint) and {"offset", "roller"} & set(p.least)}
    rollers = [name for name, least in asked.items() if "roller" in least]
    settled = SETTLED_CHANGE
    for _ in range(MOST_ROUNDS):
        for name in [name for name, least in asked.items() if "offset" in least]:
            mechanism = _with_best_offset(mechanism, name)
        before = mechanism
        if rollers:
            run = solved(mechanism)
            settled = max(SETTLED_CHANGE, run.error)
            least_radii = {name: _least_roller(run, name) for name in rollers}
            mechanism = replace(mechanism, joints=tuple(_with_roller(p, least_radii) for p in mechanism.joints))
        if all(_settled(p, q, settled) for p, q in zip(before.joints, mechanism.joints, strict=True)):
            return mechanism
    why = "solution after solution of the forces asks for another roller."
    raise MechanismError([Fault(f"joints.{name}.face", why, "Give its radius.") for name in rollers])


def _with_roller(joint: Joint, least: dict[str, tuple[float, float]]) -> Joint:
    if not isinstance(joint, CamJoint) or joint.name not in least:
        return joint
    radius, angle = least[joint.name]
    pin = 0.0 if joint.friction is None else joint.friction.radius
    if radius <= pin:
        why = f"its pin of {as_length(pin)} is not thinner than the least roller of {as_length(radius)}."
        raise MechanismError(Fault(f"joints.{joint.name}.face", why, "Give the pin a smaller radius, or give the roller's."))
    others = tuple(entry for entry in joint.sized if entry[0] != "roller")
    return replace(joint, face=Roller(radius), sized=(*others, ("roller", angle)))


def _settled(before: Joint, after: Joint, change: float) -> bool:
    if before is after or not isinstance(before, CamJoint) or not isinstance(after, CamJoint):
        return True
    a, b = (p.face.radius for p in (before, after) if isinstance(p.face, Roller))
    return abs(a - b) <= change * b


def _placed(model: Model, name: str) -> PlacedCam:
    cam = next(r.geometry for r in model.relations if getattr(r.geometry, "name", "") == name)
    assert isinstance(cam, PlacedCam)  # a disc with a lift, as the scene checks
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
    cam = _placed(compile_mechanism(mechanism).model, name)
    shared = guide.points[guide.links.index(cam.carrier)]
    users = [p.name for p in mechanism.joints if p is not guide and _uses(p, cam.carrier, shared)]
    if users:
        why = f"the guide's point '{shared}' is that of '{users[0]}' too, which would move with it."
        raise MechanismError(Fault(path, why, f"Give '{guide.name}' a point of its own on '{cam.carrier}'."))
    assert isinstance(cam.cam.follower.guide, Translating)
    beside = outer_flank if cam.groove else None
    best = best_offset(joint.lift, joint.face, required(joint), joint.sense, joint.hub, beside=beside)
    moved = cam.axes * (best.offset - cam.cam.follower.guide.offset)
    links = [
        replace(link, points={**link.points, shared: _shifted(link.points[shared], moved)}) if link.name == cam.carrier else link
        for link in mechanism.links
    ]
    others = tuple(entry for entry in joint.sized if entry[0] != "offset")
    sized = replace(joint, sized=(*others, ("offset", best.offset)))
    return replace(mechanism, links=tuple(links), joints=tuple(sized if p is joint else p for p in mechanism.joints))


def _uses(joint: Joint, link: str, point: str) -> bool:
    """Whether a joint acts at this point of a link."""
    points = getattr(joint, "points", ())
    return any((at, name) == (link, point) for at, name in zip(joint.links, points, strict=False))


def _shifted(point: tuple[float, float], by: complex) -> tuple[float, float]:
    return point[0] + by.real, point[1] + by.imag


def _least_roller(run: Solved, name: str) -> tuple[float, float]:
    """The least roller [m] on the present pitch curve, and the argument of the law that decides it."""
    times = np.linspace(0.0, run.duration, RATING_FRAMES + 1)
    step = float(times[1])
    least, greatest, where = 0.0, np.inf, 0.0
    for _ in range(1 + FINER_GRIDS):  # the decisive instant may lie between frames, and forces jump with the law
        forces = run.forces(times)
        cam = _placed(forces.motion.model, name)
        low, high, x = _rollers(forces, cam)
        k = int(np.argmax(low))
        if low[k] > least:
            least, where = float(low[k]), float(x[k])
        greatest = min(greatest, float(high.min()))
        times = np.clip(times[k] + step * np.linspace(-1.0, 1.0, 33), 0.0, run.duration)
        step /= 12.0
    joint, path = joint_of(forces.motion, cam), f"joints.{name}.face"
    assert joint.rating is not None
    if least == 0.0:
        why = "no force presses this follower on its cam, so that any roller would do."
        raise MechanismError(Fault(path, why, "Give its radius, or a spring, loads and effects that press it."))
    sharp = find_limits(cam.cam).greatest_roller
    fits = np.inf if sharp is None else sharp.value - (joint.curvature_limit or 0.0)
    if least > min(greatest, fits):
        limit = as_pressure(joint.rating.limit, 5) if joint.rating.limit else ""
        why = f"no roller on this cam keeps to a Hertz pressure of {limit}."
        raise MechanismError(Fault(path, why, "Give a wider contact, a larger limit or a larger base circle."))
    return least, where


def _rollers(forces: Forces, cam: PlacedCam) -> tuple[Real, Real, Real]:
    """The least and the greatest roller [m] at instants (n), and the arguments of the law there."""
    rating = joint_of(forces.motion, cam).rating
    assert rating is not None and rating.width is not None and rating.limit is not None
    out = np.zeros((3, forces.motion.frames))
    out[1] = np.inf
    for rows, part in forces.parts:
        if all(other.name != cam.name for other in placed_cams(part.motion)):
            continue  # the follower has left it
        force, rho = np.nan_to_num(contact_force(part, cam)), cam.at(part.motion).pitch_radius
        low, high = rollers_for(force, rho, rating.width, rating.limit, rating.modulus, rating.poisson)
        out[:, rows] = low, high, cam.argument(part.motion)
    return out[0], out[1], out[2]
