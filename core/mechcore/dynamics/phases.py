"""Phases of a motion with dry friction and end stops, integrated from event to event by a compiled program."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mechcore.arrays import Real
from mechcore.compiled.collocation import HEAD
from mechcore.constants import REST
from mechcore.dynamics.equations.charts import STRAINED_RATE
from mechcore.dynamics.equations.contacts import ContactProgram, Ending
from mechcore.dynamics.integration.collocation import Window
from mechcore.dynamics.integration.windows import Integrator, windows_of

ENDINGS = tuple(Ending)
MOST_WINDOWS = 256  # windows of one call


class ContactPhase(NamedTuple):
    """A phase from ``start`` to ``end`` [s], in which elements slide by ``signs`` (e,).

    ``ending``: why it ends, with the ``number`` of an element or a stop, the ``sense`` in which rest ends, the energy ``lost`` in
    an impact [J] and its ``rate`` of approach; ``decided``: whether the program has decided how the motion continues."""

    start: float
    end: float
    windows: list[Window]
    signs: Real
    ending: Ending
    decided: bool
    number: int
    sense: float
    lost: float
    rate: float


class PhaseRun(NamedTuple):
    """Consecutive phases; time [s], position, speed and signs after them; and the number of evaluations."""

    phases: list[ContactPhase]
    time: float
    q: Real
    v: Real
    signs: Real
    evaluations: int


def run_phases(
    program: ContactProgram,
    by: Integrator,
    start: tuple[float, Real, Real],
    duration: float,
    friction: tuple[Real, Real],
    stops: Real,
    sense_delay: float,
) -> PhaseRun:
    """Consecutive phases from a ``start`` (time [s], position, speed (f,)) on, up to the first event that the program does not
    decide.

    ``friction``: scales and signs (e,) of the elements, all of them moved by free coordinates; ``stops`` (k, 5) as
    `EndStops.program_rows` has them; ``sense_delay`` [s] as in `friction_state.FrictionPhases`.
    """
    t, q, v = start
    rule, f = by.rule(), len(q)
    if by.searches_breakpoints and not program.has_forms:
        return PhaseRun([], t, q, v, friction[1], 0)
    least = by.least(t, duration)
    at = np.concatenate([[t], np.zeros(HEAD - 1), q, v, np.zeros(f * (len(rule.nodes) + 1))])
    limits = by.limits(t, duration, least, MOST_WINDOWS)
    known = program.phases(rule, at, limits, (duration, sense_delay, REST, STRAINED_RATE), (*friction, stops))
    if known is None:
        return PhaseRun([], t, q, v, friction[1], 0)
    marks, signs, batch = known
    windows, first, phases = windows_of(batch), 0, []
    for mark, own in zip(marks.tolist(), signs, strict=False):
        begun, end, until, kind, index, sense, lost, rate = mark
        last = int(until)
        ending = ENDINGS[abs(int(kind))]
        phases.append(ContactPhase(begun, end, windows[first:last], own, ending, kind >= 0.0, int(index), sense, lost, rate))
        first = last
    return PhaseRun(phases, float(at[0]), at[HEAD : HEAD + f], at[HEAD + f : HEAD + 2 * f], signs[-1], int(at[3]))
