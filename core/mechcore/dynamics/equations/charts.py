"""Coordinate charts: accelerations of the joint coordinates that, taken as drives, determine the configuration; choice of the
coordinates, the range in which they are good, and the change from one chart to the next.

At a dead point of one coordinate another one moves: the configuration curve itself is regular there. A chart is good as long as its
own coordinate has a fair share of the motion; where it has not, the joint that moves most takes over. The angles of the links, and
the groups that have to be followed, continue from their present values.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations
from math import comb
from typing import Any

import numpy as np

from mechcore.arrays import Real, Values
from mechcore.branches.paths import Starts, Waypoint
from mechcore.branches.unwrapped import UnwrappedAngles, raw_angles
from mechcore.constants import TURN
from mechcore.dynamics.equations.contacts import contact_program
from mechcore.dynamics.equations.curve import CurveEquations, beside_singular, tabulate, whole_turn
from mechcore.dynamics.equations.lines import straight_lines
from mechcore.dynamics.equations.program import EquationsProgram, Programmed
from mechcore.dynamics.equations.reduced import (
    constrained,
    free_of,
    motion_at,
    moving,
    rates_of_joints,
    reduced_equations,
    steps_of_differences,
    with_states,
)
from mechcore.effects.masses import kinetic_energy
from mechcore.effects.registry import effects_of, potential
from mechcore.errors import Fault, MechanismError
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled, reached
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism
from mechcore.records import dataclass
from mechcore.spec.mechanism import Drive, Mechanism
from mechcore.texts import as_coordinate

WORTH_LINES = 10  # evaluations after which it pays to write the equations out: that costs as much as about five
STRAINED_RATE = 6.0  # joint rate per unit rate of the free coordinates, above which other coordinates take over
EASED_RATE = 0.5  # part of the present rate that the others may have at most
MANY_SETS = 500  # sets of joints up to which all are compared
SAME_PLACE = 1e-9  # relative difference of positions and energies up to which the mechanism is at the same place


def jacobian_of(motion: Motion, units: Sequence[Motion], joints: Sequence[str]) -> tuple[Real, Real]:
    """Rates of joints' coordinates per unit rate of each free coordinate (n, p, f), and their second rates at q'' = 0 (n, p), which
    are also those of prescribed drives; ``motion`` with q'' = 0, ``units`` its tangents."""
    free = [motion.mechanism.drives[i].joint for i in free_of(motion)]
    rows, second = np.zeros((motion.frames, len(joints), len(units))), np.zeros((motion.frames, len(joints)))
    for k, joint in enumerate(joints):
        if joint in free:
            rows[:, k, free.index(joint)] = 1.0
        else:
            second[:, k] = motion.coordinate(joint)[:, 2]
            for i, unit in enumerate(units):
                rows[:, k, i] = unit.coordinate(joint)[:, 1]
    return rows, second


class Chart(Programmed):
    """Accelerations of all coordinates (n, f). Joints that ``rest`` keep their coordinates; `holding` gives the efforts that hold
    them."""

    def __init__(self, compiled: Compiled, rests: Sequence[str] = ()):
        self.compiled, self.rests = compiled, tuple(rests)
        free = [compiled.mechanism.drives[i].joint for i in free_of(compiled)]
        self.held = [free.index(joint) for joint in self.rests if joint in free]
        self.calls = 0

    def program(self, *, long: bool = False) -> EquationsProgram | None:
        return contact_program(self.compiled, self.rests, long=long) if self.rests else super().program(long=long)

    def __call__(self, q: Real, v: Real, t: Real) -> Real:
        program = self.program()
        if program is not None and program.everywhere:
            return program(q, v, t)
        self.calls += 1
        lines = self.compiled.cached(straight_lines) if self.calls > WORTH_LINES and not self.rests else None
        return self._solve(q, v, t)[0] if lines is None else lines(q, v, t)

    def _solve(self, q: Real, v: Real, t: Real) -> tuple[Real, Real]:
        """Accelerations (n, f + s), see `with_states`, and the efforts that hold the joints at rest (n, p).

        From M q'' + h = Q + G' p, G q'' + b = 0.
        """
        motion, units = moving(self.compiled, q, v, t)
        r = reduced_equations(motion, units)
        if not self.rests:
            return with_states(r.acceleration(), motion), np.zeros((len(t), 0))
        rows, second = jacobian_of(motion, units, self.rests)
        accelerations, holding = constrained(r.inertia, r.force - r.bias, rows, second)
        accelerations[:, self.held] = 0.0
        return with_states(accelerations, motion), holding

    def holding(self, q: Real, v: Real, t: Real) -> Real:
        """Efforts that keep the joints at rest (n, p): torque [N m] or force [N] in the direction of each one's coordinate."""
        program = contact_program(self.compiled, self.rests)
        return program.friction_state(q, v, t).holding if program is not None and program.everywhere else self._solve(q, v, t)[1]

    def slopes(self, q: Real, v: Real, t: Real, a: Real) -> tuple[Real, Real]:
        """Derivatives of the accelerations by position and speed (n, f, f) each, by differences, all in one call."""
        return differences(self, q, v, t, a, steps_of_differences(self.compiled, q, v, a))

    def with_slopes(self, q: Real, v: Real, t: Real, near: Real) -> tuple[Real, Real, Real]:
        """Accelerations (n, f) and their `slopes`, all in one call, ``near`` accelerations (n, f)."""
        f, steps = q.shape[1], steps_of_differences(self.compiled, q, v, near)
        every = self(*difference_states(q, v, t, steps, itself=True)).reshape(2 * f + 1, *q.shape)
        return every[-1], *quotients(every[:-1] - every[-1], steps)


