"""Tolerance analysis: effect of the tolerances of parts on a quantity. Worst case, root sum of squares, and samples (Monte Carlo).

The first two come from exact derivatives at the nominal design and give the contribution of each tolerance. Corners and samples
solve the mechanism anew for every design. A tolerance is a symmetric limit: parts are distributed normally with a third of it as
standard deviation, or uniformly or triangularly within it.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor as Pool
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, Literal

import numpy as np

from mechcore.arrays import Real
from mechcore.compiled.motion import Executor
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass
from mechviz.figures import chart
from mechviz.quantities.catalogue import Axis, Quantity
from mechviz.runs import Run
from mechviz.scene.annotations import Place
from mechviz.scene.faults import under_other_names
from mechviz.scene.scene import Scene
from mechviz.scene.units import QuantityError, split, unit_of
from mechviz.studies.designs.evaluate import DesignResults, Study, study_of
from mechviz.studies.designs.measures import Measure
from mechviz.studies.designs.sampling import Variation
from mechviz.studies.designs.sensitivity import UNKNOWN, Sensitivity, sensitivities
from mechviz.studies.designs.sweep import run_study
from mechviz.studies.designs.variables import Variable, parameters_of, variables_of, without_ranges

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Distribution = Literal["normal", "uniform", "triangular"]
NORMAL_SIGMAS = 3.0  # standard deviations per tolerance, for normal distributions
SCRAMBLES = 8  # independent scrambles of the samples, whose scatter gives the standard errors
MOST_CORNERS = 12  # largest number of tolerances whose corners are all computed
MOST_NUMBERS = 60_000_000  # largest number of values in the curves of all samples
BAND_PLACES = 13  # rows of a printed band
EXTREMES = ("max", "min", "peak", "range")  # reducers to values of single frames
TAKEN_OVER = 1e-6  # relative: an extreme that moves farther than its own derivative says has passed to another frame
TAIL_QUANTILES = (0.00135, 0.99865)  # of a normal distribution at three standard deviations on either side


@dataclass(frozen=True)
class QuantityLimits:
    """Least and greatest allowed value of a quantity, in its unit; infinite where there is no limit."""

    low: float = -np.inf
    high: float = np.inf


@dataclass(frozen=True, eq=False)
class Tolerances:
    """Effects of tolerances on a measure, in its unit. The last axis of the arrays, written (...), is (F,) for a curve and empty
    for a number.

    ``nominal`` (...): value of the nominal design; ``slopes`` (P, ...): slopes per unit of each variable; ``worst`` (...): half
    width by all tolerances together, see `worst_within`; ``root_sum_square`` (...): by the root of the sum of the squares of the
    contributions; ``corners``
    (2, ...): least and greatest value over all corners of the tolerances, None where there are too many; ``mean``, ``sigma`` (...):
    mean and standard deviation of the samples; ``errors`` (2, ...): standard errors of these two; ``tails``, ``ends`` (2, ...):
    99.73 % interval and extremes of the samples; ``lost``, ``lost_corners``: numbers of samples and corners that cannot be
    assembled; ``values``: of the samples, if the measure is a number.
    """

    measure: Measure
    quantity: Quantity
    variables: tuple[Variable, ...]
    distribution: Distribution
    nominal: Real
    slopes: Real
    exact: bool  # whether the slopes are exact derivatives; otherwise they are fitted to the samples
    worst: Real
    root_sum_square: Real
    corners: Real | None
    mean: Real
    sigma: Real
    errors: Real
    tails: Real
    ends: Real
    samples: int
    lost: int
    lost_corners: int
    values: Real
    limits: QuantityLimits | None
    inside: float  # fraction of the samples that is within the limits at all frames
    computed_by: str  # executor of the samples, in words

    @property
    def curve(self) -> bool:
        """Whether the measure is a curve over the frames."""
        return self.nominal.ndim > 0

    @property
    def at(self) -> int | None:
        """The frame with the greatest root-sum-square deviation; None where the measure is a number."""
        return int(np.argmax(np.nan_to_num(self.root_sum_square, nan=-1.0))) if self.curve else None

    def deviations(self) -> Real:
        """Contribution (P,) of each variable to the worst case; of a curve at the frame `at`."""
        moved = np.abs(self.slopes[:, self.at] if self.curve else self.slopes)
        return np.asarray(moved * np.array([v.tolerance for v in self.variables]))

    def shares(self) -> Real:
        """Fraction (P,) of the variance that is due to each variable; of a curve at the frame `at`."""
        squares = self.deviations() ** 2
        return np.asarray(squares / squares.sum()) if squares.sum() > 0.0 else squares

    @property
    def capability(self) -> tuple[float, float]:
        """Process capability indices Cp and Cpk of the samples of a number: its limits in units of six standard deviations, and the
        distance of the mean from the nearer limit in units of three. NaN where they are not defined."""
        if self.curve or self.limits is None or not float(self.sigma) > 0.0:
            return float("nan"), float("nan")
        low, high, mean, sigma = self.limits.low, self.limits.high, float(self.mean), float(self.sigma)
        cp = (high - low) / (6.0 * sigma) if np.isfinite(high - low) else float("nan")
        return cp, min(high - mean, mean - low) / (3.0 * sigma)

    def lines(self) -> Iterator[tuple[str, ...]]:
        """Rows of the table of results: name and value."""
        unit, k = self.quantity.unit, self.at

        def of(x: Real) -> float:
            return float(x if k is None else x[..., k])

        nominal = of(self.nominal)
        yield "nominal", f"{nominal:.6g} {unit}"
        yield "worst case", _deviation(of(self.worst), unit)
        if self.corners is not None:
            low, high = (of(x) - nominal for x in self.corners)
            cut = f"; {self.lost_corners} of {2 ** len(self.variables)} not assembled" if self.lost_corners else ""
            yield "all corners", (f"{low:+.4g} to {high:+.4g} {unit}" if np.isfinite(low) else "none") + cut
        yield "root sum square", _deviation(of(self.root_sum_square), unit)
        yield "mean of the samples", f"{of(self.mean):.6g} {unit}"
        yield "standard deviation", f"{of(self.sigma):.4g} {unit}"
        yield "99.73 % between", f"{of(self.tails[0]) - nominal:+.4g} and {of(self.tails[1]) - nominal:+.4g} {unit}"
        if self.limits is not None:
            error = 100.0 * float(np.sqrt(max(self.inside * (1.0 - self.inside), 0.0) / self.samples))
            yield "yield", f"{100.0 * self.inside:.4g} %" + (f" ± {error:.2g} %" if error else "")
            cp, cpk = self.capability
            if np.isfinite(cpk):
                yield "Cp, Cpk", f"{cp:.3g}, {cpk:.3g}" if np.isfinite(cp) else f"-, {cpk:.3g}"
        if self.lost:
            yield "not assembled", f"{self.lost} of {self.samples} samples"

    def band(self, axis: Axis) -> Iterator[tuple[str, ...]]:
        """Rows of the table of a curve's band at evenly spaced places of an axis, headings first."""
        unit = self.quantity.unit
        yield axis.title, f"nominal [{unit}]", "worst case", "root sum square", "99.73 % between"
        places = np.linspace(axis.values[0], axis.values[-1], BAND_PLACES)
        for k in dict.fromkeys(int(np.argmin(np.abs(axis.values - place))) for place in places):
            low, high = self.tails[:, k] - self.nominal[k]
            yield (
                f"{axis.values[k]:.5g}", f"{self.nominal[k]:.6g}", _deviation(self.worst[k]), _deviation(self.root_sum_square[k]),
                f"{low:+.4g} and {high:+.4g}",
            )  # fmt: skip

    def rows(self) -> Iterator[tuple[str, ...]]:
        """Rows of the table of contributions, headings first, then the greatest first."""
        yield "variable", "value", "tolerance", f"does ± [{self.quantity.unit}]", "of the variance"
        off, shares = self.deviations(), self.shares()
        for k in np.argsort(-shares, kind="stable"):
            v = self.variables[k]
            yield (
                v.name, f"{v.value:.6g} {v.unit}".strip(), f"± {v.tolerance:.4g} {v.unit}".strip(),
                *((f"{off[k]:.4g}", f"{100.0 * shares[k]:.3g} %") if np.isfinite(off[k]) else (UNKNOWN, UNKNOWN)),
            )  # fmt: skip


