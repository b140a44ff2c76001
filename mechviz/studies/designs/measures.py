"""Measures of a design: a quantity of the catalogue over the run, or a number that it is reduced to. Also tables of the catalogue
from motion and forces alone, for batches of designs and for motions on a tape (automatic differentiation)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from mechcore.arrays import Real
from mechcore.constants import TURN
from mechcore.errors import Fault, MechanismError
from mechcore.forces.kinetostatics import Forces
from mechcore.motion.metrics import mechanical_advantage, transmission_rows, velocity_ratios
from mechcore.motion.motion import Motion
from mechcore.numerics.interpolation import between, rate_between
from mechcore.records import dataclass
from mechcore.texts import as_angle, as_length
from mechviz.quantities.catalogue import Catalogue, Quantity
from mechviz.quantities.vectors import centre_name, point_name
from mechviz.scene.faults import did_you_mean
from mechviz.scene.scene import Scene
from mechviz.scene.units import QuantityError

OF_FORCES = ("reaction", "torque", "force", "moment", "power", "load", "energy", "friction")  # words in names of quantities
REDUCERS = ("max", "min", "peak", "mean", "rms", "range", "at")
PLACE_ROUNDING = 1e-12  # relative to the place and the drive's range: a frame that is closer is at the place
_SHAPE = re.compile(r"(?P<key>.+?)(?:\[(?P<curve>[^\]]+)\])?(?::\s*(?P<reducer>max|min|peak|mean|rms|range|at\s+(?P<at>.+)))?")


@dataclass(frozen=True)
class Measure:
    """A quantity by its key, one of its curves, and the number that the curve is reduced to.

    ``curve``: "" for the only curve, or for the magnitude of a vector; ``reducer``: one of `REDUCERS`, or "" for the whole curve;
    ``place``: coordinate of the first drive [rad or m], for the reducer "at"; ``turn``: [rad] after which a turning drive is at the
    same place again, 0 for a sliding one."""

    text: str
    key: str
    curve: str = ""
    reducer: str = ""
    place: float = math.nan
    turn: float = 0.0

    def column(self, quantity: Quantity) -> int:
        """Column of the measure's curve in the values of the quantity. Raises `MechanismError` where there is none, or several."""
        curves = quantity.curves
        if self.curve:
            if self.curve not in curves:
                raise _wrong(self.text, f"{self.key} has no curve '{self.curve}'.", did_you_mean(self.curve, curves, what="It has"))
            return curves.index(self.curve)
        lengths = [k for k, name in enumerate(curves) if name.startswith("|")]
        if len(curves) > 1 and not lengths:
            raise _wrong(self.text, f"{self.key} has several curves.", f"Name one: {self.key}[{curves[0]}].")
        return lengths[0] if lengths else 0

    def reduced(self, values: Real, time: Real, drive: Real | None) -> Real:
        """Numbers (D,) that curves (D, F) at times (F,) [s] are reduced to, or the curves themselves where there is no reducer.
        ``drive`` (F,): coordinate of the first drive [rad or m]."""
        if self.reducer == "":
            return values
        if self.reducer == "at":
            return self._at(values, time, drive)
        if self.reducer in ("mean", "rms"):
            of = values if self.reducer == "mean" else values * values
            span = time[-1] - time[0]
            mean = np.trapezoid(of, time, axis=-1) / span if span > 0.0 else of[..., 0]
            return np.asarray(mean if self.reducer == "mean" else np.sqrt(mean))
        if self.reducer == "peak":
            return np.asarray(np.max(np.abs(values), axis=-1))
        if self.reducer == "range":
            return np.asarray(np.max(values, axis=-1) - np.min(values, axis=-1))
        return np.asarray(np.max(values, axis=-1) if self.reducer == "max" else np.min(values, axis=-1))

    def weights(self, values: Real, time: Real, drive: Real | None) -> Real:
        """Derivatives (F,) of the reduced number with respect to the values of the curve (F,)."""
        unit = np.eye(len(values))
        if self.reducer == "at":
            return self._at(unit, time, drive)
        if self.reducer in ("mean", "rms"):
            means: Real = replace(self, reducer="mean").reduced(unit, time, drive)
            return means if self.reducer == "mean" else means * values / max(float(self.reduced(values, time, drive)), 1e-300)
        high, low = unit[int(np.nanargmax(values))], unit[int(np.nanargmin(values))]
        if self.reducer == "peak":
            k = int(np.nanargmax(np.abs(values)))
            return np.asarray(unit[k] * np.sign(values[k]))
        return np.asarray(high - low if self.reducer == "range" else high if self.reducer == "max" else low)

    def slope(self, values: Real, time: Real, drive: Real | None) -> float:
        """Slope of the curve (F,) over the coordinate of the first drive at ``place``; NaN where the drive rests there."""
        t, _ = self._instant(time, drive)
        gained, moved = rate_between(time, np.stack([values, self._drive(time, drive)], axis=-1), t, 3)
        return float(gained / moved) if moved else math.nan

    def _at(self, values: Real, time: Real, drive: Real | None) -> Real:
        """Values (D,) where the first drive passes ``place`` for the first time, by cubic interpolation between frames."""
        t, k = self._instant(time, drive)
        if k is not None:
            return values[..., k]
        moved = np.moveaxis(np.atleast_2d(values), -1, 0)
        value = between(time, moved, np.array([t]), 3)[0]
        return np.asarray(value if values.ndim > 1 else value[0])

    def _drive(self, time: Real, drive: Real | None) -> Real:
        if drive is None or len(time) < 4:
            raise _wrong(self.text, "no drive passes a place in this run.", "Ask for max, min, mean, rms or range.")
        return drive

    def _instant(self, time: Real, drive: Real | None) -> tuple[float, int | None]:
        """Time [s] at which the first drive passes ``place`` for the first time, and the number of the frame that is there, or
        None."""
        at = self._drive(time, drive)
        met = _passage(time.tobytes(), np.ascontiguousarray(at).tobytes(), self.place, self.turn)
        if met is None:
            ends = " to ".join((as_angle if self.turn else as_length)(float(end)) for end in (at.min(), at.max()))
            raise _wrong(self.text, "the first drive never is there.", f"It runs over {ends}.")
        return met


