"""Synthesis of a plane cam by inversion, as it is drawn: the cam stands still and the frame turns back about it, step by step.

In every step the guide of the follower lies on the ray that is turned back by the cam's angle (tangent to the offset circle; the
pivot of an oscillating follower lies on its circle), the lift is laid off from the base circle, and the follower is drawn there.
The profile is the envelope of all these positions, which it touches from inside. For a wedge the frame is shifted back instead; for
a conjugate pair both cams are constructed.
"""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.cams.followers import Flat, Oscillating
from mechcore.cams.placement.plane import PlacedCam
from mechcore.errors import Fault, MechanismError
from mechcore.motion.motion import Motion
from mechcore.records import dataclass

DRAWN_POSITIONS = 30
"""Positions of the follower that are drawn in a turn."""
CIRCLE_POINTS = np.exp(2j * np.pi * np.linspace(0.0, 1.0, 49))
PROFILE_POINTS = 3600
"""Points of the profile, by which its distance from the follower is measured."""


@dataclass(frozen=True, eq=False)
class CamInversion:
    """Construction over the steps (n): positions in the axes of the cam's ``link`` [m], the cam's axis at ``centre``.

    ``angles`` of the law [rad], of a wedge lengths [m]; ``origins``: feet of the guide's line on the offset circle, or pivots,
    which also lie on a circle; ``starts``: reference points without lift, ``references``: with it. ``radius`` of the roller,
    mushroom or knife (0); ``faces`` (n, 2): ends of a flat face, else None. ``base`` radius of the base circle, of a wedge the
    height of the base line; ``bases``: the base circle or line and the path of the origins, each a polyline (k,). ``profile`` (m,),
    closed except for a ``wedge``. ``gap`` (n) [m]: distance of the profile from the follower; negative where it is undercut.
    """

    joint: str
    link: str
    centre: complex
    angles: Real
    origins: Complex
    starts: Complex
    references: Complex
    radius: float
    faces: Complex | None
    base: float
    bases: tuple[Complex, ...]
    profile: Complex
    wedge: bool
    gap: Real

    @property
    def lifts(self) -> Real:
        """Distances (n) [m] that are laid off: along the guide, or as chords of the arm's end."""
        return np.abs(self.references - self.starts)


def cam_inversions(motion: Motion, joint: str, steps: int = DRAWN_POSITIONS) -> dict[str, CamInversion]:
    """The construction of a plane cam's profile in ``steps``, by the name of the joint; for a conjugate pair that of both profiles.

    Raises `MechanismError` for joints that are no plane cams, and for cams whose profile is given.
    """
    placed = next((r.geometry for r in motion.model.relations if r.name == joint), None)
    if not isinstance(placed, PlacedCam):
        why = f"'{joint}' is no cam with a profile in the plane, about whose axis the follower could be turned back."
        raise MechanismError(Fault("inversion", why, "Name a disc cam or a wedge, or leave it out."))
    if placed.given is not None and placed.intended is None:
        why = f"the profile of '{joint}' is given: there is nothing to construct."
        raise MechanismError(Fault("inversion", why, "Name a cam with a law, or leave it out."))
    both = {joint: placed} if placed.mate is None else {joint: placed, f"{joint} second cam": placed.mate}
    return {name: _constructed(cam, steps) for name, cam in both.items()}


def _constructed(placed: PlacedCam, steps: int) -> CamInversion:
    cam = placed.intended or placed.cam
    follower, law = cam.follower, cam.law
    if cam.wedge:  # without the level parts before and after
        low, high = float(law.knots[1]), float(law.knots[-2])
        angles, along_it = np.linspace(low, high, steps + 1), np.linspace(low, high, PROFILE_POINTS)
    else:
        angles, along_it = (law.start + law.length * np.arange(n) / n for n in (steps, PROFILE_POINTS))
    s = cam.at(angles)
    turn: Complex = np.exp(-1j * cam.turn * angles) if not cam.wedge else np.ones(len(angles), complex)
    shift = angles if cam.wedge else np.zeros(len(angles))
    rest = complex(follower.reference(np.array([[placed.zero]]))[0, 0])
    foot = follower.guide.pivot if isinstance(follower.guide, Oscillating) else complex(follower.guide.offset)
    profile = cam.working_curve(along_it, 0)[0]
    if cam.wedge:
        reach = np.array([angles[0], angles[-1]])
        base = placed.base
        bases = [reach + 1j * base] + ([reach + foot] if foot else [])
    else:
        base = abs(rest) - follower.radius if not isinstance(follower.face, Flat) else placed.base
        bases = [base * CIRCLE_POINTS] + ([abs(foot) * CIRCLE_POINTS] if abs(foot) > 0.0 else [])
    face, faces = follower.face, None
    if isinstance(face, Flat):
        along = turn * follower.face_direction(s.motion[0])
        left, right = (
            min(reach, float(np.abs(profile).max())) for reach in (face.left, face.right)
        )  # for a face without an end, far enough
        faces = np.stack([s.pitch - left * along, s.pitch + right * along], axis=1)
        gap = np.array([np.min(np.imag(np.conj(d) * (z - profile))) for d, z in zip(along, s.pitch, strict=True)])
        radius = 0.0
    else:
        radius = follower.radius
        away = np.array([np.abs(profile - z).min() for z in s.pitch])
        gap = away - radius if not cam.outer else radius - away

    def into_link(z: Complex) -> Complex:
        return np.asarray(placed.mount_origin + placed.mount * z)

    return CamInversion(
        joint=placed.name,
        link=placed.links[0],
        centre=complex(placed.mount_origin),
        angles=angles,
        origins=into_link(turn * foot + shift),
        starts=into_link(turn * rest + shift),
        references=into_link(s.pitch),
        radius=radius,
        faces=None if faces is None else into_link(faces),
        base=base,
        bases=tuple(into_link(z) for z in bases),
        profile=into_link(profile),
        wedge=cam.wedge,
        gap=gap,
    )
