"""Exact derivatives, at every frame, of motions and forces by parameters of a mechanism.

Two kinds of functions are composed. The numbers of the compiled mechanism (vectors, masses, coefficients, positions of drives
...) are explicit functions of a parameter: `model_numbers.slopes` interpolates them by polynomials through enough values to be
exact to rounding. Positions are implicit functions of these numbers: their derivatives follow from the Jacobian of the loop
equations, block by block. The same tape (`mechcore.numerics.tape`) continues through velocities, accelerations and forces, whose
code runs on traced arrays. In forward mode it gives the derivatives of any results by a few parameters, in reverse mode those of
one number by all that varies.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np

from mechcore.arrays import Index, Real, Values
from mechcore.branches.unwrapped import LinkAngles
from mechcore.derivatives.cams import (
    by_argument,
    in_phase,
    key_of_signs,
    moved_on,
    shape_of,
    sliding_of,
    sliding_parts,
    third_derivative,
)
from mechcore.derivatives.friction import forces_with_friction
from mechcore.derivatives.knots import with_nominal_knots
from mechcore.derivatives.model_numbers import (
    ModelNumbers,
    Parameter,
    argument_of,
    check_motion,
    check_structure,
    numbers_of_model,
    refusal,
    slopes,
    turning_vectors,
)
from mechcore.derivatives.time_pieces import TracedTable, TracedTarget
from mechcore.derivatives.zeros import with_friction
from mechcore.effects.registry import totals
from mechcore.forces.equilibrium import joint_forces
from mechcore.forces.kinetostatics import Forces
from mechcore.joints.base import Relation
from mechcore.kinematics.build import build_model, loop_sum
from mechcore.kinematics.columns import matrix_of
from mechcore.kinematics.model import Model
from mechcore.kinematics.program import Block, LinearConstraint
from mechcore.kinematics.state import State, relation_sum, value
from mechcore.laws.timed import Free
from mechcore.motion.motion import Motion
from mechcore.numerics.frames import QUIET, lazy
from mechcore.numerics.tape import Traced, Untraced, regular_inverses, value_of
from mechcore.numerics.tape_functions import new_tape
from mechcore.records import NumberPlace, with_numbers
from mechcore.spec.mechanism import Mechanism, joints_with_friction
from mechcore.topology.graph import vector_loops

T = TypeVar("T")
OPEN_LOOP = 1e-9  # largest closure error of redundant loops over the width of a parameter, relative to the length scale


class Derivatives:
    """Derivatives of a motion, and of the forces that it needs, by parameters.

    ``times``: from a mechanism to the times (F,) of its frames, where they depend on it, as those of whole cycles do; by default
    they are the motion's. Frames of the same number are compared. ``under_forces``: free coordinates have the values of the motion
    and do not depend on the parameters (see `forced`). Raises `MechanismError` with the reason where there are no derivatives.
    """

    every_drive = False  # whether positions and rates of all drives are variables of the tape, not only those that move

    def __init__(
        self,
        motion: Motion,
        parameters: Sequence[Parameter],
        times: Callable[[Mechanism], Real] | None = None,
        *,
        under_forces: bool = False,
    ):
        check_motion(motion, under_forces)
        self.nominal = motion
        self.parameters = tuple(with_nominal_knots(p, motion.mechanism, same_times=under_forces) for p in parameters)
        self.times = times or (lambda _: motion.time)
        self.tape = new_tape()
        self.leaves: dict[NumberPlace, Traced] = {}
        self._slopes: dict[int, list[Any]] = {}  # derivatives of leaves by the parameters
        self._redundant: list[tuple[str, Traced]] = []  # redundant loops: a joint, and the residual, which has to stay zero
        self._models: dict[tuple[str, float], Model] = {}  # models beside the nominal one, by parameter and value
        self._arms = turning_vectors(motion.model)  # of this model and those beside it, without vectors that stay zero
        with np.errstate(**QUIET):
            self._varied = [self._numbers_of(p) for p in self.parameters]
            for p, known in zip(self.parameters, self._varied, strict=True):
                for place in known:
                    if place[0] == "kept":
                        load = motion.mechanism.loads[place[2]].name
                        raise refusal(f"a table or law inside the load {load} depends on {p.name}.", "Sweep it instead.")
            for place, number in self._nominal.items():
                own = [slopes.get(place) for slopes in self._varied]
                if any(d is not None for d in own):
                    self.leaves[place] = self._leaf(number, own)
        for d, drive in enumerate(motion.mechanism.drives):
            if self.every_drive or isinstance(drive.law, Free):
                for k, number in enumerate(motion.drives[d]):
                    if ("drive", d, k) not in self.leaves:
                        self.leaves["drive", d, k] = self._leaf(number, [None] * len(self.parameters))
        for name, number in motion.states.items():
            self.leaves["state", name] = self._leaf(number, [None] * len(self.parameters))
        self._refused(lambda: self.motion)
        self._check_closure()

    # -- results ------------------------------------------------------------------------------------------------------
    @cached_property
    def motion(self) -> Motion:
        """The motion on the tape: its results are traced."""
        return _TracedMotion(self, self._model, self._state)

    @cached_property
    def forces(self) -> Forces:
        """The forces on the tape."""
        return self._refused(self._forces)

    def of(self, *results: Any) -> list[Real]:
        """Derivatives (P, ...) of results by the parameters, in SI units; NaN where a position is singular."""
        traced = [x for x in results if isinstance(x, Traced)]
        given = {number: np.stack(d) for number, d in self._slopes.items()}
        values = iter(self.tape.forward(given, traced) if given else [self._unmoved(x.value) for x in traced])
        out = [np.array(next(values)) if isinstance(x, Traced) else self._unmoved(x) for x in results]
        for d in out:
            if len(self.singular) and d.shape[1:2] == (self.nominal.frames,):
                d[:, self.singular] = np.nan
        return out

    def _unmoved(self, plain: Any) -> Real:
        """Derivatives (P, ...) of what depends on no parameter: zero, and NaN where it is not known."""
        return np.tile(np.where(np.isnan(plain), np.nan, 0.0), (len(self.parameters), *(1,) * np.ndim(plain)))

    @cached_property
    def energy(self) -> Any:
        """Kinetic and potential energy, work and dissipation so far (F, 4) [J], on the tape."""
        return self._refused(lambda: self.forces.energy)

    @cached_property
    def singular(self) -> Index:
        """Frames so close to a singular position that the branch is interpolated: no derivatives are known there."""
        given = [interpolant.frames for interpolants in (self.nominal.interpolants or {}).values() for interpolant in interpolants]
        return np.unique(np.concatenate(given)) if given else np.zeros(0, np.intp)

    def adjoint(self, result: object, weights: Real) -> Real:
        """Derivatives (M, P) by the parameters of M sums of a result with ``weights`` (M, ...): by one reverse pass for any number
        of parameters, in forward mode where a step of the computation has no reverse."""
        out = np.zeros((len(weights), len(self.parameters)))
        if isinstance(result, Traced):
            try:
                known = self.tape.adjoint(result, weights)
            except Untraced:  # a work over the run
                flat, (d,) = weights.reshape(len(weights), -1), self.of(result)
                return flat @ np.where(flat.any(axis=0), d.reshape(len(d), -1), 0.0).T
            for number, by_parameter in self._slopes.items():
                if number in known:
                    w = known[number].reshape(len(weights), -1)
                    for p, d in enumerate(by_parameter):
                        out[:, p] += (w @ np.conj(np.ravel(d))).real
        return out

    # -- numbers of the compiled mechanism ----------------------------------------------------------------------------
    @cached_property
    def _nominal(self) -> ModelNumbers:
        model = self.nominal.model
        return numbers_of_model(model, self.nominal, self.nominal.time)

    def _numbers_of(self, parameter: Parameter) -> ModelNumbers:
        """Derivatives by a parameter of the numbers that depend on it."""

        def at(x: float) -> ModelNumbers:
            model = self._beside(parameter, x)
            check_structure(self.nominal.model, model, parameter.name)
            self._arms |= turning_vectors(model)
            return numbers_of_model(model, self.nominal, self.times(model.mechanism))

        return slopes(at, self._nominal, parameter)

    def _beside(self, parameter: Parameter, x: float) -> Model:
        """The model for another value of a parameter."""
        if (parameter.name, x) not in self._models:
            self._models[parameter.name, x] = build_model(parameter.mechanism(x))
        return self._models[parameter.name, x]

    def _alone(self, of: Callable[[Model], Any], parameter: Parameter, x: float) -> ModelNumbers:
        """A number of the model for a parameter's value ``x``, as the only one of its `ModelNumbers`."""
        return {(): np.asarray(of(self._beside(parameter, x)))}

    def _leaf(self, number: object, slopes: Sequence[Any]) -> Traced:
        leaf = self.tape.variable(number)
        zero = np.zeros_like(leaf.value)
        self._slopes[leaf.number] = [zero if d is None else np.broadcast_to(d, zero.shape).astype(zero.dtype) for d in slopes]
        return leaf

    def state_slopes(self, leaf: Traced, by_parameters: Sequence[Any]) -> None:
        """Set the derivatives of a variable of the tape by each parameter."""
        self._slopes[leaf.number] = list(by_parameters)

    def beside(self, of: Callable[[Model], Any], number: object, key: NumberPlace) -> Any:
        """``number``, traced or not, which depends on the motion, with its direct dependence on the parameters added: that of
        ``of(model)`` at the nominal motion, through numbers of the compiled mechanism that are not on the tape."""
        if key not in self.leaves:
            plain = np.asarray(of(self.nominal.model))
            own = []
            for p in self.parameters:
                own.append(slopes(partial(self._alone, of, p), {(): plain}, p).get(()))
            if all(d is None for d in own):
                return number
            self.leaves[key] = self._leaf(np.zeros_like(plain), own)
        return number + self.leaves[key]

    def contact_of(self, joint: str, what: str, values: Callable[[Any, Motion], Real]) -> Any:
        """Numbers (F,) of a cam and its follower on the tape, called ``what``: ``values(cam, motion)`` at the nominal motion.
        Raises `LookupError` where the joint is no cam."""
        r, relation = next((r, x) for r, x in enumerate(self.nominal.model.relations) if x.name == joint)
        if relation.geometry is None:
            raise LookupError(joint)
        known = np.isfinite(values(relation.geometry, self.nominal))

        def finite(cam: Any, motion: Motion) -> list[Real]:
            return [np.where(known, values(cam, motion), 0.0)]

        return self._of_cam(r, (what,), self.nominal, finite)[0] + np.where(known, 0.0, np.nan)

    def _of_cam(self, r: int, key: NumberPlace, motion: Motion, values: Callable[[Any, Motion], Sequence[Any]]) -> list[Any]:
        """Numbers (F,) of a relation (for a cam, of its geometry) and of a ``motion`` on the tape, with their dependence on the
        parameters through the relation's shape and through the argument of its law."""
        at, own = self.nominal, self.nominal.model.relations[r]

        def of(k: int) -> Callable[[Model], Any]:
            return lambda model: np.broadcast_to(values(in_phase(shape_of(model.relations[r]), own.geometry), at)[k], at.shape)

        argument: Any = None if own.geometry is None else argument_of(self._model, r, self._state)
        moves = isinstance(argument, Traced)
        found = values(moved_on(own.geometry, at) if moves else shape_of(own), motion)
        found = [self.beside(of(k), x, ("relation", r, *key, k)) for k, x in enumerate(found)]
        if moves:
            on = self._refused(lambda: by_argument(lambda cam: values(cam, at), own.geometry, at))
            found = [x + self.tape.elementwise(np.zeros_like(d), [(argument, d, None)]) for x, d in zip(found, on, strict=True)]
        return found

    # -- on the tape --------------------------------------------------------------------------------------------------
    def _refused(self, work: Callable[[], T]) -> T:
        try:
            with np.errstate(**QUIET):
                return work()
        except Untraced as reason:
            raise refusal(f"{reason}.", "Vary something else, or sweep it.") from None

    def _forces(self) -> Forces:
        motion, mechanism = self.motion, self.nominal.mechanism
        force, moment, formed = totals(motion)
        if "friction" in mechanism.effects and joints_with_friction(motion.mechanism.joints):
            nominal = with_friction(self.nominal, [p[1:] for p in self.leaves if p[:2] == ("mechanism", "joints")])
            return forces_with_friction(self.tape, nominal, motion, formed(), force, moment)
        return Forces(motion, formed, *joint_forces(motion, force, moment)[:2])

    def _get(self, place: NumberPlace, plain: object) -> Any:
        return self.leaves.get(place, plain)

    @cached_property
    def _model(self) -> Model:
        """The nominal model with its varied numbers on the tape."""
        model, get = self.nominal.model, self._get
        if not self.leaves and not model.relations:  # a relation may have varied numbers that are no leaves
            return model
        joints = []
        for j, joint in enumerate(model.joints):
            own = {name: get(("joint", j, name), getattr(joint, name)) for name in ("a", "b", "slide")}
            joints.append(replace(joint, **own))
        turn = tuple(get(("turn", k), x) for k, x in enumerate(model.turn))
        loops = vector_loops(model.ends, joints, model.tree)
        sums = [loop_sum(c, model.angles, turn) for c in loops]
        kept = [tuple(arm for arm in total.arms if (c, arm[0]) in self._arms) for c, total in enumerate(sums)]
        numbers: ModelNumbers = {p[1:]: x for p, x in self.leaves.items() if p[0] == "mechanism"}
        for i in {p[1] for p in self.leaves if p[0] == "target"}:
            law, time = model.mechanism.loads[i].target, self.nominal.time
            numbers["loads", i, "target"] = TracedTarget(law, time, *(get(("target", i, k), law(time)[k]) for k in range(2)))
        for _, i, name in [p for p in self.leaves if p[0] == "table"]:
            diagram = getattr(model.mechanism.loads[i], "cycle")  # noqa: B009  # of the pressure of a gas
            numbers["loads", i, "cycle", name] = TracedTable(getattr(diagram, name), self.leaves["table", i, name])
        mechanism = with_numbers(model.mechanism, numbers)
        masses = {}
        for k, (mass, centre, inertia) in zip(model.links, model.masses, strict=True):
            masses[k] = get(("mass", k), mass), get(("centre", k), centre), get(("inertia", k), inertia)
        bodies = {
            k: with_numbers(link, {p[2:]: x for p, x in self.leaves.items() if p[:2] == ("body", k)})
            for k, link in model.bodies.items()
        }
        return replace(
            model,
            mechanism=mechanism,
            joints=tuple(joints),
            turn=turn,
            loops=loops,
            loop_sums=tuple(total._replace(arms=arms) for total, arms in zip(sums, kept, strict=True)),
            constraints=tuple(self._constraint(r, c) for r, c in enumerate(model.constraints)),
            relations=tuple(self._relation(r, x) for r, x in enumerate(model.relations)),
            varied={p[1:]: x for p, x in self.leaves.items() if p[0] == "point"},
            varied_masses=masses,
            bodies=bodies,
        )

    def _constraint(self, r: int, own: LinearConstraint) -> LinearConstraint:
        def with_leaves(kind: str) -> Any:
            return tuple((i, self._get((kind, r, i), c)) for i, c in getattr(own, kind))

        curve = own.curve
        if curve is not None:
            curve = replace(curve, function=lambda _: self._curve_slopes(r), shift=self._get(("shift", r), curve.shift))
        return replace(own, curve=curve, **{kind: with_leaves(kind) for kind in ("groups", "drives", "slides")})

    def _curve_slopes(self, r: int) -> list[Any]:
        """The curve of a relation and its two derivatives on the tape, as functions of its shape and its argument."""
        values = self.nominal.state.curve_values[r]
        argument = argument_of(self._model, r, self._state_so_far)
        bent = []
        for k in range(3):
            z: Any = values[k]
            if isinstance(argument, Traced):
                cam = self.nominal.model.relations[r].geometry
                slope: Any = values[k + 1] if k < 2 else third_derivative(cam, argument.value)
                z = self.tape.elementwise(z, [(argument, slope, None)])
            leaf = self.leaves.get(("curve_value", r, k))
            bent.append(z if leaf is None else z - leaf.value + leaf)
        return bent

    def _relation(self, r: int, own: Relation) -> Relation:
        def contact(motion: Motion, multiplier: Values) -> tuple[Any, Any]:
            m: Any = value_of(multiplier)
            sign = np.where(np.real(m) >= 0.0, 1.0, -1.0)
            place, along = self._of_cam(r, ("contact", key_of_signs(sign)), motion, lambda x, motion: x.contact(motion, sign))
            return place, along

        def couple(motion: Motion, place: Any, force: Any) -> Any:
            under = value_of(place), value_of(force)

            def values(shape: Any, motion: Motion) -> list[Any]:
                of = getattr(shape, "bearing", shape)  # of a screw
                return [of.couple(motion, *(under if motion is self.nominal else (place, force)))]

            return self._of_cam(r, ("couple", *(np.asarray(x).tobytes() for x in under)), motion, values)[0]

        def sliding(motion: Motion, flank: Values) -> Any:
            sign = np.real(np.asarray(flank))
            return sliding_of(
                self._of_cam(r, ("sliding", key_of_signs(sign)), motion, lambda cam, motion: sliding_parts(cam, motion, flank))
            )

        bearing = own.bearing if own.bearing is None else replace(own.bearing, couple=couple)
        geometry = own.geometry
        if geometry is not None:  # friction takes contact and sliding from it
            geometry = copy(geometry)
            vars(geometry)["contact"] = contact
            if bearing is not None:
                vars(geometry)["sliding"] = sliding
        return replace(own, contact=contact, bearing=bearing, geometry=geometry)

    @cached_property
    def _drives(self) -> list[tuple[Any, Any, Any]]:
        plain = self.nominal.drives
        return [tuple(self._get(("drive", d, k), x) for k, x in enumerate(own)) for d, own in enumerate(plain)]

    @cached_property
    def _state(self) -> State:
        """Positions on the tape: those that the drives determine, then block by block those that follow by the loops' Jacobian."""
        model, nominal = self._model, self.nominal.state
        turning = model.angles
        self.turned: list[Any] = [0.0] * turning.groups  # angles of groups against the nominal ones
        if not self.leaves:
            return nominal
        drives = [d[0] for d in self._drives]
        self._state_so_far = state = State(
            drives=drives,
            delta=list(nominal.delta),
            rot=list(nominal.rot),
            slide={j: drives[d] for j, d in model.program.driven_slides},
            constants=[self._constant(r, c) for r, c in enumerate(nominal.constants)],
            angle=dict(nominal.angle),
        )
        for s, terms in model.program.driven_rotations:
            driven: Any = 0.0
            for d, sign in terms:
                if isinstance(drives[d], Traced):
                    driven = driven + sign * (drives[d] - drives[d].value)
            if isinstance(driven, Traced):
                state.delta[s] = nominal.delta[s] * np.exp(1j * driven)
                state.rot[s] = nominal.rot[s] * np.exp(1j * driven)
        for block, columns in zip(model.blocks, self.nominal.columns, strict=True):
            self._settle(block, columns, state)
        return state

    def _check_closure(self) -> None:
        """Raise for parameters beside whose values redundant constraints contradict each other."""
        for joint, left in self._redundant:
            for p, slope in zip(self.parameters, self.of(left)[0], strict=True):
                known = np.abs(slope[np.isfinite(slope)])  # none at singular positions
                if not len(known) or float(known.max()) * p.width > OPEN_LOOP * self.nominal.model.length_scale:
                    why = f"beside the stated value of {p.name} redundant constraints contradict each other at {joint}."
                    raise refusal(why, "Let all that has to fit follow from one parameter.")

    def _constant(self, r: int, plain: float) -> Any:
        return self._get(("constant", r), plain)

    def _settle(self, block: Block, columns: Any, state: State) -> None:
        """Put the unknowns of a block on the tape."""
        model, nominal = self._model, self.nominal.state
        for j in block.slides:
            state.slide[j] = nominal.slide[j]
        residuals: list[Any] = []
        for c in block.loops:
            left = value(model.loop_sums[c], state.rot, state.slide)
            residuals += [left.real, left.imag]
        for r in block.relations:
            known, unknown = relation_sum(model, r, state, block)
            for (what, i), coefficient in unknown.items():
                at = _group_angle(self.nominal, i) if what == "angle" else nominal.slide[i]
                known = known + coefficient * at
            residuals.append(known)
        if not any(isinstance(x, Traced) for x in residuals):
            return
        if not block.unknowns:
            self._redundant += [(self._closing(block), x) for x in residuals if isinstance(x, Traced)]
            return
        matrix, _ = matrix_of(columns)
        square = matrix.shape[-1] == matrix.shape[-2]
        with np.errstate(all="ignore"):
            inverse = regular_inverses(matrix) if square else np.linalg.pinv(np.nan_to_num(matrix))
        changes = self.tape.implicit(residuals, matrix, inverse)
        for g, change in zip(block.angles, changes, strict=False):
            self.turned[g] = change
            for s in model.angles.classes_of[g]:
                state.rot[s] = state.rot[s] * np.exp(1j * change)
            if g in state.angle:
                state.angle[g] = state.angle[g] + change
        for j, change in zip(block.slides, changes[len(block.angles) :], strict=True):
            state.slide[j] = nominal.slide[j] + change
        if not square:
            self._redundant += [(self._closing(block), 0.0 * x) for x in changes]  # NaN for surplus equations

    def _closing(self, block: Block) -> str:
        """A joint at which the loops of a block close, or a relation of it."""
        model = self.nominal.model
        return model.joints[model.loops[block.loops[0]].closing].name if block.loops else model.relations[block.relations[0]].name