def _deviation(size: float, unit: str = "") -> str:
    """A deviation as text; "not known" where it is not finite, as without derivatives."""
    return f"± {size:.4g} {unit}".rstrip() if np.isfinite(size) else UNKNOWN


def tolerances(
    run: Run,
    measures: Sequence[Measure],
    variables: Sequence[Variable],
    *,
    limits: Sequence[QuantityLimits | None] = (),
    samples: int = 16384,
    distribution: Distribution = "normal",
    seed: int = 0,
    executor: Pool | None = None,
    most: int = 4,
    begin: Callable[[Study, int], None] = lambda *_: None,
    progress: Callable[[int, int], None] = lambda *_: None,
    program: Executor = "numpy",
) -> list[Tolerances]:
    """Effects of the tolerances of variables on measures of a run, one for each measure.

    ``limits``: of the measures, in their order; ``samples``: a power of two, at least 16; ``executor``: pool for portions of
    designs, ``most`` of them at a time; ``begin`` gets the study and the number of its designs before they are computed;
    ``program``: executor of batches of designs. Raises `MechanismError`."""
    if len(limits) > len(measures):
        why = f"{len(limits)} limits of {len(measures)} quantit{'ies' if len(measures) > 1 else 'y'}."
        raise MechanismError(Fault("--limits", why, "Give at most one of each quantity, in their order."))
    some = [v for v in variables if v.tolerance > 0.0]
    if not some:
        remedy = "Give parameters a tolerance in the scene, or here: --tolerance stroke=0.1mm."
        raise MechanismError(Fault("--tolerance", "nothing has a tolerance.", remedy))
    if samples < 2 * SCRAMBLES or samples & (samples - 1):
        below = max(1 << (samples.bit_length() - 1), 2 * SCRAMBLES)
        raise MechanismError(
            Fault("--samples", f"{samples} is no power of two from {2 * SCRAMBLES} on.", f"Take {below} or {2 * below}.")
        )
    frames = max((1 if m.reducer else run.scene.frames + 1) for m in measures)
    if samples * frames > MOST_NUMBERS:
        why = f"curves of {samples} samples at {frames} frames are more numbers than are kept."
        raise MechanismError(Fault("--samples", why, f"Take {1 << ((MOST_NUMBERS // frames).bit_length() - 1)}, or fewer frames."))
    scene, varied = parametrised(run.scene, some)
    nominal, half = (np.array([getattr(v, name) for v in some]) for name in ("value", "tolerance"))
    corners = np.array(list(product((-1.0, 1.0), repeat=len(some)))) if len(some) <= MOST_CORNERS else np.zeros((0, len(some)))
    offsets = np.concatenate([corners, _samples(len(some), samples, distribution, seed)])
    designs = np.concatenate([nominal[None], nominal + half * offsets])
    own, cycles = run.scene.frames or None, run.scene.cycles
    study = study_of(scene, varied, measures, frames=own, cycles=cycles, executor=program, count=len(designs))
    begin(study, len(designs))
    results = run_study(study, designs, executor=executor, most=most, progress=progress).results
    if results.reasons[0]:
        raise MechanismError(Fault("--of", f"the nominal design has no values: {results.reasons[0]}.", "Mend the scene."))
    try:
        known = sensitivities(run, measures, some)
        slopes, worst, exact = [slopes_within(s, half) for s in known], [worst_within(s, half) for s in known], True
    except MechanismError:  # no exact derivatives: linear regression through the samples
        slopes, exact = [_fitted(values, designs, len(corners)) for values in results.values], False
        worst = [np.tensordot(half, np.abs(d), 1) for d in slopes]
    stated = [*limits, *[None] * (len(measures) - len(limits))]
    return [
        _judged(measure, quantity, tuple(some), distribution, (d, w), exact, _Sampled(study, results, k, len(corners)), limit)
        for k, (measure, quantity, d, w, limit) in enumerate(zip(measures, study.quantities, slopes, worst, stated, strict=True))
    ]


