"""What is summed up over the frames, looked up once per model: constant coefficients by spin, and the slides.

Every vector of a mechanism is ``sum of A E + sum of s d E`` over spins with rotations E and over slides s. Contours are such
sums (`Split` sorts one by what is known when its block is solved), and so is the place of every point (`point_terms`); derivatives
are the same sums over the derivatives of E and of s d E. Looking the coefficients up beforehand leaves only arithmetic for a run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from mechcore.kinematics.model import Block, Model


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
    # of each unknown: which of the contour's vectors turn with it; or its slide, and its column where its guide rests, else None
    places: tuple[tuple[tuple[int, ...], Array], ...]


class Turning(NamedTuple):
    """A contour by what turns in it: ``arms`` (spin, A) of the spins that turn; ``slides`` (joint, spin, d), of which those in
    ``carried`` turn, each given as (its number, joint, spin, d, number of the arm that it adds to)."""

    arms: tuple[tuple[int, Array], ...]
    slides: tuple[tuple[int, int, Array], ...]
    carried: tuple[tuple[int, int, int, Array, int], ...]
    resting: tuple[Array, tuple[tuple[int, Array], ...]]  # sum of the arms that rest, and (joint, d) of the guides that do


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
    arms_of, slides = c.arms, tuple(s for s in c.slides if s[0] in block.slides)
    known_slides = tuple(s for s in c.slides if s[0] not in block.slides)
    if block.kind == "theta_slide" and slides[0][1] == model.angles.spin[0]:  # in the axes of a guide that rests
        ((j, s, d),) = slides
        arms_of = tuple((spin, a * d.conjugate()) for spin, a in arms_of)
        known_slides = tuple((i, spin, other * d.conjugate()) for i, spin, other in known_slides)
        slides = ((j, s, 1 + 0j),)
    unknown = tuple((group[spin], spin, a) for spin, a in arms_of if group[spin] in block.angles)
    spins = dict.fromkeys([s for s, _ in c.arms] + [s for _, s, _ in c.slides])  # as `blocks.vectors` puts them
    turning = [s for s in spins if s != model.angles.spin[0]]
    arms: dict[int, Array] | None = {}
    for g, spin, a in unknown:
        if arms is not None:
            arms[g] = arms[g] + a if g in arms else a
        if model.angles.spin_drives[spin]:
            arms = None
    return Split(
        known=tuple((spin, -a) for spin, a in arms_of if group[spin] not in block.angles),
        unknown=unknown,
        arms=arms,
        known_slides=known_slides,
        slides=slides,
        places=(
            *((tuple(i for i, s in enumerate(turning) if group[s] == g), None) for g in block.angles),
            *(
                ((i,), -1j * d if spin == model.angles.spin[0] else None)
                for j in block.slides
                for i, (k, spin, d) in enumerate(c.slides)
                if k == j
            ),
        ),
    )


def turning(model: Model, contour: int) -> Turning:
    """Sort a contour's vectors by whether they turn."""
    c, frame = model.spin_contours[contour], model.angles.spin[0]
    arms = tuple((s, a) for s, a in c.arms if s != frame)
    spins = list(dict.fromkeys([*(s for s, _ in arms), *(s for _, s, _ in c.slides if s != frame)]))
    return Turning(
        arms=arms,
        slides=c.slides,
        carried=tuple((i, j, s, d, spins.index(s)) for i, (j, s, d) in enumerate(c.slides) if s != frame),
        resting=(sum((a for s, a in c.arms if s == frame), 0j), tuple((j, d) for j, s, d in c.slides if s == frame)),
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
