"""The values of a scene that can be edited: found by traversing its document, each with its unit and a useful range.

Apart from groups and labels, nothing here depends on a particular scene or keyword: the types of the document state which values
are quantities, of which kind, and their bounds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import groupby
from typing import Any, Literal, get_args, get_origin

import numpy as np

from mechcore.laws.factors import ORDER_NAMES
from mechcore.records import dataclass
from mechviz.editor.laws import LAW_OPTIONS, law_changes
from mechviz.scene.annotations import Leaf, Place, leaves
from mechviz.scene.document import SceneDocument, value_at
from mechviz.scene.expressions import is_plain, parse_expression
from mechviz.scene.fields import DocumentTable, QuantityMark
from mechviz.scene.kinds.joints.cam_documents import SOLIDS
from mechviz.scene.kinds.segments import LawDocument, SegmentTable
from mechviz.scene.kinds.settings import ParameterDocument
from mechviz.scene.scene import Scene
from mechviz.scene.units import DERIVATIVES, UNIT_KINDS, QuantityError, Units, split, symbol_of, unit_factor, unit_of

LONGEST_LIST = 4  # longer lists are edited as texts, not by sliders
HIDDEN = {"units", "parameters", "run", "along", "bulges", "watch", "mesh_unit"}  # texts, directions, settings of the computation
CURVE_SAMPLES = 257  # of a curve, for its largest derivative
RANGE_STEPS = 1000  # approximate number of steps over a range
WIDEST_RANGE = 20.0  # how much wider than the first range a typed value may make it
BARE = {
    "linear speed": "{length}/{time}",
    "angular speed": "{angle}/{time}",
    "frequency": "1/{time}",
    "stiffness": "{force}/{length}",
}
GROUPS = ("Parameters", "Lengths", "Drive", "Cam", "Loads and springs", "Masses", "Friction", "Assembly", "Other")


@dataclass(frozen=True)
class Parameter:
    """A number of a scene: ``value`` as it is shown, in ``unit``, between ``low`` and ``high``, in steps of ``step``; a typed value
    may lie between ``hard_low`` and ``hard_high``.

    ``suffix`` is the unit in the text of the file where it stands there, "" for a bare number. ``sign`` is the factor between the
    shown and the written value: a length is shown positive, on whichever side of the origin of its link its point lies. ``whole``:
    an integer.
    """

    path: Place
    group: str
    label: str
    value: float
    unit: str
    low: float
    high: float
    step: float
    hard_low: float
    hard_high: float
    suffix: str = ""
    sign: float = 1.0
    whole: bool = False

    @property
    def title(self) -> str:
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    @property
    def key(self) -> str:
        """One text for the place: ``links.crank.points.B[0]``."""
        return place_key(self.path)

    def written(self, value: float) -> float | int | str:
        """The value in the file for a shown value: a number, or a text with its unit."""
        number = round(value) if self.whole else float(f"{self.sign * value:.12g}")
        return f"{number!r} {self.suffix}" if self.suffix else number

    def text(self, value: float) -> str:
        """A value with its unit."""
        return f"{value:.6g} {self.unit}".strip()


@dataclass(frozen=True)
class Choice:
    """A value of a scene that is one of a few texts."""

    path: Place
    group: str
    label: str
    value: str
    options: tuple[str, ...]

    @property
    def key(self) -> str:
        return place_key(self.path)

    def changes(self, scene: Scene, option: str) -> dict[Place, Any]:
        """The changes of a scene for another option."""
        return law_changes(scene, self.path, option) if self.path[-1] == "law" else {self.path: option}


def place_key(path: Place) -> str:
    """A place in the document as a text."""
    return "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in path).lstrip(".")


def find_parameters(scene: Scene, opened: SceneDocument | None = None) -> tuple[Parameter, ...]:
    """All numbers of a scene that are useful as sliders, in the order of ``GROUPS`` and of the file.

    ``opened``: the document from which the scene was edited; coordinates of points that it shows one by one are shown so also where
    they have become zero.
    """
    document = scene.document
    leaves_shown = (leaf for leaf in _editable_leaves(document) if not _options(leaf))
    parameters = [p for leaf in leaves_shown if (p := _parameter(scene, leaf, opened)) is not None]
    parameters = [*_named(scene), *_scaled(parameters)]
    return tuple(sorted(parameters, key=lambda p: (GROUPS.index(p.group), "–" not in p.label)))


def find_choices(scene: Scene) -> tuple[Choice, ...]:
    """All values that are one of a few texts: laws of motion, assembly modes, senses. A law that is a table has its kind as value,
    which is none of the options."""
    choices = [
        Choice(path, group_of(path), label_of(path), f"{law.kind}, as stated", LAW_OPTIONS)
        for path, law in _law_tables(scene.document)
    ]
    for leaf in _editable_leaves(scene.document):
        options = _options(leaf)
        if len(options) > 1 and isinstance(leaf.value, str) and leaf.path[0] in ("joints", "loads", "links"):
            choices.append(Choice(leaf.path, group_of(leaf.path), label_of(leaf.path), leaf.value, options))
    return tuple(sorted(choices, key=lambda c: GROUPS.index(c.group)))


def marked_series(document: SceneDocument) -> Iterator[tuple[Place, str, str, list[Place]]]:
    """Series of numbered points of a link, such as P1, P2 ..., that are no joints, of more than `LONGEST_LIST` points: the place,
    the key and the label of each series, and the places of its points."""
    for link, entry in document.links.items():
        names = entry.points if isinstance(entry.points, dict) else ()
        for stem, group in groupby(names, lambda name: name.rstrip("0123456789")):
            members = list(group)
            if len(members) > LONGEST_LIST and stem not in members and document.joints.keys().isdisjoint(members):
                label = f"{link} {members[0]} to {members[-1]}"
                home: Place = ("links", link, "points")
                yield (*home, stem, 0), f"{place_key(home)}.{stem}", label, [(*home, name) for name in members]


def _law_tables(document: SceneDocument) -> Iterator[tuple[Place, LawDocument]]:
    """The laws that are tables, by their places."""
    within = (leaf.path[: leaf.path.index("law") + 1] for leaf in leaves(document) if "law" in leaf.path[:-1])
    for path in dict.fromkeys(within):
        if isinstance(law := value_at(document, path), LawDocument):
            yield path, law


# -- walking ----------------------------------------------------------------------------------------------------------
def _editable_leaves(document: SceneDocument) -> Iterator[Leaf]:
    """The scalars of a scene that can be edited, as far as they are stated; also default laws of segments."""
    listed = {place for *_, homes in marked_series(document) for place in homes}
    for leaf in leaves(document, _shown):
        if leaf.path in document.formulas or leaf.path[:-1] in listed:  # follows from parameters, or stands in a text
            continue
        if leaf.value is None:  # a law that is not stated
            leaf = leaf._replace(value=value_at(document, leaf.path[:-1]).law_name)
        if _editable(leaf):
            yield leaf


def _shown(table: DocumentTable) -> Iterator[str]:
    """The keys of a table in which values are edited."""
    for key in type(table).model_fields:
        value = getattr(table, key)
        if isinstance(table, SegmentTable) and key == "law" and not (table.to is None and value is None):
            yield key
        table_of_values = isinstance(value, list) and len(value) > LONGEST_LIST and not isinstance(value[0], DocumentTable)
        stated = key in table.model_fields_set or (key == "gravity" and isinstance(table, SceneDocument) and key in table.effects)
        if value is not None and key not in (*HIDDEN, "law") and not table_of_values and stated:
            yield key


def _editable(leaf: Leaf) -> bool:
    quantity = leaf.mark(QuantityMark)
    if quantity is not None and quantity.word and leaf.value == quantity.word:
        return False
    return is_number(leaf.value) or quantity is not None or bool(_options(leaf))


def is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _options(leaf: Leaf) -> tuple[str, ...]:
    """The texts of which the value is one, if it is a choice."""
    if leaf.path[-1] == "law":
        return LAW_OPTIONS
    return tuple(o for o in get_args(leaf.kind) if isinstance(o, str)) if get_origin(leaf.kind) is Literal else ()


def _named(scene: Scene) -> Iterator[Parameter]:
    """The parameters of a scene that are not computed from others."""
    entries, document = scene.document.parameters, scene.document
    whole_places = [text for place, text in document.formulas.items() if isinstance(value_at(document, place), int)]
    counts = {name for text in whole_places for name in parse_expression(text).names}
    for name, known in scene.parameters.items():
        entry = entries[name]
        value = entry.value if isinstance(entry, ParameterDocument) else entry
        if not known.is_independent or (isinstance(value, str) and not is_plain(value)):
            continue
        number, suffix = (float(split(value)[0]), split(value)[1]) if isinstance(value, str) else (float(value), "")
        per = float(unit_of(suffix).factor) if suffix else 1.0
        bounds = float(f"{known.low / per:.12g}"), float(f"{known.high / per:.12g}")
        usual = _round_out(*sorted((number / 4.0, number * 2.5))) if number else (0.0, 1.0)
        low, high = (x if math.isfinite(x) else other for x, other in zip(bounds, usual, strict=True))
        whole = isinstance(value, int) and name in counts
        step = 1.0 if whole else _nice((high - low) / RANGE_STEPS)
        path: Place = ("parameters", name, *(["value"] if isinstance(entry, ParameterDocument) else []))
        yield Parameter(path, GROUPS[0], name, number, symbol_of(suffix), low, high, step, *bounds, suffix, whole=whole)


# -- one value --------------------------------------------------------------------------------------------------------
def _parameter(scene: Scene, leaf: Leaf, opened: SceneDocument | None) -> Parameter | None:
    document, path, value, quantity = scene.document, leaf.path, leaf.value, leaf.mark(QuantityMark)
    along = False
    if path[0] == "links" and len(path) == 5 and path[2] == "points":
        skip, along = _of_point(document, path)
        if (skip or along) and opened is not None and _has_point(opened, path) and not any(_of_point(opened, path)):
            skip = along = False
        if skip:
            return None
    suffix = ""
    if quantity is None:
        kind, number, unit = "", float(value), ""
    else:
        units = document.unit_system
        if isinstance(value, str):
            text, suffix = split(value)
            kind, number, unit = _kind_of_unit(quantity, suffix), float(text), symbol_of(suffix)
        else:
            kind = scene.kinds.get(place_key(path), quantity.kinds[0])
            number, unit = float(value), _bare_unit(units, kind)
    least: str = quantity.least if quantity is not None else ""
    sign = 1.0
    if path[-2:] == ("profile", "base") and number > 0.0 and _plane_cam(document, path):
        least = "above zero"  # a radius; of a cam about an axis in the plane it is a place along that
    if along:
        least, sign, number = "above zero", math.copysign(1.0, number), abs(number)
    whole = isinstance(value, int) and quantity is None and (path[-2:-1] == ("teeth",) or path[-1:] == ("rollers",))
    low, high = _range(document, path, number, kind, least)
    if kind in DERIVATIVES and not number:
        reach = _usual_derivative(scene, path, kind)
        low, high = _round_out(-reach, reach) if reach else (low, high)
    if whole:
        low, high = max(3.0, math.floor(low)), max(math.ceil(high), 4.0)
    step = 1.0 if whole else _nice((high - low) / RANGE_STEPS)
    span = WIDEST_RANGE * (high - low)
    bound = 0.0 if least == "zero" else (min(step, low) if low > 0.0 else step) if least else -math.inf
    if quantity is None and number >= 0.0:
        bound = 0.0
    hard_low = max(high - span, bound) if high > low else bound
    label = label_of(path)
    if along:
        label = f"{path[1]} {next(iter(document.links[str(path[1])].points))}–{path[3]}"
    return Parameter(path, group_of(path), label, number, unit, low, high, step, hard_low, low + span, suffix, sign, whole)


def _has_point(document: SceneDocument, path: Place) -> bool:
    """Whether a document states the point of a coordinate in a table of its link."""
    link = document.links.get(str(path[1]))
    return link is not None and isinstance(link.points, dict) and path[3] in link.points


def _of_point(document: SceneDocument, path: Place) -> tuple[bool, bool]:
    """Whether a coordinate of a link's point is left out, and whether it is shown as the point's distance from the first one.

    A shift of all points in the frame of their link does not change the mechanism: of a link whose first point is the origin only
    the other points count, and for one of them on an axis of the frame only its distance.
    """
    link, point, k = str(path[1]), str(path[3]), int(path[4])
    points = document.links[link].points
    if link == document.frame or not isinstance(points, dict):
        return False, False
    first = next(iter(points))
    if any(_zero(v) is False for v in points[first]):
        return False, False
    if point == first:
        return True, False
    zero = [_zero(v) for v in points[point]]
    if zero[1 - k] and not zero[k]:
        return False, True
    return bool(zero[k] and not zero[1 - k]), False


def _zero(value: float | str) -> bool:
    return (float(split(value)[0]) if isinstance(value, str) else float(value)) == 0.0


def _kind_of_unit(quantity: QuantityMark, unit: str) -> str:
    for kind in quantity.kinds:
        try:
            unit_factor(unit, kind)
        except QuantityError:
            continue
        return kind
    return quantity.kinds[0]


def _bare_unit(units: Units, kind: str) -> str:
    return symbol_of(BARE.get(kind, UNIT_KINDS[kind].bare).format(**vars(units)))


# -- ranges -----------------------------------------------------------------------------------------------------------
def _range(document: SceneDocument, path: Place, value: float, kind: str, least: str) -> tuple[float, float]:
    """A useful range around a value: wide enough to reach the limits of the mechanism, but not so wide that all usual values lie in
    a corner of the slider."""
    size = abs(value)
    if least and value > 0.0 and kind != "angle":
        return _round_out(value / 4.0, value * 2.5)
    if path[-1] == "angle" or kind == "angle":
        reach = 0.5 * _half_turn(document, path)
        return _round_out(value / 10.0 if least else value - reach, value + reach)
    if kind == "length" and path[0] in ("links", "sketch"):
        reach = max(size, 0.6 * _link_size(document, path)) or 1.0
        return _round_out(value - reach, value + reach)
    if value == 0.0:
        return 0.0, 0.0  # set by `_scaled`
    if kind in ("", "angular speed", "linear speed", "pressure", "power", "density"):
        return _round_out(*sorted((value / 4.0, value * 2.5)))
    return _round_out(-2.5 * size, 2.5 * size)


def _usual_derivative(scene: Scene, path: Place, kind: str) -> float:
    """The largest magnitude of a derivative over the segments at one end of which it is stated, as a bare number of the scene; 0
    where it is unknown."""
    joined = scene.curves.get(place_key(path[:-3]))
    if joined is None or path[-2] != "to":
        return 0.0
    samples = joined.curve(np.linspace(joined.curve.start, joined.curve.end, CURVE_SAMPLES), int(path[-1]))[-1]
    return float(np.abs(samples).max() / float(scene.units.factor(kind)))


def _plane_cam(document: SceneDocument, path: Place) -> bool:
    """Whether a value in the profile of a cam belongs to a plane cam."""
    profile: Any = getattr(document.joints[str(path[1])], "profile", None)
    return all(getattr(profile, kind, None) is None for kind in SOLIDS)


def _half_turn(document: SceneDocument, path: Place) -> float:
    """Half a turn in the unit of an angle in the document."""
    return math.pi / _unit_at(document, path, "angle")


def _unit_at(document: SceneDocument, path: Place, kind: str) -> float:
    """The factor to SI units of a value in the document: that of its own unit where it states one, else of the scene's."""
    value, units = value_at(document, path), document.unit_system
    try:
        return float(unit_factor(split(value)[1], kind) if isinstance(value, str) else units.factor(kind))
    except QuantityError:
        return float(units.factor(kind))


