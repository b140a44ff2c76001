"""From a scene document to the mechanism that the core computes: SI units, every name resolved."""

from __future__ import annotations

import math
from typing import Literal

from mechcore.errors import Fault
from mechcore.laws import Table
from mechcore.spec import Drive, Force, Link, Load, Mechanism, Pair, Prismatic, Revolute, Torque

from .convert import LARGEST, Converter
from .document import LoadDocument, PairDocument, SceneDocument
from .drives import law_of
from .masses import links_that_cannot_turn, mass_properties
from .motions import FactorTable
from .placement import Placement, place_links
from .references import check_references, points_of_pair, resolve_trace
from .validate import Reading

__all__ = ["assemble"]


def assemble(reading: Reading, name: str) -> tuple[Mechanism | None, list[Fault]]:
    """The mechanism, or None, with every fault that is left beside those of form in ``reading.faults``.

    Parts that could not be read are left out; what remains is still converted, since that is where further faults show.
    """
    document = reading.document
    convert = Converter.of(document.units)
    faults = list(check_references(reading))
    placement = place_links(document, convert)
    parallel = links_that_cannot_turn(document)
    links = []
    for key, link in document.links.items():
        points = placement.points.get(key)
        if points:
            settled = key == document.frame or key in reading.broken["links"]  # nothing is missing, or it is not known
            effects = () if settled else tuple(document.effects)
            mass, centre, inertia = mass_properties(key, link, points, effects, convert, can_turn=key not in parallel)
            links.append(Link(name=key, points=points, mass=mass, centre=centre, inertia=inertia))
    pairs = [_pair(key, pair, placement, convert) for key, pair in document.pairs.items()]
    drives = []
    for key, pair in document.pairs.items():
        if pair.drive is not None:
            drawn = _drawn_angle(pair, placement)
            sort = "angle" if pair.kind == "revolute" else "length"
            law = law_of(pair.drive, sort, convert, f"pairs.{key}.drive", drawn=drawn, cycles=document.run.cycles)
            if law is not None:
                drives.append(Drive(pair=key, law=law))
    loads = [_load(key, load, document, convert) for key, load in document.loads.items()]
    gravity = convert.vector(document.gravity, "gravity", "gravity")
    faults += convert.faults
    if faults or reading.faults:
        return None, faults
    traced = [found for text in document.trace if not isinstance(found := resolve_trace(reading, text), Fault)]
    return Mechanism(
        name=name,
        frame=document.frame,
        links=tuple(links),
        pairs=tuple(pairs),
        drives=tuple(drives),
        loads=tuple(loads),
        effects=tuple(document.effects),
        gravity=gravity,
        modes={key: pair.mode for key, pair in document.pairs.items() if pair.mode is not None},
        sketch={key: pose for key, pose in placement.poses.items() if key != document.frame},
        traced=tuple(traced),
    ), []


def _pair(name: str, pair: PairDocument, placement: Placement, convert: Converter) -> Pair:
    points = points_of_pair(name, pair)
    if pair.kind == "revolute":
        return Revolute(name=name, links=pair.links, points=points)
    guide: Literal[0, 1] = 1 if pair.guide == pair.links[1] else 0
    along = (1.0, 0.0)
    if pair.along is not None:
        a, b = pair.along
        if isinstance(a, str) and isinstance(b, str):
            places = placement.points.get(pair.links[guide], {})
            pa, pb = places.get(a, (0.0, 0.0)), places.get(b, (1.0, 0.0))
            along = (pb[0] - pa[0], pb[1] - pa[1])
            if along == (0.0, 0.0):
                convert.note(
                    f"pairs.{name}.along",
                    f"'{a}' and '{b}' are at the same place.",
                    "Name two different points, or write a direction such as [1, 0].",
                )
        else:
            along = (float(a), float(b))
    if pair.angle is not None:
        angle = convert.si(pair.angle, "angle", f"pairs.{name}.angle")
    elif placement.drawn.issuperset(pair.links):
        first, second = (placement.poses[link][2] for link in pair.links)
        angle = math.remainder(second - first, 2.0 * math.pi)
    else:
        angle = 0.0
    return Prismatic(name=name, links=pair.links, points=points, along=along, guide=guide, angle=angle)


def _drawn_angle(pair: PairDocument, placement: Placement) -> float:
    """The coordinate of a revolute pair between two drawn links [rad]; 0 for any other pair."""
    if pair.kind != "revolute" or not placement.drawn.issuperset(pair.links):
        return 0.0
    first, second = (placement.poses[link][2] for link in pair.links)
    return math.remainder(second - first, 2.0 * math.pi)


def _load(name: str, load: LoadDocument, document: SceneDocument, convert: Converter) -> Load:
    path = f"loads.{name}"
    factor = None if load.table is None else _factor(load.table, document, convert, f"{path}.table")
    drive = None if load.table is None else load.table.drive
    if load.torque is not None:
        moment = convert.si(load.torque, "torque", f"{path}.torque")
        return Torque(name=name, link=load.on, moment=moment, factor=factor, drive=drive)
    assert load.force is not None
    vector = convert.vector(load.force, "force", f"{path}.force")
    point = load.at
    if point is None:
        link = document.links.get(load.on)
        point = next(iter(link.points)) if link is not None else ""
    return Force(name=name, link=load.on, point=point, vector=vector, axes=load.axes, factor=factor, drive=drive)


def _factor(table: FactorTable, document: SceneDocument, convert: Converter, path: str) -> Table | None:
    """A table of factors over the position of a drive [rad or m]; None where a fault was noted."""
    driven = [pair for pair in document.pairs.values() if pair.drive is not None]
    pair = document.pairs.get(table.drive) if table.drive is not None else (driven[0] if driven else None)
    if pair is None:
        return None
    sort = "angle" if pair.kind == "revolute" else "length"
    x, y = convert.row(table.position, sort, f"{path}.position"), tuple(table.factor)
    for k, value in enumerate(y):
        if abs(value) > LARGEST:
            convert.note(f"{path}.factor[{k}]", f"{value:g} is beyond {LARGEST:g}.", "Check the number.")
            return None
    if not convert.increasing(x, f"{path}.position"):
        return None
    if table.period is None:
        return _spline(x, y, None, table, convert, path)
    period = convert.si(table.period, sort, f"{path}.period")
    span = x[-1] - x[0]
    if math.isclose(span, period, rel_tol=1e-12):  # the closing row is a repetition of the first one
        if y[-1] != y[0]:
            convert.note(
                f"{path}.factor[{len(y) - 1}]",
                f"differs from the first factor, {y[0]:g}, one period before.",
                "Give both the same factor, or leave out the last row.",
            )
            return None
        x, y = x[:-1], y[:-1]
    elif span > period:
        convert.note(f"{path}.period", "is shorter than the range of the positions.", "Give a longer period, or fewer rows.")
        return None
    return _spline(x, y, period, table, convert, path)


def _spline(
    x: tuple[float, ...], y: tuple[float, ...], period: float | None, table: FactorTable, convert: Converter, path: str
) -> Table | None:
    """The table as a function; None, and a fault, where its rows are so close that nothing smooth goes through them."""
    try:
        return Table(x=x, y=y, period=period, smooth=table.smooth)
    except ValueError:
        convert.note(f"{path}.position", "the rows are too close to each other.", "Leave out some of them.")
        return None
