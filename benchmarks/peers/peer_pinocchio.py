"""Pinocchio: open chains with the closing pin cut; positions by Newton's method with the frames' Jacobians, written by hand.

Forces: recursive Newton-Euler twice, without and with the force in the cut, which two equations of the undriven joints give.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from problem import FOUR_BAR, GRAVITY, SLIDER_CRANK

PACKAGES = ("pin==4.1.0",)
PLANE = slice(0, 2)


def chain(model, pin, parent, joint, place, *, mass=0.0, centre=0.0, inertia=0.0):
    """Append a joint at a place on its parent's axes, with a body behind it."""
    j = model.addJoint(parent, joint, pin.SE3(np.eye(3), np.array([*place, 0.0])), f"joint{model.njoints}")
    about = np.diag([0.0, 0.0, inertia])
    model.appendBodyToJoint(j, pin.Inertia(mass, np.array([centre, 0.0, 0.0]), about), pin.SE3.Identity())
    return j


def mark(model, pin, joint, place):
    """A named point on a joint's body."""
    at = pin.SE3(np.eye(3), np.array([*place, 0.0]))
    return model.addFrame(pin.Frame(f"frame{model.nframes}", joint, 0, at, pin.FrameType.OP_FRAME))


def four_bar():
    import pinocchio as pin

    p = FOUR_BAR
    model = pin.Model()
    crank = chain(model, pin, 0, pin.JointModelRZ(), (0.0, 0.0))
    coupler = chain(model, pin, crank, pin.JointModelRZ(), (p.crank, 0.0))
    rocker = chain(model, pin, 0, pin.JointModelRZ(), (p.ground, 0.0))
    tip, end = mark(model, pin, coupler, (p.coupler, 0.0)), mark(model, pin, rocker, (p.rocker, 0.0))
    watched = [mark(model, pin, crank, (p.crank, 0.0)), end, mark(model, pin, coupler, p.p)]
    data = model.createData()
    world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    still = np.zeros(3)

    def solve(angles, stop=1e-14):
        computed = np.empty((3, 3, len(angles), 2))
        q, v, a = np.array([0.0, 0.8, 1.8]), np.array([p.speed, 0.0, 0.0]), np.zeros(3)
        before = angles[0]
        for k in range(len(angles)):
            q += v * ((angles[k] - before) / p.speed)  # first guess
            q[0] = before = angles[k]
            for _ in range(20):
                pin.computeJointJacobians(model, data, q)
                pin.updateFramePlacements(model, data)
                gap = data.oMf[tip].translation[PLANE] - data.oMf[end].translation[PLANE]
                both = (pin.getFrameJacobian(model, data, tip, world) - pin.getFrameJacobian(model, data, end, world))[PLANE]
                dq = np.linalg.solve(both[:, 1:], gap)
                q[1:] -= dq
                if abs(dq).max() < stop:
                    break
            v[1:] = -np.linalg.solve(both[:, 1:], both[:, 0]) * p.speed
            pin.forwardKinematics(model, data, q, v, still)
            drift = [pin.getFrameClassicalAcceleration(model, data, f, world).linear[PLANE] for f in (tip, end)]
            a[1:] = np.linalg.solve(both[:, 1:], drift[1] - drift[0])
            pin.forwardKinematics(model, data, q, v, a)
            pin.updateFramePlacements(model, data)
            for i, f in enumerate(watched):
                computed[0, i, k] = data.oMf[f].translation[PLANE]
                computed[1, i, k] = pin.getFrameVelocity(model, data, f, world).linear[PLANE]
                computed[2, i, k] = pin.getFrameClassicalAcceleration(model, data, f, world).linear[PLANE]
        return {(n, d): computed[d, i] for i, n in enumerate("BCP") for d in range(3)}

    return solve


