"""From a scene document to the mechanism that the core computes: SI units, every name resolved."""

from __future__ import annotations

import math

from mechcore.errors import Fault
from mechcore.laws import Law, Table
from mechcore.loads import Factor
from mechcore.spec import Drive, Force, Link, Load, Mechanism, Torque

from .convert import LARGEST, Converter
from .couplings import check_couplings
from .document import LoadDocument, SceneDocument
from .drives import law_of
from .masses import links_that_cannot_turn, mass_properties
from .motions import FactorTable
from .pair_specs import drawn_angle, modes_of, pair_spec
from .pairs import PairDocument
from .placement import place_links
from .references import check_references, resolve_trace
from .validate import Reading

__all__ = ["assemble"]


def assemble(reading: Reading, name: str) -> tuple[Mechanism | None, list[Fault]]:
    """The mechanism, or None, with every fault that is left beside those of form in ``reading.faults``.

    Parts that could not be read are left out; what remains is still converted, since that is where further faults show.
    """
    document = reading.document
    convert = Converter.of(document.units)
    faults = [*check_references(reading), *check_couplings(reading)]
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
    pairs = [pair_spec(key, pair, document, placement, convert) for key, pair in document.pairs.items()]
    drives = []
    for key, pair in document.pairs.items():
        if pair.drive is not None:
            path = f"pairs.{key}.drive"
            drawn = drawn_angle(pair, placement) if pair.coordinate == "angle" else 0.0
            law = law_of(pair.drive, pair.coordinate, convert, path, drawn=drawn, cycles=document.run.cycles)
            if law is not None:
                _check_length(pair, law, convert, path)
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
        answers=tuple(document.answers),
        gravity=gravity,
        modes=modes_of(document),
        sketch={key: pose for key, pose in placement.poses.items() if key != document.frame},
        traced=tuple(traced),
    ), []


def _check_length(pair: PairDocument, law: Law, convert: Converter, path: str) -> None:
    """The drive of a cylinder prescribes the distance of two points, which has to be positive."""
    start = float(law(0.0)[0])
    if pair.kind == "cylinder" and start <= 0.0:
        convert.note(
            path,
            f"the cylinder's length starts at {1e3 * start:g} mm.",
            "Its coordinate is the distance of its two points: give a start, range or centre that is positive.",
        )


def _load(name: str, load: LoadDocument, document: SceneDocument, convert: Converter) -> Load:
    path = f"loads.{name}"
    table = None if load.table is None else _factor(load.table, document, convert, f"{path}.table")
    factor = None if load.table is None or table is None else Factor(function=table, pair=load.table.drive)
    if load.torque is not None:
        moment = convert.si(load.torque, "torque", f"{path}.torque")
        return Torque(name=name, link=load.on, moment=moment, factor=factor)
    assert load.force is not None
    vector = convert.vector(load.force, "force", f"{path}.force")
    point = load.at
    if point is None:
        link = document.links.get(load.on)
        point = next(iter(link.points)) if link is not None else ""
    return Force(name=name, link=load.on, point=point, vector=vector, axes=load.axes, factor=factor)


def _factor(table: FactorTable, document: SceneDocument, convert: Converter, path: str) -> Table | None:
    """A table of factors over the position of a drive [rad or m]; None where a fault was noted."""
    driven = [pair for pair in document.pairs.values() if pair.drive is not None]
    pair = document.pairs.get(table.drive) if table.drive is not None else (driven[0] if driven else None)
    if pair is None:
        return None
    sort = pair.coordinate
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