class _TracedMotion(Motion):
    """A motion whose numbers may be on a tape."""

    def __init__(self, derivatives: Derivatives, model: Model, state: State):
        nominal = derivatives.nominal
        time: Any = derivatives.leaves.get(("time",), nominal.time)
        angles = _TracedAngles(derivatives)
        super().__init__(model, time, derivatives._drives, state, angles, accuracy=nominal.accuracy)
        self._frames = nominal.frames
        own: dict[str, Any] = {name: derivatives.leaves["state", name] for name in nominal.states}
        self.states = own

    @property
    def frames(self) -> int:
        return self._frames

    @lazy
    def drives(self) -> Any:
        return self._drives

    @lazy
    def shape(self) -> tuple[int, ...]:
        return (self._frames,)


class _TracedAngles(LinkAngles):
    """Angles of links that may be on a tape."""

    def __init__(self, derivatives: Derivatives):
        nominal = derivatives.nominal
        super().__init__(
            nominal.model, nominal.angles.start, lambda: nominal.angles.class_angles, lambda raw: raw, nominal.angles.exact
        )
        self._derivatives = derivatives

    def link(self, k: int) -> Any:
        own, turning = self._derivatives, self.model.angles
        s = turning.rotation_class[k]
        angle: Any = own.nominal.angles.link(k)
        state = own._state
        if own.leaves:
            angle = angle + own.turned[turning.class_group[s]]
        for d, sign in turning.class_drives[s]:
            if isinstance(state.drives[d], Traced):
                angle = angle + sign * (state.drives[d] - value_of(state.drives[d]))
        offset = own.leaves.get(("offset", k))
        return angle if offset is None else angle + (offset - offset.value)


def _group_angle(motion: Motion, group: int) -> Any:
    """A group's angle as it enters relations."""
    return motion.state.angle[group] if group in motion.state.angle else motion.group_angle(group)