def slider_crank():
    import pinocchio as pin

    p = SLIDER_CRANK
    model = pin.Model()
    model.gravity.linear = np.array([0.0, -GRAVITY, 0.0])
    crank = chain(model, pin, 0, pin.JointModelRZ(), (0.0, 0.0), mass=p.m[0], centre=p.s1, inertia=p.j[0])
    rod = chain(model, pin, crank, pin.JointModelRZ(), (p.r, 0.0), mass=p.m[1], centre=p.s2, inertia=p.j[1])
    slider = chain(model, pin, 0, pin.JointModelPX(), (0.0, p.e), mass=p.m[2])
    tip, end = mark(model, pin, rod, (p.l, 0.0)), mark(model, pin, slider, (0.0, 0.0))
    data = model.createData()
    world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    still = np.zeros(3)
    to_joint = model.frames[tip].placement

    def solve(angles, stop=1e-14):
        n = len(angles)
        computed = {k: np.empty((n, 2)) for k in "OBC"} | {k: np.empty(n) for k in ("guide", "torque")}
        q, v, a = np.array([0.0, 0.0, p.r + p.l]), np.array([p.speed, 0.0, 0.0]), np.zeros(3)
        nothing = [pin.Force.Zero() for _ in range(model.njoints)]
        outside = [pin.Force.Zero() for _ in range(model.njoints)]
        nothing[slider] = pin.Force(np.array([p.force, 0.0, 0.0]), np.zeros(3))
        before = angles[0]
        for k in range(n):
            q += v * ((angles[k] - before) / p.speed)
            q[0] = before = angles[k]
            for _ in range(20):
                pin.computeJointJacobians(model, data, q)
                pin.updateFramePlacements(model, data)
                gap = data.oMf[tip].translation[PLANE] - data.oMf[end].translation[PLANE]
                both = (pin.getFrameJacobian(model, data, tip, world) - pin.getFrameJacobian(model, data, end, world))[PLANE]
                dq = np.linalg.solve(both[:, 1:], gap)
                q[1:] -= dq
                if abs(dq).max() < stop:
                    break
            v[1:] = -np.linalg.solve(both[:, 1:], both[:, 0]) * p.speed
            pin.forwardKinematics(model, data, q, v, still)
            drift = [pin.getFrameClassicalAcceleration(model, data, f, world).linear[PLANE] for f in (tip, end)]
            a[1:] = np.linalg.solve(both[:, 1:], drift[1] - drift[0])
            tau = pin.rnea(model, data, q, v, a, nothing)
            cut = np.linalg.solve(-both[:, 1:].T, tau[1:])  # on the slider, reversed on the rod
            turn = data.oMi[rod].rotation
            outside[rod] = to_joint.act(pin.Force(turn.T @ np.array([*-cut, 0.0]), np.zeros(3)))
            outside[slider] = pin.Force(np.array([p.force + cut[0], cut[1], 0.0]), np.zeros(3))
            computed["torque"][k] = pin.rnea(model, data, q, v, a, outside)[0]
            computed["O"][k] = (data.oMi[crank].rotation @ data.f[crank].linear)[PLANE]
            computed["B"][k] = (turn @ data.f[rod].linear)[PLANE]
            computed["C"][k] = cut
            computed["guide"][k] = data.f[slider].linear[1]
        return computed

    return solve


ROWS = {
    "four-bar": {"Pinocchio, own Newton loop": four_bar},
    "slider-crank": {"Pinocchio rnea + own loop closure": slider_crank},
}
STOPS = (1e-1, 1e-2, 1e-4, 1e-8, 1e-14)


def tolerances(build):
    """The step [rad, m] below which Newton's method stops."""
    solve = build()
    return {f"Newton to {stop:.0e}": partial(solve, stop=stop) for stop in STOPS}


SETTINGS = {
    ("four-bar", "rates"): {"Pinocchio": partial(tolerances, four_bar)},
    ("slider-crank", "forces"): {"Pinocchio": partial(tolerances, slider_crank)},
}
