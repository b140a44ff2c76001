"""Followers that may leave their cams: unilateral contact.

In contact the mechanism moves as modelled. A cam whose contact would have to pull releases its follower: then the follower's own
guide is one more free coordinate of the mechanism without that joint, until the follower returns to the cam. The test
is the complementarity of contact: the gap's acceleration, were the follower free, has the opposite sign of the contact force.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mechcore.arrays import Real
from mechcore.cams.placement.plane import PlacedCam
from mechcore.constants import TURN
from mechcore.dynamics.contact.end_stops import impact
from mechcore.dynamics.equations.charts import Chart, continued_in_chart, reenter
from mechcore.dynamics.equations.reduced import free_of, motion_at, reduce, shifted, tangents
from mechcore.dynamics.events import SeparableCam
from mechcore.dynamics.integration.collocation import System, Window
from mechcore.dynamics.integration.windows import Solution
from mechcore.errors import Fault, MechanismError
from mechcore.forces.cam_rating import contact_force, placed_cams
from mechcore.forces.kinetostatics import Forces
from mechcore.joints.base import Relation
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism
from mechcore.records import dataclass
from mechcore.spec.mechanism import Drive
from mechcore.texts import as_coordinate

EIGHTH_TURN_SAMPLES = 48  # samples for an eighth of a turn of the cam
WINDOW_TURN = TURN / 8.0  # of the cam's turn in a window in which nothing has to be integrated
MOST_ROUNDS = 10
PEAK_LOOKS, NEAR_LIMIT = 3, 0.02  # refinements of a peak below the limit by less than this part of the event function's range
INTERVAL_PARTS = 17


@dataclass(frozen=True, eq=False)
class _Contact:
    """A cam and its follower's guide; ``away`` (1, -1): sense of the guide's coordinate in which the follower leaves the cam."""

    name: str
    guide: str
    away: float
    restitution: float
    cam: PlacedCam
    rotary: bool
    level: float  # the guide's coordinate is level + slope times the lift in metres
    slope: float


class FollowerSeparation:
    """The mechanism with each set of separated followers, and the gaps between these and their cams.

    Coordinates: the free ones of the mechanism, then those of the separated followers' guides in the order of ``contacts``.
    """

    def __init__(self, compiled: Compiled, separable_cams: Sequence[SeparableCam]):
        model = compiled.model
        relations = {r.name: r for r in model.relations}
        self.free = len(free_of(compiled))
        self.contacts: dict[str, _Contact] = {}
        for each in separable_cams:
            relation = relations.get(each.joint)
            if relation is None or not isinstance(relation.geometry, PlacedCam) or relation.geometry.form_closed:
                raise MechanismError(
                    Fault(f"joints.{each.joint}", "it is no cam that its follower could leave.", "Name a force-closed cam.")
                )
            cam = relation.geometry
            rotary = model.joints[model.joint_index[cam.guide]].coordinate == "angle"
            slope = _slope(compiled, relation, cam.guide)
            self.contacts[each.joint] = _Contact(
                name=each.joint,
                guide=cam.guide,
                away=float(np.sign(slope)),
                restitution=each.restitution,
                cam=cam,
                rotary=rotary,
                level=-slope * float(relation.constant or 0.0),
                slope=slope,
            )
        self.compiled_by_separated: dict[frozenset[str], Compiled] = {frozenset(): compiled}

    def coordinate_number(self, name: str, separated: frozenset[str]) -> int:
        """Number of a separated follower's coordinate."""
        return self.free + sum(other in separated for other in list(self.contacts)[: list(self.contacts).index(name)])

    def compiled(self, separated: frozenset[str], q: Real, v: Real, t: float, name: str) -> tuple[Compiled, Real, Real]:
        """The mechanism in which the followers in ``separated`` are separated, ``name`` newly, and its coordinates and rates (f,).
        ``q``, ``v``: those before ``name`` separates."""
        held = self.compiled_by_separated[separated - {name}]
        motion = motion_at(held, q[None], v[None], np.array([t]))
        contact = self.contacts[name]
        at, rate = (float(x) for x in motion.coordinate(contact.guide)[0, :2])
        k = self.coordinate_number(name, separated)
        place = np.insert(q, k, at)
        if separated not in self.compiled_by_separated:
            self.compiled_by_separated[separated] = continued_in_chart(self._compile(held, motion, contact, at), place, t, motion)
            self._check_moved_mass(separated, name, q, v, t, at)
        reenter(self.compiled_by_separated[separated], place, t, motion)
        return self.compiled_by_separated[separated], place, np.insert(v, k, rate)

    def _compile(self, held: Compiled, motion: Motion, contact: _Contact, at: float) -> Compiled:
        mechanism = held.mechanism
        poses: dict[str, tuple[float, float, float]] = {}
        for link in motion.model.links[1:]:
            x, y, angle = motion.pose(link)[0]
            poses[link] = float(x), float(y), float(angle)
        names = [c.guide for c in self.contacts.values()]
        later = [d.joint for d in mechanism.drives if d.joint in names[names.index(contact.guide) :]]
        k = len(mechanism.drives) - len(later)
        laws = (*mechanism.drives[:k], Drive(joint=contact.guide, law=Free(at, 0.0)), *mechanism.drives[k:])
        # assembled in its present position; from there on the laws lead
        now = [Drive(joint=d.joint, law=Free(float(x[0][0]), 0.0)) for d, x in zip(mechanism.drives, motion.drives, strict=True)]
        start = (*now[:k], laws[k], *now[k:])
        loose = replace(mechanism, joints=tuple(p for p in mechanism.joints if p.name != contact.name), modes={}, sketch=poses)
        placed = compile_mechanism(replace(loose, drives=start))
        return replace(placed, model=replace(placed.model, mechanism=replace(loose, drives=laws)))

    def _check_moved_mass(self, separated: frozenset[str], name: str, q: Real, v: Real, t: float, at: float) -> None:
        k = self.coordinate_number(name, separated)
        inertia = reduce(
            self.compiled_by_separated[separated], np.insert(q, k, at)[None], np.insert(v, k, 0.0)[None], np.array([t])
        ).inertia[0]
        values = np.linalg.eigvalsh(inertia)
        if not values[0] > 1e-14 * values[-1]:
            guide = self.contacts[name].guide
            raise MechanismError(
                Fault(f"joints.{name}.liftoff", f"no mass moves with {guide} once the cam lets go.", "Give the follower a mass.")
            )

    def overlap(self, name: str, separated: frozenset[str]) -> Callable[[Real, Real, Real], Real]:
        """Penetration of a separated follower into its cam (n,), in its guide's coordinate [m or rad]; negative while there is a
        gap."""
        return lambda q, v, t: -self.gap(name, separated, q, v, t)[0]

    def gap(self, name: str, separated: frozenset[str], q: Real, v: Real, t: Real) -> tuple[Real, Real]:
        """Gap (n,) between a separated follower and its cam, in its guide's coordinate [m or rad], and its rate."""
        contact, k = self.contacts[name], self.coordinate_number(name, separated)
        held = self.compiled_by_separated[separated - {name}]
        motion = motion_at(held, np.delete(q, k, axis=1), np.delete(v, k, axis=1), t)
        h = motion.coordinate(contact.guide)
        gap = contact.away * (q[:, k] - h[:, 0])
        if contact.rotary:
            gap = np.mod(gap + np.pi, TURN) - np.pi
        return gap, contact.away * (v[:, k] - h[:, 1])

    def parting(
        self, name: str, separated: frozenset[str], system: Callable[[Compiled, Real, Real, float], System | None] | None = None
    ) -> Callable[[Real, Real, Real], Real]:
        """A function that gives the gap's acceleration (n,) if the follower, now in contact, were released: positive where the cam
        would have to pull.

        ``system``: the equations of motion with friction of a mechanism at an instant, or None where those of its chart hold.
        """
        contact, more = self.contacts[name], separated | {name}

        def parting(q: Real, v: Real, t: Real) -> Real:
            held = self.compiled_by_separated[separated]
            h = motion_at(held, q, v, t).coordinate(contact.guide)
            k = self.coordinate_number(name, more)
            if more not in self.compiled_by_separated:
                self.compiled(more, q[0], v[0], float(t[0]), name)
            at, rate = np.insert(q, k, h[:, 0], axis=1), np.insert(v, k, h[:, 1], axis=1)
            rubs = None if system is None else system(self.compiled_by_separated[more], at[0], rate[0], float(t[0]))
            loose = (Chart(self.compiled_by_separated[more]) if rubs is None else rubs)(at, rate, t)
            second = motion_at(held, q, v, t, np.delete(loose, k, axis=1)).coordinate(contact.guide)[:, 2]
            return np.asarray(contact.away * (loose[:, k] - second))

        return parting

    def landing(
        self, name: str, separated: frozenset[str], t: float, q: Real, v: Real, restitution: float
    ) -> tuple[Real, float, float]:
        """Rates (f,) after the impact of a follower on its cam, the speed of approach, and the energy lost [J]."""
        compiled, row = self.compiled_by_separated[separated], np.array([t])
        k = self.coordinate_number(name, separated)
        contact = self.contacts[name]
        _, rate = self.gap(name, separated, q[None], v[None], row)
        hit = float(rate[0])
        held = self.compiled_by_separated[separated - {name}]
        motion = motion_at(held, np.delete(q, k)[None], np.delete(v, k)[None], row)
        slopes = [float(u.coordinate(contact.guide)[0, 1]) for u in tangents(motion, free_of(held))]
        gradient = contact.away * np.insert(-np.array(slopes), k, 1.0)
        inertia = reduce(compiled, q[None], v[None], row).inertia[0]
        response = np.linalg.solve(inertia, gradient)
        impulses = impact(np.array([[gradient @ response]]), np.array([hit]), np.array([restitution]), np.array([False]))
        assert impulses is not None  # some mass moves with the follower's guide
        return shifted(v, response * impulses[0]), -hit, impulses[1]

    def touching_coordinate(self, name: str, motion: Motion) -> Real:
        """The guide's coordinate (F,) at which the follower would touch its cam."""
        c = self.contacts[name]
        return np.asarray(c.level + c.slope * c.cam.scale * c.cam.law(c.cam.argument(motion))[0])

    def cam_position_words(self, name: str, compiled: Compiled, q: Real, v: Real, t: float) -> str:
        """The cam's position in words."""
        cam = self.contacts[name].cam
        x = float(cam.argument(motion_at(compiled, q[None], v[None], np.array([t])))[0])
        rotary = cam.bed is None
        return f"{as_coordinate(x % TURN if rotary else x, rotary=rotary, digits=4)} of the cam"

    def fastest_cam_rate(self, compiled: Compiled, q: Real, v: Real, t: float) -> float:
        """Rate at which the fastest cam runs through its law [rad/s]; a wedge's length of law counts as a turn."""
        row = np.array([t])
        motion = motion_at(compiled, q[None], v[None], row)
        paces = [0.0]
        for c in self.contacts.values():
            if c.cam.bed is not None:
                paces.append(abs(float(motion.coordinate(c.cam.bed)[0, 1])) / c.cam.cam.law.length * TURN)
            else:
                paces.append(abs(float(motion.velocity(c.cam.links[0])[0, 2] - _angular_velocity(motion, c.cam.carrier))))
        return max(paces)

    def samples(self, compiled: Compiled, window: Window) -> int:
        """Number of samples of a window at which contacts are evaluated."""
        q, v, _ = window(np.array([window.start]))
        turned = self.fastest_cam_rate(compiled, q[0], v[0], window.start) * window.length
        return int(min(EIGHTH_TURN_SAMPLES * max(1.0, np.ceil(turned / WINDOW_TURN)), 20_000))

    def window_length(self, compiled: Compiled, q: Real, v: Real, t: float, duration: float) -> float:
        """Length [s] of a window from ``t`` on in which all drives are prescribed, in a motion of a ``duration`` [s]."""
        return float(
            np.clip(WINDOW_TURN / max(self.fastest_cam_rate(compiled, q, v, t), 1e-300), duration / 20_000, duration / 8.0)
        )


