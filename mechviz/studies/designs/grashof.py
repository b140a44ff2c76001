"""Grashof's rule as a limit of designs: lengths of a four-bar loop by the formulas of the scene, for many designs at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mechcore.arrays import Real
from mechcore.errors import Fault, MechanismError
from mechcore.motion.metrics import grashof
from mechcore.spec.mechanism import Mechanism, Revolute
from mechviz.runs import Run
from mechviz.scene.annotations import Place
from mechviz.scene.reading.formulas import formula_values, parameter_arrays
from mechviz.scene.scene import Scene
from mechviz.studies.designs.variables import Variable

SHORTEST = {"crank-rocker": 0, "double-rocker": 1, "double-crank": 3}
"""Which link of crank, coupler, rocker and frame is the shortest, by the type of the linkage; of "any" type none has to be."""
MM = 1e3
STEP = 1e-3  # of a variable's range: formulas of lengths are that smooth
EIGHTH = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))  # weights of differences of eighth order
_OF_MASS = ("mass", "centre", "inertia")


@dataclass(frozen=True)
class FourBarLoop:
    """A four-bar loop and the type that it is to have: two points of each of crank, coupler, rocker and frame."""

    name: str
    type: str
    sides: tuple[tuple[str, str, str], ...]  # link, point, point

    def margin(self, lengths: Real) -> Real:
        """How far (...) [m] lengths (..., 4) keep the rule: the other two links longer than shortest and longest together, and the
        link that is to be shortest shorter than the others. Negative where they are not."""
        free = lengths.sum(axis=-1) - 2.0 * (lengths.min(axis=-1) + lengths.max(axis=-1))
        if self.type not in SHORTEST:
            return np.asarray(free)
        k = SHORTEST[self.type]
        return np.asarray(np.minimum(free, np.delete(lengths, k, axis=-1).min(axis=-1) - lengths[..., k]))

    def margins(self, scene: Scene, variables: Sequence[Variable], designs: Real) -> Real:
        """Margins (D,) [mm] of designs (D, n) of a scene, in the units of its variables."""
        values = {v.name: v.factor * designs[:, k] for k, v in enumerate(variables)}
        document = scene.document
        if all(_known(place) for place in document.formulas if place[0] == "links"):
            wanted = [place for place in document.formulas if place[0] == "links" and place[2] == "points"]
            varied = formula_values(document, parameter_arrays(document, values), wanted)
            return MM * self.margin(self.lengths(scene.mechanism, varied, len(designs)))
        stated = [{v.name: v.stated(float(x)) for v, x in zip(variables, design, strict=True)} for design in designs]
        made = [self.lengths(scene.with_parameters(one).mechanism) for one in stated]
        return MM * self.margin(np.concatenate(made))

    def slopes(self, scene: Scene, variables: Sequence[Variable], design: Real) -> Real:
        """Derivatives (n,) of the margin [mm] by the variables, in their units."""
        steps = np.array([STEP * (v.high - v.low) for v in variables])
        shifts = np.concatenate([sign * k * np.diag(steps) for k, _ in EIGHTH for sign in (1.0, -1.0)])
        sides = self.margins(scene, variables, design + shifts).reshape(len(EIGHTH), 2, len(design))
        return np.asarray(sum(w * (up - down) for (_, w), (up, down) in zip(EIGHTH, sides, strict=True)) / steps)

    def lengths(self, mechanism: Mechanism, varied: Mapping[Place, Real] | None = None, count: int = 1) -> Real:
        """Lengths (D, 4) [m] of crank, coupler, rocker and frame of so many designs; ``varied`` coordinates (D,) by place."""
        varied = {} if varied is None else varied
        points = {link.name: link.points for link in mechanism.links}

        def along(side: tuple[str, str, str], k: int) -> Real:
            link, first, second = side
            at = [varied.get(("links", link, "points", p, k), points[link][p][k]) for p in (first, second)]
            return np.broadcast_to(np.asarray(at[1]) - np.asarray(at[0]), (count,))

        return np.stack([np.hypot(along(side, 0), along(side, 1)) for side in self.sides], axis=-1)


def four_bar_loops(run: Run, type: str) -> list[FourBarLoop]:
    """The four-bar loops of a run, to be of a type. Raises `MechanismError` where there is none."""
    joints = {joint.name: joint for joint in run.motion.mechanism.joints}
    found = []
    for loop in grashof(run.motion.model):
        points: dict[str, list[str]] = {link: [] for link in loop.links}
        for joint in (joints[name] for name in loop.joints):
            assert isinstance(joint, Revolute)
            for link, point in zip(joint.links, joint.points, strict=True):
                points[link].append(point)
        found.append(FourBarLoop("-".join(loop.joints), type, tuple((link, own[0], own[1]) for link, own in points.items())))
    if not found:
        raise MechanismError(Fault("goal.grashof", "the scene has no four-bar loop of revolute joints.", "Leave the key out."))
    return found


def _known(place: Place) -> bool:
    """Whether an expression in a link is that of a coordinate, or moves no point."""
    return place[2] in _OF_MASS or (place[2] == "points" and len(place) == 5)
