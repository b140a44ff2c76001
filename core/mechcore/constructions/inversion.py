"""Synthesis of a disc cam by inversion, as it is drawn: the cam stands still and the frame turns back about it, step by step.

In every step the guide of the follower lies on the ray that is turned back by the cam's angle (tangent to the offset circle; the
pivot of an oscillating follower on its circle), the lift is laid off from the base circle, and the follower is drawn there. The
profile touches all these positions from inside: it is their envelope.
"""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.cams.followers import Flat, Oscillating
from mechcore.cams.placement.plane import PlacedCam
from mechcore.errors import Fault, MechanismError
from mechcore.motion.motion import Motion
from mechcore.records import dataclass

STEPS = 30
"""Positions of the follower that are drawn in a turn."""
ALONG = 3600
"""Points of the profile, from which its distance to the follower is measured."""


@dataclass(frozen=True, eq=False)
class CamInversion:
    """Over the steps (n), places in the axes of the cam's ``link`` [m], the cam's axis at ``centre``.

    ``angles`` of the law [rad]; ``origins``: feet of the guide's line on the offset circle, or pivots, which lie on a circle of
    radius ``carrier``; ``starts``: reference points without lift, ``references``: with it. ``radius`` of the roller, mushroom or
    knife (0);
    ``faces`` (n, 2): ends of a flat face, else None. ``base`` radius of the base circle; ``profile`` (m,) closed. ``gap`` (n) [m]:
    how far the profile stays away from the follower; negative where it is undercut.
    """

    joint: str
    link: str
    centre: complex
    angles: Real
    origins: Complex
    carrier: float
    starts: Complex
    references: Complex
    radius: float
    faces: Complex | None
    base: float
    profile: Complex
    gap: Real

    @property
    def lifts(self) -> Real:
        """Distances (n) [m] that are laid off: along the guide, or as chords of the arm's end."""
        return np.abs(self.references - self.starts)


def cam_inversion(motion: Motion, joint: str, steps: int = STEPS) -> CamInversion:
    """The construction of a disc cam's profile in some steps of a turn.

    Raises `MechanismError` for joints that are no disc cams, and for cams whose profile is given.
    """
    placed = next((r.geometry for r in motion.model.relations if r.name == joint), None)
    if not isinstance(placed, PlacedCam) or placed.cam.wedge:
        raise MechanismError(Fault("inversion", f"'{joint}' is no disc cam.", "Name a disc cam, or leave it out."))
    if placed.given is not None and placed.intended is None:
        why = f"the profile of '{joint}' is given: there is nothing to construct."
        raise MechanismError(Fault("inversion", why, "Name a cam with a law, or leave it out."))
    cam = placed.intended or placed.cam
    follower, law = cam.follower, cam.law
    angles = law.start + law.length * np.arange(steps) / steps
    s = cam.at(angles)
    back = np.exp(-1j * cam.turn * angles)
    rest = follower.reference(np.array([[placed.zero]]))[0]
    foot = follower.guide.pivot if isinstance(follower.guide, Oscillating) else complex(follower.guide.offset)
    profile = cam.working_curve(law.start + law.length * np.arange(ALONG) / ALONG, 0)[0]
    face, faces = follower.face, None
    if isinstance(face, Flat):
        along = back * follower.face_direction(s.motion[0])
        left, right = (
            min(reach, float(np.abs(profile).max())) for reach in (face.left, face.right)
        )  # of one without an end, enough
        faces = np.stack([s.pitch - left * along, s.pitch + right * along], axis=1)
        gap = np.array([np.min(np.imag(np.conj(d) * (z - profile))) for d, z in zip(along, s.pitch, strict=True)])
        radius = 0.0
    else:
        radius = follower.radius
        away = np.array([np.abs(profile - z).min() for z in s.pitch])
        gap = away - radius if not cam.outer else radius - away

    def into_link(z: Complex) -> Complex:
        return np.asarray(placed.own + placed.mount * z)

    return CamInversion(
        joint=joint,
        link=placed.links[0],
        centre=complex(placed.own),
        angles=angles,
        origins=into_link(back * foot),
        carrier=abs(foot),
        starts=into_link(back * rest),
        references=into_link(s.pitch),
        radius=radius,
        faces=None if faces is None else into_link(faces),
        base=placed.base,
        profile=into_link(profile),
        gap=gap,
    )