@lru_cache(maxsize=256)
def _passage(times: bytes, drive: bytes, place: float, turn: float) -> tuple[float, int | None] | None:
    """Time at which a drive first passes a place, or one a number of turns away, and the frame there; None if it never does. Many
    numbers of a design share these."""
    from scipy.optimize import brentq

    time, at = np.frombuffer(times), np.frombuffer(drive)
    if turn and not at.min() <= place <= at.max():
        place += turn * np.ceil((at.min() - place) / turn)
    off = at - place
    side = np.where(np.abs(off) <= PLACE_ROUNDING * (abs(place) + np.ptp(at)), 0.0, np.sign(off))
    met = np.flatnonzero((side[:-1] == 0.0) | (side[1:] != side[:-1]))
    if not len(met):
        return None
    k = int(met[0])
    if side[k] == 0.0 or side[k + 1] == 0.0:
        k += int(side[k] != 0.0)
        return float(time[k]), k
    found = brentq(lambda t: float(between(time, off, np.array([t]), 3)[0]), time[k], time[k + 1], xtol=1e-15 * abs(time[-1]))
    return float(found), None


def parse_measure(scene: Scene, text: str) -> Measure:
    """The measure that a text such as ``joint.B.reaction:max`` or ``link.rocker.angle:at 60 deg`` names. Whether the quantity
    exists is not checked, as only a run shows it. Raises `MechanismError`."""
    match = _SHAPE.fullmatch(text.strip())
    if match is None:
        raise _wrong(text, "is no measure.", f"Write KEY, or KEY:REDUCER with one of {', '.join(REDUCERS[:-1])} or 'at 60 deg'.")
    if match["at"] is None:
        key = match["key"]
        last = key.rpartition(":")[2]
        if ":" in key and "." not in last:
            raise _wrong(text, f"'{last}' is no reducer.", did_you_mean(last, REDUCERS, what="There are"))
        return Measure(text.strip(), key, match["curve"] or "", match["reducer"] or "")
    drives = scene.mechanism.drives
    own = f"joints.{drives[0].joint}.drive." if drives else ""
    slides = any(own and path.startswith(own) and kind in ("length", "linear speed") for path, kind in scene.kinds.items())
    try:
        try:
            stated: float | str = float(match["at"])
        except ValueError:
            stated = match["at"]
        place = scene.units.si(stated, "length" if slides else "angle")
    except QuantityError as error:
        raise _wrong(text, str(error), error.remedy) from None
    return Measure(text.strip(), match["key"], match["curve"] or "", "at", place, 0.0 if slides else TURN)


