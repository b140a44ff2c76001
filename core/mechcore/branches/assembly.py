"""Assembly of the groups at the start. Assembly modes are stated in the mechanism or taken from its sketch, never guessed."""

from __future__ import annotations

import cmath
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any, TypeAlias, cast

import numpy as np

from mechcore.arrays import Real
from mechcore.branches.modes import (
    KEYS,
    TWO_MODES,
    WORDS,
    orientation,
    other_modes,
    sketched_angle,
    sketched_slide,
    stated_modes,
    stated_sign,
)
from mechcore.errors import Fault, MechanismError
from mechcore.kinematics.model import Model
from mechcore.kinematics.positions import closed_form, group_closure_error, loop_terms, place_block, put_unknowns
from mechcore.kinematics.program import Block
from mechcore.kinematics.state import State, initial_state, real_angle, relation_sum
from mechcore.records import dataclass
from mechcore.texts import Text, as_angle, as_length

Solutions: TypeAlias = Sequence[Any]  # unknowns of a block, as of `closed_form`, (2,) each, in `BOTH_MODES`

BOTH_MODES = np.array([1.0, -1.0])
_MOST_CHOICES = 2  # groups whose modes are listed in all combinations


@dataclass(frozen=True)
class Assembly:
    """A mechanism as assembled. ``modes``: +1 or -1 for each block (0 where there is no choice); ``starts``: unknowns of general
    blocks at the start."""

    modes: tuple[float, ...]
    starts: dict[str, Real]  # also angles of groups beyond one turn, "angle <group>"
    constants: tuple[float, ...]  # of the relations
    state: State  # positions at the start


def assemble(model: Model, drives: Sequence[float], *, others: bool = True) -> Assembly:
    """Assemble the mechanism at the drives' first positions. Raises `MechanismError` with all faults found.

    ``others``: where a group cannot be assembled, the remedy names another assembly mode in which it can.
    """
    faults: list[Fault] = []
    stated = stated_modes(model)
    constants = [0.0] * len(model.relations)
    state = initial_state(model, [np.float64(q) for q in drives], constants)
    modes: list[float] = []
    starts: dict[str, Real] = {}
    for block in model.blocks:
        mode = 0.0
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            if block.kind in TWO_MODES:
                terms = loop_terms(model, block, state)
                error = float(group_closure_error(block, terms))
                if error > 1e-14 * model.length_scale:
                    faults.append(_apart(model, block, error, _fitting_mode(model, drives) if others else ""))
                    break
                if block.kind != "theta_slide" and abs(complex(terms[0])) <= 1e-14 * model.length_scale:
                    faults.append(_unspanned(block))
                    break
                solutions: Solutions = closed_form(block, terms, BOTH_MODES)
                mode, fault = _mode(model, block, state, stated.get(block.name, ()), solutions)
                faults += fault
                put_unknowns(model, block, state, [x[0 if mode > 0.0 else 1] for x in solutions])
            elif block.relations and block.kind != "general":
                faults += _fix_relation(model, block, state, constants)
                place_block(model, block, state, 0.0)
            elif block.kind == "general":
                x, fault = _start_of_general(model, block, state)
                faults += fault
                if x is None:
                    break
                starts[block.name] = x
                place_block(model, block, state, 0.0, x)
            else:
                place_block(model, block, state, 0.0)
                if not np.isfinite([complex(state.slide[j]) for j in block.slides]).all():
                    remedy = "Turn one of them, or add a drive that says where."
                    faults.append(
                        Fault(f"joints.{block.name}", "its guides are parallel: where it slides to is left open.", remedy)
                    )
                    break
        modes.append(mode)
    faults += _idle_modes(model, stated)
    if faults:
        raise MechanismError(faults)
    starts |= {f"angle {g}": np.asarray(real_angle(model, state, g)) for g in model.multi_turn}
    return Assembly(modes=tuple(modes), starts=starts, constants=tuple(constants), state=state)


