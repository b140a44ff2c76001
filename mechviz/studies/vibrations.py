"""Small vibrations of a scene: equilibrium and modes as text and as CSV, and a scene that moves in one mode."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.dynamics.rest.vibrations import Mode, Vibrations, small_vibrations
from mechcore.errors import Fault, MechanismError
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechviz.files import replacing
from mechviz.scene.faults import SceneError, in_scene_words
from mechviz.scene.kinds.signals import SIGNALS

if TYPE_CHECKING:
    from mechcore.dynamics.rest.equilibrium import Seek
    from mechcore.motion.motion import Motion
    from mechviz.scene.annotations import Place
    from mechviz.scene.scene import Scene


LARGEST_TURN = 0.35  # largest rotation of a link in a displayed mode [rad]
NO_DAMPING = 1e-12  # smaller damping ratios are rounding
SLOW = 0.5  # displayed frequency of a mode that does not vibrate [Hz]


@in_scene_words
def vibrations_of(scene: Scene, *, seek: Seek = "stable") -> Vibrations:
    """Small vibrations of a scene about an equilibrium of its free coordinates; ``seek``: which equilibrium. Raises `SceneError`
    where every motion is prescribed, `MechanismError` where there is no equilibrium."""
    if scene.simulation is None:
        remedy = "Let forces move a joint: free = { position = 0 } instead of its drive."
        raise SceneError(scene.name, Fault("joints", "every motion is prescribed: nothing can vibrate.", remedy))
    return small_vibrations(scene.mechanism, seek=seek, stops=scene.simulation.stops)


def _rotary(vibrations: Vibrations) -> list[bool]:
    return [vibrations.equilibrium.compiled.model.rotary(p) for p in vibrations.joints]


def _shape(vibrations: Vibrations, mode: Mode) -> Any:
    """The shape of a mode, scaled so that its largest component is 1; beside angles one radian or one mechanism size."""
    rotary = _rotary(vibrations)
    size = vibrations.equilibrium.compiled.model.length_scale if any(rotary) else 1.0
    scale = np.array([1.0 if r else size for r in rotary])
    return mode.shape / np.abs(mode.shape / scale).max()


def _row(vibrations: Vibrations, k: int) -> list[str]:
    mode = vibrations.modes[k]
    halving = "never"
    if abs(mode.growth) > 1e-9 * max(1.0, abs(mode.square)) ** 0.5:
        halving = f"{'doubles' if mode.growth > 0 else 'halves'} in {np.log(2.0) / abs(mode.growth):.4g} s"
    cells = [mode.kind, "-", "-"]
    if mode.kind in ("vibration", "flutter") or mode.frequency > 0:
        ratio = 0.0 if abs(mode.damping_ratio) <= NO_DAMPING else mode.damping_ratio
        numbers = (mode.frequency, ".6g"), (ratio, ".4g"), (mode.damped_frequency, ".6g")
        cells = ["-" if np.isnan(x) else format(x, digits) for x, digits in numbers]
    return [str(k + 1), *cells, halving, *map(_part, _shape(vibrations, mode))]


def _part(x: Any) -> str:
    """A component of a mode shape as text, with its phase where the shape is complex."""
    return f"{abs(x):.4g} at {np.angle(x, deg=True).round(1) + 0.0:g}°" if np.iscomplexobj(x) else f"{x:.4g}"


def vibration_lines(scene: Scene, vibrations: Vibrations) -> list[str]:
    """Equilibrium, its stability and a table of the modes, as lines of text."""
    eq = vibrations.equilibrium
    rotary = _rotary(vibrations)
    at = np.where(np.abs(eq.position) < 1e-12, 0.0, eq.position)
    shown = [scene.units.show(x, "angle" if r else "length") for x, r in zip(at, rotary, strict=True)]
    places = [f"{p} = {x}" for p, x in zip(vibrations.joints, shown, strict=True)]
    growing = [
        f"mode {k} flutters at {m.damped_frequency:.4g} Hz" if m.kind == "flutter" else f"mode {k} diverges"
        for k, m in enumerate(vibrations.modes, 1)
        if m.kind in ("flutter", "divergence")
    ]
    words = {
        "stable": "stable: a small disturbance makes it vibrate about this place",
        "neutral": "neutral: it stays where it is put, in at least one direction",
        "unstable": f"unstable: the least disturbance grows; {', '.join(growing)}",
    }
    lines = [
        scene.title,
        f"equilibrium: {', '.join(places)}",
        f"  {words[vibrations.stability]}",
        f"  found in {eq.steps} steps; the forces balance to {eq.residual:.1e} of the largest",
        *(f"  {note}" for note in vibrations.notes),
        "",
    ]
    units = ["rad" if r else "m" for r in rotary]
    heads = ["mode", "frequency [Hz]", "damping ratio", "damped [Hz]", "dies away"]
    rows = [[*heads, *(f"{p} [{u}]" for p, u in zip(vibrations.joints, units, strict=True))]]
    rows += [_row(vibrations, k) for k in range(len(vibrations.modes))]
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines += ["  ".join(cell.rjust(w) for cell, w in zip(row, widths, strict=True)) for row in rows]
    return lines


def vibrations_csv(vibrations: Vibrations, path: Path) -> Path:
    """Write the modes to a CSV file: frequencies, damping, eigenvalues, mass-normalised shapes (phi' M phi = 1), in SI units.

    The last columns are the imaginary parts of the shapes; they are zero except in flutter. Returns the path.
    """
    heads = ["mode", "kind", "frequency_Hz", "damping_ratio", "damped_frequency_Hz"]
    heads += ["exponent_1_re", "exponent_1_im", "exponent_2_re", "exponent_2_im", *(f"shape_{p}" for p in vibrations.joints)]
    heads += [f"shape_{p}_im" for p in vibrations.joints]
    with replacing(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(heads)
        for k, m in enumerate(vibrations.modes):
            exponents = [x for e in m.eigenvalues for x in (e.real, e.imag)]
            numbers = (m.frequency, m.damping_ratio, m.damped_frequency, *exponents, *m.shape.real, *m.shape.imag)
            writer.writerow([k + 1, m.kind, *(repr(float(x)) for x in numbers)])
    return path


def mode_scene(scene: Scene, vibrations: Vibrations, number: int, *, amplitude: float = 0.08) -> Scene:
    """A scene that moves in one mode (1, 2, ...): a drive moves every free coordinate harmonically about the equilibrium.

    ``amplitude``: largest displacement of a point relative to the mechanism's size; the rotation of links is limited in proportion,
    to 20 degrees at 0.08 and above. Dry friction and loads that change with time are left out. The drives then supply the damping
    forces and the nonlinear terms. Raises `SceneError`.
    """
    faults = []
    if not 1 <= number <= len(vibrations.modes):
        faults.append(Fault("mode", f"there is no mode {number}.", f"Give a number from 1 to {len(vibrations.modes)}."))
    if not (np.isfinite(amplitude) and 0 < amplitude <= 1):
        faults.append(Fault("amplitude", f"{amplitude:g} is no part of the mechanism's size.", "Give a number such as 0.08."))
    for name, entry in scene.document.joints.items():
        if entry.traits.is_planar:
            remedy = "Hold it by two sliding joints and a pin in a row instead, to see its modes move."
            faults.append(Fault(f"joints.{name}", "a mode is shown by driven joints, and a free body has none.", remedy))
    if faults:
        raise SceneError(scene.name, faults)
    mode, eq = vibrations.modes[number - 1], vibrations.equilibrium
    parts = mode.shape * _amplitude(vibrations, number - 1, amplitude)
    frequency = mode.frequency if mode.frequency > 0 else SLOW
    start = replace(eq, position=eq.position + parts.imag).motion
    changes = _without_forces_of_motion(scene)
    for drive in eq.compiled.mechanism.drives:
        joint = drive.joint
        if joint in vibrations.joints:
            i = vibrations.joints.index(joint)
            centre, part = float(eq.position[i]), complex(parts[i])
            rotary = _rotary(vibrations)[i]
        else:
            centre, part = float(drive.law(np.zeros(1))[0][0]), 0j
            model = eq.compiled.model
            rotary = model.joints[model.joint_index[joint]].coordinate == "angle"
        changes["joints", joint, "drive"] = _harmonic(centre, part, frequency, "rad" if rotary else "m")
    speed = f"{mode.frequency:.4g} Hz" if mode.frequency > 0 else f"{mode.kind}, not to its own time"
    changes["title",] = f"{scene.title}: mode {number} of {len(vibrations.modes)}, {speed}"
    changes["learning_goal",] = "A mode of vibration: all parts move in step and pass the equilibrium at the same instant."
    if np.iscomplexobj(parts):
        changes["learning_goal",] = (
            "A mode of flutter: parts move out of step, so that loads do work on it. Its growth is left out."
        )
    changes["run",] = {"frames": 240, "cycles": 3}
    for sketched in (False, True):
        try:
            made = scene.changed(changes | _sketch(scene, start) if sketched else changes, name=f"{scene.name}-mode-{number}")
        except (SceneError, MechanismError):
            if sketched:
                raise
            continue
        if _same_place(made, start):
            return made
    remedy = "Its assembly mode there cannot be stated: start the scene nearer to its equilibrium."
    raise SceneError(scene.name, Fault("mode", "the equilibrium is put together in another way than the scene.", remedy))


def _harmonic(centre: float, amplitude: complex, frequency: float, unit: str) -> dict[str, Any]:
    """Document of a drive that oscillates harmonically about a centre; the phase is that of the complex amplitude."""
    motion = {"centre": f"{centre!r} {unit}", "amplitude": f"{abs(amplitude)!r} {unit}", "frequency": f"{frequency!r} Hz"}
    phase = float(np.angle(amplitude, deg=True))
    return {"oscillation": {**motion, "phase": f"{phase:.17g} deg"} if phase else motion}


def _amplitude(vibrations: Vibrations, k: int, fraction: float) -> float:
    """Factor by which the shape of mode ``k`` is displayed; ``fraction``: largest displacement over the mechanism's size."""
    eq = vibrations.equilibrium
    model = eq.compiled.model
    shape = vibrations.modes[k].shape
    motions = [eq.motion_with(part) for part in (shape.real, shape.imag)]
    moved = [
        float(np.linalg.norm([m.point(link.name, name, 1)[0] for m in motions]))
        for link in model.mechanism.links
        for name in link.points
    ]
    turned = [float(np.linalg.norm([m.velocity(link)[0, 2] for m in motions])) for link in model.links[1:]]
    bounds = [fraction * model.length_scale / max(moved, default=0.0)] if max(moved, default=0.0) > 0 else []
    bounds += [LARGEST_TURN * min(1.0, fraction / 0.08) / max(turned)] if max(turned, default=0.0) > 0 else []
    return min(bounds)


def _without_forces_of_motion(scene: Scene) -> dict[Place, Any]:
    """The changes that remove from a scene the entries of a motion under forces, dry friction, and loads that change with time."""
    document = scene.document
    changes: dict[Place, Any] = {("watch",): None, ("effects",): [e for e in document.effects if e != "friction"]}
    for name, joint in document.joints.items():
        changes |= {("joints", name, key): None for key in ("free", "stops") if getattr(joint, key)}
        for key in ("static", "stribeck") if joint.friction is not None else ():
            if getattr(joint.friction, key) is not None:
                changes["joints", name, "friction", key] = None
    for name, load in document.loads.items():
        timed = "time" in (load.table and load.table.of, load.polynomial and load.polynomial.of)
        if timed or any(getattr(load, key) is not None for key in (*SIGNALS, "servo")):
            changes["loads", name] = None
    return changes


def _sketch(scene: Scene, start: Motion) -> dict[Place, Any]:
    """The changes that replace the stated assembly modes by a sketch: the poses of all links at the start."""
    document = scene.document
    changes: dict[Place, Any] = {}
    for name, joint in document.joints.items():
        if not joint.traits.own_mode:
            changes |= {("joints", name, key): None for key in joint.traits.modes if getattr(joint, key) is not None}
    if any(isinstance(link.points, list) for link in document.links.values()):
        return changes  # the scene's sketch also defines the shapes of these links, so it stays
    sketch = {}
    for name in document.links:
        if name != document.frame:
            x, y, angle = (float(v) for v in start.pose(name)[0])
            sketch[name] = {"at": [f"{x!r} m", f"{y!r} m"], "angle": f"{angle!r} rad"}
    return changes | {("sketch",): sketch}


def _same_place(scene: Scene, wanted: Motion) -> bool:
    """Whether every link of a scene starts in the pose of the first frame of ``wanted``, to 1e-7 relative."""
    start = solve_motion(compile_mechanism(scene.mechanism), np.zeros(1))
    size = wanted.model.length_scale
    for link in wanted.model.links[1:]:
        a, b = start.pose(link)[0], wanted.pose(link)[0]
        if np.abs(a[:2] - b[:2]).max() > 1e-7 * size or abs(np.exp(1j * (a[2] - b[2])) - 1.0) > 1e-7:
            return False
    return True
