"""Equivalent linkages: higher pairs (class IV) replaced by lower ones (class V) at the centres of curvature, at every frame.

Up to accelerations, the touching profiles act like a link between their centres of curvature, pinned to the two links there; where
a profile is straight, its centre lies at infinity and a sliding joint replaces the pin. Cams: centre of curvature of the cam (for a
roller that of the pitch curve, also where the roller drives the cam). Teeth are involutes: their centres of curvature are the
points at which the line of action touches the base circles. A pin in a slot: its block.
"""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Complex, Plane
from mechcore.cams.followers import Flat, Oscillating
from mechcore.cams.placement.inverse import PlacedInverse
from mechcore.cams.synthesis import STRAIGHT, equivalent_linkage
from mechcore.constructions.polygons import frames_of
from mechcore.errors import Fault, MechanismError
from mechcore.forces.kinetostatics import Forces
from mechcore.motion.motion import Motion
from mechcore.records import dataclass
from mechcore.spec.mechanism import CamJoint, Gear, PinSlot, Rack

REPLACED = (CamJoint, Gear, Rack, PinSlot)
"""Kinds of joints that have an equivalent linkage."""


@dataclass(frozen=True, eq=False)
class SlidingBlock:
    """A block at ``place`` (F,) [m] that slides in the direction ``along`` (F,), a unit vector; NaN in frames without one."""

    place: Complex
    along: Complex


@dataclass(frozen=True, eq=False)
class Equivalent:
    """The equivalent of a joint, in the world: ``pins`` by name (F,) [m], NaN at infinity, ``bars`` from pin to pin, ``blocks``."""

    joint: str
    pins: dict[str, Complex]
    bars: tuple[tuple[str, str], ...]
    blocks: tuple[SlidingBlock, ...] = ()


def equivalent(motion: Motion, joint: str, forces: Forces | None = None) -> Equivalent:
    """The equivalent linkage of a cam, gear, rack or pin in a slot. With ``forces``, that of the flank that carries.

    Raises `MechanismError` for other kinds of joints, and for cams about a shaft in the plane.
    """
    spec = next((p for p in motion.mechanism.joints if p.name == joint), None)
    if not isinstance(spec, REPLACED):
        why = f"there is no joint '{joint}'." if spec is None else f"'{joint}' is a lower pair, or no contact of two profiles."
        raise MechanismError(Fault("equivalent", why, "Name a cam, gear, rack or pin in a slot."))
    if isinstance(spec, CamJoint):
        return _cam(motion, spec)
    if isinstance(spec, PinSlot):
        j = motion.model.joint_index[joint]
        place = frames_of(motion.joint_point(j), motion.frames)
        return Equivalent(joint, {"": place}, (), (SlidingBlock(place, frames_of(motion.guide(j), motion.frames)),))
    return _teeth(motion, spec, forces)


def _cam(motion: Motion, joint: CamJoint) -> Equivalent:
    placed = next(r for r in motion.model.relations if r.name == joint.name).geometry
    if isinstance(placed, PlacedInverse):
        return _inverse(motion, placed)
    s = placed.at(motion)
    linkage = equivalent_linkage(s)
    flat = isinstance(placed.cam.follower.face, Flat)
    guide = placed.cam.follower.guide
    place = {"K": linkage.centre, "T": s.contact if flat else s.reference[0]}
    bars = [("K", "T")]
    if not placed.cam.wedge:
        place["O"] = np.zeros_like(linkage.centre)
        bars = [("O", "K"), *bars]
    if isinstance(guide, Oscillating):
        place["P"] = np.full_like(linkage.centre, guide.pivot)
        bars.append(("T", "P"))
    pins = {name: frames_of(placed.to_world(motion, z), motion.frames) for name, z in place.items()}
    world = placed.axes * motion.rotation(motion.model.index[placed.carrier])
    along = frames_of(1j * s.ground_normal * world, motion.frames)
    straight = np.isnan(linkage.centre)
    blocks = [SlidingBlock(pins["T"], np.where(flat | straight, along, np.nan))]
    if placed.cam.wedge:  # it moves in a straight line: its centre of curvature is pinned to a block on its bed
        blocks.append(SlidingBlock(pins["K"], np.where(straight, np.nan, frames_of(world, motion.frames))))
    return Equivalent(joint.name, pins, tuple(bars), tuple(b for b in blocks if np.isfinite(b.along).any()))