def starts_of(model: Model, state: State, shape: tuple[int, ...] = ()) -> dict[str, Real]:
    """Newton starts for continuing solved positions (*shape): unknowns of general blocks, and angles of groups beyond one turn."""
    starts = {name: np.asarray(newton.x) for name, newton in state.newton.items()}
    return starts | {f"angle {g}": np.broadcast_to(real_angle(model, state, g), shape) for g in model.multi_turn}


def _idle_modes(model: Model, stated: Mapping[str, Sequence[str]]) -> list[Fault]:
    """Faults of stated assembly modes without effect: at joints that no group with two modes places."""
    used = {joint for joints in stated.values() for joint in joints}
    near = ", ".join(sorted(block.name for block in model.blocks if block.kind in TWO_MODES))
    choice = f" Joints at which a group can be put together in two ways: {near}." if near else ""
    larger = {block.name for block in model.blocks if block.kind == "general"}
    faults = []
    for joint, word in model.mechanism.modes.items():
        if joint in used:
            continue
        why, remedy = "this joint decides nothing.", "Leave it out: there is one way only."
        if joint in larger:
            why, remedy = "this group may have more than two.", "Give a [sketch] instead: the nearest one is taken."
        drives, over = len(model.mechanism.drives), _overdriven(model, joint)
        if drives > 1 and over:
            why = f"the {drives} drives leave no choice."
            remedy = f"Take {min(over, drives - 1)} of the {drives} drives away: the mechanism has fewer degrees of freedom."
        elif over:
            why = "the constraints leave no choice."
            remedy = f"Leave it out. The group has {over} more constraint{'s' * (over > 1)} than it needs: is a joint too many?"
        why = f"an assembly mode ('{word}') is stated here, but {why}"
        faults.append(Fault(f"joints.{joint}.{KEYS[word]}", why, remedy + choice))
    return faults


def _overdriven(model: Model, joint: str) -> int:
    """Number of redundant equations in the blocks whose loops contain a link of the joint, given the drives."""
    j = model.joint_index.get(joint)
    classes = set() if j is None else {model.angles.rotation_class[k] for k in model.ends[j] if k}
    turned = {block: {s for c in block.loops for s, _ in model.loop_sums[c].arms} for block in model.blocks if block.redundant}
    return sum(block.redundant for block, own in turned.items() if classes & own or block.name == joint)


def _fitting_mode(model: Model, drives: Sequence[float]) -> str:
    """Another assembly mode in which the mechanism can be assembled at the start, as the end of a remedy; "" if there is none."""
    for other, remedy in other_modes(model.mechanism):
        try:
            assemble(replace(model, mechanism=other), drives, others=False)
        except MechanismError:
            continue
        return f"{remedy}, in which it fits"
    return ""


def fitting_statements(model: Model, drives: Sequence[float]) -> str:
    """Assembly modes possible at the start, to be stated instead of a sketch, as the end of a remedy; "" if there are none."""
    choices = [block for block in model.blocks if block.kind in TWO_MODES]
    if len(choices) > _MOST_CHOICES or any(block.kind == "general" for block in model.blocks):
        return ""
    statements = []
    for words in product(*(WORDS[block.kind] for block in choices)):
        modes = dict(zip((block.name for block in choices), words, strict=True))
        try:
            assemble(replace(model, mechanism=replace(model.mechanism, sketch={}, modes=modes)), drives, others=False)
        except MechanismError:
            continue
        statements.append(" and ".join(f'{KEYS[word]} = "{word}" at {joint}' for joint, word in modes.items()))
    return f", or state the assembly mode of the start instead: {' or '.join(statements)} fits there" if statements else ""


def _apart(model: Model, block: Block, error: float, other: str) -> Fault:
    return Fault(
        f"joints.{block.name}",
        f"cannot be assembled at the start: the links miss each other by {as_length(error)}.",
        f"Change a length or the start of the drive{other}.",
    )


def _unspanned(block: Block) -> Fault:
    return Fault(
        f"joints.{block.name}",
        "the outer pins of its group are at the same point at the start: the group can turn about it freely.",
        "Move a pin or start the drives a little before or after; if it is so in every position, drive one of its pins instead.",
    )


