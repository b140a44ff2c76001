"""Corners of velocity and acceleration plans: the places of a mechanism that are at one point of a link, and how links join
them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mechcore.kinematics.model import Model
from mechcore.motion.motion import Motion
from mechcore.motion.structure import groups

Key = tuple[int, complex]


@dataclass(frozen=True, eq=False)
class Corner:
    """A place that keeps its point on one or more links. ``label``: the name of the point; ``fixed``: it is on the frame."""

    label: str
    keys: tuple[Key, ...]
    fixed: bool

    def of(self, motion: Motion, derivative: int) -> Any:
        """Position, velocity or acceleration of the place."""
        k, local = self.keys[0]
        return motion.of_point(k, local, derivative)


@dataclass(frozen=True)
class Span:
    """Two corners on one link: the second is reached from the first by turning with the link."""

    link: int
    start: int
    end: int


@dataclass(frozen=True)
class Slide:
    """A corner that slides along a guide: from the point of the guide's link that is under it (None: the frame) to the corner."""

    joint: int
    guide: int
    corner: int


def layout(model: Model) -> tuple[list[Corner], list[Span], list[Slide]]:
    """Corners, spans in the order of the hand method (driven links first, then group by group) and slides of a mechanism."""
    near = 1e-9 * model.length_scale
    heaps: list[list[Key]] = []

    def heap(key: Key) -> list[Key]:
        for h in heaps:
            if any(k == key[0] and abs(z - key[1]) <= near for k, z in h):
                return h
        heaps.append([key])
        return heaps[-1]

    sliding: list[tuple[int, int, Key]] = []
    for j, (joint, (p, q)) in enumerate(zip(model.joints, model.ends, strict=True)):
        a, b = (p, complex(joint.a)), (q, complex(joint.b))
        if joint.slide is None:
            first, second = heap(a), heap(b)
            if first is not second:
                first.extend(second)
                heaps[:] = [h for h in heaps if h is not second]
        else:
            surface_mark, guide = (b, p) if joint.guide == 0 else (a, q)
            heap(surface_mark)
            sliding.append((j, guide, surface_mark))
    for link, point in model.mechanism.traced:
        k = model.index[link]
        heap((k, model.points[k][point]))
    joint_at = {key: joint.name for joint, e in zip(model.joints, model.ends, strict=True)
                for key in zip(e, (joint.a, joint.b), strict=True)}  # fmt: skip
    corners = [Corner(_label(model, h, joint_at), tuple(h), any(k == 0 for k, _ in h)) for h in heaps]

    def index(key: Key) -> int:
        return next(i for i, c in enumerate(corners) if any(k == key[0] and abs(z - key[1]) <= near for k, z in c.keys))

    known = {i for i, c in enumerate(corners) if c.fixed}
    surface_marks = {index(surface_mark): guide for _, guide, surface_mark in sliding}
    spans = []
    for group in groups(model):
        members = [model.index[name] for name in group.links]
        while members:
            own = {k: [i for i, c in enumerate(corners) if any(m == k for m, _ in c.keys)] for k in members}
            ready = [k for k in members if any(i in known or surface_marks.get(i) == 0 for i in own[k])]
            k = (ready or members)[0]
            members.remove(k)
            places = sorted(own[k], key=lambda i: (not corners[i].fixed, i not in known, i not in surface_marks))
            if not places:
                continue
            spans += [Span(k, places[0], i) for i in places[1:]]
            known |= set(places)
    return corners, spans, [Slide(j, guide, index(surface_mark)) for j, guide, surface_mark in sliding]


def _label(model: Model, keys: list[Key], joint_at: dict[Key, str]) -> str:
    """The name of the place: of a point there, the one that most links use; else of a joint there."""
    names: dict[str, int] = {}
    for k, local in keys:
        for name, z in model.points[k].items():
            if abs(z - local) <= 1e-9 * model.length_scale:
                names[name] = names.get(name, 0) + 1
    if names:
        return max(names, key=lambda n: (names[n], -len(n)))
    return next((joint_at[key] for key in keys if key in joint_at), model.links[keys[0][0]])