def _inverse(motion: Motion, placed: PlacedInverse) -> Equivalent:
    """A rod from the roller's centre T to the centre of curvature K of the slot's centre line, on the driven link."""
    cam, (angle, known) = placed.cam, placed.known_arguments(placed.argument(motion))
    line, first, second = cam.pitch(angle, 2)
    along = first / np.abs(first)
    bend = np.where(known, np.imag(np.conj(first) * second) / np.abs(first) ** 3, np.nan)
    curved = np.abs(bend) * motion.model.length_scale > 1.0 / STRAIGHT
    q = cam.law(angle, 0)[0]
    turn = np.exp(1j * q) if cam.turns else np.ones_like(along)
    with np.errstate(invalid="ignore"):
        centre = turn * (line + 1j * along / np.where(curved, bend, np.nan)) + (0.0 if cam.turns else 1j * q)
    place = {"T": cam.pin(angle, 0)[0], "K": centre}
    bars = [("T", "K")]
    if cam.straight is None:
        place["O"] = np.full_like(centre, cam.centre)
        bars.insert(0, ("O", "T"))
    if cam.turns:
        place["P"] = np.zeros_like(centre)
        bars.append(("K", "P"))
    pins = {name: frames_of(np.where(known, placed.to_world(motion, z), np.nan), motion.frames) for name, z in place.items()}
    slot = np.where(known & ~curved, turn * along * placed.world(motion), np.nan)
    blocks = (SlidingBlock(pins["T"], frames_of(slot, motion.frames)),) if np.isfinite(slot).any() else ()
    return Equivalent(placed.name, pins, tuple(bars), blocks)


def _teeth(motion: Motion, joint: Gear | Rack, forces: Forces | None) -> Equivalent:
    relation = next(r for r in motion.model.relations if r.name == joint.name)
    pitch, force = relation.contact(motion, 1.0)  # the flank that drives the second link with a positive multiplier
    line = force / np.abs(force)
    if isinstance(joint, Rack):
        side = 1.0 if joint.side == "left" else -1.0
        tangent = line * np.exp(1j * side * joint.pressure_angle)
        across = -1j * side * tangent  # from the pinion's axis to the pitch point
        first: Plane = pitch - joint.radius * across
    else:
        across = line * np.exp(1j * (joint.pressure_angle - 0.5 * np.pi))
        tangent = 1j * across
        (_, r1), (_, r2) = relation.angles[:2]
        first, second = pitch - r1 * across, pitch + r2 * across
    if forces is not None:  # the other flank is its mirror image
        reaction = forces.reaction(joint.name)[:, :2] @ np.array([1.0, 1.0j])
        away = np.real(np.conj(tangent) * reaction) < 0.0
        line = np.where(away, 2.0 * np.real(np.conj(tangent) * line) * tangent - line, line)
    pins = {"O1": first, "N1": _foot(first, pitch, line)}
    if isinstance(joint, Rack):  # its flank is straight: the rod's end slides along it
        pins["C"] = pitch
        bars: tuple[tuple[str, str], ...] = (("O1", "N1"), ("N1", "C"))
        blocks: tuple[SlidingBlock, ...] = (SlidingBlock(frames_of(pitch, motion.frames), frames_of(1j * line, motion.frames)),)
    else:
        pins |= {"N2": _foot(second, pitch, line), "O2": second}
        bars, blocks = (("O1", "N1"), ("N1", "N2"), ("N2", "O2")), ()
    return Equivalent(joint.name, {name: frames_of(z, motion.frames) for name, z in pins.items()}, bars, blocks)


def _foot(point: Plane, on: Plane, along: Plane) -> Plane:
    """Foot of the perpendicular from a point to a line."""
    return on + np.real(np.conj(along) * (point - on)) * along
