"""Drawing of cam joints: profiles and positions; for inverse cams the body with the slot in which the crank's roller runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from shapely.geometry import LineString, Point, Polygon

from mechcore.arrays import Complex, Vec2
from mechcore.cams.followers import Oscillating
from mechcore.joints.base import Builder, point_of
from mechcore.records import dataclass
from mechcore.spec.mechanism import CamJoint, Mechanism
from mechviz.meshes import outline
from mechviz.meshes.draft import Neck, PlacedPart, SolidsDraft

if TYPE_CHECKING:
    from mechcore.cams.placement.plane import PlacedCam
    from mechviz.meshes.model import ScaledMechanism

_PROFILE_POINTS = 1080  # points of a profile


@dataclass(frozen=True, eq=False)
class CamDrawing:
    """Data for drawing a cam joint. ``tip``: in the follower's frame; ``turn``: rotation from the ground axes of the cam theory to
    the follower's frame (for an oscillating follower at the cam angle ``theta``)."""

    joint: str
    cam: str
    follower: str
    placed: PlacedCam
    size: float
    profile: Polygon  # in the frame of the cam's link; of a groove cam: the disc inside the groove
    bore: Vec2
    tip: Vec2
    turn: complex
    theta: float  # cam angle at which `turn` holds
    guide: str
    grounded: bool  # a translating follower whose guide stands on the ground
    bed: bool  # a wedge whose bed stands on the ground
    mate_of: int | None = None  # the second cam of a conjugate pair: number of the first

    @property
    def own_guides(self) -> tuple[str, ...]:
        """Prismatic joints that are drawn with the cam."""
        return (*((self.guide,) if self.grounded else ()), *((self.placed.bed,) if self.bed and self.placed.bed else ()))


