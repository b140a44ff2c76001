"""Sensitivities: exact derivatives of a quantity of a run with respect to parameters of its scene, ranked, with a tornado chart;
and tolerance bands of curves, computed from these derivatives."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import field
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.arrays import Index, Real
from mechcore.cams.closures import contact_modulus
from mechcore.cams.placement.spatial import PlacedSpatial
from mechcore.derivatives.exact import Derivatives
from mechcore.derivatives.forced import derivatives_under_forces
from mechcore.derivatives.impacts import contact_numbers
from mechcore.derivatives.model_numbers import ModelNumbers, Parameter
from mechcore.derivatives.steady import derivatives_from_steady_run
from mechcore.dynamics.events import with_slot_ends
from mechcore.errors import Fault, MechanismError
from mechcore.forces.cam_rating import AnyCam, carrying, contact_curvature, placed_cams
from mechcore.forces.powers import powers_by_label
from mechcore.forces.section_forces import bearings, guide_load
from mechcore.kinematics.model import Model
from mechcore.motion.at_once import indeterminate
from mechcore.motion.metrics import curvature, instant_centres
from mechcore.motion.motion import Motion
from mechcore.motion.solve import default_times
from mechcore.numerics.tape import value_of
from mechcore.records import dataclass
from mechcore.reduction.balancing import shaking
from mechcore.spec.loads import Servo
from mechcore.spec.mechanism import CamJoint, Mechanism
from mechviz.figures import chart
from mechviz.quantities.catalogue import Quantity
from mechviz.quantities.vectors import point_name
from mechviz.runs import Run
from mechviz.scene.faults import under_other_names
from mechviz.scene.scene import Scene
from mechviz.studies.designs.measures import Measure, StartTurn, needs_forces, parse_measure, quantity_of, table_values
from mechviz.studies.designs.variables import Variable, parameters_of, variables_of, without_ranges

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UNKNOWN = "not known"  # text for derivatives that do not exist, as at singular positions
STRAIGHT = 1e-100  # [1/m] substitute for zero curvature, so that the radius has a derivative


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Sensitivity of a measure to variables: its ``curve`` (F,) in the unit of the quantity, and ``slopes`` (P, F) of the curve per
    unit of each variable. With a reducer also the ``number`` and its ``derivatives`` (P,); both are NaN otherwise."""

    measure: Measure
    quantity: Quantity
    variables: tuple[Variable, ...]
    curve: Real
    find_slopes: Callable[[], Real] = field(repr=False)
    number: float
    derivatives: Real

    def __repr__(self) -> str:
        return f"Sensitivity of {self.measure.text} to {', '.join(v.name for v in self.variables)}"

    @cached_property
    def slopes(self) -> Real:
        """Derivatives (P, F) of the curve, by forward mode automatic differentiation for all variables at once; computed at first
        use."""
        return self.find_slopes()

    @property
    def size(self) -> float:
        """Reference value of relative effects: the size of the number, or the largest size of the curve."""
        return abs(self.number) if self.measure.reducer else float(np.nanmax(np.abs(self.curve)))

    @property
    def values(self) -> Real:
        """Values (P,) of the variables, in their units."""
        return np.array([v.value for v in self.variables])

    def by_one_percent(self) -> Real:
        """Effect (P,) of an increase of each variable by one percent; for a curve the largest effect over the run, with its
        sign."""
        return 0.01 * self.values * self._largest()

    def by_tolerance(self) -> Real:
        """Size (P,) of the effect of each variable's tolerance; 0 where it has none."""
        return np.array([v.tolerance for v in self.variables]) * np.abs(self._largest())

    def _largest(self) -> Real:
        if self.measure.reducer:
            return self.derivatives
        where = np.nanargmax(np.abs(np.where(np.isfinite(self.slopes), self.slopes, 0.0)), axis=1)
        return np.asarray(self.slopes[np.arange(len(self.slopes)), where])

    def order(self) -> list[int]:
        """Indices of the variables, sorted by the effect of one percent, the greatest first."""
        return [int(k) for k in np.argsort(-np.abs(np.nan_to_num(self.by_one_percent())), kind="stable")]

    def rows(self) -> Iterator[tuple[str, ...]]:
        """Rows of the table, headings first: variable, value, derivative, effect of one percent more, and effect of the
        tolerance."""
        toleranced = any(v.tolerance for v in self.variables)
        unit = self.quantity.unit
        slope = "derivative" if self.measure.reducer else "largest derivative"
        yield (
            "variable",
            "value",
            slope,
            f"+1 % does [{unit}]",
            "in %",
            *(["tolerance", f"does ± [{unit}]"] if toleranced else []),
        )
        one, off, slopes = self.by_one_percent(), self.by_tolerance(), self._largest()
        for k in self.order():
            v = self.variables[k]
            per = f"{unit}/{v.unit}" if v.unit else unit
            part = f"{100.0 * one[k] / self.size:+.3g} %" if self.size else ""
            known = np.isfinite(slopes[k])
            does = (f"{slopes[k]:.6g} {per}", f"{one[k]:+.4g}", part) if known else (UNKNOWN, UNKNOWN, "")
            wide = f"{off[k]:.4g}" if known else UNKNOWN
            yield (
                v.name,
                f"{v.value:.6g} {v.unit}".strip(),
                *does,
                *([f"{v.tolerance:.4g} {v.unit}".strip(), wide] if v.tolerance else ["", ""] if toleranced else []),
            )