def differences(
    system: Callable[[Real, Real, Real], Real], q: Real, v: Real, t: Real, a: Real, steps: tuple[Real, Real]
) -> tuple[Real, Real]:
    """Slopes of a system's accelerations by position and speed (n, f, f) each, by differences with steps (f,), all in one call."""
    return quotients(system(*difference_states(q, v, t, steps)).reshape(-1, *q.shape) - a, steps)


def difference_states(q: Real, v: Real, t: Real, steps: tuple[Real, Real], *, itself: bool = False) -> tuple[Real, Real, Real]:
    """States (m n, f) and times (m n,): n of them for a step of each coordinate, then for a step of each rate, then, if ``itself``,
    the n states without a step."""
    n, f = q.shape
    m = 2 * f + itself
    many = np.empty((2, m, n, f))
    many[0], many[1] = q, v
    for k in range(f):
        many[0, k, :, k] += steps[0][k]
        many[1, f + k, :, k] += steps[1][k]
    many_q, many_v = many.reshape(2, m * n, f)
    return many_q, many_v, np.concatenate([t] * m)


def quotients(changed: Real, steps: tuple[Real, Real]) -> tuple[Real, Real]:
    """Slopes (n, f, f) by position and by speed from changes (2 f, n, f)."""
    f = len(steps[0])
    by_q, by_v = (
        (part / step[:, None, None]).transpose(1, 2, 0) for part, step in zip((changed[:f], changed[f:]), steps, strict=True)
    )
    return by_q, by_v


def with_named_drive(mechanism: Mechanism) -> Mechanism:
    """The mechanism with the first drive's joint named in loads that refer to it without a name."""
    first = mechanism.drives[0].joint
    loads = []
    for load in mechanism.loads:
        changes: dict[str, Any] = {}
        factor = getattr(load, "factor", None)
        if factor is not None and factor.of in ("position", "velocity") and factor.joint is None:
            changes["factor"] = replace(factor, joint=first)
        if getattr(load, "drive", first) is None:
            changes["drive"] = first
        loads.append(replace(load, **changes) if changes else load)
    return replace(mechanism, loads=tuple(loads))


def strain(compiled: Compiled, q: Real, v: Real, t: float) -> float:
    """Largest rate of a joint per unit rate of a free coordinate at q, v (f,), slides relative to the mechanism's size."""
    return float(np.abs(_chart_rates(compiled, q, v, t)[2]).max())


