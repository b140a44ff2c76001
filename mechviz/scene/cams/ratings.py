"""What a scene asks about a cam: Hertz pressure, a margin of its contact force, the graphical method beside the exact lift."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, model_validator

from mechcore.spec.mechanism import CamDrawn, CamRating
from mechcore.texts import as_angle, as_length
from mechviz.scene.faults import did_you_mean
from mechviz.scene.fields import Angle, Effort, Number, Pressure, Range, Size, Table, Text, Unknown, refuse

if TYPE_CHECKING:
    from mechviz.scene.convert import Converter


MATERIALS: Mapping[str, tuple[float, float]] = {
    "steel": (2.1e11, 0.30),
    "cast iron": (1.1e11, 0.26),
    "bronze": (1.1e11, 0.34),
    "aluminium": (7.0e10, 0.33),
    "polyamide": (2.8e9, 0.39),
    "acetal": (3.0e9, 0.37),
}
"""Young's modulus [Pa] and Poisson's ratio: usual values of handbooks; grades differ by a tenth, plastics by more."""

_FEWEST, _MOST = 4, 100_000  # steps of a turn
_THINNEST = 1e-9  # width of a contact [m]


class RatingDocument(Table):
    """By what the contact of a cam is judged."""

    width: Size | None = None
    """Length of the line on which cam and follower touch, across the plane: with it the Hertz pressure is computed."""
    materials: Annotated[list[Text], Field(min_length=2, max_length=2)] | None = None
    """[cam, follower]: steel, cast iron, bronze, aluminium, polyamide, acetal. Default steel on steel."""
    modulus: Annotated[list[Pressure], Field(min_length=2, max_length=2)] | None = None
    """Young's moduli [cam, follower], instead of materials."""
    poisson: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = None
    """Poisson's ratios [cam, follower], beside modulus. Default 0.3."""
    limit: Pressure | None = None
    """Largest Hertz pressure that is allowed; more is an event."""
    margin: Effort | None = None
    """Closure = "force": contact force that has to remain; less is an event, and `mechviz cams` tells the least spring for it."""

    @model_validator(mode="after")
    def _agrees(self) -> RatingDocument:
        found = []
        if self.modulus is not None and self.materials is not None:
            found.append(("modulus", "materials and modulus at once.", "Keep one of them."))
        if self.poisson is not None and self.modulus is None:
            found.append(("poisson", "poisson goes with modulus.", "Give modulus too, or leave it out."))
        for key in ("materials", "modulus", "limit"):
            if getattr(self, key) is not None and self.width is None and self.sound("width"):
                found.append((key, f"{key} without a width of the contact.", 'Add width = "12 mm".'))
        for k, name in enumerate(self.materials or []):
            if not isinstance(name, Unknown) and isinstance(name, str) and name not in MATERIALS:
                near = did_you_mean(name, MATERIALS, what="Materials")
                found.append((f"materials[{k}]", f"'{name}' is no material.", near or "Give modulus = [...] instead."))
        for k, ratio in enumerate(self.poisson or []):
            if isinstance(ratio, float) and not -1.0 < ratio <= 0.5:
                found.append((f"poisson[{k}]", f"{ratio:g} is no Poisson's ratio.", "Metals have 0.25 to 0.35, none is above 0.5."))
        refuse(found)
        return self


class GraphicalDocument(Table):
    """The lift by the graphical method of the lecture, beside the exact one."""

    step: Angle
    """The cam is turned by this much from point to point; so often that it comes round, at least four times."""
    lines: Literal["chord", "tangent"] = "chord"
    """By what the curves are differentiated: slopes of their chords, or of tangents laid by eye."""
    resolution: Range = 0.0
    """What can be read off the drawing: a length, of an oscillating follower an angle. Default 0."""


def rating_of(rating: RatingDocument, path: str, convert: Converter) -> CamRating:
    """The core's rating; faults are noted."""

    def number(value: float | str | None, kind: str, key: str) -> float | None:
        return None if value is None else convert.si(value, kind, f"{path}.{key}")

    first, second = (MATERIALS.get(name, MATERIALS["steel"]) for name in rating.materials or ("steel", "steel"))
    modulus, poisson = (first[0], second[0]), (first[1], second[1])
    if rating.modulus is not None:
        a, b = convert.row(rating.modulus, "pressure", f"{path}.modulus")
        modulus = (a, b)
        poisson = (0.3, 0.3) if rating.poisson is None else (float(rating.poisson[0]), float(rating.poisson[1]))
    width = number(rating.width, "length", "width")
    if width is not None and width < _THINNEST:
        convert.note(f"{path}.width", f"{as_length(width)} is below {as_length(_THINNEST)}.", "Check the number and its unit.")
    return CamRating(
        width=width,
        modulus=modulus,
        poisson=poisson,
        limit=number(rating.limit, "pressure", "limit"),
        margin=number(rating.margin, "force", "margin"),
    )


def graphical_of(graphical: GraphicalDocument, across: str, path: str, convert: Converter) -> CamDrawn | None:
    """The core's request for a drawing; ``across``: what the follower's coordinate is. Faults are noted."""
    step = convert.si(graphical.step, "angle", f"{path}.step")
    resolution = convert.si(graphical.resolution, across, f"{path}.resolution")
    if math.isnan(step) or math.isnan(resolution):
        return None
    whole = whole_step(step)
    if whole is None:
        convert.note(f"{path}.step", *step_fault(step))
        return None
    return CamDrawn(step=whole, lines=graphical.lines, resolution=resolution)


def whole_step(step: float) -> float | None:
    """The step [rad] that makes exactly a turn in 4 to 100,000 steps, where ``step`` is that but for rounding; else None."""
    turns = 2.0 * math.pi / step if step > 0.0 else 0.0
    if not _FEWEST - 1e-6 <= turns <= _MOST + 1e-6 or abs(turns - round(turns)) > 1e-6:
        return None
    return 2.0 * math.pi / round(turns)


def step_fault(step: float) -> tuple[str, str]:
    """What is wrong with a step [rad] that ``whole_step`` does not take, and the remedy."""
    turns = 2.0 * math.pi / step if step > 0.0 else math.inf
    size = as_angle(step)
    if step > 0.0 and turns > _MOST:
        return f"{size} are {turns:.6g} steps of a turn, more than {_MOST}.", f"Give at least {as_angle(2.0 * math.pi / _MOST)}."
    if turns < _FEWEST:
        return f"{size} are {turns:.4g} steps of a turn, less than {_FEWEST}.", f"Give at most {as_angle(2.0 * math.pi / _FEWEST)}."
    usual = [as_angle(math.radians(degrees), 3) for degrees in (30, 15, 10, 5)]
    return f"{size} do not make a turn.", f"Usual are {', '.join(usual[:3])} or {usual[3]}."