def sensitivity(run: Run, of: str, by: str | Sequence[str] = ()) -> Sensitivity:
    """Sensitivity of a quantity, or of a number such as ``joint.B.reaction:max``, to parameters of the run's scene or numbers in it
    by their paths: exact derivatives at every frame. Without ``by``: all independent parameters. Raises `MechanismError`."""
    with under_other_names({"--of": "of", "--by": "by"}):
        measure = parse_measure(run.scene, of)
        variables = variables_of(run.scene, [by] if isinstance(by, str) else by)
        return sensitivities(run, [measure], variables)[0]


def sensitivities(
    run: Run, measures: Sequence[Measure], variables: Sequence[Variable], turns: Sequence[StartTurn] = ()
) -> list[Sensitivity]:
    """Sensitivities of several measures, which share one computation; ``turns``: of the measures, by default those of the run.

    Derivatives of numbers come from reverse mode automatic differentiation, at a cost independent of the number of variables; those
    of curves from forward mode. Raises `MechanismError`.
    """
    quantities = [quantity_of(measure, run.catalogue) for measure in measures]
    drives = run.motion.mechanism.drives
    parts: list[tuple[Index, Derivatives, list[Any]]] = []
    driven: list[Any] = []  # coordinate of the first drive in each part
    for rows, exact in derivatives_of(run, variables):
        columns, once = [], dict[tuple[str, int], Any]()
        for measure, quantity in zip(measures, quantities, strict=True):
            key = quantity.key, measure.column(quantity)
            try:
                once[key] = once[key] if key in once else traced(exact, quantity)[:, key[1]]
                columns.append(once[key])
            except LookupError:
                why = f"the derivatives of {quantity.key} are not known."
                raise MechanismError(
                    Fault(f"--of {measure.text}", why, "Sweep it instead: mechviz sweep SCENE --vary ...")
                ) from None
        parts.append((rows, exact, columns))
        driven.append(exact.motion.coordinate(drives[0].joint)[:, 0] if any(m.reducer == "at" for m in measures) else None)

    def slopes_of(*numbers: int) -> list[Real]:
        slopes_found: list[Real | None] = [None] * len(numbers)
        for rows, exact, columns in parts:
            for k, part in enumerate(exact.of(*(columns[n] for n in numbers))):
                slopes_found[k] = _with_rows(slopes_found[k], rows, part, run.motion.frames)
        return [slopes for slopes in slopes_found if slopes is not None]  # a run has frames

    curves = [k for k, measure in enumerate(measures) if not measure.reducer]
    known = dict(zip(curves, slopes_of(*curves) if curves else (), strict=True))
    drive = run.catalogue.coordinate(drives[0].joint) if drives else None
    time = run.catalogue.numbers.time
    results = []
    for n, (measure, quantity) in enumerate(zip(measures, quantities, strict=True)):
        curve = quantity.values()[:, measure.column(quantity)]
        curve = turns[n].aligned(curve) if turns else curve
        number, derivatives = float("nan"), np.full(len(variables), np.nan)
        if measure.reducer:
            number = float(measure.reduced(curve, time, drive))
            weights = measure.weights(curve, time, drive)
            parts_of_sum = [exact.adjoint(columns[n], weights[None, rows])[0] for rows, exact, columns in parts]
            unknown = any(weights[rows[exact.singular]].any() for rows, exact, _ in parts)
            unknown = unknown or any(weights[rows[np.isnan(value_of(columns[n]))]].any() for rows, _, columns in parts)
            derivatives = np.full(len(variables), np.nan) if unknown else np.sum(parts_of_sum, axis=0)
            if measure.reducer == "at":  # the drive passes the place at another instant
                moved = zip(driven, parts, strict=True)
                ahead = np.sum([exact.adjoint(along, weights[None, rows])[0] for along, (rows, exact, _) in moved], axis=0)
                derivatives = derivatives - np.where(ahead == 0.0, 0.0, measure.slope(curve, time, drive) * ahead)
        find = partial(known.__getitem__, n) if n in known else lambda n=n: slopes_of(n)[0]
        results.append(Sensitivity(measure, quantity, tuple(variables), curve, find, number, derivatives))
    return results