def slopes_within(of: Sensitivity, half: Real) -> Real:
    """Slopes (P, ...) of a measure within the tolerances ``half`` (P,): its derivatives. Where an extreme passes to another frame
    within a tolerance, the slope is the greatest change for either sign, from the derivatives at all frames, over the tolerance."""
    if of.measure.reducer not in EXTREMES:
        return of.derivatives if of.measure.reducer else of.slopes
    moved = _moved(of, half)
    both = np.stack([of.measure.reduced(of.curve + sign * moved, of.curve, None) - of.number for sign in (1.0, -1.0)])
    most = np.abs(both).max(axis=0)
    taken = most > (1.0 + TAKEN_OVER) * np.abs(of.derivatives) * half
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(taken, np.copysign(most / half, of.derivatives), of.derivatives)


def worst_within(of: Sensitivity, half: Real) -> Real:
    """Worst case (...) of a measure by all tolerances ``half`` (P,) together, from its derivatives. Of an extreme, the greatest
    change that the derivatives at all frames allow, whichever frame it passes to."""
    known = of.derivatives if of.measure.reducer else of.slopes
    if of.measure.reducer not in EXTREMES or not np.isfinite(known).all():
        return np.asarray(np.tensordot(half, np.abs(known), 1))
    # an extreme is a convex function of the deviations (a least value a concave one), so that no change the other way is greater
    moved, curve = _moved(of, half), of.curve
    most = np.abs(moved).sum(axis=0)
    if of.measure.reducer == "peak":
        return np.asarray((np.abs(curve) + most).max() - of.number)
    if of.measure.reducer != "range":
        return np.asarray((curve + most).max() - of.number if of.measure.reducer == "max" else of.number - (curve - most).min())
    highest = np.flatnonzero(curve + most >= (curve - most).max())  # other frames are neither the greatest nor the least anywhere
    lowest = np.flatnonzero(curve - most <= (curve + most).min())
    apart = [curve[k] - curve[lowest] + np.abs(moved[:, k, None] - moved[:, lowest]).sum(axis=0) for k in highest]
    return np.asarray(max(float(x.max()) for x in apart) - of.number)