def _chart_rates(compiled: Compiled, q: Real, v: Real, t: float) -> tuple[Motion, list[str], Real]:
    """The motion at an instant, joints whose coordinates could be free ones, and their rates per unit rate of each free coordinate
    (p, f)."""
    motion, units = moving(compiled, q[None], v[None], np.array([t]))
    names, rows = rates_of_joints(compiled, units)
    return motion, names, np.array([[float(np.ravel(x)[0]) for x in row] for row in rows])


def take_over(compiled: Compiled, q: Real, v: Real, t: float, known: Sequence[Compiled]) -> tuple[Compiled, Real, Real] | None:
    """The same mechanism, in the same place, in a better chart; its coordinates and rates (f,) there. A ``known`` chart is used
    again if it passes through this place. None where no other chart is better, or none has the same configuration there."""
    motion, names, rows = _chart_rates(compiled, q, v, t)
    if not np.isfinite(rows).all():
        return None
    sets = _sets(rows)
    if not sets:  # screws and cylinders lead, and there are too few other joints
        return None
    chosen = rows[np.array(sets)]
    fine = np.abs(np.linalg.det(chosen)) > 1e-6
    eased = np.full(len(sets), np.inf)
    eased[fine] = np.abs(rows @ np.linalg.inv(chosen[fine])).max(axis=(1, 2))
    if not eased.min() <= EASED_RATE * np.abs(rows).max():
        return None
    joints = [names[k] for k in sets[int(np.argmin(eased))]]
    coordinates = np.array([motion.coordinate(joint)[0] for joint in joints])
    place, speeds = coordinates[:, 0], coordinates[:, 1]
    candidates = [c for c in known if [c.mechanism.drives[i].joint for i in free_of(c)] == joints]
    for candidate in (*candidates, None):
        if candidate is None:
            other = continued_in_chart(_compiled(compiled, motion, joints, coordinates), place, t, motion)
        else:
            other = reenter(candidate, place, t, motion)
        if _same(motion, other, place, speeds, t):
            return other, place, speeds
    return None


def _sets(rows: Real) -> list[tuple[int, ...]]:
    """Sets of joints whose coordinates could be free ones; where there are very many, only that of a pivoted QR decomposition of
    their rates."""
    p, f = rows.shape
    if comb(p, f) <= MANY_SETS:
        return list(combinations(range(p), f))

    from scipy.linalg import qr

    return [tuple(sorted(int(k) for k in qr(rows.T, mode="r", pivoting=True)[1][:f]))]


def _compiled(compiled: Compiled, motion: Motion, joints: Sequence[str], coordinates: Real) -> Compiled:
    """The mechanism with other free coordinates, assembled in its present position; from there on the laws of drives lead."""
    mechanism = with_named_drive(compiled.mechanism)
    poses: dict[str, tuple[float, float, float]] = {}
    for link in motion.model.links[1:]:
        x, y, angle = motion.pose(link)[0]
        poses[link] = float(x), float(y), float(angle)
    free = [Drive(joint=joint, law=Free(float(x[0]), float(x[1]))) for joint, x in zip(joints, coordinates, strict=True)]
    prescribed = [d for d in mechanism.drives if not isinstance(d.law, Free)]
    still = [Drive(joint=d.joint, law=Free(float(motion.coordinate(d.joint)[0, 0]), 0.0)) for d in prescribed]
    placed = compile_mechanism(
        replace(mechanism, drives=(*free, *still), modes={}, sketch=poses), compiled.accuracy, compiled.executor
    )
    known = replace(mechanism, drives=(*free, *prescribed), modes={}, sketch=poses)
    return replace(placed, model=replace(placed.model, mechanism=known))


def _same(motion: Motion, other: Compiled, q: Real, v: Real, t: float) -> bool:
    """Whether a chart has the same poses of all links and the same energies as a ``motion``."""
    there = motion_at(other, q[None], v[None], np.array([t]))
    if not _same_poses(motion, there):
        return False
    energies = [np.array([kinetic_energy(m)[0], np.ravel(potential(m))[0]]) for m in (motion, there)]
    return bool(np.abs(energies[0] - energies[1]).max() <= 1e3 * SAME_PLACE * max(1e-300, np.abs(energies[0]).max()))


