"""Cams: do the joints and the point exist that they name?"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

from mechcore.errors import Fault
from mechcore.spec.mechanism import Joint
from mechviz.scene.cams.cams import SOLIDS, FollowerDocument, ProfileDocument, cam_joint
from mechviz.scene.cams.ratings import GraphicalDocument, RatingDocument
from mechviz.scene.faults import did_you_mean
from mechviz.scene.fields import Table, Unknown
from mechviz.scene.kinds.free_motion import LiftoffDocument
from mechviz.scene.kinds.friction import ROLLER
from mechviz.scene.kinds.joints.base import JointKind, JointMaker
from mechviz.scene.names import TwoLinks, known_point

if TYPE_CHECKING:
    from mechviz.scene.kinds.joints.document import JointDocument
    from mechviz.scene.reading.recovery import Reading


class CamKeys(Table):
    """The keyword of cams, and the keys that only they have."""

    cam: TwoLinks | None = None
    """[cam, follower], both guided on one link."""
    profile: ProfileDocument | None = None
    """Cam: base circle and lift."""
    follower: FollowerDocument | None = None
    """Cam: what touches it and what guides that."""
    closure: Literal["force", "form"] | None = None
    """Cam: "force", the follower is only pressed on it (by a spring, its weight); "form", a groove or a yoke holds it too.
    Default force."""
    rating: RatingDocument | None = None
    """Cam: by what its contact is judged: Hertz pressure, a margin of the contact force."""
    graphical: GraphicalDocument | None = None
    """Cam: its lift also by the graphical method, with the error of that."""
    liftoff: LiftoffDocument | None = None
    """Cam: the follower may leave it, flies under the forces and lands with an impact; the run then has a duration."""


def _cam(m: JointMaker) -> Joint | None:
    guide = None if m.joint.follower is None else m.document.joints.get(m.joint.follower.guide)
    return cam_joint(m.name, m.joint, guide is not None and guide.kind == "revolute", m.friction, m.convert)


def _check_cam(reading: Reading, path: str, joint: JointDocument) -> Iterator[Fault]:
    """Faults of the joints and the point that a cam names."""
    document = reading.document
    cam, follower = joint.links
    wanted: list[tuple[str, str, str, tuple[str, ...]]] = []
    if joint.follower is not None:
        wanted.append((f"{path}.follower.guide", joint.follower.guide, follower, ("prismatic", "revolute")))
    if joint.profile is not None and joint.profile.bed is not None:
        wanted.append((f"{path}.profile.bed", joint.profile.bed, cam, ("prismatic",)))
    for where, name, link, kinds in wanted:
        if isinstance(name, Unknown) or link not in document.links or reading.shapeless:
            continue
        if name in document.joints and any(isinstance(own, Unknown) for own in document.joints[name].links):
            continue
        guides = [key for key, other in document.joints.items() if other.kind in kinds and link in other.links]
        if name not in guides and "*" not in reading.broken["joints"]:
            words = " or ".join(kinds)
            known = name in document.joints
            message = f"'{name}' is no {words} joint of '{link}'." if known else f"there is no joint '{name}'."
            near = did_you_mean(name, guides, what=f"Joints that guide '{link}'")
            yield Fault(where, message, near or f"Add a {words} joint that guides '{link}'.")
    if joint.follower is not None and not isinstance(joint.follower.point, Unknown):
        owner = follower if joint.follower.groove is None else cam
        yield from known_point(reading, f"{path}.follower.point", owner, joint.follower.point)
        if joint.follower.groove is not None and joint.closure != "form" and not joint.unread:
            yield Fault(f"{path}.follower.groove", "a groove where closure is 'force'.", "Add closure = 'form'.")
        second = joint.follower.second
        if second is not None and not isinstance(second.point, Unknown):
            yield from known_point(reading, f"{path}.follower.second.point", follower, second.point)
        if second is not None and joint.closure != "form" and not joint.unread:
            yield Fault(f"{path}.follower.second", "a second roller where closure is 'force'.", "Add closure = 'form'.")
        lone = [key for key in (*SOLIDS, "bed") if getattr(joint.profile, key, None) is not None]
        if second is not None and lone:
            yield Fault(f"{path}.follower.second", f"a second roller does not go with {lone[0]}.", "Leave it out.")


_OF_THE_CORE = {
    "lift": "profile.lift", "base": "profile.base", "bed": "profile.bed", "sense": "profile.sense", "phase": "profile.phase",
    "undercut": "profile.undercut", "guide": "follower.guide", "point": "follower.point", "second": "follower.second",
    "left": "follower.face",
}  # fmt: skip
"""What a cam joint of the core states, in a scene; its face is one of `_FACES`."""

_FACES = ("roller", "mushroom", "groove", "flat")


def _core_path(joint: JointDocument, path: str) -> str:
    """A path inside a cam joint of the core, in the scene."""
    key, _, rest = path.partition(".")
    if key == "face" and joint.follower is not None:
        return f"follower.{next((face for face in _FACES if getattr(joint.follower, face)), '')}"
    return ".".join(filter(None, (_OF_THE_CORE.get(key, key), rest)))


_PROFILE = '{ base = "40 mm", lift = [{ over = "120 deg", to = "20 mm" }, { over = "240 deg", to = 0 }] }'

CAMS = {
    "cam": JointKind(
        words="a cam",
        example=f'{{ cam = ["cam", "rod"], profile = {_PROFILE}, follower = {{ roller = "10 mm", guide = "S", point = "T" }} }}',
        make=_cam,
        keys=("profile", "follower", "closure", "friction", "liftoff", "rating", "graphical"),
        needs={
            "profile": _PROFILE,
            "follower": '{ roller = "10 mm", guide = "the joint that guides it", point = "the roller\'s centre" }',
        },
        synonyms=("cams",),
        instead={
            "at": "Leave it out: follower = { point = ... } names the follower's point.",
            "radius": "Write follower = { roller = ... } and profile = { base = ... }.",
            "side": "Write follower = { side = ... }.",
            "guide": "Write follower = { guide = ... }.",
            "slider": "Write follower = { guide = ... }.",
        },
        undriven="Drive the cam's revolute joint, or its bed, instead.",
        viscous="damping",
        rubs=ROLLER,
        joins=False,
        places=False,
        higher=True,
        check=_check_cam,
        core_path=_core_path,
    ),
}
"""The kind of joint of cams."""
