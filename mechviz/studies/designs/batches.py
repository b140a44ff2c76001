"""Batches: many designs in one call of the core, for parameters that affect only positions of joints, masses of links, numbers of
loads, and starts and constant speeds of drives.

A few designs are also run singly (see `evaluate`); where the results differ, all designs are run singly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import product

import numpy as np

from mechcore.arrays import Flags, Real
from mechcore.compiled.motion import Executor
from mechcore.effects.registry import effects_of
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.laws.program import CurveOverMaster
from mechcore.laws.timed import ConstantSpeed, moves
from mechcore.motion.compiled import Compiled
from mechcore.motion.design_program import DesignProgram
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism, default_times
from mechcore.motion.sweep import sweep
from mechcore.records import dataclass, numbers_in
from mechcore.spec.mechanism import Link, joints_with_friction
from mechviz.quantities.catalogue import Catalogue, Quantity
from mechviz.scene.annotations import Place
from mechviz.scene.assembly.links import of_shape
from mechviz.scene.document import LinkDocument, value_at
from mechviz.scene.faults import path_text
from mechviz.scene.kinds.bodies import MassDocument
from mechviz.scene.reading.formulas import formula_values, parameter_arrays, parameters_behind
from mechviz.scene.scene import Scene
from mechviz.studies.designs.measures import Measure, needs_forces, quantity_of, table_values
from mechviz.studies.designs.sampling import Variation

NOT_FINITE = "the values are not finite"  # at some frames, although the mechanism is assembled at all
MOST_CORNERS = 12  # largest number of parameters whose corners are all checked
VariedNumbers = dict[tuple[int | str, ...], float]  # by their paths in a mechanism


@dataclass(frozen=True, eq=False)
class DesignBatch:
    """A batch of designs: the compiled nominal design, the times of the frames, and the values that vary."""

    scene: Scene
    compiled: Compiled
    time: Real
    variations: tuple[Variation, ...]
    columns: tuple[tuple[Measure, Quantity, int], ...]
    places: tuple[Place, ...]
    loads: tuple[tuple[tuple[int | str, ...], Place, float, float], ...]  # number of a load = constant + factor times a value
    count: int = 0  # number of designs of the whole study

    @property
    def drive(self) -> Real | None:
        """Coordinate (F,) of the first drive, the same in all designs; None without drives."""
        drives = self.compiled.mechanism.drives
        return np.broadcast_to(drives[0].law(self.time)[0], self.time.shape) if drives else None

    @property
    def has_friction(self) -> bool:
        """Whether there is dry friction, for which a C program may leave some designs to single runs."""
        return "friction" in self.compiled.mechanism.effects and bool(joints_with_friction(self.compiled.mechanism.joints))

    @cached_property
    def _constant(self) -> dict[str, ConstantSpeed]:
        """The laws of drives of constant speed, by their joints."""
        return {d.joint: d.law for d in self.compiled.mechanism.drives if isinstance(d.law, ConstantSpeed)}

    @cached_property
    def _varied_drives(self) -> frozenset[str]:
        """Joints of the drives whose start or speed varies."""
        return frozenset(str(place[1]) for place in self.places if place[0] == "joints")

    @cached_property
    def _leader(self) -> str:
        """Joint of the leading drive, whose cycle the frames divide: the first one that moves; "" where none does."""
        return next((d.joint for d in self.compiled.mechanism.drives if moves(d.law)), "")

    @property
    def period_varies(self) -> bool:
        """Whether the period of the cycle varies between designs."""
        return ("joints", self._leader, "drive", "speed") in self.places

    @property
    def comparable(self) -> bool:
        """Whether frames of the same number are comparable between designs: the leading drive has the same displacement there, and
        its sense of rotation is the same in all designs, which is checked at the corners of the variations."""
        drives = self.compiled.mechanism.drives
        still = [d.joint for d in drives if not moves(d.law)]
        if self._varied_drives.intersection(still[: [d.joint for d in drives].index(self._leader)] if self._leader else still):
            return False  # a drive at rest before the leader could become the leader
        if any(m.reducer == "at" for m, _, _ in self.columns) and ("joints", drives[0].joint, "drive", "start") in self.places:
            return False
        if not self.period_varies:
            return True
        leader = self._constant[self._leader]
        moving = [d.law for d in drives if d.joint not in self._constant]
        timed = any("time" in effect.needs for effect in effects_of(self.compiled.mechanism))
        if timed or not all(isinstance(law, CurveOverMaster) and law.master == leader for law in moving):
            return False
        if len(self.variations) > MOST_CORNERS or (moving and ("joints", self._leader, "drive", "start") in self.places):
            return False
        corners = np.array(
            list(product(*((min(v.values), max(v.values)) if v.values else (v.low, v.high) for v in self.variations)))
        )
        amounts = parameter_arrays(self.scene.document, {v.name: corners[:, k] * v.factor for k, v in enumerate(self.variations)})
        place: Place = ("joints", self._leader, "drive", "speed")
        return bool((formula_values(self.scene.document, amounts, (place,))[place] * leader.speed > 0.0).all())

    @cached_property
    def program(self) -> DesignProgram | str:
        """The C program of the batch, or why numpy computes it. Raises `MechanismError` where executor "c" is required and
        fails."""
        _, _, program = self._swept(self.nominal)
        return program

    @property
    def nominal(self) -> Real:
        """The design of the scene itself (1, n)."""
        return np.array([[self.scene.parameters[v.name].amount.number / v.factor for v in self.variations]], float)

    def curves(self, designs: Real) -> tuple[list[Real], list[str]]:
        """Curves (D, F) of each measure for designs (D, n), and for each design the reason why it has none, or ""."""
        curves, reasons, _ = self._swept(designs)
        return curves, reasons

    def _swept(self, designs: Real) -> tuple[list[Real], list[str], DesignProgram | str]:
        amounts = parameter_arrays(self.scene.document, {v.name: designs[:, k] * v.factor for k, v in enumerate(self.variations)})
        values = formula_values(self.scene.document, amounts, self.places)
        count = len(designs)
        reasons = [""] * count
        for name, known in self.scene.parameters.items():
            numbers = np.broadcast_to(amounts[name].number, (count,))
            for k in map(int, np.flatnonzero(~known.allows(numbers))):
                reasons[k] = f"parameters.{name}: is outside of its range"
        points, masses, wrong = self._varied(values, count)
        for k in wrong:
            reasons[k] = reasons[k] or "links: a mass or moment of inertia is negative"
        with np.errstate(all="ignore"):
            loads = {number: constant + factor * values[place] for number, place, constant, factor in self.loads}
            pace, drives = self._driven(values, count)
            for k in map(int, np.flatnonzero(pace <= 0.0) if pace is not None else ()):
                reasons[k] = reasons[k] or f"joints.{self._leader}.drive: turns the other way"
            swept = sweep(self.compiled, points, self.time, self._collect, masses, loads, self.count, pace, drives)
        curves = [swept.results[_curve_name(quantity, column)] for _, quantity, column in self.columns]
        for k in map(int, np.flatnonzero(~swept.assembled)):
            reasons[k] = reasons[k] or "joints: the mechanism cannot be assembled at all frames of the run"
        whole: Flags = np.all([np.isfinite(curve).all(axis=1) for curve in curves], axis=0)
        for k in map(int, np.flatnonzero(~whole)):
            reasons[k] = reasons[k] or NOT_FINITE
        return curves, reasons, swept.program

    def _driven(self, values: Mapping[Place, Real], count: int) -> tuple[Real | None, dict[str, tuple[Real, Real]]]:
        """Pace (D,) of each design relative to the nominal one, None where it does not vary, and the starts and speeds (D,) of
        drives that differ in more than the pace, by joint."""
        pace = values["joints", self._leader, "drive", "speed"] / self._constant[self._leader].speed if self.period_varies else None
        drives = {}
        for joint, law in self._constant.items():
            start, speed = (values.get(("joints", joint, "drive", what)) for what in ("start", "speed"))
            if start is not None or (joint != self._leader and (speed is not None or pace is not None)):
                drives[joint] = (
                    np.full(count, law.start) if start is None else start,
                    np.full(count, law.speed) if speed is None else speed,
                )
        return pace, drives

    def _varied(
        self, values: Mapping[Place, Real], count: int
    ) -> tuple[dict[tuple[str, str], Real], dict[str, tuple[Real, Real, Real]], list[int]]:
        """Coordinates of points (D, 2), masses (mass, centre, inertia) of links, and the designs in which a mass or inertia is
        negative."""
        links: dict[str, Link] = {link.name: link for link in self.compiled.mechanism.links}
        points: dict[tuple[str, str], Real] = {}
        masses: dict[str, tuple[Real, Real, Real]] = {}

        def weights(link: str) -> tuple[Real, Real, Real]:
            own = links[link]
            if link not in masses:
                masses[link] = np.full(count, own.mass), np.tile(own.centre, (count, 1)), np.full(count, own.inertia)
            return masses[link]

        for place, numbers in values.items():
            if place[0] != "links":
                continue
            link = str(place[1])
            if place[2] == "points":
                key = link, str(place[3])
                if key not in points:
                    points[key] = np.tile(np.asarray(links[link].points[key[1]], float), (count, 1))
                points[key][:, int(place[4])] = numbers
            elif place[2] == "mass":
                weights(link)[0][:] = numbers
            elif place[2] == "centre":
                weights(link)[1][:, int(place[3])] = numbers
            else:
                weights(link)[2][:] = numbers
        for link in dict.fromkeys(str(place[1]) for place in values if place[0] == "links"):
            shape = self.scene.document.links[link].shape
            if isinstance(shape, str):
                mass, centre, inertia = weights(link)
                known = [
                    points.get((link, name), np.tile(np.asarray(xy, float), (count, 1))) for name, xy in links[link].points.items()
                ]
                where, inertia[:] = of_shape(shape, mass, [xy[:, 0] + 1j * xy[:, 1] for xy in known])
                centre[:] = np.column_stack([where.real, where.imag])
        if not points:  # the core takes the number of designs from the points
            joint = next(j for j in self.compiled.model.joints if j.name in links[j.links[1]].points)
            points[joint.links[1], joint.name] = np.tile(np.asarray(links[joint.links[1]].points[joint.name], float), (count, 1))
        negative = np.zeros(count, bool)
        for mass, _, inertia in masses.values():
            negative |= (mass < 0.0) | (inertia < 0.0)
        return points, masses, np.flatnonzero(negative).tolist()

    def _collect(self, motion: Motion) -> dict[str, Real]:
        """The curves (D, F) of all measures by name; several numbers of one curve share it."""
        forces = solve_forces(motion) if any(needs_forces(q.path) for _, q, _ in self.columns) else None
        collected: dict[str, Real] = {}
        tables: dict[tuple[str, ...], Real] = {}
        for _, quantity, column in self.columns:
            if _curve_name(quantity, column) in collected:
                continue
            if quantity.path not in tables:
                rows = table_values(quantity.path, motion, forces)
                tables[quantity.path] = np.broadcast_to(rows, (*motion.shape, rows.shape[-1]))
            rows = tables[quantity.path]
            flat = quantity.entry.read(rows.reshape(-1, rows.shape[-1]))
            collected[_curve_name(quantity, column)] = flat[:, column].reshape(motion.shape)
        return collected


def _curve_name(quantity: Quantity, column: int) -> str:
    return f"{quantity.key}[{column}]"


def batch_of(
    scene: Scene,
    variations: Sequence[Variation],
    measures: Sequence[Measure],
    catalogue: Catalogue,
    frames: tuple[int, int],
    executor: tuple[Executor, int],
) -> DesignBatch | None:
    """The batch of a study, or None where single runs are needed: where the variations affect more than a batch supports (see the
    module docstring), or the mechanism has groups, effects or quantities that batches do not have.

    ``frames``: frames and cycles of the run; ``executor``: executor and total number of designs. Raises `MechanismError` where
    executor "c" is required and compiling fails."""
    names = {v.name for v in variations}
    places = tuple(place for place in scene.document.formulas if names & parameters_behind(scene.document, place))
    mechanism = scene.mechanism
    if scene.simulation is not None or scene.accuracy.target is not None or not all(_can_vary(scene, place) for place in places):
        return None
    links: dict[str, LinkDocument] = dict(scene.document.links)
    for link in {str(place[1]) for place in places if place[2] == "points"}:
        own = links[link]
        if own.point_masses or isinstance(own.mass, MassDocument) or isinstance(own.centre, str):
            return None
    columns = []
    for measure in measures:
        quantity = quantity_of(measure, catalogue)
        columns.append((measure, quantity, measure.column(quantity)))
    try:
        compiled = compile_mechanism(mechanism, scene.accuracy)
        loads = tuple(varied for place in places if place[0] == "loads" for varied in _load_numbers(scene, place))
        batch = DesignBatch(scene, compiled, default_times(mechanism, *frames), tuple(variations), tuple(columns), places, loads)
        how, count = executor
        if batch.has_friction:
            batch = replace(batch, compiled=replace(compiled, executor=how), count=count)
        if not batch.comparable:
            return None
        batch.curves(batch.nominal)
    except MechanismError as error:
        if any(fault.path == "executor" for fault in error.faults):
            raise
        return None
    except (LookupError, StopIteration, ValueError, TypeError):
        return None
    return replace(batch, compiled=replace(compiled, executor=how), count=count)


def _can_vary(scene: Scene, place: Place) -> bool:
    """Whether a value of the document may vary within a batch."""
    if place[0] == "loads":
        return True
    if place[0] == "joints":
        laws = {d.joint: d.law for d in scene.mechanism.drives}
        return place[2:] in (("drive", "speed"), ("drive", "start")) and isinstance(laws.get(str(place[1])), ConstantSpeed)
    if place[0] != "links" or place[2] not in ("points", "mass", "centre", "inertia"):
        return False
    link = scene.document.links[str(place[1])]
    if place[2] == "points":
        return isinstance(link.points, dict)
    return not isinstance(link.mass, MassDocument) and not link.point_masses


def _load_numbers(scene: Scene, place: Place) -> list[tuple[tuple[int | str, ...], Place, float, float]]:
    """The numbers of loads that depend on a value of the document, each as constant plus factor times the value. Raises
    `ValueError` where the value affects anything else, or not linearly."""
    unit = float(scene.units.factor(scene.kinds[path_text(place)])) if path_text(place) in scene.kinds else 1.0
    value = float(value_at(scene.document, place))
    step = 0.125 * (abs(value) or 1.0)

    def numbers(x: float) -> tuple[VariedNumbers, VariedNumbers]:
        mechanism = scene.changed({place: x}).mechanism
        return dict(numbers_in(mechanism.loads)), dict(numbers_in(replace(mechanism, loads=())))

    (low, one), (middle, _), (high, other) = (numbers(value + s * step) for s in (-1.0, 0.0, 1.0))
    if one != other or low.keys() != high.keys():
        raise ValueError(f"{path_text(place)} decides more than numbers of loads")
    varied = []
    for number, x in middle.items():
        if low[number] == high[number]:
            continue
        if abs(low[number] + high[number] - 2.0 * x) > 1e-14 * (abs(low[number]) + abs(high[number])):
            raise ValueError(f"{path_text(place)} is not proportional to a number of a load")
        factor = (high[number] - low[number]) / (2.0 * step * unit)
        varied.append((number, place, x - factor * value * unit, factor))
    return varied