def profile_points(placed: PlacedCam, count: int = _PROFILE_POINTS) -> Complex:
    """Points (n,) of the profile in the cam axes of the theory, complex [m], counter-clockwise; of a wedge from left to right."""
    contour = placed.contour
    each = max(count // contour.count, 8)
    t = (np.arange(contour.count)[:, None] + np.arange(each) / each).ravel()
    t = t if contour.closed else np.append(t, contour.count)
    if placed.bed is not None:  # the law is extended by dwells of its own length on both sides: part of them is drawn
        t = t[(t >= 0.8) & (t <= contour.count - 0.8)]
    z = np.asarray(contour(t)[0])
    if placed.bed is not None:
        z = z[np.argsort(z.real)]
    return z


def find_cams(mechanism: Mechanism, parts: Builder, size: float, samples: int = _PROFILE_POINTS) -> tuple[CamDrawing, ...]:
    """All plane cams of a mechanism except inverse ones; ``samples``: points of each profile."""
    by_name = {r.name: r.geometry for r in parts.relations}
    drawings: list[CamDrawing] = []
    for p in mechanism.joints:
        if isinstance(p, CamJoint) and p.spatial is None and not p.inverse:
            placed = by_name[p.name]
            drawings.append(_drawing(mechanism, parts, p, p.point, placed, size, samples))
            if placed.mate is not None and p.second is not None:
                second = _drawing(mechanism, parts, p, p.second[0], placed.mate, size, samples)
                drawings.append(replace(second, mate_of=len(drawings) - 1, grounded=False))
    return tuple(drawings)


def _drawing(
    mechanism: Mechanism, parts: Builder, joint: CamJoint, point: str, placed: PlacedCam, size: float, samples: int
) -> CamDrawing:
    z = profile_points(placed, samples)
    if placed.bed is not None:
        deep = -0.25 * float(np.ptp(z.real))
        z = np.concatenate([[complex(z[0].real, deep), complex(z[-1].real, deep)], z[::-1]])
    on_link = (placed.mount_origin + placed.mount * z) / size
    tip = point_of(parts.links[joint.links[1]], point)
    theta = placed.cam.law.start
    guide = placed.cam.follower.guide
    if isinstance(guide, Oscillating):
        _, own = parts.axis_between(joint, joint.links[1], placed.carrier)
        arm = placed.cam.at([theta]).reference[0][0] - guide.pivot
        turn = (tip - own) / abs(tip - own) * abs(arm) / arm
    else:
        loop_joint = next(j for j in parts.joints if j.name == joint.guide)
        first = loop_joint.links[0] == placed.carrier
        turn = placed.axes * np.exp(1j * (-loop_joint.angle if first else loop_joint.angle))
    at_frame = placed.carrier == mechanism.frame
    return CamDrawing(
        joint=joint.name,
        cam=joint.links[0],
        follower=joint.links[1],
        placed=placed,
        size=size,
        profile=outline.largest(Polygon(np.column_stack([on_link.real, on_link.imag])).buffer(0.0)),
        bore=(placed.mount_origin.real / size, placed.mount_origin.imag / size),
        tip=(tip.real / size, tip.imag / size),
        turn=complex(turn),
        theta=theta,
        guide=joint.guide,
        grounded=at_frame and not isinstance(guide, Oscillating),
        bed=at_frame and placed.bed is not None,
    )


def cam_extents(cams: Sequence[CamDrawing]) -> Mapping[str, list[Vec2]]:
    """Corners of the bounding boxes of the cam profiles by link, in units of the size."""
    extents: dict[str, list[Vec2]] = {}
    for cam in cams:
        x0, y0, x1, y1 = cam.profile.bounds
        extents.setdefault(cam.cam, []).extend([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    return extents


_ROLLER_SIDES = 256  # sides of the roller


@dataclass(frozen=True, eq=False)
class InverseCamDrawing:
    """Data for drawing an inverse cam. ``groove``: region swept by the roller, in the driven link's frame; ``tip``: in the
    crank's."""

    joint: str
    crank: str
    driven: str
    groove: Polygon
    ends: tuple[Vec2, Vec2]  # points beyond the ends of the groove, on its body
    tip: Vec2
    radius: float


def find_inverse_cams(mechanism: Mechanism, parts: Builder, size: float) -> tuple[InverseCamDrawing, ...]:
    """All inverse cams of a mechanism."""
    by_name = {r.name: r.geometry for r in parts.relations}
    drawings = []
    for joint in mechanism.joints:
        if not isinstance(joint, CamJoint) or not joint.inverse:
            continue
        placed = by_name[joint.name]
        low, high = placed.travel
        margin = 0.06 * (high - low)
        theta = np.linspace(low - margin, high + margin, _PROFILE_POINTS)
        w = (placed.mount_origin + placed.mount * placed.cam.pitch(theta, 0)[0]) / size
        radius = placed.cam.radius / size
        groove = LineString(np.column_stack([w.real, w.imag])).buffer(radius, quad_segs=64)
        out = [w[0] + 1.6 * radius * (w[0] - w[8]) / abs(w[0] - w[8]), w[-1] + 1.6 * radius * (w[-1] - w[-9]) / abs(w[-1] - w[-9])]
        tip = (placed.tip.real / size, placed.tip.imag / size)
        first, last = ((z.real, z.imag) for z in out)
        drawings.append(InverseCamDrawing(joint.name, joint.links[0], joint.links[1], groove, (first, last), tip, radius))
    return tuple(drawings)


def _group(drawing: InverseCamDrawing) -> str:
    return f"groove {drawing.joint}"


def draw_inverse_cams(model: ScaledMechanism, draft: SolidsDraft) -> None:
    """Add the pieces of all inverse cams."""
    r = model.proportions.half_width
    for drawing in model.inverse_cams:
        group, mates = _group(drawing), frozenset([drawing.joint])
        body = drawing.groove.buffer(max(1.3 * r, 0.9 * drawing.radius), quad_segs=32).difference(drawing.groove)
        draft.pieces.append(PlacedPart(drawing.driven, outline.largest(body), group, "wheel", mates))
        for end in drawing.ends:
            contact_area = outline.polygons(Point(end).buffer(0.5 * r).intersection(body.buffer(-0.05 * r)))
            if contact_area:
                draft.necks.append(Neck(drawing.driven, contact_area[0], (draft.groups[drawing.driven], group)))
        roller = outline.disc(drawing.tip, drawing.radius, _ROLLER_SIDES)
        draft.pieces.append(PlacedPart(drawing.crank, roller, group, "wheel", mates))
        pin = outline.disc(drawing.tip, 0.5 * min(drawing.radius, r), model.segments)
        draft.necks.append(Neck(drawing.crank, pin, (draft.groups[drawing.crank], group)))