@dataclass(frozen=True)
class StartTurn:
    """Whole turns of an angle that no drive states, such as a coupler's: each run counts its own, so that designs next to each
    other may differ by a turn. ``turn``: one turn in the unit of the quantity, 0 where nothing is to be counted; ``start``: value
    at the start of the nominal run."""

    turn: float = 0.0
    start: float = 0.0

    def aligned(self, curves: Real) -> Real:
        """Curves (..., F) moved by whole turns so that they start within half a turn of the nominal one."""
        if self.turn == 0.0:
            return curves
        return np.asarray(curves - self.turn * np.nan_to_num(np.round((curves[..., :1] - self.start) / self.turn)))

    def without_turns(self, off: Real) -> Real:
        """Deviations (...,) from wanted values, without whole turns."""
        return off - self.turn * np.round(off / self.turn) if self.turn else off


OWN_TURNS = StartTurn()


def quantity_of(measure: Measure, catalogue: Catalogue) -> Quantity:
    """The quantity of a measure. Raises `MechanismError` where the catalogue has no quantity with its key."""
    quantity = catalogue.by_key.get(measure.key)
    if quantity is None:
        last = measure.key.rpartition(".")[2]
        alike = [key for key in catalogue.by_key if key.rpartition(".")[2] == last]
        remedy = did_you_mean(measure.key, alike or catalogue.by_key, what="There are")
        if not catalogue.numbers.has_forces and any(word in last for word in OF_FORCES):
            remedy = 'The scene names no effects and no loads, so there are no forces. Add effects = ["inertia"].'
        raise _wrong(measure.text, f"there is no quantity '{measure.key}'.", remedy)
    return quantity


def _wrong(text: str, message: str, remedy: str) -> MechanismError:
    return MechanismError(Fault(f"--of {text}", message, remedy))


def needs_forces(path: tuple[str, ...]) -> bool:
    """Whether a table holds results of the force analysis."""
    return path[1] == "drive" or path[-1] in ("reaction", "inertia")


def table_values(path: tuple[str, ...], motion: Motion, forces: Forces | None) -> Real:
    """The values (D, F, n) of a table of the catalogue, or (F, n) for a single design. Raises `LookupError` where the table cannot
    be computed from motion and forces alone."""
    match path[1:]:
        case ("links", link, "pose"):
            return motion.pose(link)
        case ("links", link, "velocity"):
            return motion.velocity(link)
        case ("links", link, "acceleration"):
            return motion.acceleration(link)
        case ("links", link, "inertia") if forces is not None:
            return forces.inertia(link)
        case ("points", name, what) if what in ("position", "velocity", "acceleration"):
            order = ("position", "velocity", "acceleration").index(what)
            for key in motion.mechanism.traced:
                if point_name(*key) == name:
                    return motion.point(*key, order)
            link = next(link for link in motion.model.links if centre_name(link) == name)
            return motion.centre_of_mass(link, order)
        case ("joints", joint, "motion"):
            return motion.coordinate(joint)
        case ("joints", joint, "reaction") if forces is not None:
            return forces.reaction(joint)
        case ("drive", joint) if forces is not None:
            coordinate = motion.coordinate(joint)
            columns = [coordinate[..., k] for k in range(3)] + [forces.effort(joint), forces.power(joint)]
            return np.stack([np.broadcast_to(x, motion.shape) for x in columns], axis=-1)
        case ("answers", name, item) if name in _METRICS:
            values = _METRICS[name](motion)[item]
            return values if name == "transmission_angle" else values[..., None]
    raise LookupError("/".join(path))


_METRICS: dict[str, Callable[[Motion], Mapping[str, Real]]] = {
    "transmission_angle": transmission_rows,
    "velocity_ratio": velocity_ratios,
    "mechanical_advantage": mechanical_advantage,
}