def _link_size(document: SceneDocument, path: Place) -> float:
    """The largest coordinate of a link's points, or else of all links, in the unit of a length in the document."""
    units = document.unit_system
    own = [document.links[str(path[1])]] if path[0] == "links" else []
    for links in (own, document.links.values()):
        places = (v for link in links if isinstance(link.points, dict) for xy in link.points.values() for v in xy)
        largest = max((abs(units.si(v, "length")) for v in places), default=0.0)
        if largest:
            return largest / _unit_at(document, path, "length")
    return 0.0


def _scaled(parameters: list[Parameter]) -> list[Parameter]:
    """The parameters, with ranges for values that are zero: up to the largest value of the same unit and name, or a usual one."""
    out = []
    for p in parameters:
        if p.high > p.low:
            out.append(p)
            continue
        others = [abs(o.value) for o in parameters if o.unit == p.unit and o.path[-1] == p.path[-1] and o.value]
        usual = {"kg": 1.0, "kg m²": 1e-3, "N": 100.0, "N m": 10.0}.get(p.unit, 1.0)
        reach = max(others, default=usual)
        low, high = _round_out(-reach if p.hard_low < 0.0 else 0.0, reach)
        span = WIDEST_RANGE * (high - low)
        hard = max(p.hard_low, high - span)
        out.append(replace(p, low=low, high=high, step=_nice((high - low) / RANGE_STEPS), hard_low=hard, hard_high=low + span))
    return out