def _same_poses(motion: Motion, other: Motion) -> bool:
    """Whether two motions have all links at the same place in their first frames, but for whole turns."""
    for link in motion.model.links[1:]:
        a, b = motion.pose(link)[0], other.pose(link)[0]
        if (
            not np.abs(a[:2] - b[:2]).max() <= SAME_PLACE * motion.model.length_scale
            or not abs(np.exp(1j * (a[2] - b[2])) - 1.0) <= SAME_PLACE
        ):
            return False
    return True


POOR_SHARE = 0.05  # share of the motion that a chart's own coordinate must do, at least
DEAD_SHARE = 1e-4  # share of the motion below which a joint's start does not determine it: four digits of its speed would be lost
FAIR_SHARE = 0.2  # share below which another joint takes over, well before it gets poor
CURVE_SAMPLES = 721  # of the curve on either side of where a chart begins
LEAST_ROOM = 1e-6  # part of the range of a chart: one that ends sooner does not take over


@dataclass(frozen=True, eq=False)
class CurveChart:
    """A chart of the curve: the mechanism driven by its coordinate, the table, and the range in which it is good (None:
    everywhere)."""

    compiled: Compiled
    curve: CurveEquations | Chart
    valid_range: tuple[float, float] | None


def curve_around(compiled: Compiled, q: float, tolerance: float) -> tuple[CurveEquations | Chart, tuple[float, float] | None]:
    """The mechanism tabulated over one turn of its coordinate, or as far around ``q`` as its coordinate leads at all; then also the
    range within which it leads well. At an edge of this range, where another joint should take over at once, a `Chart` instead of a
    table.

    Raises `MechanismError` at a dead point of the coordinate at ``q`` itself.
    """
    model = compiled.model
    rotary = _rotary(compiled)
    if rotary:
        turn = whole_turn(compiled, q, tolerance=tolerance, usable=_leads_well, most_strain=1.0 / POOR_SHARE)
        if turn is not None:
            return turn, None
    reach = TURN if rotary else 4.0 * model.length_scale
    x = beside_singular(compiled, q + reach * np.linspace(-1.0, 1.0, 2 * CURVE_SAMPLES - 1))
    share = _share(compiled, x)
    here = int(np.searchsorted(x, q))
    if DEAD_SHARE < share[here] <= POOR_SHARE:
        return Chart(compiled), (q, q)
    if not share[here] > POOR_SHARE:
        raise MechanismError(
            Fault(
                f"joints.{compiled.mechanism.drives[0].joint}",
                f"at {as_coordinate(q, rotary=rotary)} its coordinate stands still while the mechanism moves (dead point): its "
                "speed says nothing there.",
                "Give the free start at another joint, or start next to the dead point.",
            )
        )
    good = share >= POOR_SHARE
    low, high = here, here
    while low > 0 and good[low - 1]:
        low -= 1
    while high < len(x) - 1 and good[high + 1]:
        high += 1
    ends = float(x[low]), float(x[high])
    low, high = low + 1, high - 1  # the event that ends a chart lies within its table
    while low < here and share[low] < FAIR_SHARE:
        low += 1
    while high > here and share[high] < FAIR_SHARE:
        high -= 1
    if not low < here < high:
        return Chart(compiled), (q, q)
    return tabulate(compiled, *ends, tolerance=tolerance), (float(x[low]), float(x[high]))


def _share(compiled: Compiled, q: Real) -> Real:
    """Share of the motion that the chart's own coordinate has (n,): its rate over that of the fastest joint; 0 where it cannot be
    assembled."""
    share = _own_share(motion_at(compiled, q[:, None], np.ones((len(q), 1)), np.zeros(len(q))))
    return np.where(reached(compiled, q), share, 0.0)


def _leads_well(unit: Motion) -> bool:
    """Whether the chart's own coordinate has a sufficient share of the motion at a unit rate everywhere."""
    return bool(np.all(_own_share(unit) >= POOR_SHARE))


