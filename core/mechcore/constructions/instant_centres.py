"""Instant centres of all pairs of links, by Kennedy's theorem: the centres of three links lie on one straight line.

A pin is the centre of its two links; that of a sliding joint lies at infinity, across its guide; that of a higher pair lies on the
common normal. Every other centre is where two lines meet, each through two centres known before. Centres are homogeneous
(x, y, w), so that one at infinity (w = 0) is no exception. Where the lines meet is compared with the centre that the solved
velocities give; a pair that no two lines decide (in groups of class III and higher) has the latter alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Literal

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.constructions.polygons import frames_of
from mechcore.kinematics.model import Model
from mechcore.motion.metrics import relative_turns
from mechcore.motion.motion import Motion
from mechcore.records import dataclass

LEAST = 1e-6
"""Sine of the angle between two lines, or distance of two centres, typical of the frames, below which they decide nothing."""
AT_INFINITY = 1e-9
"""A centre farther than the mechanism's size over this is at infinity."""
STILL = 1e-11
"""Rates below this part of the largest in the mechanism are rounding."""
MOST = 6
"""Lines among which the two that meet best are chosen."""

Pair = tuple[int, int]


@dataclass(frozen=True, eq=False)
class CentreLine:
    """A straight line on which a centre lies: through ``base`` (F,) [m] along the unit vectors ``along`` (F,), NaN in frames
    without one. ``through``: names of the two centres that it joins, or of the joint whose common normal it is."""

    through: tuple[str, ...]
    base: Complex
    along: Complex


@dataclass(frozen=True, eq=False)
class InstantCentre:
    """The instant centre of two links: ``place`` (F,) [m], NaN where it lies at infinity, there in the direction ``away`` (F,).

    ``lines``: the two in which it was found; none of joints. ``gap`` (F,) [m]: how far from the centre by velocities the lines
    meet, NaN where they do not.
    """

    links: tuple[str, str]
    found_by: Literal["joint", "lines", "velocities"]
    place: Complex
    away: Complex
    lines: tuple[CentreLine, ...]
    gap: Real


@dataclass(frozen=True, eq=False)
class _Locus:
    """A line (F, 3) on which a centre lies: through two others, or the common normal of a joint."""

    line: Real
    pairs: tuple[Pair, ...] = ()
    joint: str = ""


def kennedy(motion: Motion, links: Sequence[str] = ()) -> dict[str, InstantCentre]:
    """The instant centres of every two of some links (none named: of all) and those that their lines run through.

    By their names: P01 is that of the frame, number 0, and of the first link in the model's order. From the motion per unit of the
    first drive, which may stand still. Links that do not move against each other are one.
    """
    model, n = motion.model, motion.frames
    scene = _Scene(motion)
    true, bodies = scene.centres()
    normals = scene.normals(bodies, true)
    loci: dict[Pair, tuple[_Locus, ...]] = {pair: () for pair in _pins(model, bodies) if pair in true}
    while fresh := {p: _best(p, sorted(set(bodies)), loci, true, normals) for p in true if p not in loci}:
        loci |= {p: two for p, two in fresh.items() if two}  # in rounds: each centre by as short a chain as there is
        if not any(fresh.values()):
            break
    asked = {bodies[model.index[link]] for link in links} if links else set(bodies)
    wanted = [pair for pair in true if set(pair) <= asked]
    for pair in wanted:  # grows while it is walked through
        wanted += [other for locus in loci.get(pair, ()) for other in locus.pairs if other not in wanted]
    name = instant_centre_names(len(model.links))
    out = {}
    for pair in sorted(set(wanted)):
        place, away = scene.point(true[pair])
        two = loci.get(pair, ())
        lines = tuple(
            CentreLine(tuple(name[p] for p in locus.pairs) or (locus.joint,), *scene.straight(locus.line)) for locus in two
        )
        meeting = _unit(np.cross(two[0].line, two[1].line), LEAST) if two else np.full((n, 3), np.nan)
        gap = np.abs(scene.point(meeting)[0] - place)
        how: Literal["joint", "lines", "velocities"] = "velocities" if pair not in loci else "lines" if two else "joint"
        out[name[pair]] = InstantCentre((model.links[pair[0]], model.links[pair[1]]), how, place, away, lines, gap)
    return out


def instant_centre_names(links: int) -> dict[Pair, str]:
    """P01, P02 ...: the names of the centres of so many links, numbered from the frame, which is 0."""
    comma = "," if links > 10 else ""
    return {(a, b): f"P{a}{comma}{b}" for a, b in combinations(range(links), 2)}


