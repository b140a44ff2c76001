"""Rating of cams in their mechanisms: Hertz pressure, the least spring that keeps contact, the drawn lift beside the exact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mechcore.arrays import Real
from mechcore.cams.closures import HertzContact, hertz
from mechcore.cams.followers import Arc, Flat, Roller
from mechcore.cams.placement.inverse import PlacedInverse
from mechcore.cams.placement.plane import PlacedCam
from mechcore.cams.placement.spatial import PlacedSpatial
from mechcore.cams.real_profiles import Graphical, graphical
from mechcore.errors import Fault, MechanismError
from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.records import dataclass
from mechcore.spec.loads import Spring
from mechcore.spec.mechanism import CamDrawn, CamJoint, CamRating, braked

AnyCam = PlacedCam | PlacedSpatial | PlacedInverse


def placed_cams(motion: Motion) -> list[AnyCam]:
    """The cams of a mechanism, in the order of its joints."""
    return [r.geometry for r in motion.model.relations if isinstance(r.geometry, AnyCam)]


def joint_of(motion: Motion, cam: AnyCam) -> CamJoint:
    """Rating of a cam that the mechanism states."""
    return next(p for p in motion.mechanism.joints if p.name == cam.name and isinstance(p, CamJoint))


def contact_force(forces: Forces, cam: AnyCam) -> Real:
    """Force along the common normal (F) [N], positive where the cam presses on the follower."""
    reaction = forces.pressed(cam.name)
    return cam.pressing(forces.motion, reaction[:, 0] + 1j * reaction[:, 1])


# -- stress ---------------------------------------------------------------------------------------------------------------


def contact_stress(forces: Forces, cam: AnyCam, rating: CamRating) -> HertzContact:
    """Hertz pressure [Pa] and half width [m] where cam and follower touch (F); NaN where no line contact is possible.

    Of two flanks (groove, yoke, conjugate pair) the one that carries at the moment, with its own curvature.
    """
    if rating.width is None:
        raise MechanismError(Fault("rating.width", "it is not known how wide the contact is.", "Give it a width."))
    force = contact_force(forces, cam)
    radius, roller = _radii(forces.motion, cam, force)
    size = np.abs(force) if cam.form else force
    stresses = [
        hertz(size[mask], radius[mask], float(r), rating.width, rating.modulus, rating.poisson)
        for r in np.unique(roller)
        for mask in [roller == r]
    ]
    pressure, half = np.empty(len(size)), np.empty(len(size))
    for r, part in zip(np.unique(roller), stresses, strict=True):
        pressure[roller == r], half[roller == r] = part.pressure, part.half_width
    return HertzContact(pressure, half)


def _radii(motion: Motion, cam: AnyCam, force: Real) -> tuple[Real, Real]:
    """Radii of curvature [m] (F) of the flank that carries, negative where it is hollow, and of the follower's face."""
    pulled = force < 0.0
    rows = cam.rows(motion, np.where(np.isfinite(force), force, 1.0))
    own = np.asarray(rows.radius, float)
    face = cam.face
    roller = np.full(len(force), face.radius if isinstance(face, Roller | Arc) else np.inf if isinstance(face, Flat) else 0.0)
    if isinstance(cam, PlacedInverse):
        x = np.where(np.isfinite(rows.angle), rows.angle, cam.cam.law.start)
        k, c = (motion.model.index[name] for name in (cam.links[0], cam.carrier))
        push = cam.contact(motion, np.where(pulled, -1.0, 1.0))[0] - motion.origins[k] - motion.rotation(k) * cam.tip
        turned = np.exp(1j * cam.cam.law(x, 0)[0]) if cam.cam.turns else 1.0
        ahead = np.real(np.conj(turned * cam.cam.normal(x) * cam.axes * motion.rotation(c)) * push) > 0.0
        return np.where(ahead, cam.cam.flank_radius(x, 1), cam.cam.flank_radius(x, -1)), roller
    if not pulled.any() or not cam.form:
        return own, roller
    if isinstance(cam, PlacedSpatial):
        x = np.where(np.isfinite(rows.angle), rows.angle, 0.0)
        with np.errstate(divide="ignore"):
            far = 1.0 / cam.cam.flank(x, [cam.middle], -1).principal_curvatures[0][:, 0]
        return np.where(pulled, far, own), roller
    if cam.mate is not None:
        assert isinstance(cam.mate.face, Roller)
        return np.where(pulled, cam.mate.at(motion).radius, own), np.where(pulled, cam.mate.face.radius, roller)
    if cam.yoke:
        return np.where(pulled, cam.cam.at(cam.at(motion).angle + np.pi).radius, own), roller
    return np.where(pulled, -(own + 2.0 * roller), own), roller  # the far flank of a groove: parallel, two radii further out