def pressing(motion: Motion, forces: Forces, name: str) -> Real:
    """Force (n,) [N] with which a cam in contact presses on its follower. Raises `MechanismError` where friction jams."""
    force = contact_force(forces, next(cam for cam in placed_cams(motion) if cam.name == name))
    if np.isnan(force).any():
        t = float(motion.time[int(np.argmax(np.isnan(force)))])
        raise MechanismError(
            Fault(f"joints.{name}", f"at t = {t:.6g} s friction jams the follower.", "Lower a coefficient, or lengthen its guide.")
        )
    return np.asarray(force)


def _angular_velocity(motion: Motion, link: str) -> float:
    return 0.0 if link == motion.mechanism.frame else float(motion.velocity(link)[0, 2])


def _slope(compiled: Compiled, relation: Relation, guide: str) -> float:
    """Derivative of the guide's coordinate x by the lift in metres, from the relation c x + lift = constant."""
    for name, c in relation.slides:
        if name == guide:
            return -1.0 / c
    model = compiled.model
    joint = model.joints[model.joint_index[guide]]
    c = next(c for link, c in relation.angles if link == relation.links[1])
    return -1.0 / c if joint.links[1] == relation.links[1] else 1.0 / c


def first_beyond(
    event_function: Callable[[Real, Real, Real], Real],
    window: Window,
    after: float,
    limit: float,
    count: int,
    *,
    again: bool = False,
) -> float | None:
    """The first time in a window after ``after`` [s] at which an event function, which may have kinks and jumps, exceeds ``limit``;
    None where it does not. ``count``: number of intervals of the first search.

    ``again``: an event function that exceeds it at the beginning, by rounding, has to fall below it first.
    """
    low, high = max(window.start, after), window.start + window.length
    if high <= low:
        return None
    t = low + (high - low) * np.arange(count + 1) / count
    last, close = high, 0
    for _ in range(MOST_ROUNDS + PEAK_LOOKS):
        q, v, _ = window(t)
        value = event_function(q, v, t)
        beyond = value > limit
        if not beyond.any() and close < PEAK_LOOKS and float(value.max()) > limit - NEAR_LIMIT * float(np.ptp(value)):
            k = int(np.argmax(value))  # it nearly does: sample more finely there
            t = np.linspace(t[max(k - 1, 0)], t[min(k + 1, len(t) - 1)], 2 * INTERVAL_PARTS + 1)
            close += 1
            continue
        if again and beyond.all():
            k = 1  # a bounce that is over before the first sample, if there is one
        else:
            beyond[: int(np.argmin(beyond)) if again else 0] = False
            if not beyond.any():
                return None
            k = max(int(np.argmax(beyond)), 1)
            again = again and k == 1
        last = float(t[k])
        if t[k] - t[k - 1] <= 4.0 * np.spacing(t[k]):
            break
        t = t[k - 1] + (t[k] - t[k - 1]) * np.linspace(0.0, 1.0, INTERVAL_PARTS + 1)
        t[-1] = last
    return last


def driven_windows(
    t0: float,
    t1: float,
    length: Callable[[float], float],
    after: Callable[[Window], float | None],
    breakpoints: Callable[[Window, float], float | None] | None,
) -> Solution:
    """Windows in which no coordinate is free: they only serve to find events, and end at breakpoints of laws."""
    solution = Solution()
    none = np.zeros(0)
    t = t0
    tiny = 1e-12 * max(abs(t0), abs(t1))
    while t < t1 - tiny:
        window = Window(t, min(length(t), t1 - t), none, none, np.zeros((2, 0)))
        break_time = breakpoints(window, t + tiny) if breakpoints is not None else None
        if break_time is not None and t + 10.0 * tiny < break_time < t + window.length:
            window = Window(t, break_time - t, none, none, np.zeros((2, 0)))
        solution.windows.append(window)
        if after(window) is not None:
            break
        t += window.length
    return solution
