"""The axis of a link, along which its section forces are stated: a chain of straight segments through points of the link."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mechcore.arrays import Complex, Flags, Index, Real
from mechcore.errors import Fault, MechanismError
from mechcore.spec.mechanism import CamJoint, Link, Mechanism

STRAIGHT = 1e-9
"""Distance from a line, relative to its length, up to which points lie on it."""


class Cuts(NamedTuple):
    """Cuts through a link at ``stations`` (...) of its axis [m]: just behind them where ``sides`` are +1, just before where -1."""

    stations: Real
    sides: Real

    def before(self, station: float | Real) -> Flags:
        """Whether what acts at a station lies beyond the cuts."""
        return np.asarray((station > self.stations) | ((station == self.stations) & (self.sides < 0.0)))

    def taken(self, order: Index) -> Cuts:
        """The cuts (F, n) of these numbers in each frame (F, m)."""
        return Cuts(*(np.take_along_axis(np.broadcast_to(v, self.stations.shape), order, axis=1) for v in self))


@dataclass(frozen=True, eq=False)
class Axis:
    """The chain of segments between ``vertices`` (V,), complex places in the link's frame [m], the first at station 0."""

    vertices: Complex

    @cached_property
    def stations(self) -> Real:
        """Stations (V,) of the vertices: lengths along the axis from its start [m]."""
        return np.concatenate([[0.0], np.cumsum(np.abs(np.diff(self.vertices)))])

    @property
    def length(self) -> float:
        return float(self.stations[-1])

    @cached_property
    def directions(self) -> Complex:
        """Unit vectors (V - 1,) of the segments."""
        chords = np.diff(self.vertices)
        return chords / np.abs(chords)

    @cached_property
    def straight(self) -> bool:
        return bool(np.abs(np.imag(self.directions[1:] * np.conj(self.directions[0]))).max(initial=0.0) <= STRAIGHT)

    def segment(self, cuts: Cuts) -> Index:
        """Number of the segment that each cut goes through."""
        behind, before = (np.searchsorted(self.stations, cuts.stations, side=side) - 1 for side in ("right", "left"))
        return np.clip(np.where(cuts.sides > 0.0, behind, before), 0, len(self.directions) - 1)

    def place(self, cuts: Cuts) -> Complex:
        """Places of cuts in the link's frame [m]."""
        k = self.segment(cuts)
        return self.vertices[k] + (cuts.stations - self.stations[k]) * self.directions[k]

    def nearest(self, place: complex | Complex) -> Real:
        """The station of the axis nearest to each place of the link's frame [m]."""
        z = np.asarray(place)[..., None] - self.vertices[:-1]
        lengths = np.diff(self.stations)
        along = np.clip(np.real(z * np.conj(self.directions)), 0.0, lengths)
        apart = np.abs(z - along * self.directions)
        chosen = np.argmin(np.where(np.isfinite(apart), apart, np.inf), axis=-1)[..., None]
        return np.asarray(np.take_along_axis(self.stations[:-1] + along, chosen, axis=-1)[..., 0])


def axis_of(mechanism: Mechanism, link: str, points: Sequence[str] = ()) -> Axis:
    """The axis of a link through the named points, or through those of `axis_points`. Raises `MechanismError`."""
    body = next(k for k in mechanism.links if k.name == link)
    names = points or axis_points(mechanism, body)
    vertices = np.array([complex(*body.points[name]) for name in names])
    steps = np.abs(np.diff(vertices))
    if len(steps) == 0 or steps.min() <= STRAIGHT * steps.sum():
        k = int(np.argmin(steps)) if len(steps) else 0
        why = f"'{names[k]}' and '{names[k + 1]}' are at one place." if len(steps) else f"the axis has one point, '{names[0]}'."
        raise MechanismError(Fault(f"sections.{link}.along", why, "Name at least two points of the link, one after the other."))
    return Axis(vertices)


def axis_points(mechanism: Mechanism, link: Link) -> tuple[str, ...]:
    """The ends of the axis of a link that states none.

    They are the outermost of the points at which joints and loads act, where these lie on one line; else of those at which joints
    act, and where there are not two of these, of all points of the link. Raises `MechanismError` where they do not lie on a line.
    """
    jointed, loaded = _joint_points(mechanism, link.name), _load_points(mechanism, link.name)
    choices = [[*jointed, *loaded], jointed, list(link.points)]
    for names in choices:
        ends = _ends(link, names)
        if ends:
            return ends
    named = ", ".join(dict.fromkeys(choices[0] or choices[2]))
    why = f"the axis of '{link.name}' is not clear: its points {named} do not lie on one line."
    if len(link.points) == 1:
        why = f"'{link.name}' has one point, '{named}', and no axis."
        raise MechanismError(Fault(f"sections.{link.name}", why, "Give the link another point at the other end of its axis."))
    raise MechanismError(Fault(f"sections.{link.name}", why, 'Say where it runs: along = ["A", "B"], points of the link.'))


def _ends(link: Link, names: Sequence[str]) -> tuple[str, ...]:
    """The outermost of some points in the order of the scene; none where they do not lie on one line."""
    known = [name for name in link.points if name in names]
    z = np.array([complex(*link.points[name]) for name in known])
    if len(z) < 2 or not (reach := np.abs(z - z[0])).any():
        return ()
    along = (z - z[0]) * np.conj(z[np.argmax(reach)] - z[0]) / reach.max()
    if np.abs(along.imag).max() > STRAIGHT * np.ptp(along.real):
        return ()
    ends = sorted((int(np.argmin(along.real)), int(np.argmax(along.real))))
    return known[ends[0]], known[ends[1]]


def _joint_points(mechanism: Mechanism, link: str) -> list[str]:
    found = []
    for joint in mechanism.joints:
        ends = [*zip(getattr(joint, "links", ()), getattr(joint, "points", ()), strict=False)]
        if isinstance(joint, CamJoint):
            ends.append((joint.links[0 if joint.inverse else 1], joint.point))
        found += [point for k, point in ends if k == link and point is not None]
    return found


def _load_points(mechanism: Mechanism, link: str) -> list[str]:
    found = []
    for load in mechanism.loads:
        ends = [*zip(getattr(load, "links", ()), getattr(load, "points", ()), strict=False)]
        ends.append((getattr(load, "link", None), getattr(load, "point", None)))
        found += [point for k, point in ends if k == link and isinstance(point, str)]
    return found
