"""A second formulation of plane mechanisms, written apart from the core: absolute coordinates and Lagrange multipliers.

Prescribed motions: `Second.follow` and `Second.reactions`. Under forces the equations of index 1 go through scipy's DOP853, with
impacts and rests on stops between: `Second.run`. Of `mechcore` only the specs are read, and what is compared.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
from absolute_constraints import Array, Lost
from absolute_forces import Loaded
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from mechcore.dynamics.events import EndStop
from mechcore.spec.loads import GasPressure

__all__ = ["Lost", "Second"]


GRAZES = 1e-11  # [rad or m]: a coordinate that comes no farther beyond a stop does not touch it
DENSE = 400  # places at which what comes before a graze is looked at
MOST_CALLS = 200_000  # of the equations of motion: some minutes
SHORTEST = 1e-6  # of the duration: bounces that are over sooner end in rest


class Second(Loaded):
    """A mechanism in absolute coordinates that moves under its forces."""

    def accelerations(self, t: float, q: Array, v: Array, more: tuple[str, ...] = ()) -> tuple[Array, Array]:
        """Accelerations (n,) and multipliers of the equations of index 1."""
        _, j, _, k = self.system(t, q, v, True, more)
        big, quad = self.masses(q, v)
        force = self.generalised(self.applied(t, q, v), q) + quad
        m = len(j)
        whole = np.zeros((self.n + m, self.n + m))
        whole[: self.n, : self.n], whole[: self.n, self.n :], whole[self.n :, : self.n] = big, -j.T, j
        solution = np.linalg.solve(whole, np.concatenate([force, -k]))
        return solution[: self.n], solution[self.n :]

    def project(self, t: float, q: Array, v: Array, more: tuple[str, ...] = ()) -> tuple[Array, Array]:
        """The nearest state that the constraints allow."""
        for _ in range(4):
            g, j, *_ = self.system(t, q, None, True, more)
            q = q - np.linalg.lstsq(j, g, rcond=None)[0]
        _, j, r, _ = self.system(t, q, None, True, more)
        return q, v + np.linalg.lstsq(j, r - j @ v, rcond=None)[0]

    def strike(self, t: float, q: Array, v: Array, stop: EndStop, more: tuple[str, ...]) -> Array:
        """Velocities after an impact on a stop."""
        _, j, r, _ = self.system(t, q, v, True, more)
        _, row, _ = self.measured(stop.joint, q, v)
        big, _ = self.masses(q, v)
        j = np.vstack([j, row])
        r = np.append(r, -stop.restitution * float(row @ v))
        m = len(j)
        whole = np.block([[big, -j.T], [j, np.zeros((m, m))]])
        return np.linalg.solve(whole, np.concatenate([big @ v, r]))[: self.n]

    def run(self, time: Array, stops: tuple[EndStop, ...] = (), tolerance: float = 1e-11) -> dict[str, Any]:
        """The motion from the start of the free coordinates: states at times, impacts, and which stops hold at each time."""
        t, end = 0.0, float(time[-1])
        q = self.solve(0.0, self.q0, "all")
        v, _ = self.rates(0.0, q, "all")
        out: dict[str, Any] = {"q": [], "v": [], "a": [], "events": [], "resting": [], "condition": 1.0}
        resting: list[EndStop] = []
        calls = itertools.count()
        longest = np.inf
        wanted = list(time)

        def states(more: tuple[str, ...], upto: float, dense: Any) -> None:
            while wanted and wanted[0] <= upto:
                s = float(wanted.pop(0))
                y = dense(s)
                x, u = self.project(s, y[: self.n], y[self.n :], more)
                out["q"].append(x)
                out["v"].append(u)
                out["a"].append(self.accelerations(s, x, u, more)[0])
                out["resting"].append(more)
                out["condition"] = max(out["condition"], float(np.linalg.cond(self.system(s, x, None)[1])))

        for _ in range(400):
            more = tuple(s.joint for s in resting)

            def slope(t: float, y: Array, more: tuple[str, ...] = more) -> Array:
                if next(calls) > MOST_CALLS:
                    raise Lost("stiff: an explicit method takes too many steps")
                q, v = y[: self.n], y[self.n :]
                return np.concatenate([v, self.accelerations(t, q, v, more)[0]])

            events: list[Any] = []
            nearest: list[Any] = []  # where a coordinate turns back before its stop, or within a step beyond it
            for s in stops:
                sign = 1.0 if s.side == "upper" else -1.0

                def approaching(t: float, y: Array, s: EndStop = s, sign: float = sign) -> float:
                    return sign * self.measured(s.joint, y[: self.n], y[self.n :])[1] @ y[self.n :]

                approaching.direction = -1.0  # type: ignore[attr-defined]
                nearest.append(approaching)
                if s in resting:
                    index = more.index(s.joint)

                    def pulls(t: float, y: Array, i: int = index, sign: float = sign, more: tuple[str, ...] = more) -> float:
                        p = self.accelerations(t, y[: self.n], y[self.n :], more)[1]
                        return -sign * float(p[len(p) - len(more) + i])

                    event: Any = pulls
                    event.direction = -1.0
                else:

                    def near(t: float, y: Array, s: EndStop = s, sign: float = sign) -> float:
                        return sign * (self.measured(s.joint, y[: self.n])[0] - s.at)

                    event = near
                    event.direction = 1.0
                event.terminal = True
                events.append(event)
            started = np.concatenate([q, v])
            exact = {"method": "DOP853", "rtol": tolerance, "atol": 1e-13, "dense_output": True}
            solution = solve_ivp(slope, (t, end), started, events=[*events, *nearest], max_step=longest, **exact)
            longest = np.inf
            if solution.status < 0:
                raise Lost(solution.message)
            met = [(float(solution.t[-1]), i) for i in range(len(stops)) if solution.status == 1 and len(solution.t_events[i])]
            for i, (s, near) in enumerate(zip(stops, events, strict=True)):  # a graze within a step: in and out again
                turns = [] if s in resting else solution.t_events[len(stops) + i]
                beyond = next((float(u) for u in turns if near(u, solution.sol(u)) > GRAZES), None)
                if beyond is not None:
                    before = max(float(u) for u in np.linspace(t, beyond, DENSE) if near(u, solution.sol(u)) < 0.0)
                    met.append((brentq(lambda u, near=near, at=solution.sol: near(u, at(u)), before, beyond, xtol=1e-16), i))
            if not met:
                states(more, end, solution.sol)
                return {k: np.array(x) if k in ("q", "v", "a") else x for k, x in out.items()}
            t, which = min(met)
            states(more, t, solution.sol)
            y = solution.sol(t)
            q, v = self.project(t, y[: self.n], y[self.n :], more)
            s = stops[which]
            sign = 1.0 if s.side == "upper" else -1.0
            if s in resting:
                resting.remove(s)
                out["events"].append((t, "release", s.name))
                continue
            before = float(self.measured(s.joint, q, v)[1] @ v)
            out["events"].append((t, "impact", s.name))
            for x in self.m.loads:
                if isinstance(x, GasPressure):
                    rate = self.coordinate(x.joint, q, v)[1]
                    self.led[x.name] = -rate if x.head == "ahead" else rate
            v = self.strike(t, q, v, s, more)
            after = s.restitution * abs(before)
            self.held[s.joint] = s.at
            pressing = self.accelerations(t, q, v, more)[0]
            gaining = sign * float(self.measured(s.joint, q, v)[1] @ pressing + self.measured(s.joint, q, v)[2])
            if gaining > 0.0 and 2.0 * after < SHORTEST * end * gaining:
                resting.append(s)
                v = self.strike(t, q, v, replace(s, restitution=0.0), more)
            elif gaining > 0.0:
                longest = 0.5 * after / gaining  # a step must not reach over a whole bounce
        raise Lost("too many events")