def _with_rows(whole: Real | None, rows: Index, part: Real, frames: int) -> Real:
    """Derivatives (P, F, ...) of all frames, into which those of some frames are written; the others are NaN at first."""
    if whole is None:
        whole = np.full((len(part), frames, *part.shape[2:]), np.nan)
    whole[:, rows] = part
    return whole


def core_parameters(scene: Scene, variables: Sequence[Variable]) -> tuple[Parameter, ...]:
    """Variables as parameters of the core's derivatives, in their units. Ranges are removed, because neighbouring values, which are
    evaluated too, may lie outside of them."""
    wide = without_ranges(scene)

    def of(variable: Variable) -> Parameter:
        def mechanism(value: float) -> Mechanism:
            return variable.changed(wide, value).mechanism

        def contacts(value: float) -> ModelNumbers:
            changed = variable.changed(wide, value)
            spec = changed.simulation
            assert spec is not None
            return contact_numbers(with_slot_ends(changed.mechanism, spec.stops), spec.separable_cams)

        under_forces = scene.simulation is not None
        return Parameter(variable.name, variable.value, variable.width, mechanism, contacts if under_forces else None)

    return tuple(of(v) for v in variables)


def derivatives_of(run: Run, variables: Sequence[Variable]) -> list[tuple[Index, Derivatives]]:
    """Derivatives of a run with respect to variables of its scene, in their units, in parts, each with the numbers of its frames.
    They are taken at fixed frame numbers, not at fixed times. Raises `MechanismError`."""
    parameters = core_parameters(run.scene, variables)
    if run.simulation is not None and run.steady is not None:
        assert run.scene.simulation is not None
        whole = bool(np.isnan(run.scene.simulation.duration))
        return derivatives_from_steady_run(run.simulation, run.steady, parameters, run.motion.time, whole=whole)
    if run.simulation is not None:
        return derivatives_under_forces(run.simulation, parameters, run.motion.time)
    frames, cycles = run.scene.frames, run.scene.cycles
    exact = Derivatives(run.motion, parameters, lambda m: default_times(m, frames, cycles))
    return [(np.arange(run.motion.frames), exact)]


