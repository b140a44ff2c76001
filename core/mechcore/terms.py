"""What is summed up over the frames, looked up once per model: constant coefficients by spin, and the slides.

Every vector of a mechanism is ``sum of A E + sum of s d E`` over spins with rotations E and over slides s. Contours are such
sums (`Split` sorts one by what is known when its block is solved), and so is the place of every point (`point_terms`); derivatives
are the same sums over the derivatives of E and of s d E. Looking the coefficients up beforehand leaves only arithmetic for a run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from .model import Block, Model

__all__ = ["Split", "Terms", "driven_spins", "point_terms", "scaled", "split"]

Array = Any
MOST = 6  # terms of a point: beyond, it is cheaper to go from link to link and share what is common


class Split(NamedTuple):
    """A contour as its block sees it. ``arms``: vectors of the unknown groups in the group's axes, None where drives turn spins
    within a group, which makes them vary."""

    known: tuple[tuple[int, Array], ...]  # (spin, -A)
    unknown: tuple[tuple[int, int, Array], ...]  # (group, spin, A)
    arms: dict[int, Array] | None
    known_slides: tuple[tuple[int, int, Array], ...]  # (joint, spin, d)
    slides: tuple[tuple[int, int, Array], ...]  # of the unknown
    unknown_places: tuple[tuple[int, ...], ...]  # of each unknown: which of the contour's vectors turn with it, or its slide


class Terms(NamedTuple):
    """Place of a point: ``sum of A E`` over spins and ``sum of sign s d E`` over joints."""

    spins: tuple[tuple[int, Array], ...]
    slides: tuple[tuple[int, float], ...]


def driven_spins(model: Model) -> tuple[tuple[int, tuple[tuple[int, int], ...]], ...]:
    """The spins that drives turn against their group, with (drive, sign)."""
    return tuple((s, terms) for s, terms in enumerate(model.angles.spin_drives) if terms)


def split(model: Model, block: Block, contour: int) -> Split:
    """Sort a contour's vectors by what its block solves."""
    c = model.spin_contours[contour]
    group = model.angles.spin_group
    unknown = tuple((group[spin], spin, a) for spin, a in c.arms if group[spin] in block.angles)
    spins = dict.fromkeys([s for s, _ in c.arms] + [s for _, s, _ in c.slides])  # as `blocks.vectors` puts them
    turning = [s for s in spins if s != model.angles.spin[0]]
    arms: dict[int, Array] | None = {}
    for g, spin, a in unknown:
        if arms is not None:
            arms[g] = arms[g] + a if g in arms else a
        if model.angles.spin_drives[spin]:
            arms = None
    return Split(
        known=tuple((spin, -a) for spin, a in c.arms if group[spin] not in block.angles),
        unknown=unknown,
        arms=arms,
        known_slides=tuple(s for s in c.slides if s[0] not in block.slides),
        slides=tuple(s for s in c.slides if s[0] in block.slides),
        unknown_places=(
            *(tuple(i for i, s in enumerate(turning) if group[s] == g) for g in block.angles),
            *(tuple(i for i, s in enumerate(c.slides) if s[0] == j) for j in block.slides),
        ),
    )


def point_terms(model: Model, k: int, local: Array) -> Terms | None:
    """The place of a point of link ``k``, given in link axes; None where the way to the frame is long."""
    spin, turn = model.angles.spin, model.turn
    spins: dict[int, Array] = {}
    slides: dict[int, float] = {}

    def add(link: int, vector: Array, sign: float) -> None:
        if not (isinstance(vector, complex) and vector == 0):
            spins[spin[link]] = spins.get(spin[link], 0j) + sign * vector * turn[link]

    add(k, local, 1.0)
    while k:
        p, j = model.tree.parent[k], model.tree.joint[k]
        joint = model.joints[j]
        side = 1 if model.ends[j][1] == k else 0
        add(p, joint.a if side else joint.b, 1.0)
        add(k, joint.b if side else joint.a, -1.0)
        if joint.slide is not None:
            slides[j] = 1.0 if joint.guide != side else -1.0
        if len(spins) + len(slides) > MOST:
            return None
        k = p
    return Terms(tuple((s, a) for s, a in spins.items() if not (isinstance(a, complex) and a == 0)), tuple(slides.items()))


def scaled(terms: Terms | None, factor: float) -> Terms | None:
    """A sum times a number."""
    if terms is None:
        return None
    return Terms(tuple((s, factor * a) for s, a in terms.spins), tuple((j, factor * sign) for j, sign in terms.slides))