def _own_share(motion: Motion) -> Real:
    rates = _rates(motion)
    own = rates[motion.mechanism.drives[0].joint]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = own / np.max(np.array(list(rates.values())), axis=0)
    return np.where(np.isfinite(share), share, 0.0)


def _rates(motion: Motion) -> dict[str, Real]:
    """Absolute rates of all joints' coordinates (n,), slides relative to the mechanism's size; any of these can be the free
    coordinate."""
    model, speeds = motion.model, motion.speeds
    rotation_class = model.angles.rotation_class
    joints = {p.name for p in motion.mechanism.joints}  # of a cylinder the slide, not the pins that it brings along
    out: dict[str, Values] = {}
    for j, joint in enumerate(model.joints):
        if joint.freedoms and joint.name in joints:
            if j in model.driven:
                rate: Values = motion.drives[model.driven[j]][1]
            elif joint.coordinate == "slide":
                rate = speeds.slide[j]
            else:
                first, second = model.ends[j]
                rate = speeds.angular[rotation_class[second]] - speeds.angular[rotation_class[first]]
            out[joint.name] = rate if joint.coordinate == "angle" else rate / model.length_scale
    return {name: np.abs(rate) if np.ndim(rate) else np.full(motion.shape, abs(rate)) for name, rate in out.items()}


def best_chart(
    compiled: Compiled, q: float, v: float, known: Sequence[CurveChart], tolerance: float
) -> tuple[CurveChart, float, float]:
    """The same mechanism, in the same place, led by the joint that moves most; its coordinate and rate there.

    A ``known`` chart is used again where it passes through this place on the same branch.
    """
    motion = motion_at(compiled, np.array([[q]]), np.array([[v if v else 1.0]]), np.zeros(1))
    rates = _rates(motion)
    joint = max(rates, key=lambda name: float(rates[name][0]))
    coordinate, rate = (float(x) for x in motion.coordinate(joint)[0, :2])
    counted = any(e.counts_turns for e in effects_of(compiled.mechanism))
    for chart in known:
        place = _place_on(chart, coordinate, rate) if chart.compiled.mechanism.drives[0].joint == joint else None
        if place is not None and _same_poses(motion, motion_at(chart.compiled, *_at_rest(place))):
            again = continued_in_chart(chart.compiled, np.array([place]), 0.0, motion)
            before, after = (motion_at(c, *_at_rest(place)).angles.class_angles for c in (chart.compiled, again))
            if np.abs(after - before).max() < 1.0:
                return chart, place, rate if v else 0.0
            if isinstance(chart.curve, CurveEquations) and not counted:
                return CurveChart(again, replace(chart.curve, compiled=again), chart.valid_range), place, rate if v else 0.0
    start = np.array([[coordinate, rate if v else 0.0]])
    own = continued_in_chart(_compiled(compiled, motion, [joint], start), np.array([coordinate]), 0.0, motion)
    if not _same_poses(motion, motion_at(own, *_at_rest(coordinate))):
        raise MechanismError(
            Fault(
                "dynamics",
                f"two branches meet where {joint} takes over from {compiled.mechanism.drives[0].joint}.",
                "Start elsewhere, or give it another speed.",
            )
        )
    return CurveChart(own, *curve_around(own, coordinate, tolerance)), coordinate, rate if v else 0.0


def _place_on(chart: CurveChart, coordinate: float, rate: float) -> float | None:
    """The coordinate in the range of a chart, less whole turns; None where it is not good there and a little ahead in the sense of
    its rate."""
    if chart.valid_range is None:
        return coordinate
    low, high = chart.valid_range
    ahead = coordinate + float(np.copysign(LEAST_ROOM * (high - low), rate))
    turns = TURN * float(np.floor((ahead - low) / TURN)) if _rotary(chart.compiled) else 0.0
    return coordinate - turns if low <= min(coordinate, ahead) - turns and max(coordinate, ahead) - turns <= high else None


def _rotary(compiled: Compiled) -> bool:
    return compiled.model.rotary(compiled.mechanism.drives[0].joint)