def traced(exact: Derivatives, quantity: Quantity) -> Any:
    """The values (F, n) of a quantity on the tape, in its unit. Raises `LookupError` where its derivatives are not implemented, and
    `MechanismError` where the forces have no derivatives."""
    forces = exact.forces if needs_forces(quantity.path) else None
    _check_determined(exact, quantity.path)
    try:
        with np.errstate(all="ignore"):
            rows = _rows(exact, quantity)
            return quantity.entry.read(table_values(quantity.path, exact.motion, forces) if rows is None else rows)
    except TypeError:
        raise LookupError(quantity.key) from None


def _rows(exact: Derivatives, quantity: Quantity) -> Any:
    """The table of a quantity on the tape, or None where `table_values` has it. Raises `LookupError` where derivatives are not
    implemented."""
    match quantity.path[1:]:
        case ("joints" | "cams", joint, what) if joint not in {c.name for c in exact.nominal.model.connections}:
            return _rows_of_separated_cam(exact, what)
        case ("energy",):
            return exact.energy
        case ("power",):
            powers = dict(powers_by_label(exact.forces))
            names = quantity.curves if len(quantity.curves) > 1 else list(powers)  # the curve of a single power has another name
            nothing = np.zeros(exact.nominal.frames)  # power of a stop that is not in contact
            return np.stack([powers.get(name, nothing) for name in names], axis=-1)
        case ("shaking",) if (study := exact.nominal.mechanism.studies.shaking) is not None:
            shaken = shaking(exact.motion, study.about)
            return np.column_stack([shaken.force, shaken.moment])
        case ("cams", joint, "contact" | "normal" | "lift" as what):
            return _of_cam(exact, joint, what)
        case ("loads", *names):
            if quantity.key.endswith("point_of_action"):  # may be drawn at another place
                raise LookupError(quantity.key)
            load = exact.forces.loads.get("/".join(names))
            return np.zeros((exact.nominal.frames, 5)) if load is None else load.values  # None: a stop that is not in contact
        case ("joints", joint, "friction" | "friction_loss" as what) if (friction := exact.forces.friction) is not None:
            return friction.wrench(joint) if what == "friction" else np.stack([friction.losses(joint)], axis=-1)
        case ("joints", joint, "bearing"):
            (guide,) = (p for p in bearings(exact.motion.mechanism) if p.name == joint)
            return guide_load(exact.forces, guide).ends
        case ("answers", "instant_centre", item):
            return next(place for links, place in instant_centres(exact.motion).items() if " ".join(links) == item)
        case ("answers", "curvature", item):
            return curvature(exact.motion, *next(key for key in exact.motion.mechanism.traced if point_name(*key) == item))[:, None]
        case ("cams", joint, "stress"):
            return _stress(exact, joint)
        case ("servos", name, "position" | "error" as what):
            servo = next(x for x in exact.motion.mechanism.loads if isinstance(x, Servo) and x.name == name)
            target, reached = servo.target(exact.motion.time)[0], exact.motion.coordinate(servo.joint)[:, 0]
            return np.stack([target, reached] if what == "position" else [target - reached], axis=-1)
    return None


def _rows_of_separated_cam(exact: Derivatives, what: str) -> Any:
    """Rows of a table of a cam while its follower is separated: forces are zero, all else is NaN."""
    unknown = np.nan
    columns = {
        "reaction": [0.0] * 3,
        "contact": [unknown, unknown, 0.0, unknown, unknown, unknown],
        "normal": [0.0],
        "stress": [0.0] * 2,
    }
    return np.tile(columns.get(what, [unknown] * 3), (exact.nominal.frames, 1))