def _mode(model: Model, block: Block, state: State, joints: Sequence[str], solutions: Solutions) -> tuple[float, list[Fault]]:
    """The sign of a block with two assembly modes, stated at ``joints`` or else sketched; with faults if neither decides."""
    if joints:
        return stated_sign(model, block, state, joints)
    sketched = _sketched_mode(model, block, state, solutions)
    if sketched is not None:
        return sketched, []
    if all(abs(plus - minus) < 1e-12 for plus, minus in solutions):
        return 1.0, []
    words = WORDS[block.kind]
    key = KEYS[words[0]]
    sign = orientation(model, block, block.name)
    where = dict(zip(words, _mode_words(model, block, state, (sign, -sign)), strict=True))
    options = ", or ".join(f'{key} = "{w}" (there {where[w]})' for w in words)
    return 1.0, [
        Fault(
            f"joints.{block.name}",
            "the assembly mode is not stated, and the group can be put together in two ways.",
            f"Add {options}; or give a [sketch] of the start position.",
        )
    ]


def _mode_words(model: Model, block: Block, state: State, modes: Sequence[float]) -> list[str]:
    """Texts that distinguish a block's modes: the position of its joint, else the displacements and angles that differ."""
    places = [f"{block.name} is at {_place_of(model, block, state, mode)}" for mode in modes]
    if len(set(places)) == len(places):
        return places
    rows = []
    solutions: Solutions = closed_form(block, loop_terms(model, block, state), np.array(modes))
    angular, along = solutions[: len(block.angles)], solutions[len(block.angles) :]
    for k in range(len(modes)):
        slides = [
            f"{model.joints[j].name} is displaced by {as_length(float(s[k].real), 4)}"
            for j, s in zip(block.slides, along, strict=True)
        ]
        angles = [_angle_words(model, g, float(np.angle(e[k]))) for g, e in zip(block.angles, angular, strict=True)]
        rows.append([*slides, *angles])
    telling = [k for k, words in enumerate(zip(*rows, strict=True)) if len(set(words)) > 1]
    return [", ".join(row[k] for k in telling) or place for row, place in zip(rows, places, strict=True)]


def _place_of(model: Model, block: Block, state: State, mode: float) -> str:
    """The position of the block's joint in one mode, as text for a message."""
    trial = state.copy()
    with np.errstate(invalid="ignore", divide="ignore"):
        place_block(model, block, trial, mode)
    j = model.joint_index[block.name]
    joint = model.joints[j]
    side = 1 if joint.slide is not None and joint.guide == 0 else 0
    k = model.ends[j][side]
    start = trial.rot[model.angles.rotation_class[k]]
    if start is None:
        return "a place that other groups decide"
    z = (joint.b if side else joint.a) * model.turn[k] * start
    while k:
        i, p = model.tree.joint[k], model.tree.parent[k]
        tree_side = 1 if model.ends[i][1] == k else 0
        for link, s, sign in ((k, tree_side, -1), (p, 1 - tree_side, 1)):
            tj = model.joints[i]
            vector = tj.b if s else tj.a
            if tj.slide is not None and tj.guide == s:
                vector = vector + float(trial.slide.get(i, 0.0)) * tj.slide
            rot = trial.rot[model.angles.rotation_class[link]]
            if rot is None:
                return "a place that other groups decide"
            z = z + sign * vector * model.turn[link] * rot
        k = p
    noise = 1e-12 * model.length_scale
    x, y = (0.0 if abs(part) < noise else part for part in (complex(z).real, complex(z).imag))
    return f"x = {as_length(x, 4)}, y = {as_length(y, 4)}"


def _fix_relation(model: Model, block: Block, state: State, constants: list[float]) -> list[Fault]:
    """Set the constant of a block's relation; if none is given, from the start: its unknown as sketched, else zero."""
    r = block.relations[0]
    given = model.constraints[r].constant
    if given is not None:
        constants[r] = given
        return []
    known, unknown = relation_sum(model, r, state, block)
    total = float(known)
    faults: list[Fault] = []
    for (what, i), c in unknown.items():
        start = sketched_angle(model, i, state) if what == "angle" else sketched_slide(model, i)
        if start is None and what == "angle":
            link = _placed_by_angle(model, i)
            faults += [_unsketched(model.constraints[r].name, link)] if link else []
        total += c * (start or 0.0)
    constants[r] = total
    return faults