class _Scene:
    """Homogeneous coordinates about the middle of a mechanism's joints, in units of its size."""

    def __init__(self, motion: Motion):
        self.motion, self.size = motion, motion.model.length_scale
        places = [frames_of(motion.joint_point(j), motion.frames) for j in range(len(motion.model.joints))]
        self.middle = complex(np.nanmean(places)) if places else 0j

    def centres(self) -> tuple[dict[Pair, Real], list[int]]:
        """Unit vectors (F, 3) of the centres by velocities, NaN where two links do not move against each other, and of each link
        the lowest number of those against which it never moves: only these have centres."""
        crosses: dict[Pair, Real] = {}
        index = self.motion.model.index
        for (first, second), (turn, shift) in relative_turns(self.motion).items():
            at = (-1j * shift - turn * self.middle) / self.size
            crosses[index[first], index[second]] = np.stack([at.real, at.imag, turn], axis=-1)
        sizes = {pair: np.linalg.norm(c, axis=-1) for pair, c in crosses.items()}
        least = STILL * np.fmax.reduce([*sizes.values(), np.zeros(self.motion.frames)])
        bodies = list(range(len(index)))
        for (a, b), size in sizes.items():
            if not (size > least).any():
                bodies = [bodies[a] if k == bodies[b] else k for k in bodies]
        return {(a, b): _unit(c, least[:, None]) for (a, b), c in crosses.items() if bodies[a] == a and bodies[b] == b}, bodies

    def normals(self, bodies: Sequence[int], true: Mapping[Pair, Real]) -> dict[Pair, list[_Locus]]:
        """Common normals of higher pairs by links; not of joints out of the plane, whose centre does not lie on it."""
        motion, model = self.motion, self.motion.model
        lines = [(j.name, e, motion.joint_point(k), 1j * motion.guide(k))
                 for k, (j, e) in enumerate(zip(model.joints, model.ends, strict=True)) if j.freedoms == 2]  # fmt: skip
        lines += [(r.name, (model.index[r.links[0]], model.index[r.links[1]]), *r.contact(motion, 1.0)) for r in model.relations]
        loci_of: dict[Pair, list[_Locus]] = {}
        for name, ends, at, along in lines:
            pair = _pair(bodies, ends)
            z, d = ((frames_of(v, motion.frames) - m) / s for v, m, s in ((at, self.middle, self.size), (along, 0j, 1.0)))
            line = _unit(np.stack([-d.imag, d.real, z.real * d.imag - z.imag * d.real], axis=-1))
            if pair in true and _typical(np.abs((line * true[pair]).sum(axis=-1))) < LEAST:
                loci_of.setdefault(pair, []).append(_Locus(line, joint=name))
        return loci_of

    def point(self, c: Real) -> tuple[Complex, Complex]:
        """The place (F,) of a homogeneous point (F, 3), NaN at infinity, and the direction (F,) in which it lies there."""
        with np.errstate(invalid="ignore", divide="ignore"):
            far = np.abs(c[:, 2]) <= AT_INFINITY * np.hypot(c[:, 0], c[:, 1])
            z = c[:, 0] + 1j * c[:, 1]
            place = self.middle + self.size * z / np.where(far, np.nan, c[:, 2])
            return np.asarray(place, complex), np.asarray(np.where(far, z / np.abs(z), np.nan), complex)

    def straight(self, line: Real) -> tuple[Complex, Complex]:
        """The point of a line (F, 3) nearest to the middle, and its direction (F,); NaN of the line at infinity."""
        across = line[:, 0] + 1j * line[:, 1]
        with np.errstate(invalid="ignore", divide="ignore"):
            across = np.where(np.abs(across) > AT_INFINITY, across, np.nan)
            base = np.asarray(self.middle - self.size * line[:, 2] * across / np.abs(across) ** 2, complex)
            return base, np.asarray(1j * across / np.abs(across), complex)


def _pair(bodies: Sequence[int], ends: tuple[int, int]) -> Pair:
    a, b = sorted(bodies[k] for k in ends)
    return a, b


def _pins(model: Model, bodies: Sequence[int]) -> set[Pair]:
    """Pairs of links joined by a lower pair with one freedom: its centre is known."""
    bound = {r.name for r in model.relations}
    joints = zip(model.joints, model.ends, strict=True)
    return {_pair(bodies, ends) for joint, ends in joints if joint.freedoms == 1 and joint.name not in bound}


def _best(
    pair: Pair, bodies: Sequence[int], known: Mapping[Pair, object], true: Mapping[Pair, Real], normals: Mapping[Pair, list[_Locus]]
) -> tuple[_Locus, ...]:
    """The two lines on which a centre lies that meet under the largest angle, typical of the frames; none where they do not."""
    a, b = pair
    candidates = [*normals.get(pair, ())]
    for k in bodies:
        p, q = (min(a, k), max(a, k)), (min(b, k), max(b, k))
        if k in pair or p not in known or q not in known or len(candidates) == MOST:
            continue
        line = np.cross(true[p], true[q])
        if _typical(np.linalg.norm(line, axis=-1)) > LEAST:
            candidates.append(_Locus(_unit(line), (p, q)))
    best: tuple[_Locus, ...] = ()
    most = LEAST
    for first, second in combinations(candidates, 2):
        meeting = _typical(np.linalg.norm(np.cross(first.line, second.line), axis=-1))
        if meeting > most:
            best, most = (first, second), meeting
    return best


def _typical(values: Real) -> float:
    good = values[np.isfinite(values)]
    return float(np.median(good)) if len(good) else 0.0


def _unit(vectors: Real, least: Real | float = 0.0) -> Real:
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(size > least, vectors / size, np.nan))