def _check_determined(exact: Derivatives, path: tuple[str, ...]) -> None:
    """Raise `MechanismError` where a table holds a force of a joint that statics does not determine."""
    match path[1:]:
        case ("joints", joint, "reaction") | ("cams", joint, "contact" | "normal"):
            if exact.nominal.model.needs_global_solve and joint in indeterminate(exact.nominal):
                raise MechanismError(
                    Fault(
                        f"joints.{joint}",
                        f"statics does not determine what {joint} carries: how redundant constraints share a load follows from how "
                        "stiff the parts are and how well they fit, which no scene says, so that there is no derivative.",
                        "Ask for an effort or a reaction that statics determines, or leave the redundant joint out.",
                    )
                )


def _of_cam(exact: Derivatives, joint: str, what: str) -> Any:
    """Rows of the table of a cam's contact, or of its lift, on the tape."""

    def column(name: str, values: Callable[[Any, Motion], Real]) -> Any:
        return exact.contact_of(joint, name, values)

    if what == "lift":
        first = column("law 1", lambda cam, motion: cam.law(cam.rows(motion).angle)[1])
        second = column("law 2", lambda cam, motion: cam.law(cam.rows(motion).angle)[2])
        return np.stack([column("lift", lambda cam, motion: cam.rows(motion).lift), first, second], axis=-1)
    pressed, pressing = exact.forces.normal_reaction(joint), _pressing(exact, joint)[1]
    force = np.hypot(pressed[:, 0], pressed[:, 1]) / _seen(exact, joint)
    if what == "normal":
        return np.stack([np.where(pressing < 0.0, -1.0, 1.0) * force], axis=-1)
    side = carrying(pressing)
    turned = column(
        "pressure angle", lambda cam, motion: np.exp(1j * cam.rows(motion, side).pressure_angle)
    )  # as a unit vector: a pressure angle that stays zero is rounding relative to it
    curvature = column("curvature", lambda cam, motion: 1.0 / cam.rows(motion, side).radius)
    radius = 1.0 / (curvature + np.where(value_of(curvature) == 0.0, STRAIGHT, 0.0))
    beside = column("eccentricity", lambda cam, motion: cam.rows(motion).eccentricity)
    unknown = np.full(exact.nominal.frames, np.nan)  # the place of contact, which is not a quantity of the catalogue
    return np.stack([unknown, unknown, force, np.angle(turned), radius, beside], axis=-1)


def _seen(exact: Derivatives, joint: str) -> Any:
    """Ratio (F,) of the contact force's component in the plane of the mechanism to the contact force of a cam, on the tape."""
    return exact.contact_of(
        joint, "seen", lambda cam, motion: cam.in_plane_share(motion) if isinstance(cam, PlacedSpatial) else np.ones(motion.frames)
    )


def _pressing(exact: Derivatives, joint: str) -> tuple[AnyCam, Real]:
    """A cam, and the contact force along its normal (F,) [N], whose sign tells the flank that carries it."""
    (cam,) = (c for c in placed_cams(exact.nominal) if c.name == joint)
    pressed = value_of(exact.forces.normal_reaction(joint))
    return cam, cam.pressing(exact.nominal, pressed[:, 0] + 1j * pressed[:, 1])


def _stress(exact: Derivatives, joint: str) -> Any:
    """Hertz pressure [Pa] and half width [m] of a cam's contact (F, 2) on the tape, from the contact force and the sum of the
    curvatures of both bodies."""

    def elastic(model: Model) -> Real:
        rating = next(p.rating for p in model.mechanism.joints if isinstance(p, CamJoint) and p.name == joint)
        assert rating is not None and rating.width is not None
        stiff = contact_modulus(rating.modulus, rating.poisson)
        return np.array([stiff / (np.pi * rating.width), 4.0 / (np.pi * stiff * rating.width)])

    of_force, of_width = exact.beside(elastic, elastic(exact.nominal.model), ("rating", joint))
    pressed, seen = exact.forces.normal_reaction(joint), _seen(exact, joint)
    cam, side = _pressing(exact, joint)
    loaded = side != 0.0 if cam.form_closed else side > 0.0
    bent = exact.contact_of(joint, "bent", lambda cam, motion: contact_curvature(motion, cam, side))
    force = np.hypot(pressed[:, 0] + ~loaded, pressed[:, 1]) / seen
    return np.stack([np.sqrt(force * bent * of_force) * loaded, np.sqrt(force / bent * of_width) * loaded], axis=-1)