def _nice(value: float) -> float:
    """The power of ten, or 2 or 5 times it, next below a positive value."""
    if not value > 0.0 or not math.isfinite(value):
        return 1.0
    decade = 10.0 ** math.floor(math.log10(value))
    return float(f"{decade * max(k for k in (1.0, 2.0, 5.0) if k * decade <= value * (1.0 + 1e-9)):.1e}")


def _round_out(low: float, high: float) -> tuple[float, float]:
    """A range with round ends that holds another one."""
    step = _nice((high - low) / 20.0)
    return float(f"{math.floor(low / step + 1e-9) * step:.10g}") or (_nice(low) if low > 0.0 else 0.0), float(
        f"{math.ceil(high / step - 1e-9) * step:.10g}"
    )


# -- names ------------------------------------------------------------------------------------------------------------
def group_of(path: Place) -> str:
    first, keys = path[0], set(path)
    if first == "sketch" or (first == "links" and path[2] == "points"):
        return "Lengths"
    if first == "links":
        return "Masses"
    if first == "loads":
        return "Loads and springs"
    if first == "friction" or "friction" in keys:
        return "Friction"
    if first == "joints":
        if {"drive", "free"} & keys:
            return "Drive"
        if {"profile", "follower"} & keys:
            return "Cam"
        return "Lengths" if {"radius", "radii", "teeth"} & keys else "Assembly"
    return "Other"


def label_of(path: Place) -> str:
    """Label of a value: the item and the key, without the words that its group implies."""
    parts = [str(p) for p in path if not isinstance(p, int)]
    axis = ("x", "y")
    last = path[-1]
    if path[0] == "links" and len(path) == 5 and path[2] == "points":
        return f"{path[1]} {path[3]} {axis[int(path[4])]}"
    if path[0] == "sketch":
        return " ".join([*parts[1:], axis[int(last)] if isinstance(last, int) else ""]).strip()
    silent = ("drive", "profile", "follower", "parameters")
    words = [
        str(p + 1) if isinstance(p, int) else p.replace("_", " ")
        for k, p in enumerate(path[1:-1] if isinstance(last, int) else path[1:])
        if k == 0 or p not in silent
    ] or parts
    if isinstance(last, int):
        vector = path[-2] in ("centre", "force", "gravity", "at", "pole")
        if path[-2] == "to":
            words += [ORDER_NAMES[last]] if last else []
        elif path[-2] in ("stiffness", "linear"):
            words.append(("x", "y", "angle")[last])
        else:
            words.append(axis[last] if vector and last < 2 else str(last + 1))
    return " ".join(words)