def _at_rest(q: float) -> tuple[Real, Real, Real]:
    """A position as arguments of `motion_at`: coordinate, unit rate, time 0."""
    return np.array([[q]]), np.ones((1, 1)), np.zeros(1)


def waypoints(compiled: Compiled, q: Real, t: Real) -> list[Waypoint]:
    """Waypoints at free coordinates (n, f) and times (n,)."""
    columns = iter(q.T)
    drives = [next(columns) if isinstance(d.law, Free) else np.asarray(d.law(t)[0], float) for d in compiled.mechanism.drives]
    return [Waypoint(float(time), row) for time, row in zip(t, np.column_stack([np.zeros((len(t), 0)), *drives]), strict=True)]


def continued_in_chart(compiled: Compiled, q: Real, t: float, motion: Motion) -> Compiled:
    """A mechanism in a new chart, assembled at its coordinates q (f,) at time t [s]. The angles of its links continue from those of
    a ``motion`` (one frame) of the same mechanism there, in another chart."""
    at = replace(_entered(compiled, q, t, motion), starts=compiled.assembly.starts)
    followed = replace(compiled, angles=UnwrappedAngles(compiled.model, motion.angles.start, at, exact=False))
    model, angles = compiled.model, motion_at(followed, q[None], np.zeros_like(q)[None], np.array([t])).angles
    turning = [j for j in model.driven if model.joints[j].coordinate == "angle"]
    gone = (angles.joint(model.joints[j].name)[0] - at.drives[model.driven[j]] for j in turning)
    followed.angles.exact = all(abs(float(x)) < 1.0 for x in gone)
    return followed


def reenter(compiled: Compiled, q: Real, t: float, motion: Motion) -> Compiled:
    """A chart that has been used before and is used again from its free coordinates q (f,) and the time t [s] on, as
    `continued_in_chart`."""
    if len(compiled.mechanism.drives) > 1:
        at = _entered(compiled, q, t, motion)
        compiled.angles.path.leave([replace(at, starts=_starts(compiled, at, motion))])
    return compiled


def _entered(compiled: Compiled, q: Real, t: float, motion: Motion) -> Waypoint:
    """The waypoint at which a chart takes a motion over from another one, with the angles of its rotation classes."""
    model, old = compiled.model, motion.model
    placed = motion_at(compiled, q[None], np.zeros_like(q)[None], np.array([t]))
    class_angles = raw_angles(model, [d[0] for d in placed.drives], placed.state, (1,))[:, 0]
    for k, link in enumerate(model.links):
        if link in old.index:
            rotation_class = model.angles.rotation_class[k]
            there = float(motion.angle(old.index[link])[0]) - model.angles.offset[k]
            class_angles[rotation_class] += TURN * np.round((there - class_angles[rotation_class]) / TURN)
    (at,) = waypoints(compiled, q[None], np.array([t]))
    return replace(at, class_angles=class_angles)


def _starts(compiled: Compiled, at: Waypoint, motion: Motion) -> Starts:
    """Starts of the groups that have to be followed, from those at the chart's first waypoint and the motion since then."""
    model, first = compiled.model, compiled.angles.at
    turning = model.angles

    def group(waypoint: Waypoint, g: int) -> float:
        rotation_class = turning.classes_of[g][0]
        assert waypoint.class_angles is not None
        return float(waypoint.class_angles[rotation_class]) - sum(
            sign * float(waypoint.drives[d]) for d, sign in turning.class_drives[rotation_class]
        )

    known, later = first.starts or {}, {}
    for block in model.blocks:
        if block.name in known:
            turned = [known[block.name][i] + group(at, g) - group(first, g) for i, g in enumerate(block.angles)]
            old = motion.model.joint_index
            slid = [float(np.ravel(motion.state.slide[old[model.joints[j].name]])[0]) for j in block.slides]
            later[block.name] = np.array([*turned, *slid])
    for g in model.multi_turn:
        later[f"angle {g}"] = np.asarray(known[f"angle {g}"] + group(at, g) - group(first, g))
    return later
