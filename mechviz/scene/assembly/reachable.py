"""Drives that run to the limits of the mechanism and back: ``range = "reachable"``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.errors import Fault, MechanismError
from mechcore.kinematics.build import build_model
from mechcore.laws.timed import ConstantSpeed, Free, Law, Oscillation, Rest, moves
from mechcore.motion.compiled import Compiled
from mechcore.motion.reach import range_beside, reachable_ranges
from mechcore.motion.solve import compile_mechanism
from mechcore.spec.mechanism import Drive, Mechanism
from mechviz.scene.document import SceneDocument
from mechviz.scene.units import magnitude

if TYPE_CHECKING:
    from mechviz.scene.scene import Scene


REACHABLE = "reachable"
MARGIN = 0.01
"""Part of the reach that is left before each limit: a dead point, where efforts grow beyond all bounds."""
STEPS = 36
"""Places of a drive that are tried where it cannot start."""
TURN = 2.0 * math.pi


def swinging(document: SceneDocument) -> Mapping[tuple[str | int, ...], Any]:
    """The changes that let the drive of a document swing within its reach: none where no drive could."""
    led = [name for name, joint in document.joints.items() if joint.led]
    drive = document.joints[led[0]].drive if len(led) == 1 else None
    if drive is None or drive.laws != ["speed"] or drive.signals or not magnitude(drive.speed or 0.0):
        return {}
    return {("joints", led[0], "drive", "range"): REACHABLE} if drive.travel is None and drive.range is None else {}


def swings(scene: Scene) -> tuple[str, ...]:
    """The drives of a scene that run to their limits and back; not those that may, but can turn fully."""
    asked = {name for name, joint in scene.document.joints.items() if joint.drive is not None and joint.drive.range == REACHABLE}
    return tuple(d.joint for d in scene.mechanism.drives if d.joint in asked and isinstance(d.law, Oscillation))


def with_swings(mechanism: Mechanism, joints: list[str]) -> tuple[Mechanism, list[Fault]]:
    """The mechanism in which the drives of these joints, at constant speeds so far, run to their limits and back."""
    faults: list[Fault] = []
    for joint in joints:
        path = f"joints.{joint}.drive.range"
        others = [d.law for d in mechanism.drives if d.joint != joint and moves(d.law)]
        cycles = {math.inf if isinstance(law, Free) else law.duration for law in others}
        if len(joints) > 1:
            why = "two drives that run as far as they can leave each other's reach open"
        elif len(cycles) > 1:
            why = "how far it can go beside other drives is told over their cycle, and theirs differ"
        else:
            why = "" if all(map(math.isfinite, cycles)) else "where the other drives or free joints go has no end in time"
        if why:
            faults.append(Fault(path, f"{why}.", "Give it a range = [least, greatest]."))
            continue
        try:
            laws = {joint: _swing(mechanism, joint, max(cycles, default=0.0))}
        except MechanismError as error:
            faults += [Fault(path, f.message, f.remedy) for f in error.faults if f.path == path]
            continue  # what else is wrong is found out, and said, when it is run
        drives = tuple(replace(d, law=laws.get(d.joint, d.law)) for d in mechanism.drives)
        mechanism = replace(mechanism, drives=drives)
    return mechanism, faults


def _put_together(mechanism: Mechanism) -> Compiled:
    """The mechanism with its first drive held at its start, or as near to it as it can be put together (in steps; not where groups
    have to be followed). Raises `MechanismError`."""
    try:
        return compile_mechanism(mechanism)
    except MechanismError as error:
        first, *others = mechanism.drives
        model = build_model(mechanism)
        if any(block.kind == "general" for block in model.blocks):
            raise
        step = TURN / STEPS if model.rotary(first.joint) else 10.0 * model.length_scale / STEPS
        for k in range(2, STEPS + 2):
            law = Rest(float(first.law(0.0)[0]) + step * (k // 2) * (-1.0) ** k)
            with suppress(MechanismError):
                return compile_mechanism(replace(mechanism, drives=(replace(first, law=law), *others)))
        raise error


def _swing(mechanism: Mechanism, joint: str, cycle: float) -> Law:
    """The law of one drive: a harmonic oscillation whose largest speed is the stated one, or that speed where it can turn fully.
    ``cycle``: of other drives that move [s], during which it must not come to a limit. Raises `MechanismError`."""
    law = next(d.law for d in mechanism.drives if d.joint == joint)
    assert isinstance(law, ConstantSpeed)
    others = tuple(d for d in mechanism.drives if d.joint != joint)
    held = (Drive(joint=joint, law=Rest(law.start)), *others)
    compiled = _put_together(replace(mechanism, drives=held, loads=(), effects=()))
    rotary, size = compiled.model.rotary(joint), compiled.model.length_scale
    path = f"joints.{joint}.drive.range"
    if cycle:
        beside = range_beside(compiled, np.array([0.0, cycle]))
        if beside is None:
            why = "at its start it cannot stand while the other drives run through their cycle" + (
                ", as far as that is known: some groups of it have to be followed." if compiled.followed else "."
            )
            raise MechanismError(Fault(path, why, "Let it start elsewhere, or give a range = [least, greatest]."))
        ranges = [beside]
    else:
        ranges = reachable_ranges(compiled)
    low, high = ranges[0] if ranges else (law.start, law.start)
    inside = low <= law.start <= high
    if rotary and high - low > TURN * (1.0 - (1e-5 if cycle else 1e-9)):
        return law
    if not rotary and high - low > 9.0 * size:
        raise MechanismError(Fault(path, "nothing limits how far it can go.", "Give a range = [least, greatest]."))
    if high - low < 1e-6 * (TURN if rotary else size):
        raise MechanismError(Fault(path, "it cannot move from its start.", "Let it start elsewhere, or change a length."))
    margin = MARGIN * (high - low)
    low, high = low + margin, high - margin
    if inside:
        low, high = min(low, law.start), max(high, law.start)
    centre, amplitude = 0.5 * (low + high), 0.5 * (high - low)
    phase = math.asin(min(max((law.start - centre) / amplitude, -1.0), 1.0))
    frequency = abs(law.speed) / (TURN * amplitude)
    return Oscillation(centre, amplitude, frequency, phase if law.speed > 0.0 else math.pi - phase)
