"""The loop equations of a mechanism in readable form, as the contour-graph method writes them (planar case).

Round a loop 0-1-...-n-0, with the joint A_i joining body i-1 to body i, r_i its place, w_ij = w_i - w_j:

    sum w_(i,i-1) = 0                                         sum e_(i,i-1) = 0
    sum ( y_i w_(i,i-1), -x_i w_(i,i-1)) + sum v_i = 0        the same with e and relative accelerations
                                                              + sum a^c_i - sum w_i^2 (r_(i+1) - r_i) = 0

Gears, racks, belts, rolling and cams have an equation each besides: the bodies move alike along the line of contact.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from mechcore.joints.base import Relation
from mechcore.kinematics.model import Model
from mechcore.motion.motion import Motion


def loop_equations(motion: Motion, frame: int = 0) -> list[str]:
    """Lines of text: the legend, then for every loop its velocity and acceleration equations, with numbers at a frame, and the
    equation of every gear, rack, belt, rolling or cam joint."""
    model = motion.model
    turning = [s != model.angles.rotation_class[0] for s in model.angles.rotation_class]
    lines = ["bodies  " + ", ".join(f"{i} {name}" for i, name in enumerate(model.links))]
    lines.append(
        "w_ij = w_i - w_j [rad/s], e_ij alike [rad/s2]; v_A, a_A: sliding velocity and acceleration along the guide of joint A;"
    )
    lines.append("places of the joints in metres, at the start; positive angles counter-clockwise")

    for number, loop in enumerate(model.loops, 1):
        steps = _around(model, loop.closing)
        bodies = [0 if not steps else steps[0][1], *(q for _, _, q in steps)]
        names = [model.joints[j].name for j, _, _ in steps]
        lines += ["", f"loop {number}: {'-'.join(map(str, bodies))} through {', '.join(names)}"]
        term, along = partial(_term, least=1e-12 * model.length_scale), partial(_term, least=1e-12)  # of lengths and of directions
        omegas: list[str] = []
        first: list[str] = []
        second: list[str] = []
        spin2: list[str] = []
        x2: list[str] = []
        y2: list[str] = []
        for j, p, q in steps:
            joint = model.joints[j]
            z = complex(np.broadcast_to(motion.joint_point(j), motion.frames)[frame])
            if joint.turns:
                w = f"w_{q},{p}"
                omegas.append(w)
                first.append(term(z.imag, w))
                second.append(term(-z.real, w))
                spin2.append(f"e_{q},{p}")
                x2.append(term(z.imag, f"e_{q},{p}"))
                y2.append(term(-z.real, f"e_{q},{p}"))
            if joint.slide is not None:
                d = complex(np.broadcast_to(motion.guide(j), motion.frames)[frame])
                # relative velocity of body q's point at the joint against body p's, in the direction in which the coordinate grows
                d = d if model.ends[j][joint.guide] == p else -d
                carrier = model.ends[j][joint.guide]
                first.append(along(d.real, f"v_{joint.name}"))
                second.append(along(d.imag, f"v_{joint.name}"))
                coriolis = 2.0 if turning[carrier] else 0.0
                x2.append(along(d.real, f"a_{joint.name}") + along(-coriolis * d.imag, f"w_{carrier} v_{joint.name}"))
                y2.append(along(d.imag, f"a_{joint.name}") + along(coriolis * d.real, f"w_{carrier} v_{joint.name}"))
        for (j, _, q), (nxt, _, _) in zip(steps, [*steps[1:], steps[0]], strict=True):
            if not turning[q]:
                continue
            way = complex(np.broadcast_to(motion.joint_point(nxt) - motion.joint_point(j), motion.frames)[frame])
            x2.append(term(-way.real, f"w_{q}^2"))
            y2.append(term(-way.imag, f"w_{q}^2"))
        lines.append("  velocities")
        lines += [f"    {' + '.join(omegas) or '0'} = 0", f"    {''.join(first) or '0 '}= 0", f"    {''.join(second) or '0 '}= 0"]
        lines.append("  accelerations")
        lines += [f"    {' + '.join(spin2) or '0'} = 0", f"    {''.join(x2) or '0 '}= 0", f"    {''.join(y2) or '0 '}= 0"]
    for number, relation in enumerate(model.relations):
        p, q = (model.index[k] for k in relation.links)
        lines += ["", f"{relation.kind} {relation.name}: bodies {p} and {q}"]
        velocities, accelerations = _tied(motion, relation, number, frame)
        lines += ["  velocities", f"    {velocities or '0 '}= 0", "  accelerations", f"    {accelerations or '0 '}= 0"]
    return lines


def _term(coefficient: float, symbols: str, least: float) -> str:
    return f"{coefficient:+.6g} {symbols} " if abs(coefficient) > least else ""


def _tied(motion: Motion, relation: Relation, number: int, frame: int) -> tuple[str, str]:
    """The rates of a relation between coordinates: what its terms sum up to."""
    index = motion.model.index

    def rates(angles: Sequence[tuple[str, float]], slides: Sequence[tuple[str, float]]) -> dict[str, float]:
        found: dict[str, float] = {}
        for name, c in [*((f"w_{index[k]}", c) for k, c in angles if index[k]), *((f"v_{j}", c) for j, c in slides)]:
            found[name] = found.get(name, 0.0) + c
        return found

    total, squares = rates(relation.angles, relation.slides), ""
    if relation.curve is not None:
        _, slope, bend = (float(np.broadcast_to(b, motion.frames)[frame]) for b in motion.state.bends[number])
        inner = list(rates(relation.curve.angles, relation.curve.slides).items())
        for i, (name, c) in enumerate(inner):
            total[name] = total.get(name, 0.0) + slope * c
            squares += _term(bend * c * c, f"{name}^2", 0.0)
            squares += "".join(_term(2.0 * bend * c * d, f"{name} {other}", 0.0) for other, d in inner[i + 1 :])
    least = 1e-12 * max((abs(c) for c in total.values()), default=0.0)
    rate = {"w": "e", "v": "a"}
    first = "".join(_term(c, name, least) for name, c in total.items())
    return first, "".join(_term(c, rate[name[0]] + name[1:], least) for name, c in total.items()) + squares


def loop_residuals(motion: Motion, frame: int = 0) -> list[complex]:
    """The velocity equation of every loop with the solved velocities put in, for a check of what is printed."""
    model = motion.model
    out = []
    for loop in model.loops:
        total = 0j
        for j, p, q in _around(model, loop.closing):
            z = complex(np.broadcast_to(motion.joint_point(j), motion.frames)[frame])
            omega = [np.broadcast_to(motion.speeds.angular[model.angles.rotation_class[k]], motion.frames)[frame] for k in (p, q)]
            total += -1j * z * (omega[1] - omega[0])
            joint = model.joints[j]
            if joint.slide is not None:
                d = complex(np.broadcast_to(motion.guide(j), motion.frames)[frame])
                d = d if model.ends[j][joint.guide] == p else -d
                total += d * np.broadcast_to(motion.speeds.slide[j], motion.frames)[frame]
        out.append(total)
    return out


def _around(model: Model, closing: int) -> list[tuple[int, int, int]]:
    """The way round a loop: (joint, from body, to body), starting at the body nearest to the frame."""
    p, q = model.ends[closing]
    tree = model.tree
    up, line = [], [p]
    while line[-1] != 0:
        line.append(tree.parent[line[-1]])
    down = []
    k = q
    while k not in line:
        down.append((tree.joint[k], k, tree.parent[k]))
        k = tree.parent[k]
    for link in line[: line.index(k)]:
        up.append((tree.joint[link], tree.parent[link], link))
    return [*reversed(up), (closing, p, q), *down]
