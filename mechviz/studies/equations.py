"""``mechviz forces --equations``: the equilibrium equations of each group with their numbers, as text and as LaTeX."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from mechcore.constructions.equations import Equation, EquilibriumSystem, ForceUnknown, GroupEquations, LinkEquations
from mechcore.errors import Fault, MechanismError
from mechcore.forces.kinetostatics import Forces, solve_forces
from mechviz.runs import Run
from mechviz.scene.units import Units

THIN = r"\,"
IN_A_ROW = 3  # values that fit side by side on a page
UNDETERMINED = "statics does not determine these; the smallest that balance are"
NOTHING = 1e-12
"""Relative to the largest load of a link: a smaller load is rounding."""


def equilibrium_at(run: Run, time: float) -> tuple[EquilibriumSystem, int]:
    """The equilibrium of a run and the frame in it that belongs to a time [s].

    A prescribed motion is solved at exactly that time. A motion under forces is taken at the nearest frame. Raises
    `MechanismError` where friction jams the mechanism at that time.
    """
    assert run.forces is not None
    forces, frame = run.forces, int(np.argmin(np.abs(run.motion.time - time)))
    if run.motion.at_times is not None and run.simulation is None:  # one frame is enough
        forces, frame = solve_forces(run.motion.at_times(np.array([time]))), 0
    equilibrium = EquilibriumSystem(_part(forces, frame)[0])
    frame = _part(forces, frame)[1]
    if not np.isfinite(equilibrium.values[frame]).all():
        why = f"at {time:.6g} s friction jams the mechanism: no forces of the drives move it."
        raise MechanismError(Fault("forces", why, "Choose another moment, or less friction."))
    return equilibrium, frame


def _part(forces: Forces, frame: int) -> tuple[Forces, int]:
    """The part of the motion that contains a frame, and the number of the frame within that part."""
    for rows, part in forces.parts:
        where = np.flatnonzero(rows == frame)
        if len(where):
            return part, int(where[0])
    raise ValueError(f"no part holds frame {frame}")


def _groups(equilibrium: EquilibriumSystem, frame: int, units: Units) -> list[GroupEquations]:
    """The equations of every group at a frame, the last group first, in the given units of forces and moments. Loads that are
    rounding are set to zero."""
    size = equilibrium.forces.motion.model.length_scale
    per = {si: units.display_unit(si)[1] for si in ("N", "N m")}

    def unknown(u: ForceUnknown) -> ForceUnknown:
        return replace(u, unit=units.display_unit(u.unit)[0])

    def values(pairs: Sequence[tuple[ForceUnknown, float]]) -> tuple[tuple[ForceUnknown, float], ...]:
        return tuple((unknown(u), per[u.unit] * value) for u, value in pairs)

    def equation(link: LinkEquations, e: Equation) -> Equation:
        factor, unit = per[e.unit], units.display_unit(e.unit)[0]
        terms = tuple((c * factor / per[u.unit], unknown(u)) for c, u in e.terms)
        return replace(e, terms=terms, load=factor * e.load if abs(e.load) > _rounding(link, e.unit, size) else 0.0, unit=unit)

    def lines_of(link: LinkEquations) -> LinkEquations:
        def shown(value: float, unit: str) -> float:
            return per[unit] * value if abs(value) > _rounding(link, unit, size) else 0.0

        loads = tuple((name, shown(x, "N"), shown(y, "N"), shown(turn, "N m")) for name, x, y, turn in link.loads)
        return replace(link, loads=loads, equations=tuple(equation(link, e) for e in link.equations))

    return [
        replace(
            group,
            links=tuple(map(lines_of, group.links)),
            solved=values(group.solved),
            known=values(group.known),
            undetermined=values(group.undetermined),
        )
        for group in equilibrium.groups(frame)
    ]


def _heading(equilibrium: EquilibriumSystem, frame: int, units: Units) -> str:
    """Heading: the time, and the units of forces, lever arms and moments."""
    force, moment = (units.display_unit(si)[0] for si in ("N", "N m"))
    arm = moment.removeprefix(f"{force} ") if moment.startswith(f"{force} ") else f"{moment}/{force}"
    return f"equilibrium at {equilibrium.forces.motion.time[frame]:.6g} s, in {force}, {arm} and {moment}"


def equation_lines(equilibrium: EquilibriumSystem, frame: int, units: Units) -> list[str]:
    """The equations of every group at a frame and their solutions, the last group first, as lines of text."""
    lines = [
        _heading(equilibrium, frame, units),
        "R_B, N_B, M_B act on the second link of joint B, the opposite on its first; T_B, F_B: drives; sum M_B: about joint B",
    ]
    for number, group in enumerate(_groups(equilibrium, frame, units), 1):
        lines += ["", f"group {number}: {group.group}"]
        for link in group.links:
            lines.append(f"  {link.link}")
            for label, x, y, turn in link.loads:
                if abs(x) + abs(y) + abs(turn) > 0.0:
                    lines.append(f"    load {label}: Fx {_number(x)}, Fy {_number(y)}, moment {_number(turn)}")
            for equation in link.equations:
                lines.append(f"    {f'sum {_sum(equation)}':<10} {_text(equation)} = 0")
        if group.known:
            lines.append(f"  known      {_values(group.known)}")
        lines.append(f"  gives      {_values(group.solved)}")
        if group.undetermined:
            lines.append(f"  {UNDETERMINED}: {_values(group.undetermined)}")
    return [*lines, "", *_together(equilibrium, frame)]


def equation_table(run: Run) -> list[str]:
    """The equations at the start of the run as Markdown. Empty where the scene names no force polygon, or where friction jams the
    mechanism at the start."""
    if run.forces is None or "force" not in run.motion.mechanism.studies.polygons:
        return []
    try:
        equilibrium, frame = equilibrium_at(run, float(run.motion.time[0]))
    except MechanismError:
        return []
    lines = ["## Equilibrium equations at the start", "", "| group | link | sum | equation |", "|---|---|---|---|"]
    for number, group in enumerate(_groups(equilibrium, frame, run.scene.units), 1):
        for link in group.links:
            for equation in link.equations:
                lines.append(f"| {number} | {link.link} | {_sum(equation)} | {_text(equation)} = 0 |")
        lines.append(f"| {number} | gives | | {_values(group.solved)} |")
        if group.undetermined:
            lines.append(f"| {number} | {UNDETERMINED} | | {_values(group.undetermined)} |")
    return [*lines, "", *(f"- {line}" for line in _together(equilibrium, frame)), ""]


def _together(equilibrium: EquilibriumSystem, frame: int) -> Iterator[str]:
    """A line that compares the solution by groups with that of all equations at once."""
    yield f"all {equilibrium.equations} equations at once, without groups, for {len(equilibrium.unknowns)} unknowns: " + (
        f"the same values, to {_difference(equilibrium, frame):.1e} of the largest"
        if equilibrium.determinate
        else f"statics does not decide them all; these values leave {equilibrium.residual[frame]:.1e} of the largest term"
    )


def _difference(equilibrium: EquilibriumSystem, frame: int) -> float:
    values, again = equilibrium.values[frame], equilibrium.at_once()[frame]
    largest = float(np.abs(values).max(initial=0.0))
    return float(np.abs(again - values).max(initial=0.0)) / (largest or 1.0)


def _rounding(link: LinkEquations, unit: str, size: float) -> float:
    """Bound up to which loads of a link in ``unit`` (N or N m) are rounding. ``size``: length scale of the mechanism [m]."""
    force = max((abs(x) + abs(y) for _, x, y, _ in link.loads), default=0.0)
    return NOTHING * (force if unit == "N" else max([force * size, *(abs(m) for _, _, _, m in link.loads)]))


def _sum(equation: Equation) -> str:
    return f"M_{equation.about}" if equation.about else equation.sum


def _number(value: float) -> str:
    return f"{value:.6g}"


def _text(equation: Equation) -> str:
    parts = [("-" if c < 0.0 else "+", abs(c), u.name) for c, u in equation.terms]
    if equation.load:
        parts.append(("-" if equation.load < 0.0 else "+", abs(equation.load), ""))
    return _joined(parts, " ")


def _joined(parts: list[tuple[str, float, str]], between: str) -> str:
    """The terms of a sum (sign, size, name) as text: a factor 1 is left out, the first term has no plus sign."""
    words = []
    for k, (sign, size, name) in enumerate(parts):
        unit = name and abs(size - 1.0) < 1e-12
        term = name if unit else f"{_number(size)}{between if name else ''}{name}"
        words.append((f"{sign} " if k else "-" if sign == "-" else "") + term)
    return " ".join(words) or "0"


def _values(pairs: tuple[tuple[ForceUnknown, float], ...]) -> str:
    return ", ".join(f"{u.name} = {_number(v)} {u.unit}" for u, v in pairs) or "nothing new"


def latex_lines(equilibrium: EquilibriumSystem, frame: int, units: Units) -> list[str]:
    """The equations of every group and their solutions as LaTeX, for a document that loads amsmath."""
    lines = [f"% {_heading(equilibrium, frame, units)}"]
    for number, group in enumerate(_groups(equilibrium, frame, units), 1):
        lines += [
            rf"\paragraph{{Group {number}: {', '.join(_escaped(k) for k in group.group.links)}}}",
            *_latex_group(group),
        ]
    return lines


def _latex_group(group: GroupEquations) -> Iterator[str]:
    rows = []
    for link in group.links:
        for equation in link.equations:
            parts = [("-" if c < 0.0 else "+", abs(c), _symbol(u)) for c, u in equation.terms]
            if equation.load:
                parts.append(("-" if equation.load < 0.0 else "+", abs(equation.load), ""))
            about = rf"M_{{\mathrm{{{_escaped(equation.about)}}}}}" if equation.about else "M"
            of = about if equation.sum == "M" else f"F_{equation.sum[-1]}"
            rows.append(rf"\textstyle\sum {of}^{{\text{{{_escaped(link.link)}}}}} &:\quad & {_joined(parts, THIN)} &= 0")
    yield from (r"\begin{alignat*}{2}", " \\\\\n".join(rows), r"\end{alignat*}")
    for text, pairs in (("", group.solved), (f"{UNDETERMINED}:", group.undetermined)):
        given = [rf"{_symbol(u)} &= {_latex_number(v)}{THIN}\mathrm{{{u.unit.replace(' ', THIN)}}}" for u, v in pairs]
        if not given:
            continue
        yield from [text] if text else []
        lines = (", & ".join(given[k : k + IN_A_ROW]) for k in range(0, len(given), IN_A_ROW))
        yield from (r"\begin{align*}", ", \\\\\n".join(lines), r"\end{align*}")


def _symbol(u: ForceUnknown) -> str:
    return rf"{u.letter}_{{\mathrm{{{_escaped(u.joint)}}}{u.axis}}}"


def _latex_number(value: float) -> str:
    mantissa, _, exponent = _number(value).partition("e")
    return rf"{mantissa}\cdot 10^{{{int(exponent)}}}" if exponent else mantissa


def _escaped(text: str) -> str:
    return text.replace("_", r"\_").replace("&", r"\&").replace("%", r"\%").replace("#", r"\#")
