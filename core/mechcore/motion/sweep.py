"""Many designs of one mechanism computed together, by the same code with a design axis before the frame axis."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Complex, Flags, Real, numbers
from mechcore.branches.unwrapped import SolvedFrames, along_designs
from mechcore.errors import Fault, MechanismError
from mechcore.kinematics.build import loop_sum
from mechcore.kinematics.model import Model
from mechcore.kinematics.positions import place_all
from mechcore.laws.timed import ConstantSpeed
from mechcore.motion.compiled import Compiled
from mechcore.motion.design_program import DesignProgram, DrivenDesigns, design_program
from mechcore.motion.motion import Motion
from mechcore.records import NumberPlace, dataclass, with_numbers
from mechcore.spec.mechanism import joints_with_friction
from mechcore.topology.graph import vector_loops

CHUNK_OF_C = 2**21  # numbers that a program computes in one call
# Numbers in an array of numpy: few enough to stay in the cache, and enough to make up for the cost of calls
NUMBERS_AT_ONCE = 16384


@dataclass(frozen=True, eq=False)
class Sweep:
    """Results of a sweep. ``results``: the collected values, each (D, F, ...). ``assembled`` (D,): designs that can be assembled in
    every frame. ``program``: the program that computed them in C, or the reason why numpy was used."""

    results: dict[str, Real]
    assembled: Flags
    program: DesignProgram | str


def sweep(
    compiled: Compiled,
    points: Mapping[tuple[str, str], ArrayLike],
    time: ArrayLike,
    collect: Callable[[Motion], Mapping[str, Real]],
    masses: Mapping[str, tuple[ArrayLike, ArrayLike, ArrayLike]] | None = None,
    loads: Mapping[NumberPlace, ArrayLike] | None = None,
    total: int = 0,
    speed_factor: ArrayLike | None = None,
    drives: Mapping[str, tuple[ArrayLike, ArrayLike]] | None = None,
) -> Sweep:
    """Results of the motions of D variants of a mechanism at times (F,) [s].

    ``points``: (link, point) -> positions (D, 2) [m] in the link's frame, of points at which the link is joined. All else is as
    compiled, the assembly modes too. ``masses``: link -> mass (D,) [kg], centre of mass (D, 2) [m] and moment of inertia about it
    (D,) [kg m^2], of links whose masses vary as well. ``loads``: numbers (D,) that replace those of the mechanism's loads, by their
    places in them (`numbers_in`). ``speed_factor`` (D,): factor on the speed at which all drives run through their laws. The
    designs are compared at the times of the compiled one divided by their speed factor; no force may depend on time. ``drives``:
    joint -> start position and constant speed (D,) [rad, rad/s or m, m/s], independent of ``speed_factor``, that replace a law of
    constant speed. ``collect``: motion -> the values of interest by name, arrays (designs, F, ...).

    The executor of ``compiled`` computes the designs. ``total``: number of all designs of which these are a part, from which it
    judges whether compiling pays. With C, ``collect`` gets a motion of symbols and may use only what these support (see
    `design_program`); otherwise numpy computes the designs.

    Designs that cannot be assembled are NaN in the frames concerned and marked; they raise no error. With dry friction only C
    computes several designs together; where it finds no friction forces, as in jams, they are NaN. Raises `MechanismError` for
    groups without a closed form, for relations between coordinates (gears, cams) and for change points: there the branch depends on
    the path of each design.
    """
    model = compiled.model
    if compiled.assembly.starts or model.relations or (compiled.singular_points is not None and compiled.singular_points.points):
        raise MechanismError(
            Fault(
                "sweep",
                "this mechanism has groups that must be followed along their course, design by design.",
                "Loop over designs.",
            )
        )
    time = numbers(time)
    varied = {key: np.asarray(xy, float) for key, xy in points.items()}
    for link, point in varied:
        if link not in model.index or point not in model.bodies[link].points:
            raise MechanismError(
                Fault("sweep", f"there is no point '{point}' on a link '{link}'.", "Name a link and one of its points.")
            )
    designs = {len(xy) for xy in varied.values()}
    if len(designs) != 1:
        raise MechanismError(
            Fault("sweep", "the points are given for different numbers of designs, or for none.", "Give as many of each.")
        )
    count = designs.pop()
    speed_factors = None if speed_factor is None else np.asarray(speed_factor, float)
    own = {_constant(model, joint): (np.asarray(q, float), np.asarray(v, float)) for joint, (q, v) in (drives or {}).items()}
    keys = tuple(varied), tuple(masses or ()), tuple(loads or ()), tuple(own), speed_factors is not None
    program = design_program(compiled, varied_model, keys, time, collect, max(total, count))
    rubs = "friction" in model.mechanism.effects and bool(joints_with_friction(model.mechanism.joints))
    if rubs and isinstance(program, str):
        why = f"numpy solves dry friction of one design at a time, and C none of these ({program})."
        raise MechanismError(Fault("sweep", why, "Loop over designs."))
    chunk = max(1, (NUMBERS_AT_ONCE if isinstance(program, str) else CHUNK_OF_C // program.rows) // len(time))
    parts: list[Mapping[str, Real]] = []
    assembled = np.empty(count, bool)
    for start in range(0, count, chunk):
        part = {key: xy[start : start + chunk, :] for key, xy in varied.items()}
        weights = {link: _rows_of_masses(own, start, chunk) for link, own in (masses or {}).items()}
        stated = {key: np.asarray(x, float)[start : start + chunk, None] for key, x in (loads or {}).items()}
        rows = slice(start, start + chunk)
        driven = DrivenDesigns(
            model.mechanism,
            None if speed_factors is None else speed_factors[rows, None],
            {d: (q[rows, None], v[rows, None]) for d, (q, v) in own.items()},
        )
        if not isinstance(program, str):
            computed, assembled[start : start + chunk], far = program(part, weights, stated, time, driven)
            parts.append(computed)
            if not far.any():
                continue
            if rubs:
                for x in computed.values():
                    x[far] = np.nan
                continue
            part = {key: xy[far] for key, xy in part.items()}
            weights = {link: (mass[far], centre[far], inertia[far]) for link, (mass, centre, inertia) in weights.items()}
            again = collect(_motion(compiled, part, weights, {key: x[far] for key, x in stated.items()}, time, driven.some(far)))
            for name, x in again.items():
                computed[name][far] = x
            continue
        motion = _motion(compiled, part, weights, stated, time, driven)
        parts.append(collect(motion))
        ok = np.ones(motion.shape, bool)
        for rot in motion.state.rot:
            ok &= np.isfinite(rot)
        for slide in motion.state.slide.values():
            ok &= np.isfinite(slide)
        assembled[start : start + chunk] = ok.all(axis=-1)
    results = {name: parts[0][name] if len(parts) == 1 else np.concatenate([p[name] for p in parts]) for name in parts[0]}
    return Sweep(results, assembled, program)


def _constant(model: Model, joint: str) -> int:
    """The number of the drive of constant speed on a joint. Raises `MechanismError` if the joint has none."""
    for d, drive in enumerate(model.mechanism.drives):
        if drive.joint == joint and isinstance(drive.law, ConstantSpeed):
            return d
    raise MechanismError(Fault("sweep", f"'{joint}' has no drive of constant speed.", "Loop over designs."))


def _rows_of_masses(stated: tuple[ArrayLike, ArrayLike, ArrayLike], start: int, chunk: int) -> tuple[Real, Complex, Real]:
    """Mass, centre (complex) and moment of inertia of some designs, (designs, 1) each."""
    mass, centre, inertia = (np.asarray(values, float)[start : start + chunk] for values in stated)
    return mass[:, None], (centre[:, 0] + 1j * centre[:, 1])[:, None], inertia[:, None]


def varied_model(
    compiled: Compiled, points: Mapping[tuple[str, str], Any], masses: Mapping[str, Any], loads: Mapping[NumberPlace, Any]
) -> Model:
    """The model with other positions of points (complex), masses of links and numbers of loads: arrays (designs, 1) or symbols."""
    model = compiled.model
    ends = {p.name: getattr(p, "points", None) for p in model.mechanism.joints}
    joints = []
    for joint in model.joints:
        names = ends.get(joint.name)
        if names is not None:
            a, b = (points.get((link, name)) for link, name in zip(joint.links, names, strict=True))
            joint = replace(joint, a=joint.a if a is None else a, b=joint.b if b is None else b)
        joints.append(joint)
    closed = vector_loops(model.ends, joints, model.tree)
    return replace(
        model,
        mechanism=replace(model.mechanism, loads=with_numbers(model.mechanism.loads, loads)),
        joints=tuple(joints),
        loops=closed,
        loop_sums=tuple(loop_sum(c, model.angles, model.turn) for c in closed),
        varied=points,
        varied_masses=masses,
    )


def _motion(
    compiled: Compiled,
    points: Mapping[tuple[str, str], Real],
    masses: Mapping[str, tuple[Real, Complex, Real]],
    loads: Mapping[NumberPlace, Real],
    time: Real,
    driven: DrivenDesigns,
) -> Motion:
    variant = varied_model(compiled, {key: (xy[:, 0] + 1j * xy[:, 1])[:, None] for key, xy in points.items()}, masses, loads)
    modes, values = compiled.assembly.modes, driven.values(time)
    state = place_all(variant, [v[0] for v in values], modes)

    def placed(x: Real) -> SolvedFrames:
        q = [v[0] for v in driven.values(x[:, 0])]
        return q, place_all(variant, q, modes), (*variant.designs, len(x))

    angles = along_designs(variant, time, ([v[0] for v in values], state, (*variant.designs, len(time))), driven.laws, placed)
    return Motion(variant, time, values, state, angles, accuracy=compiled.accuracy)