def _placed_by_angle(model: Model, group: int) -> str:
    """The first link of a group with a guide or with joints at different points: its angle at the start matters; "" without one."""
    for k in model.angles.links_of[group]:
        sides = [(model.joints[j], side) for j, ends in enumerate(model.ends) for side in (0, 1) if ends[side] == k]
        guides = any(joint.slide is not None and joint.guide == side for joint, side in sides)
        if guides or len({joint.b if side else joint.a for joint, side in sides}) > 1:
            return model.links[k]
    return ""


def _unsketched(joint: str, link: str) -> Fault:
    remedy = f"Sketch it: [sketch] {link} = {{ at = [x, y], angle = ... }}."
    return Fault(f"joints.{joint}", f"nothing says how '{link}' stands at the start.", remedy)


def _sketched_mode(model: Model, block: Block, state: State, solutions: Solutions) -> float | None:
    """The mode that is nearest to the sketch; None if the sketch does not decide."""
    errors: Any = None
    for (what, i), values in zip(block.unknowns, solutions, strict=True):
        if what == "angle":
            angle = sketched_angle(model, i, state)
            error = None if angle is None else abs(values - cmath.exp(1j * angle))
        else:
            slide = sketched_slide(model, i)
            error = None if slide is None else abs(values - slide) / model.length_scale
        if error is not None:
            errors = error if errors is None else errors + error
    if errors is None or abs(errors[0] - errors[1]) < 1e-9:
        return None
    return 1.0 if errors[0] < errors[1] else -1.0


def _start_of_general(model: Model, block: Block, state: State) -> tuple[Real | None, list[Fault]]:
    """Unknowns of a general block at the start, in the assembly mode nearest to the sketch; None with faults if undecided."""
    angles = [sketched_angle(model, g, state) for g in block.angles]
    slides = [sketched_slide(model, j) for j in block.slides]
    if block.relations:
        faults = _fix_relations_of_group(model, block, state, angles, slides)
        if faults:
            return None, faults
    modes = group_modes(model, block, state, near=[*angles, *slides])
    if len(modes) == 0:
        return None, [
            Fault(
                f"joints.{block.name}",
                "cannot be assembled at the start: no position of its group closes the loops.",
                "Change a length or the start of the drive.",
            )
        ]
    if all(a is None for a in angles) and all(s is None for s in slides):
        if len(modes) == 1:
            return modes[0], []
        listed = "; ".join(_describe(model, block, x) for x in modes[:8])
        return None, [
            Fault(
                f"joints.{block.name}",
                f"the assembly mode is not stated; this group has {len(modes)} at the start.",
                f"Add a [sketch] with rough angles of its links, near one of: {listed}.",
            )
        ]
    guess = np.array([np.nan if a is None else a for a in angles] + [np.nan if s is None else s for s in slides])
    n = len(block.angles)
    error = np.abs(np.exp(1j * modes[:, :n]) - np.exp(1j * guess[:n]))
    error = np.nansum(error, axis=-1) + np.nansum(np.abs(modes[:, n:] - guess[n:]), axis=-1) / model.length_scale
    best = np.argsort(error)
    if len(best) > 1 and error[best[1]] - error[best[0]] < 1e-6:
        return None, [
            Fault(f"joints.{block.name}", "the sketch fits two assembly modes equally.", "Sketch more links of this group.")
        ]
    return modes[best[0]], []