# -- springs --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class LeastSpring:
    """The least spring that keeps a margin [N] of contact force: ``stiffness`` [N/m] with the free length kept, or
    ``free_length`` [m] with the stiffness kept, None where no such spring does; ``force`` [N]: the least contact force now.

    ``frames``: those that decide each.
    """

    spring: str
    margin: float
    force: float
    stiffness: float | None
    free_length: float | None
    frames: tuple[int, int]


def least_springs(forces: Forces, cam: AnyCam, margin: float) -> list[LeastSpring]:
    """For every spring that presses a cam's follower the least one that keeps the contact force at or above ``margin`` [N].

    Without friction and with the motion prescribed the contact force is linear in the spring's pull ``P = preload + k (L - L0)``:
    ``N = N_other + P b``, with b from one more solution of the forces. Each frame then bounds k and L0. Raises where friction or
    forces decide.
    """
    motion = forces.motion
    mechanism = motion.mechanism
    if "friction" in mechanism.effects and braked(mechanism.joints):
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
        if not isinstance(load, Spring) or cam.form:
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
        slack, second = _least(-load.stiffness * gain, margin - rest - (load.preload + load.stiffness * length) * gain)
        if load.stiffness == 0.0:
            slack = None
        rate, free = (None if x is None else max(x, 0.0) for x in (stiff, slack))
        springs.append(LeastSpring(load.name, margin, float(now.min()), rate, free, (first, second)))
    return springs


def _least(gain: Real, need: Real) -> tuple[float | None, int]:
    """The least x with ``gain x >= need`` at all frames, and the frame that decides; None where there is none."""
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
    """The graphical method of the lecture for a disc cam: the lift point by point over a turn, with its error."""
    if not isinstance(cam, PlacedCam) or cam.bed is not None:
        raise MechanismError(
            Fault(f"joints.{cam.name}.graphical", "the method turns a plane disc cam step by step.", "Leave it out for other cams.")
        )
    divisions = round(2.0 * np.pi / drawn.step)
    construction = graphical(cam.contour, cam.cam.follower, divisions, drawn.lines, drawn.resolution, cam.cam.turn)
    shift = np.array([[cam.zero], [0.0], [0.0]])
    sign = np.array([[1.0], [cam.ahead], [1.0]])
    return Graphical(construction.angle, (construction.drawn - shift) * sign, (construction.exact - shift) * sign)


def drawn_rows(motion: Motion, cam: PlacedCam, construction: Graphical) -> Real:
    """At every frame what the drawing gives by straight lines between its points, and its error: lift, first and second derivative
    with respect to the cam's angle, drawn and drawn less exact (F, 6)."""
    x = cam.argument(motion) * cam.ahead
    angle = np.append(construction.angle, 2.0 * np.pi)
    at = np.mod(x, 2.0 * np.pi)
    values = [np.interp(at, angle, np.append(row, row[0])) for row in construction.drawn]
    exact = cam.law(cam.argument(motion)) - np.array([[cam.zero], [0.0], [0.0]])
    return np.column_stack([*values, *(v - e for v, e in zip(values, exact, strict=True))])