def tornado(row: Sensitivity, title: str, most: int = 20) -> Figure:
    """Tornado chart: effect of one percent less and more of each of the ``most`` influential variables, and of the tolerances."""
    order = row.order()[:most]
    one, off = row.by_one_percent(), row.by_tolerance()
    toleranced = any(row.variables[k].tolerance for k in order)
    with chart(7.0, 1.2 + 0.3 * len(order)) as figure:
        panels = figure.subplots(1, 2 if toleranced else 1, sharey=True, squeeze=False)[0]
        names = [f"{row.variables[k].name} = {row.variables[k].value:.5g} {row.variables[k].unit}".strip() for k in order]
        places = np.arange(len(order))
        panels[0].barh(places, [-one[k] for k in order], color="#c8553d", label="1 % less")
        panels[0].barh(places, [one[k] for k in order], color="#1b6ca8", label="1 % more")
        panels[0].set_xlabel(f"change of {row.measure.text} [{row.quantity.unit}]")
        panels[0].set_yticks(places, names)
        panels[0].invert_yaxis()
        panels[0].legend()
        if toleranced:
            panels[1].barh(places, [2.0 * off[k] for k in order], left=[-off[k] for k in order], color="#3a7d44")
            panels[1].use_sticky_edges = False
            panels[1].set_xlabel(f"by its tolerance [{row.quantity.unit}]")
        for axes in panels:
            axes.axvline(0.0, color="#222222", linewidth=0.8)
        figure.suptitle(f"{title}: sensitivity of {row.quantity.label}")
    return figure


@dataclass(frozen=True, eq=False)
class Bands:
    """Tolerance bands: half widths (F, n) of the curves of quantities by key, in their units. They are worst case, the sum of the
    effects of all tolerances; NaN at singular frames. ``missing_reason``: why some or all are missing; ``variables``: those with
    the tolerances."""

    halves: Mapping[str, Real] = field(default_factory=dict)
    missing_reason: str = ""
    variables: tuple[Variable, ...] = ()


def with_tolerances(scene: Scene) -> tuple[Variable, ...]:
    """The independent parameters of a scene that have a tolerance."""
    return tuple(v for v in parameters_of(scene) if v.tolerance > 0.0)


def bands_of(run: Run) -> Bands:
    """Tolerance bands of all quantities whose derivatives are implemented, from the tolerances of the scene's parameters; empty
    where no parameter has a tolerance."""
    variables = with_tolerances(run.scene)
    if not variables:
        return Bands()
    refused = ""
    slopes_of: dict[str, Real | None] = {quantity.key: None for quantity in run.catalogue.quantities}
    try:
        parts = derivatives_of(run, variables)
    except MechanismError as error:
        return Bands(missing_reason=error.faults[0].message, variables=variables)
    for rows, exact in parts:
        columns = {}
        for key in slopes_of:
            with suppress(LookupError):
                try:
                    columns[key] = traced(exact, run.catalogue[key])
                except MechanismError as error:
                    refused = error.faults[0].message
        slopes_of = {
            key: _with_rows(slopes_of[key], rows, slopes, run.motion.frames)
            for key, slopes in zip(columns, exact.of(*columns.values()), strict=True)
        }
    tolerances = np.array([v.tolerance for v in variables])
    halves = {
        key: np.asarray(np.tensordot(tolerances, np.abs(slopes), 1)) for key, slopes in slopes_of.items() if slopes is not None
    }
    return Bands(halves, refused, variables)
