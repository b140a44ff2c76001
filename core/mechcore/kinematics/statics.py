"""What forces need of a model, looked up once: weights, bodies with mass, and which links decide the forces in the cuts."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from mechcore.kinematics.terms import Terms, scaled
from mechcore.numerics.frames import minus, plus

if TYPE_CHECKING:
    from mechcore.effects.base import Effect
    from mechcore.kinematics.model import Block, Model


Array = Any


Arm = tuple[int, Array, tuple[int, int, int] | None]
"""(spin, vector in its axes, None), or (spin, vector, (link, joint, side)) where a slide is part of it: see `Motion.arm`."""

Hanging = tuple[tuple[int, int, Arm | None, Arm | None], ...]
"""Links inwards, each with the link that it hangs on, and the arms at which its force acts on it and on that link; None where the
moment is not asked for, or the force acts at the link's origin."""

Put = Callable[[Array, Array], Array]  # `plus` or `minus`


class Balance(NamedTuple):
    """What balances at an unknown: the moments on the ``links`` of an angle, or the force that hangs on a ``child`` along its
    guide (``back``: against it); and the forces in the cuts of later blocks, their contours and relations, in which it appears."""

    unknown: tuple[str, int]
    links: tuple[int, ...]
    child: int  # 0: none
    back: bool
    contours: tuple[int, ...]
    relations: tuple[int, ...]


class Acting(NamedTuple):
    """What an effect puts on a link at a point fixed in it: a constant force, the inertia force of a mass there, -J alpha."""

    link: int
    point: Array  # in link axes [m]; in a sweep it may vary, (designs, 1)
    force: complex = 0j  # in the world [N]
    mass: float = 0.0  # [kg]
    inertia: float = 0.0  # J [kg m^2]


class Carried(NamedTuple):
    """All that is `Acting` at one point of a link. ``opposed``: -mass times its place as a sum, None where that is too long."""

    link: int
    point: Array
    arm: Array  # the point in the axes of its spin; None: the link's origin, about which forces have no moment
    force: complex
    mass: float
    inertia: float
    spin: int
    opposed: Terms | None


class KnownLoads(NamedTuple):
    """What `Acting` says of all effects. ``accelerated``: whether inertia is among it."""

    carried: tuple[Carried, ...]
    accelerated: bool
    others: tuple[Effect, ...]  # applied effects that have to be evaluated


def balances(model: Model) -> tuple[tuple[int, Block, tuple[Balance, ...]], ...]:
    """The blocks from the last back to the first, each with its number and its unknowns."""

    def balance(unknown: tuple[str, int]) -> Balance:
        what, i = unknown
        if what == "angle":
            return Balance(unknown, model.angles.links_of[i], 0, False, *model.later[unknown])
        k = model.child.get(i, 0)  # of a tree joint: what hangs on the child moves along the guide
        return Balance(unknown, (), k, k != 0 and model.ends[i][model.joints[i].guide] == k, *model.later[unknown])

    return tuple((i, b, tuple(balance(u) for u in b.unknowns)) for i, b in enumerate(model.blocks))[::-1]


def closings(model: Model) -> tuple[tuple[int, tuple[tuple[int, Put, Arm | None], ...]], ...]:
    """The joint that closes each contour, with the moving links that the force in its cut acts on, whether it adds to their forces
    or is taken from them, and its arm where the moment is asked for."""
    found = []
    for contour in model.contours:
        j = contour.closing
        sides = ((k, put, side) for side, (k, put) in enumerate(zip(model.ends[j], (minus, plus), strict=True)) if k)
        found.append((j, tuple((k, put, _arm(model, model.passing, k, j, side)) for k, put, side in sides)))
    return tuple(found)


def _arm(model: Model, wanted: Container[int], k: int, j: int, side: int) -> Arm | None:
    """The arm of a joint's force on a link; None where it is zero, or the moment on the link is not ``wanted``."""
    joint = model.joints[j]
    at = joint.b if side else joint.a
    slides = joint.slide is not None and joint.guide == side
    still = isinstance(at, complex) and at == 0 and not slides
    return None if still or k not in wanted else (model.angles.spin[k], at * model.turn[k], (k, j, side) if slides else None)


def weights(model: Model) -> tuple[tuple[int, complex, complex], ...]:
    """(link, weight [N], centre of mass in link axes [m]) of every moving link that has a weight."""
    found = []
    for k, (mass, centre, _) in enumerate(model.masses):
        own = model.bodies[model.links[k]].gravity
        if k and mass:
            found.append((k, mass * complex(*(model.mechanism.gravity if own is None else own)), centre))
    return tuple(found)


def carried(model: Model, acting: Iterable[Acting]) -> tuple[Carried, ...]:
    """What acts at points of moving links, all at one point in one sum."""
    found: dict[tuple[int, Any], Acting] = {}
    for a in acting:
        key = a.link, a.point if isinstance(a.point, complex) else id(a.point)
        b = found.get(key, Acting(a.link, a.point))
        found[key] = Acting(a.link, a.point, a.force + b.force, a.mass + b.mass, a.inertia + b.inertia)
    out = []
    for (k, _), (_, point, force, mass, inertia) in found.items():
        if k:
            opposed = scaled(model.terms(k, point), -mass) if mass else None
            still = isinstance(point, complex) and point == 0
            arm = None if still else point * model.turn[k]
            out.append(Carried(k, point, arm, force, mass, inertia, model.angles.spin[k], opposed))
    return tuple(out)


def hanging(model: Model, wanted: Container[int], order: Sequence[int]) -> Hanging:
    """Which forces hang where: over the links of ``order``, the moments on the links ``wanted``."""
    found, among = [], frozenset(order)
    for k in order:
        j, side, p = model.steps[k]
        on = _arm(model, wanted, p, j, 1 - side) if p else None
        own = _arm(model, wanted, k, j, side)
        if (p and p in among) or own is not None or on is not None:
            found.append((k, p, own, on))
    return tuple(found)


def subtree_loads(model: Model) -> tuple[int, ...]:
    """Links, inwards, whose hanging force decides the forces in the cuts; that of the others only passes to the frame."""
    parent = model.tree.parent
    needed = {model.child[j] for b in model.blocks for j in b.slides if j in model.child}
    needed |= {k for k in model.tree.order if k in model.grouped or parent[k] in model.grouped}
    for k in model.tree.order:  # parents first: all that hangs on a link that is needed is needed too
        if parent[k] in needed:
            needed.add(k)
    return tuple(k for k in model.inwards if k in needed)
