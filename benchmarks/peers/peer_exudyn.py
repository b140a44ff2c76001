"""exudyn: rigid bodies in the plane, joints as constraints, the crank's speed prescribed, steps through the turn.

Implicit trapezoidal rule, index 2: of the engine's integrators the one with the smallest errors of accelerations and forces here.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from problem import FOUR_BAR, GRAVITY, SLIDER_CRANK

PACKAGES = ("exudyn==1.13.6",)


class Scene:
    """Bodies, joints and sensors of a mechanism, and how it is run."""

    def __init__(self, steps: int, speed: float):
        import exudyn
        from exudyn import itemInterface as items

        self.exu, self.items, self.steps, self.speed = exudyn, items, steps, speed
        self.mbs = exudyn.SystemContainer().AddSystem()
        self.ground = self.mbs.AddObject(items.ObjectGround())
        settings = exudyn.SimulationSettings()
        settings.timeIntegration.verboseMode = 0
        settings.timeIntegration.newton.useModifiedNewton = False
        alpha = settings.timeIntegration.generalizedAlpha
        alpha.computeInitialAccelerations = alpha.useNewmark = alpha.useIndex2Constraints = True
        if steps > 1:  # else the stop of Newton's method, not the step, decides the error of the forces
            newton = settings.timeIntegration.newton
            newton.relativeTolerance, newton.absoluteTolerance = 1e-11, 1e-12
        settings.solutionSettings.writeSolutionToFile = False
        settings.displayComputationTime = settings.displayStatistics = False
        self.settings = settings
        self.sensors = {}

    def body(self, mass, inertia, force, pose, rates):
        """A rigid body, its node at the centre of mass, where the force acts; returns body and node."""
        node = self.mbs.AddNode(self.items.NodeRigidBody2D(referenceCoordinates=list(pose), initialVelocities=list(rates)))
        body = self.mbs.AddObject(self.items.ObjectRigidBody2D(mass=mass, inertia=inertia, nodeNumber=node))
        if force is not None:
            marker = self.mbs.AddMarker(self.items.MarkerNodePosition(nodeNumber=node))
            self.mbs.AddLoad(self.items.Force(markerNumber=marker, loadVector=[*force, 0.0]))
        return body, node

    def pin(self, first, at_first, second, at_second):
        markers = [
            self.mbs.AddMarker(self.items.MarkerBodyPosition(bodyNumber=b, localPosition=[*at, 0.0]))
            for b, at in ((first, at_first), (second, at_second))
        ]
        return self.mbs.AddObject(self.items.RevoluteJoint2D(markerNumbers=markers))

    def hold(self, node, coordinate, speed):
        """Prescribe the speed of a coordinate of a node against the ground."""
        fixed = self.mbs.AddNode(self.items.NodePointGround())
        markers = [
            self.mbs.AddMarker(self.items.MarkerNodeCoordinate(nodeNumber=fixed, coordinate=0)),
            self.mbs.AddMarker(self.items.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate)),
        ]
        moving = speed != 0.0
        connector = self.items.CoordinateConstraint(markerNumbers=markers, offset=speed, velocityLevel=moving)
        return self.mbs.AddObject(connector)

    def watch(self, key, obj, kind, place=None):
        output = getattr(self.exu.OutputVariableType, kind)
        if place is None:
            sensor = self.items.SensorObject(objectNumber=obj, outputVariableType=output, storeInternal=True, writeToFile=False)
        else:
            sensor = self.items.SensorBody(
                bodyNumber=obj, localPosition=[*place, 0.0], outputVariableType=output, storeInternal=True, writeToFile=False
            )
        self.sensors[key] = self.mbs.AddSensor(sensor)

    def run(self, angles):
        n, turn = len(angles), angles[1] - angles[0]
        integration = self.settings.timeIntegration
        integration.numberOfSteps = self.steps * (n - 1)
        integration.endTime = float(turn * (n - 1) / self.speed)
        self.settings.solutionSettings.sensorsWritePeriod = float(turn / self.speed)
        self.mbs.SolveDynamic(self.settings)
        return {k: self.mbs.GetSensorStoredData(s)[:, 1:] for k, s in self.sensors.items()}


def four_bar(*, steps: int):
    """The engine needs masses; they change nothing of the prescribed motion."""
    from problem import four_bar as reference

    p = FOUR_BAR
    start = reference(np.zeros(1))
    b, c = start["B", 0][0], start["C", 0][0]
    x, y = np.arctan2(*(c - b)[::-1]), np.arctan2(*(c - (p.ground, 0.0))[::-1])
    b1, c1 = start["B", 1][0], start["C", 1][0]
    wx = ((c1 - b1) @ (-np.sin(x), np.cos(x))) / p.coupler
    wy = (c1 @ (-np.sin(y), np.cos(y))) / p.rocker
    scene = Scene(steps, p.speed)
    crank, crank_node = scene.body(1.0, 0.1, None, (0.0, 0.0, 0.0), (0.0, 0.0, p.speed))
    coupler, _ = scene.body(1.0, 0.1, None, (*b, x), (*b1, wx))
    rocker, _ = scene.body(1.0, 0.1, None, (p.ground, 0.0, y), (0.0, 0.0, wy))
    o = (0.0, 0.0)
    scene.pin(scene.ground, o, crank, o)
    scene.pin(crank, (p.crank, 0.0), coupler, o)
    scene.pin(coupler, (p.coupler, 0.0), rocker, (p.rocker, 0.0))
    scene.pin(scene.ground, (p.ground, 0.0), rocker, o)
    scene.hold(crank_node, 2, p.speed)
    for name, body, place in (("B", crank, (p.crank, 0.0)), ("C", rocker, (p.rocker, 0.0)), ("P", coupler, p.p)):
        for derivative, kind in enumerate(("Position", "Velocity", "Acceleration")):
            scene.watch((name, derivative), body, kind, place)
    scene.mbs.Assemble()

    def solve(angles):
        return {k: v[:, :2] for k, v in scene.run(angles).items()}

    return solve


def slider_crank(*, steps: int):
    p = SLIDER_CRANK
    scene = Scene(steps, p.speed)
    rod_angle = np.arcsin(p.e / p.l)
    c, s = np.cos(rod_angle), np.sin(rod_angle)
    spin = -p.r * p.speed / (p.l * c)
    at_s2 = np.array([p.r + p.s2 * c, p.s2 * s])
    v_s2 = np.array([-p.s2 * s * spin, p.r * p.speed + p.s2 * c * spin])
    x3, v3 = p.r + p.l * c, -p.l * s * spin
    weights = [-GRAVITY * m for m in p.m]
    crank, crank_node = scene.body(p.m[0], p.j[0], (0.0, weights[0]), (p.s1, 0.0, 0.0), (0.0, p.s1 * p.speed, p.speed))
    rod, _ = scene.body(p.m[1], p.j[1], (0.0, weights[1]), (*at_s2, rod_angle), (*v_s2, spin))
    slider, slider_node = scene.body(p.m[2], 1e-3, (p.force, weights[2]), (x3, p.e, 0.0), (v3, 0.0, 0.0))
    joints = {
        "O": scene.pin(scene.ground, (0.0, 0.0), crank, (-p.s1, 0.0)),
        "B": scene.pin(crank, (p.r - p.s1, 0.0), rod, (-p.s2, 0.0)),
        "C": scene.pin(rod, (p.l - p.s2, 0.0), slider, (0.0, 0.0)),
        "guide": scene.hold(slider_node, 1, 0.0),
        "couple": scene.hold(slider_node, 2, 0.0),
        "torque": scene.hold(crank_node, 2, p.speed),
    }
    for name, joint in joints.items():
        scene.watch(name, joint, "Force")
    scene.mbs.Assemble()

    def solve(angles):
        result = scene.run(angles)
        return {k: -result[k][:, :2] for k in "OBC"} | {k: -result[k][:, 0] for k in ("guide", "torque")}

    return solve


ROWS = {
    problem: {f"exudyn, {k} step{'s' * (k > 1)} a position": partial(build, steps=k) for k in (1, 10)}
    for problem, build in (("four-bar", four_bar), ("slider-crank", slider_crank))
}

STEPS = (1, 2, 5, 10, 100)
SETTINGS = {
    (problem, panel): {"exudyn": lambda build=build: {f"{k} step{'s' * (k > 1)} a position": build(steps=k) for k in STEPS}}
    for problem, panel, build in (("four-bar", "rates", four_bar), ("slider-crank", "forces", slider_crank))
}
