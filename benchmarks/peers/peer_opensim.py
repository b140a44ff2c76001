"""OpenSim: joints, a point constraint that closes the loop, a prescribed crank; realised position by position.

Joints tell their reactions; torque and pin C come from the multipliers of the constraints. Positions and velocities are found by
hand, as for the other engines: `Model.assemble` left a visible gap in the loop here.
"""

from __future__ import annotations

import numpy as np
from problem import GRAVITY, SLIDER_CRANK

PACKAGES = ("opensim==4.6",)
LARGE = True


def slider_crank():
    import opensim as osim

    osim.Logger.setLevelString("Off")
    p = SLIDER_CRANK
    v3, zero = osim.Vec3, osim.Vec3(0)
    model = osim.Model()
    model.setGravity(v3(0, -GRAVITY, 0))
    inertias = (*p.j, 1e-3)
    crank, rod, slider = (
        osim.Body(name, m, v3(centre, 0, 0), osim.Inertia(j, j, j))
        for name, m, centre, j in zip(("crank", "rod", "slider"), p.m, (p.s1, p.s2, 0.0), inertias, strict=True)
    )
    joints = (
        osim.PinJoint("O", model.getGround(), zero, zero, crank, zero, zero),
        osim.PinJoint("B", crank, v3(p.r, 0, 0), zero, rod, zero, zero),
        osim.SliderJoint("S", model.getGround(), v3(0, p.e, 0), zero, slider, zero, zero),
    )
    for body in (crank, rod, slider):
        model.addBody(body)
    for joint in joints:
        model.addJoint(joint)
    model.addConstraint(osim.PointConstraint(rod, v3(p.l, 0, 0), slider, zero))
    push = osim.PrescribedForce("F", slider)
    push.setForceFunctions(osim.Constant(p.force), osim.Constant(0), osim.Constant(0))
    push.setPointIsInGlobalFrame(False)
    push.setForceIsInGlobalFrame(True)
    model.addForce(push)
    turning = joints[0].updCoordinate()
    turning.setPrescribedFunction(osim.LinearFunction(p.speed, 0.0))
    turning.setDefaultIsPrescribed(True)
    joints[1].updCoordinate().setDefaultValue(float(np.arcsin(p.e / p.l)))
    joints[2].updCoordinate().setDefaultValue(p.r + float(np.sqrt(p.l**2 - p.e**2)))
    model.finalizeConnections()
    state = model.initSystem()
    matter, on_bodies, on_joints = model.getMatterSubsystem(), osim.VectorOfSpatialVec(), osim.Vector()
    coordinates = [joint.getCoordinate() for joint in joints]
    end = v3(p.l, 0, 0)

    def solve(angles):
        n = len(angles)
        computed = {k: np.empty((n, 2)) for k in "OBC"} | {k: np.empty(n) for k in ("guide", "torque")}
        q, v, before = np.array([0.0, 0.0, p.r + p.l]), np.array([p.speed, 0.0, 0.0]), angles[0]
        for k in range(n):
            state.setTime(float(angles[k] / p.speed))
            q += v * ((angles[k] - before) / p.speed)
            q[0] = before = angles[k]
            for _ in range(20):
                for coordinate, value in zip(coordinates, q.tolist(), strict=True):
                    coordinate.setValue(state, value, False)
                model.realizePosition(state)
                at_b, at_c = rod.getPositionInGround(state), rod.findStationLocationInGround(state, end)
                c, s = at_c.get(0) - at_b.get(0), at_c.get(1) - at_b.get(1)
                turn = (p.e - at_c.get(1)) / c
                slide = at_c.get(0) - q[2] - s * turn
                q[1:] += turn, slide
                if max(abs(turn), abs(slide)) < 1e-14:
                    break
            spin = -p.speed * at_b.get(0) / c
            v[1:] = spin - p.speed, -p.speed * at_b.get(1) - spin * s
            for coordinate, value in zip(coordinates, v.tolist(), strict=True):
                coordinate.setSpeedValue(state, value)
            model.realizeAcceleration(state)
            for name, joint in zip("OB", joints, strict=False):
                force = joint.calcReactionOnChildExpressedInGround(state).get(1)
                computed[name][k] = force.get(0), force.get(1)
            computed["guide"][k] = joints[2].calcReactionOnChildExpressedInGround(state).get(1).get(1)
            matter.findConstraintForces(state, on_bodies, on_joints)
            computed["torque"][k] = -on_joints.get(0)
            slider_force = on_bodies.get(slider.getMobilizedBodyIndex()).get(1)
            computed["C"][k] = -slider_force.get(0), -slider_force.get(1)
        return computed

    return solve


ROWS = {"slider-crank": {"OpenSim realizeAcceleration + own loop closure": slider_crank}}
