"""A straight-line program in stages: what has to be computed how often, and in which loops over lanes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from operator import or_
from typing import NamedTuple

from mechcore.compiled.symbols import Code, Names, Node, Operand

LANE, FRAME = 1, 2  # what a number of a program differs with
BOTH = LANE | FRAME
CARRIED = "c["  # how names of numbers begin that go on from frame to frame
SLOW = ("atan2", "atan", "cos", "sin", "tan", "tanh", "exp", "expm1", "log", "log1p", "pow", "modulo")
TABLES = ("piecewise", "searched", "curve")
"""Functions that compilers do not compute for several lanes at once, and those that look something up."""


class Stages(NamedTuple):
    """Lines of C: what is the same for all, what differs with the frames, with the lanes, with both (in loops one after the
    other). So many numbers are ``kept`` from loop to loop, in rows ``z``."""

    of_none: list[str]
    of_frames: list[str]
    of_lanes: list[str]
    of_both: list[list[str]]
    kept: int


def staged(code: Code, outputs: Sequence[tuple[str, Operand]], parameters: list[float], depends: Mapping[int, int]) -> Stages:
    """The program of some outputs: ``depends`` says of inputs by their numbers whether they differ with the lanes or the frames;
    where none does with the frames all is of one stage.

    Functions for which a compiler has no vectors get loops of their own, so that it makes vectors of the others.
    """
    names, order = Names(parameters), code.needed(outputs)
    stage = dict.fromkeys(order, BOTH)
    if any(depends.get(number, LANE) & FRAME for number in order):
        for number in order:
            stage[number] = reduce(or_, map(stage.__getitem__, code.operands(number)), depends.get(number, 0))
    loop = dict.fromkeys(order, 0)  # of those that differ with both: odd for slow functions
    for number in order:
        if stage[number] == BOTH:
            slow = code.form(number).startswith(tuple(f"{name}(" for name in (*SLOW, *TABLES)))
            loop[number] = int(slow)
            for x in code.operands(number):
                loop[number] = max(loop[number], loop[x] + (loop[x] % 2 != slow) if stage[x] == BOTH else 0)
    last = max(loop.values(), default=0)
    given = {number for number in order if not code.operands(number) and not code.form(number).startswith(CARRIED)}
    assigned: list[list[str]] = [[] for _ in range(last + 1)]
    wanted: list[set[int]] = [set() for _ in assigned]
    for target, value in outputs:
        own = last if target.startswith(CARRIED) else loop[value.number] if isinstance(value, Node) else 0
        assigned[own].append(f"{target} = {names(value)};")
        wanted[own] |= {value.number} if isinstance(value, Node) else set()
    for number in order:
        if stage[number] == BOTH:
            wanted[loop[number]].update(code.operands(number))
    handed = [[x for x in sorted(w) if stage[x] == LANE or (stage[x] == BOTH and loop[x] != k)] for k, w in enumerate(wanted)]
    rows = {x: k for k, x in enumerate(sorted({x for taken in handed for x in taken if x not in given}))}

    def stored(number: int) -> list[str]:
        return [f"z[{rows[number]}][k] = t{number};"] if number in rows else []

    loops = []
    for k, taken in enumerate(handed):
        lines = [code.line(x, names) if x in given else f"const double t{x} = z[{rows[x]}][k];" for x in taken]
        for number in order:
            if stage[number] == BOTH and loop[number] == k and not (number in given and number in taken):
                lines += [code.line(number, names), *stored(number)]
        loops.append(lines + assigned[k])
    return Stages(
        of_none=[code.line(number, names) for number in order if stage[number] == 0],
        of_frames=[code.line(number, names) for number in order if stage[number] == FRAME],
        of_lanes=[line for number in order if stage[number] == LANE for line in (code.line(number, names), *stored(number))],
        of_both=[lines for lines in loops if lines],
        kept=len(rows),
    )