def _moved(of: Sensitivity, half: Real) -> Real:
    """Changes (P, F) of a curve by the tolerances, zero where they are not known."""
    return np.asarray(np.where(np.isfinite(of.slopes), of.slopes, 0.0) * half[:, None])


def parametrised(scene: Scene, variables: Sequence[Variable]) -> tuple[Scene, list[Variation]]:
    """A scene in which all variables are parameters without ranges, and their variations within the tolerances."""
    changes: dict[Place, object] = {}
    varied = []
    for k, v in enumerate(variables):
        name = v.name
        if v.place[0] != "parameters":
            name = f"varied_{k + 1}"
            changes["parameters", name] = f"{v.value!r} {v.unit}" if v.unit else v.value
            changes[v.place] = name
        varied.append(Variation(name, v.unit, low=v.value - v.tolerance, high=v.value + v.tolerance))
    wide = without_ranges(scene)
    return (wide.changed(changes) if changes else wide), varied


def _samples(count: int, samples: int, distribution: Distribution, seed: int) -> Real:
    """Offsets (samples, count) in units of the tolerances: `SCRAMBLES` scrambled Sobol samples, one after the other."""
    from scipy.special import ndtri
    from scipy.stats import qmc

    seeds = np.random.SeedSequence(seed).spawn(SCRAMBLES)
    points = [qmc.Sobol(count, rng=np.random.default_rng(s)).random(samples // SCRAMBLES) for s in seeds]
    u = np.clip(np.concatenate(points), 1e-12, 1.0 - 1e-12)
    if distribution == "uniform":
        return np.asarray(2.0 * u - 1.0)
    if distribution == "triangular":
        return np.asarray(np.where(u < 0.5, np.sqrt(2.0 * u) - 1.0, 1.0 - np.sqrt(2.0 * (1.0 - u))))
    return np.asarray(ndtri(u) / NORMAL_SIGMAS)


def _fitted(values: Real, designs: Real, corners: int) -> Real:
    """Slopes (P, ...) by linear regression through the samples, the designs after the nominal one and the corners."""
    sampled, off = values[1 + corners :], designs[1 + corners :] - designs[0]
    known = np.isfinite(sampled.reshape(len(sampled), -1)).all(axis=1)
    matrix = np.column_stack([off[known], np.ones(int(known.sum()))])
    return np.asarray(np.linalg.lstsq(matrix, sampled[known], rcond=None)[0][:-1])


class _Sampled:
    """Values of a measure for the nominal design, the corners and the samples."""

    def __init__(self, study: Study, results: DesignResults, k: int, corners: int):
        self.computed_by = study.computed_by
        values = results.values[k]
        self.nominal, self.corners, self.samples = values[0], values[1 : 1 + corners], values[1 + corners :]
        self.lost_corners, self.lost = (
            sum(map(bool, part)) for part in (results.reasons[1 : 1 + corners], results.reasons[1 + corners :])
        )


def _judged(
    measure: Measure,
    quantity: Quantity,
    variables: tuple[Variable, ...],
    distribution: Distribution,
    linear: tuple[Real, Real],
    exact: bool,
    sample: _Sampled,
    limits: QuantityLimits | None,
) -> Tolerances:
    slopes, worst = linear
    half = np.array([v.tolerance for v in variables]).reshape(-1, *[1] * (slopes.ndim - 1))
    moved = np.abs(slopes) * half
    groups = sample.samples.reshape(SCRAMBLES, -1, *sample.samples.shape[1:])
    known = np.isfinite(sample.samples.reshape(len(sample.samples), -1)).all(axis=1)
    some = sample.samples[known]
    if not len(some):
        raise MechanismError(Fault("--tolerance", "no sample can be assembled.", "Give smaller tolerances."))
    with np.errstate(invalid="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # groups in which hardly any sample can be assembled have no statistics
        scatter = np.stack([np.nanmean(groups, axis=1), np.nanstd(groups, axis=1, ddof=1)])
        sigma = np.asarray(some.std(axis=0, ddof=1))
        corners = np.stack([np.nanmin(sample.corners, axis=0), np.nanmax(sample.corners, axis=0)]) if len(sample.corners) else None
    inside = 1.0
    if limits is not None:
        within = (sample.samples >= limits.low) & (sample.samples <= limits.high)
        inside = float(within.reshape(len(within), -1).all(axis=1).mean())
    return Tolerances(
        measure=measure,
        quantity=quantity,
        variables=variables,
        distribution=distribution,
        nominal=np.asarray(sample.nominal),
        slopes=slopes,
        exact=exact,
        worst=worst,
        root_sum_square=np.asarray(np.sqrt((moved**2).sum(axis=0))),
        corners=corners,
        mean=np.asarray(some.mean(axis=0)),
        sigma=sigma,
        errors=scatter.std(axis=1, ddof=1) / SCRAMBLES**0.5,
        tails=np.quantile(some, TAIL_QUANTILES, axis=0),
        ends=np.stack([some.min(axis=0), some.max(axis=0)]),
        samples=len(sample.samples),
        lost=sample.lost,
        lost_corners=sample.lost_corners,
        values=some if measure.reducer else np.zeros(0),
        limits=limits,
        inside=inside,
        computed_by=sample.computed_by,
    )


def toleranced(scene: Scene, stated: Sequence[str]) -> list[Variable]:
    """The scene's variables with their tolerances, which texts such as ``stroke=0.1mm`` replace or add. Raises `MechanismError`."""
    given: dict[str, str] = {}
    for text in stated:
        name, equals, value = text.rpartition("=")  # names of points and links may contain "="
        if not equals or not name.strip() or not value.strip():
            raise MechanismError(Fault(f"--tolerance {text}", "is no tolerance.", "Write it like stroke=0.1mm."))
        given[name.strip()] = value.strip().removeprefix("±").strip()
    own = [v.name for v in parameters_of(scene)]
    names = [*own, *(name for name in given if name not in own)]
    with under_other_names({"--by": "--tolerance"}):
        variables = variables_of(scene, names) if names else ()
    return [_with_tolerance(v, given[v.name]) if v.name in given else v for v in variables]


def _with_tolerance(variable: Variable, text: str) -> Variable:
    try:
        try:
            number, unit = float(text), variable.unit
        except ValueError:
            stated, unit = split(text)
            number = float(stated)
        mine, theirs = (unit_of(u) if u else None for u in (variable.unit, unit))
        if (mine.powers if mine else None) != (theirs.powers if theirs else None):
            raise QuantityError(f"'{unit}' is no unit of {variable.name}.", f"Give it in {variable.unit or 'plain numbers'}.")
        factor = float(theirs.factor / mine.factor) if mine and theirs else 1.0
    except QuantityError as error:
        raise MechanismError(Fault(f"--tolerance {variable.name}={text}", str(error), error.remedy)) from None
    if not 0.0 <= number < np.inf:
        raise MechanismError(Fault(f"--tolerance {variable.name}={text}", "is negative or infinite.", "It counts either way."))
    return replace(variable, tolerance=number * factor)


def parse_limits(text: str) -> QuantityLimits:
    """The limits that a text such as ``90..118``, ``..118`` or ``90..`` states. Raises `MechanismError`."""
    low, dots, high = text.partition("..")
    try:
        limits = QuantityLimits(float(low) if low.strip() else -np.inf, float(high) if high.strip() else np.inf)
        if dots and limits.low < limits.high:
            return limits
    except ValueError:
        pass
    raise MechanismError(
        Fault(f"--limits {text}", "are no limits.", "Write them like 90..118, ..118 or 90.., in the quantity's unit.")
    )


# -- charts -----------------------------------------------------------------------------------------------------------
def tolerance_chart(spans: Tolerances, title: str, axis: Axis) -> Figure:
    """Figure of the bands of a curve over an axis, or of the distribution of a number, and of the contributions of the
    tolerances."""
    with chart(9.5, 4.2) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(2.2, 1.0))
        (_band if spans.curve else _histogram)(left, spans, axis)
        if spans.limits is not None:
            for limit in (spans.limits.low, spans.limits.high):
                if np.isfinite(limit) and spans.curve:
                    left.plot(axis.values, limit - spans.nominal, color="#c8553d", linestyle="--", linewidth=1.0)
                elif np.isfinite(limit):
                    left.axvline(limit, color="#c8553d", linestyle="--", linewidth=1.0)
        left.legend(frameon=True)
        shares = spans.shares()
        order = [int(k) for k in np.argsort(-shares, kind="stable")[:12]]
        places = np.arange(len(order))
        right.barh(places, [100.0 * shares[k] for k in order], color="#3a7d44")
        right.set_yticks(
            places, [f"{spans.variables[k].name} ± {spans.variables[k].tolerance:.3g} {spans.variables[k].unit}" for k in order]
        )
        right.invert_yaxis()
        right.set_xlabel("part in the variance [%]")
        figure.suptitle(f"{title}: tolerance of {spans.quantity.label}")
    return figure


def _band(axes: Axes, tolerances: Tolerances, axis: Axis) -> None:
    """Draw the deviations from the nominal curve; next to the curve itself its band would be too narrow to see."""
    x, nominal = axis.values, tolerances.nominal
    axes.fill_between(x, -tolerances.worst, tolerances.worst, color="#dbe5ee", label="worst case")
    axes.fill_between(x, -tolerances.root_sum_square, tolerances.root_sum_square, color="#a9c6df", label="root sum square")
    axes.plot(x, tolerances.tails[0] - nominal, color="#1b6ca8", label="99.73 % of the samples")
    axes.plot(x, tolerances.tails[1] - nominal, color="#1b6ca8")
    axes.set_xlabel(axis.title)
    axes.set_ylabel(f"{tolerances.quantity.label}: deviation [{tolerances.quantity.unit}]")


def _histogram(axes: Axes, tolerances: Tolerances, axis: Axis) -> None:
    axes.hist(tolerances.values, bins=80, density=True, color="#a9c6df", label=f"{tolerances.samples} samples")
    middle, spread = float(tolerances.mean), float(tolerances.sigma)
    if spread > 0.0:
        x = np.linspace(middle - 4.0 * spread, middle + 4.0 * spread, 200)
        axes.plot(x, np.exp(-0.5 * ((x - middle) / spread) ** 2) / (spread * np.sqrt(2.0 * np.pi)), color="#1b6ca8", label="normal")
    axes.set_xlabel(f"{tolerances.measure.text} [{tolerances.quantity.unit}]")
    axes.set_yticks([])