def _fix_relations_of_group(
    model: Model, block: Block, state: State, angles: Sequence[float | None], slides: Sequence[float | None]
) -> list[Fault]:
    """Set the constants of the relations inside a general block from the sketch, whose angles then fix their phase exactly."""
    start = dict(zip([("angle", g) for g in block.angles] + [("slide", j) for j in block.slides], [*angles, *slides], strict=True))
    faults: dict[str, Fault] = {}
    constants = cast(list[float], state.constants)  # a list during assembly
    for r in block.relations:
        given = model.constraints[r].constant
        if given is not None:
            constants[r] = given
            continue
        known, unknown = relation_sum(model, r, state, block)
        name = model.constraints[r].name
        for what, i in unknown:
            if start[what, i] is not None:
                continue
            if what == "slide":
                why = f"nothing says where '{model.joints[i].name}' stands at the start."
                remedy = "Give a [sketch] with both of its links: it sets the phase of the gears."
                faults.setdefault(model.joints[i].name, Fault(f"joints.{name}", why, remedy))
            elif link := _placed_by_angle(model, i):
                faults.setdefault(link, _unsketched(name, link))
        constants[r] = float(known) + sum(c * float(start[u] or 0.0) for u, c in unknown.items())
    return list(faults.values())


def _describe(model: Model, block: Block, x: Real) -> str:
    words = []
    for i, g in enumerate(block.angles):
        words.append(_angle_words(model, g, float(x[i])))
    return ", ".join(words)


def _angle_words(model: Model, group: int, angle: float) -> str:
    """The first link of a group of parallel links and its angle; ``angle`` is the group's [rad]."""
    k = model.angles.links_of[group][0]
    turned = (angle + model.angles.offset[k] + np.pi) % (2.0 * np.pi) - np.pi
    return f"{model.links[k]} {as_angle(turned, 4)}"


def group_modes(model: Model, block: Block, state: State, *, starts: int = 400, near: Sequence[float | None] = ()) -> Real:
    """All assembly modes of a general block (modes, unknowns) that Newton's method finds from many random starts.

    ``near`` replaces one of them. Angles lie within half a turn of zero; in a block with relations, for which whole turns matter,
    they are as found.
    """
    rng = np.random.default_rng(12345)  # reproducible
    n, k = len(block.angles), len(block.slides)
    x = np.concatenate([rng.uniform(-np.pi, np.pi, (starts, n)), rng.uniform(-2.0, 2.0, (starts, k)) * model.length_scale], axis=-1)
    if near:
        x[0] = [0.0 if v is None else v for v in near]
    trial = state.copy()
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        place_block(model, block, trial, 0.0, x)
    solutions = trial.newton[block.name].x
    solutions = solutions[np.isfinite(solutions).all(axis=-1)]
    if not block.relations:
        solutions[:, :n] = (solutions[:, :n] + np.pi) % (2.0 * np.pi) - np.pi
    unique: list[tuple[Real, Real]] = []
    for row in solutions:
        key = np.concatenate([np.exp(1j * row[:n]), row[n:] / model.length_scale])
        if all(np.abs(key - other).max() > 1e-6 for other, _ in unique):
            unique.append((key, row))
    rows = sorted((row for _, row in unique), key=lambda r: [round(float(v), 9) for v in r])
    return np.array(rows) if rows else np.empty((0, n + k))


def all_modes(model: Model, assembly: Assembly, drives: Sequence[float]) -> list[tuple[str, list[tuple[Text, bool]]]]:
    """The assembly modes of every group at the start as texts, with earlier groups as assembled: (joint, [(text, assembled?)])."""
    state = initial_state(model, [np.float64(q) for q in drives], assembly.constants)
    out = []
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for block, mode in zip(model.blocks, assembly.modes, strict=True):
            described: list[tuple[Text, bool]] = []
            if block.kind in TWO_MODES:
                sign = orientation(model, block, block.name)
                signs = (sign, -sign)
                for word, s, text in zip(WORDS[block.kind], signs, _mode_words(model, block, state, signs), strict=True):
                    described.append((Text(f"{word}: {text}"), s == mode))
            elif block.kind == "general":
                start = assembly.starts[block.name]
                for x in group_modes(model, block, state):
                    n = len(block.angles)
                    same = np.abs(np.exp(1j * x[:n]) - np.exp(1j * start[:n])).max(initial=0.0) < 1e-6
                    described.append((Text(_describe(model, block, x)), bool(same)))
            place_block(model, block, state, mode, assembly.starts.get(block.name))
            if described:
                out.append((block.name, described))
    return out
